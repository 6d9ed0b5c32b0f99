/* The floor: see bench_floor.h. */
#include "tests/bench/bench_floor.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "master/fmi/model.h"

void bench_fail(const char *what, const char *why) {
    (void)fprintf(stderr, "bench: %s: %s\n", what, why);
    exit(1);
}

static fmi2ValueReference reference_of(const tl_fmu *fmu, const char *name) {
    const tl_variable *variable = tl_model_variable(&fmu->model, name);
    if (variable == NULL || variable->type != TL_REAL) {
        bench_fail(fmu->path, "the benchmark needs the Real variables u and y");
    }
    return variable->reference;
}

void bench_chain_open(bench_chain *chain, const tl_fmu *fmu, size_t count) {
    memset(chain, 0, sizeof *chain);
    chain->fmi = &fmu->guard.own;
    chain->count = count;
    chain->input = reference_of(fmu, "u");
    chain->output = reference_of(fmu, "y");
    for (size_t k = 0; k < count; k++) {
        fmi2Component instance = chain->fmi->instantiate("floor", fmi2CoSimulation, fmu->model.guid, fmu->resources,
                                                         &fmu->guard.fmu_callbacks, fmi2False, fmi2False);
        if (instance == NULL) {
            bench_fail(fmu->path, "cannot be instantiated");
        }
        (void)chain->fmi->setup_experiment(instance, fmi2False, 0.0, 0.0, fmi2False, 0.0);
        (void)chain->fmi->enter_initialization_mode(instance);
        (void)chain->fmi->exit_initialization_mode(instance);
        (void)chain->fmi->get_real(instance, &chain->output, 1, &chain->y[k]);
        chain->instances[k] = instance;
    }
    for (size_t k = 1; k < count; k++) {
        chain->u[k] = chain->y[k - 1];
    }
}

void bench_chain_close(bench_chain *chain) {
    for (size_t k = 0; k < chain->count; k++) {
        if (chain->states[k] != NULL) {
            (void)chain->fmi->free_fmu_state(chain->instances[k], &chain->states[k]);
        }
        (void)chain->fmi->terminate(chain->instances[k]);
        chain->fmi->free_instance(chain->instances[k]);
    }
}

/* ---- The loop ---- */

static void step_all(bench_chain *chain, int64_t step, fmi2Boolean is_final) {
    const tl_fmi2 *fmi = chain->fmi;
    double now = (double)step * BENCH_STEP_S;
    for (size_t k = 0; k < chain->count; k++) {
        fmi2Component instance = chain->instances[k];
        (void)fmi->set_real(instance, &chain->input, 1, &chain->u[k]);
        (void)fmi->do_step(instance, now, BENCH_STEP_S, is_final);
        (void)fmi->get_real(instance, &chain->output, 1, &chain->y[k]);
    }
    for (size_t k = 1; k < chain->count; k++) {
        chain->u[k] = chain->y[k - 1];
    }
}

static void save_all(bench_chain *chain) {
    for (size_t k = 0; k < chain->count; k++) {
        (void)chain->fmi->get_fmu_state(chain->instances[k], &chain->states[k]);
        chain->saved[k] = chain->u[k];
    }
}

static void restore_all(bench_chain *chain) {
    for (size_t k = 0; k < chain->count; k++) {
        (void)chain->fmi->set_fmu_state(chain->instances[k], chain->states[k]);
        chain->u[k] = chain->saved[k];
    }
}

void bench_chain_step(bench_chain *chain, int64_t step) {
    chain->u[0] = bench_excitation(step);
    step_all(chain, step, fmi2True);
}

void bench_floor_free(bench_chain *chain, int64_t first, int64_t steps) {
    for (int64_t step = first; step < first + steps; step++) {
        chain->u[0] = bench_excitation(step);
        step_all(chain, step, fmi2True);
    }
}

void bench_floor_locked(bench_chain *chain, int64_t first, int64_t steps, const uint32_t *evaluations) {
    int64_t horizon = (int64_t)chain->count;
    for (int64_t step = first; step < first + steps; step++) {
        save_all(chain);
        for (uint32_t e = 0; e < evaluations[step - first]; e++) {
            restore_all(chain);
            chain->u[0] = 1.0 + 0.001 * e;
            for (int64_t j = step; j < step + horizon; j++) {
                step_all(chain, j, fmi2False);
            }
        }
        restore_all(chain);
        chain->u[0] = bench_excitation(step);
        step_all(chain, step, fmi2True);
    }
}
