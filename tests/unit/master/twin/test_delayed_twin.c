/* A twin with delayed inputs and measurements: which samples it uses, when, and that saving of
 * executions respects that. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "tests/support/test_plan.h"

enum { TICKS = 40, LATEST = 8 };

static tl_test_log call_log;
static tl_test_fmu fmus[2];
static tl_test_plan plan;
static tl_test_run run;
static tl_record records[TICKS];
static size_t record_count;

void setUp(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* "a" passes u on to "b", with a delay of one step each. The offset of b is adjusted to match y. */
static void make(tl_pairing measurements, int32_t input_ticks, int32_t output_ticks) {
    setUp();
    for (size_t i = 0; i < 2; i++) {
        tl_test_fmu_init(&fmus[i], 1, false, &call_log);
        tl_test_plan_component(&plan, i == 0 ? "a" : "b", &fmus[i]);
    }
    tl_test_plan_signal(&plan, "u", TL_REAL, "");
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.u", "a.u0");
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    tl_test_plan_match(&plan, "b.y0", "plant.y", 0.01);
    tl_test_plan_adjust(&plan, "b.offset", 1.0);
    plan.plan.measurements = measurements;
    plan.plan.prediction = 3;
    plan.plan.saving = (tl_plan_saving){.structure = true, .sequences = true};
    plan.plan.input_ticks = input_ticks;
    plan.plan.output_ticks = output_ticks;
}

/* u of the plant at tick m; constant before tick 0. */
static double u_of(int64_t m) {
    int64_t held = m % 3 == 2 ? m - 1 : m;
    return m < 0 ? 0.0 : sin(0.9 * (double)held);
}

static double y_of(int64_t m) {
    return m < 0 ? 0.5 : 2.0 * cos(0.3 * (double)m);
}

/* Runs the twin. The sample of tick m has u of m + `inputs` and y of m + `outputs`. */
static void play(int64_t inputs, int64_t outputs) {
    record_count = 0;
    for (int64_t m = 0; m < TICKS; m++) {
        run.sample.values[0] = u_of(m + inputs);
        run.sample.values[1] = y_of(m + outputs);
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
        if (run.ready) {
            records[record_count++] = run.record;
        }
    }
}

static void expect_ledger(void) {
    for (size_t k = 0; k < tl_twin_get_facts(run.twin).components; k++) {
        tl_twin_ledger entry = tl_twin_get_ledger(run.twin, k);
        TEST_ASSERT_EQUAL_INT64_MESSAGE(0, entry.difference, entry.name);
        TEST_ASSERT_TRUE(entry.executions < entry.plain);
    }
}

static const int32_t SHIFTS[][2] = {{0, 0},  {3, 0},  {0, 2},   {0, -2}, {2, 4},
                                    {4, -3}, {-2, 1}, {-3, -1}, {1, 6},  {2, 3}};

enum { PAIRS = sizeof SHIFTS / sizeof SHIFTS[0] };

/* A shift within the twin equals a shift of its samples, bit for bit, once no sample before tick 0
 * is needed. */
static void a_shift_is_as_if_the_plant_were_shifted(void) {
    for (size_t s = 0; s < PAIRS; s++) {
        static tl_record expected[TICKS];
        make(TL_LAG, 0, 0);
        tl_test_run_build(&run, &plan);
        play(SHIFTS[s][0], SHIFTS[s][1]);
        memcpy(expected, records, sizeof expected);
        size_t count = record_count;
        tl_test_run_end(&run, &plan);
        make(TL_LAG, SHIFTS[s][0], SHIFTS[s][1]);
        tl_test_run_build(&run, &plan);
        play(0, 0);
        int32_t longest = SHIFTS[s][0] > SHIFTS[s][1] ? SHIFTS[s][0] : SHIFTS[s][1];
        longest = longest > 0 ? longest : 0;
        TEST_ASSERT_EQUAL_UINT32(3 + (uint32_t)longest, tl_twin_get_facts(run.twin).lead);
        TEST_ASSERT_EQUAL_size_t(count - (size_t)longest, record_count);
        bool before = SHIFTS[s][0] < 0 || SHIFTS[s][1] < 0;
        for (size_t i = 0; i < record_count && !before; i++) {
            TEST_ASSERT_EQUAL_INT64(expected[i].step, records[i].step);
            TEST_ASSERT_EQUAL_INT(expected[i].outcome, records[i].outcome);
            TEST_ASSERT_EQUAL_UINT32(expected[i].executions, records[i].executions);
            TEST_ASSERT_TRUE(expected[i].y[0] == records[i].y[0]);
            TEST_ASSERT_TRUE(expected[i].measured[0] == records[i].measured[0]);
            TEST_ASSERT_TRUE(expected[i].u[0] == records[i].u[0]);
        }
        expect_ledger();
        tl_test_run_end(&run, &plan);
    }
}

static void y_is_paired_with_the_sample_so_many_ticks_away(void) {
    for (size_t s = 0; s < PAIRS; s++) {
        for (tl_pairing mode = TL_LAG; mode <= TL_HOLD; mode++) {
            make(mode, SHIFTS[s][0], SHIFTS[s][1]);
            tl_test_run_build(&run, &plan);
            play(0, 0);
            for (size_t i = 0; i < record_count; i++) {
                int64_t seen = records[i].step + 1 + SHIFTS[s][1];
                if (mode == TL_AHEAD && SHIFTS[s][1] > 0) { /* ahead waits for no later sample */
                    seen = records[i].step + 1;
                }
                TEST_ASSERT_EQUAL_INT(seen < 0 ? TL_NO_LINK : TL_GOOD, records[i].measured_quality[0]);
                TEST_ASSERT_TRUE(records[i].measured[0] == y_of(seen < 0 ? 0 : seen));
            }
            expect_ledger();
            tl_test_run_end(&run, &plan);
        }
    }
}

/* Inputs of the first component in the committed steps. */
static void inputs_are_those_of_the_shifted_instant(void) {
    for (size_t s = 0; s < PAIRS; s++) {
        make(TL_HOLD, SHIFTS[s][0], SHIFTS[s][1]);
        tl_test_run_build(&run, &plan);
        play(0, 0);
        int64_t shift = SHIFTS[s][0];
        for (size_t i = 3; i < record_count; i++) {
            /* y of b after step i: the input of a in step i − 1, plus the offset of b */
            int64_t given = records[i].step - 1 + shift;
            double passed = records[i].y[0] - records[i].u[0];
            TEST_ASSERT_DOUBLE_WITHIN(1e-12, u_of(given < 0 ? 0 : given), passed);
        }
        tl_test_run_end(&run, &plan);
    }
}

static void nothing_is_called_before_the_inputs_of_the_start_are_there(void) {
    make(TL_LAG, 3, 0);
    tl_test_run_build(&run, &plan);
    for (int64_t m = 0; m <= 3; m++) {
        TEST_ASSERT_EQUAL_UINT64(0, tl_test_log_count(&call_log, NULL, TL_TEST_DO_STEP));
        run.sample.values[0] = u_of(m);
        tl_test_run_step(&run);
        TEST_ASSERT_FALSE(run.ready);
    }
    TEST_ASSERT_TRUE(tl_test_log_count(&call_log, NULL, TL_TEST_DO_STEP) > 0); /* the rollback check */
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_shift_is_as_if_the_plant_were_shifted);
    RUN_TEST(y_is_paired_with_the_sample_so_many_ticks_away);
    RUN_TEST(inputs_are_those_of_the_shifted_instant);
    RUN_TEST(nothing_is_called_before_the_inputs_of_the_start_are_there);
    return UNITY_END();
}
