/* The free twin: the same co-simulation, left alone beside the locked one, and what its predictions say of the lock.
 *
 * Purpose: a lock must do no harm over time. So what it makes of the measurements is held against a twin that never sees them (contest.h). Where that one predicts
 *          better, u rests at nominal; and the twin goes on from the free twin's state if that is the better one.
 * Method:  in the FMUs of the twin itself: after each committed step they are led to the free twin's state and back, and while u does not rest to a
 *          prediction's as well. Each of the two executes all components once a step, with nominal u; nothing of it is in any other count.
 * States:  three of each FMU: the free twin's, the prediction's, and where the twin is meanwhile.
 * Not:     for FMUs that are led back by replay: each way there and back would be all of the run again.
 * Thread:  the twin's. Memory: the arena, at start-up; states are the FMUs' own.
 */
#ifndef TL_MASTER_SYNC_FREE_TWIN_H
#define TL_MASTER_SYNC_FREE_TWIN_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/graph/exchange.h"
#include "master/graph/snapshot.h"
#include "master/sync/contest.h"
#include "master/sync/objective.h"
#include "master/sync/record.h"

/* Fields are private, but `counts`. Zeroed: there is none. */
typedef struct tl_free_twin {
    tl_exchange *exchange;
    const tl_objective *objective;
    bool is_led;
    bool predicts; /* `predicted` is where a prediction is; else it is to begin */
    tl_snapshot free;
    tl_snapshot predicted;
    tl_contest contest;
    uint64_t *executions; /* of each component, while steps that do not count are made */
    tl_free_twin_counts counts;
} tl_free_twin;

/* For an exchange whose values are placed. `guard`: steps until a prediction has outrun what its beginning has used; 0: there shall be no free twin. False when
 * memory is out. */
bool tl_free_twin_init(tl_free_twin *twin, tl_arena *arena, tl_exchange *exchange, const tl_objective *objective,
                       uint32_t guard);

/* The FMUs stand at the committed instant, where both begin, and u does not rest. Also later, if the FMUs have begun anew, or their states are worth nothing any
 * more. */
tl_status tl_free_twin_begin(tl_free_twin *twin, tl_error *error);

/* `record` is complete, and the FMUs are left where they are after its step: or, with `adopt` in the verdict, where the free twin is, and its values are in all ports;
 * then the caches begin anew. Errors: TL_FMU_FAILED, TL_FMU_FATAL if they cannot be led back. */
tl_status tl_free_twin_follow(tl_free_twin *twin, const tl_record *record, tl_contest_verdict *verdict,
                              tl_error *error);

/* Whether u rests from the next step on. */
bool tl_free_twin_rests(const tl_free_twin *twin);

/* What was seen of a lock with other tolerances or bounds says nothing; u does not rest. */
void tl_free_twin_retune(tl_free_twin *twin);

/* What it knows, and both states. When loading, the FMUs are not called but to make states of the bytes. */
tl_status tl_free_twin_archive(tl_free_twin *twin, tl_archive *archive, tl_error *error);

/* Gives a component's states back, before it is freed, or if they are worth nothing any more. tl_free_twin_begin() makes others. */
void tl_free_twin_end_component(tl_free_twin *twin, size_t component);

#endif
