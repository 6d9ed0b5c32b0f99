/* The prognosis: executions from the graph, and a measured time. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/cli/advice.h"
#include "master/base/estimate.h"
#include "tests/support/config_text.h"
#include "tests/support/read_assembly.h"
#include "tests/support/scratch.h"
#include "tests/support/stderr_capture.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"

static tl_scratch scratch;
static tl_assembly assembly;
static tl_prognosis prognosis;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    assembly = (tl_assembly){0};
    memset(&prognosis, 0xA5, sizeof prognosis); /* make() must set every field */
}

void tearDown(void) {
    tl_assembly_free(&assembly);
    tl_scratch_empty(&scratch);
}

static void make(const char *old, const char *new) {
    const char *path = tl_scratch_path(&scratch, "config.json");
    TEST_ASSERT_TRUE_MESSAGE(tl_test_write_replaced(LOCK, path, old, new), old);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(path, &assembly));
    tl_prognosis_make(&assembly, &prognosis);
}

/* T_P = 3, dynamic: Γ of drive, motor and plant is 2, 3 and 2. Another u reaches drive one step
 * later, and the plant never. */
static void test_executions(void) {
    make("\"horizon\": { \"prediction\": 1,", "\"horizon\": { \"prediction\": 3, \"shape\": \"dynamic\",");
    TEST_ASSERT_EQUAL_UINT64(3, prognosis.step);
    TEST_ASSERT_EQUAL_UINT64(9, prognosis.plain);
    TEST_ASSERT_EQUAL_UINT64(7, prognosis.first);
    TEST_ASSERT_EQUAL_UINT64(4, prognosis.next);
    TEST_ASSERT_EQUAL_UINT64(3 + 7 + 59 * 4, prognosis.worst);
}

static void test_executions_without_saving(void) {
    make("\"synchronise\": {", "\"synchronise\": { \"saving\": { \"structure\": false, \"sequences\": false },");
    TEST_ASSERT_EQUAL_UINT64(3, prognosis.plain);
    TEST_ASSERT_EQUAL_UINT64(3, prognosis.first);
    TEST_ASSERT_EQUAL_UINT64(3, prognosis.next);
    TEST_ASSERT_EQUAL_UINT64(3 + 60 * 3, prognosis.worst);
}

/* The plant takes no time. */
static void test_time(void) {
    make("\"duration_s\": 14", "\"duration_s\": 100");
    TEST_ASSERT_EQUAL_size_t(1600, prognosis.steps);
    TEST_ASSERT_GREATER_THAN_INT64(0, prognosis.step_time);
    TEST_ASSERT_GREATER_THAN_INT64(0, prognosis.cost[0]);
    TEST_ASSERT_GREATER_THAN_INT64(0, prognosis.cost[1]);
    TEST_ASSERT_EQUAL_INT64(0, prognosis.cost[2]);
    /* commit and first evaluation of motor, 59 further ones, and commit of drive */
    TEST_ASSERT_EQUAL_INT64(prognosis.cost[0] + 61 * prognosis.cost[1], prognosis.worst_time);
    TEST_ASSERT_EQUAL_UINT32(60, prognosis.fitting);
}

/* The run has 1400 steps. The verification between ticks gets the time of the rest. */
static void test_the_duration_bounds_the_steps(void) {
    make("\"duration_s\": 14", "\"duration_s\": 14");
    TEST_ASSERT_EQUAL_size_t(560, prognosis.steps);
    TEST_ASSERT_LESS_THAN_INT64(1400, prognosis.next_tick);
}

static void test_a_budget_that_is_too_short(void) {
    make("\"time_s\": 0.006", "\"time_s\": 1e-9");
    TEST_ASSERT_EQUAL_UINT32(0, prognosis.fitting);
    tl_assembly_free(&assembly);
    make("\"evaluations\": 60, \"time_s\": 0.006", "\"evaluations\": 100000, \"time_s\": 1e-4");
    TEST_ASSERT_GREATER_THAN_UINT32(0, prognosis.fitting);
    TEST_ASSERT_LESS_THAN_UINT32(100000, prognosis.fitting);
}

/* Slow FMUs, long horizons and many evaluations can exceed 64 bits of nanoseconds. */
static void test_times_that_cannot_be_added_up(void) {
    TEST_ASSERT_EQUAL_INT64(7, tl_duration_sum(1, 2, 3));
    TEST_ASSERT_EQUAL_INT64(1, tl_duration_sum(1, 0, UINT64_MAX));
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_duration_sum(INT64_MAX, 0, 5));
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_duration_sum(INT64_MAX, 1, 1));
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_duration_sum(INT64_MAX % 10, 10, (uint64_t)(INT64_MAX / 10)));
    TEST_ASSERT_EQUAL_INT64(INT64_MAX - 1, tl_duration_sum(INT64_MAX % 10 - 1, 10, (uint64_t)(INT64_MAX / 10)));
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_duration_sum(INT64_MAX % 10, 10, (uint64_t)(INT64_MAX / 10) + 1));
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_duration_sum(0, 60 * 1000 * (2 * TL_SECOND), 100000));
}

static void test_a_twin_that_runs_free(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(TL_SOURCE_DIR "/config/motor/free.json", &assembly));
    tl_prognosis_make(&assembly, &prognosis);
    TEST_ASSERT_EQUAL_UINT64(3, prognosis.step);
    TEST_ASSERT_EQUAL_UINT64(3, prognosis.worst);
    TEST_ASSERT_EQUAL_INT64(0, prognosis.worst_time);
    TEST_ASSERT_GREATER_THAN_INT64(0, prognosis.step_time);
}

static void test_an_fmu_that_cannot_step(void) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    make("\"J\": 0.0515 }, \"keep\": \"states\" }\n  },\n  \"plant\": {\n    \"torque\": {",
         "\"J\": 1e-320 } }\n  },\n  \"plant\": {\n    \"torque\": { \"initial\": 5,");
    free(tl_stderr_capture_end());
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, prognosis.error.status);
    TEST_ASSERT_EQUAL_INT64(0, prognosis.step_time);
    TEST_ASSERT_EQUAL_INT64(0, prognosis.worst_time);
    TEST_ASSERT_EQUAL_UINT64(63, prognosis.worst);
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_prognosis");
    RUN_TEST(test_executions);
    RUN_TEST(test_executions_without_saving);
    RUN_TEST(test_time);
    RUN_TEST(test_the_duration_bounds_the_steps);
    RUN_TEST(test_a_budget_that_is_too_short);
    RUN_TEST(test_times_that_cannot_be_added_up);
    RUN_TEST(test_a_twin_that_runs_free);
    RUN_TEST(test_an_fmu_that_cannot_step);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
