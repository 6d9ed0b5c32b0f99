/* Each step is in time, although the cost of FMUs may change at any execution. The accuracy
 * suffers instead. A repetition gives the same bits.
 *
 * Bound: before each macro step of a candidate, this step, the rest of the candidate and the
 * commit must fit, by the measured costs. If all costs rise by a factor, only the first slow steps
 * cannot be foreseen. So a step is late by at most (factor − 1) times one macro step and one
 * commit. */
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <time.h>
#include <unity.h>

#include "tests/support/random_numbers.h"
#include "tests/support/test_plan.h"

enum { CMD, Y0, SUM, FLAG, OTHER_FLAG }; /* signals */
enum { FMUS = 2, TICKS = 150, QUIET = 60, LAST = 10, SOLVERS = 6, EVALUATIONS = 40 };

/* Cost of both FMUs, factor of the slowdown, T_S and budget. A step that is late by the bound
 * still ends within T_S. */
static const tl_time DRIVE = TL_SECOND / 5000;
static const tl_time MOTOR = TL_SECOND / 1000;
static const tl_time BOTH = TL_SECOND / 5000 + TL_SECOND / 1000;
static const tl_time SLOWER = 10;
static const tl_time PERIOD = 60 * (TL_SECOND / 1000);
static const tl_time BUDGET = 36 * (TL_SECOND / 1000);

/* An expected cost decreases by a sixteenth in each step: a tenth is left after 36 committed
 * steps. */
enum { STEPS_TO_RECOVER = 36 };

static const char *const solvers[SOLVERS] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx", "boolean"};

typedef struct setting {
    const char *algorithm;
    const char *fallback;
    uint32_t prediction;
    tl_shape shape;
    tl_pairing measurements;
    bool saving;
    tl_keep keep;
    uint32_t stagnation;
    double noise_floor;
} setting;

static tl_test_log call_log;
static tl_test_fmu fmus[FMUS];
static tl_test_plan plan;
static tl_test_run run;

/* The fake clock, and what advances it. */
static struct {
    tl_time now;
    uint32_t seed;
    bool jumps; /* executions randomly become slow or fast */
    bool slow[FMUS];
    int64_t executions;
    int64_t slow_every; /* one of so many executions of each FMU is slow; 0: none */
    int64_t slow_at;    /* from this execution on, those FMUs are slow */
    bool slowed[FMUS];
    int64_t readings;
    int64_t pause_at; /* at this reading the machine pauses for `pause` */
    tl_time pause;
} watch;

static tl_record live[TICKS]; /* by step */
static bool caught_up[TICKS]; /* by tick */

void setUp(void) {
    memset(&watch, 0, sizeof watch);
    memset(caught_up, 0, sizeof caught_up);
    watch.slow_at = -1;
    watch.pause_at = -1;
}

void tearDown(void) {
    tl_test_run_end(&run, &plan);
}

/* ---- FMUs that take time ---- */

static void set_costs(void) {
    fmus[0].control.cost = watch.slow[0] ? SLOWER * DRIVE : DRIVE;
    fmus[1].control.cost = watch.slow[1] ? SLOWER * MOTOR : MOTOR;
}

static void set_slow(bool drive, bool motor) {
    watch.slow[0] = drive;
    watch.slow[1] = motor;
    set_costs();
}

static fmi2Status (*plain_step)(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean);

/* From any execution on, costs may differ. */
static fmi2Status watched_step(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    if (watch.executions++ == watch.slow_at) {
        set_slow(watch.slowed[0], watch.slowed[1]);
    }
    if (watch.slow_every != 0) {
        bool is_slow = watch.executions / FMUS % watch.slow_every == 0;
        set_slow(is_slow, is_slow);
    }
    if (watch.jumps && tl_test_any(&watch.seed, watch.slow[1] ? 30 : 200) == 0) {
        set_slow(!watch.slow[1], !watch.slow[1]);
    }
    return plain_step(component, time, step, final);
}

static tl_time read_clock(void *context) {
    (void)context;
    watch.now += watch.readings++ == watch.pause_at ? watch.pause : 0;
    return watch.now;
}

/* ---- the twin ---- */

static void add_fmus(const setting *set) {
    static const char *const names[FMUS] = {"drive", "motor"};
    for (size_t i = 0; i < FMUS; i++) {
        tl_test_fmu_init(&fmus[i], 2, true, &call_log);
        plain_step = fmus[i].functions.do_step;
        fmus[i].functions.do_step = watched_step;
        tl_test_plan_component(&plan, names[i], &fmus[i])->keep = set->keep;
        tl_test_plan_set(&plan, "lag", 0.1 + 0.05 * (double)i);
        tl_test_plan_set(&plan, "u1", 0.0);
        tl_test_plan_set(&plan, "count", 0.0);
        tl_test_plan_set(&plan, "mode", 0.0);
        tl_test_plan_set_value(&plan, "flag", (tl_value){.type = TL_BOOLEAN});
    }
}

/* The targets contradict each other, so no search reaches its tolerance. */
static void synchronise_numbers(void) {
    tl_test_plan_adjust(&plan, "motor.u0", 0.1);
    tl_test_plan_adjust(&plan, "motor.gain", 0.05)->lower = 0.2;
    tl_test_plan_match(&plan, "motor.y0", "plant.y0", 0.001);
    tl_test_plan_match(&plan, "motor.sum", "plant.sum", 0.001);
}

static void synchronise_booleans(void) {
    tl_test_plan_adjust(&plan, "motor.flag", 0.0);
    tl_test_plan_adjust(&plan, "drive.flag", 0.0)->dwell = 2 * PERIOD;
    tl_test_plan_match(&plan, "motor.flag_out", "plant.flag", 0.1);
    tl_test_plan_match(&plan, "drive.flag_out", "plant.other_flag", 0.1);
    tl_test_plan_match(&plan, "motor.y0", "plant.y0", 0.1); /* unreachable */
}

/* cmd → drive → motor, whose input is adjusted. */
static void build(const setting *set) {
    tl_test_run_end(&run, &plan);
    tl_test_plan_init(&plan, PERIOD);
    add_fmus(set);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y0", TL_REAL, "");
    tl_test_plan_signal(&plan, "sum", TL_REAL, "");
    tl_test_plan_signal(&plan, "flag", TL_BOOLEAN, "");
    tl_test_plan_signal(&plan, "other_flag", TL_BOOLEAN, "");
    tl_test_plan_connect(&plan, "plant.cmd", "drive.u0");
    tl_test_plan_connect(&plan, "drive.y0", "motor.u0");
    if (set->algorithm == NULL) { /* free */
        tl_test_plan_match(&plan, "motor.y0", "plant.y0", 0.001);
        plan.plan.algorithm = "secant";
    } else {
        (strcmp(set->algorithm, "boolean") == 0 ? synchronise_booleans : synchronise_numbers)();
        plan.plan.algorithm = set->algorithm;
    }
    plan.plan.fallback = set->fallback;
    plan.plan.stagnation = set->stagnation;
    plan.plan.noise_floor = set->noise_floor;
    plan.plan.prediction = set->prediction;
    plan.plan.shape = set->shape;
    plan.plan.measurements = set->measurements;
    plan.plan.saving = (tl_plan_saving){set->saving, set->saving, 0};
    plan.plan.margin = 0.01;
    plan.plan.evaluations = EVALUATIONS;
    tl_test_run_build(&run, &plan);
    run.budget.evaluations = EVALUATIONS;
}

static void use_clock(void) {
    fmus[0].control.clock = &watch.now;
    fmus[1].control.clock = &watch.now;
    set_costs();
    run.budget.now = read_clock;
    run.budget.time = BUDGET;
}

/* Sets the sample of this tick. */
static void feed(int64_t tick) {
    double t = (double)tick;
    run.sample.values[CMD] = sin(0.2 * t);
    run.sample.values[Y0] = sin(0.2 * t - 0.6) + 0.3;
    run.sample.values[SUM] = sin(0.2 * t - 0.6) + 0.5;
    run.sample.values[FLAG] = tick / 7 % 2 != 0 ? 1.0 : 0.0;
    run.sample.values[OTHER_FLAG] = tick / 11 % 2 != 0 ? 1.0 : 0.0;
}

/* Computes the next tick and keeps its record, if there is one. */
static void step(void) {
    int64_t tick = run.sample.tick;
    feed(tick);
    run.budget.started = watch.now;
    if (caught_up[tick]) {
        tl_test_run_catch_up(&run);
    } else {
        tl_test_run_step(&run);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    if (run.ready) {
        TEST_ASSERT_FALSE(run.record.objective > run.record.objective_nominal);
        live[run.record.step] = run.record;
    }
}

/* ---- which evaluations are started ---- */

static uint32_t ended_by_time; /* in the checked ticks */

/* A search that time ended had no time for another evaluation; without any evaluation, none for a
 * guess and nominal. Time for the commit is kept, although its step may be known. */
static void assert_not_timid(const setting *set) {
    tl_time evaluation = (tl_time)set->prediction * BOTH;
    if (run.record.stop == TL_STOP_TIME) {
        ended_by_time++;
        tl_time next = (run.record.evaluations == 0 ? 2 : 1) * evaluation + (set->saving ? BOTH : 0);
        TEST_ASSERT_TRUE(run.record.used + next > run.budget.time);
    }
}

/* Constant costs are known exactly. */
static void an_evaluation_is_begun_exactly_where_it_fits(void) {
    for (size_t s = 0; s < SOLVERS - 1; s++) {
        for (uint32_t prediction = 1; prediction <= 4; prediction++) {
            const setting set = {.algorithm = solvers[s], .prediction = prediction};
            build(&set);
            use_clock();
            ended_by_time = 0;
            for (int64_t tick = 0; tick < 100; tick++) {
                run.budget.time = BOTH + (tick % 30) * MOTOR;
                step();
                if (run.ready && run.record.step > 0) {
                    tl_time executions = (tl_time)(run.record.evaluations * prediction) + 1; /* all is executed */
                    TEST_ASSERT_EQUAL_INT64(executions * BOTH, run.record.used);
                    TEST_ASSERT_TRUE(run.record.used <= run.budget.time);
                    TEST_ASSERT_TRUE(run.record.evaluations == 0 || isfinite(run.record.objective_nominal));
                    assert_not_timid(&set);
                }
            }
            TEST_ASSERT_TRUE(ended_by_time > 5);
        }
    }
}

/* The log entry of a candidate gives its J: the FMU has no lag here, so y0 is u0. */
static void a_search_that_time_ends_commits_the_best_so_far(void) {
    static const double WANTED = 2.6;
    uint32_t best_is_not_last = 0;
    for (tl_time budget = 3; budget < 20; budget++) {
        setUp();
        tl_test_plan_init(&plan, PERIOD);
        tl_test_fmu_init(&fmus[0], 1, false, &call_log);
        tl_test_plan_component(&plan, "m", &fmus[0]);
        tl_test_plan_signal(&plan, "y0", TL_REAL, "");
        tl_test_plan_adjust(&plan, "m.u0", 1.0);
        tl_test_plan_match(&plan, "m.y0", "plant.y0", 1e-9);
        tl_test_run_init(&run, tl_test_plan_build(&plan));
        tl_test_run_step(&run);
        fmus[0].control.clock = &watch.now;
        fmus[0].control.cost = MOTOR;
        run.budget.now = read_clock;
        run.budget.time = budget * MOTOR;
        run.sample.values[0] = WANTED;
        tl_test_log_clear(&call_log);
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT(TL_STOP_TIME, run.record.stop);
        double best = 0.0;
        double last = 0.0;
        for (size_t i = 0; i < run.record.evaluations; i++) {
            last = tl_test_log_step(&call_log, &fmus[0], i)->u[0];
            best = fabs(last - WANTED) < fabs(best - WANTED) ? last : best;
        }
        best_is_not_last += fabs(best - last) > 0.0 ? 1 : 0;
        TEST_ASSERT_EQUAL_INT(TL_BEST_SO_FAR, run.record.outcome);
        TEST_ASSERT_TRUE(run.record.u[0] == best);
        tl_test_run_end(&run, &plan);
    }
    TEST_ASSERT_TRUE(best_is_not_last > 3); /* otherwise the test proves nothing */
}

/* Saving and restoring a state also takes time. */
static fmi2Status (*plain_get)(fmi2Component, fmi2FMUstate *);
static fmi2Status (*plain_set)(fmi2Component, fmi2FMUstate);

static fmi2Status costly_get(fmi2Component component, fmi2FMUstate *state) {
    watch.now += 2 * DRIVE;
    return plain_get(component, state);
}

static fmi2Status costly_set(fmi2Component component, fmi2FMUstate state) {
    watch.now += 3 * DRIVE;
    return plain_set(component, state);
}

static void let_states_take_time(void) {
    for (size_t i = 0; i < FMUS; i++) {
        plain_get = fmus[i].functions.get_fmu_state;
        plain_set = fmus[i].functions.set_fmu_state;
        fmus[i].functions.get_fmu_state = costly_get;
        fmus[i].functions.set_fmu_state = costly_set;
    }
}

static void states_that_take_time_are_reckoned_with(void) {
    static const tl_keep keeps[] = {TL_KEEP_STATES, TL_KEEP_STATES, TL_KEEP_OUTPUTS};
    for (uint32_t number = 0; number < SOLVERS * 15; number++) {
        const setting set = {.algorithm = solvers[number % SOLVERS],
                             .prediction = 1 + number / SOLVERS % 5,
                             .saving = number / 30 > 0,
                             .keep = keeps[number / 30]};
        build(&set);
        use_clock();
        let_states_take_time();
        for (int64_t tick = 0; tick < TICKS; tick++) {
            step();
            TEST_ASSERT_TRUE(!run.ready || run.record.step < 3 || run.record.used <= BUDGET);
        }
    }
}

/* Costs that are high now and then are expected: few candidates are started in vain. */
static void one_slow_execution_in_four_is_reckoned_with(void) {
    for (size_t s = 0; s < SOLVERS - 1; s++) {
        const setting set = {.algorithm = solvers[s], .prediction = 4};
        uint32_t evaluations = 0;
        uint32_t left = 0;
        setUp();
        build(&set);
        use_clock();
        run.budget.time = 4 * BUDGET;
        watch.slow_every = 4;
        for (int64_t tick = 0; tick < TICKS; tick++) {
            step();
            if (run.ready && run.record.step > 3) {
                uint32_t macro_steps = run.record.evaluations * set.prediction + 1;
                TEST_ASSERT_TRUE(run.record.used <= run.budget.time);
                left += run.record.executions > (FMUS + 1) * macro_steps ? 1 : 0;
                evaluations += run.record.evaluations;
            }
        }
        TEST_ASSERT_TRUE(left < TICKS / 2);
        TEST_ASSERT_TRUE(evaluations > TICKS); /* searches continue */
        tl_test_run_end(&run, &plan);
    }
}

/* ---- ten times as long ---- */

/* All solvers, horizons and ways of saving. */
static setting press_setting(uint32_t number) {
    setting set = {.algorithm = solvers[number % SOLVERS], .prediction = 1 + number / SOLVERS % 4};
    set.shape = number / 24 % 2 != 0 ? TL_DYNAMIC : TL_STATIC;
    set.saving = number / 48 % 2 != 0;
    return set;
}

enum { PRESS_SETTINGS = 96, AT_REST = 40 };

static void go_on(int64_t ticks) {
    for (int64_t i = 0; i < ticks; i++) {
        step();
        TEST_ASSERT_TRUE(!run.ready || run.record.used == watch.now - run.budget.started);
    }
}

/* The largest delay of the tick in which FMUs become slow; `slowed` names those FMUs. */
static tl_time excess(void) {
    tl_time late = (watch.slowed[0] ? DRIVE : 0) + (watch.slowed[1] ? MOTOR : 0);
    return (SLOWER - 1) * 2 * late;
}

static void slow_down_at(const setting *set, int64_t execution, bool drive, bool motor) {
    setUp();
    build(set);
    use_clock();
    go_on(AT_REST);
    assert_not_timid(set);
    watch.slowed[0] = drive;
    watch.slowed[1] = motor;
    watch.slow_at = watch.executions + execution;
    for (int64_t i = 0; i < 8; i++) {
        bool known = watch.slow_at < watch.executions;
        go_on(1);
        TEST_ASSERT_TRUE(run.record.used <= (known ? BUDGET : BUDGET + excess()));
        TEST_ASSERT_TRUE(run.record.used <= PERIOD);
        TEST_ASSERT_TRUE(run.record.evaluations <= EVALUATIONS);
    }
    watch.slow_at = -1;
    set_slow(false, false);
    go_on(STEPS_TO_RECOVER);
    for (int i = 0; i < 6; i++) {
        go_on(1);
        assert_not_timid(set);
    }
    tl_test_run_end(&run, &plan);
}

static void slower_by_ten_is_late_by_no_more_than_was_not_to_be_known(void) {
    for (uint32_t number = 0; number < PRESS_SETTINGS; number++) {
        const setting set = press_setting(number);
        for (int64_t execution = 0; execution < 40; execution += 5) {
            slow_down_at(&set, execution, true, true);
            slow_down_at(&set, execution + 1, execution % 2 != 0, execution % 2 == 0);
        }
    }
}

/* The mean error of the first output over some steps. */
static double mean_error(int64_t ticks) {
    double sum = 0.0;
    for (int64_t i = 0; i < ticks; i++) {
        step();
        sum += fabs(run.record.y[0] - run.record.measured[0]);
    }
    return sum / (double)ticks;
}

/* While FMUs are slow, accuracy is lost, but it stays better than without synchronisation. Later
 * it recovers. */
static void accuracy_is_what_is_lost_and_it_comes_back(void) {
    const setting set = {.algorithm = "nelder-mead", .prediction = 1};
    build(&set);
    plan.plan.match_count = 1; /* the reachable one */
    tl_twin_destroy(run.twin);
    tl_test_run_init(&run, tl_test_plan_build(&plan));
    run.budget.evaluations = EVALUATIONS;
    use_clock();
    (void)mean_error(20);
    double at_rest = mean_error(25);
    set_slow(true, true);
    double slow = mean_error(25);
    set_slow(false, false);
    (void)mean_error(STEPS_TO_RECOVER);
    double after = mean_error(25);
    TEST_ASSERT_TRUE(at_rest < 0.002 && after < 0.002);
    TEST_ASSERT_TRUE(slow > 10.0 * at_rest);
}

/* ---- repeated ---- */

static bool was_late(const tl_record *record) {
    return record->stop == TL_STOP_TIME || (record->flags & TL_FLAG_WITHOUT_NOMINAL) != 0;
}

static void assert_same(const tl_record *one, const tl_record *other) {
    TEST_ASSERT_EQUAL_INT(one->outcome, other->outcome);
    TEST_ASSERT_EQUAL_INT(one->stop, other->stop);
    TEST_ASSERT_EQUAL_UINT32(one->evaluations, other->evaluations);
    TEST_ASSERT_EQUAL_MEMORY(one->u, other->u, 2 * sizeof one->u[0]);
    TEST_ASSERT_EQUAL_MEMORY(one->y, other->y, plan.plan.match_count * sizeof one->y[0]);
    TEST_ASSERT_EQUAL_MEMORY(&one->objective, &other->objective, sizeof one->objective);
    TEST_ASSERT_EQUAL_MEMORY(&one->objective_nominal, &other->objective_nominal, sizeof one->objective);
    TEST_ASSERT_EQUAL_UINT32(one->held, other->held);
    TEST_ASSERT_EQUAL_UINT32(one->flags, other->flags);
}

/* Repeats the run without a clock, from its records. Returns the number of late steps. */
static uint32_t repeat(const setting *set) {
    static tl_record first[TICKS];
    uint32_t late = 0;
    memcpy(first, live, sizeof first);
    build(set);
    tl_twin_facts facts = tl_twin_get_facts(run.twin);
    for (int64_t tick = 0; tick < TICKS; tick++) {
        const tl_record *record = &first[tick < (int64_t)facts.lead ? 0 : tick - (int64_t)facts.lead];
        run.budget.repeated = was_late(record);
        run.budget.evaluations = run.budget.repeated ? record->evaluations : EVALUATIONS;
        run.budget.without_nominal = (record->flags & TL_FLAG_WITHOUT_NOMINAL) != 0;
        late += run.budget.repeated ? 1 : 0;
        step();
        if (run.ready) {
            assert_same(&first[run.record.step], &run.record);
        }
    }
    return late;
}

/* An FMU without kept states must catch up before an execution, by at most a horizon. */
static tl_time executions_of_one(const setting *set) {
    return set->saving && set->keep == TL_KEEP_OUTPUTS ? 1 + (tl_time)set->prediction : 1;
}

/* With a clock that jumps all the time. */
static void run_live(const setting *set, uint32_t seed) {
    build(set);
    use_clock();
    watch.seed = seed;
    for (int64_t tick = 0; tick < TICKS; tick++) {
        watch.jumps = tick > 8 && tick < TICKS - QUIET;
        step();
        tl_time used = watch.now - run.budget.started;
        TEST_ASSERT_TRUE(tick < 8 || used <= BUDGET + 2 * (SLOWER - 1) * BOTH * executions_of_one(set));
    }
    watch.jumps = false;
    set_slow(false, false);
}

static void a_late_step_is_repeated_to_the_bit(void) {
    uint32_t late[SOLVERS] = {0};
    for (uint32_t number = 0; number < PRESS_SETTINGS; number++) {
        const setting set = press_setting(number);
        setUp();
        run_live(&set, 1 + number);
        late[number % SOLVERS] += repeat(&set);
        tl_test_run_end(&run, &plan);
    }
    for (size_t s = 0; s < SOLVERS; s++) {
        TEST_ASSERT_TRUE(late[s] > 100);
    }
}

/* Any setting: pairing modes, second solvers, held variables and missed ticks. */
static void any_setting_is_repeated_to_the_bit(void) {
    uint32_t flags = 0;
    uint32_t held = 0;
    for (uint32_t seed = 1; seed <= 150; seed++) {
        setUp();
        watch.seed = seed;
        setting set = press_setting(tl_test_any(&watch.seed, PRESS_SETTINGS));
        bool numbers = strcmp(set.algorithm, "boolean") != 0;
        set.measurements = (tl_pairing)tl_test_any(&watch.seed, 3);
        set.fallback =
            numbers && tl_test_any(&watch.seed, 2) == 0 ? solvers[tl_test_any(&watch.seed, SOLVERS - 1)] : NULL;
        set.stagnation = tl_test_any(&watch.seed, 3) == 0 ? 3 + tl_test_any(&watch.seed, 8) : 0;
        set.noise_floor = tl_test_any(&watch.seed, 3) == 0 ? 5.0 * tl_test_any(&watch.seed, 12) : 0.0;
        set.keep = tl_test_any(&watch.seed, 2) == 0 ? TL_KEEP_STATES : TL_KEEP_OUTPUTS;
        for (size_t tick = 1; tick < TICKS; tick++) {
            caught_up[tick] = tl_test_any(&watch.seed, 12) == 0;
        }
        run_live(&set, seed);
        for (size_t i = 0; i < TICKS - 6; i++) {
            flags |= live[i].flags;
            held |= live[i].held;
        }
        (void)repeat(&set);
        tl_test_run_end(&run, &plan);
    }
    TEST_ASSERT_EQUAL_HEX32(TL_FLAG_FALLBACK | TL_FLAG_STAGNATED | TL_FLAG_WITHOUT_NOMINAL, flags);
    TEST_ASSERT_EQUAL_HEX32(3, held);
}

/* ---- at the ends ---- */

/* The machine pauses once, at any point of a step: that is forgotten again. */
static void a_pause_is_forgotten(void) {
    for (int64_t at = 0; at < 24; at++) {
        const setting set = {.algorithm = "secant", .prediction = 2};
        setUp();
        build(&set);
        use_clock();
        go_on(10);
        watch.pause_at = watch.readings + at;
        watch.pause = 10 * BUDGET;
        go_on(110);
        TEST_ASSERT_TRUE(watch.readings > watch.pause_at);
        assert_not_timid(&set);
        TEST_ASSERT_TRUE(run.record.evaluations > 0);
        tl_test_run_end(&run, &plan);
    }
}

/* Then the twin equals a free twin, bit for bit, at all times. */
static void a_budget_that_is_always_too_short_commits_nominal(void) {
    static double alone[1000];
    const setting free_run = {.algorithm = NULL};
    build(&free_run);
    for (int64_t tick = 0; tick < 1000; tick++) {
        feed(tick);
        tl_test_run_step(&run);
        alone[tick] = run.ready ? run.record.y[0] : 0.0;
    }
    for (size_t s = 0; s < SOLVERS - 1; s++) {
        for (int saving = 0; saving < 2; saving++) {
            const setting set = {.algorithm = solvers[s], .prediction = 1, .saving = saving > 0};
            build(&set);
            use_clock();
            run.budget.time = (saving > 0 ? MOTOR : BOTH) + BOTH - 1; /* a candidate, but not its commit */
            for (int64_t tick = 0; tick < 1000; tick++) {
                feed(tick);
                run.budget.started = watch.now;
                run.budget.evaluations = run.sample.tick < 2 ? 1 : EVALUATIONS; /* costs are unknown at first */
                tl_test_run_step(&run);
                TEST_ASSERT_EQUAL_INT(TL_OK, run.status);
                if (tick > 1) {
                    TEST_ASSERT_EQUAL_INT(TL_NOMINAL, run.record.outcome);
                    TEST_ASSERT_EQUAL_INT(TL_STOP_TIME, run.record.stop);
                    TEST_ASSERT_EQUAL_UINT32(0, run.record.evaluations);
                    TEST_ASSERT_EQUAL_UINT32(TL_FLAG_WITHOUT_NOMINAL, run.record.flags);
                    TEST_ASSERT_EQUAL_INT64(BOTH, run.record.used); /* the commit only */
                    TEST_ASSERT_EQUAL_MEMORY(run.record.nominal, run.record.u, 2 * sizeof run.record.u[0]);
                    TEST_ASSERT_EQUAL_MEMORY(&alone[tick], &run.record.y[0], sizeof alone[0]);
                }
            }
        }
    }
}

/* ---- a real clock: processor time of this thread, so that a busy machine does not matter ---- */

static tl_time burnt; /* ns of an execution, at least */

static tl_time read_processor(void *context) {
    (void)context;
    struct timespec now;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

static fmi2Status burning_step(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    tl_time begun = read_processor(NULL);
    while (read_processor(NULL) - begun < burnt) {
    }
    return plain_step(component, time, step, final);
}

/* An execution takes `burnt` or longer, so at most this many evaluations fit. */
static uint32_t most_that_fit(const setting *set) {
    return (uint32_t)((run.budget.time / (FMUS * burnt) - 1) / (tl_time)set->prediction);
}

/* The test does not check how long a tick took, because interrupts may only reduce the
 * evaluations. */
static void under_a_real_clock_no_more_is_begun_than_fits(void) {
    for (size_t s = 0; s < SOLVERS - 1; s++) {
        const setting set = {.algorithm = solvers[s], .prediction = 1 + (uint32_t)s % 2};
        build(&set);
        fmus[0].functions.do_step = burning_step;
        fmus[1].functions.do_step = burning_step;
        run.budget.now = read_processor;
        run.budget.time = TL_SECOND / 500;
        for (int64_t tick = 0; tick < 40; tick++) {
            burnt = tick / 10 % 2 == 0 ? TL_SECOND / 20000 : TL_SECOND / 2000;
            feed(tick);
            run.budget.started = read_processor(NULL);
            tl_test_run_step(&run);
            TEST_ASSERT_EQUAL_INT(TL_OK, run.status);
            tl_time executed = FMUS * burnt * ((tl_time)run.record.evaluations * (tl_time)set.prediction + 1);
            if (run.ready && run.record.step > 0 && tick % 10 != 0) { /* not in a tick with new costs */
                TEST_ASSERT_TRUE(run.record.evaluations <= most_that_fit(&set));
                TEST_ASSERT_TRUE(run.record.used >= executed);
                TEST_ASSERT_TRUE(run.record.objective <= run.record.objective_nominal || isnan(run.record.objective));
            }
        }
    }
}

static void the_constants_fit(void) {
    TEST_ASSERT_EQUAL_INT64(PERIOD * 6 / 10, BUDGET);
    TEST_ASSERT_EQUAL_INT64(DRIVE + MOTOR, BOTH);
    TEST_ASSERT_TRUE((SLOWER - 1) * 2 * BOTH <= PERIOD - BUDGET);
    TEST_ASSERT_TRUE(pow(15.0 / 16.0, STEPS_TO_RECOVER) < 1.0 / (double)SLOWER);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(the_constants_fit);
    RUN_TEST(an_evaluation_is_begun_exactly_where_it_fits);
    RUN_TEST(a_search_that_time_ends_commits_the_best_so_far);
    RUN_TEST(states_that_take_time_are_reckoned_with);
    RUN_TEST(one_slow_execution_in_four_is_reckoned_with);
    RUN_TEST(slower_by_ten_is_late_by_no_more_than_was_not_to_be_known);
    RUN_TEST(accuracy_is_what_is_lost_and_it_comes_back);
    RUN_TEST(a_late_step_is_repeated_to_the_bit);
    RUN_TEST(any_setting_is_repeated_to_the_bit);
    RUN_TEST(a_pause_is_forgotten);
    RUN_TEST(a_budget_that_is_always_too_short_commits_nominal);
    RUN_TEST(under_a_real_clock_no_more_is_begun_than_fits);
    return UNITY_END();
}
