/* Side twin: the same co-simulation beside the twin, with nominal or approved u.
 *
 * Purpose: free_twin.h and released_twin.h compare the twin with twins that are not corrected.
 *          These have no FMUs of their own: the FMUs are set to a saved state, execute the step
 *          that the twin has just committed, and the new state is saved.
 * Use:     tl_exchange_take() first, then tl_side_twin_step() and tl_snapshot_take() for each saved
 *          state, then tl_exchange_return(). No count of the twin includes these executions.
 * Not for: FMUs that are rolled back by replay. Each rollback would repeat the whole run.
 * Thread:  the twin's. Memory: the arena, at start-up; states: fmi/component.h.
 */
#ifndef TL_MASTER_SYNC_SIDE_TWIN_H
#define TL_MASTER_SYNC_SIDE_TWIN_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/graph/exchange.h"
#include "master/graph/snapshot.h"
#include "master/sync/synchroniser_state.h"

/* Fields are private, except `count`. */
typedef struct tl_side_twin {
    tl_exchange *exchange;
    size_t variables;            /* number of adjusted variables */
    const tl_adjusted *adjusted; /* NULL: u is nominal */
    uint64_t *executions;        /* of each component: its count, saved during executions that do not count */
    uint64_t count;              /* executions of FMUs and of the plant */
} tl_side_twin;

/* `adjusted`: u is nominal plus the approved correction, within the bounds; must outlive the twin.
 * NULL: u is nominal. Returns false if memory is out. */
bool tl_side_twin_init(tl_side_twin *twin, tl_arena *arena, tl_exchange *exchange, size_t variables,
                       const tl_adjusted *adjusted);

/* Initialises a snapshot of the exchange. Returns false if memory is out. */
bool tl_side_twin_init_state(tl_snapshot *state, tl_arena *arena, const tl_exchange *exchange);

/* After the initialisation of the FMUs: false if one of them is rolled back by replay. */
bool tl_side_twin_is_possible(const tl_exchange *exchange);

/* Restores `state` and executes macro step `step` with nominal or approved u (see `adjusted`). Then
 * the ports have the values at the end of the step. Errors: TL_FMU_FAILED or TL_FMU_FATAL. */
tl_status tl_side_twin_step(tl_side_twin *twin, const tl_snapshot *state, int64_t step, tl_error *error);

#endif
