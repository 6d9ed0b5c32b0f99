/* Re-runs: what would the outputs be if something in the plant or in the model had changed?
 *
 * Purpose: a twin is marked between two ticks, and continues as before. After some more ticks, it
 *          executes the steps since the mark again, without corrections and with one change. The
 *          outputs then show whether this change explains what was measured.
 * Plant:   the caller keeps the values of the plant's signals, because a twin keeps only those of
 *          its horizon.
 * Not for: twins with an event horizon, with an FMU that is rolled back by replay, or with a
 *          component whose cache keeps only outputs (TL_KEEP_OUTPUTS).
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
    TL_RERUN_ADJUSTED, /* an adjusted variable: its u is the changed nominal value û */
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
    double value;     /* û, input or parameter, at the time of tl_rerun_target_get() */
    size_t index;     /* private */
} tl_rerun_target;

/* Returns target `number`; false if there are not so many. All components must have started. */
bool tl_rerun_target_get(tl_twin *twin, size_t number, tl_rerun_target *target);

/* Marks the present instant for re-runs, in place of an earlier mark. The twin's tl_plan must have
 * `may_rerun`. Errors: TL_BAD_DATA if the twin cannot be rolled back to it; TL_FMU_FAILED,
 * TL_FMU_FATAL. */
tl_status tl_twin_mark(tl_twin *twin, tl_error *error);

/* Returns the number of the first step after the mark. */
int64_t tl_twin_marked_step(const tl_twin *twin);

/* Copies the plant's values of the newest tick to `values`, one per signal. A bad value is replaced
 * by the last good one. */
void tl_twin_get_plant(const tl_twin *twin, double *values);

/* A re-run: from step `from` on, the target is x · factor + offset. x is û or the input of the same
 * step; for a parameter, target->value. */
typedef struct tl_rerun {
    const tl_rerun_target *target; /* NULL: no change */
    double factor, offset;
    int64_t from;
    size_t steps;        /* number of steps from the mark */
    const double *plant; /* values of `ticks` ticks, from `first_tick` on; later ticks repeat the last ones */
    int64_t first_tick;  /* at most tl_twin_marked_step() + 1 + the shift of the plant (plant.h) */
    size_t ticks;
} tl_rerun;

/* Restores the mark and executes the steps. Fills `y` with all matched outputs of the first step,
 * then of the next ones. Afterwards the twin must not step: re-run it again, or destroy it.
 * Errors: TL_FMU_FAILED: this re-run failed, and another one may succeed. TL_FMU_FATAL. */
tl_status tl_twin_rerun(tl_twin *twin, const tl_rerun *rerun, double *y, tl_error *error);

#endif
