/* What a writer of runs leaves to its successor: how far everything has been written.
 *
 * Purpose: a process that writes may be killed at any instant, and its successor must write each entry once. So before a commit a mark says
 *          how far things will be after it, beside the mark of how far they are. The successor finds in the database which of the two holds: the run's
 *          row has the same totals.
 * Memory:  the caller's, zeroed at first: of this process, or a block that outlives it and that only writers write. No pointers.
 * Thread:  one writes; the counts, and what has been taken, may be read by any thread and process.
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

enum { TL_WRITER_QUEUES = 8, TL_WRITER_OWN_EVENTS = 8 };

/* How far everything has been written. */
typedef struct tl_recorder_mark {
    uint64_t number;               /* of the batch; 0: none */
    char path[PATH_MAX];           /* of the file; "": none yet */
    tl_database_identity identity; /* which one that is */
    int64_t run;                   /* its row in there; 0: it has none yet */
    bool has_begun;
    bool is_untimed; /* it began without a START: it is on no clock */
    bool has_ended;
    bool hands_over; /* it has ended so that a run from another ring goes on */
    uint32_t ring;   /* the outbox from which it came */
    bool is_again;   /* its beginning is in another file, and here it has no sample yet */
    tl_record_queue_start start;
    tl_recorder_totals totals;       /* of the row, */
    uint64_t own;                    /* and how many of its events are the writer's own */
    tl_run_tuning tuning;            /* in force: the newest one of the run that was written; its hash "": none */
    uint64_t written;                /* entries and events of all runs, */
    uint64_t dropped;                /* and those that a file took with it, or that belonged to no run */
    uint64_t said;                   /* number of the first of the writer's own events that is not written */
    uint64_t lost[TL_WRITER_QUEUES]; /* what the producers have lost, as far as totals know it, */
    tl_time counted;                 /* and when that was looked at */
    uint64_t id;                     /* of the run in its ring; 0: it has none */
    int64_t sampled;                 /* the tick behind its newest sample; 0: it has none */
    bool is_cut;                     /* what came behind that in the ring was skipped */
    tl_record_queue_taken taken[TL_WRITER_QUEUES];
} tl_recorder_mark;

/* Entries and events of the run that were written; the writer's own events are not counted. */
uint64_t tl_recorder_mark_entries(const tl_recorder_mark *mark);

/* So many more are lost of the run. */
void tl_recorder_mark_lose(tl_recorder_mark *mark, uint64_t more);

/* Fields are private but for `taken`: there each producer looks, in its own. */
typedef struct tl_recorder_writer_state {
    tl_record_queue_taken taken[TL_WRITER_QUEUES];
    tl_recorder_mark marks[2];
    uint32_t current;  /* the mark that is committed; the other one is being committed, or was not */
    uint64_t own_said; /* number of the next of the writer's own events */
    tl_recorder_event_entry own[TL_WRITER_OWN_EVENTS];
    uint64_t written; /* to be shown */
    uint64_t dropped;
    int64_t run;
    uint32_t tuning;
    tl_time refused_since;
} tl_recorder_writer_state;

/* ---- the writer's ---- */

/* What is committed. */
const tl_recorder_mark *tl_recorder_state_mark(const tl_recorder_writer_state *state);

/* What was going to be committed when the writer before us ended, and perhaps is; NULL: nothing was. */
const tl_recorder_mark *tl_recorder_state_tried(const tl_recorder_writer_state *state);

/* Before the commit: how far things will be. Its number must be that of what is committed, plus 1. */
void tl_recorder_state_try(tl_recorder_writer_state *state, const tl_recorder_mark *mark);

/* What was tried is committed. */
void tl_recorder_state_settle(tl_recorder_writer_state *state);

/* The run is in a file that is not written any more: it begins again in the next one. `gone`: and that one is no more. Takes some 20 KB of stack. */
void tl_recorder_state_leave_run(tl_recorder_writer_state *state, bool gone);

/* Lets others see what is committed, as settle() does: for a writer that begins, since the one before may have been killed within it. */
void tl_recorder_state_show(tl_recorder_writer_state *state);

/* An event of the writer's own, until there is a file to write it into. There is room for a few: the newest takes the place of the one before it. */
void tl_recorder_state_say(tl_recorder_writer_state *state, tl_severity severity, const char *text);

/* ---- any thread's or process's ---- */

typedef struct tl_recorder_state_counts {
    uint64_t written; /* entries and events that are in a file; the writer's own are not counted */
    uint64_t dropped; /* that are in none, though their producers have not lost them */
    int64_t run;      /* id of the newest run; 0: none yet */
    uint32_t tuning;  /* number of the newest tuning that is in a file, and its configuration's text with it; 0: none */
    tl_time refused_since; /* CLOCK_MONOTONIC; 0: what is to be written can be */
} tl_recorder_state_counts;

tl_recorder_state_counts tl_recorder_state_get(const tl_recorder_writer_state *state);

#endif
