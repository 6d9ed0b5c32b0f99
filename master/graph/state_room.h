/* How many states of each FMU may be kept, so that all of them stay within a bound.
 *
 * Purpose: a state may be a hundred bytes or ten megabytes, and only the FMU knows. The bound is shared out by the bytes: who needs less
 *          than an equal share gets what it needs, and the others share what that leaves.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_GRAPH_STATE_ROOM_H
#define TL_MASTER_GRAPH_STATE_ROOM_H

#include <stddef.h>
#include <stdint.h>

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

#endif
