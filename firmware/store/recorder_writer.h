/* Writer of the recorder: moves entries from record queues into a database. No failure ends it.
 *
 * Purpose: reads the record queues (record_queue.h) of the producers and writes batches, one
 *          transaction each. The caller calls it regularly; it has no thread of its own.
 * Order:   an event of the queue with the ring is written after all entries that were put before
 *          it, so it belongs to their run. An event of another queue belongs to the open run, or
 *          else to the last one.
 * Runs:    a START entry begins a run, END ends it. Events before the first START wait for it. If a
 *          START comes during an open run, the open run is marked as not ended cleanly.
 * Rings:   at a handover, the next run comes through the ring of another queue. Then the present
 *          run ends with the reason `hand_over`, and this writer reads nothing after that END. When
 *          all entries before it are written (tl_recorder_writer_has_drained()), the caller closes
 *          this writer and opens one for the other ring, with the same state. If `continues` gives
 *          true, no other ring follows, and the writer continues with this ring. All writers must
 *          list the queues in the same order, because the state has one element for each.
 * Once:    each entry and event is written exactly once, even if the process is killed at any
 *          instant. The successor continues from tl_recorder_writer_state (recorder_state.h), in
 *          memory that outlives the process, and writes into the same row of the run.
 * Faults:  recorder_file.h opens and replaces the file. If the disk is full or another program has
 *          locked the file, the writer retries. In another file, the run begins again, with the
 *          entries that were not yet written. Each fault is reported once, in the log and as an
 *          event. Meanwhile entries stay in the queues; they are lost only if a queue is full.
 * Trust:   the content of the queues is untrusted.
 * Memory:  malloc() at the opening.
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
#include "firmware/store/recorder_entry.h"
#include "firmware/store/recorder_state.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_recorder_writer tl_recorder_writer;

/* A record queue that the writer reads. */
typedef struct tl_recorder_writer_queue {
    const char *name; /* of the producer, for messages */
    tl_record_queue_settings settings;
    const void *memory; /* of the queue; NULL: there is no such queue now */
} tl_recorder_writer_queue;

/* Source of samples that are missing in the ring: the readings in io's sample buffers. */
typedef struct tl_recorder_plant {
    /* Makes the sample of `tick`, due at `instant` (CLOCK_MONOTONIC, ns). NULL: no source. */
    void (*take)(void *context, int64_t tick, tl_time instant, tl_sample *sample);
    void *context;
    tl_time kept; /* how long io keeps its readings, ns */
} tl_recorder_plant;

typedef struct tl_recorder_writer_settings {
    const tl_recorder_settings *record; /* outlives the writer; component_count is ignored */
    const tl_recorder_writer_queue *queues;
    size_t queue_count;
    size_t ring;                      /* index of the queue whose ring is read; of the others only events are */
    const char *hand_over;            /* reason of an END before a handover, see Rings; NULL: no handover */
    bool (*continues)(void *context); /* see Rings; in the writer's thread; NULL only without `hand_over` */
    /* Called with each entry of the ring once, before it is written, and first with the start of
     * the present run. Also called while the database cannot be written. NULL: no observer. */
    void (*observe)(void *context, const tl_recorder_entry *entry);
    void *context;                      /* of continues() and observe() */
    tl_recorder_writer_state *state;    /* outlives the writer */
    const tl_record_queue_start *first; /* a run that begins at once, without a START; or NULL */
    tl_thread_heartbeat *heartbeat;     /* of the caller's thread; beats with each batch; or NULL */
    tl_recorder_plant plant;            /* for samples missing in the ring; zeroed: none */
    bool is_last;                       /* no other process can continue or end the run later */
} tl_recorder_writer_settings;

/* Opens the database and continues from settings->state. Errors: those of tl_recorder_open() for
 * the file; TL_TRY_AGAIN if memory is out. */
tl_status tl_recorder_writer_open(const tl_recorder_writer_settings *settings, tl_recorder_writer **writer,
                                  tl_error *error);

/* Writes all entries that are in the queues now. After a failure they stay for the next call. */
void tl_recorder_writer_write(tl_recorder_writer *writer);

/* Returns true if the caller should write soon: the ring is more than half full, or a run begins,
 * and the last write did not fail. */
bool tl_recorder_writer_is_pressed(tl_recorder_writer *writer);

/* Call it when the producer of the ring has ended, or puts nothing more before the next writer
 * reads the ring. From now on the writer also reads a sample that waits for its step. */
void tl_recorder_writer_finish_ring(tl_recorder_writer *writer);

/* Returns true if all entries of the ring up to a handover are written, and the events of its queue
 * that belong to them. */
bool tl_recorder_writer_has_drained(tl_recorder_writer *writer);

/* Writes findings and what was learnt, in a transaction of its own. Returns false if that fails, or
 * if no file is open or no run has begun. */
bool tl_recorder_writer_keep(tl_recorder_writer *writer, const tl_run_changes *changes);

/* Reads what earlier runs learnt, and the largest number of a finding, as
 * tl_recorder_database_learned(). Returns false if no file is open, or the reading fails. */
bool tl_recorder_writer_read_learned(tl_recorder_writer *writer, unsigned char **bytes, size_t *size,
                                     uint32_t *last_finding);

/* Returns true if a user has removed what was learnt (finding_notes.h). The next call of keep()
 * with `is_new` ends this. */
bool tl_recorder_writer_is_removed(tl_recorder_writer *writer);

/* Finds the next finding after `number` whose state is "normal". Returns false if there is
 * none. */
bool tl_recorder_writer_next_normal(tl_recorder_writer *writer, uint32_t number, uint32_t *next);

/* Returns since when a queue is unreadable (CLOCK_MONOTONIC, ns); 0: it is readable. `queue`: index
 * in settings.queues. The writer checks again every second, because a successor of the producer may
 * have repaired the queue. */
tl_time tl_recorder_writer_damage(const tl_recorder_writer *writer, size_t queue);

/* Returns the path of the open file; if no file is open, the requested path. */
const char *tl_recorder_writer_path(const tl_recorder_writer *writer);

/* Writes the remaining entries and closes. Retries for at most `patience` (ns) if the disk refuses;
 * then counts the remaining entries as dropped and fails with TL_TRY_AGAIN. If the run has no END
 * entry, its row then has no end. The next writer without this state marks it as not ended cleanly.
 * The last writer (`is_last`) marks it itself if all entries are written, including a sample that
 * waits for its step. In both cases a writer with this state can continue the run. NULL is allowed.
 */
tl_status tl_recorder_writer_close(tl_recorder_writer *writer, tl_time patience, tl_error *error);

#endif
