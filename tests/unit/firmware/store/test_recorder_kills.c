/* A writer that is killed repeatedly, at any instruction: each entry is in the database exactly
 * once, and a run without an end continues in its row.
 *
 * This process puts entries, events and checkpoints. A child writes them and is killed, then the
 * next child continues. TL_WRITER_LIVES is the number of children. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "tests/support/made_run.h"
#include "tests/support/random_numbers.h"
#include "tests/support/sql.h"
#include "tests/support/writer_bench.h"

enum { LIVES = 60, LONGEST_US = 30000, TICKS_AT_ONCE = 20, CHECKPOINT = 15000, WAITING_EVENTS = 400 };

static tl_writer_bench bench;
static tl_test_random dice;

/* What this process has put. */
static int64_t runs;
static int64_t ticks; /* of the current run */
static int64_t all_ticks;
static int64_t events[TL_BENCH_QUEUES];
static int64_t ended;

void setUp(void) {
    tl_writer_bench_begin(&bench);
    dice = (tl_test_random){20261123};
    runs = ticks = all_ticks = ended = 0;
    memset(events, 0, sizeof events);
}

void tearDown(void) {
    tl_writer_bench_end(&bench);
}

/* ---- put ---- */

static void begin_run(void) {
    tl_writer_bench_start(&bench, 1000 * runs);
    runs++;
    ticks = 0;
}

/* The text has the number of the run. */
static void put_event(int which) {
    char text[64];
    if ((uint64_t)events[which] - bench.state->taken[which].events >= WAITING_EVENTS) {
        return; /* the queue may be full */
    }
    (void)snprintf(text, sizeof text, "event %lld of run %lld", (long long)events[which]++, (long long)runs);
    tl_record_queue_event(which == 0 ? &bench.twin : &bench.io, ticks, TL_EVENT_INFO, which == 0 ? "twin" : "io", text);
}

static void put_checkpoint(void) {
    size_t capacity = 0;
    unsigned char *room = tl_record_queue_checkpoint_room(&bench.twin, &capacity);
    TEST_ASSERT_NOT_NULL(room);
    memset(room, (int)(ticks % 251), CHECKPOINT);
    tl_record_queue_put_checkpoint(&bench.twin, ticks - 1, CHECKPOINT);
}

/* Then the largest entry fits. */
static bool is_half_empty(void) {
    return bench.twin.written - bench.state->taken[0].ring < bench.settings[0].ring_bytes / 2;
}

static void put_some(void) {
    if (!is_half_empty()) {
        return;
    }
    int64_t some = 1 + (int64_t)tl_test_random_below(&dice, TICKS_AT_ONCE);
    for (int64_t i = 0; i < some; i++) {
        tl_writer_bench_put(&bench, ticks++, 1);
        all_ticks++;
    }
    put_event((int)tl_test_random_below(&dice, 2));
    if (tl_test_random_chance(&dice, 5)) {
        put_checkpoint();
    }
    if (tl_test_random_chance(&dice, 2)) {
        bool ends = tl_test_random_chance(&dice, 50) && tl_record_queue_put_end(&bench.twin, "SIGTERM");
        ended += ends ? 1 : 0;
        begin_run();
        put_event(0);
    }
}

/* ---- write ---- */

static void write_now(void) {
    tl_recorder_writer_write(bench.writer);
}

static void live_and_be_killed(void) {
    tl_time life = (tl_time)tl_test_random_below(&dice, LONGEST_US) * 1000;
    tl_writer_bench_live(&bench, tl_clock_now(NULL) + life, write_now, put_some);
}

/* ---- check ---- */

static int64_t ask(const char *sql) {
    return tl_sql_integer(bench.path, sql);
}

static void expect_all_once(void) {
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_INT64(runs, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(runs, ask("SELECT max(run) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(runs, ask("SELECT count(DISTINCT start_ns) FROM beginnings"));
    TEST_ASSERT_EQUAL_INT64(ended, ask("SELECT count(*) FROM runs WHERE ended_reason = 'SIGTERM'"));
    TEST_ASSERT_EQUAL_INT64(runs - ended, ask("SELECT count(*) FROM runs WHERE ended_reason = 'not ended cleanly'"));
    TEST_ASSERT_EQUAL_INT64(all_ticks, ask("SELECT count(*) FROM (SELECT DISTINCT run, tick FROM samples)"));
    TEST_ASSERT_EQUAL_INT64(all_ticks, ask("SELECT count(*) FROM steps"));
    TEST_ASSERT_EQUAL_INT64(all_ticks, ask("SELECT sum(samples_written) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT sum(entries_lost) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(events[0], ask("SELECT count(*) FROM events WHERE source = 'twin'"));
    TEST_ASSERT_EQUAL_INT64(events[0], ask("SELECT count(DISTINCT text) FROM events WHERE source = 'twin'"));
    TEST_ASSERT_EQUAL_INT64(events[1], ask("SELECT count(*) FROM events WHERE source = 'io'"));
    TEST_ASSERT_EQUAL_INT64(events[1], ask("SELECT count(DISTINCT text) FROM events WHERE source = 'io'"));
    TEST_ASSERT_EQUAL_INT64(
        0, ask("SELECT count(*) FROM events WHERE source = 'twin' AND text NOT LIKE '% of run ' || run"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM checkpoints WHERE length(bytes) <> 15000"));
    TEST_ASSERT_EQUAL_UINT64(2 * (uint64_t)all_ticks + (uint64_t)events[0] + (uint64_t)events[1],
                             tl_recorder_state_get(bench.state).written);
}

static void each_entry_is_there_once(void) {
    size_t lives = tl_test_campaign("TL_WRITER_LIVES", LIVES);
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&bench.twin, CHECKPOINT));
    begin_run();
    for (size_t i = 0; i < lives; i++) {
        live_and_be_killed();
    }
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    tl_sql_execute(bench.path, "UPDATE main.runs SET ended_reason = 'not ended cleanly', ended = committed"
                               " WHERE runs.ended IS NULL"); /* the last one */
    expect_all_once();
}

int main(void) {
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_recorder_kills");
    UNITY_BEGIN();
    RUN_TEST(each_entry_is_there_once);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
