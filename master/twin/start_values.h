/* Start values that come from the plant: copied from a signal, or found in the first steps.
 *
 * Copied:  `set` names a signal of the plant. The variable gets its value in the sample that the
 *          FMUs are initialised with. If the signal is not good yet, the FMUs start with their own
 *          value, and start again when all these signals have been good.
 * Found:   the values of plan.find for which the FMUs, alone and with nominal u, agree best with
 *          the first plan.find_steps steps: least squares of the matched errors in tolerances, by
 *          the Levenberg–Marquardt method with differences. Then the twin continues from there.
 * When:    at the first step and after each reset. It depends on samples only, so a replay does the
 *          same.
 * Memory:  of the arena. Thread: the twin's. Code: twin_starts.c, declared in twin_parts.h.
 */
#ifndef TL_MASTER_TWIN_START_VALUES_H
#define TL_MASTER_TWIN_START_VALUES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/signal.h"
#include "master/fmi/component.h"
#include "master/fmi/units.h"

/* A start value that is copied. */
typedef struct tl_copied_start {
    tl_start_value *start;
    size_t signal;
    tl_conversion conversion;
    bool is_known; /* the signal has been good */
} tl_copied_start;

/* A start value that is found. */
typedef struct tl_found_start {
    tl_start_value *start;
    double guess; /* that the search begins with, unless a signal has the value */
    double lower, upper;
} tl_found_start;

typedef struct tl_start_values {
    tl_copied_start *copied;
    size_t copied_count;
    bool waits; /* a signal has not been good yet */
    tl_found_start found[TL_MAX_ADJUST];
    size_t found_count;
    size_t steps;     /* number of steps that are compared */
    size_t terms;     /* matched outputs with a weight */
    int64_t first;    /* the step at whose instant the FMUs were initialised */
    size_t kept;      /* steps in the buffers */
    bool searches;    /* steps are being kept */
    double *plant;    /* [step][signal]: what the plant delivers at t_first … t_(first + steps) */
    double *measured; /* [step][term]: ŷ at the end of each step; NaN: not good */
    double *best;     /* residuals: [step][term] */
    double *tried;
    double *slopes;       /* [variable][step][term] */
    uint64_t *executions; /* of each component before a search, whose executions no count includes */
} tl_start_values;

/* What is due before a step. */
typedef enum tl_start_due {
    TL_START_NOTHING,
    TL_START_AGAIN, /* the FMUs must be reset, because all signals are known now */
    TL_START_FIND   /* tl_start_values_find() is due */
} tl_start_due;

#endif
