/* The floor: what a chain of FMUs costs in a hand-written loop of the same calls, in the same order, and nothing else.
 *
 * Purpose: the denominator of every ratio. It knows no types, units, failures, objectives or searches.
 * Chain:   the first component's input is given; every other one's is the output of the one before it, a step later.
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
    double saved[BENCH_LONGEST]; /* u with the state */
} bench_chain;

/* Ends the program. */
void bench_fail(const char *what, const char *why);

/* Instantiates and initialises `count` components; the FMU's Real variables "u" and "y" are its ends. */
void bench_chain_open(bench_chain *chain, const tl_fmu *fmu, size_t count);
void bench_chain_close(bench_chain *chain);

/* What the plant does: never zero for long, so that nothing becomes denormal. */
static inline double bench_excitation(int64_t step) {
    static const double values[8] = {1.0, 1.3, 1.7, 1.5, 0.8, 0.4, 0.6, 0.9};
    return values[step & 7];
}

/* One step under the excitation. Not a part of any figure: it is for a chain that plays the plant. */
void bench_chain_step(bench_chain *chain, int64_t step);

/* Steps `first` … `first + steps − 1`, the excitation at the first input. */
void bench_floor_free(bench_chain *chain, int64_t first, int64_t steps);

/* The same steps synchronised: saved, evaluated over a horizon of as many steps as there are components, each time with
 * another u at the first input, and committed. `evaluations` says how often, step by step. */
void bench_floor_locked(bench_chain *chain, int64_t first, int64_t steps, const uint32_t *evaluations);

#endif
