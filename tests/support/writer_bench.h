/* Test bench for the recorder's writer (recorder_writer.h): record queues of a twin, of its I/O and
 * of a second twin, the writer's state, and a database in a temporary folder.
 *
 * Memory: queues and state are shared with child processes, so that a child can write and die.
 * Use:    tl_scratch_make() in main(), tl_writer_bench_begin() in setUp(), tl_writer_bench_end() in
 *         tearDown().
 * Errors: an unexpected error fails the test.
 * Thread: one.
 */
#ifndef TL_TESTS_SUPPORT_WRITER_BENCH_H
#define TL_TESTS_SUPPORT_WRITER_BENCH_H

#include <limits.h>
#include <stddef.h>
#include <sys/types.h>

#include "firmware/store/recorder_writer.h"
#include "tests/support/scratch.h"

enum { TL_BENCH_TWIN, TL_BENCH_IO, TL_BENCH_OTHER, TL_BENCH_QUEUES };
enum { TL_BENCH_CHECKPOINT = 20000 };

/* The reason with which a run ends if the run in the other queue continues it. */
#define TL_BENCH_HAND_OVER "hand over"

typedef struct tl_writer_bench {
    tl_scratch scratch;
    char path[PATH_MAX]; /* run.db */
    tl_recorder_settings record;
    tl_record_queue_settings settings[TL_BENCH_QUEUES];
    tl_recorder_writer_queue queues[TL_BENCH_QUEUES];
    void *memory[TL_BENCH_QUEUES];
    size_t bytes[TL_BENCH_QUEUES];
    tl_record_queue twin;
    tl_record_queue io;
    tl_record_queue other;
    size_t ring;    /* queue that is read: TL_BENCH_TWIN (default) or TL_BENCH_OTHER */
    bool continues; /* result of the callback continues() */
    tl_recorder_writer_state *state;
    bool is_last;                                                 /* see recorder_writer.h */
    void (*observe)(void *bench, const tl_recorder_entry *entry); /* NULL: none */
    tl_recorder_plant plant;                                      /* see recorder_writer.h */
    tl_recorder_writer *writer;                                   /* NULL: not open */
    tl_error error;
    pid_t child; /* running child process; 0: none */
} tl_writer_bench;

void tl_writer_bench_begin(tl_writer_bench *bench);
void tl_writer_bench_end(tl_writer_bench *bench);

/* Empties queues and state, as a restart of the program does. Files are kept. */
void tl_writer_bench_forget(tl_writer_bench *bench);

/* Open and close a writer that continues with the state. */
tl_status tl_writer_bench_try_open(tl_writer_bench *bench);
void tl_writer_bench_open(tl_writer_bench *bench);
tl_status tl_writer_bench_close(tl_writer_bench *bench); /* does not wait */
void tl_writer_bench_close_well(tl_writer_bench *bench); /* all entries must be written */

/* Writes repeatedly until this number of entries and events is written. */
void tl_writer_bench_write_until(tl_writer_bench *bench, uint64_t written);

/* A child opens the writer and calls `write` in a loop until it is killed at the time `until`.
 * Meanwhile this process calls `put` in a loop. */
void tl_writer_bench_live(tl_writer_bench *bench, tl_time until, void (*write)(void), void (*put)(void));

/* Put the start of a synthetic run (made_run.h), and ticks with one step each. */
void tl_writer_bench_start(tl_writer_bench *bench, tl_time start);
void tl_writer_bench_put(tl_writer_bench *bench, int64_t first, int64_t ticks);

/* Records a complete run of this many ticks into the existing file. */
void tl_writer_bench_record(tl_writer_bench *bench, int64_t ticks);

/* Each run in the database has the counts of its row, and each tick and step is complete and
 * unique. */
void tl_writer_bench_expect_whole(const char *path);

/* Counts the writer's own events whose text has all parts, see message.h. */
int64_t tl_writer_bench_count_own(const char *path, const char *parts);

#endif
