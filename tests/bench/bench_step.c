/* Benchmark: what a macro step costs beyond the FMU's own work.
 *
 * usage: bench_step FMU CONFIG    for example build/host/fmus/lag.fmu config/motor/free.json
 *
 * First part: an FMU with one Real input and one output, stepped by a plain loop of the same dlopen'ed calls (the floor)
 * and by the twin; both in turns in one process, the fastest of many rounds. Second part: free steps of a configuration.
 * Figures are ratios and nanoseconds; compare only within one run.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "firmware/assembly.h"
#include "firmware/clock.h"
#include "firmware/fmu_store.h"
#include "master/twin.h"

enum { STEPS = 20000, ROUNDS = 15 };

static const tl_time STEP = TL_SECOND / 100;

static void fail(const char *text) {
    (void)fprintf(stderr, "bench_step: %s\n", text);
    exit(1);
}

static const tl_variable *first_of(const tl_model *model, tl_causality causality) {
    for (size_t i = 0; i < model->variable_count; i++) {
        if (model->variables[i].causality == causality && model->variables[i].type == TL_REAL) {
            return &model->variables[i];
        }
    }
    fail("the FMU needs a Real input and a Real output");
    return NULL;
}

/* The floor: set, step, get, and nothing else. */
static tl_time time_floor(const tl_fmu *fmu) {
    const tl_fmi2 *fmi = &fmu->functions;
    const fmi2ValueReference in = first_of(&fmu->model, TL_INPUT)->reference;
    const fmi2ValueReference out = first_of(&fmu->model, TL_OUTPUT)->reference;
    fmi2Component instance = fmi->instantiate("floor", fmi2CoSimulation, fmu->model.guid, fmu->resources,
                                              &fmu->callbacks, fmi2False, fmi2False);
    if (instance == NULL) {
        fail("cannot instantiate");
    }
    (void)fmi->setup_experiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0);
    (void)fmi->enter_initialization_mode(instance);
    (void)fmi->exit_initialization_mode(instance);
    double u = 0.0;
    double y = 0.0;
    tl_time begun = tl_clock_now(NULL);
    for (int64_t i = 0; i < STEPS; i++) {
        u = (double)(i % 7);
        (void)fmi->set_real(instance, &in, 1, &u);
        (void)fmi->do_step(instance, tl_seconds(i * STEP), tl_seconds(STEP), fmi2True);
        (void)fmi->get_real(instance, &out, 1, &y);
    }
    tl_time took = tl_clock_now(NULL) - begun;
    (void)fmi->terminate(instance);
    fmi->free_instance(instance);
    return took;
}

static void print_problem(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    (void)fprintf(stderr, "bench_step: %s: %s\n", where, text);
}

static tl_time time_ticks(tl_twin *twin, size_t signals, uint64_t *executions) {
    tl_sample sample = {0};
    const tl_budget budget = {.evaluations = 1};
    tl_time begun = 0;
    for (int64_t i = 0; i <= STEPS; i++) {
        tl_record record;
        tl_error error;
        bool ready = false;
        sample.tick = i;
        for (size_t k = 0; k < signals; k++) {
            sample.values[k] = (double)(i % 7) * 0.1;
        }
        if (tl_twin_step(twin, &sample, &budget, &record, &ready, &error) != TL_OK) {
            fail(error.text);
        }
        begun = i == 0 ? tl_clock_now(NULL) : begun;
    }
    tl_time took = tl_clock_now(NULL) - begun;
    *executions = 0;
    for (size_t i = 0; i < tl_twin_get_facts(twin).components; i++) {
        *executions += tl_twin_executions(twin, i);
    }
    return took;
}

/* The same component in a twin, driven by the plant. */
static tl_time time_twin(const tl_fmu *fmu) {
    char to[128];
    char from[128];
    (void)snprintf(to, sizeof to, "c.%s", first_of(&fmu->model, TL_INPUT)->name);
    (void)snprintf(from, sizeof from, "c.%s", first_of(&fmu->model, TL_OUTPUT)->name);
    const tl_plan_component component = {.where = "c",
                                         .name = "c",
                                         .model = &fmu->model,
                                         .functions = &fmu->functions,
                                         .callbacks = &fmu->callbacks,
                                         .resources = fmu->resources};
    const tl_plan_signal signal = {.where = "u", .name = "u", .type = TL_REAL, .unit = ""};
    const tl_plan_connection connection = {"connect", "plant.u", to};
    const tl_plan_output output = {"output", from};
    const tl_plan plan = {.step = STEP,
                          .components = &component,
                          .component_count = 1,
                          .signals = &signal,
                          .signal_count = 1,
                          .connections = &connection,
                          .connection_count = 1,
                          .outputs = &output,
                          .output_count = 1,
                          .algorithm = "nelder-mead"};
    tl_report report = {.add = print_problem};
    tl_twin *twin = tl_twin_build(&plan, &report);
    if (twin == NULL) {
        fail("cannot build the twin");
    }
    uint64_t executions = 0;
    tl_time took = time_ticks(twin, 1, &executions);
    tl_twin_destroy(twin);
    return took;
}

static void bench_component(const char *path) {
    tl_fmu fmu;
    tl_error error;
    if (tl_fmu_load(path, &fmu, &error) != TL_OK) {
        fail(error.text);
    }
    tl_time floor_best = INT64_MAX;
    tl_time twin_best = INT64_MAX;
    for (int round = 0; round < ROUNDS; round++) {
        tl_time floor_took = time_floor(&fmu);
        tl_time twin_took = time_twin(&fmu);
        floor_best = floor_took < floor_best ? floor_took : floor_best;
        twin_best = twin_took < twin_best ? twin_took : twin_best;
    }
    (void)printf("%-12s floor %8.1f ns per step, twin %8.1f ns, ratio %.2f\n", fmu.model.name,
                 (double)floor_best / STEPS, (double)twin_best / STEPS, (double)twin_best / (double)floor_best);
    tl_fmu_unload(&fmu);
}

static void bench_configuration(const char *path) {
    tl_time best = INT64_MAX;
    uint64_t executions = 0;
    for (int round = 0; round < ROUNDS; round++) {
        tl_assembly assembly;
        if (tl_assembly_load(path, &assembly) != TL_OK) {
            fail("cannot load the configuration");
        }
        tl_time took = time_ticks(assembly.twin, assembly.config.signal_count, &executions);
        best = took < best ? took : best;
        tl_assembly_free(&assembly);
    }
    (void)printf("%s: %.1f ns per free execution\n", path, (double)best / (double)executions);
}

int main(int argc, char **argv) {
    if (argc != 3) {
        (void)fputs("usage: bench_step FMU CONFIG\n", stderr);
        return 2;
    }
    bench_component(argv[1]);
    bench_configuration(argv[2]);
    return 0;
}
