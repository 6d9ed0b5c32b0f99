/* The recorder on a disk that is full, broken, locked or slow, or that loses power, and in a
 * process that is killed.
 *
 * With `--write PATH`, the program is the process that is killed. */
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <spawn.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "tests/support/faulty_vfs.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/recorder_bench.h"
#include "tests/support/sql.h"

enum { THREADS = 6, EVENTS_EACH = 2000, WRITTEN_AT_ONCE = 400 };

static const tl_time HURRY = TL_SECOND / 5; /* patience of a recorder that must give up */

extern char **environ;

static tl_recorder_bench bench;

void setUp(void) {
    tl_bench_begin(&bench);
}

static void repair_disk(void) {
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    tl_faulty_vfs_slow(0);
}

void tearDown(void) {
    repair_disk();
    tl_bench_end(&bench);
}

static double seconds(void) {
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + (double)time.tv_nsec / 1e9;
}

static void open_recorder(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_bench_open(&bench, &settings);
}

static tl_status close_recorder(void) {
    tl_recorder *closing = bench.recorder;
    bench.recorder = NULL;
    return tl_recorder_close(closing, "end", &bench.counts, &bench.error);
}

/* Tests wait for the result of the writer's thread, not for a fixed time, because a busy machine
 * may delay the thread. They fail after WAITS. */
enum { WAITS = 24000, WAIT_US = 5000 };

/* Waits until a counter of the disk has this value: the recorder has seen the fault. */
static void wait_for(uint64_t (*counter)(void), uint64_t wanted) {
    for (int i = 0; i < WAITS && counter() < wanted; i++) {
        usleep(WAIT_US);
    }
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(wanted, counter());
}

static void wait_for_refusals(uint64_t wanted) {
    wait_for(tl_faulty_vfs_refusals, wanted);
}

static void wait_for_written(uint64_t wanted) {
    for (int i = 0; i < WAITS && tl_recorder_get_counts(bench.recorder).written < wanted; i++) {
        usleep(WAIT_US);
    }
}

/* Waits until this number is written or a write is refused. */
static void wait_for_written_or_refused(uint64_t wanted, uint64_t refusals) {
    for (int i = 0;
         i < WAITS && tl_recorder_get_counts(bench.recorder).written < wanted && tl_faulty_vfs_refusals() == refusals;
         i++) {
        usleep(WAIT_US / 5);
    }
}

/* Each tick has all its signals, each step all its outputs. */
static void expect_nothing_missing(void) {
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM (SELECT count(*) AS n FROM samples"
                                                          " GROUP BY run, tick) WHERE n <> 3"));
    TEST_ASSERT_EQUAL_INT64(0,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM steps s WHERE 2 <> (SELECT count(*) FROM"
                                                       " outputs o WHERE o.run = s.run AND o.step = s.step)"));
}

/* The database agrees with the counts and the run's row, and each batch is complete. */
static void expect_whole(int64_t written) {
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path,
                                              "SELECT count(*) FROM runs WHERE samples_written <>"
                                              " (SELECT count(DISTINCT tick) FROM samples s WHERE s.run = runs.run)"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs WHERE steps_written <>"
                                                          " (SELECT count(*) FROM steps s WHERE s.run = runs.run)"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs WHERE events_written <>"
                                                          " (SELECT count(*) FROM events s WHERE s.run = runs.run)"));
    expect_nothing_missing();
    TEST_ASSERT_EQUAL_INT64(0,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM steps s WHERE 2 <> (SELECT count(*) FROM"
                                                       " adjustments o WHERE o.run = s.run AND o.step = s.step)"));
    if (written >= 0) {
        TEST_ASSERT_EQUAL_INT64(
            written, tl_sql_integer(bench.path, "SELECT (SELECT count(DISTINCT tick) FROM samples) + (SELECT count(*)"
                                                " FROM steps) + (SELECT count(*) FROM events WHERE source <>"
                                                " 'recorder')"));
    }
}

static int64_t count_events(const char *parts) {
    return tl_sql_count_events(bench.path, "recorder", parts);
}

/* ---- Full and broken ---- */

/* The recorder reports the fault once, with SQLite's reason, and its end once. */
static void expect_recovery(int code, const char *reason) {
    char sql[128];
    open_recorder();
    tl_made_put(bench.recorder, 0, 100);
    wait_for_written(198);
    uint64_t before = tl_faulty_vfs_refusals();
    tl_faulty_vfs_refuse(code, 0);
    tl_made_put(bench.recorder, 100, 200);
    wait_for_refusals(before + 4); /* several tries */
    tl_made_put(bench.recorder, 300, 200);
    TEST_ASSERT_EQUAL_UINT64(198, tl_recorder_get_counts(bench.recorder).written);
    repair_disk();
    wait_for_written(998);
    tl_made_put(bench.recorder, 500, 100);
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(0, bench.counts.lost);
    TEST_ASSERT_EQUAL_UINT64(1198, bench.counts.written);
    expect_whole(1198);
    TEST_ASSERT_EQUAL_INT64(1, count_events(reason));
    TEST_ASSERT_EQUAL_INT64(1, count_events("after|s"));
    TEST_ASSERT_EQUAL_INT64(0, count_events("lost"));
    (void)snprintf(sql, sizeof sql, "SELECT severity FROM events WHERE text LIKE '%%%s%%'", reason);
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, sql));
}

static void test_a_full_disk_is_survived(void) {
    expect_recovery(SQLITE_FULL, "disk is full");
}

static void test_a_broken_disk_is_survived(void) {
    expect_recovery(SQLITE_IOERR_WRITE, "disk I/O error");
}

/* The fault happens at each write of a batch, a checkpoint or a rollback. */
static void test_a_fault_at_any_write(void) {
    open_recorder();
    int64_t tick = 0;
    for (uint64_t after = 0; after < 60; after++) {
        uint64_t before = tl_faulty_vfs_refusals();
        tl_faulty_vfs_refuse(after % 2 == 0 ? SQLITE_FULL : SQLITE_IOERR_WRITE, after);
        for (int i = 0; i < 400 && tl_faulty_vfs_refusals() == before; i++) {
            tl_made_put(bench.recorder, tick, 100);
            tick += 100;
            wait_for_written_or_refused((uint64_t)(2 * tick - 2), before);
        }
        tl_faulty_vfs_refuse(SQLITE_OK, 0);
        wait_for_written((uint64_t)(2 * tick - 2));
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(0, bench.counts.lost);
    TEST_ASSERT_EQUAL_UINT64(2 * tick - 2, bench.counts.written);
    expect_whole(2 * tick - 2);
}

/* The ring overflows: the lost entries are counted and reported, and the sum is right. */
static void test_a_long_fault(void) {
    enum { TICKS = 20000 };
    open_recorder();
    tl_made_put(bench.recorder, 0, 100);
    wait_for_written(198);
    uint64_t before = tl_faulty_vfs_refusals();
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    double began = seconds();
    tl_made_put(bench.recorder, 100, TICKS - 100); /* 4 MB into a ring of 1 MiB */
    TEST_ASSERT_TRUE(seconds() - began < 20.0);    /* 2 s of patience */
    wait_for_refusals(before + 2);
    uint64_t lost = tl_recorder_get_counts(bench.recorder).lost;
    TEST_ASSERT_GREATER_THAN_UINT64(1000, lost);
    repair_disk();
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(lost, bench.counts.lost);
    TEST_ASSERT_EQUAL_UINT64(2 * TICKS - 2, bench.counts.written + bench.counts.lost);
    expect_whole((int64_t)bench.counts.written);
    TEST_ASSERT_EQUAL_INT64(lost, tl_sql_integer(bench.path, "SELECT entries_lost FROM runs"));
    char pattern[64];
    (void)snprintf(pattern, sizeof pattern, "%llu|lost", (unsigned long long)lost);
    TEST_ASSERT_EQUAL_INT64(1, count_events(pattern));
}

static void test_close_gives_up_on_a_disk_that_stays_full(void) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.patience = HURRY;
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 100);
    wait_for_written(198);
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    tl_made_put(bench.recorder, 100, 100);
    tl_recorder_event(bench.recorder, 5, TL_EVENT_INFO, "cycle", "the last word");
    double began = seconds();
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, close_recorder());
    TEST_ASSERT_TRUE(seconds() - began < 5.0);
    TL_EXPECT_PARTS("/run.db|201 entries|disk is full", bench.error.text);
    TEST_ASSERT_EQUAL_UINT64(198, bench.counts.written);
    TEST_ASSERT_EQUAL_UINT64(201, bench.counts.lost);
    repair_disk();
    expect_whole(198);
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT ended IS NULL FROM runs"));
    bench.error = (tl_error){TL_OK, ""};
    open_recorder();
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_STRING("not ended cleanly",
                             tl_sql_text(bench.path, "SELECT ended_reason FROM runs WHERE runs.run = 1"));
}

static void test_a_disk_that_is_full_from_the_start(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_recorder_open(&settings, &bench.recorder, &bench.error));
    TEST_ASSERT_NULL(bench.recorder);
    TEST_ASSERT_EQUAL_INT(0, tl_scratch_count(&bench.scratch)); /* no incomplete file */
    for (uint64_t writes = 1; writes < 60; writes++) {          /* full during the creation */
        tl_faulty_vfs_refuse(SQLITE_FULL, writes);
        tl_status status = tl_recorder_open(&settings, &bench.recorder, &bench.error);
        TEST_ASSERT_TRUE(status == TL_OK || status == TL_TRY_AGAIN);
        repair_disk();
        if (bench.recorder != NULL) {
            (void)close_recorder();
        }
    }
    bench.error = (tl_error){TL_OK, ""};
    open_recorder();
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
}

/* The recorder must not write into a file that was moved away: the run continues in a new file. */
static void test_a_file_that_is_moved_away(void) {
    char elsewhere[PATH_MAX + 8];
    (void)snprintf(elsewhere, sizeof elsewhere, "%s.moved", bench.path);
    open_recorder();
    tl_made_put(bench.recorder, 0, 100);
    wait_for_written(198);
    TEST_ASSERT_EQUAL_INT(0, rename(bench.path, elsewhere));
    tl_made_put(bench.recorder, 100, 100);
    wait_for_written(398);
    tl_made_put(bench.recorder, 200, 100);
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(598, bench.counts.written);
    TEST_ASSERT_EQUAL_UINT64(0, bench.counts.lost);
    expect_whole(400);
    TEST_ASSERT_EQUAL_INT64(1, count_events("moved|198 samples"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(*) FROM events"));
    TEST_ASSERT_EQUAL_STRING("100|end|0", tl_sql_text(bench.path, "SELECT removed_before || '|' || ended_reason || '|'"
                                                                  " || entries_lost FROM runs"));
    /* The moved file has all committed data, because its log has another name now. */
    TEST_ASSERT_EQUAL_INT64(100, tl_sql_integer(elsewhere, "SELECT count(DISTINCT tick) FROM samples"));
    TEST_ASSERT_EQUAL_STRING("98|1", tl_sql_text(elsewhere, "SELECT steps_written || '|' || (ended IS NULL) FROM"
                                                            " runs"));
}

/* Entries in a removed file count as lost. */
static void test_a_file_that_is_removed(void) {
    open_recorder();
    tl_made_put(bench.recorder, 0, 100);
    wait_for_written(198);
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    tl_made_put(bench.recorder, 100, 100);
    tl_recorder_event(bench.recorder, 199, TL_EVENT_INFO, "cycle", "the file is gone");
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(201, bench.counts.written);
    TEST_ASSERT_EQUAL_UINT64(198, bench.counts.lost);
    expect_whole(201);
    TEST_ASSERT_EQUAL_INT64(1, count_events("removed|198 samples"));
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "SELECT count(*) FROM events"));
    TEST_ASSERT_EQUAL_STRING("100|end|198", tl_sql_text(bench.path, "SELECT removed_before || '|' || ended_reason ||"
                                                                    " '|' || entries_lost FROM runs"));
}

/* ---- Slow and locked ---- */

static void test_a_slow_disk_does_not_slow_the_cycle(void) {
    open_recorder();
    tl_faulty_vfs_slow(300000000);
    usleep(50000);
    double began = seconds();
    for (int64_t tick = 0; tick < 5000; tick += 100) {
        tl_made_put(bench.recorder, tick, 100);
        tl_recorder_event(bench.recorder, tick, TL_EVENT_INFO, "cycle", "tick");
        usleep(1000);
    }
    TEST_ASSERT_TRUE(seconds() - began < 10.0); /* 100 slow writes need 30 s */
    tl_faulty_vfs_slow(0);
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(9998 + 50, bench.counts.written + bench.counts.lost);
    expect_whole((int64_t)bench.counts.written);
}

static void test_a_replay_waits_for_a_slow_disk(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_bench_open(&bench, &settings);
    tl_faulty_vfs_slow(200000);
    tl_made_put(bench.recorder, 0, 20000);
    tl_faulty_vfs_slow(0);
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(0, bench.counts.lost);
    TEST_ASSERT_EQUAL_UINT64(39998, bench.counts.written);
    expect_whole(39998);
}

/* A replay does not wait forever for a disk that refuses writes. */
static void test_a_replay_does_not_hang_on_a_full_disk(void) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.patience = HURRY;
    tl_bench_open(&bench, &settings);
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    double began = seconds();
    tl_made_put(bench.recorder, 0, 20000);
    TEST_ASSERT_TRUE(seconds() - began < 10.0);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(39998, bench.counts.written + bench.counts.lost);
    TEST_ASSERT_EQUAL_UINT64(0, bench.counts.written);
}

static void test_a_lock_of_another_program_is_survived(void) {
    sqlite3 *other = NULL;
    open_recorder();
    tl_made_put(bench.recorder, 0, 100);
    wait_for_written(198);
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(bench.path, &other));
    (void)sqlite3_busy_timeout(other, 5000);
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_exec(other, "BEGIN IMMEDIATE", NULL, NULL, NULL));
    uint64_t locked = tl_faulty_vfs_locked();
    tl_made_put(bench.recorder, 100, 100);
    wait_for(tl_faulty_vfs_locked, locked + 20); /* SQLite tries at most 9 times in 100 ms */
    TEST_ASSERT_EQUAL_UINT64(198, tl_recorder_get_counts(bench.recorder).written);
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_exec(other, "COMMIT", NULL, NULL, NULL));
    wait_for_written(398);
    (void)sqlite3_close(other);
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(398, bench.counts.written);
    TEST_ASSERT_EQUAL_INT64(1, count_events("program|locked"));
    TEST_ASSERT_EQUAL_INT64(1, count_events("after|s"));
}

static void test_a_locked_database_cannot_be_opened(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    sqlite3 *other = NULL;
    open_recorder();
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(bench.path, &other));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_exec(other, "BEGIN IMMEDIATE", NULL, NULL, NULL));
    double began = seconds();
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_recorder_open(&settings, &bench.recorder, &bench.error));
    TEST_ASSERT_TRUE(seconds() - began > 1.5);
    TL_EXPECT_PARTS("/run.db|program|locked", bench.error.text);
    (void)sqlite3_close(other);
}

/* ---- Many threads ---- */

static void *put_events(void *context) {
    for (int i = 0; i < EVENTS_EACH; i++) {
        tl_recorder_event(bench.recorder, i, TL_EVENT_INFO, "thread", context);
        if (i % 50 == 0) {
            usleep(1000);
        }
    }
    return NULL;
}

static void test_events_of_many_threads(void) {
    static char names[THREADS][8] = {"one", "two", "three", "four", "five", "six"};
    pthread_t threads[THREADS];
    open_recorder();
    for (int i = 0; i < THREADS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, put_events, names[i]));
    }
    for (int64_t tick = 0; tick < 2000; tick += 20) {
        tl_made_put(bench.recorder, tick, 20);
        tl_recorder_event(bench.recorder, tick, TL_EVENT_INFO, "cycle", "tick");
        (void)tl_recorder_get_counts(bench.recorder);
        usleep(1000);
    }
    for (int i = 0; i < THREADS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_join(threads[i], NULL));
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
    TEST_ASSERT_EQUAL_UINT64(3998 + 100 + THREADS * EVENTS_EACH, bench.counts.written + bench.counts.lost);
    expect_whole((int64_t)bench.counts.written);
}

/* ---- Kill -9 and power cuts ---- */

/* Returns a reproducible number below `limit`. */
static uint32_t random_below(uint64_t *state, uint32_t limit) {
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)(*state >> 33) % limit;
}

/* The process that is killed: it writes until then. A bound makes it remove entries, too. */
static int write_forever(const char *where) {
    tl_recorder_settings settings = tl_made_settings(where);
    settings.commit = TL_SECOND / 500;
    settings.max_bytes = 4000000;
    tl_log_set_level(TL_LOG_ERROR);
    if (tl_recorder_open(&settings, &bench.recorder, &bench.error) != TL_OK) {
        (void)fprintf(stderr, "%s\n", bench.error.text);
        return EXIT_FAILURE;
    }
    uint64_t report_count = 0;
    for (int64_t tick = 0;; tick += 10) {
        tl_made_put(bench.recorder, tick, 10);
        tl_recorder_event(bench.recorder, tick, TL_EVENT_INFO, "cycle", "ten ticks");
        for (; report_count < tl_recorder_get_counts(bench.recorder).written / WRITTEN_AT_ONCE; report_count++) {
            if (write(STDOUT_FILENO, "", 1) != 1) {
                return EXIT_FAILURE;
            }
        }
    }
}

/* Kills the process this time after it has written `times` times WRITTEN_AT_ONCE entries. */
static void write_and_kill(uint32_t times, uint32_t microseconds) {
    pid_t child = 0;
    int status = 0;
    int output_pipe[2];
    char byte = 0;
    posix_spawn_file_actions_t actions;
    char self[PATH_MAX] = "";
    char option[] = "--write";
    char *arguments[] = {self, self, option, bench.path, NULL};
    const char *emulator = getenv("TL_EMULATOR"); /* runs programs for another machine */
    TEST_ASSERT_TRUE(readlink("/proc/self/exe", self, sizeof self - 1) > 0);
    TEST_ASSERT_EQUAL_INT(0, pipe2(output_pipe, O_CLOEXEC));
    (void)posix_spawn_file_actions_init(&actions);
    (void)posix_spawn_file_actions_adddup2(&actions, output_pipe[1], STDOUT_FILENO);
    TEST_ASSERT_EQUAL_INT(0, emulator == NULL ? posix_spawn(&child, self, &actions, NULL, arguments + 1, environ)
                                              : posix_spawn(&child, emulator, &actions, NULL, arguments, environ));
    (void)posix_spawn_file_actions_destroy(&actions);
    (void)close(output_pipe[1]);
    for (uint32_t i = 0; i < times; i++) {
        TEST_ASSERT_EQUAL_INT(1, read(output_pipe[0], &byte, 1));
    }
    usleep(microseconds);
    TEST_ASSERT_EQUAL_INT(0, kill(child, SIGKILL));
    TEST_ASSERT_EQUAL_INT(child, waitpid(child, &status, 0));
    (void)close(output_pipe[0]);
    TEST_ASSERT_TRUE(WIFSIGNALED(status)); /* was killed, did not exit */
}

/* As expect_whole(), for runs whose oldest ticks may have been removed: the rest has no gap. */
static void expect_one_piece(void) {
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
    TEST_ASSERT_EQUAL_INT64(
        0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs WHERE samples_written > 0 AND"
                                      " max(0, samples_written - coalesce(removed_before, 0)) <> (SELECT count(*)"
                                      " FROM samples s WHERE s.run = runs.run AND signal = 0)"));
    TEST_ASSERT_EQUAL_INT64(
        0, tl_sql_integer(bench.path,
                          "SELECT count(*) FROM runs WHERE samples_written >"
                          " coalesce(removed_before, 0) AND samples_written - 1 <> (SELECT max(tick) FROM samples s"
                          " WHERE s.run = runs.run)"));
    TEST_ASSERT_EQUAL_INT64(
        0, tl_sql_integer(bench.path,
                          "SELECT count(*) FROM runs WHERE steps_written >"
                          " coalesce(removed_before, 0) AND steps_written - 1 <> (SELECT max(step) FROM steps s WHERE"
                          " s.run = runs.run)"));
    expect_nothing_missing();
    /* The ledger is that of the last committed step, see tl_made_ledger(). */
    TEST_ASSERT_EQUAL_INT64(
        0, tl_sql_integer(bench.path,
                          "SELECT count(*) FROM components JOIN runs USING (run) WHERE plain <> 40 * steps_written"
                          " OR executions <> (21 + component) * steps_written"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs WHERE 3 <> (SELECT count(*) FROM"
                                                          " components c WHERE c.run = runs.run)"));
}

static void test_a_process_that_is_killed(void) {
    uint64_t state = 20261121;
    int64_t seen = 0;
    for (int i = 0; i < 20; i++) {
        bool early = i % 2 == 0; /* also before and during the creation */
        write_and_kill(early ? 0 : 1 + random_below(&state, 20), 2000 + random_below(&state, early ? 60000 : 20000));
        if (access(bench.path, F_OK) == 0) { /* otherwise killed before the creation */
            expect_one_piece();
            seen += tl_sql_integer(bench.path, "SELECT sum(samples_written) FROM runs");
        }
        bench.error = (tl_error){TL_OK, ""};
        open_recorder();
        tl_made_put(bench.recorder, 0, 10);
        TEST_ASSERT_EQUAL_INT(TL_OK, close_recorder());
        TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) - count(ended) FROM runs"));
        TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs WHERE ended < started"));
    }
    TEST_ASSERT_GREATER_THAN_INT64(1000, seen); /* the test was effective */
    TEST_ASSERT_GREATER_THAN_INT64(
        0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs WHERE ended_reason = 'not ended cleanly'"));
}

/* Entries that were counted as written survive a power cut, whichever other writes are lost. */
static void test_a_power_cut_loses_nothing_that_was_committed(void) {
    uint64_t state = 4711;
    uint64_t written = 0;
    char sql[128];
    tl_log_set_level(TL_LOG_ERROR - 1);
    for (int i = 0; i < 8; i++) {
        tl_recorder_settings settings = tl_made_settings(bench.path);
        settings.max_bytes = i % 2 == 0 ? 2000000 : 0; /* log written back often, and never */
        settings.commit = TL_SECOND / 200;
        settings.patience = HURRY;
        tl_faulty_vfs_arm_power_cut();
        tl_bench_open(&bench, &settings);
        int64_t ticks = 200 + (int64_t)random_below(&state, 8000);
        tl_made_put(bench.recorder, 0, ticks);
        if (i % 2 == 1) {
            wait_for_written(1);
        }
        usleep(random_below(&state, 20000)); /* also before the first commit */
        tl_faulty_vfs_cut_power();
        (void)close_recorder();
        tl_faulty_vfs_restore_power(state + (uint64_t)i);
        expect_one_piece();
        (void)snprintf(sql, sizeof sql, "SELECT samples_written + steps_written FROM runs WHERE runs.run = %lld",
                       (long long)bench.counts.run);
        TEST_ASSERT_EQUAL_INT64(bench.counts.run, tl_sql_integer(bench.path, "SELECT max(run) FROM runs"));
        TEST_ASSERT_GREATER_OR_EQUAL_INT64((int64_t)bench.counts.written, tl_sql_integer(bench.path, sql));
        written += bench.counts.written;
        bench.error = (tl_error){TL_OK, ""};
    }
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(4, written); /* the test was effective */
    tl_log_set_level(TL_LOG_NOTICE);
}

int main(int argc, char **argv) {
    if (argc == 3 && strcmp(argv[1], "--write") == 0) {
        return write_forever(argv[2]);
    }
    tl_faulty_vfs_install();
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_recorder_faults");
    UNITY_BEGIN();
    RUN_TEST(test_a_full_disk_is_survived);
    RUN_TEST(test_a_broken_disk_is_survived);
    RUN_TEST(test_a_fault_at_any_write);
    RUN_TEST(test_a_long_fault);
    RUN_TEST(test_close_gives_up_on_a_disk_that_stays_full);
    RUN_TEST(test_a_disk_that_is_full_from_the_start);
    RUN_TEST(test_a_file_that_is_moved_away);
    RUN_TEST(test_a_file_that_is_removed);
    RUN_TEST(test_a_slow_disk_does_not_slow_the_cycle);
    RUN_TEST(test_a_replay_waits_for_a_slow_disk);
    RUN_TEST(test_a_replay_does_not_hang_on_a_full_disk);
    RUN_TEST(test_a_lock_of_another_program_is_survived);
    RUN_TEST(test_a_locked_database_cannot_be_opened);
    RUN_TEST(test_events_of_many_threads);
    RUN_TEST(test_a_process_that_is_killed);
    RUN_TEST(test_a_power_cut_loses_nothing_that_was_committed);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
