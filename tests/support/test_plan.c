/* A plan of a twin made of test FMUs: see test_plan.h. */
#include "tests/support/test_plan.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "tests/support/message.h"

static void add_problem(void *context, tl_status status, const char *where, const char *text) {
    tl_test_plan *plan = context;
    size_t number = plan->report.count - 1; /* counted already */
    if (number < TL_TEST_PROBLEMS) {
        tl_test_problem *problem = &plan->problems[number];
        problem->status = status;
        (void)snprintf(problem->where, sizeof problem->where, "%s", where);
        (void)snprintf(problem->text, sizeof problem->text, "%s", text);
    }
}

void tl_test_plan_init(tl_test_plan *plan, tl_time step) {
    memset(plan, 0, sizeof *plan);
    plan->plan.step = step;
    plan->plan.components = plan->components;
    plan->plan.signals = plan->signals;
    plan->plan.connections = plan->connections;
    plan->plan.adjust = plan->adjust;
    plan->plan.match = plan->match;
    plan->plan.measurements = TL_LAG;
    plan->plan.algorithm = "nelder-mead";
}

/* Stores and returns "kind.name". */
static const char *where_of(tl_test_plan *plan, const char *kind, const char *name) {
    assert(plan->where_count < sizeof plan->where / sizeof plan->where[0]);
    char *where = plan->where[plan->where_count++];
    (void)snprintf(where, TL_TEST_WHERE, "%s.%s", kind, name);
    return where;
}

tl_plan_component *tl_test_plan_component(tl_test_plan *plan, const char *name, tl_test_fmu *fmu) {
    size_t number = plan->plan.component_count++;
    assert(number < TL_TEST_COMPONENTS);
    tl_plan_component *component = &plan->components[number];
    plan->fmus[number] = fmu;
    *component = (tl_plan_component){.where = where_of(plan, "components", name),
                                     .name = name,
                                     .model = &fmu->model,
                                     .functions = &fmu->functions,
                                     .callbacks = &fmu->callbacks,
                                     .resources = "file:///resources",
                                     .set = plan->sets[number]};
    return component;
}

void tl_test_plan_set_value(tl_test_plan *plan, const char *variable, tl_value value) {
    size_t number = plan->plan.component_count - 1;
    tl_plan_component *component = &plan->components[number];
    assert(component->set_count < TL_TEST_SETS);
    tl_plan_set *set = &plan->sets[number][component->set_count++];
    *set = (tl_plan_set){.where = where_of(plan, "set", variable), .variable = variable, .value = value};
}

void tl_test_plan_set(tl_test_plan *plan, const char *variable, double value) {
    const tl_value number = {.type = TL_REAL, .real = value};
    tl_test_plan_set_value(plan, variable, number);
}

tl_plan_signal *tl_test_plan_signal(tl_test_plan *plan, const char *name, tl_type type, const char *unit) {
    size_t number = plan->plan.signal_count++;
    assert(number < sizeof plan->signals / sizeof plan->signals[0]);
    tl_plan_signal *signal = &plan->signals[number];
    *signal = (tl_plan_signal){.where = where_of(plan, "plant", name), .name = name, .type = type, .unit = unit};
    return signal;
}

void tl_test_plan_connect(tl_test_plan *plan, const char *from, const char *to) {
    size_t number = plan->plan.connection_count++;
    assert(number < TL_TEST_CONNECTIONS && plan->where_count < sizeof plan->where / sizeof plan->where[0]);
    char *where = plan->where[plan->where_count++];
    (void)snprintf(where, TL_TEST_WHERE, "connect[%u]", (unsigned)number);
    plan->connections[number] = (tl_plan_connection){.where = where, .from = from, .to = to};
}

tl_plan_adjust *tl_test_plan_adjust(tl_test_plan *plan, const char *variable, double step) {
    size_t number = plan->plan.adjust_count++;
    assert(number < sizeof plan->adjust / sizeof plan->adjust[0]);
    tl_plan_adjust *adjust = &plan->adjust[number];
    *adjust = tl_plan_adjust_defaults(variable, step);
    adjust->where = where_of(plan, "adjust", variable);
    return adjust;
}

tl_plan_match *tl_test_plan_match(tl_test_plan *plan, const char *variable, const char *to, double tolerance) {
    size_t number = plan->plan.match_count++;
    assert(number < sizeof plan->match / sizeof plan->match[0]);
    tl_plan_match *match = &plan->match[number];
    *match = tl_plan_match_defaults(variable, to, tolerance);
    match->where = where_of(plan, "match", variable);
    return match;
}

tl_twin *tl_test_plan_build(tl_test_plan *plan) {
    memset(plan->problems, 0, sizeof plan->problems);
    plan->report = (tl_report){.add = add_problem, .context = plan};
    return tl_twin_build(&plan->plan, &plan->report);
}

const tl_test_problem *tl_test_plan_problem(const tl_test_plan *plan, const char *where, const char *words) {
    for (size_t i = 0; i < plan->report.count && i < TL_TEST_PROBLEMS; i++) {
        const tl_test_problem *problem = &plan->problems[i];
        if (strcmp(problem->where, where) == 0 && tl_test_has_parts(problem->text, words)) {
            return problem;
        }
    }
    return NULL;
}

void tl_test_plan_single(tl_test_plan *plan, tl_test_fmu *fmu, tl_test_log *log) {
    tl_test_plan_init(plan, TL_SECOND / 10);
    tl_test_fmu_init(fmu, 1, false, log);
    tl_test_plan_component(plan, "m", fmu);
    tl_test_plan_signal(plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(plan, "y0", TL_REAL, "");
    tl_test_plan_connect(plan, "plant.cmd", "m.u0");
    tl_test_plan_match(plan, "m.y0", "plant.y0", 0.01);
}

void tl_test_run_init(tl_test_run *run, tl_twin *twin) {
    memset(run, 0, sizeof *run);
    run->twin = twin;
    run->budget.evaluations = 200;
}

void tl_test_run_build(tl_test_run *run, tl_test_plan *plan) {
    tl_twin *twin = tl_test_plan_build(plan);
    TEST_ASSERT_EQUAL_STRING("", plan->problems[0].text);
    tl_test_run_init(run, twin);
}

static void end_fmu(tl_test_fmu *fmu) {
    char violation[sizeof fmu->log->first_violation];
    bool clean = fmu->dead || (fmu->living == 0 && fmu->states == 0);
    memcpy(violation, fmu->log->first_violation, sizeof violation);
    tl_test_fmu_end(fmu);
    tl_test_log_clear(fmu->log);
    TEST_ASSERT_EQUAL_STRING("", violation);
    TEST_ASSERT_TRUE(clean);
}

void tl_test_run_end(tl_test_run *run, tl_test_plan *plan) {
    tl_twin_destroy(run->twin);
    run->twin = NULL;
    for (size_t i = 0; i < plan->plan.component_count; i++) {
        end_fmu(plan->fmus[i]);
    }
}

/* The sample becomes that of the next tick. */
static void move_on(tl_test_run *run) {
    run->sample.tick++;
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        run->sample.stamps[i] = run->sample.tick * TL_SECOND;
    }
}

void tl_test_run_step(tl_test_run *run) {
    run->status = tl_twin_step(run->twin, &run->sample, &run->budget, &run->record, &run->ready, &run->error);
    move_on(run);
}

const tl_record *tl_test_run_tick(tl_test_run *run, tl_test_log *log) {
    do {
        tl_test_log_clear(log);
        tl_test_run_step(run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run->status, run->error.text);
        TEST_ASSERT_EQUAL_STRING("", log->first_violation);
    } while (!run->ready);
    return &run->record;
}

const tl_record *tl_test_run_single(tl_test_run *run, tl_test_log *log, double cmd, double y0) {
    run->sample.values[TL_TEST_CMD] = cmd;
    run->sample.values[TL_TEST_Y0] = y0;
    return tl_test_run_tick(run, log);
}

void tl_test_run_catch_up(tl_test_run *run) {
    run->status = tl_twin_catch_up(run->twin, &run->sample, &run->record, &run->ready, &run->error);
    move_on(run);
}

void tl_test_run_follow(tl_test_run *run, const double *u) {
    run->status = tl_twin_follow(run->twin, &run->sample, u, &run->record, &run->ready, &run->error);
    move_on(run);
}
