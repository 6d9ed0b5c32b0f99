/* Floor of the benchmark: a hand-written loop that makes only the FMI calls of a chain of FMUs, in
 * the same order as the twin.
 *
 * Purpose: measures the denominator of each ratio. The loop has no types, units, error handling,
 *          objective or search.
 * Chain:   the caller sets the input of the first component. Each other component gets the output
 *          of the one before it, one step later.
 * Owner:   a chain must be closed before its FMU is unloaded.
 */
#ifndef TL_TESTS_BENCH_BENCH_FLOOR_H
#define TL_TESTS_BENCH_BENCH_FLOOR_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/fmu/fmu_store.h"

enum { BENCH_LONGEST = 32 };

/* The macro step, in s and in ns. */
#define BENCH_STEP_S 0.01
#define BENCH_STEP_NS ((tl_time)10000000)

typedef struct bench_chain {
    const tl_fmi2 *fmi;
    size_t count;
    fmi2ValueReference input;
    fmi2ValueReference output;
    double u[BENCH_LONGEST];
    double y[BENCH_LONGEST];
    fmi2Component instances[BENCH_LONGEST];
    fmi2FMUstate states[BENCH_LONGEST];
    double saved[BENCH_LONGEST]; /* u at the time of the saved states */
} bench_chain;

/* Prints the two texts and ends the program. */
void bench_fail(const char *what, const char *why);

/* Instantiates and initialises `count` components. Input and output of each are the FMU's Real
 * variables "u" and "y". */
void bench_chain_open(bench_chain *chain, const tl_fmu *fmu, size_t count);
void bench_chain_close(bench_chain *chain);

/* Excitation: the input of the first component at a step. It is never 0, so that no value becomes
 * denormal. */
static inline double bench_excitation(int64_t step) {
    static const double values[8] = {1.0, 1.3, 1.7, 1.5, 0.8, 0.4, 0.6, 0.9};
    return values[step & 7];
}

/* Executes one step with the excitation, for a chain that is the plant. No measurement includes
 * it. */
void bench_chain_step(bench_chain *chain, int64_t step);

/* Executes steps `first` … `first + steps − 1` with the excitation. */
void bench_floor_free(bench_chain *chain, int64_t first, int64_t steps);

/* The same steps, synchronised: each step saves the states, evaluates candidates, and commits. Each
 * candidate has another u at the first input, and a horizon of as many steps as components.
 * `evaluations`: number of candidates of each step. */
void bench_floor_locked(bench_chain *chain, int64_t first, int64_t steps, const uint32_t *evaluations);

#endif
