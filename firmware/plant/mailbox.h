/* A mailbox: the newest readings of one signal, from one writer to readers, wait-free.
 *
 * Purpose: plant I/O posts, the cycle looks up; neither ever waits for the other. The newest `depth` readings are kept, so that a sample can
 *          be looked up at its own instant after a missed tick, or by a twin that was started again.
 * Memory:  of the owner, zeroed at first: of this process, or a block (block.h) that only the writer's process writes. It has no pointers;
 *          the handle is each side's own. Who only reads may map it read-only.
 * Death:   the memory may outlive its writer. A successor mends it and goes on in it; readers notice nothing.
 * Thread:  one writer at a time; any number of readers.
 * Trust:   a reader believes nothing of the memory. Whatever is in it, and changes while it is read, a look-up ends, reads nothing
 *          else, and gives a quality that exists. Value and stamp may be any.
 * Bound:   post O(1); look-up O(log depth), for the far past as for the newest.
 */
#ifndef TL_FIRMWARE_PLANT_MAILBOX_H
#define TL_FIRMWARE_PLANT_MAILBOX_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/signal.h"

/* Its fields are private. */
typedef struct tl_mailbox_slot {
    uint64_t sequence; /* odd while the slot is written */
    uint64_t value;    /* bits of the double */
    int64_t stamp;
    uint64_t quality;
} tl_mailbox_slot;

/* A handle on one. */
typedef struct tl_mailbox {
    tl_mailbox_slot *slots; /* `depth` of them */
    uint64_t *count;        /* readings posted so far */
    uint32_t depth;         /* a power of two */
} tl_mailbox;

/* Writer. Stamps should not decrease. One that does is looked up in order of posting while it is among the newest few; later an instant
 * near it may give a reading near it. */
void tl_mailbox_post(const tl_mailbox *mailbox, const tl_reading *reading);

/* A writer's successor, before its first post: what the dead one had posted stands, what it had not is as if it had never begun. */
void tl_mailbox_mend(const tl_mailbox *mailbox);

/* Reader, from ≤ until: of the readings with stamp ≤ until the first with stamp ≥ from, of equal ones the last; if there is none, the newest
 * before; else as below. */
bool tl_mailbox_from(const tl_mailbox *mailbox, tl_time from, tl_time until, tl_reading *reading);

/* Reader, at ≤ until: the newest reading with stamp ≤ `at`, and the one behind it where its stamp is ≤ `until`; else *after has the stamp
 * TL_TIME_NEVER. False if there is none at or before `at`, or it is not kept any more; both are then as they were. */
bool tl_mailbox_around(const tl_mailbox *mailbox, tl_time at, tl_time until, tl_reading *before, tl_reading *after);

/* Reader of each reading in turn: post *next or, where it has a stamp > until or is not kept any more, the first of the few behind it that is, and has not; *next is
 * then the one behind that. 0 at first. False if there is none; *reading is then as it was. */
bool tl_mailbox_next(const tl_mailbox *mailbox, tl_time until, uint64_t *next, tl_reading *reading);

/* Reader: the newest reading with stamp ≤ instant; the oldest kept one if all are later than `instant` and
 * something had to be forgotten. False if there is none; *reading is then as it was. */
bool tl_mailbox_at(const tl_mailbox *mailbox, tl_time instant, tl_reading *reading);

#endif
