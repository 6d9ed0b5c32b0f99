/* State of the recorder's writer, for its successor: how much of each record queue has been
 * written.
 *
 * Purpose: a process that writes may be killed at any instant, and its successor must write each
 *          entry exactly once. A mark is the writer's progress after a commit. Before each commit,
 *          the writer stores the mark of that commit beside the last one. The successor compares
 *          both with the totals in the run's row, and so detects whether the commit has happened.
 * Memory:  the caller's, zeroed at first: of this process, or a shared block that outlives it and
 *          that only writers change. No pointers.
 * Thread:  one thread writes; any thread or process may read the counts and `taken`.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_STATE_H
#define TL_FIRMWARE_STORE_RECORDER_STATE_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/database_file.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder_database.h"
#include "master/base/simtime.h"

/* Limits: queues of a writer; waiting own events, which report on the recorder itself. */
enum { TL_WRITER_QUEUES = 8, TL_WRITER_OWN_EVENTS = 8 };

/* Progress of the writer after a commit. */
typedef struct tl_recorder_mark {
    uint64_t number;               /* of the batch; 0: none */
    char path[PATH_MAX];           /* of the file; "": none yet */
    tl_database_identity identity; /* of that file */
    int64_t run;                   /* row of the run in the file; 0: none yet */
    bool has_begun;                /* a run has begun; the comments below mean this run */
    bool is_untimed;               /* the run began without a START, so its t_start is unknown */
    bool has_ended;
    bool hands_over; /* the run has ended with a handover: a run of another ring follows */
    uint32_t ring;   /* index of the record queue with the run */
    bool is_again;   /* the run began in another file, and this file has no sample of it yet */
    tl_record_queue_start start;
    tl_recorder_totals totals;       /* in the run's row */
    uint64_t own;                    /* number of the writer's own events in totals.events */
    tl_run_tuning tuning;            /* newest tuning of the run that was written; hash "": none */
    uint64_t written;                /* entries and events of all runs */
    uint64_t dropped;                /* entries and events lost with a file, or that belonged to no run */
    uint64_t said;                   /* number of own events written so far, all runs */
    uint64_t lost[TL_WRITER_QUEUES]; /* the producers' loss counts that are included in totals */
    tl_time counted;                 /* when these loss counts were read, CLOCK_MONOTONIC, ns */
    uint64_t id;                     /* of the run, as in its entries; 0: none */
    int64_t sampled;                 /* tick of the run's newest sample + 1; 0: no sample */
    bool is_cut;                     /* entries of the run after `sampled` were skipped in the damaged ring */
    tl_record_queue_taken taken[TL_WRITER_QUEUES];
} tl_recorder_mark;

/* Returns the number of written samples, steps and events of the run, without own events. */
uint64_t tl_recorder_mark_entries(const tl_recorder_mark *mark);

/* Adds `more` to the run's lost entries, totals.lost, up to an upper limit. */
void tl_recorder_mark_lose(tl_recorder_mark *mark, uint64_t more);

/* Fields are private except `taken`: each producer reads its own element. */
typedef struct tl_recorder_writer_state {
    tl_record_queue_taken taken[TL_WRITER_QUEUES];
    tl_recorder_mark marks[2];
    uint32_t current;  /* index of the committed mark; the other one is not committed yet */
    uint64_t own_next; /* number of the next own event */
    tl_recorder_event_entry own[TL_WRITER_OWN_EVENTS];
    uint64_t written; /* from here on: as in tl_recorder_state_counts, published for other threads */
    uint64_t dropped;
    int64_t run;
    uint32_t tuning;
    tl_time refused_since;
} tl_recorder_writer_state;

/* ---- functions of the writer ---- */

/* Returns the mark of the last commit. */
const tl_recorder_mark *tl_recorder_state_mark(const tl_recorder_writer_state *state);

/* Returns the mark of the commit that was in progress when the previous writer ended; it may have
 * been committed. Returns NULL if there was none. */
const tl_recorder_mark *tl_recorder_state_tried(const tl_recorder_writer_state *state);

/* Stores the mark of the coming commit. Its number must be that of the committed mark plus 1. */
void tl_recorder_state_try(tl_recorder_writer_state *state, const tl_recorder_mark *mark);

/* Makes the tried mark the committed one and publishes it. */
void tl_recorder_state_commit(tl_recorder_writer_state *state);

/* Leaves the run's file: the run will begin again in the next file. `gone`: the file is lost, so
 * the run's entries in it count as dropped and lost. Needs about 40 kB of stack. */
void tl_recorder_state_leave_file(tl_recorder_writer_state *state, bool gone);

/* Publishes the committed mark: its progress becomes visible to producers and other threads. A new
 * writer calls it, because the previous one may have been killed inside tl_recorder_state_commit().
 */
void tl_recorder_state_publish(tl_recorder_writer_state *state);

/* Stores an own event until a file can be written. If 8 events wait, the new one overwrites the
 * newest of them. `tick` −1: no tick. */
void tl_recorder_state_add_event(tl_recorder_writer_state *state, int64_t tick, tl_severity severity,
                                 const char *source, const char *text);

/* ---- functions for any thread or process ---- */

typedef struct tl_recorder_state_counts {
    uint64_t written;      /* entries and events in a file, without the writer's own events */
    uint64_t dropped;      /* entries and events that the producer put, but that are in no file */
    int64_t run;           /* id of the newest run; 0: none yet */
    uint32_t tuning;       /* number of the newest tuning recorded with its configuration; 0: none */
    tl_time refused_since; /* since when writing fails, CLOCK_MONOTONIC, ns; 0: writing works */
} tl_recorder_state_counts;

tl_recorder_state_counts tl_recorder_state_get(const tl_recorder_writer_state *state);

#endif
