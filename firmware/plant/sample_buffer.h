/* Sample buffers: the last samples of each signal, in memory that the reader of the plant writes and the cycle reads.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_PLANT_SAMPLE_BUFFER_H
#define TL_FIRMWARE_PLANT_SAMPLE_BUFFER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "master/base/signal.h"

/* ---- A mailbox: the newest readings of one signal, from one writer to readers, wait-free.
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

/* Its fields are private. */
typedef struct tl_sample_buffer_slot {
    uint64_t sequence; /* odd while the slot is written */
    uint64_t value;    /* bits of the double */
    int64_t stamp;
    uint64_t quality;
} tl_sample_buffer_slot;

/* A handle on one. */
typedef struct tl_sample_buffer {
    tl_sample_buffer_slot *slots; /* `depth` of them */
    uint64_t *count;              /* readings posted so far */
    uint32_t depth;               /* a power of two */
} tl_sample_buffer;

/* Writer. Stamps should not decrease. One that does is looked up in order of posting while it is among the newest few; later an instant
 * near it may give a reading near it. */
void tl_sample_buffer_post(const tl_sample_buffer *buffer, const tl_reading *reading);

/* A writer's successor, before its first post: what the dead one had posted stands, what it had not is as if it had never begun. */
void tl_sample_buffer_mend(const tl_sample_buffer *buffer);

/* Reader, from ≤ until: of the readings with stamp ≤ until the first with stamp ≥ from, of equal ones the last; if there is none, the newest
 * before; else as below. */
bool tl_sample_buffer_from(const tl_sample_buffer *buffer, tl_time from, tl_time until, tl_reading *reading);

/* Reader, at ≤ until: the newest reading with stamp ≤ `at`, and the one behind it where its stamp is ≤ `until`; else *after has the stamp
 * TL_TIME_NEVER. False if there is none at or before `at`, or it is not kept any more; both are then as they were. */
bool tl_sample_buffer_around(const tl_sample_buffer *buffer, tl_time at, tl_time until, tl_reading *before,
                             tl_reading *after);

/* Reader of each reading in turn: post *next or, where it has a stamp > until or is not kept any more, the first of the few behind it that is, and has not; *next is
 * then the one behind that. 0 at first. False if there is none; *reading is then as it was. */
bool tl_sample_buffer_next(const tl_sample_buffer *buffer, tl_time until, uint64_t *next, tl_reading *reading);

/* Reader: the newest reading with stamp ≤ instant; the oldest kept one if all are later than `instant` and
 * something had to be forgotten. False if there is none; *reading is then as it was. */
bool tl_sample_buffer_at(const tl_sample_buffer *buffer, tl_time instant, tl_reading *reading);

/* ---- The mail: the mailboxes of all signals of a configuration, in one piece of memory.
 *
 * Purpose: plant I/O writes the piece, the cycle reads it; in two processes it is a block (block.h). How large it is and what lies where
 *          follows from the configuration alone, which both sides have; nothing of it is read from the memory.
 * Memory:  of the caller, zeroed at first, aligned to 8 bytes; better to a page, as a block is. The counts of all mailboxes come first, on a
 *          cache line each, then the slots of one signal after the other.
 * Look-ups: a second look-up of a signal has no mailbox of its own: it reads that of the signal. So twins with different look-ups read the same mail.
 * Thread:  plain data; of the mailboxes see sample_buffer.h.
 */

enum { TL_SAMPLE_BUFFERS_LEAST = 256, TL_SAMPLE_BUFFERS_MOST = 65536 }; /* readings of a signal */

typedef struct tl_sample_buffers_shape {
    size_t signals;
    uint32_t depth[TL_MAX_SIGNALS]; /* powers of two */
    size_t of[TL_MAX_SIGNALS];      /* whose mailbox each reads: its own, or that of an earlier signal */
} tl_sample_buffers_shape;

/* Live: what a source reads in hang_s and 10 s is kept, as often as it polls: every period_s (CAN: 1 ms), but not less often than each step, and
 * no more often than each millisecond. The configuration has its second look-ups already: tl_config_use_lookups(). */
void tl_sample_buffers_shape_of(const tl_config *config, tl_sample_buffers_shape *shape);

/* For how long live readings are kept, ns, if they are not more than TL_SAMPLE_BUFFERS_MOST. */
tl_time tl_sample_buffers_kept(const tl_config *config);

/* Of the memory; never 0. */
size_t tl_sample_buffers_bytes(const tl_sample_buffers_shape *shape);

/* Handles on what is in the memory, for either side: whoever only reads may have mapped it read-only. */
void tl_sample_buffers_open(const tl_sample_buffers_shape *shape, void *memory,
                            tl_sample_buffer buffers[TL_MAX_SIGNALS]);

/* Within one process: memory with the least depth of all, opened: for recordings, whose readings are looked up as they come. The caller frees it with
 * free(). NULL: there is not enough. */
void *tl_sample_buffers_make_least(size_t signals, tl_sample_buffer buffers[TL_MAX_SIGNALS]);

#endif
