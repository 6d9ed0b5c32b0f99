/* The inbox: all outboxes that a writer reads, side by side.
 *
 * Purpose: the ring of one of them, the events of all in the order in which they belong into a run, and what was lost in each. How far everything is
 *          taken its caller knows (recorder_state.h).
 * Order:   an event of the outbox with the ring comes once all entries are written that were put before it.
 * Touches: the outboxes' memory, by their readers; nothing else.
 * Trust:   none in what is in the outboxes. What is damaged is looked at again every now and then: its producer's successor mends it.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_INBOX_H
#define TL_FIRMWARE_STORE_RECORDER_INBOX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/outbox.h"
#include "firmware/store/recorder_state.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"

typedef struct tl_recorder_writer_outbox {
    const char *name; /* of who writes it: one word */
    tl_outbox_settings settings;
    const void *memory; /* NULL: there is none now */
} tl_recorder_writer_outbox;

/* What io has read of the plant, for samples that do not come by the ring. */
typedef struct tl_recorder_plant {
    void (*take)(void *context, int64_t tick, tl_time instant, tl_sample *sample); /* NULL: nobody can */
    void *context;
    tl_time kept; /* ns: for so long it is there */
} tl_recorder_plant;

/* Private; placed by the caller. */
typedef struct tl_recorder_inbox {
    tl_recorder_writer_outbox outboxes[TL_WRITER_OUTBOXES];
    tl_outbox_reader readers[TL_WRITER_OUTBOXES];
    bool is_told[TL_WRITER_OUTBOXES];       /* that it is damaged */
    tl_time damaged_at[TL_WRITER_OUTBOXES]; /* by a look that was not before this; 0: it is not */
    size_t count;
    size_t ring;       /* which of them has the ring */
    tl_time mended_at; /* when that was tried the last time */
    bool is_reopened;  /* the ring was, since it was still damaged */
} tl_recorder_inbox;

/* At most TL_WRITER_OUTBOXES. `ring` is there; of the others only events are read. */
void tl_recorder_inbox_open(tl_recorder_inbox *inbox, const tl_recorder_writer_outbox *outboxes, size_t count,
                            size_t ring);

/* ---- the ring ---- */

/* Behind the newest entry that is there now, seen from what is taken. */
uint64_t tl_recorder_inbox_end(tl_recorder_inbox *inbox, uint64_t taken);

/* Its producer is no more: a sample that waits for its step is there, too. */
void tl_recorder_inbox_leave(tl_recorder_inbox *inbox);

/* Whether more can come of it. */
bool tl_recorder_inbox_is_whole(const tl_recorder_inbox *inbox);

/* After tl_recorder_inbox_mend(): where to go on, from what is taken: see tl_outbox_reader_skip(). */
uint64_t tl_recorder_inbox_skip(tl_recorder_inbox *inbox, uint64_t taken);

/* As tl_outbox_reader_entry() and tl_outbox_reader_checkpoint(). */
bool tl_recorder_inbox_entry(tl_recorder_inbox *inbox, uint64_t *position, uint64_t end, tl_recorder_entry *entry);
bool tl_recorder_inbox_checkpoint(tl_recorder_inbox *inbox, const tl_outbox_taken *taken, unsigned char *bytes,
                                  size_t *size, int64_t *tick, uint64_t *number);

/* ---- events; `taken`: of each outbox, TL_WRITER_OUTBOXES of them; `written`: of the ring ---- */

/* The oldest one that may be written now; of two of the same instant that of the later outbox, since what io says is often why the twin says
 * something. The outbox, or `count`: there is none. *skip: it was left half-written, and is none. */
size_t tl_recorder_inbox_oldest_event(tl_recorder_inbox *inbox, const tl_outbox_taken *taken, uint64_t written,
                                      tl_recorder_event_entry *oldest, bool *skip);

/* Those that can be written once the ring is as far, of each outbox at most so many. */
size_t tl_recorder_inbox_count_events(tl_recorder_inbox *inbox, const tl_outbox_taken *taken, uint64_t written,
                                      size_t most);

/* One of the outbox with the ring that can be written; `taken` is of that one. */
bool tl_recorder_inbox_has_event_of_ring(tl_recorder_inbox *inbox, const tl_outbox_taken *taken);

/* What the producer of an outbox has lost so far; of one that is not there, as much as was `known`. */
uint64_t tl_recorder_inbox_lost(const tl_recorder_inbox *inbox, size_t outbox, uint64_t known);

/* ---- damage ---- */

/* Looks at damaged outboxes again, once a second; at one that was found damaged since the last look by another caller, at once. */
void tl_recorder_inbox_mend(tl_recorder_inbox *inbox);

/* After reading, which began at this time (CLOCK_MONOTONIC): notes what was found damaged. And since when an outbox is, by that; 0: it is not. */
void tl_recorder_inbox_note_damage(tl_recorder_inbox *inbox, tl_time begun);
tl_time tl_recorder_inbox_damage(const tl_recorder_inbox *inbox, size_t outbox);

/* The next damage that was not told yet, in words; false: there is none. */
bool tl_recorder_inbox_tell(tl_recorder_inbox *inbox, char *text, size_t size);

#endif
