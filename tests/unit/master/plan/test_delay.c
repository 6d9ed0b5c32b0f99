/* Delays of chains: table 5.16, groups, and densities against a numerical convolution.
 * TL_TEST_CHAINS is the number of random chains. */
#include <math.h>
#include <stdlib.h>

#include <unity.h>

#include "master/plan/plan.h"
#include "tests/support/random_numbers.h"

#define MS ((tl_time)1000000)

enum { BUS, PLANT, ACQUISITION, SIMULATION, PARTICIPANTS };

/* Table 5.16. Acquisition and simulation share a time base. */
static const tl_delay_participant table[PARTICIPANTS] = {
    [BUS] = {0, 8 * MS, BUS},
    [PLANT] = {10 * MS, MS / 10, PLANT},
    [ACQUISITION] = {4 * MS, 4 * MS, ACQUISITION},
    [SIMULATION] = {4 * MS, 4 * MS, ACQUISITION},
};

void setUp(void) {}

void tearDown(void) {}

static void table_516_of_the_thesis(void) {
    const size_t plant[] = {BUS, PLANT, BUS};
    const size_t simulation[] = {BUS, ACQUISITION, SIMULATION, SIMULATION};
    tl_delay_density density;
    TEST_ASSERT_TRUE(tl_delay_of_chain(table, plant, 3, &density));
    TEST_ASSERT_EQUAL_INT64(0, density.dead);
    TEST_ASSERT_EQUAL_size_t(2, density.count);
    TEST_ASSERT_EQUAL_INT64(MS / 10, density.cycles[0]);
    TEST_ASSERT_EQUAL_INT64(8 * MS, density.cycles[1]);
    TEST_ASSERT_EQUAL_INT64(8 * MS, tl_delay_mode(&density));
    TEST_ASSERT_EQUAL_INT64(81 * MS / 10, tl_delay_longest(&density));
    TEST_ASSERT_TRUE(tl_delay_of_chain(table, simulation, 4, &density));
    TEST_ASSERT_EQUAL_INT64(12 * MS, density.dead);
    TEST_ASSERT_EQUAL_size_t(1, density.count);
    TEST_ASSERT_EQUAL_INT64(16 * MS, tl_delay_mode(&density));
}

static void table_516_of_the_inputs(void) {
    const size_t plant[] = {BUS, PLANT};
    const size_t simulation[] = {BUS, ACQUISITION, SIMULATION};
    tl_delay_density density;
    TEST_ASSERT_TRUE(tl_delay_of_chain(table, plant, 2, &density));
    TEST_ASSERT_EQUAL_INT64(MS / 10, tl_delay_mode(&density));
    TEST_ASSERT_TRUE(tl_delay_of_chain(table, simulation, 3, &density));
    TEST_ASSERT_EQUAL_INT64(12 * MS, tl_delay_mode(&density));
}

static void a_dead_time_counts_in_a_group_and_once(void) {
    const tl_delay_participant parts[] = {{1, 10, 0}, {20, 10, 0}, {300, 10, 1}, {4000, 10, 1}, {50000, 10, 2}};
    const size_t groups[] = {0, 1, 2, 3, 4};
    const size_t same[] = {4, 4};
    const size_t apart[] = {0, 2, 0};
    tl_delay_density density;
    TEST_ASSERT_TRUE(tl_delay_of_chain(parts, groups, 5, &density));
    TEST_ASSERT_EQUAL_INT64(4321, density.dead);
    TEST_ASSERT_EQUAL_size_t(2, density.count);
    TEST_ASSERT_TRUE(tl_delay_of_chain(parts, same, 2, &density));
    TEST_ASSERT_EQUAL_INT64(100000, density.dead);
    TEST_ASSERT_EQUAL_size_t(0, density.count);
    TEST_ASSERT_EQUAL_INT64(100000, tl_delay_mode(&density));
    TEST_ASSERT_TRUE(tl_delay_density_at(&density, 100000) == 0.0);
    TEST_ASSERT_TRUE(tl_delay_of_chain(parts, apart, 3, &density));
    TEST_ASSERT_EQUAL_INT64(0, density.dead);
    TEST_ASSERT_EQUAL_size_t(2, density.count);
    TEST_ASSERT_TRUE(tl_delay_of_chain(parts, apart, 1, &density));
    TEST_ASSERT_EQUAL_INT64(0, tl_delay_mode(&density));
}

static void more_links_than_there_is_room_for(void) {
    const size_t chain[] = {BUS, PLANT, BUS, PLANT, BUS, PLANT, BUS, PLANT, BUS};
    tl_delay_density density;
    TEST_ASSERT_TRUE(tl_delay_of_chain(table, chain, 8, &density));
    TEST_ASSERT_EQUAL_size_t(TL_DELAY_LINKS, density.count);
    TEST_ASSERT_FALSE(tl_delay_of_chain(table, chain, 9, &density));
}

static tl_delay_density density_of(size_t count, const tl_time *cycles) {
    tl_delay_density density = {.count = count};
    for (size_t i = 0; i < count; i++) {
        density.cycles[i] = cycles[i];
    }
    return density;
}

static void two_uniforms_are_a_trapezoid(void) {
    const tl_delay_density density = density_of(2, (const tl_time[]){MS / 10, 8 * MS});
    const double top = 1.0 / 0.008;
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.0, tl_delay_density_at(&density, -1));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.0, tl_delay_density_at(&density, 0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, top / 2, tl_delay_density_at(&density, MS / 20));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, top, tl_delay_density_at(&density, MS / 10));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, top, tl_delay_density_at(&density, 5 * MS));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, top, tl_delay_density_at(&density, 8 * MS));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, top / 2, tl_delay_density_at(&density, 8 * MS + MS / 20));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.0, tl_delay_density_at(&density, 8 * MS + MS / 10));
}

/* Irwin and Hall: the density in the middle is 3/4 of the reciprocal cycle for three equal cycles,
 * 2/3 for four. */
static void equal_uniforms_are_irwin_and_hall(void) {
    const tl_time equal[] = {MS, MS, MS, MS};
    const tl_delay_density three = density_of(3, equal);
    const tl_delay_density four = density_of(4, equal);
    TEST_ASSERT_EQUAL_INT64(3 * MS / 2, tl_delay_mode(&three));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 750.0, tl_delay_density_at(&three, 3 * MS / 2));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 500.0, tl_delay_density_at(&three, MS));
    TEST_ASSERT_EQUAL_INT64(2 * MS, tl_delay_mode(&four));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 2000.0 / 3.0, tl_delay_density_at(&four, 2 * MS));
}

/* With 1 ns beside 1 s, truncated powers would lose all digits. */
static void nothing_cancels(void) {
    const tl_delay_density density = density_of(7, (const tl_time[]){1, 1, 2, 3, TL_SECOND, 5, 1});
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.0, tl_delay_density_at(&density, TL_SECOND / 2));
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 1.0, tl_delay_density_at(&density, TL_SECOND));
    TEST_ASSERT_EQUAL_INT64(TL_SECOND, tl_delay_mode(&density));
}

/* ---- compared with a numerical convolution ---- */

enum { CELLS = 4096, LONGEST = 500 };

static double cells[CELLS];

/* Cells of 1 ns: the probability of each sum of uniforms that are rounded down to whole ns. Exact
 * except for rounding errors. */
static void convolve(const tl_delay_density *density) {
    for (size_t i = 0; i < CELLS; i++) {
        cells[i] = i == 0 ? 1.0 : 0.0;
    }
    for (size_t k = 0; k < density->count; k++) {
        size_t width = (size_t)density->cycles[k];
        double before[CELLS];
        double sum = 0.0;
        for (size_t i = 0; i < CELLS; i++) {
            before[i] = cells[i];
            sum += before[i] - (i >= width ? before[i - width] : 0.0);
            cells[i] = sum / (double)width;
        }
    }
}

/* The rounding down shifts the cells by (n − 1)/2 ns on average, and blurs them. */
static void expect_convolution(const tl_delay_density *density) {
    tl_time half = (tl_time)(density->count - 1) / 2;
    double top = 0.0;
    convolve(density);
    for (size_t i = 0; i < CELLS; i++) {
        top = fmax(top, cells[i]);
    }
    for (tl_time at = half; at < tl_delay_longest(density); at++) {
        double exact = tl_delay_density_at(density, at) / 1e9;
        TEST_ASSERT_DOUBLE_WITHIN(0.02 * top, cells[at - half], exact);
    }
}

static void expect_mode(const tl_delay_density *density) {
    double top = tl_delay_density_at(density, tl_delay_mode(density));
    tl_time longest = tl_delay_longest(density);
    for (tl_time at = 0; at <= longest; at++) {
        double here = tl_delay_density_at(density, at);
        TEST_ASSERT_TRUE(here <= top * (1.0 + 1e-12));
        TEST_ASSERT_DOUBLE_WITHIN(top * 1e-9, here, tl_delay_density_at(density, longest - at));
        if (at > tl_delay_mode(density) + 1) {
            TEST_ASSERT_TRUE(here < top);
        }
    }
}

/* Odd counts, so that the shift is a whole number of cells. */
static void random_sums_are_what_convolving_gives(void) {
    tl_test_random chance = {.state = 11};
    const char *wanted = getenv("TL_TEST_CHAINS");
    long chains = wanted != NULL ? strtol(wanted, NULL, 10) : 12;
    for (long n = 0; n < chains; n++) {
        tl_delay_density density = {.count = 3 + 2 * (size_t)(n % 2)};
        for (size_t i = 0; i < density.count; i++) {
            density.cycles[i] = (tl_time)tl_test_random_number(&chance, 120.0, LONGEST);
        }
        if (n % 3 == 0) {
            density.cycles[0] = 2000;
        }
        expect_convolution(&density);
        expect_mode(&density);
    }
}

static void the_density_is_one_in_all(void) {
    const tl_delay_density density = density_of(4, (const tl_time[]){700, 300, 500, 1100});
    double sum = 0.0;
    for (tl_time at = 0; at <= tl_delay_longest(&density); at++) {
        sum += tl_delay_density_at(&density, at) / 1e9;
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.0, sum);
}

/* ---- look-ups ---- */

static void expect_look_up(tl_time shift, tl_time wait, tl_time step, int32_t ticks, tl_time look_back) {
    tl_delay_lookup found = tl_delay_look_up(shift, wait, step);
    TEST_ASSERT_EQUAL_INT32(ticks, found.ticks);
    TEST_ASSERT_EQUAL_INT64(look_back, found.look_back);
    TEST_ASSERT_EQUAL_INT64(shift, found.ticks * step - found.look_back);
}

static void a_shift_is_ticks_and_what_is_left(void) {
    expect_look_up(0, 0, 4 * MS, 0, 0);
    expect_look_up(-8 * MS, 0, 4 * MS, -2, 0);
    expect_look_up(8 * MS, 0, 4 * MS, 2, 0);
    expect_look_up(-3 * MS, 0, 10 * MS, 0, 3 * MS);
    expect_look_up(3 * MS, 0, 10 * MS, 1, 7 * MS);
    expect_look_up(-13 * MS, 0, 10 * MS, -1, 3 * MS);
    expect_look_up(-8 * MS, 8 * MS, 4 * MS, 0, 8 * MS);
    expect_look_up(0, 8 * MS, 4 * MS, 2, 8 * MS);
    expect_look_up(-3 * MS, 8 * MS, 4 * MS, 2, 11 * MS);
    expect_look_up(-1, 0, 4 * MS, 0, 1);
    expect_look_up(1, 0, 4 * MS, 1, 4 * MS - 1);
}

static void a_measured_delay_moves_by_whole_ticks(void) {
    TEST_ASSERT_EQUAL_INT32(0, tl_delay_ticks(0, 0, 4 * MS));
    TEST_ASSERT_EQUAL_INT32(-2, tl_delay_ticks(0, 8 * MS, 4 * MS));
    TEST_ASSERT_EQUAL_INT32(-2, tl_delay_ticks(0, 9 * MS, 4 * MS));
    TEST_ASSERT_EQUAL_INT32(-3, tl_delay_ticks(0, 11 * MS, 4 * MS));
    TEST_ASSERT_EQUAL_INT32(3, tl_delay_ticks(0, -11 * MS, 4 * MS));
    TEST_ASSERT_EQUAL_INT32(0, tl_delay_ticks(8 * MS, 8 * MS, 4 * MS));
    TEST_ASSERT_EQUAL_INT32(2, tl_delay_ticks(8 * MS, MS, 4 * MS));
    TEST_ASSERT_EQUAL_INT32(-1, tl_delay_ticks(8 * MS, 13 * MS, 4 * MS));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(table_516_of_the_thesis);
    RUN_TEST(table_516_of_the_inputs);
    RUN_TEST(a_dead_time_counts_in_a_group_and_once);
    RUN_TEST(more_links_than_there_is_room_for);
    RUN_TEST(two_uniforms_are_a_trapezoid);
    RUN_TEST(equal_uniforms_are_irwin_and_hall);
    RUN_TEST(nothing_cancels);
    RUN_TEST(random_sums_are_what_convolving_gives);
    RUN_TEST(the_density_is_one_in_all);
    RUN_TEST(a_shift_is_ticks_and_what_is_left);
    RUN_TEST(a_measured_delay_moves_by_whole_ticks);
    return UNITY_END();
}
