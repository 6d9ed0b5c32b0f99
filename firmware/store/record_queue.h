/* The record queue: what a process hands to the recorder, in memory that the recorder reads.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_STORE_RECORD_QUEUE_H
#define TL_FIRMWARE_STORE_RECORD_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

/* ---- An event as it waits to be written.
 *
 * Size:   fixed, texts are cut; no pointers, so that it can wait in memory that another process reads (record_queue.h).
 * Thread: plain data.
 */

/* That wait at most; a power of two. */
enum { TL_RECORDER_EVENTS = 512 };
enum { TL_EVENT_SOURCE = 32, TL_EVENT_TEXT = 224 };

typedef struct tl_recorder_event_entry {
    int64_t at;        /* UTC, ms */
    int64_t tick;      /* −1: none */
    uint64_t position; /* of an outbox: end of its ring when the event was put; else 0 */
    tl_severity severity;
    char source[TL_EVENT_SOURCE];
    char text[TL_EVENT_TEXT];
} tl_recorder_event_entry;

/* Fills an entry with the texts, cut to what it holds, and the time now. */
void tl_recorder_event_fill(tl_recorder_event_entry *entry, int64_t tick, tl_severity severity, const char *source,
                            const char *text);

/* ---- An outbox: what a process hands to the recorder, in memory that the recorder reads.
 *
 * Purpose: the beginning of a run, its samples, steps, tunings and end go through a ring of bytes; events through a queue for many threads;
 *          saved twins (checkpoints) lie in two places that take turns. Nothing of it ever waits for the recorder.
 * Memory:  of the caller, zeroed at first, at a multiple of 64 bytes: of this process, or a block (block.h) that only this process writes. It has
 *          no pointers. What the reader gives back, tl_record_queue_taken, lies in the reader's memory.
 * Death:   the memory may outlive its writer. A successor goes on in it: all that was published stands; what was left half-written, and what is
 *          not sound of that which the reader has not taken, goes. A successor may also look back: what was taken stays in the ring until new entries
 *          need its bytes, and the ring is large enough for 30 s of new ones beside those since the older of the two checkpoints.
 * New:     memory of zeros in the place of another outbox, all of which was taken, goes on with its numbers: those of a reader never go back.
 * Ticks:   a sample waits for its step, and is in the ring together with it, or with whatever else is put next: so that of a tick in which its writer dies
 *          nothing is there, unless the reader knows that nobody goes on. If the successor goes on with that tick, it takes its sample anew; if it begins
 *          another run, the sample that waited is the last one of the run before.
 * Loss:    what finds no room is counted, and never waited for. Room is lost only to a reader that is too slow, not to what is kept.
 * Damage:  a reader that cannot read the ring on may skip to its end, and the next entry goes behind what it has skipped.
 * Order:   nothing of a run is in the ring before its beginning. A beginning without room waits, and goes first; until then the rest is lost.
 * Thread:  put_* and checkpoints: one thread, the cycle's; event(): any; lost(): any. Lock-free: an event is tried again only
 *          if another thread has put one meanwhile.
 * Trust:   the reader's side (record_queue.h) believes nothing of this; and this nothing of what the reader says it has taken.
 */

/* The same on both sides. */
typedef struct tl_record_queue_settings {
    tl_recorder_shape shape; /* of the entries */
    size_t ring_bytes; /* a power of two, at least that of tl_record_queue_ring_bytes(); 0: there are events only */
    size_t checkpoint_bytes; /* of each place, and of the room for the next one; used only as far as needed. 0: none */
} tl_record_queue_settings;

/* What the reader has taken, for good. In its memory, where the writer looks. Positions never go back. */
typedef struct tl_record_queue_taken {
    uint64_t ring;       /* bytes */
    uint64_t events;     /* how many */
    uint64_t checkpoint; /* number of the newest one; 0: none */
} tl_record_queue_taken;

/* Private; placed by the caller. */
typedef struct tl_record_queue {
    tl_record_queue_settings settings;
    struct tl_record_queue_control *control;
    unsigned char *ring;
    const tl_record_queue_taken *taken; /* NULL: nobody reads */
    uint64_t written;                   /* end of what was put, */
    uint64_t published;                 /* and of what is in the ring: between them is a sample that waits, */
    int64_t waiting;                    /* of this tick */
    uint64_t number;                    /* of the newest checkpoint */
    size_t reserved;                    /* bytes for each */
    bool hides;                         /* what is not reserved */
    char fmus[TL_SHA256_TEXT];
    tl_run_tuning configured; /* of the runs that are begun, */
    tl_run_tuning tuning;     /* and what is in force */
    tl_resumption beginning;  /* of the run; stamps are relative to its start */
    uint64_t id;              /* of the run: when its beginning was put; 0: it has none */
} tl_record_queue;

/* For 30 s of such a run, and what a successor looks back at; between 256 KiB and 16 MiB. */
size_t tl_record_queue_ring_bytes(const tl_recorder_shape *shape, tl_time step);

/* Of the memory. */
size_t tl_record_queue_bytes(const tl_record_queue_settings *settings);

/* Begins, or goes on where a dead one was. All pages of the ring are touched. `taken` may be the reader's block. NULL: nobody reads;
 * what is put is for a successor only, and events go nowhere. Takes some 25 KB of stack. */
void tl_record_queue_open(const tl_record_queue_settings *settings, void *memory, const tl_record_queue_taken *taken,
                          tl_record_queue *queue);

/* ---- a run ---- */

/* Which FMUs the runs have that are begun from now on, as identity.h says; of those that hold, nothing is said. */
void tl_record_queue_name_fmus(tl_record_queue *queue, const char fmus[TL_SHA256_TEXT]);

/* What they are built with; of those that hold, nothing is said. */
void tl_record_queue_name_configuration(tl_record_queue *queue, const tl_run_tuning *configured);

/* False: there was no room. A beginning goes in before the next entry that finds room; anything else was counted as lost. Stamps are kept relative
 * to the start. A sample finds room only together with its step. */
bool tl_record_queue_put_start(tl_record_queue *queue, const tl_record_queue_start *start);
bool tl_record_queue_put_sample(tl_record_queue *queue, const tl_sample *sample);
bool tl_record_queue_put_step(tl_record_queue *queue, const tl_record *record, const tl_recorder_component *ledger);
bool tl_record_queue_put_end(tl_record_queue *queue, const char *reason); /* cut to TL_RECORDER_REASON */

/* The twin has this from `tick` on: just before that tick's sample. Whoever asks first whether there is room, beside that tick and the step before it,
 * does not lose it. */
bool tl_record_queue_has_room_for_tuning(const tl_record_queue *queue);
bool tl_record_queue_put_tuning(tl_record_queue *queue, const tl_run_tuning *tuning);

/* What is in force: what the run was built with, or what was put since. */
const tl_run_tuning *tl_record_queue_tuning(const tl_record_queue *queue);

/* How the run began that is being put. */
const tl_resumption *tl_record_queue_beginning(const tl_record_queue *queue);

/* Sleeps in small pieces until a tuning, a sample, a step and an end have room; false: not by `until` (CLOCK_MONOTONIC). For who makes up what is past. */
bool tl_record_queue_wait_for_room(tl_record_queue *queue, tl_time until);

/* Any thread. `source` is one word; `tick` −1 if it belongs to none. Texts are cut to what an entry holds. */
void tl_record_queue_event(tl_record_queue *queue, int64_t tick, tl_severity severity, const char *source,
                           const char *text);

/* Entries and events that found no room. */
uint64_t tl_record_queue_lost(const tl_record_queue *queue);

/* ---- checkpoints ---- */

/* From now on checkpoints of up to `size` bytes meet no page fault. What the places hold stays. False: settings.checkpoint_bytes are
 * fewer, or memory is out. */
bool tl_record_queue_reserve_checkpoint(tl_record_queue *queue, size_t size);

/* Where the next one is made; NULL if nothing was reserved. */
unsigned char *tl_record_queue_checkpoint_room(tl_record_queue *queue, size_t *capacity);

/* It is made: the twin after `tick`, and after all entries put so far. Copied into the place of the older one, whether or not the reader has taken
 * that. `size` 0: a twin that cannot be saved; a successor finds what was put since. */
void tl_record_queue_put_checkpoint(tl_record_queue *queue, int64_t tick, size_t size);

/* What neither a reservation nor a checkpoint that was left uses cannot be touched any more, until it is reserved: so that a process that locks its
 * memory does not fill it. Only of memory that begins with a page. */
void tl_record_queue_hide_unused(tl_record_queue *queue);

/* ---- a successor, before it puts anything ---- */

/* What the predecessor has left. */
typedef struct tl_record_queue_left {
    int64_t tick;
    const unsigned char *bytes; /* valid until the next checkpoint; size 0: none */
    size_t size;
    uint64_t position;       /* of the first entry after it */
    tl_resumption beginning; /* of its run */
    tl_run_tuning tuning;    /* in force then; its values are not judged, its hash is */
} tl_record_queue_left;

/* The newest (0) or the older (1) checkpoint that is whole, and since which no entry was overwritten. False: there is none. */
bool tl_record_queue_checkpoint_left(const tl_record_queue *queue, unsigned which, tl_record_queue_left *left);

/* The entry at a position, which moves behind it. False: there is none any more. Sound as recorder_entry.h says; stamps are relative to its
 * run's start, and may be any. */
bool tl_record_queue_entry_left(const tl_record_queue *queue, uint64_t *position, tl_recorder_entry *entry);

/* ---- What lies where in an outbox: shared by the writer and the reader.
 *
 * Layout:  what controls it, with the events; the ring; two places for checkpoints, and the room in which the next one is made. Each part
 *          begins with a page.
 * Atomics: whatever both sides touch at the same time has 8 bytes and lies on a multiple of 8, so that a 32-bit machine reads it at once too.
 * Thread:  as record_queue.h and record_queue.h say.
 */

enum { TL_RECORD_QUEUE_LINE = 64, TL_RECORD_QUEUE_PLACES = 2 };

/* Event n lies in slot n % TL_RECORDER_EVENTS. Before it is there, its state is that of an earlier one. */
typedef struct tl_record_queue_slot {
    uint64_t state __attribute__((aligned(8)));
    tl_recorder_event_entry entry;
} tl_record_queue_slot;

/* What belongs to the bytes of a checkpoint. */
typedef struct tl_record_queue_mark {
    int64_t tick;
    uint64_t size;
    uint64_t position; /* of the first entry after it */
    uint64_t behind;   /* what the reader takes before it: that far, and the beginning of its run if that still waits */
    tl_resumption beginning;
    tl_run_tuning tuning; /* in force */
} tl_record_queue_mark;

enum { TL_RECORD_QUEUE_MARK_WORDS = (sizeof(tl_record_queue_mark) + 7) / 8 };

/* Checkpoint n lies in place n % 2. Number 0: none, or one that is being written. The digest is over all of it, so that one that was read
 * while it changed, or that somebody has written into, is none: no order of stores and loads has to see to that. */
typedef struct tl_record_queue_checkpoint {
    uint64_t number __attribute__((aligned(TL_RECORD_QUEUE_LINE)));
    uint64_t digest;
    uint64_t mark[TL_RECORD_QUEUE_MARK_WORDS];
} tl_record_queue_checkpoint;

typedef struct tl_record_queue_control {
    uint64_t head __attribute__((aligned(TL_RECORD_QUEUE_LINE))); /* end of what is in the ring, for the reader */
    uint64_t put; /* and with a sample that waits for its step; for a successor, or a reader if there is none */
    uint64_t next __attribute__((aligned(TL_RECORD_QUEUE_LINE))); /* event */
    uint64_t lost __attribute__((aligned(TL_RECORD_QUEUE_LINE)));
    tl_record_queue_checkpoint places[TL_RECORD_QUEUE_PLACES];
    tl_record_queue_slot slots[TL_RECORDER_EVENTS];
    bool start_waits;            /* the writer's own: */
    tl_record_queue_start start; /* has found no room yet */
} tl_record_queue_control;

size_t tl_record_queue_checkpoint_at(const tl_record_queue_settings *settings,
                                     unsigned place); /* TL_RECORD_QUEUE_PLACES: the room; one more: the end */

/* Checkpoints below it are possible; so numbers never wrap around. */
#define TL_RECORD_QUEUE_NUMBERS (UINT64_MAX / 2)

/* Over the mark as it lies there, padding included, and the bytes. */
uint64_t tl_record_queue_digest(uint64_t number, const tl_record_queue_mark *mark, const unsigned char *bytes);

/* ---- The reader's side of an outbox (record_queue.h), which may be a hostile process's.
 *
 * Purpose: hands out copies of what is in it, each checked: kinds, sizes, positions, enumerations, texts, digests. Numbers are not judged.
 *          Control characters of texts become '?'. The first thing that cannot be ends its part, the ring or the events: `fault`
 *          says what, and nothing more comes of that part. A reader that is opened anew goes on if a successor of the writer has mended it, or
 *          behind what it skips.
 * Twice:   the reader goes on from tl_record_queue_taken, which its owner keeps. What was not taken comes again.
 * Death:   an event that its writer has left half-written keeps those behind it waiting, until a successor has mended the outbox.
 * Thread:  one.
 */

/* Private but for `fault`; placed by the caller. */
typedef struct tl_record_queue_reader {
    tl_record_queue_settings settings;
    const struct tl_record_queue_control *control;
    const unsigned char *ring;
    bool is_left; /* its writer is no more */
    bool is_ring_broken;
    bool are_events_broken;
    char fault[TL_ERROR_TEXT]; /* "": none */
} tl_record_queue_reader;

void tl_record_queue_reader_open(const tl_record_queue_settings *settings, const void *memory,
                                 tl_record_queue_reader *reader);

/* Its writer is no more, and nobody goes on in it: from now on a sample that waits for its step is there, too. */
void tl_record_queue_reader_leave(tl_record_queue_reader *reader);

/* Behind the newest entry that is there now, seen from `taken`. */
uint64_t tl_record_queue_reader_end(tl_record_queue_reader *reader, uint64_t taken);

/* The entry at a position before that end, which moves behind it. False: a fault. */
bool tl_record_queue_reader_entry(tl_record_queue_reader *reader, uint64_t *position, uint64_t end,
                                  tl_recorder_entry *entry);

/* Of a reader that was just opened: where to go on. `taken` if all entries up to the end are sound, or the writer has to publish first; else the end:
 * a writer that lives goes on there. */
uint64_t tl_record_queue_reader_skip(tl_record_queue_reader *reader, uint64_t taken);

/* The event of this number; false: it is not there yet, or a fault. *skip: it was left half-written, and is none. */
bool tl_record_queue_reader_event(tl_record_queue_reader *reader, uint64_t number, tl_recorder_event_entry *event,
                                  bool *skip);

/* Of the whole checkpoints with a number above `taken`, whose entries before it, the beginning of its run included, end at or before
 * `position`, the older one: a run may begin with it. Copied into `bytes` (of settings.checkpoint_bytes). False: there is none (now). */
bool tl_record_queue_reader_checkpoint(tl_record_queue_reader *reader, uint64_t taken, uint64_t position,
                                       unsigned char *bytes, size_t *size, int64_t *tick, uint64_t *number);

/* As the writer counts. */
uint64_t tl_record_queue_reader_lost(const tl_record_queue_reader *reader);

/* ---- The rest: what is in an outbox, and nobody is left who records it.
 *
 * Purpose: what is lost at the end of a run is counted, by who has outlived all others.
 * Trust:   none in the outbox, nor in what is said to be taken of it.
 * Thread:  one at a time.
 */

/* Samples, steps and events that were not taken, up to the first thing that cannot be. */
uint64_t tl_record_queue_rest_count(const tl_record_queue_settings *settings, const void *memory,
                                    const tl_record_queue_taken *taken);

#endif
