/* A writer under test (recorder_writer.h): outboxes of a twin, of its io and of another twin, its state, and a database in a folder that is empty again after each test.
 *
 * Memory: outboxes and state are shared with the children of this process, so that one of them may write and be killed.
 * Use:    tl_scratch_make() in main(), tl_writer_bench_begin() in setUp(), tl_writer_bench_end() in tearDown().
 * Errors: what does not go well fails the test.
 * Thread: one thread.
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

/* The reason with which a run in one ring hands over to one in the other. */
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
    size_t ring;  /* that is read: of the twin, at first, or of the other one; the outbox without is not there then */
    bool goes_on; /* as in recorder_writer.h: what that says */
    tl_recorder_writer_state *state;
    bool is_last;               /* as in recorder_writer.h, */
    tl_recorder_plant plant;    /* as this */
    tl_recorder_writer *writer; /* NULL: none is open */
    tl_error error;
    pid_t child; /* that lives; 0: none */
} tl_writer_bench;

void tl_writer_bench_begin(tl_writer_bench *bench);
void tl_writer_bench_end(tl_writer_bench *bench);

/* The outboxes are empty, and the state knows nothing: another start of the program. Files stay. */
void tl_writer_bench_forget(tl_writer_bench *bench);

/* A writer that goes on with the state. */
tl_status tl_writer_bench_try_open(tl_writer_bench *bench);
void tl_writer_bench_open(tl_writer_bench *bench);
tl_status tl_writer_bench_close(tl_writer_bench *bench); /* without patience */
void tl_writer_bench_close_well(tl_writer_bench *bench); /* nothing is left */

/* Writes every now and then, until so many entries and events are written. */
void tl_writer_bench_write_until(tl_writer_bench *bench, uint64_t written);

/* A life: a child opens the writer and calls `write` for ever, and at `until` it is killed, at whatever it does. Meanwhile this process calls `put`. */
void tl_writer_bench_live(tl_writer_bench *bench, tl_time until, void (*write)(void), void (*put)(void));

/* The beginning of a run that is made up, and some ticks of it (made_run.h), a step for each. */
void tl_writer_bench_start(tl_writer_bench *bench, tl_time start);
void tl_writer_bench_put(tl_writer_bench *bench, int64_t first, int64_t ticks);

/* A run of so many ticks, from its beginning to its end, into the file as it is. */
void tl_writer_bench_record(tl_writer_bench *bench, int64_t ticks);

/* Of the database: every run has what its row says, each tick and step once and whole. */
void tl_writer_bench_expect_whole(const char *path);

/* How many events of the writer's own are in there, by SQL's LIKE. */
int64_t tl_writer_bench_count_own(const char *path, const char *pattern);

#endif
