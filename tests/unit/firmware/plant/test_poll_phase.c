/* Phase of polls: when they start, that they end before their instants, and that there are no more
 * of them than periods. The time is simulated. */
#include "firmware/plant/poll_phase.h"

#include <unity.h>

#include "tests/support/random_numbers.h"

enum { CASES = 300, POLLS = 2600, LEARNED = 1030 };

static const tl_time US = 1000;
static const tl_time MS = 1000000;

void setUp(void) {}

void tearDown(void) {}

static void expect_start(tl_time expected, tl_poll_phase *phase, tl_time origin, tl_time now) {
    TEST_ASSERT_EQUAL_INT64(expected, tl_poll_phase_next(phase, origin, now));
}

static void without_a_phase_a_poll_starts_each_period(void) {
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, 10 * MS, 7 * MS);
    expect_start(17 * MS, &phase, -1, 9 * MS);
    expect_start(27 * MS, &phase, -1, 26 * MS);
    expect_start(37 * MS, &phase, -1, 27 * MS);
}

/* Before the run starts, its lead is learned already. */
static void without_a_run_the_grid_stays(void) {
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, 10 * MS, 7 * MS);
    expect_start(17 * MS, &phase, 0, 8 * MS);
    expect_start(27 * MS - 1200 * US, &phase, 0, 18 * MS);
    expect_start(45 * MS - 1200 * US, &phase, 15 * MS, 27 * MS);
}

static void missed_instants_are_skipped(void) {
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, 10 * MS, 0);
    expect_start(30 * MS, &phase, -1, 25 * MS);
    expect_start(60 * MS, &phase, -1, 55 * MS);
}

/* A slow first poll counts in the first window only, of two polls. */
static void the_first_poll_may_connect(void) {
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, 10 * MS, 7 * MS);
    expect_start(20 * MS, &phase, 1000 * MS, 16 * MS);
    expect_start(20800 * US, &phase, 1000 * MS, 21 * MS);
    TEST_ASSERT_EQUAL_INT64(30 * MS, phase.due);
    for (int i = 0; i < 4; i++) {
        (void)tl_poll_phase_next(&phase, 1000 * MS, phase.due - phase.lead + MS);
    }
    TEST_ASSERT_EQUAL_INT64(1200 * US, phase.lead);
    TEST_ASSERT_EQUAL_INT64(70 * MS, phase.due);
}

/* A tenth of the polls takes 3 ms: the lead is 0.2 ms more. A hundredth: to wait for these would
 * cost more than it gains. */
static void the_lead_weighs_late_polls(void) {
    static const struct {
        int every;
        tl_time lead;
    } cases[] = {{10, 3200000}, {100, 700000}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        tl_poll_phase phase;
        tl_poll_phase_begin(&phase, 10 * MS, 0);
        for (int i = 0; i < LEARNED; i++) {
            tl_time needed = i % cases[c].every == 0 ? 3 * MS : 500 * US;
            (void)tl_poll_phase_next(&phase, 10 * MS, phase.due - phase.lead + needed);
        }
        TEST_ASSERT_EQUAL_INT64(cases[c].lead, phase.lead);
    }
}

/* Three slow polls in a window of 512 change no lead. */
static void a_single_slow_poll_has_no_effect(void) {
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, 10 * MS, 0);
    tl_time start = 0;
    for (int i = 0; i < POLLS; i++) {
        start = tl_poll_phase_next(&phase, 5 * MS, start + (i % 200 == 199 ? 8 * MS : MS));
        TEST_ASSERT_EQUAL_INT64(i == 0 ? 0 : 1200 * US, phase.lead);
    }
}

/* A poll that takes longer than a period starts at the first instant after the one before. */
static void long_polls_keep_their_rate(void) {
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, 10 * MS, 0);
    tl_time start = 0;
    for (int64_t i = 1; i < POLLS; i++) {
        start = tl_poll_phase_next(&phase, 10 * MS, start + 15 * MS);
        TEST_ASSERT_EQUAL_INT64(i * 20 * MS, start);
        TEST_ASSERT_EQUAL_INT64(0, phase.lead);
    }
}

static void a_new_grid_adds_no_poll(void) {
    tl_poll_phase phase;
    tl_poll_phase_begin(&phase, 10 * MS, 0);
    expect_start(10 * MS, &phase, 10 * MS, MS);
    expect_start(20 * MS - 1200 * US, &phase, 10 * MS, 11 * MS);
    tl_time start = tl_poll_phase_next(&phase, 13 * MS, 20 * MS);
    TEST_ASSERT_EQUAL_INT64(33 * MS, phase.due);
    TEST_ASSERT_TRUE(start >= 20 * MS - 1200 * US + 10 * MS);
}

static void any_origin_is_safe(void) {
    static const tl_time origins[] = {1, 9999999, INT64_MAX - 1, INT64_MAX};
    for (size_t i = 0; i < sizeof origins / sizeof origins[0]; i++) {
        tl_poll_phase phase;
        tl_poll_phase_begin(&phase, 10 * MS, 1000 * MS);
        tl_time start = tl_poll_phase_next(&phase, origins[i], 1001 * MS);
        TEST_ASSERT_TRUE(start >= 1010 * MS && start < 1020 * MS);
        TEST_ASSERT_EQUAL_INT64(0, (phase.due - origins[i] % (10 * MS)) % (10 * MS));
    }
}

/* A source that needs `base` to base + jitter, now and then much longer. */
static tl_time time_of_poll(tl_test_random *random, tl_time period, tl_time base, tl_time jitter) {
    return tl_test_random_below(random, 4000) == 0 ? 3 * period
                                                   : base + (tl_time)tl_test_random_below(random, (size_t)jitter + 1);
}

/* Any start, any step, a period that divides it or is a multiple of it: after it has learned, a
 * poll ends at most jitter + 0.2 ms before its instant, and rarely later. */
static void polls_end_before_ticks(void) {
    tl_test_random random = {.state = 7};
    for (int i = 0; i < CASES; i++) {
        static const tl_time periods[] = {1000000, 10000000, 100000000};
        tl_time period = periods[tl_test_random_below(&random, 3)];
        tl_time ratio = (tl_time)tl_test_random_between(&random, 1, 5);
        bool is_dense = tl_test_random_chance(&random, 50);
        tl_time step = is_dense ? period * ratio : period;
        period = is_dense ? period : period * ratio;
        tl_time base = (tl_time)tl_test_random_below(&random, (size_t)(period / 2));
        tl_time jitter = (tl_time)tl_test_random_below(&random, (size_t)(period / 8));
        tl_time origin = (tl_time)tl_test_random_between(&random, 1, 1000000000);
        tl_time begin = (tl_time)tl_test_random_between(&random, 1, 1000000000);
        tl_poll_phase phase;
        tl_poll_phase_begin(&phase, period, begin);
        tl_time start = begin;
        tl_time last = begin;
        int late = 0;
        for (int poll = 0; poll < POLLS; poll++) {
            tl_time end = start + time_of_poll(&random, period, base, jitter);
            if (poll > LEARNED) {
                tl_time slack = phase.due - end;
                late += slack < 0 ? 1 : 0;
                TEST_ASSERT_TRUE(slack <= jitter + 200 * US);
                TEST_ASSERT_EQUAL_INT64(0, (phase.due - origin) % (step < period ? step : period));
            }
            start = tl_poll_phase_next(&phase, origin, end);
            start = start > end ? start : end; /* the thread cannot begin earlier */
            TEST_ASSERT_TRUE(phase.due - last >= period || poll == 0);
            TEST_ASSERT_TRUE(phase.lead >= 0 && phase.lead <= period);
            last = phase.due;
        }
        TEST_ASSERT_TRUE_MESSAGE(late <= (POLLS - LEARNED) / 100, "late");
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(without_a_phase_a_poll_starts_each_period);
    RUN_TEST(without_a_run_the_grid_stays);
    RUN_TEST(missed_instants_are_skipped);
    RUN_TEST(the_first_poll_may_connect);
    RUN_TEST(the_lead_weighs_late_polls);
    RUN_TEST(a_single_slow_poll_has_no_effect);
    RUN_TEST(long_polls_keep_their_rate);
    RUN_TEST(a_new_grid_adds_no_poll);
    RUN_TEST(any_origin_is_safe);
    RUN_TEST(polls_end_before_ticks);
    return UNITY_END();
}
