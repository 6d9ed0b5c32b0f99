/* Test bench for the recorder: its database in a temporary folder, and its last results.
 *
 * Use:    tl_scratch_make() in main(), tl_bench_begin() in setUp(), tl_bench_end() in tearDown().
 * Errors: an unexpected error fails the test.
 * Thread: one.
 */
#ifndef TL_TESTS_SUPPORT_RECORDER_BENCH_H
#define TL_TESTS_SUPPORT_RECORDER_BENCH_H

#include <limits.h>

#include "firmware/store/recorder.h"
#include "tests/support/scratch.h"

typedef struct tl_recorder_bench {
    tl_scratch scratch;
    char path[PATH_MAX];    /* run.db */
    char wal[PATH_MAX + 8]; /* run.db-wal, SQLite's log */
    tl_recorder *recorder;  /* NULL: not open */
    tl_recorder_counts counts;
    tl_error error;
} tl_recorder_bench;

void tl_bench_begin(tl_recorder_bench *bench);
void tl_bench_end(tl_recorder_bench *bench);

/* The status is TL_OK, and there is no error text. */
void tl_bench_expect_ok(const tl_recorder_bench *bench, tl_status status);

void tl_bench_open(tl_recorder_bench *bench, const tl_recorder_settings *settings);
void tl_bench_close(tl_recorder_bench *bench, const char *reason);

#endif
