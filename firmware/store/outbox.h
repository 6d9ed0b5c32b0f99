/* An outbox: what a process hands to the recorder, in memory that the recorder reads.
 *
 * Purpose: the beginning of a run, its samples, steps, tunings and end go through a ring of bytes; events through a queue for many threads;
 *          saved twins (checkpoints) lie in two places that take turns. Nothing of it ever waits for the recorder.
 * Memory:  of the caller, zeroed at first, at a multiple of 64 bytes: of this process, or a block (block.h) that only this process writes. It has
 *          no pointers. What the reader gives back, tl_outbox_taken, lies in the reader's memory.
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
 * Trust:   the reader's side (outbox_reader.h) believes nothing of this; and this nothing of what the reader says it has taken.
 */
#ifndef TL_FIRMWARE_STORE_OUTBOX_H
#define TL_FIRMWARE_STORE_OUTBOX_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/sha256.h"
#include "firmware/store/recorder_entry.h"
#include "firmware/store/run_types.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

/* The same on both sides. */
typedef struct tl_outbox_settings {
    tl_recorder_shape shape; /* of the entries */
    size_t ring_bytes;       /* a power of two, at least that of tl_outbox_ring_bytes(); 0: there are events only */
    size_t checkpoint_bytes; /* of each place, and of the room for the next one; used only as far as needed. 0: none */
} tl_outbox_settings;

/* What the reader has taken, for good. In its memory, where the writer looks. Positions never go back. */
typedef struct tl_outbox_taken {
    uint64_t ring;       /* bytes */
    uint64_t events;     /* how many */
    uint64_t checkpoint; /* number of the newest one; 0: none */
} tl_outbox_taken;

/* A run begins. */
typedef struct tl_outbox_start {
    bool holds;                /* safe hold: samples and events only */
    tl_resumption resumption;  /* `start` and `started` always count. Its run, if below 0: the one before in here */
    tl_account account;        /* of the twin; nothing if it holds */
    char fmus[TL_SHA256_TEXT]; /* which FMUs it has: see tl_outbox_name_fmus(). "": nobody has named them */
    tl_run_tuning
        configured; /* what it was built with: see tl_outbox_name_configuration(). Its hash "": nobody has named it */
} tl_outbox_start;

/* Private; placed by the caller. */
typedef struct tl_outbox {
    tl_outbox_settings settings;
    struct tl_outbox_control *control;
    unsigned char *ring;
    unsigned char *checkpoints;
    const tl_outbox_taken *taken; /* NULL: nobody reads */
    uint64_t written;             /* end of what was put, */
    uint64_t published;           /* and of what is in the ring: between them is a sample that waits, */
    int64_t waiting;              /* of this tick */
    uint64_t number;              /* of the newest checkpoint */
    size_t reserved;              /* bytes for each */
    bool hides;                   /* what is not reserved */
    char fmus[TL_SHA256_TEXT];
    tl_run_tuning configured; /* of the runs that are begun, */
    tl_run_tuning tuning;     /* and what is in force */
    tl_resumption beginning;  /* of the run; stamps are relative to its start */
    uint64_t id;              /* of the run: when its beginning was put; 0: it has none */
} tl_outbox;

/* For 30 s of such a run, and what a successor looks back at; between 256 KiB and 16 MiB. */
size_t tl_outbox_ring_bytes(const tl_recorder_shape *shape, tl_time step);

/* Of the memory. */
size_t tl_outbox_bytes(const tl_outbox_settings *settings);

/* Begins, or goes on where a dead one was. All pages of the ring are touched. `taken` may be the reader's block. NULL: nobody reads;
 * what is put is for a successor only, and events go nowhere. Takes some 25 KB of stack. */
void tl_outbox_open(const tl_outbox_settings *settings, void *memory, const tl_outbox_taken *taken, tl_outbox *outbox);

/* ---- a run ---- */

/* Which FMUs the runs have that are begun from now on, as identity.h says; of those that hold, nothing is said. */
void tl_outbox_name_fmus(tl_outbox *outbox, const char fmus[TL_SHA256_TEXT]);

/* What they are built with; of those that hold, nothing is said. */
void tl_outbox_name_configuration(tl_outbox *outbox, const tl_run_tuning *configured);

/* False: there was no room. A beginning goes in before the next entry that finds room; anything else was counted as lost. Stamps are kept relative
 * to the start. A sample finds room only together with its step. */
bool tl_outbox_put_start(tl_outbox *outbox, const tl_outbox_start *start);
bool tl_outbox_put_sample(tl_outbox *outbox, const tl_sample *sample);
bool tl_outbox_put_step(tl_outbox *outbox, const tl_record *record, const tl_recorder_component *ledger);
bool tl_outbox_put_end(tl_outbox *outbox, const char *reason); /* cut to TL_RECORDER_REASON */

/* The twin has this from `tick` on: just before that tick's sample. Whoever asks first whether there is room, beside that tick and the step before it,
 * does not lose it. */
bool tl_outbox_has_room_for_tuning(const tl_outbox *outbox);
bool tl_outbox_put_tuning(tl_outbox *outbox, const tl_run_tuning *tuning);

/* What is in force: what the run was built with, or what was put since. */
const tl_run_tuning *tl_outbox_tuning(const tl_outbox *outbox);

/* How the run began that is being put. */
const tl_resumption *tl_outbox_beginning(const tl_outbox *outbox);

/* Sleeps in small pieces until a tuning, a sample, a step and an end have room; false: not by `until` (CLOCK_MONOTONIC). For who makes up what is past. */
bool tl_outbox_wait_for_room(tl_outbox *outbox, tl_time until);

/* Any thread. `source` is one word; `tick` −1 if it belongs to none. Texts are cut to what an entry holds. */
void tl_outbox_event(tl_outbox *outbox, int64_t tick, tl_severity severity, const char *source, const char *text);

/* Entries and events that found no room. */
uint64_t tl_outbox_lost(const tl_outbox *outbox);

/* ---- checkpoints ---- */

/* From now on checkpoints of up to `size` bytes meet no page fault. What the places hold stays. False: settings.checkpoint_bytes are
 * fewer, or memory is out. */
bool tl_outbox_reserve_checkpoint(tl_outbox *outbox, size_t size);

/* Where the next one is made; NULL if nothing was reserved. */
unsigned char *tl_outbox_checkpoint_room(tl_outbox *outbox, size_t *capacity);

/* It is made: the twin after `tick`, and after all entries put so far. Copied into the place of the older one, whether or not the reader has taken
 * that. `size` 0: a twin that cannot be saved; a successor finds what was put since. */
void tl_outbox_put_checkpoint(tl_outbox *outbox, int64_t tick, size_t size);

/* What neither a reservation nor a checkpoint that was left uses cannot be touched any more, until it is reserved: so that a process that locks its
 * memory does not fill it. Only of memory that begins with a page. */
void tl_outbox_hide_unused(tl_outbox *outbox);

/* ---- a successor, before it puts anything ---- */

/* What the predecessor has left. */
typedef struct tl_outbox_left {
    int64_t tick;
    const unsigned char *bytes; /* valid until the next checkpoint; size 0: none */
    size_t size;
    uint64_t position;       /* of the first entry after it */
    tl_resumption beginning; /* of its run */
    tl_run_tuning tuning;    /* in force then; its values are not judged, its hash is */
} tl_outbox_left;

/* The newest (0) or the older (1) checkpoint that is whole, and since which no entry was overwritten. False: there is none. */
bool tl_outbox_checkpoint_left(const tl_outbox *outbox, unsigned which, tl_outbox_left *left);

/* The entry at a position, which moves behind it. False: there is none any more. Sound as recorder_entry.h says; stamps are relative to its
 * run's start, and may be any. */
bool tl_outbox_entry_left(const tl_outbox *outbox, uint64_t *position, tl_recorder_entry *entry);

#endif
