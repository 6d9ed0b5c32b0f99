/* The rows of a run: all of them in all bits and in order, over many statements; damaged rows. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/store/history.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"

enum { TICKS = 5000, STEPS = TICKS - TL_MADE_PREDICTION }; /* several statements */

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_history *history;
static const tl_history_run *run;
static tl_error error;

/* Rows that the visitor has received. */
static int64_t counts[TL_HISTORY_ADJUSTMENTS + 1];
static int64_t first[TL_HISTORY_ADJUSTMENTS + 1];
static int64_t events;

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    memset(counts, 0, sizeof counts);
    events = 0;
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_history_close(history);
    history = NULL;
    tl_scratch_empty(&scratch);
}

static void expect_ok(tl_status status) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
}

static void record_run(int64_t ticks) {
    const tl_recorder_settings settings = tl_made_settings(path);
    tl_recorder *recorder = NULL;
    expect_ok(tl_recorder_open(&settings, &recorder, &error));
    for (int64_t i = 0; i < 5; i++) {
        char text[32];
        (void)snprintf(text, sizeof text, "event %d", (int)i);
        tl_recorder_event(recorder, i == 0 ? -1 : i, TL_EVENT_WARNING, "plant", text);
    }
    tl_made_put(recorder, 0, ticks);
    expect_ok(tl_recorder_close(recorder, "end of recording", NULL, &error));
}

static void open_run(void) {
    expect_ok(tl_history_open(path, &history, &error));
    expect_ok(tl_history_find(history, 0, &run, &error));
}

/* ---- The visitor ---- */

/* Numbers that are not finite are read as NaN. */
static void expect_number(double expected, double found) {
    if (isfinite(expected)) {
        TEST_ASSERT_EQUAL_MEMORY(&expected, &found, sizeof found);
    } else {
        TEST_ASSERT_TRUE(isnan(found));
    }
}

/* The next row of a table with this many signals has the expected tick or step, and signal. */
static void expect_next(tl_history_table table, int64_t signals, int64_t number, size_t signal) {
    TEST_ASSERT_EQUAL_INT64(first[table] + counts[table] / signals, number);
    TEST_ASSERT_EQUAL_size_t((size_t)(counts[table] % signals), signal);
    counts[table]++;
}

static void see_sample(void *context, const tl_history_sample *found) {
    tl_sample sample;
    (void)context;
    expect_next(TL_HISTORY_SAMPLES, TL_MADE_PLANT, found->tick, found->signal);
    tl_made_sample(found->tick, &sample);
    expect_number(sample.values[found->signal], found->value);
    TEST_ASSERT_EQUAL_INT64(sample.quality[found->signal], found->quality);
    TEST_ASSERT_EQUAL_INT64(sample.stamps[found->signal], found->stamp);
}

static void see_step(void *context, const tl_history_step *found) {
    tl_record record;
    (void)context;
    expect_next(TL_HISTORY_STEPS, 1, found->step, 0);
    tl_made_record(found->step, &record);
    TEST_ASSERT_EQUAL_INT64(record.outcome, found->outcome);
    TEST_ASSERT_EQUAL_INT64(record.stop, found->stop);
    expect_number(record.objective, found->objective);
    expect_number(record.objective_nominal, found->objective_nominal);
    TEST_ASSERT_EQUAL_INT64(record.evaluations, found->evaluations);
    TEST_ASSERT_EQUAL_INT64(record.executions, found->executions);
    TEST_ASSERT_EQUAL_INT64(record.used, found->used);
    TEST_ASSERT_EQUAL_INT64(record.predicted, found->predicted);
    TEST_ASSERT_EQUAL_UINT32(record.flags, found->flags);
    TEST_ASSERT_EQUAL_UINT32(record.held, found->held);
}

static void see_output(void *context, const tl_history_output *found) {
    tl_record record;
    (void)context;
    expect_next(TL_HISTORY_OUTPUTS, TL_MADE_MATCH, found->step, found->signal);
    tl_made_record(found->step, &record);
    expect_number(record.y[found->signal], found->y);
    expect_number(record.measured[found->signal], found->measured);
    TEST_ASSERT_EQUAL_INT64(record.measured_quality[found->signal], found->quality);
    TEST_ASSERT_EQUAL_INT64(record.readings[found->signal].count, found->readings);
    expect_number(record.readings[found->signal].squares, found->squares);
    TEST_ASSERT_EQUAL_INT64(record.readings[found->signal].rejected, found->rejected);
    expect_number(record.release_age != 0 ? record.released[found->signal] : (double)NAN, found->released);
}

static void see_adjustment(void *context, const tl_history_adjustment *found) {
    tl_record record;
    (void)context;
    expect_next(TL_HISTORY_ADJUSTMENTS, TL_MADE_ADJUST, found->step, found->signal);
    tl_made_record(found->step, &record);
    expect_number(record.u[found->signal], found->u);
    expect_number(record.nominal[found->signal], found->nominal);
}

static void see_event(void *context, const tl_history_event *found) {
    const int64_t *from = context;
    char text[32];
    (void)snprintf(text, sizeof text, "event %d", (int)(*from + events));
    TEST_ASSERT_EQUAL_STRING(text, found->text);
    TEST_ASSERT_EQUAL_STRING("warning", found->severity);
    TEST_ASSERT_EQUAL_STRING("plant", found->source);
    TEST_ASSERT_TRUE(found->has_tick == (*from + events != 0));
    TEST_ASSERT_EQUAL_INT64(*from + events, found->tick);
    events++;
}

static const tl_history_visitor all = {
    .signals = {TL_MADE_PLANT, TL_MADE_MATCH, TL_MADE_ADJUST},
    .sample = see_sample,
    .step = see_step,
    .output = see_output,
    .adjustment = see_adjustment,
};

static tl_status visit(int64_t from, int64_t to) {
    const int64_t range[2] = {from, to};
    for (size_t i = 0; i < sizeof first / sizeof first[0]; i++) {
        first[i] = from;
    }
    return tl_history_rows(history, run, range, &all, &error);
}

/* ---- Tests ---- */

static void test_all_rows_in_all_bits(void) {
    record_run(TICKS);
    open_run();
    expect_ok(visit(0, TICKS));
    TEST_ASSERT_EQUAL_INT64((int64_t)TICKS * TL_MADE_PLANT, counts[TL_HISTORY_SAMPLES]);
    TEST_ASSERT_EQUAL_INT64(STEPS, counts[TL_HISTORY_STEPS]);
    TEST_ASSERT_EQUAL_INT64((int64_t)STEPS * TL_MADE_MATCH, counts[TL_HISTORY_OUTPUTS]);
    TEST_ASSERT_EQUAL_INT64((int64_t)STEPS * TL_MADE_ADJUST, counts[TL_HISTORY_ADJUSTMENTS]);
}

static void test_a_part_of_the_rows(void) {
    record_run(100);
    open_run();
    expect_ok(visit(10, 12));
    TEST_ASSERT_EQUAL_INT64(3 * TL_MADE_PLANT, counts[TL_HISTORY_SAMPLES]);
    TEST_ASSERT_EQUAL_INT64(3, counts[TL_HISTORY_STEPS]);
    TEST_ASSERT_EQUAL_INT64(3 * TL_MADE_MATCH, counts[TL_HISTORY_OUTPUTS]);
    TEST_ASSERT_EQUAL_INT64(3 * TL_MADE_ADJUST, counts[TL_HISTORY_ADJUSTMENTS]);
}

static void test_the_range_that_is_there(void) {
    int64_t range[2] = {-1, -1};
    bool any = false;
    record_run(100);
    open_run();
    expect_ok(tl_history_range(history, run, TL_HISTORY_SAMPLES, 7, range, &any, &error));
    TEST_ASSERT_TRUE(any && range[0] == 7 && range[1] == 99);
    expect_ok(tl_history_range(history, run, TL_HISTORY_OUTPUTS, 0, range, &any, &error));
    TEST_ASSERT_TRUE(any && range[0] == 0 && range[1] == 97);
    expect_ok(tl_history_range(history, run, TL_HISTORY_STEPS, 98, range, &any, &error));
    TEST_ASSERT_FALSE(any);
}

static void test_the_last_events(void) {
    static const int64_t most[] = {-1, 5, 2, 0};
    record_run(3);
    open_run();
    for (size_t i = 0; i < sizeof most / sizeof most[0]; i++) {
        int64_t expected = most[i] < 0 ? 5 : most[i];
        int64_t from = 5 - expected;
        const tl_history_visitor visitor = {.context = &from, .event = see_event};
        events = 0;
        expect_ok(tl_history_events(history, run, "", most[i], &visitor, &error));
        TEST_ASSERT_EQUAL_INT64(expected, events);
    }
}

/* The visitor may receive rows before the damage, but no damaged row. */
static void expect_damage(const char *sql) {
    record_run(20);
    tl_sql_execute(path, sql);
    open_run();
    memset(counts, 0, sizeof counts);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, visit(0, 19), sql);
    TL_EXPECT_PARTS("/run.db|damaged|run 1", error.text);
    tl_history_close(history);
    history = NULL;
    tl_scratch_empty(&scratch);
    error = (tl_error){TL_OK, ""};
}

static void test_impossible_rows_are_damage(void) {
    expect_damage("UPDATE samples SET value = 'text' WHERE tick = 4 AND signal = 1");
    expect_damage("UPDATE samples SET stamp_ns = 9223372036854775807 WHERE tick = 4 AND signal = 1");
    expect_damage("UPDATE steps SET predicted = -1 WHERE step = 4");
    expect_damage("UPDATE steps SET predicted = NULL WHERE step = 4");
    expect_damage("UPDATE steps SET flags = NULL WHERE step = 4");
    expect_damage("UPDATE steps SET flags = 4294967296 WHERE step = 4");
    expect_damage("UPDATE steps SET held = NULL WHERE step = 4");
    expect_damage("UPDATE steps SET held = 1.5 WHERE step = 4");
    expect_damage("UPDATE outputs SET measured = 9e999 WHERE step = 4");
    expect_damage("UPDATE outputs SET readings = NULL WHERE step = 4");
    expect_damage("UPDATE outputs SET rejected = NULL WHERE step = 4");
    expect_damage("UPDATE adjustments SET applied = x'00' WHERE step = 4");
    expect_damage("UPDATE adjustments SET signal = 2 WHERE step = 4 AND signal = 1");
}

/* SQLite checks NOT NULL when it writes, but not when it reads. */
static void test_unexpected_null(void) {
    static const char *const columns[][2] = {{"samples", "quality"},   {"steps", "outcome"}, {"steps", "stop"},
                                             {"steps", "evaluations"}, {"steps", "used_ns"}, {"outputs", "quality"}};
    for (size_t i = 0; i < sizeof columns / sizeof columns[0]; i++) {
        char sql[512];
        (void)snprintf(sql, sizeof sql,
                       "PRAGMA writable_schema = ON; UPDATE sqlite_schema SET"
                       " sql = replace(sql, '%s INTEGER NOT NULL', '%s INTEGER') WHERE name = '%s';"
                       "PRAGMA writable_schema = RESET; UPDATE %s SET %s = NULL",
                       columns[i][1], columns[i][1], columns[i][0], columns[i][0], columns[i][1]);
        expect_damage(sql);
    }
}

static void see_period(void *context, const tl_history_period *period) {
    TEST_ASSERT_EQUAL_INT64(run->run, period->run->run);
    TEST_ASSERT_GREATER_THAN_INT64(0, period->count);
    (*(int *)context)++;
}

static void test_impossible_periods_are_damage(void) {
    static const char *const changes[] = {"count = 0",
                                          "count = 'many'",
                                          "period = -1",
                                          "signal = -1",
                                          "mean = 'text'",
                                          "least = 9e999",
                                          "largest = x'00'",
                                          "spread = -9e999",
                                          "period = 1 << 60",
                                          "kind = x'00'",
                                          "count = 1.5",
                                          "signal = 0.5",
                                          "kind = 'a long name of a kind'"};
    for (size_t i = 0; i < sizeof changes / sizeof changes[0]; i++) {
        char sql[512];
        int seen = 0;
        const tl_history_visitor visitor = {.context = &seen, .period = see_period};
        record_run(20);
        open_run();
        expect_ok(tl_history_periods(history, run, TL_MINUTE, &visitor, &error));
        TEST_ASSERT_GREATER_THAN_INT(5, seen);
        tl_history_close(history);
        (void)snprintf(sql, sizeof sql, "UPDATE periods SET %s WHERE length_s = 60 AND kind = 'adjust' AND signal = 1",
                       changes[i]);
        tl_sql_execute(path, sql);
        open_run();
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, tl_history_periods(history, run, TL_MINUTE, &visitor, &error), sql);
        TL_EXPECT_PARTS("/run.db|damaged|run 1", error.text);
        tl_history_close(history);
        history = NULL;
        tl_scratch_empty(&scratch);
        error = (tl_error){TL_OK, ""};
    }
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_history_rows");
    UNITY_BEGIN();
    RUN_TEST(test_all_rows_in_all_bits);
    RUN_TEST(test_a_part_of_the_rows);
    RUN_TEST(test_the_range_that_is_there);
    RUN_TEST(test_the_last_events);
    RUN_TEST(test_impossible_rows_are_damage);
    RUN_TEST(test_unexpected_null);
    RUN_TEST(test_impossible_periods_are_damage);
    int failures = UNITY_END();
    tl_scratch_remove(&scratch);
    return failures;
}
