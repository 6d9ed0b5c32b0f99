/* The chain in a twin: see bench_twin.h. */
#include "tests/bench/bench_twin.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { NAME_SIZE = 16, WARM_UP_TICKS = 2 * BENCH_LONGEST };

static const double BOUND = 1000.0;
static const double MISFIT = 1.000001;  /* factor of the measured value, so that no candidate can equal it */
static const double TOLERANCE = 1e-150; /* its square is still a normal number */

/* The plan of one chain, with room for its names. */
typedef struct bench_draft {
    tl_plan plan;
    char names[BENCH_LONGEST][NAME_SIZE];
    char inputs[BENCH_LONGEST][NAME_SIZE];
    char outputs[BENCH_LONGEST][NAME_SIZE];
    tl_plan_component components[BENCH_LONGEST];
    tl_plan_connection connections[BENCH_LONGEST];
    tl_plan_signal signal;
    tl_plan_adjust adjust;
    tl_plan_match match;
    tl_plan_output output;
    bool unknown_solver;
} bench_draft;

static void connect(bench_draft *draft, const char *from, const char *to) {
    draft->connections[draft->plan.connection_count++] = (tl_plan_connection){"connect", from, to};
}

static void draft_chain(bench_draft *draft, const bench_setup *setup) {
    for (size_t k = 0; k < setup->count; k++) {
        (void)snprintf(draft->names[k], NAME_SIZE, "c%u", (unsigned)k);
        (void)snprintf(draft->inputs[k], NAME_SIZE, "c%u.u", (unsigned)k);
        (void)snprintf(draft->outputs[k], NAME_SIZE, "c%u.y", (unsigned)k);
        draft->components[k] = (tl_plan_component){.where = draft->names[k],
                                                   .name = draft->names[k],
                                                   .model = &setup->fmu->model,
                                                   .functions = &setup->fmu->guard.functions,
                                                   .callbacks = &setup->fmu->guard.callbacks,
                                                   .resources = setup->fmu->resources};
        if (k > 0) {
            connect(draft, draft->outputs[k - 1], draft->inputs[k]);
        }
    }
    draft->output = (tl_plan_output){"outputs", draft->outputs[setup->count - 1]};
}

static void draft_plan(bench_draft *draft, const bench_setup *setup) {
    memset(draft, 0, sizeof *draft);
    draft_chain(draft, setup);
    draft->signal = (tl_plan_signal){.where = "plant", .name = "s", .type = TL_REAL, .unit = ""};
    tl_plan *plan = &draft->plan;
    plan->step = BENCH_STEP_NS;
    plan->components = draft->components;
    plan->component_count = setup->count;
    plan->signals = &draft->signal;
    plan->signal_count = 1;
    plan->connections = draft->connections;
    plan->outputs = &draft->output;
    plan->output_count = 1;
    plan->algorithm = setup->solver;
    plan->evaluations = setup->evaluations;
    plan->saving.structure = setup->saving;
    plan->saving.sequences = setup->saving;
    if (setup->solver == NULL) {
        plan->algorithm = "nelder-mead";
        connect(draft, "plant.s", draft->inputs[0]);
        return;
    }
    draft->adjust =
        (tl_plan_adjust){.where = "adjust", .variable = draft->inputs[0], .step = 0.1, .lower = -BOUND, .upper = BOUND};
    draft->match = (tl_plan_match){.where = "match",
                                   .variable = draft->outputs[setup->count - 1],
                                   .to = "plant.s",
                                   .tolerance = TOLERANCE,
                                   .weight = 1.0};
    plan->adjust = &draft->adjust;
    plan->adjust_count = 1;
    plan->match = &draft->match;
    plan->match_count = 1;
}

static void take_problem(void *context, tl_status status, const char *where, const char *text) {
    bench_draft *draft = context;
    (void)status;
    if (strcmp(where, "synchronise.algorithm") != 0) {
        bench_fail(where, text);
    }
    draft->unknown_solver = true;
}

/* The cycle's clock. */
static tl_time read_clock(void *context) {
    (void)context;
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

bool bench_twin_open(bench_twin *twin, const bench_setup *setup) {
    bench_draft draft;
    tl_report report = {.add = take_problem, .context = &draft};
    draft_plan(&draft, setup);
    memset(twin, 0, sizeof *twin);
    twin->locked = setup->solver != NULL;
    twin->count = setup->count;
    twin->budget.evaluations = setup->evaluations;
    twin->live = setup->live;
    twin->budget.now = setup->live ? read_clock : NULL;
    twin->budget.time = TL_SECOND;
    twin->twin = tl_twin_build(&draft.plan, &report);
    if (twin->twin == NULL) {
        return false;
    }
    bench_chain_open(&twin->plant, setup->fmu, setup->count);
    bench_twin_prepare(twin, WARM_UP_TICKS);
    bench_twin_run(twin, WARM_UP_TICKS, NULL);
    return true;
}

void bench_twin_close(bench_twin *twin) {
    tl_twin_destroy(twin->twin);
    bench_chain_close(&twin->plant);
    free(twin->signal);
    memset(twin, 0, sizeof *twin);
}

static void make_room(bench_twin *twin, int64_t ticks) {
    if (ticks > twin->capacity) {
        free(twin->signal);
        twin->signal = malloc((size_t)ticks * sizeof *twin->signal);
        twin->capacity = ticks;
    }
    if (twin->signal == NULL) {
        bench_fail("the plant", "not enough memory");
    }
}

void bench_twin_prepare(bench_twin *twin, int64_t ticks) {
    make_room(twin, ticks);
    for (int64_t i = 0; i < ticks; i++) {
        int64_t tick = twin->sample.tick + i;
        twin->output = twin->plant.y[twin->count - 1];
        twin->signal[i] = twin->locked ? MISFIT * twin->output : bench_excitation(tick);
        bench_chain_step(&twin->plant, tick);
    }
}

void bench_twin_run(bench_twin *twin, int64_t ticks, uint32_t *evaluations) {
    for (int64_t i = 0; i < ticks; i++) {
        tl_record record;
        tl_error error;
        bool ready = false;
        twin->sample.values[0] = twin->signal[i];
        twin->budget.started = twin->live ? read_clock(NULL) : 0;
        if (tl_twin_step(twin->twin, &twin->sample, &twin->budget, &record, &ready, &error) != TL_OK) {
            bench_fail("the twin", error.text);
        }
        if (evaluations != NULL) {
            evaluations[i] = record.evaluations;
        }
        twin->sample.tick++;
    }
}

void bench_twin_check(const bench_twin *twin) {
    double output = tl_twin_output(twin->twin, 0);
    if (memcmp(&output, &twin->output, sizeof output) != 0) {
        bench_fail("the twin", "its output is not the floor's");
    }
}

uint64_t bench_twin_executions(const bench_twin *twin) {
    uint64_t sum = 0;
    for (size_t k = 0; k < twin->count; k++) {
        sum += tl_twin_executions(twin->twin, k);
    }
    return sum;
}
