/* Seeded noise: the published numbers of its generator, and its distributions. */
#include <math.h>
#include <stdint.h>

#include <unity.h>

#include "firmware/cli/emulation.h"

enum { DRAWS = 200000 };

void setUp(void) {}

void tearDown(void) {}

/* Upper 53 bits of SplitMix64 (Steele, Lea, Flood 2014; output of the reference implementation). */
static void test_known_numbers(void) {
    static const uint64_t from_0[] = {UINT64_C(0xe220a8397b1dcdaf), UINT64_C(0x6e789e6aa1b965f4),
                                      UINT64_C(0x06c45d188009454f)};
    static const uint64_t from_1234567[] = {UINT64_C(6457827717110365317), UINT64_C(3203168211198807973),
                                            UINT64_C(9817491932198370423), UINT64_C(4593380528125082431)};
    tl_random noise = {0};
    for (size_t i = 0; i < sizeof from_0 / sizeof *from_0; i++) {
        TEST_ASSERT_EQUAL_DOUBLE((double)(from_0[i] >> 11) / 9007199254740992.0, tl_random_uniform(&noise));
    }
    noise.state = 1234567;
    for (size_t i = 0; i < sizeof from_1234567 / sizeof *from_1234567; i++) {
        double expected = (double)(from_1234567[i] >> 11) / 9007199254740992.0;
        double found = tl_random_uniform(&noise);
        TEST_ASSERT_EQUAL_MEMORY(&expected, &found, sizeof expected);
    }
}

static void test_uniform(void) {
    tl_random noise = {1};
    double sum = 0.0;
    double squares = 0.0;
    for (int i = 0; i < DRAWS; i++) {
        double value = tl_random_uniform(&noise);
        TEST_ASSERT_TRUE(value >= 0.0 && value < 1.0);
        sum += value;
        squares += (value - 0.5) * (value - 0.5);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.003, 0.5, sum / DRAWS);
    TEST_ASSERT_DOUBLE_WITHIN(0.001, 1.0 / 12.0, squares / DRAWS);
}

static void test_normal(void) {
    tl_random noise = {1};
    double moments[5] = {0};
    int within_1 = 0;
    int within_2 = 0;
    for (int i = 0; i < DRAWS; i++) {
        double value = tl_random_normal(&noise);
        for (int k = 1; k <= 4; k++) {
            moments[k] += pow(value, k) / DRAWS;
        }
        within_1 += fabs(value) < 1.0 ? 1 : 0;
        within_2 += fabs(value) < 2.0 ? 1 : 0;
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.0, moments[1]);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 1.0, moments[2]);
    TEST_ASSERT_DOUBLE_WITHIN(0.04, 0.0, moments[3]);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 3.0, moments[4]);
    TEST_ASSERT_DOUBLE_WITHIN(0.005, 0.6827, (double)within_1 / DRAWS);
    TEST_ASSERT_DOUBLE_WITHIN(0.002, 0.9545, (double)within_2 / DRAWS);
}

/* Consecutive draws are not correlated. */
static void test_draws_are_not_correlated(void) {
    tl_random noise = {3};
    double sum = 0.0;
    double last = tl_random_normal(&noise);
    for (int i = 0; i < DRAWS; i++) {
        double value = tl_random_normal(&noise);
        sum += value * last;
        last = value;
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.0, sum / DRAWS);
}

static void test_a_seed_is_a_sequence(void) {
    tl_random one = {42};
    tl_random same = {42};
    tl_random other = {43};
    int equal = 0;
    for (int i = 0; i < 1000; i++) {
        double expected = tl_random_normal(&one);
        double found = tl_random_normal(&same);
        TEST_ASSERT_EQUAL_MEMORY(&expected, &found, sizeof expected);
        equal += tl_random_normal(&other) == expected ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_INT(0, equal);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_known_numbers);
    RUN_TEST(test_uniform);
    RUN_TEST(test_normal);
    RUN_TEST(test_draws_are_not_correlated);
    RUN_TEST(test_a_seed_is_a_sequence);
    return UNITY_END();
}
