/* Released twins: what the model does if the twin is no longer corrected.
 *
 * Purpose: in lock, y agrees with ŷ even if the model is wrong, because u is corrected until it
 *          does. A released twin starts from the state of the locked twin and then runs with
 *          nominal u, plus the approved correction, within the bounds. Its error shows how far the
 *          model without other corrections is from the plant. It also shows whether the states
 *          without a sensor were right at the release.
 * Method:  a release lasts R steps. Two released twins take turns, R/2 steps apart. So after the
 *          first R/2 steps one of them is at least R/2 old. Its outputs are recorded. R should be
 *          longer than the longest reaction of an output. Then the measurements from before the
 *          release no longer matter.
 * Lag:     in mode lag the released state depends on measurements up to T_P steps after it.
 * Failure: if an FMU of a released twin fails, this released twin is missing until its next
 *          release. Only fmi2Fatal ends the twin.
 * Other:   the free-running twin of free_twin.h stays uncorrected as long as it predicts well, and
 *          decides whether u rests. A released twin affects the twin only by a measured delay
 *          (tl_plan_measure).
 * Source:  not the dissertation.
 * Thread:  the twin's. Memory: the arena, at start-up; states: fmi/component.h.
 */
#ifndef TL_MASTER_SYNC_RELEASED_TWIN_H
#define TL_MASTER_SYNC_RELEASED_TWIN_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/graph/exchange.h"
#include "master/graph/snapshot.h"
#include "master/sync/objective.h"
#include "master/sync/record.h"
#include "master/sync/side_twin.h"

/* One of the two. */
typedef struct tl_release {
    tl_snapshot state;
    uint32_t age; /* steps since the release, 0 … R */
    bool runs;    /* `state` and `age` are valid */
} tl_release;

/* Fields are private, except `state` and `counts`. */
typedef struct tl_released_twin {
    tl_side_twin side;
    const tl_objective *objective;
    uint32_t steps; /* R, even */
    uint32_t phase; /* committed steps since the start, modulo R */
    tl_released_state state;
    tl_release release[2];
    tl_released_counts counts;
    uint32_t timed;    /* measured calls of tl_released_twin_follow(), at most TL_RELEASED_TIMED */
    tl_time fastest;   /* ns: shortest time that such a call took for both twins */
    int64_t last_step; /* after this step both end as TL_RELEASED_SLOW (tl_released_twin_end_after()); −1: none */
} tl_released_twin;

/* Number of measured calls. The fastest one decides whether there is time for released twins. */
enum { TL_RELEASED_TIMED = 8 };

/* For an exchange that is initialised. `adjusted` must outlive the twin. `steps`: R, ≥ 2, an odd
 * one is rounded up; 0: no released twins. `state`: TL_RELEASED_ON, or the reason why there are
 * none. Returns false if memory is out. */
bool tl_released_twin_init(tl_released_twin *twin, tl_arena *arena, tl_exchange *exchange,
                           const tl_objective *objective, const tl_adjusted *adjusted, uint32_t steps,
                           tl_released_state state);

/* Releases the first twin at the committed instant. Also call it after a reset of the FMUs, or if
 * their states have become invalid. */
tl_status tl_released_twin_begin(tl_released_twin *twin, tl_error *error);

/* Call after each committed step with its complete record: executes the step for both twins, fills
 * `released` and `release_age` of the record, and releases a twin if it is its turn. Afterwards the
 * FMUs are in their state from before the call. `now`: clock of the step, ns; NULL if the tick
 * is a replayed or an unrecorded one.
 * With a clock, released twins end for good if they take more than a tenth of T_S; this record then
 * has TL_FLAG_RELEASED_SLOW.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if a rollback fails. */
tl_status tl_released_twin_follow(tl_released_twin *twin, tl_record *record, tl_time (*now)(void *context),
                                  void *context, tl_error *error);

/* Repeats TL_FLAG_RELEASED_SLOW of a recorded step in a replay: both end for good after it. */
void tl_released_twin_end_after(tl_released_twin *twin, int64_t step);

/* Ends both until their next turn. Call it after a change of an approved correction, because both
 * have run without it. */
void tl_released_twin_end(tl_released_twin *twin);

/* Frees a component's states. Call it before the component is freed, or if its states have become
 * invalid. tl_released_twin_begin() creates new ones. */
void tl_released_twin_end_component(tl_released_twin *twin, size_t component);

#endif
