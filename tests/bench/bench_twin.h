/* The same chain in a twin, by the façade only: free, or locked to what a chain under the excitation measures.
 *
 * Purpose: the numerator of every ratio.
 * Plant:   a chain of the floor's under the excitation. A free twin is given the excitation, a locked one the last output.
 * Locked:  the first input is adjusted, the last output is matched with a tolerance that nothing but equality meets,
 *          T_P = T_D. So a search ends with its budget, or where its solver ends it.
 * Owner:   a twin must be closed before its FMU is unloaded.
 */
#ifndef TL_TESTS_BENCH_BENCH_TWIN_H
#define TL_TESTS_BENCH_BENCH_TWIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/twin/twin.h"
#include "tests/bench/bench_floor.h"

typedef struct bench_setup {
    const tl_fmu *fmu;
    size_t count;         /* of FMUs */
    const char *solver;   /* NULL: free */
    uint32_t evaluations; /* budget of a step */
    bool saving;          /* by structure and by sequences */
    bool live;            /* the budget has a clock, as in the cycle, and time enough */
} bench_setup;

typedef struct bench_twin {
    bool locked;
    bool live;
    size_t count;
    tl_twin *twin;
    tl_sample sample; /* of the next tick */
    tl_budget budget;
    bench_chain plant; /* under the excitation */
    double *signal;    /* what the twin is given at the ticks to come */
    int64_t capacity;
    double output; /* of the plant at the last of these ticks */
} bench_twin;

/* false: the master has no such solver. Any other problem ends the program. */
bool bench_twin_open(bench_twin *twin, const bench_setup *setup);
void bench_twin_close(bench_twin *twin);

/* Lets the plant run so many ticks ahead; what it gives is for the next run, which must be as long. */
void bench_twin_prepare(bench_twin *twin, int64_t ticks);

/* So many ticks. `evaluations`: those of each, or NULL. */
void bench_twin_run(bench_twin *twin, int64_t ticks, uint32_t *evaluations);

/* Ends the program unless the last output of a free twin is the plant's to the bit. */
void bench_twin_check(const bench_twin *twin);

/* fmi2DoStep calls of all its FMUs so far. */
uint64_t bench_twin_executions(const bench_twin *twin);

#endif
