/* One component behind its sequence cache: executes only what is not known yet.
 *
 * Purpose: stands between the exchange and an FMU. A candidate walks from the root (the committed state at t_i) down the
 *          tree. Where its next input is known, the stored outputs are delivered and the FMU is not touched; where it is
 *          not, the FMU is brought to the candidate's place, executed, and the result stored. The committed step moves
 *          the root one node down, so that the next horizon finds what this one has left.
 * States:  the FMU's state is saved at the last moment, when the FMU leaves a node, and loaded only when it must be
 *          executed from somewhere else (table 4.1, right column).
 *          TL_KEEP_OUTPUTS saves states only every `spacing` steps; from there the FMU catches up (left column).
 * Final:   a step from the newest saved state that all candidates pass (the root's, where states are kept) tells the FMU that
 *          no earlier one comes back, so that it can give up what it has buffered; the state itself may come back.
 *          While each horizon finds its first steps known from the one before, there is no such step; nor while somebody else keeps an
 *          earlier state of the FMU (`is_kept_from`).
 * Full:    a result for which the pool has no room is used and not stored, and counted.
 * Room:    where not all nodes may have a state (`states`), those that find no room go without one, and the FMU catches up from the one
 *          above, as with TL_KEEP_OUTPUTS. One handle is held back for the committed instant, which must have one.
 * Failure: a failed step leaves the FMU nowhere; the next execution begins with loading a state.
 * Thread:  the twin's. Memory: the arena, at start-up; state handles belong to the FMU, at most one for
 *          each node, and never more than `states`. With TL_KEEP_STATES as many as are mostly used are made at start-up too, up to
 *          256; all others as they are needed, and then kept.
 */
#ifndef TL_MASTER_CACHE_CACHED_COMPONENT_H
#define TL_MASTER_CACHE_CACHED_COMPONENT_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/cache/sequence_cache.h"
#include "master/fmi/component.h"
#include "master/plan/plan.h"

typedef struct tl_cached_component {
    tl_component *component;
    tl_sequence_cache tree;
    tl_time size; /* T_S */
    tl_keep keep;
    uint32_t spacing;     /* TL_KEEP_OUTPUTS: steps between saved states, ≥ 1 */
    uint32_t root;        /* t_i as committed */
    uint32_t position;    /* of the candidate; TL_NO_NODE: beyond what the pool could keep */
    uint32_t at;          /* where the FMU is; TL_NO_NODE: nowhere, or with the candidate beyond the pool */
    unsigned char *key;   /* scratch: inputs of the step at hand, */
    unsigned char *value; /* and outputs */
    bool is_kept_from;    /* somebody keeps a state that is older than the root, and will come back to it */
    uint32_t states;      /* handles that there may be, ≥ 2 */
    uint32_t made;        /* handles that there are */
    uint64_t caught_up;   /* executions repeated to bring the FMU to a place */
    uint64_t unstored;    /* executions whose result found no room */
} tl_cached_component;

/* For a component whose ports are placed. `capacity` in nodes, ≥ 2·spacing + 2; false when memory is out. */
bool tl_cached_component_init(tl_cached_component *cached, tl_arena *arena, tl_component *component, tl_keep keep,
                              tl_time size, uint32_t spacing, uint32_t capacity);

/* The FMU stands initialised: bytes that one state of it takes, by what it says and by what its heap grows by when some are made; 0 where
 * neither is to be had. `heap`: bytes that are allocated in this process; NULL: nobody knows. */
tl_status tl_cached_component_measure(tl_cached_component *cached, size_t (*heap)(void), size_t *size, tl_error *error);

/* From here on there may be so many handles. Before the start. */
void tl_cached_component_limit(tl_cached_component *cached, uint32_t states);

/* The FMU stands initialised at t_0: plants the root and makes the first state handles. */
tl_status tl_cached_component_start(tl_cached_component *cached, tl_error *error);

/* The FMU has begun anew, and stands initialised at what is t_i from now on: all that was known is given up, and the root is planted
 * there. Handles stay; what tl_cached_component_end() has freed of them is made again. */
tl_status tl_cached_component_begin_anew(tl_cached_component *cached, tl_error *error);

/* The candidate goes back to the root. */
void tl_cached_component_rewind(tl_cached_component *cached);

/* Brings the FMU itself to the root, which is before macro step `step`. Not can_stand: it has to catch up there, since no state of the root is kept. */
bool tl_cached_component_can_stand(const tl_cached_component *cached);
tl_status tl_cached_component_stand(tl_cached_component *cached, int64_t step, tl_error *error);

/* Between steps: the FMU's state at the root, to a handle of the caller's. The FMU stays where it is. False in *taken: nobody has that state (TL_KEEP_OUTPUTS),
 * or the FMU is nowhere. `aside` is a second handle of the caller's, for where the FMU is meanwhile. */
tl_status tl_cached_component_copy_root(tl_cached_component *cached, fmi2FMUstate *state, fmi2FMUstate *aside,
                                        bool *taken, tl_error *error);

/* One step of the candidate, macro step `step`, with the inputs in the ports; the outputs are in the ports afterwards. */
tl_status tl_cached_component_step(tl_cached_component *cached, int64_t step, tl_error *error);

/* Before the step that will be committed, macro step `step`, with its inputs in the ports and the candidate at the root: where no state
 * found room for `spacing` steps, the FMU is brought to the root, so that what is above it can be given up. */
tl_status tl_cached_component_gather(tl_cached_component *cached, int64_t step, tl_error *error);

/* Before the step that will be committed, with its inputs in the ports: if it is not known and the pool is full, all other
 * candidates are given up, so that it finds room. */
void tl_cached_component_make_room(tl_cached_component *cached);

/* The candidate, one step below the root, is committed: it becomes the root, and other beginnings are given up. */
void tl_cached_component_commit(tl_cached_component *cached);

/* Frees the state handles. The component must not have been freed. */
void tl_cached_component_end(tl_cached_component *cached);

#endif
