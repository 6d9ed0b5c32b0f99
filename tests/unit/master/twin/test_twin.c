/* The twin as a whole: its build, the samples of a step, the pairing of records, determinism. */
#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/test_plan.h"

static tl_test_log call_log;
static tl_test_fmu fmus[5];
static tl_test_plan plan;
static tl_test_run run;

void setUp(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static tl_test_fmu *add(const char *name, size_t width) {
    tl_test_fmu *fmu = &fmus[plan.plan.component_count];
    tl_test_fmu_init(fmu, width, false, &call_log);
    tl_test_plan_component(&plan, name, fmu);
    return fmu;
}

/* One tick with this value of the first signal. Returns its record, or NULL. */
static const tl_record *tick(double value) {
    run.sample.values[0] = value;
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    return run.ready ? &run.record : NULL;
}

/* ---- the graphs of fig. 4.4 ---- */

static void make_graph(char which) {
    (void)add("in", 1);
    if (which == 'c') {
        (void)add("k1", 1);
        tl_test_plan_connect(&plan, "k1.y0", "in.u0");
        tl_test_plan_set(&plan, "u0", 0.0);
    } else {
        (void)add("k1", which == 'd' ? 2 : 1);
        tl_test_plan_connect(&plan, "in.y0", "k1.u0");
        (void)add("out", which == 'b' ? 3 : 1);
        tl_test_plan_connect(&plan, "k1.y0", "out.u0");
    }
    if (which == 'b') {
        (void)add("k2", 1);
        (void)add("k3", 1);
        tl_test_plan_connect(&plan, "in.y0", "k2.u0");
        tl_test_plan_connect(&plan, "in.y0", "k3.u0");
        tl_test_plan_connect(&plan, "k2.y0", "out.u1");
        tl_test_plan_connect(&plan, "k3.y0", "out.u2");
    }
    if (which == 'd') {
        tl_test_plan_connect(&plan, "out.y0", "k1.u1");
    }
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_adjust(&plan, which == 'c' ? "in.gain" : "in.u0", 1.0);
    tl_test_plan_match(&plan, which == 'c' ? "in.y0" : "out.sum", "plant.y", 0.01);
}

static void assert_graph(char which, uint32_t distance, uint64_t components, uint64_t per_evaluation) {
    make_graph(which);
    tl_test_run_build(&run, &plan);
    tl_twin_facts facts = tl_twin_get_facts(run.twin);
    TEST_ASSERT_EQUAL_UINT32(distance, facts.distance);
    TEST_ASSERT_EQUAL_UINT32(distance, facts.prediction);
    TEST_ASSERT_EQUAL_UINT64(components + 1, facts.components);
    TEST_ASSERT_EQUAL_UINT64(components + 1, facts.executions_per_step);
    /* the table of fig. 4.4 does not count the plant */
    TEST_ASSERT_EQUAL_UINT64(per_evaluation + distance, facts.executions_per_evaluation);
    for (int i = 0; i < 6; i++) {
        tl_test_log_clear(&call_log);
        const tl_record *record = tick(5.0);
        if (record != NULL) {
            TEST_ASSERT_EQUAL_UINT64(components + per_evaluation * record->evaluations,
                                     tl_test_log_count(&call_log, NULL, TL_TEST_DO_STEP));
        }
    }
}

static void graph_a_a_chain(void) {
    assert_graph('a', 3, 3, 9);
}

static void graph_b_parallel_paths(void) {
    assert_graph('b', 3, 5, 15);
}

static void graph_c_an_unaffected_component(void) {
    assert_graph('c', 1, 2, 2);
}

static void graph_d_a_cycle(void) {
    assert_graph('d', 3, 3, 9);
}

/* ---- executions ---- */

static void executions_are_exactly_as_predicted(void) {
    for (uint32_t prediction = 1; prediction <= 5; prediction += 2) {
        uint64_t evaluations = 0;
        uint64_t executions = 0;
        uint64_t steps = 0;
        setUp();
        (void)add("drive", 1);
        (void)add("motor", 1);
        tl_test_plan_signal(&plan, "y", TL_REAL, "");
        tl_test_plan_connect(&plan, "plant.y", "drive.u0");
        tl_test_plan_connect(&plan, "drive.y0", "motor.u0");
        tl_test_plan_adjust(&plan, "motor.offset", 1.0);
        tl_test_plan_match(&plan, "motor.y0", "plant.y", 0.01);
        plan.plan.prediction = prediction;
        tl_test_run_build(&run, &plan);
        for (int i = 0; i < 40; i++) {
            const tl_record *record = tick(sin(0.3 * (double)i));
            if (record != NULL) {
                TEST_ASSERT_EQUAL_UINT32(3 + 3 * prediction * record->evaluations, record->executions);
                evaluations += record->evaluations;
                executions += record->executions;
                steps++;
            }
        }
        TEST_ASSERT_EQUAL_UINT64(40 - prediction, steps);
        TEST_ASSERT_TRUE(evaluations > steps); /* otherwise there was no search */
        TEST_ASSERT_EQUAL_UINT64(3 * steps + 3 * prediction * evaluations, executions);
        uint64_t sum = 0;
        for (size_t k = 0; k < 3; k++) {
            TEST_ASSERT_EQUAL_UINT64(executions / 3, tl_twin_executions(run.twin, k));
            sum += tl_twin_executions(run.twin, k);
        }
        TEST_ASSERT_EQUAL_UINT64(executions, sum);
        tl_test_run_end(&run, &plan);
    }
}

static void a_free_twin_executes_each_component_once_a_step(void) {
    (void)add("m", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.y", "m.u0");
    tl_test_plan_match(&plan, "m.y0", "plant.y", 1.0)->weight = 0.0;
    fmus[0].functions.get_fmu_state = NULL;
    tl_test_run_build(&run, &plan);
    TEST_ASSERT_NULL(tick(0.0));
    for (int i = 1; i < 10; i++) {
        const tl_record *record = tick((double)i);
        TEST_ASSERT_EQUAL_INT64(i - 1, record->step);
        TEST_ASSERT_EQUAL_INT(TL_FREE, record->outcome);
        TEST_ASSERT_EQUAL_INT(TL_STOP_NONE, record->stop);
        TEST_ASSERT_EQUAL_UINT32(2, record->executions);
        TEST_ASSERT_EQUAL_UINT32(0, record->evaluations);
        TEST_ASSERT_TRUE(isnan(record->objective));
        TEST_ASSERT_EQUAL_DOUBLE((double)i - 1.0, record->y[0]);
        TEST_ASSERT_EQUAL_DOUBLE((double)i, record->measured[0]);
    }
    tl_twin_facts facts = tl_twin_get_facts(run.twin);
    TEST_ASSERT_EQUAL_UINT32(0, facts.distance);
    TEST_ASSERT_EQUAL_UINT64(0, facts.executions_per_evaluation);
    TEST_ASSERT_EQUAL_UINT64(9, tl_twin_executions(run.twin, 0));
    TEST_ASSERT_EQUAL_UINT64(0, tl_test_log_count(&call_log, NULL, TL_TEST_GET_STATE));
}

/* ---- samples of a step ---- */

/* "m" passes on the number of the tick. An offset of 1 matches the same signal one step later. */
static void make_counter(tl_pairing measurements, uint32_t prediction) {
    (void)add("m", 1);
    tl_test_plan_signal(&plan, "tick", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.tick", "m.u0");
    tl_test_plan_adjust(&plan, "m.offset", 1.0);
    tl_test_plan_match(&plan, "m.y0", "plant.tick", 0.01);
    plan.plan.measurements = measurements;
    plan.plan.prediction = prediction;
    tl_test_run_build(&run, &plan);
}

/* Asserts the inputs of all steps in the log: step i + j uses the sample of tick i + j, or the
 * newest one. */
static void assert_inputs(const tl_record *record, uint32_t prediction, int64_t newest) {
    for (size_t n = 0; n <= prediction * (size_t)record->evaluations; n++) {
        const tl_test_entry *entry = tl_test_log_step(&call_log, &fmus[0], n);
        TEST_ASSERT_NOT_NULL(entry);
        int64_t ahead = entry->final ? 0 : (int64_t)(n % prediction);
        int64_t used = record->step + ahead < newest ? record->step + ahead : newest;
        TEST_ASSERT_EQUAL_DOUBLE((double)used, entry->u[0]);
        TEST_ASSERT_TRUE(entry->time == (double)(record->step + ahead) / 10.0);
    }
}

static void lag_knows_every_sample_of_its_horizon(void) {
    static const uint32_t predictions[] = {1, 2, 5};
    for (size_t p = 0; p < 3; p++) {
        setUp();
        make_counter(TL_LAG, predictions[p]);
        for (int64_t m = 0; m < 20; m++) {
            tl_test_log_clear(&call_log);
            const tl_record *record = tick((double)m);
            TEST_ASSERT_EQUAL_INT(m >= (int64_t)predictions[p], record != NULL);
            if (record == NULL) {
                continue;
            }
            TEST_ASSERT_EQUAL_INT64(m - (int64_t)predictions[p], record->step);
            assert_inputs(record, predictions[p], m);
            TEST_ASSERT_EQUAL_DOUBLE((double)record->step + 1.0, record->measured[0]);
            /* y(i + 1) = i + offset, so an offset of 1 is right at each sample of the horizon */
            TEST_ASSERT_DOUBLE_WITHIN(0.01, 1.0, record->u[0]);
            TEST_ASSERT_DOUBLE_WITHIN(0.01, record->measured[0], record->y[0]);
            double error = record->y[0] - record->measured[0];
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, (double)predictions[p] * error * error / 1e-4, record->objective);
        }
        tl_test_run_end(&run, &plan);
    }
}

static void ahead_takes_the_newest_sample_for_the_later_ones(void) {
    static const uint32_t predictions[] = {1, 2, 5};
    for (size_t p = 0; p < 3; p++) {
        setUp();
        make_counter(TL_AHEAD, predictions[p]);
        for (int64_t m = 0; m < 20; m++) {
            const tl_record *record = tick((double)m);
            TEST_ASSERT_EQUAL_INT(m >= 1, record != NULL);
            if (record != NULL) {
                TEST_ASSERT_EQUAL_INT64(m - 1, record->step);
                TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
                /* the search compares with the newest sample, i */
                TEST_ASSERT_TRUE(record->u[0] == 0.0);
                TEST_ASSERT_EQUAL_DOUBLE((double)m - 1.0, record->y[0]);
                /* the record has the sample of its instant */
                TEST_ASSERT_EQUAL_DOUBLE((double)m, record->measured[0]);
                TEST_ASSERT_EQUAL_DOUBLE(0.0, record->objective);
            }
            /* this tick has computed step m; the record of step m follows with the next tick */
            if (m >= 1) {
                const tl_record step = {.step = m, .evaluations = 1};
                assert_inputs(&step, predictions[p], m);
            }
            tl_test_log_clear(&call_log);
        }
        tl_test_run_end(&run, &plan);
    }
}

static void ahead_uses_the_true_sample_as_soon_as_it_is_there(void) {
    make_counter(TL_AHEAD, 2);
    (void)tick(0.0);
    (void)tick(100.0);
    tl_test_log_clear(&call_log);
    (void)tick(7.0); /* step 1 was committed with 100 in place of the sample of t_2 */
    TEST_ASSERT_EQUAL_DOUBLE(7.0, tl_test_log_step(&call_log, &fmus[0], 0)->u[0]);
}

static void ahead_is_finished_by_the_sample_that_follows(void) {
    make_counter(TL_AHEAD, 1);
    (void)tick(0.0);
    TEST_ASSERT_EQUAL_INT64(0, tick(1.0)->step);
    size_t calls = call_log.count;
    run.sample.values[0] = 2.5;
    tl_twin_finish(run.twin, &run.sample, &run.record, &run.ready);
    TEST_ASSERT_TRUE(run.ready);
    TEST_ASSERT_EQUAL_INT64(1, run.record.step);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, run.record.y[0]);
    TEST_ASSERT_EQUAL_DOUBLE(2.5, run.record.measured[0]);
    TEST_ASSERT_EQUAL_UINT64(calls, call_log.count);
    TEST_ASSERT_EQUAL_UINT64(2, tl_twin_metrics(run.twin, 0)->pairs);
    tl_twin_finish(run.twin, &run.sample, &run.record, &run.ready);
    TEST_ASSERT_FALSE(run.ready); /* no step is left */
}

static void lag_has_nothing_to_finish(void) {
    make_counter(TL_LAG, 1);
    (void)tick(0.0);
    (void)tick(1.0);
    tl_twin_finish(run.twin, &run.sample, &run.record, &run.ready);
    TEST_ASSERT_FALSE(run.ready);
}

static void a_made_up_step_uses_the_samples_of_its_own_instants(void) {
    make_counter(TL_LAG, 2);
    for (int64_t m = 0; m < 12; m++) {
        run.sample.values[0] = (double)m;
        tl_test_log_clear(&call_log);
        bool missed = m == 4 || m == 5 || m == 8;
        if (missed) {
            tl_test_run_catch_up(&run);
        } else {
            tl_test_run_step(&run);
        }
        TEST_ASSERT_EQUAL_INT(TL_OK, run.status);
        TEST_ASSERT_EQUAL_INT(m >= 2, run.ready);
        if (run.ready) {
            TEST_ASSERT_EQUAL_INT64(m - 2, run.record.step);
            TEST_ASSERT_EQUAL_INT(missed, run.record.outcome == TL_CAUGHT_UP);
            TEST_ASSERT_EQUAL_DOUBLE((double)m - 1.0, run.record.measured[0]);
            /* with the earlier offset */
            TEST_ASSERT_DOUBLE_WITHIN(0.01, (double)m - 1.0, run.record.y[0]);
            assert_inputs(&run.record, 2, m);
        }
    }
}

static void a_missed_tick_in_mode_ahead_keeps_the_pairs(void) {
    make_counter(TL_AHEAD, 1);
    for (int64_t m = 0; m < 9; m++) {
        run.sample.values[0] = (double)m;
        if (m == 3 || m == 4) {
            tl_test_run_catch_up(&run);
        } else {
            tl_test_run_step(&run);
        }
        TEST_ASSERT_EQUAL_INT(m >= 1, run.ready);
        if (run.ready) {
            TEST_ASSERT_EQUAL_INT64(m - 1, run.record.step);
            TEST_ASSERT_EQUAL_INT(m - 1 == 3 || m - 1 == 4, run.record.outcome == TL_CAUGHT_UP);
            TEST_ASSERT_EQUAL_DOUBLE((double)m, run.record.measured[0]);
            TEST_ASSERT_EQUAL_DOUBLE((double)m - 1.0, run.record.y[0]);
        }
    }
}

static void a_tick_before_the_first_step_only_initialises(void) {
    make_counter(TL_LAG, 3);
    TEST_ASSERT_NULL(tick(4.0));
    TEST_ASSERT_EQUAL_UINT64(1, tl_test_log_count(&call_log, NULL, TL_TEST_EXIT_INITIALIZATION));
    size_t calls = call_log.count;
    TEST_ASSERT_NULL(tick(5.0));
    TEST_ASSERT_NULL(tick(6.0));
    TEST_ASSERT_EQUAL_UINT64(calls, call_log.count);
    TEST_ASSERT_NOT_NULL(tick(7.0));
}

/* ---- starting ---- */

static void start_values_and_nominals_are_set_before_the_first_step(void) {
    (void)add("m", 2);
    tl_test_plan_set(&plan, "gain", 3.0);
    tl_test_plan_set(&plan, "u1", 2.0);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "m.u0");
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "m.offset", 1.0);
    adjust->has_nominal = true;
    adjust->nominal = 0.25;
    tl_test_plan_match(&plan, "m.y1", "plant.cmd", 1.0);
    tl_test_run_build(&run, &plan);
    (void)tick(6.0);
    const tl_record *record = tick(6.0);
    TEST_ASSERT_EQUAL_INT(TL_FIRST_GUESS, record->outcome);
    TEST_ASSERT_EQUAL_DOUBLE(3.0 * 2.0 + 0.25, record->y[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, record->nominal[0]);
}

static void nominals_are_set_before_initialisation(void) {
    (void)add("m", 1);
    tl_test_plan_set(&plan, "u0", 6.0);
    (void)add("out", 1);
    fmus[0].control.feed_through = true;
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "m.y0", "out.u0");
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "m.offset", 1.0);
    adjust->has_nominal = true;
    adjust->nominal = 0.25;
    tl_test_plan_match(&plan, "out.y0", "plant.y", 100.0);
    tl_test_run_build(&run, &plan);
    (void)tick(6.0);
    (void)tick(6.0);
    TEST_ASSERT_EQUAL_DOUBLE(6.25, tick(6.0)->y[0]); /* the output of "m" at t_0 */
}

static void a_nominal_is_what_was_set_or_else_the_start_value(void) {
    (void)add("m", 1);
    tl_test_plan_set(&plan, "u0", 4.0);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_adjust(&plan, "m.u0", 1.0);
    tl_test_plan_adjust(&plan, "m.gain", 1.0);
    tl_test_plan_match(&plan, "m.y0", "plant.cmd", 1.0);
    tl_test_run_build(&run, &plan);
    (void)tick(4.0);
    const tl_record *record = tick(4.0);
    TEST_ASSERT_EQUAL_DOUBLE(4.0, record->nominal[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, record->nominal[1]);
}

static void before_any_reading_a_signal_is_what_it_drives(void) {
    (void)add("m", 2);
    tl_test_fmu_variable(&fmus[0], "u0")->start.real = 5.0;
    tl_test_plan_signal(&plan, "a", TL_REAL, "");
    tl_plan_signal *signal = tl_test_plan_signal(&plan, "b", TL_REAL, "");
    signal->has_initial = true;
    signal->initial = -8.0;
    tl_test_plan_connect(&plan, "plant.a", "m.u0");
    tl_test_plan_connect(&plan, "plant.b", "m.u1");
    tl_test_plan_match(&plan, "m.y0", "plant.a", 1.0)->weight = 0.0;
    tl_test_plan_match(&plan, "m.y1", "plant.b", 1.0)->weight = 0.0;
    tl_test_run_build(&run, &plan);
    run.sample.quality[0] = TL_NO_LINK;
    run.sample.quality[1] = TL_NO_LINK;
    (void)tick((double)NAN);
    const tl_record *record = tick((double)NAN);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, record->y[0]);
    TEST_ASSERT_EQUAL_DOUBLE(-8.0, record->y[1]);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, record->measured[0]);
    TEST_ASSERT_EQUAL_DOUBLE(-8.0, record->measured[1]);
    TEST_ASSERT_EQUAL_UINT8(TL_NO_LINK, record->measured_quality[0]);
    TEST_ASSERT_EQUAL_UINT64(1, tl_twin_metrics(run.twin, 0)->left_out);
}

static void the_start_value_is_held_in_the_signals_unit(void) {
    static const tl_unit known[] = {{"K", true, {0, 0, 0, 0, 1}, 1.0, 0.0},
                                    {"degC", true, {0, 0, 0, 0, 1}, 1.0, 273.15}};
    (void)add("m", 1);
    fmus[0].model.units = known;
    fmus[0].model.unit_count = 2;
    tl_test_fmu_variable(&fmus[0], "u0")->unit = &known[0];
    tl_test_fmu_variable(&fmus[0], "u0")->start.real = 300.0;
    tl_test_fmu_variable(&fmus[0], "y0")->unit = &known[0];
    tl_test_plan_signal(&plan, "a", TL_REAL, "degC");
    tl_test_plan_connect(&plan, "plant.a", "m.u0");
    tl_test_plan_match(&plan, "m.y0", "plant.a", 1.0)->weight = 0.0;
    tl_test_run_build(&run, &plan);
    run.sample.quality[0] = TL_NO_LINK;
    (void)tick(0.0);
    const tl_record *record = tick(0.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 300.0, record->y[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 300.0, record->measured[0]); /* in the unit of y */
    TEST_ASSERT_EQUAL_STRING("K", tl_twin_match_unit(run.twin, 0));
}

static void an_fmu_that_does_not_start_is_reported_and_all_are_freed(void) {
    make_graph('a');
    /* also the attempt with logging on */
    tl_test_fmu_fail(&fmus[1], TL_TEST_INSTANTIATE, TL_TEST_ERROR, 1, 2);
    TEST_ASSERT_NULL(tl_test_plan_build(&plan));
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
    const tl_test_problem *problem = &plan.problems[0];
    TEST_ASSERT_EQUAL_STRING("components.k1", problem->where);
    TL_EXPECT_PARTS("k1|fmi2Instantiate|GUID", problem->text);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, problem->status);
    TEST_ASSERT_EQUAL_UINT64(0, fmus[0].living + fmus[2].living);
}

static void a_start_value_that_is_fatal_ends_all_calls_of_the_fmu(void) {
    (void)add("m", 1);
    tl_test_plan_set(&plan, "u0", 0.0);
    tl_test_plan_component(&plan, "again", &fmus[0]);
    tl_test_plan_set(&plan, "u0", 0.0);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_fmu_fail(&fmus[0], TL_TEST_SET_REAL, TL_TEST_FATAL, 1, 1);
    TEST_ASSERT_NULL(tl_test_plan_build(&plan));
    TEST_ASSERT_NOT_NULL(tl_test_plan_problem(&plan, "components.m", "fmi2Fatal"));
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, plan.report.first_status);
    TEST_ASSERT_EQUAL_UINT64(2, call_log.count); /* fmi2Instantiate, fmi2SetReal */
}

static void a_failed_initialisation_ends_the_twin(void) {
    make_counter(TL_LAG, 1);
    tl_test_fmu_fail(&fmus[0], TL_TEST_EXIT_INITIALIZATION, TL_TEST_ERROR, 1, 1);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TL_EXPECT_PARTS("m|fmi2ExitInitializationMode", run.error.text);
    size_t calls = call_log.count;
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TEST_ASSERT_FALSE(run.ready);
    TEST_ASSERT_EQUAL_UINT64(calls, call_log.count);
}

static void a_failed_step_ends_a_free_twin(void) {
    (void)add("m", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.y", "m.u0");
    tl_test_plan_match(&plan, "m.y0", "plant.y", 1.0)->weight = 0.0;
    plan.plan.measurements = TL_AHEAD;
    tl_test_run_build(&run, &plan);
    tl_test_fmu_fail(&fmus[0], TL_TEST_DO_STEP, TL_TEST_DISCARD, 3, 3);
    (void)tick(0.0);
    (void)tick(1.0);
    run.sample.values[0] = 2.0;
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TEST_ASSERT_TRUE(run.ready); /* the record of the step before is complete */
    TEST_ASSERT_EQUAL_INT64(1, run.record.step);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, run.record.measured[0]);
    tl_test_run_step(&run); /* no step may follow a discarded one */
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TEST_ASSERT_FALSE(run.ready);
    tl_twin_finish(run.twin, &run.sample, &run.record, &run.ready);
    TEST_ASSERT_FALSE(run.ready);
}

/* ---- check of the rollback ---- */

static void assert_liar_is_found(size_t liar, const char *name) {
    fmus[liar].control.state_lies = true;
    tl_test_run_build(&run, &plan);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TL_EXPECT_PARTS(name, run.error.text);
    TL_EXPECT_PARTS("\"rollback\"", run.error.text);
}

static void a_state_that_lies_is_found(void) {
    (void)add("m", 1);
    tl_test_plan_set(&plan, "lag", 0.5);
    tl_test_plan_set(&plan, "u0", 1.0);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_adjust(&plan, "m.gain", 1.0);
    tl_test_plan_match(&plan, "m.y0", "plant.y", 0.01);
    assert_liar_is_found(0, "m.y0");
}

static void a_liar_upstream_of_the_match_is_found(void) {
    make_graph('a');
    tl_test_fmu_variable(&fmus[0], "u0")->start.real = 1.0; /* all outputs move */
    for (size_t i = 0; i < 3; i++) {
        tl_test_fmu_variable(&fmus[i], "lag")->start.real = 0.5;
    }
    assert_liar_is_found(1, "k1.y0");
}

static void a_liar_at_rest_is_found(void) {
    make_graph('a'); /* all values stay 0 until a variable is adjusted */
    for (size_t i = 0; i < 3; i++) {
        tl_test_fmu_variable(&fmus[i], "lag")->start.real = 0.5;
    }
    assert_liar_is_found(2, "out.sum");
}

/* A second rollback method that restores exactly. It uses the states of the test FMU. */
typedef struct full_copy {
    fmi2FMUstate kept;
    int given_up, end_proof;
    char why[120];
} full_copy;

static full_copy asides[3];

static size_t fmu_of(fmi2Component instance) {
    for (size_t i = 0; i < 3; i++) {
        if ((const void *)fmus[i].alive == instance) {
            return i;
        }
    }
    TEST_FAIL_MESSAGE("unknown instance");
    return 0;
}

static fmi2Status keep_aside(fmi2Component instance) {
    size_t i = fmu_of(instance);
    return fmus[i].functions.get_fmu_state(instance, &asides[i].kept);
}

static fmi2Status restore_start(fmi2Component instance) {
    size_t i = fmu_of(instance);
    bool lies = fmus[i].control.state_lies;
    fmus[i].control.state_lies = false;
    fmi2Status status = fmus[i].functions.set_fmu_state(instance, asides[i].kept);
    fmus[i].control.state_lies = lies;
    return status;
}

static fmi2Status next_method(fmi2Component instance, const char *why) {
    size_t i = fmu_of(instance);
    asides[i].given_up++;
    (void)snprintf(asides[i].why, sizeof asides[i].why, "%s", why);
    fmus[i].control.state_lies = false;
    return restore_start(instance);
}

static void end_proof(fmi2Component instance) {
    size_t i = fmu_of(instance);
    asides[i].end_proof++;
    if (asides[i].kept != NULL) {
        (void)fmus[i].functions.free_fmu_state(instance, &asides[i].kept);
    }
}

static size_t size_aside(fmi2Component instance) {
    (void)instance;
    return 100;
}

static bool has_choice(fmi2Component instance) {
    (void)instance;
    return false;
}

static const tl_fmi2_fallback other_way = {keep_aside, restore_start, next_method, end_proof, size_aside,
                                           has_choice, NULL,          NULL,        NULL};

/* The first locked step, with exact or with wrong states. */
static tl_record first_step(bool lies) {
    make_graph('a');
    tl_test_fmu_variable(&fmus[0], "u0")->start.real = 1.0;
    memset(asides, 0, sizeof asides);
    for (size_t i = 0; i < 3; i++) {
        tl_test_fmu_variable(&fmus[i], "lag")->start.real = 0.5;
        fmus[i].functions.fallback = &other_way;
    }
    fmus[0].control.state_lies = fmus[2].control.state_lies = lies;
    tl_test_run_build(&run, &plan);
    const tl_record *record = NULL;
    for (int i = 0; i < 20 && record == NULL; i++) {
        record = tick(0.1 * i);
    }
    TEST_ASSERT_NOT_NULL(record);
    return *record;
}

static void a_liar_is_rolled_back_by_the_other_method(void) {
    tl_record honest = first_step(false);
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_INT(0, asides[i].given_up);
        TEST_ASSERT_EQUAL_INT(1, asides[i].end_proof);
    }
    tearDown();
    setUp();
    tl_record lying = first_step(true);
    TEST_ASSERT_EQUAL_INT(1, asides[0].given_up);
    TEST_ASSERT_EQUAL_INT(0, asides[1].given_up);
    TEST_ASSERT_EQUAL_INT(1, asides[2].given_up);
    TL_EXPECT_PARTS("incomplete", asides[0].why);
    TEST_ASSERT_GREATER_THAN_UINT64(0, tl_twin_get_facts(run.twin).proved_executions);
    TEST_ASSERT_EQUAL_MEMORY(honest.y, lying.y, sizeof honest.y);
    TEST_ASSERT_EQUAL_MEMORY(honest.u, lying.u, sizeof honest.u);
    TEST_ASSERT_EQUAL_UINT64(honest.executions, lying.executions);
}

static void the_check_does_not_change_an_honest_fmu(void) {
    (void)add("m", 1);
    tl_test_plan_set(&plan, "lag", 0.4);
    tl_test_plan_set(&plan, "start", 1.0);
    tl_test_plan_set(&plan, "u0", 0.0);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_adjust(&plan, "m.gain", 1.0);
    tl_test_plan_match(&plan, "m.y0", "plant.y", 100.0);
    tl_test_run_build(&run, &plan);
    (void)tick(0.0);
    TEST_ASSERT_EQUAL_UINT64(0, tl_twin_executions(run.twin, 0));
    TEST_ASSERT_EQUAL_UINT64(0, tl_twin_executions(run.twin, 1));
    const tl_record *record = tick(0.0);
    /* one step of 0.1 s from 1 towards 0, with a lag of 0.4 s */
    TEST_ASSERT_EQUAL_DOUBLE(0.75, record->y[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, record->u[0]);
    TEST_ASSERT_EQUAL_UINT64(1, fmus[0].states);
}

static void the_check_survives_a_candidate_that_fails(void) {
    make_counter(TL_LAG, 2);
    tl_test_fmu_fail_above(&fmus[0], TL_TEST_ERROR, 0.5); /* fails with an offset of 1, not of 0 */
    (void)tick(0.0);
    (void)tick(0.0);
    TEST_ASSERT_NOT_NULL(tick(0.0));
}

/* ---- determinism and memory ---- */

enum { TICKS = 60 };

static void make_busy_plan(size_t first) {
    static const char *const names[] = {"drive", "motor"};
    for (size_t i = 0; i < 2; i++) {
        tl_test_fmu_init(&fmus[first + i], 2, true, &call_log);
        tl_test_plan_component(&plan, names[i], &fmus[first + i]);
        tl_test_plan_set(&plan, "lag", 0.3);
        tl_test_plan_set(&plan, "count", 1.0);
        tl_test_plan_set(&plan, "mode", 2.0);
    }
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y0", TL_REAL, "");
    tl_test_plan_signal(&plan, "y1", TL_REAL, "");
    tl_test_plan_signal(&plan, "on", TL_BOOLEAN, "");
    tl_test_plan_connect(&plan, "plant.cmd", "drive.u0");
    tl_test_plan_connect(&plan, "motor.y1", "drive.u1");
    tl_test_plan_connect(&plan, "drive.y0", "motor.u0");
    tl_test_plan_connect(&plan, "drive.y1", "motor.u1");
    tl_test_plan_connect(&plan, "plant.on", "drive.flag");
    tl_test_plan_connect(&plan, "drive.flag_out", "motor.flag");
    tl_test_plan_adjust(&plan, "motor.u0", 0.1);
    tl_test_plan_adjust(&plan, "motor.offset", 0.2);
    tl_test_plan_match(&plan, "motor.y0", "plant.y0", 0.01);
    tl_test_plan_match(&plan, "motor.y1", "plant.y1", 0.02);
    tl_test_plan_match(&plan, "motor.flag_out", "plant.on", 1.0)->weight = 0.0;
    plan.plan.margin = 0.01;
    plan.plan.prediction = 3;
}

static void search_busily(tl_record *records) {
    run.budget.evaluations = 30;
    for (int i = 0; i < TICKS; i++) {
        run.sample.values[1] = sin(0.2 * (double)i);
        run.sample.values[2] = 0.3 * cos(0.1 * (double)i);
        run.sample.values[3] = i % 7 < 3 ? 1.0 : 0.0;
        run.sample.quality[1] = i % 11 == 10 ? TL_STALE : TL_GOOD;
        const tl_record *record = tick(sin(0.15 * (double)i));
        if (record != NULL) {
            records[record->step] = *record;
        }
    }
}

static void run_busily(tl_record *records) {
    tl_test_run_build(&run, &plan);
    search_busily(records);
}

static void the_same_samples_give_the_same_bits(void) {
    static tl_record first[TICKS];
    static tl_record second[TICKS];
    uint64_t evaluations = 0;
    make_busy_plan(0);
    run_busily(first);
    tl_twin *earlier = run.twin; /* stays beside the second one */
    tl_test_plan_init(&plan, TL_SECOND / 10);
    make_busy_plan(2);
    run_busily(second);
    for (size_t i = 0; i < TICKS - 3; i++) {
        TEST_ASSERT_EQUAL_MEMORY(&first[i], &second[i], sizeof first[i]);
        evaluations += first[i].evaluations;
    }
    TEST_ASSERT_TRUE(evaluations > 3 * TICKS);
    TEST_ASSERT_EQUAL_UINT64(TICKS - 3, tl_twin_metrics(run.twin, 2)->pairs);
    TEST_ASSERT_EQUAL_MEMORY(tl_twin_metrics(earlier, 0), tl_twin_metrics(run.twin, 0), sizeof(tl_metrics));
    tl_twin_destroy(earlier);
}

static void no_memory_is_allocated_after_the_build(void) {
    static tl_record records[TICKS];
    make_busy_plan(0);
    run_busily(records);
    size_t memory = tl_twin_get_facts(run.twin).memory;
    size_t used = mallinfo2().uordblks;
    for (int i = 0; i < 100; i++) {
        (void)tick(sin(0.15 * (double)i));
    }
    TEST_ASSERT_EQUAL_UINT64(used, mallinfo2().uordblks);
    TEST_ASSERT_EQUAL_UINT64(memory, tl_twin_get_facts(run.twin).memory);
    TEST_ASSERT_TRUE(memory > 0);
}

static void a_plan_need_not_outlive_the_build(void) {
    static tl_record first[TICKS];
    static tl_record second[TICKS];
    make_busy_plan(0);
    run_busily(first);
    tl_twin_destroy(run.twin);
    tl_test_plan_init(&plan, TL_SECOND / 10);
    make_busy_plan(2);
    tl_twin *twin = tl_test_plan_build(&plan);
    memset(&plan, 0xA5, sizeof plan);
    plan.plan.component_count = 0; /* for tearDown() */
    tl_test_run_init(&run, twin);
    search_busily(second);
    TEST_ASSERT_EQUAL_MEMORY(first, second, sizeof first[0] * (TICKS - 3));
    TEST_ASSERT_EQUAL_STRING("motor", tl_twin_component_name(run.twin, 1));
}

/* ---- metrics and names ---- */

static void metrics_pair_by_their_own_instants(void) {
    double sum = 0.0;
    double largest = 0.0;
    (void)add("m", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.y", "m.u0");
    tl_test_plan_match(&plan, "m.y0", "plant.y", 1.0)->weight = 0.0;
    tl_test_run_build(&run, &plan);
    for (int i = 0; i <= 20; i++) {
        run.sample.quality[0] = i == 9 ? TL_OUT_OF_RANGE : TL_GOOD;
        (void)tick((double)i * (double)i);
        /* y(i) is the sample of i − 1; the sample of tick 9 is bad, so step 9 uses 64 */
        double difference = (double)i * (double)i - (i == 10 ? 64.0 : (double)(i - 1) * (double)(i - 1));
        if (i > 0 && i != 9) {
            sum += difference * difference;
            largest = fmax(largest, difference);
        }
    }
    const tl_metrics *metrics = tl_twin_metrics(run.twin, 0);
    TEST_ASSERT_EQUAL_UINT64(19, metrics->pairs);
    TEST_ASSERT_EQUAL_UINT64(1, metrics->left_out);
    TEST_ASSERT_EQUAL_DOUBLE(sum / 18.0, tl_metrics_mse(metrics));
    TEST_ASSERT_EQUAL_DOUBLE(largest, metrics->maximum);
}

static void names_and_units_are_those_of_the_fmus(void) {
    static const tl_unit speed = {"rad/s", true, {0, 0, -1, 0, 0, 0, 0, 1}, 1.0, 0.0};
    make_graph('a');
    tl_test_fmu_variable(&fmus[2], "sum")->unit = &speed;
    tl_test_run_build(&run, &plan);
    TEST_ASSERT_EQUAL_STRING("in", tl_twin_component_name(run.twin, 0));
    TEST_ASSERT_EQUAL_STRING("out", tl_twin_component_name(run.twin, 2));
    TEST_ASSERT_EQUAL_STRING("plant", tl_twin_component_name(run.twin, 3));
    TEST_ASSERT_EQUAL_STRING("rad/s", tl_twin_match_unit(run.twin, 0));
    TEST_ASSERT_EQUAL_STRING("", tl_twin_adjust_unit(run.twin, 0));
}

static void solvers_have_names_and_numbers(void) {
    char text[] = "l-bfgs"; /* the function returns its own text */
    const char *name = tl_twin_solver_named(text);
    TEST_ASSERT_EQUAL_STRING("l-bfgs", name);
    TEST_ASSERT_TRUE(name != text);
    TEST_ASSERT_EQUAL_PTR(name, tl_twin_solver_numbered(100));
    TEST_ASSERT_NULL(tl_twin_solver_named("newton"));
    TEST_ASSERT_NULL(tl_twin_solver_numbered(0));
    TEST_ASSERT_NOT_NULL(strstr(tl_twin_solver_names(), "\"l-bfgs\""));
}

static void outcomes_and_stops_have_names(void) {
    TEST_ASSERT_EQUAL_STRING("free", tl_outcome_name(TL_FREE));
    TEST_ASSERT_EQUAL_STRING("first guess", tl_outcome_name(TL_FIRST_GUESS));
    TEST_ASSERT_EQUAL_STRING("optimised", tl_outcome_name(TL_OPTIMISED));
    TEST_ASSERT_EQUAL_STRING("best so far", tl_outcome_name(TL_BEST_SO_FAR));
    TEST_ASSERT_EQUAL_STRING("nominal", tl_outcome_name(TL_NOMINAL));
    TEST_ASSERT_EQUAL_STRING("free run", tl_outcome_name(TL_FREE_RUN));
    TEST_ASSERT_EQUAL_STRING("caught up", tl_outcome_name(TL_CAUGHT_UP));
    TEST_ASSERT_EQUAL_STRING("none", tl_stop_name(TL_STOP_NONE));
    TEST_ASSERT_EQUAL_STRING("tolerance", tl_stop_name(TL_STOP_TOLERANCE));
    TEST_ASSERT_EQUAL_STRING("solver", tl_stop_name(TL_STOP_SOLVER));
    TEST_ASSERT_EQUAL_STRING("evaluations", tl_stop_name(TL_STOP_EVALUATIONS));
    TEST_ASSERT_EQUAL_STRING("time", tl_stop_name(TL_STOP_TIME));
}

static void an_output_that_is_only_read_is_that_of_the_newest_step(void) {
    static const tl_plan_output outputs[] = {{"outputs[0]", "m.sum"}, {"outputs[1]", "m.y0"}};
    (void)add("m", 2);
    tl_test_plan_set(&plan, "u1", 10.0);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.y", "m.u0");
    plan.plan.outputs = outputs;
    plan.plan.output_count = 2;
    tl_test_run_build(&run, &plan);
    (void)tick(1.0);
    (void)tick(2.0);
    TEST_ASSERT_EQUAL_DOUBLE(11.0, tl_twin_output(run.twin, 0));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, tl_twin_output(run.twin, 1));
}

static void nothing_destroys_nothing(void) {
    tl_twin_destroy(NULL);
}

static void a_twin_that_never_ran_is_destroyed(void) {
    make_graph('b');
    tl_test_run_build(&run, &plan);
    tl_twin_destroy(run.twin);
    run.twin = NULL;
    TEST_ASSERT_EQUAL_UINT64(5, tl_test_log_count(&call_log, NULL, TL_TEST_FREE_INSTANCE));
}

static void run_structure(void) {
    RUN_TEST(graph_a_a_chain);
    RUN_TEST(graph_b_parallel_paths);
    RUN_TEST(graph_c_an_unaffected_component);
    RUN_TEST(graph_d_a_cycle);
    RUN_TEST(executions_are_exactly_as_predicted);
    RUN_TEST(a_free_twin_executes_each_component_once_a_step);
}

static void run_samples(void) {
    RUN_TEST(lag_knows_every_sample_of_its_horizon);
    RUN_TEST(ahead_takes_the_newest_sample_for_the_later_ones);
    RUN_TEST(ahead_uses_the_true_sample_as_soon_as_it_is_there);
    RUN_TEST(ahead_is_finished_by_the_sample_that_follows);
    RUN_TEST(lag_has_nothing_to_finish);
    RUN_TEST(a_made_up_step_uses_the_samples_of_its_own_instants);
    RUN_TEST(a_missed_tick_in_mode_ahead_keeps_the_pairs);
    RUN_TEST(a_tick_before_the_first_step_only_initialises);
}

static void run_starting(void) {
    RUN_TEST(start_values_and_nominals_are_set_before_the_first_step);
    RUN_TEST(nominals_are_set_before_initialisation);
    RUN_TEST(a_nominal_is_what_was_set_or_else_the_start_value);
    RUN_TEST(before_any_reading_a_signal_is_what_it_drives);
    RUN_TEST(the_start_value_is_held_in_the_signals_unit);
    RUN_TEST(an_fmu_that_does_not_start_is_reported_and_all_are_freed);
    RUN_TEST(a_start_value_that_is_fatal_ends_all_calls_of_the_fmu);
    RUN_TEST(a_failed_initialisation_ends_the_twin);
    RUN_TEST(a_failed_step_ends_a_free_twin);
    RUN_TEST(a_state_that_lies_is_found);
    RUN_TEST(a_liar_upstream_of_the_match_is_found);
    RUN_TEST(a_liar_at_rest_is_found);
    RUN_TEST(a_liar_is_rolled_back_by_the_other_method);
    RUN_TEST(the_check_does_not_change_an_honest_fmu);
    RUN_TEST(the_check_survives_a_candidate_that_fails);
}

static void run_the_rest(void) {
    RUN_TEST(the_same_samples_give_the_same_bits);
    RUN_TEST(no_memory_is_allocated_after_the_build);
    RUN_TEST(a_plan_need_not_outlive_the_build);
    RUN_TEST(metrics_pair_by_their_own_instants);
    RUN_TEST(names_and_units_are_those_of_the_fmus);
    RUN_TEST(solvers_have_names_and_numbers);
    RUN_TEST(outcomes_and_stops_have_names);
    RUN_TEST(an_output_that_is_only_read_is_that_of_the_newest_step);
    RUN_TEST(nothing_destroys_nothing);
    RUN_TEST(a_twin_that_never_ran_is_destroyed);
}

int main(void) {
    UNITY_BEGIN();
    run_structure();
    run_samples();
    run_starting();
    run_the_rest();
    return UNITY_END();
}
