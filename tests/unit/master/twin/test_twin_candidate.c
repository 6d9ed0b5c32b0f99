/* Candidates outside of a search restore the committed instant, and report how an FMU fails. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/twin/twin_candidate.h"
#include "tests/support/message.h"
#include "tests/support/test_plan.h"

enum { VALUES = 16, PREDICTION = 3, NEVER = 1000000 };

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;
static double values[VALUES];
static tl_error failure;

/* A motor with a searched offset; it fails by `kind` if the offset is above 10. */
static void build(tl_test_fault_kind kind, bool sequences) {
    tl_test_fmu_init(&fmu, 1, true, &call_log);
    (void)tl_test_plan_component(&plan, "motor", &fmu);
    tl_test_plan_set(&plan, "lag", 0.4);
    tl_test_plan_set(&plan, "u0", 1.0);
    tl_test_plan_set(&plan, "count", 1.0);
    tl_test_plan_set(&plan, "mode", 1.0);
    tl_test_plan_set_value(&plan, "flag", (tl_value){.type = TL_BOOLEAN, .integer = 1});
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_adjust(&plan, "motor.offset", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 0.01);
    plan.plan.prediction = PREDICTION;
    plan.plan.saving.sequences = sequences;
    fmu.control.fault = (tl_test_fault){.kind = kind, .call = TL_TEST_DO_STEP, .above = 10.0};
    tl_test_run_build(&run, &plan);
    for (int i = 0; i < 3; i++) {
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    }
}

static tl_status try_value(double value) {
    return tl_twin_try_value(run.twin, 0, value, values, &failure, &run.error);
}

static double output(void) {
    for (size_t i = 0; i < tl_twin_value_count(run.twin); i++) {
        tl_twin_value found;
        if (tl_twin_get_value(run.twin, i, &found)) {
            return found.value;
        }
    }
    return (double)NAN;
}

void setUp(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static void test_it_executes_and_restores(void) {
    static double first[VALUES];
    for (int sequences = 0; sequences < 2; sequences++) {
        build(TL_TEST_ERROR, sequences != 0);
        double before = output();
        uint64_t steps = fmu.calls[TL_TEST_DO_STEP];
        TEST_ASSERT_LESS_OR_EQUAL_size_t(VALUES, tl_twin_value_count(run.twin));
        TEST_ASSERT_EQUAL_INT(TL_OK, try_value(9.0));
        TEST_ASSERT_EQUAL_INT(TL_OK, failure.status);
        TEST_ASSERT_EQUAL_UINT64(steps + PREDICTION, fmu.calls[TL_TEST_DO_STEP]);
        TEST_ASSERT_EQUAL_MEMORY(&before, &(double){output()}, sizeof before);
        memcpy(first, values, sizeof first);
        TEST_ASSERT_EQUAL_INT(TL_OK, try_value(-9.0));
        TEST_ASSERT_FALSE(memcmp(first, values, sizeof first) == 0);
        TEST_ASSERT_EQUAL_INT(TL_OK, try_value(9.0));
        TEST_ASSERT_EQUAL_MEMORY(first, values, sizeof first);
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
        tearDown();
        setUp();
    }
}

/* The twin continues. */
static void test_an_fmu_fails(void) {
    static const struct {
        tl_test_fault_kind kind;
        const char *text;
    } faults[] = {
        {TL_TEST_ERROR, "motor:|fmi2DoStep"}, {TL_TEST_DISCARD, "motor:|fmi2DoStep"}, {TL_TEST_NAN, "motor:|y0|NaN"}};
    for (size_t i = 0; i < sizeof faults / sizeof faults[0]; i++) {
        build(faults[i].kind, false);
        TEST_ASSERT_EQUAL_INT(TL_OK, try_value(20.0));
        TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, failure.status);
        TL_EXPECT_PARTS(faults[i].text, failure.text);
        TEST_ASSERT_EQUAL_INT(TL_OK, try_value(2.0));
        TEST_ASSERT_EQUAL_INT(TL_OK, failure.status);
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
        tearDown();
        setUp();
    }
}

static void expect_ended(tl_status status) {
    TEST_ASSERT_EQUAL_INT(status, run.error.status);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(status, run.status);
}

static void test_a_fatal_failure_ends_the_twin(void) {
    build(TL_TEST_FATAL, false);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, try_value(20.0));
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, failure.status);
    expect_ended(TL_FMU_FATAL);
}

static void test_a_component_that_cannot_be_restored_ends_the_twin(void) {
    build(TL_TEST_ERROR, false);
    fmu.control.fault = (tl_test_fault){.kind = TL_TEST_ERROR,
                                        .call = TL_TEST_SET_STATE,
                                        .first = fmu.calls[TL_TEST_SET_STATE] + 1,
                                        .last = NEVER,
                                        .above = (double)INFINITY};
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, try_value(2.0));
    TEST_ASSERT_EQUAL_INT(TL_OK, failure.status);
    expect_ended(TL_FMU_FAILED);
}

/* ---- response ---- */

enum { RESPONSE = 12 };

static tl_status respond(double change, double *response) {
    return tl_twin_respond(run.twin, 0, change, RESPONSE, response, &failure, &run.error);
}

/* A step of 0.1 s moves y by 0.1/0.4 of its distance to the input. Then the twin continues as one
 * that was not asked. */
static void test_the_response_of_a_lag(void) {
    for (int sequences = 0; sequences < 2; sequences++) {
        double response[RESPONSE];
        double after[2];
        for (int asked = 0; asked < 2; asked++) {
            build(TL_TEST_ERROR, sequences != 0);
            for (int i = 0; i < asked; i++) {
                TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, respond(2.0, response), run.error.text);
                TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, failure.status, failure.text);
            }
            tl_test_run_step(&run);
            TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
            after[asked] = output();
            tearDown();
            setUp();
        }
        TEST_ASSERT_EQUAL_MEMORY(&after[0], &after[1], sizeof after[0]);
        for (int i = 0; i < RESPONSE; i++) {
            TEST_ASSERT_DOUBLE_WITHIN(1e-12, 2.0 * (1.0 - pow(0.75, i + 1)), response[i]);
        }
    }
}

static void test_no_response(void) {
    double response[RESPONSE];
    build(TL_TEST_ERROR, false);
    TEST_ASSERT_EQUAL_INT(TL_OK, respond(20.0, response));
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, failure.status);
    TEST_ASSERT_EQUAL_INT(TL_OK, respond(1.0, response));
    TEST_ASSERT_EQUAL_INT(TL_OK, failure.status);
    fmu.functions.replay.most = 100;
    TEST_ASSERT_EQUAL_INT(TL_OK, respond(1.0, response));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, failure.status);
    fmu.functions.replay.most = 0;
    tearDown();
    setUp();
    build(TL_TEST_FATAL, false);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, respond(20.0, response));
    expect_ended(TL_FMU_FATAL);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_it_executes_and_restores);
    RUN_TEST(test_an_fmu_fails);
    RUN_TEST(test_a_fatal_failure_ends_the_twin);
    RUN_TEST(test_a_component_that_cannot_be_restored_ends_the_twin);
    RUN_TEST(test_the_response_of_a_lag);
    RUN_TEST(test_no_response);
    return UNITY_END();
}
