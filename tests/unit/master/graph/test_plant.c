#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/base/arena.h"
#include "master/graph/plant.h"

enum { REAL_SIGNAL, INTEGER_SIGNAL, BOOLEAN_SIGNAL, UNUSED_SIGNAL, SIGNALS };
enum { WINDOW = 4 };

static tl_arena arena;
static tl_plant plant;
static tl_sample sample;
static fmi2Real real;
static fmi2Integer integer;
static fmi2Boolean boolean;

void setUp(void) {
    tl_arena_init(&arena);
    memset(&plant, 0, sizeof plant);
    memset(&sample, 0, sizeof sample);
    TEST_ASSERT_TRUE(tl_plant_init(&plant, &arena, SIGNALS, WINDOW, 0));
    plant.outputs[REAL_SIGNAL] = (tl_plant_output){.type = TL_REAL, .real = &real};
    plant.outputs[INTEGER_SIGNAL] = (tl_plant_output){.type = TL_INTEGER, .integer = &integer};
    plant.outputs[BOOLEAN_SIGNAL] = (tl_plant_output){.type = TL_BOOLEAN, .boolean = &boolean};
    tl_plant_placed(&plant);
    real = -1.0;
    integer = -1;
    boolean = -1;
}

void tearDown(void) {
    tl_arena_release(&arena);
}

/* Pushes the sample of `tick`. All signals have this value. */
static void push(int64_t tick, double value, tl_quality quality) {
    sample.tick = tick;
    for (size_t i = 0; i < SIGNALS; i++) {
        sample.values[i] = value;
        sample.quality[i] = (uint8_t)quality;
    }
    tl_plant_push(&plant, &sample);
}

static void values_are_delivered_in_their_type(void) {
    push(0, 3.0, TL_GOOD);
    tl_plant_deliver(&plant, 0);
    TEST_ASSERT_EQUAL_DOUBLE(3.0, real);
    TEST_ASSERT_EQUAL_INT32(3, integer);
    TEST_ASSERT_EQUAL_INT32(fmi2True, boolean);
    push(1, 0.0, TL_GOOD);
    tl_plant_deliver(&plant, 1);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, real);
    TEST_ASSERT_EQUAL_INT32(fmi2False, boolean);
}

static void large_integers_are_exact(void) {
    push(0, -2147483647.0, TL_GOOD);
    tl_plant_deliver(&plant, 0);
    TEST_ASSERT_EQUAL_INT32(-2147483647, integer);
}

static void only_a_step_counts_as_an_execution(void) {
    push(0, 1.0, TL_GOOD);
    push(1, 2.0, TL_GOOD);
    tl_plant_deliver(&plant, 0);
    TEST_ASSERT_EQUAL_UINT64(0, plant.executions);
    tl_plant_step(&plant, 1);
    TEST_ASSERT_EQUAL_UINT64(1, plant.executions);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, real);
}

static void each_tick_of_the_window_keeps_its_own_sample(void) {
    for (int64_t tick = 0; tick < 11; tick++) {
        push(tick, (double)tick, TL_GOOD);
    }
    for (int64_t tick = 11 - WINDOW; tick < 11; tick++) {
        TEST_ASSERT_EQUAL_INT64(tick, tl_plant_sample(&plant, tick)->tick);
        tl_plant_deliver(&plant, tick);
        TEST_ASSERT_EQUAL_DOUBLE((double)tick, real);
    }
}

static void the_newest_stands_for_what_is_not_there_yet(void) {
    push(0, 5.0, TL_GOOD);
    push(1, 6.0, TL_GOOD);
    TEST_ASSERT_EQUAL_INT64(1, tl_plant_sample(&plant, 2)->tick);
    TEST_ASSERT_EQUAL_INT64(1, tl_plant_sample(&plant, 1000000)->tick);
    push(2, 7.0, TL_GOOD);
    TEST_ASSERT_EQUAL_INT64(2, tl_plant_sample(&plant, 2)->tick);
}

static void a_bad_value_is_held_and_its_quality_stays(void) {
    push(0, 5.0, TL_GOOD);
    push(1, 1e9, TL_OUT_OF_RANGE);
    push(2, (double)NAN, TL_NOT_A_NUMBER);
    for (int64_t tick = 1; tick <= 2; tick++) {
        tl_plant_deliver(&plant, tick);
        TEST_ASSERT_EQUAL_DOUBLE(5.0, real);
        TEST_ASSERT_EQUAL_INT32(5, integer);
    }
    TEST_ASSERT_EQUAL_UINT8(TL_OUT_OF_RANGE, tl_plant_sample(&plant, 1)->quality[REAL_SIGNAL]);
    TEST_ASSERT_EQUAL_UINT8(TL_NOT_A_NUMBER, tl_plant_sample(&plant, 2)->quality[REAL_SIGNAL]);
    push(3, 8.0, TL_GOOD);
    tl_plant_deliver(&plant, 3);
    TEST_ASSERT_EQUAL_DOUBLE(8.0, real);
    tl_plant_deliver(&plant, 2); /* a bad value is replaced by an earlier one */
    TEST_ASSERT_EQUAL_DOUBLE(5.0, real);
}

static void before_any_good_value_the_initial_one_is_held(void) {
    tl_plant_set_initial(&plant, REAL_SIGNAL, 42.0);
    push(0, 0.0, TL_NO_LINK);
    tl_plant_deliver(&plant, 0);
    TEST_ASSERT_EQUAL_DOUBLE(42.0, real);
    TEST_ASSERT_EQUAL_INT32(0, integer);
}

static void a_value_that_calls_itself_good_but_is_not_is_held_too(void) {
    push(0, 5.0, TL_GOOD);
    push(1, (double)NAN, TL_GOOD);
    tl_plant_deliver(&plant, 1);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, real);
    TEST_ASSERT_EQUAL_UINT8(TL_NOT_A_NUMBER, tl_plant_sample(&plant, 1)->quality[REAL_SIGNAL]);
    push(2, HUGE_VAL, TL_GOOD);
    TEST_ASSERT_EQUAL_UINT8(TL_NOT_A_NUMBER, tl_plant_sample(&plant, 2)->quality[UNUSED_SIGNAL]);
}

static void what_no_integer_can_hold_is_out_of_range_for_one(void) {
    push(0, 5.0, TL_GOOD);
    push(1, 4294967295.0, TL_GOOD);
    tl_plant_deliver(&plant, 1);
    TEST_ASSERT_EQUAL_INT32(5, integer);
    TEST_ASSERT_EQUAL_UINT8(TL_OUT_OF_RANGE, tl_plant_sample(&plant, 1)->quality[INTEGER_SIGNAL]);
    TEST_ASSERT_EQUAL_DOUBLE(4294967295.0, real);
    TEST_ASSERT_EQUAL_UINT8(TL_GOOD, tl_plant_sample(&plant, 1)->quality[REAL_SIGNAL]);
}

/* ---- saved executions ---- */

static void step(int64_t number, uint64_t executions, double value) {
    tl_plant_step(&plant, number);
    TEST_ASSERT_EQUAL_UINT64(executions, plant.executions);
    TEST_ASSERT_TRUE(real == value);
}

static void a_step_that_is_known_is_delivered_without_an_execution(void) {
    TEST_ASSERT_TRUE(tl_plant_save_executions(&plant, &arena, 3));
    for (int64_t tick = 0; tick <= 4; tick++) {
        push(tick, 10.0 * (double)tick, TL_GOOD);
    }
    for (size_t candidate = 0; candidate < 3; candidate++) {
        real = -1.0;
        step(1, candidate == 0 ? 1 : 3, 20.0);
        step(2, candidate == 0 ? 2 : 3, 30.0);
        step(3, 3, 40.0);
    }
    push(5, 50.0, TL_GOOD);
    step(2, 3, 30.0); /* the next horizon: its overlap is known */
    step(3, 3, 40.0);
    step(4, 4, 50.0);
}

/* Also if the values are equal: the sample's number identifies it. */
static void what_was_stood_for_is_not_taken_for_the_real_one(void) {
    TEST_ASSERT_TRUE(tl_plant_save_executions(&plant, &arena, 3));
    push(0, 1.0, TL_GOOD);
    push(1, 1.0, TL_GOOD);
    step(0, 1, 1.0);
    step(1, 2, 1.0); /* sample 1 is used for 2 and 3 */
    step(2, 3, 1.0);
    push(2, 1.0, TL_GOOD);
    step(1, 4, 1.0);
    step(2, 5, 1.0); /* sample 2 is used for 3 now */
    step(1, 5, 1.0);
    step(2, 5, 1.0);
}

static void without_saving_every_step_is_an_execution(void) {
    push(0, 1.0, TL_GOOD);
    push(1, 2.0, TL_GOOD);
    step(0, 1, 2.0);
    step(0, 2, 2.0);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(values_are_delivered_in_their_type);
    RUN_TEST(large_integers_are_exact);
    RUN_TEST(only_a_step_counts_as_an_execution);
    RUN_TEST(each_tick_of_the_window_keeps_its_own_sample);
    RUN_TEST(the_newest_stands_for_what_is_not_there_yet);
    RUN_TEST(a_bad_value_is_held_and_its_quality_stays);
    RUN_TEST(before_any_good_value_the_initial_one_is_held);
    RUN_TEST(a_value_that_calls_itself_good_but_is_not_is_held_too);
    RUN_TEST(what_no_integer_can_hold_is_out_of_range_for_one);
    RUN_TEST(a_step_that_is_known_is_delivered_without_an_execution);
    RUN_TEST(what_was_stood_for_is_not_taken_for_the_real_one);
    RUN_TEST(without_saving_every_step_is_an_execution);
    return UNITY_END();
}
