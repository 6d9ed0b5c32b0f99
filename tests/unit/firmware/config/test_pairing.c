/* Pairing of steps with measurements, weights, Huber losses and penalties. Saved executions must
 * not change any result, also if a step first used a substitute for a late sample. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "tests/support/random_numbers.h"
#include "tests/support/test_plan.h"

enum { CMD, Y0, OTHER }; /* signals */
enum { COMPONENTS = 3, SOLVERS = 5, TICKS = 60, SEEDS = 100 };

static const char *const solvers[SOLVERS] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"};

static tl_test_log call_log;
static tl_test_fmu fmus[COMPONENTS];
static tl_test_plan plan;
static tl_test_run run;
static uint32_t seed;

void setUp(void) {}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

static void add_signals(void) {
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y0", TL_REAL, "");
    tl_test_plan_signal(&plan, "other", TL_REAL, "");
}

/* y0 = u0 + offset with u0 = cmd; the offset is adjusted, and nominal at 0. */
static tl_plan_match *begin_observer(void) {
    tl_test_run_end(&run, &plan);
    tl_test_plan_init(&plan, TL_SECOND / 10);
    tl_test_fmu_init(&fmus[0], 1, false, &call_log);
    tl_test_plan_component(&plan, "m", &fmus[0]);
    add_signals();
    tl_test_plan_connect(&plan, "plant.cmd", "m.u0");
    tl_test_plan_adjust(&plan, "m.offset", 1.0);
    plan.plan.algorithm = "secant";
    return tl_test_plan_match(&plan, "m.y0", "plant.y0", 0.01);
}

/* Returns true if the step produced a record. */
static bool tick(double cmd, double y0, tl_quality quality) {
    run.sample.values[CMD] = cmd;
    run.sample.values[Y0] = y0;
    run.sample.quality[Y0] = (uint8_t)quality;
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    return run.ready;
}

/* ---- pairing ---- */

/* The plant equals the twin on a ramp of 1 per step. Values of the same instant are equal. */
static void expect_ramp(tl_pairing measurements, uint32_t prediction, double wanted) {
    plan.plan.measurements = measurements;
    plan.plan.prediction = prediction;
    tl_test_run_build(&run, &plan);
    for (int64_t m = 0; m < 40; m++) {
        bool ready = tick((double)m, (double)m - 1.0, TL_GOOD);
        if (ready && run.record.step > 12) {
            TEST_ASSERT_DOUBLE_WITHIN(0.011, wanted, run.record.u[0]);
            TEST_ASSERT_DOUBLE_WITHIN(1e-9, (double)run.record.step, run.record.measured[0]);
            TEST_ASSERT_DOUBLE_WITHIN(0.011, run.record.measured[0] + wanted, run.record.y[0]);
        }
    }
}

static void a_step_is_paired_with_its_own_measurements(void) {
    (void)begin_observer();
    expect_ramp(TL_LAG, 1, 0.0);
    (void)begin_observer();
    expect_ramp(TL_LAG, 3, 0.0);
    (void)begin_observer();
    expect_ramp(TL_HOLD, 1, 0.0);
    (void)begin_observer();
    expect_ramp(TL_AHEAD, 1, -1.0); /* the newest sample replaces the next one */
}

/* In mode hold, the sample of t_(i+1) replaces all later samples of inputs and outputs. */
static void held_measurements_replace_later_ones(void) {
    (void)begin_observer();
    plan.plan.measurements = TL_HOLD;
    plan.plan.prediction = 3;
    tl_test_run_build(&run, &plan);
    for (int64_t m = 0; m < 20; m++) {
        tl_test_log_clear(&call_log);
        if (!tick((double)m, (double)m - 1.0, TL_GOOD)) {
            continue;
        }
        TEST_ASSERT_EQUAL_INT64(m - 1, run.record.step);
        for (size_t depth = 0; depth < 3; depth++) {
            double input = (double)(m - 1) + (depth > 0 ? 1.0 : 0.0);
            TEST_ASSERT_EQUAL_DOUBLE(input, tl_test_log_step(&call_log, &fmus[0], depth)->u[0]);
        }
    }
}

/* ---- weights, Huber loss, penalties ---- */

/* Runs one search over `count` samples of y0 and returns its u. */
static double search_u(const double *samples, const tl_quality *quality, uint32_t count) {
    plan.plan.prediction = count;
    plan.plan.noise_floor = 0.0;
    tl_test_run_build(&run, &plan);
    for (uint32_t m = 0; m <= count; m++) {
        bool ready = tick(0.0, m == 0 ? 0.0 : samples[m - 1], m == 0 ? TL_GOOD : quality[m - 1]);
        TEST_ASSERT_TRUE(ready == (m == count));
    }
    return run.record.u[0];
}

/* The best constant is the mean of the good samples. The others have no weight. */
static void bad_samples_lose_their_weight(void) {
    for (uint32_t number = 1; number <= 100; number++) {
        double samples[5];
        tl_quality quality[5];
        double sum = 0.0;
        double good = 0.0;
        seed = number * 7919U;
        for (size_t i = 0; i < 5; i++) {
            quality[i] = i != 2 && tl_test_any(&seed, 3) == 0 ? TL_STALE : TL_GOOD;
            samples[i] = 5.0 + tl_test_noise(&seed) + (quality[i] == TL_GOOD ? 0.0 : 1e6 * tl_test_noise(&seed));
            sum += quality[i] == TL_GOOD ? samples[i] : 0.0;
            good += quality[i] == TL_GOOD ? 1.0 : 0.0;
        }
        (void)begin_observer();
        TEST_ASSERT_DOUBLE_WITHIN(0.01, sum / good, search_u(samples, quality, 5));
        TEST_ASSERT_EQUAL_INT(good > 1.0 ? TL_BEST_SO_FAR : TL_OPTIMISED, run.record.outcome);
    }
}

/* Four samples are 1, one is 100, and their mean is 20.8. With a Huber loss the outlier counts
 * linearly. */
static void a_huber_loss_limits_an_outlier(void) {
    static const double samples[5] = {1.0, 1.0, 100.0, 1.0, 1.0};
    static const tl_quality quality[5] = {TL_GOOD, TL_GOOD, TL_GOOD, TL_GOOD, TL_GOOD};
    for (size_t s = 1; s < 3; s++) { /* the other solvers are inexact at a kink */
        (void)begin_observer();
        plan.plan.algorithm = solvers[s];
        TEST_ASSERT_DOUBLE_WITHIN(0.01, 20.8, search_u(samples, quality, 5));
        begin_observer()->huber = 1.0;
        plan.plan.algorithm = solvers[s];
        /* 4·2·d = 2·1, so the distance d to the four samples is a quarter of a tolerance */
        TEST_ASSERT_DOUBLE_WITHIN(0.0005, 1.0 + 0.25 * 0.01, search_u(samples, quality, 5));
    }
}

/* J = ((u − ŷ)/tolerance)² + p·(u − û)²/step². The minimum is the weighted mean of ŷ and û. */
static void a_penalty_on_the_deviation_holds_back(void) {
    static const double penalties[] = {0.0, 100.0, 1e4, 1e6};
    for (size_t s = 0; s < SOLVERS; s++) {
        for (size_t i = 0; i < 4; i++) {
            (void)begin_observer();
            plan.plan.algorithm = solvers[s];
            plan.adjust[0].deviation_penalty = penalties[i];
            tl_test_run_build(&run, &plan);
            (void)tick(0.0, 5.0, TL_GOOD);
            TEST_ASSERT_TRUE(tick(0.0, 5.0, TL_GOOD));
            double measured = 1.0 / (0.01 * 0.01);
            double wanted = 5.0 * measured / (measured + penalties[i]);
            TEST_ASSERT_DOUBLE_WITHIN(penalties[i] > 0.0 ? 1e-3 : 0.01, wanted, run.record.u[0]);
        }
    }
}

/* The penalty refers to the u of the previous step. Each step closes the same share of the
 * distance. */
static void a_penalty_on_the_rate_slows_down(void) {
    for (size_t s = 0; s < SOLVERS; s++) {
        double before = 0.0;
        (void)begin_observer();
        plan.plan.algorithm = solvers[s];
        plan.adjust[0].rate_penalty = 1e4; /* the weight of the measurement */
        tl_test_run_build(&run, &plan);
        (void)tick(0.0, 5.0, TL_GOOD);
        for (int i = 0; i < 8; i++) {
            TEST_ASSERT_TRUE(tick(0.0, 5.0, TL_GOOD));
            TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.5 * (before + 5.0), run.record.u[0]);
            before = run.record.u[0];
        }
    }
}

/* ---- saved executions ---- */

/* Draws a plan without its saving options: a chain or a ring of components with several plant
 * inputs. */
static void draw_plan(void) {
    static const char *const names[COMPONENTS] = {"a", "b", "c"};
    tl_test_run_end(&run, &plan);
    tl_test_plan_init(&plan, TL_SECOND / 10);
    for (size_t i = 0; i < COMPONENTS; i++) {
        tl_test_fmu_init(&fmus[i], 2, false, &call_log);
        tl_test_plan_component(&plan, names[i], &fmus[i]);
        tl_test_plan_set(&plan, "lag", 0.1 + 0.1 * (double)tl_test_any(&seed, 4));
    }
    add_signals();
    tl_test_plan_connect(&plan, "plant.cmd", "a.u0");
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    tl_test_plan_connect(&plan, "b.y0", "c.u0");
    tl_test_plan_connect(&plan, tl_test_any(&seed, 2) == 0 ? "c.y1" : "plant.other", "a.u1");
    tl_test_plan_connect(&plan, tl_test_any(&seed, 2) == 0 ? "plant.other" : "a.y1", "b.u1");
    tl_test_plan_connect(&plan, tl_test_any(&seed, 2) == 0 ? "plant.other" : "b.y1", "c.u1");
    tl_test_plan_adjust(&plan, tl_test_any(&seed, 2) == 0 ? "b.u0" : "a.offset", 0.1);
    if (tl_test_any(&seed, 2) == 0) {
        tl_test_plan_adjust(&plan, tl_test_any(&seed, 2) == 0 ? "c.offset" : "b.gain", 0.1)->rate_penalty =
            0.1 * tl_test_any(&seed, 2);
    }
    tl_plan_match *match = tl_test_plan_match(&plan, "c.y0", "plant.y0", 0.02);
    match->huber = tl_test_any(&seed, 3) == 0 ? 2.0 : 0.0;
    tl_test_plan_match(&plan, "b.y0", "plant.y0", 0.05)->weight = tl_test_any(&seed, 2);
    plan.plan.prediction = 3 + tl_test_any(&seed, 3);
    plan.plan.shape = (tl_shape)tl_test_any(&seed, 2);
    plan.plan.measurements = (tl_pairing)tl_test_any(&seed, 3);
    plan.plan.algorithm = solvers[tl_test_any(&seed, SOLVERS)];
    plan.plan.noise_floor = 0.2 * tl_test_any(&seed, 2);
    plan.plan.evaluations = 30;
}

static tl_record records[TICKS]; /* of the run without saving, by tick */

/* Runs a seed. A run without saving keeps its records; the other runs are compared with them. */
static uint64_t run_seed(uint32_t number, bool structure, bool sequences, uint32_t nodes, tl_keep keep) {
    uint64_t executions = 0;
    bool kept = !structure && !sequences;
    seed = number * 7919U;
    draw_plan();
    plan.plan.saving = (tl_plan_saving){structure, sequences, nodes};
    for (size_t i = 0; i < COMPONENTS; i++) {
        plan.components[i].keep = keep;
    }
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = 30;
    for (size_t m = 0; m < TICKS; m++) {
        double t = (double)m;
        run.sample.values[OTHER] =
            tl_test_any(&seed, 3) == 0 ? tl_test_noise(&seed) : run.sample.values[OTHER]; /* often unchanged */
        run.sample.quality[OTHER] = tl_test_any(&seed, 10) == 0 ? TL_STALE : TL_GOOD;
        tl_quality quality = tl_test_any(&seed, 10) == 0 ? TL_NO_LINK : TL_GOOD;
        (void)tick(tl_test_any(&seed, 4) == 0 ? tl_test_noise(&seed) : 0.5, sin(0.2 * t) + 0.1 * tl_test_noise(&seed),
                   quality);
        const tl_record *record = &run.record;
        executions += run.ready ? record->executions : 0;
        if (kept) {
            records[m] = *record;
        } else if (run.ready) {
            TEST_ASSERT_EQUAL_UINT32(records[m].evaluations, record->evaluations);
            TEST_ASSERT_EQUAL_INT(records[m].outcome, record->outcome);
            TEST_ASSERT_EQUAL_MEMORY(records[m].u, record->u, plan.plan.adjust_count * sizeof record->u[0]);
            TEST_ASSERT_EQUAL_MEMORY(records[m].y, record->y, plan.plan.match_count * sizeof record->y[0]);
            TEST_ASSERT_EQUAL_MEMORY(&records[m].objective, &record->objective, sizeof record->objective);
            TEST_ASSERT_EQUAL_UINT32(records[m].held, record->held);
        }
    }
    return executions;
}

static void saving_changes_no_bit(void) {
    for (uint32_t number = 1; number <= SEEDS; number++) {
        uint64_t plain = run_seed(number, false, false, 0, TL_KEEP_STATES);
        uint64_t by_structure = run_seed(number, true, false, 0, TL_KEEP_STATES);
        uint64_t by_both = run_seed(number, true, true, 0, TL_KEEP_STATES);
        uint64_t by_sequences = run_seed(number, false, true, 0, TL_KEEP_STATES);
        (void)run_seed(number, true, true, 12, TL_KEEP_STATES); /* a pool that fills up soon */
        (void)run_seed(number, true, true, 0, TL_KEEP_OUTPUTS);
        TEST_ASSERT_TRUE(by_structure < plain && by_both < by_structure && by_sequences < plain);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_step_is_paired_with_its_own_measurements);
    RUN_TEST(held_measurements_replace_later_ones);
    RUN_TEST(bad_samples_lose_their_weight);
    RUN_TEST(a_huber_loss_limits_an_outlier);
    RUN_TEST(a_penalty_on_the_deviation_holds_back);
    RUN_TEST(a_penalty_on_the_rate_slows_down);
    RUN_TEST(saving_changes_no_bit);
    return UNITY_END();
}
