/* Checkpoints and beginnings in the database: what is kept, what is read again, and how large the file gets. */
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/database/database_schema.h"
#include "firmware/record/history.h"
#include "tests/support/made_run.h"
#include "tests/support/recorder_bench.h"
#include "tests/support/sql.h"

enum { SIZE = 5000, LARGE = 60000 };

static tl_history *history;
static const tl_history_run *run;
static tl_recorder_bench bench;

void setUp(void) {
    tl_bench_begin(&bench);
    history = NULL;
}

void tearDown(void) {
    tl_history_close(history);
    tl_bench_end(&bench);
}

static tl_recorder_settings settings_of(int64_t max_bytes) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.verb = "run";
    settings.wait_when_full = true;
    settings.max_bytes = max_bytes;
    settings.fmus = "digest";
    settings.boot = "boot";
    settings.format = "this one";
    return settings;
}

static void open_recorder(int64_t max_bytes) {
    const tl_recorder_settings settings = settings_of(max_bytes);
    tl_bench_open(&bench, &settings);
}

static void close_recorder(void) {
    tl_bench_close(&bench, "SIGTERM");
}

static unsigned char byte_of(int64_t tick, size_t i) {
    return (unsigned char)((uint64_t)tick * 7 + i * 13 + i / 251);
}

/* As soon as the one before is written. */
static void put_checkpoint(int64_t tick, size_t size) {
    size_t capacity = 0;
    unsigned char *room = NULL;
    for (int tries = 0; room == NULL && tries < 10000; tries++) {
        room = tl_recorder_checkpoint_room(bench.recorder, &capacity);
        (void)usleep(1000);
    }
    TEST_ASSERT_NOT_NULL(room);
    TEST_ASSERT_GREATER_OR_EQUAL_size_t(size, capacity);
    for (size_t i = 0; i < size; i++) {
        room[i] = byte_of(tick, i);
    }
    tl_recorder_put_checkpoint(bench.recorder, tick, size);
}

static void open_history(int64_t id) {
    tl_history_close(history);
    history = NULL;
    tl_bench_expect_ok(&bench, tl_history_open(bench.path, &history, &bench.error));
    tl_bench_expect_ok(&bench, tl_history_find(history, id, &run, &bench.error));
}

static const tl_history_checkpoint *checkpoint_before(int64_t tick) {
    const tl_history_checkpoint *checkpoint = NULL;
    tl_bench_expect_ok(&bench, tl_history_checkpoint_before(history, run, tick, &checkpoint, &bench.error));
    return checkpoint;
}

static void expect_checkpoint(const tl_history_checkpoint *checkpoint, int64_t tick, size_t size) {
    TEST_ASSERT_NOT_NULL(checkpoint);
    TEST_ASSERT_EQUAL_INT64(tick, checkpoint->tick);
    TEST_ASSERT_TRUE(checkpoint->whole);
    TEST_ASSERT_EQUAL_STRING("this one", checkpoint->format);
    TEST_ASSERT_EQUAL_size_t(size, checkpoint->size);
    for (size_t i = 0; i < size; i++) {
        TEST_ASSERT_EQUAL_HEX8(byte_of(tick, i), checkpoint->bytes[i]);
    }
}

/* ---- what is kept ---- */

static void test_the_two_newest_and_the_first_are_kept(void) {
    const tl_resumption resumption = {
        .from = TL_RESUMED_CHECKPOINT, .run = 7, .tick = 20, .start = -5, .started = 1000};
    open_recorder(0);
    tl_recorder_resume(bench.recorder, &resumption);
    TEST_ASSERT_TRUE(tl_recorder_reserve_checkpoint(bench.recorder, SIZE));
    for (int64_t tick = 10; tick < 60; tick += 10) {
        put_checkpoint(tick, SIZE - (size_t)tick);
        tl_made_put(bench.recorder, tick, 10);
    }
    close_recorder();
    open_history(1);
    expect_checkpoint(checkpoint_before(INT64_MAX), 50, SIZE - 50);
    expect_checkpoint(checkpoint_before(50), 40, SIZE - 40);
    expect_checkpoint(checkpoint_before(40), 10, SIZE - 10); /* what it began with */
    TEST_ASSERT_NULL(checkpoint_before(10));
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_CHECKPOINT, run->resumption.from);
    TEST_ASSERT_EQUAL_INT64(7, run->resumption.run);
    TEST_ASSERT_EQUAL_INT64(20, run->resumption.tick);
    TEST_ASSERT_TRUE(run->has_start);
    TEST_ASSERT_EQUAL_INT64(-5, run->start);
    TEST_ASSERT_EQUAL_STRING("digest", run->fmus);
    TEST_ASSERT_EQUAL_STRING("boot", run->boot);
    TEST_ASSERT_EQUAL_STRING("1970-01-01T00:00:01.000Z", run->started);
}

static void test_a_run_that_begins_anew(void) {
    open_recorder(0);
    tl_recorder_start(bench.recorder, 1234);
    tl_made_put(bench.recorder, 0, 10);
    close_recorder();
    open_history(1);
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_NOT, run->resumption.from);
    TEST_ASSERT_EQUAL_INT64(1234, run->start);
    TEST_ASSERT_NULL(checkpoint_before(INT64_MAX));
}

/* The one before is being written, or there is no room at all: the producer does not wait. */
static void test_room_for_one(void) {
    size_t capacity = 9;
    open_recorder(0);
    TEST_ASSERT_NULL(tl_recorder_checkpoint_room(bench.recorder, &capacity));
    TEST_ASSERT_EQUAL_size_t(0, capacity);
    TEST_ASSERT_TRUE(tl_recorder_reserve_checkpoint(bench.recorder, SIZE));
    put_checkpoint(3, SIZE);
    if (tl_recorder_checkpoint_room(bench.recorder, &capacity) == NULL) { /* or it has been written already */
        TEST_ASSERT_FALSE(tl_recorder_reserve_checkpoint(bench.recorder, SIZE));
    }
    close_recorder();
    open_history(1);
    expect_checkpoint(checkpoint_before(INT64_MAX), 3, SIZE);
}

static void test_damage_shows(void) {
    open_recorder(0);
    TEST_ASSERT_TRUE(tl_recorder_reserve_checkpoint(bench.recorder, SIZE));
    put_checkpoint(3, SIZE);
    close_recorder();
    tl_sql_execute(bench.path, "UPDATE checkpoints SET bytes = zeroblob(5000)");
    open_history(1);
    TEST_ASSERT_FALSE(checkpoint_before(INT64_MAX)->whole);
    tl_sql_execute(bench.path, "UPDATE checkpoints SET bytes = x''");
    open_history(1);
    TEST_ASSERT_FALSE(checkpoint_before(INT64_MAX)->whole);
}

/* ---- within the bound ---- */

static int64_t size_of(const char *name) {
    struct stat status;
    return stat(name, &status) == 0 ? (int64_t)status.st_size : 0;
}

static void test_the_bound_holds(void) {
    const int64_t bound = 1000000;
    open_recorder(bound);
    TEST_ASSERT_FALSE(
        tl_recorder_reserve_checkpoint(bench.recorder, 200000)); /* no such one would leave room for anything else */
    TEST_ASSERT_TRUE(tl_recorder_reserve_checkpoint(bench.recorder, LARGE));
    for (int64_t tick = 0; tick < 20000; tick += 500) {
        tl_made_put(bench.recorder, tick, 500);
        put_checkpoint(tick + 499, LARGE);
        TEST_ASSERT_LESS_OR_EQUAL_INT64(bound, size_of(bench.path) + size_of(bench.wal));
    }
    close_recorder();
    int64_t first = tl_sql_integer(bench.path, "SELECT removed_before FROM runs");
    TEST_ASSERT_GREATER_THAN_INT64(0, first);
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "SELECT count(*) FROM checkpoints"));
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(first - 1, tl_sql_integer(bench.path, "SELECT min(tick) FROM checkpoints"));
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
}

/* A run that is removed leaves neither. */
static void test_removed_with_the_run(void) {
    open_recorder(0);
    TEST_ASSERT_TRUE(tl_recorder_reserve_checkpoint(bench.recorder, LARGE));
    put_checkpoint(0, LARGE);
    tl_made_put(bench.recorder, 0, 2000);
    close_recorder();
    open_recorder(1000000);
    tl_made_put(bench.recorder, 0, 20000);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs WHERE run = 1"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM checkpoints"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM beginnings WHERE run = 1"));
}

/* ---- older files ---- */

static void make_format_2(void) {
    open_recorder(0);
    tl_made_put(bench.recorder, 0, 10);
    close_recorder();
    tl_sql_execute(bench.path, "DROP TABLE beginnings; DROP TABLE checkpoints; PRAGMA user_version = 2");
}

static void expect_nothing_known(void) {
    open_history(1);
    TEST_ASSERT_EQUAL_STRING("", run->fmus);
    TEST_ASSERT_EQUAL_STRING("", run->boot);
    TEST_ASSERT_FALSE(run->has_start);
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_NOT, run->resumption.from);
    TEST_ASSERT_NULL(checkpoint_before(INT64_MAX));
}

static void test_a_file_of_format_2_is_read_as_it_is(void) {
    make_format_2();
    expect_nothing_known();
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "PRAGMA user_version"));
}

static void test_a_file_of_format_2_is_brought_up_to_date(void) {
    make_format_2();
    open_recorder(0);
    tl_recorder_start(bench.recorder, 1);
    tl_made_put(bench.recorder, 0, 10);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(TL_DATABASE_VERSION, tl_sql_integer(bench.path, "PRAGMA user_version"));
    expect_nothing_known();
    open_history(2);
    TEST_ASSERT_EQUAL_STRING("digest", run->fmus);
    TEST_ASSERT_TRUE(run->has_start);
}

static void test_a_file_of_format_1_is_read_as_it_is(void) {
    open_recorder(0);
    tl_made_put(bench.recorder, 0, 10);
    close_recorder();
    tl_made_older(bench.path);
    expect_nothing_known();
}

int main(void) {
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_recorder_checkpoint");
    UNITY_BEGIN();
    RUN_TEST(test_the_two_newest_and_the_first_are_kept);
    RUN_TEST(test_a_run_that_begins_anew);
    RUN_TEST(test_room_for_one);
    RUN_TEST(test_damage_shows);
    RUN_TEST(test_the_bound_holds);
    RUN_TEST(test_removed_with_the_run);
    RUN_TEST(test_a_file_of_format_2_is_read_as_it_is);
    RUN_TEST(test_a_file_of_format_2_is_brought_up_to_date);
    RUN_TEST(test_a_file_of_format_1_is_read_as_it_is);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
