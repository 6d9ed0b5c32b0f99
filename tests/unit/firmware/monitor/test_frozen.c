/* Frozen sensors with made-up samples, and with the outputs of made-up releases. */
#include <string.h>

#include <unity.h>

#include "firmware/monitor/frozen.h"

enum { RELEASE = 160, LEARNED = 30, LONG = 1000 };

static tl_config_signal signals[1];
static tl_plan_match match[1];
static const char *matched_as[1], *reading_as[1];
static tl_config config;
static tl_frozen_watch watch;
static tl_sample sample;
static tl_record record;
static double motion; /* from one release to the next, and back */
static double trend;  /* from one release to the next */
static double grain;  /* smallest change of the readings */
static int begun, ended;
static bool is_decided;

void setUp(void) {
    memset(&sample, 0, sizeof sample);
    memset(&record, 0, sizeof record);
    signals[0] = (tl_config_signal){.plan = {.name = "omega", .type = TL_REAL}};
    match[0] = (tl_plan_match){.variable = "motor.omega", .to = "plant.omega", .tolerance = 1, .weight = 1};
    matched_as[0] = match[0].to;
    reading_as[0] = NULL;
    config = (tl_config){.signals = signals,
                         .signal_count = 1,
                         .own_count = 1,
                         .match = match,
                         .match_count = 1,
                         .matched_as = matched_as,
                         .reading_as = reading_as,
                         .adjust_count = 1,
                         .synchronise = true,
                         .released_steps = RELEASE,
                         .step = TL_SECOND / 100};
    motion = 10;
    trend = 0;
    grain = 0.25;
    begun = ended = 0;
    is_decided = false;
    tl_frozen_watch_init(&watch, &config);
}

void tearDown(void) {}

/* A tick with a reading, and its step. The output of a release depends on its age, and on motion. */
static void tick(double value) {
    sample.instant = sample.tick * config.step;
    sample.stamps[0] = sample.instant;
    sample.values[0] = value;
    tl_frozen_mark(tl_frozen_watch_sample(&watch, &sample, is_decided), &sample);
    begun += watch.match[0].turn == TL_FROZEN_BEGUN ? 1 : 0;
    ended += watch.match[0].turn == TL_FROZEN_ENDED ? 1 : 0;
    record.step = sample.tick;
    int64_t turn = sample.tick / (RELEASE / 2);
    record.release_age = turn == 0 ? 0 : (uint32_t)(RELEASE / 2 + sample.tick % (RELEASE / 2));
    record.released[0] = (double)record.release_age + motion * (double)(turn % 2) + trend * (double)turn;
    record.measured[0] = value;
    record.measured_quality[0] = sample.quality[0];
    tl_frozen_watch_step(&watch, &record);
    sample.quality[0] = TL_GOOD;
    sample.tick++;
}

static void move(int count) {
    for (int i = 0; i < count; i++) {
        tick(grain * (double)(1 + sample.tick % 2));
    }
}

static void stay(int count) {
    for (int i = 0; i < count; i++) {
        record.y[0] = 50;
        tick(50);
    }
}

static void test_a_frozen_sensor_is_found_and_left_out_until_it_moves(void) {
    move(LEARNED);
    stay(LONG);
    TEST_ASSERT_EQUAL(1, begun);
    TEST_ASSERT_EQUAL(LEARNED, watch.match[0].tick);
    TEST_ASSERT_EQUAL(TL_FROZEN, record.measured_quality[0]);
    tick(51);
    TEST_ASSERT_EQUAL(TL_GOOD, record.measured_quality[0]);
    TEST_ASSERT_EQUAL(1, ended);
    TEST_ASSERT_EQUAL(0, watch.match[0].longest);
}

static void test_a_plant_at_rest_is_not_found_and_not_learned(void) {
    motion = 0;
    trend = 10;
    move(LEARNED);
    stay(LONG);
    motion = 10;
    move(1);
    TEST_ASSERT_EQUAL(0, begun);
    TEST_ASSERT_EQUAL(0, watch.match[0].longest);
}

static void test_a_run_must_be_longer_than_ever(void) {
    move(LEARNED);
    stay(RELEASE);
    move(1);
    TEST_ASSERT_EQUAL((RELEASE - 1) * config.step, watch.match[0].longest);
    stay(TL_FROZEN_LONGER * RELEASE - TL_FROZEN_LONGER);
    TEST_ASSERT_EQUAL(0, begun);
    stay(2);
    TEST_ASSERT_EQUAL(1, begun);
}

static void test_a_signal_that_has_hardly_ever_moved_is_not_found(void) {
    move(TL_FROZEN_LEAST - 2);
    stay(LONG);
    TEST_ASSERT_EQUAL(0, begun);
}

static void test_coarse_readings_need_more_motion(void) {
    grain = 10;
    move(LEARNED);
    stay(LONG);
    TEST_ASSERT_EQUAL(0, begun);
}

static void test_a_twin_out_of_tolerance_proves_nothing(void) {
    move(LEARNED);
    for (int i = 0; i < LONG; i++) {
        record.y[0] = 52;
        tick(50);
    }
    TEST_ASSERT_EQUAL(0, begun);
}

static void test_samples_of_the_frozen_time_stay_marked(void) {
    static tl_config_signal both[2];
    both[0] = both[1] = signals[0];
    both[1].plan.name = "omega@reading";
    config.signals = both;
    config.own_count = config.signal_count = 2;
    reading_as[0] = "plant.omega@reading";
    signals[0].between = TL_BETWEEN_LINE;
    tl_frozen_watch_init(&watch, &config);
    TEST_ASSERT_EQUAL(1, watch.match[0].reading);
    watch.match[0].until = TL_SECOND;
    sample.stamps[0] = TL_SECOND - 1;
    sample.stamps[1] = TL_SECOND;
    TEST_ASSERT_EQUAL_UINT64(1, tl_frozen_watch_sample(&watch, &sample, false));
    sample.stamps[0] = TL_SECOND;
    TEST_ASSERT_EQUAL_UINT64(0, tl_frozen_watch_sample(&watch, &sample, false));
}

static void test_recorded_qualities_decide(void) {
    is_decided = true;
    move(LEARNED);
    stay(LONG);
    TEST_ASSERT_EQUAL(0, begun);
    sample.quality[0] = TL_FROZEN;
    tick(50);
    TEST_ASSERT_EQUAL(1, begun);
    tick(50);
    TEST_ASSERT_EQUAL(1, ended);
}

static void test_other_signals_are_not_watched(void) {
    signals[0].plan.type = TL_INTEGER;
    tl_frozen_watch_init(&watch, &config);
    TEST_ASSERT_EQUAL(SIZE_MAX, watch.match[0].reading);
    signals[0].plan.type = TL_REAL;
    config.released_steps = 0;
    tl_frozen_watch_init(&watch, &config);
    TEST_ASSERT_EQUAL(SIZE_MAX, watch.match[0].reading);
}

static void test_only_good_values_are_marked(void) {
    sample.quality[0] = TL_STALE;
    tl_frozen_mark(1, &sample);
    TEST_ASSERT_EQUAL(TL_STALE, sample.quality[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_frozen_sensor_is_found_and_left_out_until_it_moves);
    RUN_TEST(test_a_plant_at_rest_is_not_found_and_not_learned);
    RUN_TEST(test_a_run_must_be_longer_than_ever);
    RUN_TEST(test_a_signal_that_has_hardly_ever_moved_is_not_found);
    RUN_TEST(test_coarse_readings_need_more_motion);
    RUN_TEST(test_a_twin_out_of_tolerance_proves_nothing);
    RUN_TEST(test_samples_of_the_frozen_time_stay_marked);
    RUN_TEST(test_recorded_qualities_decide);
    RUN_TEST(test_other_signals_are_not_watched);
    RUN_TEST(test_only_good_values_are_marked);
    return UNITY_END();
}
