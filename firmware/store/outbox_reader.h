/* The reader's side of an outbox (outbox.h), which may be a hostile process's.
 *
 * Purpose: hands out copies of what is in it, each checked: kinds, sizes, positions, enumerations, texts, digests. Numbers are not judged.
 *          Control characters of texts become '?'. The first thing that cannot be ends its part, the ring or the events: `fault`
 *          says what, and nothing more comes of that part. A reader that is opened anew goes on if a successor of the writer has mended it, or
 *          behind what it skips.
 * Twice:   the reader goes on from tl_outbox_taken, which its owner keeps. What was not taken comes again.
 * Death:   an event that its writer has left half-written keeps those behind it waiting, until a successor has mended the outbox.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_STORE_OUTBOX_READER_H
#define TL_FIRMWARE_STORE_OUTBOX_READER_H

#include "firmware/store/outbox.h"
#include "firmware/store/recorder_events.h"

/* Private but for `fault`; placed by the caller. */
typedef struct tl_outbox_reader {
    tl_outbox_settings settings;
    const struct tl_outbox_control *control;
    const unsigned char *ring;
    const unsigned char *checkpoints;
    bool is_left; /* its writer is no more */
    bool is_ring_broken;
    bool are_events_broken;
    char fault[TL_ERROR_TEXT]; /* "": none */
} tl_outbox_reader;

void tl_outbox_reader_open(const tl_outbox_settings *settings, const void *memory, tl_outbox_reader *reader);

/* Its writer is no more, and nobody goes on in it: from now on a sample that waits for its step is there, too. */
void tl_outbox_reader_leave(tl_outbox_reader *reader);

/* Behind the newest entry that is there now, seen from `taken`. */
uint64_t tl_outbox_reader_end(tl_outbox_reader *reader, uint64_t taken);

/* The entry at a position before that end, which moves behind it. False: a fault. */
bool tl_outbox_reader_entry(tl_outbox_reader *reader, uint64_t *position, uint64_t end, tl_recorder_entry *entry);

/* Of a reader that was just opened: where to go on. `taken` if all entries up to the end are sound, or the writer has to publish first; else the end:
 * a writer that lives goes on there. */
uint64_t tl_outbox_reader_skip(tl_outbox_reader *reader, uint64_t taken);

/* The event of this number; false: it is not there yet, or a fault. *skip: it was left half-written, and is none. */
bool tl_outbox_reader_event(tl_outbox_reader *reader, uint64_t number, tl_recorder_event_entry *event, bool *skip);

/* Of the whole checkpoints with a number above `taken`, whose entries before it, the beginning of its run included, end at or before
 * `position`, the older one: a run may begin with it. Copied into `bytes` (of settings.checkpoint_bytes). False: there is none (now). */
bool tl_outbox_reader_checkpoint(tl_outbox_reader *reader, uint64_t taken, uint64_t position, unsigned char *bytes,
                                 size_t *size, int64_t *tick, uint64_t *number);

/* As the writer counts. */
uint64_t tl_outbox_reader_lost(const tl_outbox_reader *reader);

#endif
