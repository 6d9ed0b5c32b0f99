/* Re-runs: what would the outputs be if something in the plant or in the model had changed?
 *
 * Purpose: a twin is marked between two ticks, and continues as before. After some more ticks, it
 *          executes the steps since the mark again, without corrections and with one change. The
 *          outputs then show whether this change explains what was measured.
 * Plant:   the caller keeps the values of the plant's signals, because a twin keeps only those of
 *          its horizon.
 * Not for: FMUs that are rolled back by replay, `keep` outputs, and event horizons.
 * Thread:  the twin's.
 */
#ifndef TL_MASTER_TWIN_TWIN_RERUN_H
#define TL_MASTER_TWIN_TWIN_RERUN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"
#include "master/twin/twin.h"

typedef enum tl_rerun_kind {
    TL_RERUN_ADJUSTED, /* an adjusted variable: the change applies to its nominal value */
    TL_RERUN_INPUT,    /* a Real input that a signal of the plant feeds */
    TL_RERUN_PARAMETER /* a tunable Real parameter; a fixed one can only be set before the start */
} tl_rerun_kind;

/* What a re-run can change. Texts live as long as the twin. */
typedef struct tl_rerun_target {
    tl_rerun_kind kind;
    size_t component;
    const char *component_name;
    const tl_variable *variable;
    const char *unit; /* "": none */
    double value;     /* now */
    size_t index;     /* private */
} tl_rerun_target;

/* Returns target `number`; false if there are not so many. All components must have started. */
bool tl_rerun_target_get(tl_twin *twin, size_t number, tl_rerun_target *target);

/* Marks the present instant for re-runs, in place of an earlier mark. The plan must have
 * `may_rerun`. Errors: TL_BAD_DATA if the twin cannot be rolled back to it; TL_FMU_FAILED,
 * TL_FMU_FATAL. */
tl_status tl_twin_mark(tl_twin *twin, tl_error *error);

/* The first step after the mark. */
int64_t tl_twin_marked_step(const tl_twin *twin);

/* Copies the plant's values of the newest tick, one per signal, bad ones replaced, to `values`. */
void tl_twin_get_plant(const tl_twin *twin, double *values);

/* A re-run: u, an input or a parameter is value · factor + offset from step `from` on. */
typedef struct tl_rerun {
    const tl_rerun_target *target; /* NULL: no change */
    double factor, offset;
    int64_t from;
    size_t steps;        /* number of steps from the mark */
    const double *plant; /* values of ticks first_tick … first_tick + ticks − 1; later ones are as the last */
    int64_t first_tick;  /* at most the first step + 1, plus the shift of inputs */
    size_t ticks;
} tl_rerun;

/* Executes the steps. `y`: of each step the outputs of all matches, in this order. Afterwards the
 * twin can only run again or be destroyed.
 * Errors: TL_FMU_FAILED: this re-run failed, and another one may succeed. TL_FMU_FATAL. */
tl_status tl_twin_rerun(tl_twin *twin, const tl_rerun *rerun, double *y, tl_error *error);

#endif
