/* Benchmark of a twin with the chain of bench_floor.h, through master/twin/twin.h only: free, or
 * locked to a plant.
 *
 * Purpose: measures the numerator of each ratio.
 * Plant:   a second chain (bench_chain), driven by the excitation. A free twin gets the excitation
 *          as its input; a locked twin gets the plant's last output as measured value.
 * Locked:  the first input is adjusted, and the last output is matched. T_P = T_D. The tolerance is
 *          so small that no candidate is within it. So a search ends when its budget is used, or
 *          when its solver stops.
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
    size_t count;         /* of components */
    const char *solver;   /* NULL: the twin is free */
    uint32_t evaluations; /* budget of a step */
    bool saving;          /* reuse executions, by structure and by sequences */
    bool live;            /* the budget has a clock, as in the cycle, and enough time */
} bench_setup;

typedef struct bench_twin {
    bool locked;
    bool live;
    size_t count;
    tl_twin *twin;
    tl_sample sample; /* of the next tick */
    tl_budget budget;
    bench_chain plant; /* driven by the excitation */
    double *signal;    /* values of the plant's signal at the prepared ticks */
    int64_t capacity;  /* of `signal` */
    double output;     /* of the plant at the last prepared tick */
} bench_twin;

/* Builds the twin. Returns false if the master has no such solver. Any other problem ends the
 * program. */
bool bench_twin_open(bench_twin *twin, const bench_setup *setup);
void bench_twin_close(bench_twin *twin);

/* Computes so many ticks of the plant, for the next bench_twin_run(), which must have the same
 * number of ticks. */
void bench_twin_prepare(bench_twin *twin, int64_t ticks);

/* Executes so many ticks. `evaluations` gets the number of evaluations of each tick; or NULL. */
void bench_twin_run(bench_twin *twin, int64_t ticks, uint32_t *evaluations);

/* Ends the program unless the last output of a free twin equals that of the plant, bit by bit. */
void bench_twin_check(const bench_twin *twin);

/* Returns the number of fmi2DoStep calls of all its components so far. */
uint64_t bench_twin_executions(const bench_twin *twin);

#endif
