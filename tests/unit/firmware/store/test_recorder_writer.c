/* The writer: runs from record queues, continuation by a successor, waiting, and invalid queues. */
#include <math.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/store/finding_notes.h"
#include "firmware/store/history.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder.h"
#include "tests/support/faulty_vfs.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/sql.h"
#include "tests/support/writer_bench.h"

static tl_writer_bench bench;

void setUp(void) {
    tl_writer_bench_begin(&bench);
    tl_log_set_level(TL_LOG_ERROR - 1);
}

void tearDown(void) {
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    tl_writer_bench_end(&bench);
}

static int64_t ask(const char *sql) {
    return tl_sql_integer(bench.path, sql);
}

static void write_now(void) {
    tl_recorder_writer_write(bench.writer);
}

static uint64_t written(void) {
    return tl_recorder_state_get(bench.state).written;
}

/* ---- Runs ---- */

static void test_a_run_from_start_to_end(void) {
    tl_writer_bench_open(&bench);
    tl_record_queue_event(&bench.io, -1, TL_EVENT_INFO, "io", "before the run");
    tl_record_queue_event(&bench.twin, -1, TL_EVENT_INFO, "twin", "before the run");
    write_now();
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM runs")); /* events wait for a run */
    TEST_ASSERT_EQUAL_INT64(0, tl_recorder_state_get(bench.state).run);
    tl_writer_bench_start(&bench, 12345);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_EQUAL_INT64(1, tl_recorder_state_get(bench.state).run);
    TEST_ASSERT_EQUAL_STRING(bench.path, tl_recorder_writer_path(bench.writer));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT ended IS NULL FROM runs"));
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "SIGTERM"));
    write_now();
    tl_record_queue_event(&bench.io, -1, TL_EVENT_INFO, "io", "after the run");
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_STRING("run|SIGTERM|2|0|10|10|3|0",
                             tl_sql_text(bench.path, "SELECT verb || '|' || ended_reason || '|' ||"
                                                     " prediction || '|' || lead || '|' || samples_written || '|' ||"
                                                     " steps_written || '|' || events_written || '|' || entries_lost"
                                                     " FROM runs"));
    TEST_ASSERT_EQUAL_INT64(12345, ask("SELECT start_ns FROM beginnings"));
    TEST_ASSERT_EQUAL_STRING("unit 0, unit 1", tl_sql_text(bench.path, "SELECT group_concat(unit, ', ') FROM signals"
                                                                       " WHERE kind = 'match'"));
    TEST_ASSERT_EQUAL_STRING("motor.omega", tl_sql_text(bench.path, "SELECT name FROM signals WHERE kind = 'match'"));
    TEST_ASSERT_EQUAL_STRING("component 0, component 1, component 2",
                             tl_sql_text(bench.path, "SELECT group_concat(name, ', ') FROM components"));
    TEST_ASSERT_EQUAL_UINT64(23, written());
}

static void test_stamps_count_from_the_start(void) {
    const tl_time start = INT64_C(123456789012345);
    tl_sample sample;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, start);
    tl_made_sample(0, &sample);
    sample.stamps[0] = start - 17;
    sample.stamps[1] = start + 5;
    sample.stamps[2] = TL_TIME_NEVER;
    TEST_ASSERT_TRUE(tl_record_queue_put_sample(&bench.twin, &sample));
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "")); /* releases the sample */
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_STRING("-17 5 never",
                             tl_sql_text(bench.path, "SELECT group_concat(coalesce(stamp_ns, 'never'), ' ') FROM"
                                                     " (SELECT stamp_ns FROM samples ORDER BY signal)"));
    TEST_ASSERT_EQUAL_UINT64(1, written()); /* a start does not count */
}

static void test_runs_follow_each_other(void) {
    static tl_record_queue_start start;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    tl_record_queue_event(&bench.twin, 9, TL_EVENT_INFO, "twin", "first");
    start = (tl_record_queue_start){.resumption = {.from = TL_RESUMED_CHECKPOINT, .run = -1, .tick = 8, .start = 2}};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&bench.twin, &start)); /* twin killed */
    tl_record_queue_event(&bench.twin, 9, TL_EVENT_INFO, "twin", "second");
    tl_writer_bench_put(&bench, 8, 10);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "SIGTERM"));
    start = (tl_record_queue_start){.holds = true, .resumption = {.start = 3, .started = 1}};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&bench.twin, &start));
    tl_record_queue_event(&bench.twin, 9, TL_EVENT_INFO, "twin", "third");
    tl_writer_bench_put(&bench, 0, 10);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_STRING("run not ended cleanly 10, run SIGTERM 10, hold open 10",
                             tl_sql_text(bench.path, "SELECT group_concat(verb || ' ' || coalesce(ended_reason, 'open')"
                                                     " || ' ' || samples_written, ', ') FROM runs"));
    TEST_ASSERT_EQUAL_STRING("1 8 checkpoint",
                             tl_sql_text(bench.path, "SELECT resumed_run || ' ' || resumed_tick || ' ' ||"
                                                     " resumed_from FROM beginnings WHERE beginnings.run = 2"));
    TEST_ASSERT_EQUAL_STRING("1 first, 2 second, 3 third",
                             tl_sql_text(bench.path, "SELECT group_concat(run || ' ' || text, ', ') FROM events"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM components WHERE components.run = 3"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM signals WHERE signals.run = 3 AND kind <> 'plant'"));
}

static void test_checkpoints(void) {
    size_t capacity = 0;
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&bench.twin, 5000));
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    for (int64_t tick = 0; tick < 40; tick += 10) {
        tl_writer_bench_put(&bench, tick, 10);
        memset(tl_record_queue_checkpoint_room(&bench.twin, &capacity), 1, 5000);
        tl_record_queue_put_checkpoint(&bench.twin, tick + 9, 5000);
        write_now();
        TEST_ASSERT_EQUAL_UINT64((uint64_t)tick / 10 + 1, bench.state->taken[0].checkpoint);
    }
    memset(tl_record_queue_checkpoint_room(&bench.twin, &capacity), 1, 5000);
    tl_record_queue_put_checkpoint(&bench.twin, INT64_MAX, 5000); /* invalid tick */
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_STRING("9, 29, 39", tl_sql_text(bench.path, "SELECT group_concat(tick, ', ') FROM checkpoints"));
}

/* ---- Continuation ---- */

static void test_a_run_continues_in_its_row(void) {
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    tl_writer_bench_close_well(&bench); /* the run does not end */
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT ended IS NULL FROM runs"));
    tl_writer_bench_put(&bench, 10, 10);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_put(&bench, 20, 10);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "SIGTERM"));
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_STRING("1 30 SIGTERM", tl_sql_text(bench.path, "SELECT run || ' ' || samples_written || ' ' ||"
                                                                     " ended_reason FROM runs"));
}

/* Meanwhile another recorder has used the file and marked the run as killed. */
static void test_a_run_continues_after_another_recorder(void) {
    tl_recorder *recorder = NULL;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    tl_writer_bench_close_well(&bench);
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, &bench.error));
    tl_made_put(recorder, 0, 10);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "end", NULL, &bench.error));
    TEST_ASSERT_EQUAL_STRING("not ended cleanly", tl_sql_text(bench.path, "SELECT ended_reason FROM runs"));
    tl_writer_bench_put(&bench, 10, 10);
    tl_writer_bench_open(&bench);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_INT64(2, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT ended IS NULL AND samples_written = 20 FROM runs WHERE runs.run = 1"));
}

/* ---- Waiting ---- */

static void test_a_disk_that_is_full_at_first(void) {
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_NOT_EQUAL_INT64(0, tl_recorder_state_get(bench.state).refused_since);
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    tl_writer_bench_write_until(&bench, 20);
    TEST_ASSERT_EQUAL_INT64(0, tl_recorder_state_get(bench.state).refused_since);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "disk is full"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "after|s"));
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&bench.scratch));
}

static void test_a_folder_that_is_created_later(void) {
    char folder[PATH_MAX];
    char path[PATH_MAX + 8];
    (void)snprintf(folder, sizeof folder, "%s", tl_scratch_path(&bench.scratch, "later"));
    (void)snprintf(path, sizeof path, "%s/run.db", folder);
    bench.record.path = path;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_EQUAL_INT(0, mkdir(folder, 0700));
    tl_writer_bench_write_until(&bench, 20);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(10, tl_sql_integer(path, "SELECT samples_written FROM runs"));
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    TEST_ASSERT_EQUAL_INT(0, rmdir(folder));
}

static void test_a_lock_of_another_program(void) {
    sqlite3 *other = NULL;
    tl_writer_bench_record(&bench, 10);
    tl_writer_bench_forget(&bench);
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(bench.path, &other));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_exec(other, "BEGIN IMMEDIATE", NULL, NULL, NULL));
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_EQUAL_UINT64(0, written());
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_exec(other, "COMMIT", NULL, NULL, NULL));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_close(other));
    tl_writer_bench_write_until(&bench, 20);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(2, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "program|locked"));
}

static void test_another_twinlock(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_recorder *other = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &other, &bench.error));
    bench.record.open_policy = TL_DATABASE_IF_OURS;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_writer_bench_try_open(&bench));
    TL_EXPECT_PARTS("/run.db|twinlock|process", bench.error.text);
    bench.record.open_policy = TL_DATABASE_ANYHOW;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(other, "end", NULL, &bench.error));
    tl_writer_bench_write_until(&bench, 20);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(2, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "twinlock|process"));
}

/* The fault is reported once, and lost entries are counted. */
static void test_lost_entries_of_a_full_disk(void) {
    tl_sample sample;
    uint64_t refused = 0;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    tl_made_sample(10, &sample);
    for (int64_t tick = 10; refused < 100; tick++) {
        sample.tick = tick;
        refused += tl_record_queue_put_sample(&bench.twin, &sample) ? 0 : 1;
    }
    TEST_ASSERT_TRUE(tl_recorder_writer_is_pressed(bench.writer));
    for (int i = 0; i < 10; i++) {
        write_now();
        TEST_ASSERT_FALSE(tl_recorder_writer_is_pressed(bench.writer)); /* no early retry */
    }
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_INT64(100, ask("SELECT entries_lost FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "disk is full"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "100|lost"));
}

static void test_entries_that_are_not_written_at_the_end(void) {
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    tl_writer_bench_put(&bench, 10, 10);
    tl_record_queue_event(&bench.io, 1, TL_EVENT_INFO, "io", "an event");
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_writer_bench_close(&bench));
    TL_EXPECT_PARTS("/run.db|21 entries|disk is full", bench.error.text);
    TEST_ASSERT_EQUAL_UINT64(21, tl_recorder_state_get(bench.state).dropped);
}

/* A batch never ends inside a tick, so that after a power cut each tick is complete or missing. */
static void test_batches_end_between_ticks(void) {
    bench.record.max_bytes = 1000000;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    int64_t tick = 0;
    unsigned batches = 0;
    for (int64_t ticks = 1; ticks < 400; ticks += 7) {
        tl_writer_bench_put(&bench, tick, ticks);
        tick += ticks;
        write_now();
        for (int i = 0; i < 2; i++) { /* the last two batches */
            const tl_recorder_mark *mark = &bench.state->marks[i];
            TEST_ASSERT_EQUAL_UINT64(mark->totals.samples, mark->totals.steps);
            batches += mark->totals.samples > 0 && mark->totals.samples + 1 < (uint64_t)tick ? 1 : 0;
        }
    }
    TEST_ASSERT_GREATER_THAN_UINT(20, batches);
    tl_writer_bench_close_well(&bench);
}

/* ---- Observing, and changes ---- */

enum { OBSERVED = 400 };

static tl_recorder_kind kinds[OBSERVED]; /* of the observed entries */
static int64_t ticks_seen[OBSERVED];
static size_t observed;

static void observe(void *context, const tl_recorder_entry *entry) {
    (void)context;
    TEST_ASSERT_LESS_THAN_size_t(OBSERVED, observed);
    kinds[observed] = entry->kind;
    ticks_seen[observed++] = entry->kind == TL_ENTRY_SAMPLE ? entry->sample.tick : entry->record.step;
}

/* A start, then these ticks with a sample and a step each. */
static void expect_observed(size_t at, int64_t first, int64_t count) {
    TEST_ASSERT_GREATER_OR_EQUAL_size_t(at + 1 + 2 * (size_t)count, observed);
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_START, kinds[at]);
    for (size_t i = 0; i < 2 * (size_t)count; i++) {
        TEST_ASSERT_EQUAL_INT(i % 2 == 0 ? TL_ENTRY_SAMPLE : TL_ENTRY_STEP, kinds[at + 1 + i]);
        TEST_ASSERT_EQUAL_INT64(first + (int64_t)i / 2, ticks_seen[at + 1 + i]);
    }
}

static void open_with_observer(void) {
    observed = 0;
    bench.observe = observe;
    tl_writer_bench_open(&bench);
}

/* Each entry is observed once, also while the disk is full. A run after a handover is observed when
 * the end of the one before is written, because it may belong to another queue. */
static void test_an_observer_and_a_full_disk(void) {
    open_with_observer();
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_EQUAL_size_t(21, observed);
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    tl_writer_bench_put(&bench, 10, 10);
    write_now();
    write_now();
    TEST_ASSERT_EQUAL_size_t(41, observed);
    bench.continues = true; /* announced without cause */
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, TL_BENCH_HAND_OVER));
    tl_writer_bench_start(&bench, 2);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    expect_observed(0, 0, 20);
    TEST_ASSERT_EQUAL_size_t(42, observed);
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_END, kinds[41]);
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    tl_writer_bench_write_until(&bench, 60);
    write_now();
    expect_observed(42, 0, 10);
    TEST_ASSERT_EQUAL_size_t(63, observed);
    tl_writer_bench_close_well(&bench);
}

/* A successor observes the run's start, and what was not written. */
static void test_an_observer_of_a_successor(void) {
    open_with_observer();
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_put(&bench, 10, 10);
    open_with_observer();
    write_now();
    expect_observed(0, 10, 10);
    TEST_ASSERT_EQUAL_size_t(21, observed);
    tl_writer_bench_close_well(&bench);
}

/* Behind damaged bytes the observer continues. */
static void test_an_observer_of_a_damaged_queue(void) {
    open_with_observer();
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    size_t at = (size_t)(bench.twin.ring - (unsigned char *)bench.memory[0]) + (size_t)bench.state->taken[0].ring;
    tl_writer_bench_put(&bench, 10, 10);
    memset((unsigned char *)bench.memory[0] + at, 0xEE, 64);
    write_now();
    TEST_ASSERT_EQUAL_size_t(21, observed);
    tl_record_queue_open(&bench.settings[0], bench.memory[0], &bench.state->taken[0], &bench.twin);
    tl_writer_bench_start(&bench, 2);
    tl_writer_bench_put(&bench, 20, 10);
    tl_writer_bench_write_until(&bench, 40);
    write_now();
    expect_observed(observed - 21, 20, 10);
    tl_writer_bench_close_well(&bench);
}

static tl_run_changes made_changes(const tl_run_finding *findings, size_t count) {
    static const unsigned char bytes[] = "learned";
    return (tl_run_changes){.detection = {.is_ready = true, .learnt = 60, .needed = 60, .watched = 5},
                            .finding = findings,
                            .count = count,
                            .learned = bytes,
                            .size = sizeof bytes};
}

static void expect_learned(uint32_t last) {
    unsigned char *bytes = NULL;
    size_t size = 0;
    uint32_t found = 0;
    TEST_ASSERT_TRUE(tl_recorder_writer_read_learned(bench.writer, &bytes, &size, &found));
    TEST_ASSERT_EQUAL_UINT32(last, found);
    TEST_ASSERT_EQUAL_size_t(sizeof "learned", size);
    TEST_ASSERT_EQUAL_STRING("learned", (char *)bytes);
    free(bytes);
}

static void expect_in_history(void) {
    tl_history *history = NULL;
    const tl_history_run *run = NULL;
    const tl_history_finding *found = NULL;
    size_t count = 0;
    bool any = false;
    tl_run_detection detection = {0};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_history_open(bench.path, &history, &bench.error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_history_find(history, 0, &run, &bench.error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_findings(history, run, &found, &count, &bench.error),
                                  bench.error.text);
    TEST_ASSERT_EQUAL_size_t(2, count);
    TEST_ASSERT_EQUAL_STRING("gone", found[0].row.state);
    TEST_ASSERT_EQUAL_STRING("a\nb", found[0].row.also);
    TEST_ASSERT_EQUAL_STRING("drive", found[0].row.says);
    TEST_ASSERT_TRUE(found[0].row.gone > 19.9 && isnan(found[1].row.size) && found[0].started != 0);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_history_detection(history, run, &detection, &any, &bench.error));
    TEST_ASSERT_TRUE(any && detection.is_ready && detection.watched > 4.9);
    tl_history_close(history);
}

static void test_changes_are_kept(void) {
    tl_run_finding findings[2] = {
        {1, "step", "correction", "motor.d", "drive", "Nm", 5.5, 0.5, 7, (double)NAN, -2, 0.1, -5, "a\nb", "plant",
         "open"},
        {2, "freeze", "signal", "omega", "", "", 6, 1, 8, 9, (double)NAN, (double)NAN, (double)NAN, "", "", "gone"}};
    tl_run_changes changes = made_changes(findings, 2);
    tl_writer_bench_open(&bench);
    TEST_ASSERT_FALSE(tl_recorder_writer_keep(bench.writer, &changes)); /* there is no run */
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    tl_faulty_vfs_refuse(SQLITE_FULL, 0);
    TEST_ASSERT_FALSE(tl_recorder_writer_keep(bench.writer, &changes));
    tl_faulty_vfs_refuse(SQLITE_OK, 0);
    TEST_ASSERT_TRUE(tl_recorder_writer_keep(bench.writer, &changes));
    expect_learned(2);
    findings[0].state = "gone";
    findings[0].gone = 20;
    TEST_ASSERT_TRUE(tl_recorder_writer_keep(bench.writer, &changes));
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT abs((julianday(onset_at) - julianday(started)) * 86400 - 5.5) < 0.002 AND"
                                   " onset_s = 5.5 FROM findings JOIN runs USING (run) WHERE finding = 1"));
    expect_in_history();
    findings[0].state = "open";
    tl_writer_bench_open(&bench);
    TEST_ASSERT_TRUE(tl_recorder_writer_keep(bench.writer, &changes));
    changes = made_changes(&findings[1], 1);
    changes.is_new = true;
    TEST_ASSERT_TRUE(tl_recorder_writer_keep(bench.writer, &changes));
    TEST_ASSERT_FALSE(tl_recorder_writer_is_removed(bench.writer));
    tl_writer_bench_close_well(&bench);
    TEST_ASSERT_EQUAL_STRING("normal gone", tl_sql_text(bench.path, "SELECT group_concat(state, ' ') FROM"
                                                                    " (SELECT state FROM findings ORDER BY finding)"));
}

/* What was learnt is not returned if it is damaged, and is not stored if it is too large. */
static void test_what_was_learnt_is_checked(void) {
    static const unsigned char large[200000];
    unsigned char *bytes = NULL;
    size_t size = 0;
    uint32_t last = 0;
    tl_run_changes changes = made_changes(NULL, 0);
    bench.record.max_bytes = 1000000;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_TRUE(tl_recorder_writer_keep(bench.writer, &changes));
    expect_learned(0);
    tl_sql_execute(bench.path, "UPDATE learned SET bytes = x'00'");
    TEST_ASSERT_TRUE(tl_recorder_writer_read_learned(bench.writer, &bytes, &size, &last));
    TEST_ASSERT_NULL(bytes);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_finding_notes_forget(bench.path, &bench.error), bench.error.text);
    TEST_ASSERT_TRUE(tl_recorder_writer_is_removed(bench.writer));
    TEST_ASSERT_TRUE(tl_recorder_writer_keep(bench.writer, &changes)); /* by a writer that does not know it yet */
    TEST_ASSERT_TRUE(tl_recorder_writer_is_removed(bench.writer));
    changes.is_new = true;
    changes.learned = large;
    changes.size = sizeof large;
    TEST_ASSERT_TRUE(tl_recorder_writer_keep(bench.writer, &changes));
    TEST_ASSERT_FALSE(tl_recorder_writer_is_removed(bench.writer));
    TEST_ASSERT_EQUAL_STRING("watching 0",
                             tl_sql_text(bench.path, "SELECT state || ' ' || length(bytes) FROM learned"));
    TEST_ASSERT_TRUE(tl_recorder_writer_read_learned(bench.writer, &bytes, &size, &last));
    TEST_ASSERT_NULL(bytes);
    tl_writer_bench_close_well(&bench);
}

/* ---- Invalid queues ---- */

static void test_invalid_numbers(void) {
    static tl_record_queue_start start;
    tl_sample sample;
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    tl_history *history = NULL;
    const tl_history_run *run = NULL;
    static const int64_t ticks[] = {INT64_MIN, -1, 5, INT64_MAX / 2, INT64_MAX};
    tl_writer_bench_open(&bench);
    tl_record_queue_control *control = bench.memory[0];
    start = (tl_record_queue_start){.resumption = {.from = TL_RESUMED_CHECKPOINT,
                                                   .run = INT64_MAX,
                                                   .tick = INT64_MAX,
                                                   .start = INT64_MAX,
                                                   .started = INT64_MAX},
                                    .account = {.components = 1, .prediction = UINT32_MAX, .lead = UINT32_MAX}};
    memcpy(start.account.component[0].name, "\xC3\xA4", 2);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&bench.twin, &start));
    for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; i++) {
        tl_made_sample(0, &sample);
        sample.tick = ticks[i];
        sample.stamps[0] = INT64_MIN;
        sample.stamps[1] = INT64_MAX;
        TEST_ASSERT_TRUE(tl_record_queue_put_sample(&bench.twin, &sample));
        tl_made_record(0, &record);
        record.step = ticks[i];
        record.used = INT64_MIN;
        memset(ledger, 0xFF, sizeof ledger);
        TEST_ASSERT_TRUE(tl_record_queue_put_step(&bench.twin, &record, ledger));
        tl_record_queue_event(&bench.twin, ticks[i], TL_EVENT_INFO, "\xFF", "\xC3");
        control->slots[i].entry.at = ticks[i];
    }
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "\xFF"));
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_STRING("1 1 8", tl_sql_text(bench.path, "SELECT samples_written || ' ' || steps_written || ' ' ||"
                                                              " entries_lost FROM runs"));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_open(bench.path, &history, &bench.error), bench.error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_find(history, 1, &run, &bench.error), bench.error.text);
    tl_history_ticks *walk = NULL;
    tl_history_tick tick;
    bool end = false;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_history_ticks_begin(history, run, 0, &walk, &bench.error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_ticks_next(walk, &tick, &end, &bench.error), bench.error.text);
    TEST_ASSERT_EQUAL_INT64(5, tick.sample.tick);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_ticks_next(walk, &tick, &end, &bench.error), bench.error.text);
    TEST_ASSERT_TRUE(end);
    tl_history_ticks_end(walk);
    const tl_run_component *components = NULL;
    size_t count = 0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_ledger(history, run, &components, &count, &bench.error),
                                  bench.error.text);
    tl_history_close(history);
}

/* The damage is reported once, other queues are still written, and a repaired queue is read
 * again. */
static void test_a_damaged_queue(void) {
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    TEST_ASSERT_EQUAL_INT64(0, tl_recorder_writer_damage(bench.writer, 0));
    tl_time before = tl_clock_now(NULL);
    size_t at = (size_t)(bench.twin.ring - (unsigned char *)bench.memory[0]) + (size_t)bench.state->taken[0].ring;
    tl_writer_bench_put(&bench, 10, 10);
    memset((unsigned char *)bench.memory[0] + at, 0xEE, 64);
    tl_record_queue_event(&bench.io, 1, TL_EVENT_INFO, "io", "an event");
    write_now();
    write_now();
    TEST_ASSERT_EQUAL_UINT64(21, written());
    tl_time found = tl_recorder_writer_damage(bench.writer, 0);
    TEST_ASSERT_TRUE(found >= before && found <= tl_clock_now(NULL));
    TEST_ASSERT_EQUAL_INT64(0, tl_recorder_writer_damage(bench.writer, 1));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "queue|twin|corrupted"));
    tl_record_queue_open(&bench.settings[0], bench.memory[0], &bench.state->taken[0], &bench.twin);
    tl_writer_bench_start(&bench, 2);
    tl_writer_bench_put(&bench, 20, 10);
    tl_writer_bench_write_until(&bench, 41);
    TEST_ASSERT_EQUAL_INT64(0, tl_recorder_writer_damage(bench.writer, 0));
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
    TEST_ASSERT_EQUAL_INT64(2, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "queue|twin|corrupted"));
}

/* ---- Samples of the I/O process ---- */

/* Samples of the I/O process have the value 1e6, those of the twin do not. */
static void take_of_plant(void *context, int64_t tick, tl_time instant, tl_sample *sample) {
    (void)context;
    *sample = (tl_sample){.tick = tick, .instant = instant};
    for (size_t i = 0; i < TL_MADE_PLANT; i++) {
        sample->values[i] = 1e6;
        sample->stamps[i] = instant;
    }
}

static void open_with_plant(void) {
    bench.plant = (tl_recorder_plant){.take = take_of_plant, .kept = 12 * TL_SECOND};
    tl_writer_bench_open(&bench);
}

/* Puts ticks and damages the first entry. */
static void spoil_next(void) {
    size_t at = (size_t)(bench.twin.ring - (unsigned char *)bench.memory[0]) + (size_t)bench.twin.written;
    tl_writer_bench_put(&bench, 10, 10);
    ((unsigned char *)bench.memory[0])[at + 30] ^= 1;
}

static void write_until_read_on(void) {
    for (int i = 0; i < 1000 && bench.state->taken[0].ring != bench.twin.written; i++) {
        write_now();
        usleep(5000);
    }
    TEST_ASSERT_EQUAL_UINT64(bench.twin.written, bench.state->taken[0].ring);
}

static void expect_ticks(int64_t of_plant, int64_t all) {
    TEST_ASSERT_EQUAL_INT64(all, ask("SELECT count(DISTINCT tick) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(all - 1, ask("SELECT max(tick) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(of_plant, ask("SELECT count(DISTINCT tick) FROM samples WHERE value = 1e6"));
}

/* Only steps are lost with damaged entries, also if another recorder continues. */
static void test_a_ring_that_is_skipped(void) {
    open_with_plant();
    tl_writer_bench_start(&bench, tl_clock_now(NULL) - TL_SECOND);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    spoil_next();
    ((struct tl_record_queue_control *)bench.memory[0])->lost += UINT64_C(1) << 40;
    write_until_read_on();
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_open(&bench);
    tl_writer_bench_put(&bench, 20, 10);
    write_until_read_on();
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "SIGTERM"));
    tl_writer_bench_close_well(&bench);
    expect_ticks(10, 30);
    TEST_ASSERT_EQUAL_INT64(10, ask("SELECT entries_lost FROM runs"));
    TEST_ASSERT_EQUAL_INT64(20, ask("SELECT count(*) FROM steps"));
    TEST_ASSERT_EQUAL_INT64(1, tl_writer_bench_count_own(bench.path, "queue|twin|corrupted"));
    tl_writer_bench_expect_whole(bench.path);
}

/* Missing samples come from the I/O process until the next run starts. A late sample of the twin
 * replaces them. */
static void test_samples_that_the_twin_does_not_hand_over(void) {
    tl_time start = tl_clock_now(NULL) - 11 * TL_SECOND;
    open_with_plant();
    tl_writer_bench_start(&bench, start);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    /* too late for a sample of the twin */
    TEST_ASSERT_GREATER_THAN_INT64(0, ask("SELECT count(*) FROM samples WHERE value = 1e6"));
    int64_t before = ask("SELECT max(tick) FROM samples");
    TEST_ASSERT_TRUE(before > 9 && before < 400); /* the twin may still put later ones */
    tl_writer_bench_put(&bench, 10, 1);
    write_now();
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT count(*) FROM samples WHERE tick = 10 AND value = 1e6"));
    tl_writer_bench_start(&bench, start + 5 * TL_SECOND);
    write_now();
    TEST_ASSERT_EQUAL_INT64(500, ask("SELECT count(DISTINCT tick) FROM samples WHERE samples.run = 1"));
    TEST_ASSERT_EQUAL_INT64(0, ask("SELECT sum(entries_lost) FROM runs"));
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
}

/* After a damaged start, the run of the following entries is unknown, so that they are dropped. */
static void test_a_start_that_is_skipped(void) {
    open_with_plant();
    tl_writer_bench_start(&bench, tl_clock_now(NULL) - TL_SECOND);
    tl_writer_bench_put(&bench, 0, 10);
    write_now();
    uint64_t at = bench.twin.written;
    tl_writer_bench_start(&bench, tl_clock_now(NULL) - TL_SECOND / 2);
    bench.twin.ring[at + 30] ^= 1;
    write_until_read_on();
    tl_writer_bench_put(&bench, 0, 20);
    write_until_read_on();
    TEST_ASSERT_EQUAL_INT64(1, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(10, ask("SELECT count(*) FROM steps"));
    TEST_ASSERT_EQUAL_INT64(10, ask("SELECT count(DISTINCT tick) FROM samples WHERE value <> 1e6"));
    tl_writer_bench_start(&bench, tl_clock_now(NULL));
    write_now();
    TEST_ASSERT_EQUAL_INT64(2, ask("SELECT count(*) FROM runs"));
    TEST_ASSERT_TRUE(ask("SELECT count(DISTINCT tick) FROM samples WHERE samples.run = 1") >= 200);
    tl_writer_bench_close_well(&bench);
    tl_writer_bench_expect_whole(bench.path);
}

int main(void) {
    tl_faulty_vfs_install();
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_recorder_writer");
    UNITY_BEGIN();
    RUN_TEST(test_a_run_from_start_to_end);
    RUN_TEST(test_stamps_count_from_the_start);
    RUN_TEST(test_runs_follow_each_other);
    RUN_TEST(test_checkpoints);
    RUN_TEST(test_a_run_continues_in_its_row);
    RUN_TEST(test_a_run_continues_after_another_recorder);
    RUN_TEST(test_a_disk_that_is_full_at_first);
    RUN_TEST(test_a_folder_that_is_created_later);
    RUN_TEST(test_a_lock_of_another_program);
    RUN_TEST(test_another_twinlock);
    RUN_TEST(test_lost_entries_of_a_full_disk);
    RUN_TEST(test_entries_that_are_not_written_at_the_end);
    RUN_TEST(test_batches_end_between_ticks);
    RUN_TEST(test_an_observer_and_a_full_disk);
    RUN_TEST(test_an_observer_of_a_successor);
    RUN_TEST(test_an_observer_of_a_damaged_queue);
    RUN_TEST(test_changes_are_kept);
    RUN_TEST(test_what_was_learnt_is_checked);
    RUN_TEST(test_invalid_numbers);
    RUN_TEST(test_a_damaged_queue);
    RUN_TEST(test_a_ring_that_is_skipped);
    RUN_TEST(test_samples_that_the_twin_does_not_hand_over);
    RUN_TEST(test_a_start_that_is_skipped);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
