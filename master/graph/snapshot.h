/* Snapshot of all FMUs at one instant, and the memory for their states.
 *
 * Thread:  the one that steps the twin.
 */
#ifndef TL_MASTER_GRAPH_SNAPSHOT_H
#define TL_MASTER_GRAPH_SNAPSHOT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/fmi/component.h"

/* ---- Number of states of each FMU within a memory bound.
 *
 * Purpose: a state of an FMU has between some hundred bytes and many megabytes. Each component gets
 *          an equal share of the bound, in bytes. A component that needs less leaves the rest of
 *          its share to the others.
 * Thread:  plain data.
 */

/* Fewest states of a component: one at the committed instant and one within a candidate. */
enum { TL_STATES_LEAST = 2 };

/* One component. */
typedef struct tl_state_room {
    size_t size;   /* bytes of one state; 0: not known, and not counted */
    uint32_t most; /* maximum number of states needed at once, ≥ TL_STATES_LEAST */
    uint32_t kept; /* result: states that fit, TL_STATES_LEAST … most */
} tl_state_room;

/* Computes `kept` of all. `bytes`: bound for all together; 0: no bound. */
void tl_state_room_share(tl_state_room *rooms, size_t count, uint64_t bytes);

/* Bytes of all kept states. */
uint64_t tl_state_room_bytes(const tl_state_room *rooms, size_t count);

/* ---- Snapshot of the co-simulation: the hidden state of every FMU and all port values.
 *
 * Purpose: the data of a rollback. There may be any number of snapshots; each reuses its own state
 *          handles.
 * Errors:  TL_FMU_FAILED or TL_FMU_FATAL from the first FMU that failed. Those after it were not
 *          called, and the components are at different instants.
 * Thread:  the twin's. Memory: the arena, at start-up; states: fmi/component.h.
 */

typedef struct tl_snapshot {
    tl_component *components;
    size_t component_count;
    unsigned char *live; /* the present port values, owned by the exchange */
    size_t values_size;
    unsigned char *values; /* the saved port values */
    fmi2FMUstate *states;  /* one per component; NULL: none yet */
} tl_snapshot;

/* Initialises an empty snapshot of these components and values. Returns false if memory is out. */
bool tl_snapshot_init(tl_snapshot *snapshot, tl_arena *arena, tl_component *components, size_t component_count,
                      unsigned char *live, size_t values_size);

/* take() saves the present instant and replaces the earlier one. restore() restores it, any number
 * of times. */
tl_status tl_snapshot_take(tl_snapshot *snapshot, tl_error *error);
tl_status tl_snapshot_restore(const tl_snapshot *snapshot, tl_error *error);

/* Saves the snapshot to an archive, or loads it: the serialised state of each FMU, then all values.
 * After loading, call tl_snapshot_restore(). Every component must be able to serialise its state.
 * Errors: TL_BAD_DATA if the bytes end too soon. */
tl_status tl_snapshot_archive(tl_snapshot *snapshot, tl_archive *archive, tl_error *error);

/* Frees one component's state, before the component is freed. */
void tl_snapshot_forget(tl_snapshot *snapshot, size_t component);

#endif
