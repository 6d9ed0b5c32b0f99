/* The recorder's bound: its files never exceed max_bytes. The oldest entries are removed first. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include <sqlite3.h>

#include "firmware/store/recorder.h"
#include "tests/support/made_run.h"
#include "tests/support/recorder_bench.h"
#include "tests/support/sql.h"

enum { MIB = 1024 * 1024 };

static tl_recorder_bench bench;

void setUp(void) {
    tl_bench_begin(&bench);
}

void tearDown(void) {
    tl_bench_end(&bench);
}

static tl_recorder_settings bounded(int64_t max_bytes) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.max_bytes = max_bytes;
    return settings;
}

static void close_recorder(void) {
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(0, bench.counts.lost);
}

static int64_t size_of(const char *name) {
    struct stat status;
    return stat(name, &status) == 0 ? (int64_t)status.st_size : 0;
}

static int64_t size_on_disk(void) {
    return size_of(bench.path) + size_of(bench.wal);
}

/* Puts ticks. Returns the largest size on disk meanwhile. */
static int64_t put_watched(int64_t first, int64_t ticks) {
    int64_t most = 0;
    for (int64_t tick = first; tick < first + ticks; tick += 50) {
        tl_made_put(bench.recorder, tick, 50);
        int64_t size = size_on_disk();
        most = size > most ? size : most;
    }
    return most;
}

/* A tick needs about 260 bytes on disk, so that 80,000 ticks need 20 MiB. */
static void expect_bound_within_one_run(int64_t max_bytes, int64_t ticks) {
    const tl_recorder_settings settings = bounded(max_bytes);
    tl_bench_open(&bench, &settings);
    tl_recorder_event(bench.recorder, 0, TL_EVENT_INFO, "cycle", "the first event");
    int64_t most = put_watched(0, ticks);
    close_recorder();
    TEST_ASSERT_LESS_OR_EQUAL_INT64(max_bytes, most);
    TEST_ASSERT_LESS_OR_EQUAL_INT64(max_bytes, size_on_disk());
    TEST_ASSERT_GREATER_THAN_INT64(max_bytes / 2, size_on_disk());
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
    TEST_ASSERT_EQUAL_INT64(2 * ticks - 2 + 1, bench.counts.written);
    TEST_ASSERT_EQUAL_INT64(ticks, tl_sql_integer(bench.path, "SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_STRING("the first event", tl_sql_text(bench.path, "SELECT text FROM events"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(*) FROM configurations"));
}

/* The end of the run is complete, and removed_before is its first tick. */
static void expect_whole_end(int64_t ticks) {
    int64_t first = tl_sql_integer(bench.path, "SELECT removed_before FROM runs");
    TEST_ASSERT_GREATER_THAN_INT64(0, first);
    TEST_ASSERT_EQUAL_INT64(first, tl_sql_integer(bench.path, "SELECT min(tick) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(first, tl_sql_integer(bench.path, "SELECT min(step) FROM steps"));
    TEST_ASSERT_EQUAL_INT64(first, tl_sql_integer(bench.path, "SELECT min(step) FROM outputs"));
    TEST_ASSERT_EQUAL_INT64(first, tl_sql_integer(bench.path, "SELECT min(step) FROM adjustments"));
    TEST_ASSERT_EQUAL_INT64(ticks - 1, tl_sql_integer(bench.path, "SELECT max(tick) FROM samples"));
    TEST_ASSERT_EQUAL_INT64((ticks - first) * TL_MADE_PLANT,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(ticks - first - 2, tl_sql_integer(bench.path, "SELECT count(*) FROM steps"));
}

static void test_within_one_run(void) {
    expect_bound_within_one_run(2 * MIB, 80000);
    expect_whole_end(80000);
}

static void test_the_smallest_bound(void) {
    expect_bound_within_one_run(1000000, 20000);
    expect_whole_end(20000);
}

static void test_several_runs(void) {
    enum { RUNS = 8, TICKS = 10000 };
    static char configuration[200000];
    int64_t most = 0;
    for (int run = 1; run <= RUNS; run++) {
        tl_recorder_settings settings = bounded(2 * MIB);
        memset(configuration, 'a' + run, sizeof configuration - 1); /* large and different */
        settings.configuration = configuration;
        tl_bench_open(&bench, &settings);
        tl_recorder_event(bench.recorder, 0, TL_EVENT_INFO, "cycle", "an event");
        int64_t seen = put_watched(0, TICKS);
        close_recorder();
        most = seen > most ? seen : most;
        most = size_on_disk() > most ? size_on_disk() : most;
    }
    TEST_ASSERT_LESS_OR_EQUAL_INT64(2 * MIB, most);
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
    /* Minutes and hours of all runs remain, and the texts of configurations that have ticks. */
    TEST_ASSERT_EQUAL_INT64(RUNS, tl_sql_integer(bench.path, "SELECT count(DISTINCT run) FROM v_hours"));
    TEST_ASSERT_EQUAL_INT64(RUNS * TICKS, tl_sql_integer(bench.path, "SELECT sum(samples_written) FROM runs"));
    int64_t recorded = tl_sql_integer(bench.path, "SELECT count(DISTINCT run) FROM samples");
    TEST_ASSERT_LESS_THAN_INT64(4, recorded);
    TEST_ASSERT_EQUAL_INT64(recorded,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM configurations WHERE text <> ''"));
}

/* A run of which nothing remains is removed. Here the periods are removed by hand. */
static void test_an_empty_run(void) {
    const tl_recorder_settings settings = bounded(1000000);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 1000);
    close_recorder();
    tl_sql_execute(bench.path, "DELETE FROM periods; DELETE FROM events");
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 10000);
    close_recorder();
    static const char *const tables[] = {"runs", "signals", "components", "beginnings", "tunings", "samples", "steps"};
    for (size_t i = 0; i < sizeof tables / sizeof tables[0]; i++) {
        char sql[128];
        (void)snprintf(sql, sizeof sql, "SELECT count(*) FROM %s WHERE run = 1", tables[i]);
        TEST_ASSERT_EQUAL_INT64_MESSAGE(0, tl_sql_integer(bench.path, sql), tables[i]);
    }
}

static void test_a_partly_removed_run(void) {
    tl_recorder_settings settings = bounded(0);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 6000);
    close_recorder();
    settings = bounded(2 * MIB);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 1000);
    close_recorder();
    int64_t mark = tl_sql_integer(bench.path, "SELECT removed_before FROM runs WHERE runs.run = 1");
    TEST_ASSERT_GREATER_THAN_INT64(0, mark);
    TEST_ASSERT_EQUAL_INT64(mark, tl_sql_integer(bench.path, "SELECT min(tick) FROM samples WHERE samples.run = 1"));
    TEST_ASSERT_EQUAL_INT64(mark, tl_sql_integer(bench.path, "SELECT min(step) FROM steps WHERE steps.run = 1"));
    TEST_ASSERT_EQUAL_INT64(5999, tl_sql_integer(bench.path, "SELECT max(tick) FROM samples WHERE samples.run = 1"));
    TEST_ASSERT_EQUAL_INT64(1,
                            tl_sql_integer(bench.path, "SELECT removed_before IS NULL FROM runs WHERE runs.run = 2"));
    TEST_ASSERT_EQUAL_INT64(6000, tl_sql_integer(bench.path, "SELECT samples_written FROM runs WHERE runs.run = 1"));
}

/* The file shrinks to a lower bound during the run. */
static void test_a_lowered_bound(void) {
    tl_recorder_settings settings = bounded(0);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 40000);
    close_recorder();
    TEST_ASSERT_GREATER_THAN_INT64(8 * MIB, size_on_disk());
    settings = bounded(2 * MIB);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 20000);
    close_recorder();
    TEST_ASSERT_LESS_OR_EQUAL_INT64(2 * MIB, size_on_disk());
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(DISTINCT run) FROM samples"));
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
}

/* The queue has 512 places for events. */
static void wait_for_events(int put) {
    for (int i = 0; i < 1000 && tl_recorder_get_counts(bench.recorder).written < (uint64_t)put; i++) {
        usleep(5000);
    }
}

/* Events of the current run are removed only if nothing else can be removed. */
static void test_events_alone(void) {
    const tl_recorder_settings settings = bounded(1000000);
    char text[200];
    int64_t most = 0;
    memset(text, 'e', sizeof text - 1);
    text[sizeof text - 1] = '\0';
    tl_bench_open(&bench, &settings);
    for (int i = 0; i < 8000; i++) {
        tl_recorder_event(bench.recorder, i, TL_EVENT_WARNING, "plant", text);
        if (i % 200 == 0) {
            tl_made_put(bench.recorder, i, 2);
            wait_for_events(i);
            most = size_on_disk() > most ? size_on_disk() : most;
        }
    }
    close_recorder();
    TEST_ASSERT_LESS_OR_EQUAL_INT64(1000000, most);
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(1000, tl_sql_integer(bench.path, "SELECT count(*) FROM events"));
    TEST_ASSERT_EQUAL_INT64(7999, tl_sql_integer(bench.path, "SELECT max(tick) FROM events"));
    TEST_ASSERT_EQUAL_INT64(8000, tl_sql_integer(bench.path, "SELECT events_written FROM runs"));
}

/* A long read keeps SQLite from writing the log back. The recorder waits, keeps the bound, and
 * reports the reason. */
static void test_a_long_read(void) {
    const tl_recorder_settings settings = bounded(1000000);
    sqlite3 *reader = NULL;
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 10);
    usleep(100000);
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(bench.path, &reader));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_exec(reader, "BEGIN; SELECT count(*) FROM samples", NULL, NULL, NULL));
    int64_t most = 0;
    for (int64_t tick = 10; tick < 6010; tick += 50) {
        tl_made_put(bench.recorder, tick, 50);
        usleep(10000);
        most = size_on_disk() > most ? size_on_disk() : most;
    }
    uint64_t written = 0;
    while (tl_recorder_get_counts(bench.recorder).written != written) { /* until it waits for the reader */
        written = tl_recorder_get_counts(bench.recorder).written;
        sleep(1);
    }
    TEST_ASSERT_LESS_OR_EQUAL_INT64(1000000, most);
    TEST_ASSERT_LESS_THAN_UINT64(12000, written);
    (void)sqlite3_close(reader);
    tl_recorder *closing = bench.recorder;
    bench.recorder = NULL;
    tl_bench_expect_ok(&bench, tl_recorder_close(closing, "end", &bench.counts, &bench.error));
    TEST_ASSERT_EQUAL_INT64(12018, bench.counts.written + bench.counts.lost);
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_count_events(bench.path, "recorder", "program|locked"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_count_events(bench.path, "recorder", "after|s"));
    TEST_ASSERT_LESS_OR_EQUAL_INT64(1000000, size_on_disk());
}

int main(void) {
    /* In memory if possible, because a disk would sync 10,000 times. */
    tl_scratch_make(&bench.scratch, access("/dev/shm", W_OK) == 0 ? "/dev/shm" : TL_BINARY_DIR, "test_recorder_bound");
    UNITY_BEGIN();
    RUN_TEST(test_within_one_run);
    RUN_TEST(test_the_smallest_bound);
    RUN_TEST(test_several_runs);
    RUN_TEST(test_an_empty_run);
    RUN_TEST(test_a_partly_removed_run);
    RUN_TEST(test_a_lowered_bound);
    RUN_TEST(test_events_alone);
    RUN_TEST(test_a_long_read);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
