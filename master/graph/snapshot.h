/* States of all FMUs at one time, and how many have room in memory.
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

/* ---- How many states of each FMU may be kept, so that all of them stay within a bound.
 *
 * Purpose: a state may be a hundred bytes or ten megabytes, and only the FMU knows. The bound is shared out by the bytes: who needs less
 *          than an equal share gets what it needs, and the others share what that leaves.
 * Thread:  plain data.
 */

/* The fewest that a component can do with: one for the committed instant, and one on the way. */
enum { TL_STATES_LEAST = 2 };

/* One component. */
typedef struct tl_state_room {
    size_t size;   /* bytes of one state; 0: not known, and not counted */
    uint32_t most; /* states that it could need at once, ≥ TL_STATES_LEAST */
    uint32_t kept; /* states that there is room for, TL_STATES_LEAST … most */
} tl_state_room;

/* Fills `kept` of all. `bytes` is the bound for all together; 0: there is none. */
void tl_state_room_share(tl_state_room *rooms, size_t count, uint64_t bytes);

/* Bytes of all that are kept. */
uint64_t tl_state_room_bytes(const tl_state_room *rooms, size_t count);

/* ---- The co-simulation as it stands at one instant, to come back to: the hidden state of every FMU, and all port values.
 *
 * Purpose: what a rollback needs. There may be any number of them at a time; each keeps its own state handles and uses them
 *          again.
 * Errors:  TL_FMU_FAILED or TL_FMU_FATAL as the first FMU answered that was not well; those after it were not called, and the
 *          components are in different places then.
 * Thread:  the twin's. Memory: the arena, at start-up; the states are the FMUs' own.
 */

typedef struct tl_snapshot {
    tl_component *components;
    size_t component_count;
    unsigned char *live; /* where the port values of the running co-simulation are */
    size_t values_size;
    unsigned char *values;
    fmi2FMUstate *states; /* one per component; NULL: none yet */
} tl_snapshot;

/* Empty, of these components and values. False when memory is out. */
bool tl_snapshot_init(tl_snapshot *snapshot, tl_arena *arena, tl_component *components, size_t component_count,
                      unsigned char *live, size_t values_size);

/* Keeps the present instant in place of what was kept before; and leads back to what is kept, as often as wanted. */
tl_status tl_snapshot_take(tl_snapshot *snapshot, tl_error *error);
tl_status tl_snapshot_restore(const tl_snapshot *snapshot, tl_error *error);

/* What is kept, as bytes: of each FMU its own, then all values. Loading fills the snapshot; tl_snapshot_restore() then leads there.
 * TL_BAD_DATA where the bytes end too soon. Every component must be able to serialise. */
tl_status tl_snapshot_archive(tl_snapshot *snapshot, tl_archive *archive, tl_error *error);

/* Gives one component's state back to its FMU, before the component is freed. */
void tl_snapshot_forget(tl_snapshot *snapshot, size_t component);

#endif
