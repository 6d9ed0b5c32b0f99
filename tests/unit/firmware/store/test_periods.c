/* Minutes and hours: equal to what SQLite computes from the same rows; they span a year in a small
 * file. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include <sqlite3.h>

#include "firmware/store/database.h"
#include "firmware/store/periods.h"
#include "firmware/store/recorder.h"
#include "tests/support/made_run.h"
#include "tests/support/recorder_bench.h"
#include "tests/support/sql.h"

static tl_recorder_bench bench;

void setUp(void) {
    tl_bench_begin(&bench);
}

void tearDown(void) {
    tl_bench_end(&bench);
}

/* ---- Sums ---- */

/* Number of periods whose numbers differ from those of the rows. `table` has columns signal, value
 * and second. */
static int64_t count_wrong(const char *kind, const char *rows, int length_s) {
    char sql[2048];
    (void)snprintf(sql, sizeof sql,
                   "WITH rows AS (%s), means AS (SELECT second / %d AS period, signal, count(value) AS count,"
                   " avg(value) AS mean, min(value) AS least, max(value) AS largest FROM rows GROUP BY 1, 2"
                   " HAVING count(value) > 0),"
                   " spreads AS (SELECT m.period, m.signal, m.count, m.mean, m.least, m.largest,"
                   " sqrt(avg((value - mean) * (value - mean))) AS spread FROM means m JOIN rows r"
                   " ON r.second / %d = m.period AND r.signal = m.signal AND value IS NOT NULL GROUP BY 1, 2)"
                   " SELECT (SELECT count(*) FROM spreads s LEFT JOIN periods p ON p.length_s = %d AND p.kind = '%s'"
                   " AND p.run = 1 AND p.period = s.period AND p.signal = s.signal WHERE p.count IS NOT s.count"
                   " OR p.least <> s.least OR p.largest <> s.largest OR abs(p.mean - s.mean) > 1e-9"
                   " OR abs(p.spread - s.spread) > 1e-9)"
                   " + abs((SELECT count(*) FROM spreads) - (SELECT count(*) FROM periods"
                   " WHERE length_s = %d AND kind = '%s' AND run = 1))",
                   rows, length_s, length_s, length_s, kind, length_s, kind);
    return tl_sql_integer(bench.path, sql);
}

static void expect_right_periods(void) {
    static const struct {
        const char *kind, *rows;
    } kinds[] = {
        {"plant", "SELECT tick * 7 / 10 AS second, signal, iif(quality = 0, value, NULL) AS value FROM samples"},
        {"match", "SELECT step * 7 / 10 AS second, signal, iif(quality = 0, error, NULL) AS value FROM outputs"},
        {"adjust", "SELECT step * 7 / 10 AS second, signal, correction AS value FROM adjustments"},
    };
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; i++) {
        TEST_ASSERT_EQUAL_INT64_MESSAGE(0, count_wrong(kinds[i].kind, kinds[i].rows, TL_MINUTE), kinds[i].kind);
        TEST_ASSERT_EQUAL_INT64_MESSAGE(0, count_wrong(kinds[i].kind, kinds[i].rows, TL_HOUR), kinds[i].kind);
    }
    TEST_ASSERT_EQUAL_INT64(tl_sql_integer(bench.path, "SELECT count(*) FROM steps"),
                            tl_sql_integer(bench.path, "SELECT sum(count) FROM v_minutes WHERE kind = 'outcome'"));
    TEST_ASSERT_EQUAL_INT64(
        tl_sql_integer(bench.path, "SELECT count(*) FROM steps WHERE step * 7 / 10 / 3600 = 1 AND outcome = 2"),
        tl_sql_integer(bench.path, "SELECT count FROM v_hours WHERE kind = 'outcome' AND name = 'optimised'"
                                   " AND time_s = 3600"));
}

/* A run of T_S = 0.7 s with a pause of three hours. Qualities and NULLs vary. */
static void make_rows(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_bench_open(&bench, &settings);
    tl_bench_close(&bench, "end");
    tl_sql_execute(bench.path,
                   "UPDATE runs SET step_ns = 700000000, ended = NULL;"
                   "WITH RECURSIVE ticks (tick) AS (VALUES (0) UNION ALL SELECT tick + 1 FROM ticks WHERE tick < 11999)"
                   " INSERT INTO samples (run, tick, signal, value, quality)"
                   " SELECT 1, tick + iif(tick < 7000, 0, 15429), value, 1e5 + abs(random() % 1000) * 1e-6,"
                   " iif(random() % 9 = 0, 3, 0) FROM ticks, json_each('[0, 1, 2]');"
                   "INSERT INTO steps (run, step, t_ns, outcome, stop, evaluations, executions, used_ns)"
                   " SELECT 1, tick, 0, 1 + abs(random() % 3), 0, 0, 0, 0 FROM (SELECT DISTINCT tick FROM samples);"
                   "INSERT INTO outputs (run, step, signal, simulated, measured, quality)"
                   " SELECT 1, step, value, iif(random() % 7 = 0, NULL, random() * 1e-18), random() * 1e-18,"
                   " iif(random() % 9 = 0, 1, 0) FROM steps, json_each('[0, 1]');"
                   "INSERT INTO adjustments (run, step, signal, applied, nominal)"
                   " SELECT 1, step, 1, random() * 1e-18, 2.5 FROM steps");
}

/* Summarises up to each of these ticks, in a transaction of its own, by a new object if asked. */
static void summarise(const int64_t *ticks, size_t count, bool reopens) {
    sqlite3 *database = NULL;
    tl_periods *periods = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_database_open(bench.path, true, &database, &bench.error));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_open(database, &periods));
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, ticks[i], -1));
        if (reopens) {
            tl_periods_close(periods);
            TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_open(database, &periods));
        }
    }
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_end(periods, 1));
    tl_periods_close(periods);
    (void)sqlite3_close(database);
}

static void test_sums_of_one_pass(void) {
    make_rows();
    summarise(NULL, 0, false);
    expect_right_periods();
}

static void test_sums_in_pieces(void) {
    static const int64_t ticks[] = {1, 85, 86, 87, 4000, 5142, 5143, 6999, 7000, 22429, 22430, 27000, 27000};
    make_rows();
    summarise(ticks, sizeof ticks / sizeof ticks[0], false);
    expect_right_periods();
}

static void test_sums_after_restarts(void) {
    static const int64_t ticks[] = {1, 85, 86, 87, 4000, 5142, 5143, 6999, 7000, 22429, 22430, 27000, 27000};
    make_rows();
    summarise(ticks, sizeof ticks / sizeof ticks[0], true);
    expect_right_periods();
    summarise(ticks, 3, true); /* again */
    expect_right_periods();
}

/* A minute is written only when it is complete. */
static void test_complete_minutes(void) {
    sqlite3 *database = NULL;
    tl_periods *periods = NULL;
    make_rows();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_database_open(bench.path, true, &database, &bench.error));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_open(database, &periods));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, 85, -1)); /* begins at 59.5 s */
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM periods"));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, 86, -1));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(DISTINCT period) FROM periods"));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, 5142, -1)); /* begins at 3599.4 s */
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM v_hours"));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, 5143, -1));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(DISTINCT time_s) FROM v_hours"));
    tl_periods_close(periods);
    (void)sqlite3_close(database);
}

/* Steps that never come do not stop the minutes, and an end is summarised in any case. */
static void test_missing_steps(void) {
    sqlite3 *database = NULL;
    tl_periods *periods = NULL;
    make_rows();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_database_open(bench.path, true, &database, &bench.error));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_open(database, &periods));
    tl_sql_execute(bench.path, "UPDATE runs SET lead = 10");
    const int64_t late = 2 * 10 + 428; /* 300 s */
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, 0, 85 + late));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM periods"));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, 0, 86 + late));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(DISTINCT period) FROM periods"));
    tl_periods_close(periods);
    (void)sqlite3_close(database);
}

/* Numbers that the recorder does not write: nothing overflows, and nothing lasts for ever. */
static void test_damaged_numbers(void) {
    static const char *const damages[] = {
        "UPDATE runs SET step_ns = 0",
        "UPDATE runs SET step_ns = 4611686018427387904",
        "UPDATE runs SET lead = 9223372036854775807",
        "UPDATE steps SET step = 9223372036854775807 WHERE step = 22500",
        "UPDATE steps SET step = 2305843009213693950 WHERE step = 22500",
        "UPDATE steps SET step = 3294061441 WHERE step = 22500",
        "UPDATE samples SET tick = 4611686018427387904 WHERE tick = 22500",
        "INSERT INTO periods VALUES (60, 1, 9223372036854775807, 'plant', 0, 1, 1, 1, 1, 1)",
        "INSERT INTO periods VALUES (60, 1, -5, 'plant', 0, 1, 1, 1, 1, 1)",
        "INSERT INTO periods VALUES (60, 1, 3, 'plant', 0, 9223372036854775807, NULL, 1, 1, 1)",
    };
    for (size_t i = 0; i < sizeof damages / sizeof damages[0]; i++) {
        static const int64_t ticks[] = {86, 6999, 27000};
        make_rows();
        tl_sql_execute(bench.path, damages[i]);
        summarise(ticks, 3, true);
        summarise(ticks, 3, false);
        tl_scratch_empty(&bench.scratch);
    }
}

/* A run in safe hold has no steps. */
static void test_safe_hold(void) {
    sqlite3 *database = NULL;
    tl_periods *periods = NULL;
    make_rows();
    tl_sql_execute(bench.path,
                   "UPDATE runs SET verb = 'hold'; DELETE FROM steps; DELETE FROM outputs; DELETE FROM adjustments");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_database_open(bench.path, true, &database, &bench.error));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_open(database, &periods));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, tl_periods_until(periods, 1, -1, 86));
    TEST_ASSERT_EQUAL_INT64(3, tl_sql_integer(bench.path, "SELECT count(*) FROM v_minutes WHERE kind = 'plant'"));
    TEST_ASSERT_EQUAL_INT64(3, tl_sql_integer(bench.path, "SELECT count(*) FROM periods"));
    tl_periods_close(periods);
    (void)sqlite3_close(database);
}

/* ---- In the recorder ---- */

/* A run whose recorder was killed is summarised when the next run begins. */
static void test_a_killed_run(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 9000); /* 90 s */
    tl_bench_close(&bench, "end");
    tl_sql_execute(bench.path, "DELETE FROM periods WHERE length_s = 3600 OR period > 0;"
                               "UPDATE runs SET ended = NULL, ended_reason = NULL");
    tl_bench_open(&bench, &settings);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(8998,
                            tl_sql_integer(bench.path, "SELECT sum(count) FROM v_minutes WHERE kind = 'outcome'"));
    TEST_ASSERT_EQUAL_INT64(8998, tl_sql_integer(bench.path, "SELECT sum(count) FROM v_hours WHERE kind = 'outcome'"));
}

/* A year of steps of 600 s in 4 MB: the newest minutes and hours remain, as many as have room. */
static void test_a_year(void) {
    enum { STEPS_PER_HOUR = 6, HOURS = 365 * 24, BOUND = 4000000 };
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.max_bytes = BOUND;
    settings.step = 600 * TL_SECOND;
    settings.commit = TL_SECOND / 2;
    settings.adjust_count = settings.match_count = settings.plant_count = 1;
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, (int64_t)STEPS_PER_HOUR * HOURS + TL_MADE_PREDICTION);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(0, bench.counts.lost);
    const int64_t room = tl_periods_room(BOUND, 3);
    const int64_t hours =
        tl_sql_integer(bench.path, "SELECT count(DISTINCT period) FROM periods WHERE length_s = 3600");
    const int64_t minutes =
        tl_sql_integer(bench.path, "SELECT count(DISTINCT period) FROM periods WHERE length_s = 60");
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(room, hours);
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(room, minutes * 10); /* a step in ten minutes */
    TEST_ASSERT_EQUAL_INT64(HOURS, tl_sql_integer(bench.path, "SELECT max(period) FROM periods WHERE length_s = 3600"));
    TEST_ASSERT_EQUAL_INT64(STEPS_PER_HOUR,
                            tl_sql_integer(bench.path,
                                           "SELECT sum(count) FROM v_hours WHERE kind = 'outcome' AND time_s = 3600 *"
                                           " (SELECT max(period) - 1 FROM periods WHERE length_s = 3600)"));
    TEST_ASSERT_LESS_OR_EQUAL_INT64(BOUND, tl_sql_integer(bench.path, "SELECT page_count * page_size"
                                                                      " FROM pragma_page_count, pragma_page_size"));
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
}

int main(void) {
    /* In memory if possible, because a disk would sync often. */
    tl_scratch_make(&bench.scratch, access("/dev/shm", W_OK) == 0 ? "/dev/shm" : TL_BINARY_DIR, "test_periods");
    UNITY_BEGIN();
    RUN_TEST(test_sums_of_one_pass);
    RUN_TEST(test_sums_in_pieces);
    RUN_TEST(test_sums_after_restarts);
    RUN_TEST(test_complete_minutes);
    RUN_TEST(test_missing_steps);
    RUN_TEST(test_damaged_numbers);
    RUN_TEST(test_safe_hold);
    RUN_TEST(test_a_killed_run);
    RUN_TEST(test_a_year);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
