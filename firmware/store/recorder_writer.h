/* The writer: what is in outboxes, into a database. No failure ends it.
 *
 * Purpose: takes what producers have put into their outboxes (record_queue.h) and writes it in batches, one transaction each. The caller calls it every now
 *          and then; it has no thread of its own.
 * Order:   an event of the outbox with the ring is written once all entries are that were put before it, and so belongs to their run; one of the others
 *          belongs to the run that is open, or was the last one.
 * Runs:    a START entry begins one, END ends it. Events that come before the first START wait for it. A START while a run is open means that
 *          that one was not ended cleanly.
 * Rings:   a run may be followed by one that comes by the ring of another outbox. It ends with the reason `hand_over` then, and nothing behind that is read
 *          by this writer: once all is written that came before (tl_recorder_writer_has_drained()) it is closed, and the next one is opened for the other ring,
 *          with the same state. An outbox keeps its place in the list for ever: by that the state knows how far it was taken.
 * Once:    each entry and event is written exactly once, also if the process is killed at any instant: what a successor needs to know for that lies
 *          in tl_recorder_writer_state (recorder_state.h), in memory that outlives the process. The run goes on in the same row.
 * Faults:  what is wrong with a file at first is coped with, or refused (insistence of the settings): see database_file.h. Later everything is
 *          coped with: a full disk and other programs' locks are waited for, a damaged file is put aside, one that was removed, moved away or overwritten is
 *          made anew; then the run begins again in the new file, with what had not been written into the old one. Each is said once, in the log
 *          and as an event. What waits in the outboxes is not lost by any of it, as long as they have room.
 * Trust:   none in what is in the outboxes.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_WRITER_H
#define TL_FIRMWARE_STORE_RECORDER_WRITER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/heartbeat.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_database.h"
#include "firmware/store/recorder_state.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_recorder_writer tl_recorder_writer;

typedef struct tl_recorder_writer_queue {
    const char *name; /* of who writes it: one word */
    tl_record_queue_settings settings;
    const void *memory; /* NULL: there is none now */
} tl_recorder_writer_queue;

/* What io has read of the plant, for samples that do not come by the ring. */
typedef struct tl_recorder_plant {
    void (*take)(void *context, int64_t tick, tl_time instant, tl_sample *sample); /* NULL: nobody can */
    void *context;
    tl_time kept; /* ns: for so long it is there */
} tl_recorder_plant;

typedef struct tl_recorder_writer_settings {
    const tl_recorder_settings *record; /* outlives the writer; its components do not matter */
    const tl_recorder_writer_queue *queues;
    size_t queue_count;
    size_t ring;           /* the one whose entries are read; of the others it is events only */
    const char *hand_over; /* as above; NULL: no run ends so */
    bool (*goes_on)(
        void *
            context); /* after such an end no other ring goes on: it was said without cause. With `hand_over`; called in the writer's thread */
    void *context;
    tl_recorder_writer_state *state;
    const tl_record_queue_start *first; /* NULL, or a run that begins at once, without a START */
    tl_thread_heartbeat *heartbeat;     /* of the caller's thread: beats with each batch; NULL: nobody's */
    tl_recorder_plant plant;            /* for samples that do not come by the ring; zeroed: there is none */
    bool is_last;                       /* when it is closed, whoever could go on with the run, or end it, is no more */
} tl_recorder_writer_settings;

/* Errors: those of recorder.h for a file that is refused; TL_TRY_AGAIN if memory is out. */
tl_status tl_recorder_writer_open(const tl_recorder_writer_settings *settings, tl_recorder_writer **writer,
                                  tl_error *error);

/* All that is there now, as far as the disk takes it. */
void tl_recorder_writer_write(tl_recorder_writer *writer);

/* The ring is more than half full, or a run begins: it should be written soon, and can be, as far as the last try has shown. */
bool tl_recorder_writer_is_pressed(tl_recorder_writer *writer);

/* Who has put into the ring is no more, or puts nothing until it is read by the next writer: what waits there for its end is there, too. */
void tl_recorder_writer_leave(tl_recorder_writer *writer);

/* All is written that is in the ring, as far as it is this writer's, and what its outbox has said of that. */
bool tl_recorder_writer_has_drained(tl_recorder_writer *writer);

/* If what is in this outbox cannot be read on: a time (CLOCK_MONOTONIC) since which that was found; 0: it can. It is looked at again every second, since a
 * successor of its producer may have mended it. */
tl_time tl_recorder_writer_damage(const tl_recorder_writer *writer, size_t queue);

/* Where it writes; if no file is open, where it was asked to. */
const char *tl_recorder_writer_path(const tl_recorder_writer *writer);

/* Writes the rest and closes. Tries for at most `patience` if the disk refuses, then counts what is left as dropped and fails with
 * TL_TRY_AGAIN. A run without END has no end then, and the next writer without this state marks it as not ended cleanly. So does the last writer itself
 * if all is written, a sample that waits for its step included; a writer with this state goes on with the run all the same. NULL is allowed. */
tl_status tl_recorder_writer_close(tl_recorder_writer *writer, tl_time patience, tl_error *error);

#endif
