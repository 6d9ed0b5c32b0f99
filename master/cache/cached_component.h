/* Cached component: executes only those steps of a component that its sequence cache does not
 *                   contain.
 *
 * Purpose: stands between the exchange and an FMU. A candidate walks down the tree from the root,
 *          the committed state at t_i. If its next input is in the tree, the stored outputs are
 *          delivered and the FMU is not called. Otherwise the FMU is restored to the candidate's
 *          position, executed, and the result stored. The committed step moves the root one node
 *          down, so the next horizon reuses the results of this one.
 * States:  the FMU's state is saved as late as possible, when the FMU leaves a node. It is restored
 *          only to execute from another node (table 4.1, right column). TL_KEEP_OUTPUTS saves
 *          states only every `spacing` steps; from there the FMU catches up (left column).
 * Final:   a final step tells the FMU that no earlier state will be restored, so that the FMU can
 *          drop its buffers. A step is final only if it starts at the root, or at a node above it,
 *          and if this node has a saved state. This state itself may still be restored. No step is
 *          final while the owner keeps an earlier state (`is_kept_from`).
 * None:    TL_KEEP_NONE stores only the committed step and saves only the state at the root. Each
 *          candidate restores it and executes all its steps.
 * Full:    if the pool is full, a result is used and counted, but not stored.
 * Room:    if fewer state handles than nodes are allowed (`states`), some nodes have no state. The
 *          FMU then catches up from a node above, as with TL_KEEP_OUTPUTS. One handle is reserved
 *          for the committed instant, which must have a state.
 * Failure: after a failed step the FMU is at no node; the next execution starts with a restore.
 * Thread:  the twin's. Memory: the arena, at start-up. State handles: at most one per node and
 *          never more than `states`; owner: fmi/component.h. With TL_KEEP_STATES
 *          the usual number, at most 256, is created at start-up; others are created when needed,
 *          and kept. With TL_KEEP_NONE one is created.
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
    tl_time size;         /* T_S */
    tl_keep keep;         /* TL_KEEP_AUTO until the owner replaces it, before the start */
    uint32_t spacing;     /* TL_KEEP_OUTPUTS: steps between saved states, ≥ 1 */
    uint32_t root;        /* the committed instant t_i */
    uint32_t position;    /* node of the candidate; TL_NO_NODE: not stored, because of TL_KEEP_NONE or a full pool */
    uint32_t at;          /* node of the FMU; TL_NO_NODE: a step failed or was not stored, or the node was dropped */
    unsigned char *key;   /* scratch: inputs of the current step */
    unsigned char *value; /* scratch: its outputs */
    bool commits;         /* the next step will be committed */
    bool is_kept_from;    /* the owner keeps a state that is older than the root, and will restore it */
    uint32_t states;      /* largest number of state handles, ≥ 2 */
    uint32_t made;        /* state handles created */
    uint64_t repeated;    /* executions repeated to bring the FMU to a node */
    uint64_t uncached;    /* executions whose result was not stored */
} tl_cached_component;

/* Nodes with TL_KEEP_NONE: the committed step needs two, tl_cached_component_measure() three. */
enum { TL_NODES_OF_NONE = 3 };

/* For a component whose ports are placed. `capacity` in nodes, ≥ 2·spacing + 2; with TL_KEEP_NONE
 * TL_NODES_OF_NONE. Returns false if memory is out. */
bool tl_cached_component_init(tl_cached_component *cached, tl_arena *arena, tl_component *component, tl_keep keep,
                              tl_time size, uint32_t spacing, uint32_t capacity);

/* Measures the size of one state in bytes, for an initialised FMU: the result of
 * tl_component_state_size(). If that is 0, it is the larger of the serialised size and the growth
 * of the heap per state. 0: unknown. `heap`: returns the bytes allocated in this process; NULL:
 * unknown. */
tl_status tl_cached_component_measure(tl_cached_component *cached, size_t (*heap)(void), size_t *size, tl_error *error);

/* Sets the largest number of state handles. Call it before the start. */
void tl_cached_component_limit(tl_cached_component *cached, uint32_t states);

/* Creates the root and the first state handles. The FMU must be initialised at t_0. */
tl_status tl_cached_component_start(tl_cached_component *cached, tl_error *error);

/* Drops all results and starts a new tree. Call it after the FMU was reset and initialised at the
 * new t_i. Handles stay; those that tl_cached_component_end() has freed are created again. */
tl_status tl_cached_component_reset(tl_cached_component *cached, tl_error *error);

/* Moves the candidate to the root. */
void tl_cached_component_rewind(tl_cached_component *cached);

/* stand() brings the FMU into the state of the root, at the start of macro step `step`. can_stand()
 * is true if this needs no execution. Otherwise the root has no saved state, and the FMU catches up
 * from a node above. */
bool tl_cached_component_can_stand(const tl_cached_component *cached);
tl_status tl_cached_component_stand(tl_cached_component *cached, int64_t step, tl_error *error);

/* Between steps: saves the FMU's state at the root to a handle of the caller; the FMU stays where
 *                it is. *taken is false if the root has no saved state and the FMU is not there
 *                (TL_KEEP_OUTPUTS), or if the FMU has failed. `full_copy`: a second handle of the
 *                caller; if the FMU is not at the root, it saves the present state meanwhile. */
tl_status tl_cached_component_copy_root(tl_cached_component *cached, fmi2FMUstate *state, fmi2FMUstate *full_copy,
                                        bool *taken, tl_error *error);

/* Executes or looks up macro step `step` of the candidate, with the inputs in the ports; then the
 * outputs are in the ports. */
tl_status tl_cached_component_step(tl_cached_component *cached, int64_t step, tl_error *error);

/* Before the step that will be committed, macro step `step`, with its inputs in the ports and the
 * candidate at the root: if no state could be stored for `spacing` steps, moves the FMU to the
 * root, so that nodes above it can be dropped. */
tl_status tl_cached_component_gather(tl_cached_component *cached, int64_t step, tl_error *error);

/* Before the step that will be committed, with its inputs in the ports: drops all other candidates
 * if the pool is full and the step is not in the tree. The next step is stored in any case. */
void tl_cached_component_make_room(tl_cached_component *cached);

/* Commits the candidate, one step below the root: it becomes the root, and all other branches are
 * dropped. */
void tl_cached_component_commit(tl_cached_component *cached);

/* Frees the state handles. The component must still exist. */
void tl_cached_component_end(tl_cached_component *cached);

#endif
