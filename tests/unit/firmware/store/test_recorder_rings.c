/* Runs that alternate between two record queues: each entry, event and checkpoint is written once
 * and in its run, also if a writer is killed.
 *
 * This process puts entries. In the second part children write and are killed. TL_WRITER_LIVES is
 * their number. */
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "tests/support/made_run.h"
#include "tests/support/random_numbers.h"
#include "tests/support/sql.h"
#include "tests/support/writer_bench.h"

enum {
    LIVES = 60,
    LONGEST_US = 30000,
    MOST_DOUBLINGS = 10,
    TICKS_AT_ONCE = 20,
    CHECKPOINT = 15000,
    WAITING_EVENTS = 400
};

/* State that writers and this process share, as in a live run. */
typedef struct hall {
    uint32_t handovers; /* completed ones */
    uint32_t drained;   /* queues that a writer has emptied */
} hall;

static tl_writer_bench bench;
static hall *shared;
static uint32_t read_handovers; /* handovers before the queue that the writer reads */
static tl_test_random dice;

/* What this process has put. */
static int64_t runs;
static int64_t ticks; /* of the current run */
static int64_t all_ticks;
static int64_t events;
static int64_t of_io;

void setUp(void) {
    tl_writer_bench_begin(&bench);
    tl_log_set_level(TL_LOG_ERROR - 1);
    memset(shared, 0, sizeof *shared);
    dice = (tl_test_random){20261124};
    runs = ticks = all_ticks = events = of_io = 0;
    read_handovers = 0;
}

void tearDown(void) {
    tl_writer_bench_end(&bench);
}

/* ---- put ---- */

static size_t ring_since(uint32_t handovers) {
    return handovers % 2 == 0 ? TL_BENCH_TWIN : TL_BENCH_OTHER;
}

static size_t ring_of_run(void) {
    return ring_since(shared->handovers);
}

static tl_record_queue *queue_of_run(void) {
    return ring_of_run() == TL_BENCH_TWIN ? &bench.twin : &bench.other;
}

/* Starts a run that continues the one before, except the first. */
static void begin_run(void) {
    static tl_record_queue_start start; /* too large for the stack */
    tl_made_beginning(1000 * runs, &start);
    if (runs > 0) {
        start.resumption.from = TL_RESUMED_CHECKPOINT;
        start.resumption.run = -1;
        start.resumption.tick = 5;
    }
    TEST_ASSERT_TRUE(tl_record_queue_put_start(queue_of_run(), &start));
    runs++;
    ticks = 0;
}

static void put(int64_t count) {
    TEST_ASSERT_TRUE(tl_made_put_out(queue_of_run(), ticks, count));
    ticks += count;
    all_ticks += count;
}

/* The text has the number of the run. */
static void put_event(void) {
    char text[64];
    (void)snprintf(text, sizeof text, "event %lld of run %lld", (long long)events++, (long long)runs);
    tl_record_queue_event(queue_of_run(), ticks, TL_EVENT_INFO, "twin", text);
}

static void put_event_of_io(void) {
    char text[64];
    (void)snprintf(text, sizeof text, "event %lld", (long long)of_io++);
    tl_record_queue_event(&bench.io, -1, TL_EVENT_INFO, "io", text);
}

/* Its bytes are the number of the run, modulo 251. */
static void put_checkpoint(void) {
    size_t capacity = 0;
    unsigned char *room = tl_record_queue_checkpoint_room(queue_of_run(), &capacity);
    TEST_ASSERT_NOT_NULL(room);
    memset(room, (int)(runs % 251), CHECKPOINT);
    tl_record_queue_put_checkpoint(queue_of_run(), ticks - 1, CHECKPOINT);
}

static void handover(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_end(queue_of_run(), TL_BENCH_HAND_OVER));
    shared->handovers++;
    begin_run();
}

/* ---- write, as the recorder process does ---- */

static void open_writer(void) {
    bench.ring = ring_since(read_handovers);
    bench.is_last = true;
    tl_writer_bench_open(&bench);
}

static bool is_over(void) {
    return __atomic_load_n(&shared->handovers, __ATOMIC_ACQUIRE) != read_handovers;
}

static void write_now(void) {
    bool over = is_over();
    if (over) {
        tl_recorder_writer_finish_ring(bench.writer);
    }
    bench.continues = !over;
    tl_recorder_writer_write(bench.writer);
    if (over && tl_recorder_writer_has_drained(bench.writer)) {
        __atomic_store_n(&shared->drained, read_handovers + 1, __ATOMIC_RELEASE);
    }
}

static bool follow(void) {
    bool drained = __atomic_load_n(&shared->drained, __ATOMIC_ACQUIRE) == read_handovers + 1;
    read_handovers += drained ? 1 : 0;
    return drained;
}

static int64_t ask(const char *sql) {
    return tl_sql_integer(bench.path, sql);
}

static void expect(const char *text, const char *sql) {
    TEST_ASSERT_EQUAL_STRING(text, tl_sql_text(bench.path, sql));
}

static const char runs_of[] = "SELECT group_concat(run || ' ' || coalesce(ended_reason, 'open') || ' ' ||"
                              " samples_written || ' ' || entries_lost, ', ') FROM runs";

/* ---- one writer after the other ---- */

static void test_the_next_run_comes_by_the_other_ring(void) {
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&bench.twin, CHECKPOINT));
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&bench.other, CHECKPOINT));
    open_writer();
    begin_run();
    put(10);
    put_event();
    write_now();
    handover();
    put_event();
    put(7);
    put_checkpoint();
    write_now();
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_TRUE(follow());
    tl_writer_bench_close_well(&bench);
    put_event_of_io(); /* belongs to the last written run */
    open_writer();
    write_now();
    TEST_ASSERT_FALSE(follow());
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    expect("1 hand over 10 0, 2 not ended cleanly 7 0", runs_of);
    expect("1 5 checkpoint", "SELECT resumed_run || ' ' || resumed_tick || ' ' || resumed_from FROM beginnings"
                             " WHERE beginnings.run = 2");
    expect("1 event 0 of run 1, 1 event 0, 2 event 1 of run 2",
           "SELECT group_concat(run || ' ' || text, ', ') FROM (SELECT run, text FROM events ORDER BY event)");
    expect("2 6", "SELECT run || ' ' || tick FROM checkpoints");
}

/* The first writer is slow: it must not read the third run before the second one is written. */
static void test_a_handover_back_before_the_first_was_written(void) {
    begin_run();
    put(10);
    handover();
    put(8);
    handover();
    put(6);
    open_writer();
    write_now();
    write_now();
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM runs"));
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_TRUE(follow());
        tl_writer_bench_close_well(&bench);
        open_writer();
        write_now();
    }
    TEST_ASSERT_FALSE(follow());
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    expect("1 hand over 10 0, 2 hand over 8 0, 3 not ended cleanly 6 0", runs_of);
    expect("1, 2", "SELECT group_concat(resumed_run, ', ') FROM beginnings WHERE resumed_run IS NOT NULL");
}

/* Entries of a later run in the same queue do not count as dropped. */
static void test_entries_of_a_later_run_are_not_dropped(void) {
    begin_run();
    put(10);
    handover();
    put(8);
    handover();
    put(6);
    put_event();
    open_writer();
    write_now();
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_UINT64(0, tl_recorder_state_get(bench.state).dropped);
    expect("1 hand over 10 0", runs_of);
}

/* The twin has died inside a tick, before the end of its run. */
static void test_a_handover_after_the_twins_death(void) {
    tl_sample sample;
    open_writer();
    begin_run();
    put(10);
    tl_made_sample(10, &sample);
    TEST_ASSERT_TRUE(tl_record_queue_put_sample(&bench.twin, &sample));
    write_now();
    shared->handovers++;
    begin_run();
    put(3);
    write_now();
    TEST_ASSERT_TRUE(follow());
    tl_writer_bench_close_well(&bench);
    open_writer();
    write_now();
    tl_writer_bench_close_well(&bench);
    expect("1 not ended cleanly 11 0, 2 not ended cleanly 3 0", runs_of);
}

/* A wrong end of the twin: no handover follows. */
static void test_an_end_without_a_handover(void) {
    open_writer();
    begin_run();
    put(10);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, TL_BENCH_HAND_OVER));
    begin_run();
    put(4);
    write_now();
    tl_writer_bench_close_well(&bench);
    expect("1 hand over 10 0, 2 not ended cleanly 4 0", runs_of);
}

/* The writer has died after its last commit, before it could report that the queue is empty. */
static void test_a_successor_reports_the_empty_queue(void) {
    open_writer();
    begin_run();
    put(10);
    handover();
    write_now();
    shared->drained = 0;
    tl_writer_bench_close_well(&bench);
    open_writer();
    write_now();
    TEST_ASSERT_TRUE(follow());
}

/* The queue of another configuration in new memory: the reader's numbers continue. */
static void test_a_new_queue_replaces_an_old_one(void) {
    open_writer();
    begin_run();
    put(10);
    put_event();
    handover();
    put(8);
    write_now();
    TEST_ASSERT_TRUE(follow());
    tl_writer_bench_close_well(&bench);
    memset(bench.memory[TL_BENCH_TWIN], 0, bench.bytes[TL_BENCH_TWIN]);
    tl_record_queue_open(&bench.settings[0], bench.memory[TL_BENCH_TWIN], &bench.state->taken[TL_BENCH_TWIN],
                         &bench.twin);
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_lost(&bench.twin));
    open_writer();
    handover();
    put(6);
    put_event();
    write_now();
    TEST_ASSERT_TRUE(follow());
    tl_writer_bench_close_well(&bench);
    open_writer();
    write_now();
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    expect("1 hand over 10 0, 2 hand over 8 0, 3 not ended cleanly 6 0", runs_of);
    expect("1 event 0 of run 1, 3 event 1 of run 3", "SELECT group_concat(run || ' ' || text, ', ') FROM events");
}

/* ---- killed ---- */

static bool has_room(void) {
    const tl_record_queue_taken *taken = &bench.state->taken[ring_of_run()];
    return queue_of_run()->written - taken->ring < bench.settings[0].ring_bytes / 2 &&
           (uint64_t)events - bench.state->taken[0].events - bench.state->taken[2].events < WAITING_EVENTS &&
           (uint64_t)of_io - bench.state->taken[TL_BENCH_IO].events < WAITING_EVENTS;
}

/* At most two handovers ahead of the writer, as in a live run. */
static bool may_handover(void) {
    return shared->handovers - read_handovers < 2;
}

static void put_some(void) {
    if (!has_room()) {
        return;
    }
    put(1 + (int64_t)tl_test_random_below(&dice, TICKS_AT_ONCE));
    put_event();
    put_event_of_io();
    if (tl_test_random_chance(&dice, 5)) {
        put_checkpoint();
    }
    if (tl_test_random_chance(&dice, 20) && may_handover()) {
        handover();
        put_event();
    }
}

/* A number that grows with the progress of the writers. */
static uint64_t taken_so_far(void) {
    uint64_t sum = __atomic_load_n(&shared->drained, __ATOMIC_ACQUIRE);
    for (size_t i = 0; i < TL_BENCH_QUEUES; i++) {
        sum += bench.state->taken[i].ring + bench.state->taken[i].events;
    }
    return sum;
}

/* Runs a writer for at most this time. The caller doubles it if there is no progress: a slow
 * machine needs longer to open the database. */
static void live_and_be_killed(size_t longest_us) {
    tl_time life = (tl_time)tl_test_random_below(&dice, longest_us) * 1000;
    bench.ring = ring_since(read_handovers);
    tl_writer_bench_live(&bench, tl_clock_now(NULL) + life, write_now, put_some);
    (void)follow();
}

static void write_the_rest(void) {
    open_writer();
    write_now();
    while (follow()) {
        tl_writer_bench_close_well(&bench);
        open_writer();
        write_now();
    }
    TEST_ASSERT_FALSE(is_over());
    tl_writer_bench_close_well(&bench);
}

static void expect_all_once(void) {
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_INT64(runs, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(runs, ask("SELECT max(run) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(runs - 1, ask("SELECT count(*) FROM runs WHERE ended_reason = 'hand over'"));
    TEST_ASSERT_EQUAL_INT64(runs - 1, ask("SELECT count(*) FROM beginnings WHERE resumed_run = run - 1"));
    TEST_ASSERT_EQUAL_INT64(runs, ask("SELECT count(*) FROM beginnings WHERE start_ns = 1000 * (run - 1)"));
    TEST_ASSERT_EQUAL_INT64(all_ticks, ask("SELECT count(*) FROM (SELECT DISTINCT run, tick FROM samples)"));
    TEST_ASSERT_EQUAL_INT64(all_ticks, ask("SELECT count(*) FROM steps"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT sum(entries_lost) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(events, ask("SELECT count(DISTINCT text) FROM events WHERE source = 'twin'"));
    TEST_ASSERT_EQUAL_INT64(events, ask("SELECT count(*) FROM events WHERE source = 'twin'"));
    TEST_ASSERT_EQUAL_INT64(of_io, ask("SELECT count(DISTINCT text) FROM events WHERE source = 'io'"));
    TEST_ASSERT_EQUAL_INT64(of_io, ask("SELECT count(*) FROM events WHERE source = 'io'"));
    TEST_ASSERT_EQUAL_INT64(
        0, ask("SELECT count(*) FROM events WHERE source = 'twin' AND text NOT LIKE '% of run ' || run"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM checkpoints WHERE hex(substr(bytes, 1, 1)) <>"
                                   " printf('%02X', run % 251)"));
}

static void test_each_entry_is_there_once(void) {
    size_t lives = tl_test_campaign("TL_WRITER_LIVES", LIVES);
    int barren = 0; /* consecutive writers without progress */
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&bench.twin, CHECKPOINT));
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&bench.other, CHECKPOINT));
    begin_run();
    for (size_t i = 0; i < lives || runs <= 3; i++) {
        uint64_t before = taken_so_far();
        live_and_be_killed((size_t)LONGEST_US << barren);
        barren = taken_so_far() > before ? 0 : barren + 1;
        TEST_ASSERT_LESS_THAN_MESSAGE(MOST_DOUBLINGS, barren, "no progress");
    }
    write_the_rest();
    expect_all_once();
}

int main(void) {
    /* cppcheck-suppress invalidFunctionArg ; an anonymous mapping has no file, which is -1 */
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) {
        return 1;
    }
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_recorder_rings");
    UNITY_BEGIN();
    RUN_TEST(test_the_next_run_comes_by_the_other_ring);
    RUN_TEST(test_a_handover_back_before_the_first_was_written);
    RUN_TEST(test_entries_of_a_later_run_are_not_dropped);
    RUN_TEST(test_a_handover_after_the_twins_death);
    RUN_TEST(test_an_end_without_a_handover);
    RUN_TEST(test_a_successor_reports_the_empty_queue);
    RUN_TEST(test_a_new_queue_replaces_an_old_one);
    RUN_TEST(test_each_entry_is_there_once);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
