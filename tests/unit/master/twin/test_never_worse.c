/* Never worse than without synchronisation, with any setting. The test knows the model. J of the
 * committed u is within tolerance, or below that of nominal by the margin, or u is nominal. The
 * record tells which. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>
#include <unity.h>

#include "tests/support/random_numbers.h"
#include "tests/support/test_plan.h"

enum { CMD, Y0, Y1, SEEDS = 200, STEPS = 60, LONGEST = 4, SOLVERS = 5, CHANNELS = 2 };

static const double TOLERANCE = 0.02;
static const double OTHER_INPUT = 0.3; /* u1 if it is not adjusted */
static const char *const solvers[SOLVERS] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"};

/* Adjusted variables: the first one or both. */
static const char *const adjustable[][2] = {{"m.u0", "m.offset"}, {"m.gain", "m.u1"}, {"m.offset", "m.gain"}};

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;
static uint32_t seed;

/* Settings of one seed. */
static struct {
    double lag;
    double margin;
    double noise;
    double fails_above; /* input of the FMU; infinity: never */
    tl_test_fault_kind fault;
    const char *variables[2];
    size_t variable_count;
    uint32_t prediction;
    tl_shape shape;
    tl_pairing measurements;
    const char *algorithm;
} setting;

static double measured[STEPS + LONGEST + 2][CHANNELS]; /* by tick */
static double known_y[CHANNELS];                       /* at the committed instant */

/* How often each case occurred. */
static uint32_t seen[TL_OUTCOMES];
static uint32_t seen_failing_nominal;
static uint32_t seen_failing_candidates;
static uint32_t seen_without_nominal;
static uint32_t ended_early;

void setUp(void) {}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* ---- the model as the test knows it ---- */

/* The value of an adjusted variable, or `otherwise`. */
static double value_of(const char *variable, const double *u, double otherwise) {
    for (size_t v = 0; v < setting.variable_count; v++) {
        if (strcmp(setting.variables[v], variable) == 0) {
            return u[v];
        }
    }
    return otherwise;
}

/* One step of y with the variables at u. Returns false if the FMU fails. */
static bool advance(double *y, const double *u, double cmd) {
    double gain = value_of("m.gain", u, 1.0);
    double offset = value_of("m.offset", u, 0.0);
    const double inputs[CHANNELS] = {value_of("m.u0", u, cmd), value_of("m.u1", u, OTHER_INPUT)};
    bool works = true;
    for (size_t c = 0; c < CHANNELS; c++) {
        double drive = gain * inputs[c] + offset;
        works = works && drive <= setting.fails_above;
        y[c] = setting.lag > 0.0 ? y[c] + 0.1 / setting.lag * (drive - y[c]) : drive;
    }
    return works;
}

/* The tick of the newest sample when a step is computed. */
static int64_t newest_at(int64_t step) {
    static const int64_t none = 0;
    int64_t later[] = {(int64_t)setting.prediction, none, 1}; /* lag, ahead, hold */
    return step + later[setting.measurements];
}

static int64_t known_tick(int64_t step, int64_t tick) {
    return tick < newest_at(step) ? tick : newest_at(step);
}

static double cmd_at(int64_t tick) {
    return sin(0.15 * (double)tick);
}

/* J of a constant u over the horizon from `step` on. */
static double objective_of(int64_t step, const double *u) {
    double y[CHANNELS] = {known_y[0], known_y[1]};
    double sum = 0.0;
    for (int64_t depth = 1; depth <= (int64_t)setting.prediction; depth++) {
        if (!advance(y, u, cmd_at(known_tick(step, step + depth - 1)))) {
            return HUGE_VAL;
        }
        const double *wanted = measured[known_tick(step, step + depth)];
        for (size_t c = 0; c < CHANNELS; c++) {
            sum += pow((y[c] - wanted[c]) / TOLERANCE, 2.0);
        }
    }
    return sum;
}

/* ---- the twin ---- */

static void choose_setting(void) {
    static const double margins[] = {0.0, 0.02, 0.4};
    static const double levels[] = {0.0, 0.01, 0.2};
    size_t variables = tl_test_any(&seed, 3);
    setting.lag = tl_test_any(&seed, 3) == 0 ? 0.0 : 0.15 + 0.1 * (double)tl_test_any(&seed, 5);
    setting.margin = margins[tl_test_any(&seed, 3)];
    setting.noise = levels[tl_test_any(&seed, 3)];
    setting.fault = (tl_test_fault_kind[]){TL_TEST_DISCARD, TL_TEST_ERROR, TL_TEST_DISCARD}[tl_test_any(&seed, 3)];
    setting.fails_above = tl_test_any(&seed, 2) == 0 ? HUGE_VAL : 0.8 + 0.1 * (double)tl_test_any(&seed, 10);
    setting.variables[0] = adjustable[variables][0];
    setting.variables[1] = adjustable[variables][1];
    setting.variable_count = 1 + tl_test_any(&seed, 2);
    setting.prediction = 1 + tl_test_any(&seed, LONGEST);
    setting.shape = (tl_shape)tl_test_any(&seed, 2);
    setting.measurements = (tl_pairing)tl_test_any(&seed, 3);
    setting.algorithm = solvers[tl_test_any(&seed, SOLVERS)];
}

static void add_component(void) {
    tl_test_fmu_init(&fmu, CHANNELS, false, &call_log);
    tl_test_plan_component(&plan, "m", &fmu);
    tl_test_plan_set(&plan, "lag", setting.lag);
    tl_test_plan_set(&plan, "u1", OTHER_INPUT);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y0", TL_REAL, "");
    tl_test_plan_signal(&plan, "y1", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "m.u0");
}

static void build(void) {
    tl_test_plan_init(&plan, TL_SECOND / 10);
    add_component();
    for (size_t v = 0; v < setting.variable_count; v++) {
        tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, setting.variables[v], 0.1);
        if (tl_test_any(&seed, 2) == 0) {
            adjust->lower = -1.0;
            adjust->upper = 1.5;
        }
    }
    tl_test_plan_match(&plan, "m.y0", "plant.y0", TOLERANCE);
    tl_test_plan_match(&plan, "m.y1", "plant.y1", TOLERANCE);
    plan.plan.algorithm = setting.algorithm;
    plan.plan.fallback = tl_test_any(&seed, 3) == 0 ? solvers[tl_test_any(&seed, SOLVERS)] : NULL;
    plan.plan.stagnation = tl_test_any(&seed, 3) == 0 ? 5 : 0;
    plan.plan.margin = setting.margin;
    plan.plan.prediction = setting.prediction;
    plan.plan.shape = setting.shape;
    plan.plan.measurements = setting.measurements;
    plan.plan.saving = (tl_plan_saving){tl_test_any(&seed, 2) == 0, tl_test_any(&seed, 2) == 0, 0};
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = 1 + tl_test_any(&seed, 50);
    known_y[0] = 0.0;
    known_y[1] = 0.0;
}

/* The plant alternates: equal to the model, with another gain, and with an additional error that u
 * cannot remove. */
static void make_plant(void) {
    double y[CHANNELS] = {0.0, 0.0};
    double share = setting.lag > 0.0 ? 0.1 / setting.lag : 1.0;
    for (int64_t tick = 0; tick < STEPS + LONGEST + 2; tick++) {
        const double inputs[CHANNELS] = {cmd_at(tick - 1), OTHER_INPUT};
        int64_t phase = tick / 10 % 3;
        for (size_t c = 0; c < CHANNELS; c++) {
            double differs = phase == 2 ? 0.4 * (double)(c + 1) : 0.0;
            y[c] += share * ((phase == 0 ? 1.0 : 1.2) * inputs[c] + differs - y[c]);
            measured[tick][c] = y[c] + setting.noise * tl_test_noise(&seed);
        }
    }
}

/* ---- what is asserted ---- */

static bool is_nominal(const tl_record *record) {
    return memcmp(record->u, record->nominal, setting.variable_count * sizeof record->u[0]) == 0;
}

/* The values of J in the record are right. */
static void assert_honest(const tl_record *record, double nominal) {
    if (isfinite(record->objective_nominal)) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-9 * (1.0 + nominal), nominal, record->objective_nominal);
    }
    if (setting.prediction == 1 && isfinite(record->objective)) { /* the horizon is the committed step */
        double committed = objective_of(record->step, record->u);
        TEST_ASSERT_DOUBLE_WITHIN(1e-9 * (1.0 + committed), committed, record->objective);
    }
}

static void assert_not_worse(const tl_record *record, double nominal) {
    switch (record->outcome) {
    case TL_FIRST_GUESS:
        TEST_ASSERT_EQUAL_UINT32(1, record->evaluations); /* J of nominal would need a second evaluation */
        TEST_ASSERT_TRUE(record->objective < 1.0);
        break;
    case TL_OPTIMISED:
        TEST_ASSERT_TRUE(record->objective < 1.0);
        seen_without_nominal += isnan(record->objective_nominal) ? 1 : 0;
        break;
    case TL_BEST_SO_FAR:
        TEST_ASSERT_TRUE(record->objective >= 1.0);
        TEST_ASSERT_TRUE(record->objective < nominal);
        TEST_ASSERT_TRUE(record->objective <= (1.0 - setting.margin) * nominal * (1.0 + 1e-9));
        break;
    default:
        TEST_ASSERT_EQUAL_INT(TL_NOMINAL, record->outcome);
        TEST_ASSERT_TRUE(is_nominal(record));
        break;
    }
    seen[record->outcome]++;
}

/* If nothing is saved, a candidate with fewer steps than the horizon has failed. In mode ahead the
 * log is already that of the next step. */
static void count_failures(const tl_record *record) {
    bool saved = plan.plan.saving.structure || plan.plan.saving.sequences;
    size_t steps = tl_test_log_count(&call_log, &fmu, TL_TEST_DO_STEP);
    bool failed =
        !saved && setting.measurements != TL_AHEAD && steps < (size_t)record->evaluations * setting.prediction;
    seen_failing_candidates += failed ? 1 : 0;
}

/* A twin that has failed could not commit nominal either. */
static void assert_nothing_works(void) {
    double nominal[2];
    double y[CHANNELS] = {known_y[0], known_y[1]};
    int64_t step = run.sample.tick - 1 - (int64_t)tl_twin_get_facts(run.twin).lead;
    for (size_t v = 0; v < setting.variable_count; v++) {
        const char *variable = setting.variables[v];
        nominal[v] = strcmp(variable, "m.u0") == 0     ? cmd_at(step)
                     : strcmp(variable, "m.u1") == 0   ? OTHER_INPUT
                     : strcmp(variable, "m.gain") == 0 ? 1.0
                                                       : 0.0;
    }
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, run.status);
    TEST_ASSERT_FALSE(advance(y, nominal, cmd_at(step)));
    ended_early++;
}

/* One tick. Returns false if the twin has failed, because the FMU fails with all values. */
static bool tick(void) {
    int64_t number = run.sample.tick;
    run.sample.values[CMD] = cmd_at(number);
    run.sample.values[Y0] = measured[number][0];
    run.sample.values[Y1] = measured[number][1];
    tl_test_log_clear(&call_log);
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
    if (run.status != TL_OK) {
        assert_nothing_works();
    }
    return run.status == TL_OK;
}

/* Checks a record before known_y is updated to the end of its step. */
static void look_at(const tl_record *record) {
    double nominal = objective_of(record->step, record->nominal);
    seen_failing_nominal += isfinite(nominal) ? 0 : 1;
    assert_honest(record, nominal);
    assert_not_worse(record, nominal);
    count_failures(record);
    double y[CHANNELS] = {known_y[0], known_y[1]};
    TEST_ASSERT_TRUE(advance(y, record->u, cmd_at(known_tick(record->step, record->step))));
    for (size_t c = 0; c < CHANNELS; c++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, y[c], record->y[c]);
        known_y[c] = record->y[c];
    }
}

static void run_seed(void) {
    choose_setting();
    build();
    make_plant();
    tl_test_fmu_fail_above(&fmu, setting.fault, setting.fails_above);
    for (int i = 0; i < STEPS && tick(); i++) {
        if (run.ready) {
            look_at(&run.record);
        }
    }
}

static void what_is_committed_is_never_worse_than_nominal(void) {
    for (uint32_t number = 1; number <= SEEDS; number++) {
        seed = number * 7919U;
        run_seed();
        tl_test_run_end(&run, &plan);
    }
    TEST_ASSERT_TRUE(seen[TL_FIRST_GUESS] > 100 && seen[TL_OPTIMISED] > 100);
    TEST_ASSERT_TRUE(seen[TL_BEST_SO_FAR] > 100 && seen[TL_NOMINAL] > 100);
    TEST_ASSERT_TRUE(seen_failing_nominal > 50 && seen_failing_candidates > 50);
    TEST_ASSERT_TRUE(seen_without_nominal > 100 && ended_early < SEEDS / 4);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(what_is_committed_is_never_worse_than_nominal);
    return UNITY_END();
}
