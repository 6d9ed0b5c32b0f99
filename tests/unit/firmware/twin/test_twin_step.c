/* Results of a tick from the untrusted FMU process: valid and invalid values. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/twin_step.h"

enum { TICK = 50, LEAST = 40 };

static const tl_config config = {.signal_count = 2, .component_count = 2, .match_count = 2, .adjust_count = 1};
static tl_twin_result result;

/* A valid result. Fields without a signal have arbitrary bytes. */
void setUp(void) {
    memset(&result, 0xA5, sizeof result);
    result.tick = TICK;
    result.status = TL_OK;
    result.ready = 1;
    result.record.step = TICK - 1;
    result.record.outcome = TL_OPTIMISED;
    result.record.stop = TL_STOP_TOLERANCE;
    result.record.flags = TL_FLAG_FALLBACK;
    result.record.delay_state = TL_DELAY_KNOWN;
    result.identifiability.since = TICK;
    result.record.measured_quality[0] = TL_GOOD;
    result.record.measured_quality[1] = TL_STALE;
}

void tearDown(void) {}

static bool is_sound(void) {
    return tl_twin_result_is_sound(&result, &config, TICK, LEAST);
}

static void test_a_good_one(void) {
    TEST_ASSERT_TRUE(is_sound());
}

static void test_the_ends_of_all_ranges(void) {
    result.record.step = TICK;
    result.record.outcome = TL_RESUMED;
    result.record.stop = TL_STOP_TIME;
    result.record.flags = 2 * TL_LAST_FLAG - 1;
    result.record.delay_state = TL_DELAY_LOST;
    result.record.measured_quality[1] = TL_OUTLIER;
    result.status = TL_TRY_AGAIN;
    TEST_ASSERT_TRUE(is_sound());
    result.record.step = LEAST;
    result.record.outcome = TL_FREE;
    result.record.stop = TL_STOP_NONE;
    result.record.flags = 0;
    result.record.delay_state = TL_DELAY_UNKNOWN;
    TEST_ASSERT_TRUE(is_sound());
}

/* Values of plant and FMU are not checked. */
static void test_numbers_are_not_judged(void) {
    result.record.objective = (double)NAN;
    result.record.y[0] = (double)INFINITY;
    result.record.u[0] = -(double)NAN;
    result.record.evaluations = UINT32_MAX;
    result.record.used = INT64_MIN;
    TEST_ASSERT_TRUE(is_sound());
}

/* ---- each field wrong ---- */

static void test_of_another_tick(void) {
    const int64_t wrong[] = {TICK - 1, TICK + 1, 0, TL_TWIN_NO_TICK, INT64_MAX};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        result.tick = wrong[i];
        TEST_ASSERT_FALSE(is_sound());
    }
}

static void test_a_step_of_a_finding_that_is_none(void) {
    const int64_t wrong[] = {-1, TICK + 1, INT64_MIN, INT64_MAX};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        result.identifiability.since = wrong[i];
        TEST_ASSERT_FALSE(is_sound());
    }
}

/* The FMU process must not report an interruption, which would look like one by the user. */
static void test_a_status_that_is_none(void) {
    const int32_t wrong[] = {TL_INTERRUPTED, TL_INTERRUPTED + 1, -1, INT32_MIN, INT32_MAX};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        result.status = wrong[i];
        TEST_ASSERT_FALSE(is_sound());
    }
}

static void test_more_than_ready(void) {
    result.ready = 2;
    TEST_ASSERT_FALSE(is_sound());
    result.ready = UINT32_MAX;
    TEST_ASSERT_FALSE(is_sound());
}

static void test_a_step_that_was_before_or_is_not_yet(void) {
    const int64_t wrong[] = {LEAST - 1, TICK + 1, -1, INT64_MIN, INT64_MAX};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        result.record.step = wrong[i];
        TEST_ASSERT_FALSE(is_sound());
    }
}

static void test_an_outcome_that_is_none(void) {
    result.record.outcome = (tl_outcome)TL_OUTCOMES;
    TEST_ASSERT_FALSE(is_sound());
    memset(&result.record.outcome, 0xFF, sizeof result.record.outcome);
    TEST_ASSERT_FALSE(is_sound());
}

static void test_a_stop_that_is_none(void) {
    memset(&result.record.stop, 0xFF, sizeof result.record.stop);
    TEST_ASSERT_FALSE(is_sound());
    result.record.stop = (tl_stop)(TL_STOP_TIME + 1);
    TEST_ASSERT_FALSE(is_sound());
}

static void test_a_state_of_the_delay_that_is_none(void) {
    memset(&result.record.delay_state, 0xFF, sizeof result.record.delay_state);
    TEST_ASSERT_FALSE(is_sound());
    result.record.delay_state = (tl_delay_state)(TL_DELAY_LOST + 1);
    TEST_ASSERT_FALSE(is_sound());
}

static void test_a_flag_that_is_none(void) {
    result.record.flags = 2 * TL_LAST_FLAG;
    TEST_ASSERT_FALSE(is_sound());
    result.record.flags = UINT32_MAX;
    TEST_ASSERT_FALSE(is_sound());
}

static void test_a_quality_that_is_none(void) {
    for (size_t i = 0; i < config.match_count; i++) {
        result.record.measured_quality[i] = TL_LAST_QUALITY + 1;
        TEST_ASSERT_FALSE(is_sound());
        result.record.measured_quality[i] = UINT8_MAX;
        TEST_ASSERT_FALSE(is_sound());
        result.record.measured_quality[i] = TL_GOOD;
    }
    TEST_ASSERT_TRUE(is_sound());
}

/* Without a ready record, its bytes are ignored. */
static void test_a_record_that_is_not_there(void) {
    memset(&result.record, 0xFF, sizeof result.record);
    TEST_ASSERT_FALSE(is_sound());
    result.ready = 0;
    TEST_ASSERT_TRUE(is_sound());
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_good_one);
    RUN_TEST(test_the_ends_of_all_ranges);
    RUN_TEST(test_numbers_are_not_judged);
    RUN_TEST(test_of_another_tick);
    RUN_TEST(test_a_step_of_a_finding_that_is_none);
    RUN_TEST(test_a_status_that_is_none);
    RUN_TEST(test_more_than_ready);
    RUN_TEST(test_a_step_that_was_before_or_is_not_yet);
    RUN_TEST(test_an_outcome_that_is_none);
    RUN_TEST(test_a_stop_that_is_none);
    RUN_TEST(test_a_state_of_the_delay_that_is_none);
    RUN_TEST(test_a_flag_that_is_none);
    RUN_TEST(test_a_quality_that_is_none);
    RUN_TEST(test_a_record_that_is_not_there);
    return UNITY_END();
}
