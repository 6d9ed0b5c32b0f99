/* See recorder_bench.h. */
#include "tests/support/recorder_bench.h"

#include <stdio.h>
#include <unity.h>

void tl_bench_begin(tl_recorder_bench *bench) {
    (void)snprintf(bench->path, sizeof bench->path, "%s", tl_scratch_path(&bench->scratch, "run.db"));
    (void)snprintf(bench->wal, sizeof bench->wal, "%s-wal", bench->path);
    bench->recorder = NULL;
    bench->error = (tl_error){TL_OK, ""};
}

void tl_bench_end(tl_recorder_bench *bench) {
    if (bench->recorder != NULL) {
        (void)tl_recorder_close(bench->recorder, "test failed", NULL, NULL);
    }
    tl_scratch_empty(&bench->scratch);
}

void tl_bench_expect_ok(const tl_recorder_bench *bench, tl_status status) {
    TEST_ASSERT_EQUAL_STRING("", bench->error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

void tl_bench_open(tl_recorder_bench *bench, const tl_recorder_settings *settings) {
    tl_bench_expect_ok(bench, tl_recorder_open(settings, &bench->recorder, &bench->error));
}

void tl_bench_close(tl_recorder_bench *bench, const char *reason) {
    tl_recorder *closing = bench->recorder;
    bench->recorder = NULL;
    tl_bench_expect_ok(bench, tl_recorder_close(closing, reason, &bench->counts, &bench->error));
}
