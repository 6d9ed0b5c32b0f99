/* The recorder: what it writes, into which files, and which files it does not change. */
#include <math.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/text.h"
#include "firmware/store/database.h"
#include "firmware/store/recorder.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/recorder_bench.h"
#include "tests/support/sql.h"
#include "tests/support/stderr_capture.h"

enum { TICKS = 500 };

static tl_recorder_bench bench;

void setUp(void) {
    tl_bench_begin(&bench);
}

void tearDown(void) {
    tl_bench_end(&bench);
}

static void record_run(int64_t ticks) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, ticks);
    tl_bench_close(&bench, "end of recording");
}

/* ---- Content ---- */

static void test_everything_put_is_written(void) {
    record_run(TICKS);
    TEST_ASSERT_EQUAL_INT64(2 * TICKS - TL_MADE_PREDICTION, bench.counts.written);
    TEST_ASSERT_EQUAL_INT64(0, bench.counts.lost);
    TEST_ASSERT_EQUAL_INT64(1, bench.counts.run);
    TEST_ASSERT_EQUAL_INT64(TICKS * TL_MADE_PLANT, tl_sql_integer(bench.path, "SELECT count(*) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(TICKS - 2, tl_sql_integer(bench.path, "SELECT count(*) FROM steps"));
    TEST_ASSERT_EQUAL_INT64((TICKS - 2) * TL_MADE_MATCH, tl_sql_integer(bench.path, "SELECT count(*) FROM outputs"));
    TEST_ASSERT_EQUAL_INT64((TICKS - 2) * TL_MADE_ADJUST,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM adjustments"));
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&bench.scratch)); /* no -wal, no -writer */
}

/* Numbers that are not finite are stored as NULL. */
static void expect_bits(double expected, sqlite3_stmt *row, int column) {
    if (!isfinite(expected)) {
        TEST_ASSERT_EQUAL_INT(SQLITE_NULL, sqlite3_column_type(row, column));
        return;
    }
    double stored = sqlite3_column_double(row, column);
    TEST_ASSERT_EQUAL_INT(SQLITE_FLOAT, sqlite3_column_type(row, column));
    TEST_ASSERT_EQUAL_MEMORY(&expected, &stored, sizeof expected);
}

static sqlite3_stmt *ask(sqlite3 *database, const char *sql) {
    sqlite3_stmt *statement = NULL;
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_prepare_v2(database, sql, -1, &statement, NULL));
    return statement;
}

static void test_samples_come_back_bit_for_bit(void) {
    record_run(TICKS);
    sqlite3 *database = NULL;
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(bench.path, &database));
    sqlite3_stmt *row =
        ask(database, "SELECT tick, signal, value, quality, stamp_ns FROM samples ORDER BY tick, signal");
    for (int64_t tick = 0; tick < TICKS; tick++) {
        tl_sample sample;
        tl_made_sample(tick, &sample);
        for (int i = 0; i < TL_MADE_PLANT; i++) {
            TEST_ASSERT_EQUAL_INT(SQLITE_ROW, sqlite3_step(row));
            TEST_ASSERT_EQUAL_INT64(tick, sqlite3_column_int64(row, 0));
            TEST_ASSERT_EQUAL_INT(i, sqlite3_column_int(row, 1));
            expect_bits(sample.values[i], row, 2);
            TEST_ASSERT_EQUAL_INT(sample.quality[i], sqlite3_column_int(row, 3));
            if (sample.stamps[i] == TL_TIME_NEVER) {
                TEST_ASSERT_EQUAL_INT(SQLITE_NULL, sqlite3_column_type(row, 4));
            } else {
                TEST_ASSERT_EQUAL_INT64(sample.stamps[i], sqlite3_column_int64(row, 4));
            }
        }
    }
    TEST_ASSERT_EQUAL_INT(SQLITE_DONE, sqlite3_step(row));
    (void)sqlite3_finalize(row);
    (void)sqlite3_close(database);
}

static void expect_head(const tl_record *record, sqlite3_stmt *row) {
    TEST_ASSERT_EQUAL_INT(SQLITE_ROW, sqlite3_step(row));
    TEST_ASSERT_EQUAL_INT64(record->step, sqlite3_column_int64(row, 0));
    TEST_ASSERT_EQUAL_INT64((record->step + 1) * 10000000, sqlite3_column_int64(row, 1));
    TEST_ASSERT_EQUAL_INT(record->outcome, sqlite3_column_int(row, 2));
    TEST_ASSERT_EQUAL_INT(record->stop, sqlite3_column_int(row, 3));
    expect_bits(record->objective, row, 4);
    expect_bits(record->objective_nominal, row, 5);
    TEST_ASSERT_EQUAL_INT64(record->evaluations, sqlite3_column_int64(row, 6));
    TEST_ASSERT_EQUAL_INT64(record->executions, sqlite3_column_int64(row, 7));
    TEST_ASSERT_EQUAL_INT64(record->used, sqlite3_column_int64(row, 8));
    TEST_ASSERT_EQUAL_INT64(record->predicted, sqlite3_column_int64(row, 9));
    TEST_ASSERT_EQUAL_INT64(record->flags, sqlite3_column_int64(row, 10));
    TEST_ASSERT_EQUAL_INT64(record->held, sqlite3_column_int64(row, 11));
    TEST_ASSERT_EQUAL_INT64(record->release_age, sqlite3_column_int64(row, 12));
}

static void test_steps_come_back_bit_for_bit(void) {
    record_run(TICKS);
    sqlite3 *database = NULL;
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(bench.path, &database));
    sqlite3_stmt *head =
        ask(database, "SELECT step, t_ns, outcome, stop, J, J_nominal, evaluations, executions, used_ns, predicted,"
                      " flags, held, release_age FROM steps ORDER BY step");
    sqlite3_stmt *output = ask(database, "SELECT simulated, measured, quality, error, readings, squares, rejected,"
                                         " released FROM outputs ORDER BY step, signal");
    sqlite3_stmt *adjusted =
        ask(database, "SELECT applied, nominal, correction FROM adjustments ORDER BY step, signal");
    for (int64_t step = 0; step < TICKS - 2; step++) {
        tl_record record;
        tl_made_record(step, &record);
        expect_head(&record, head);
        for (int i = 0; i < TL_MADE_MATCH; i++) {
            TEST_ASSERT_EQUAL_INT(SQLITE_ROW, sqlite3_step(output));
            expect_bits(record.y[i], output, 0);
            expect_bits(record.measured[i], output, 1);
            TEST_ASSERT_EQUAL_INT(record.measured_quality[i], sqlite3_column_int(output, 2));
            TEST_ASSERT_TRUE(sqlite3_column_double(output, 3) == record.y[i] - record.measured[i]);
            TEST_ASSERT_EQUAL_UINT32(record.readings[i].count, sqlite3_column_int64(output, 4));
            expect_bits(record.readings[i].squares, output, 5);
            TEST_ASSERT_EQUAL_UINT32(record.readings[i].rejected, sqlite3_column_int64(output, 6));
            expect_bits(record.release_age != 0 ? record.released[i] : (double)NAN, output, 7);
        }
        for (int i = 0; i < TL_MADE_ADJUST; i++) {
            TEST_ASSERT_EQUAL_INT(SQLITE_ROW, sqlite3_step(adjusted));
            expect_bits(record.u[i], adjusted, 0);
            expect_bits(record.nominal[i], adjusted, 1);
            TEST_ASSERT_TRUE(sqlite3_column_double(adjusted, 2) == record.u[i] - record.nominal[i]);
        }
    }
    (void)sqlite3_finalize(head);
    (void)sqlite3_finalize(output);
    (void)sqlite3_finalize(adjusted);
    (void)sqlite3_close(database);
}

static void test_numbers_that_are_not_finite(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_sample sample;
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    tl_bench_open(&bench, &settings);
    tl_made_sample(0, &sample);
    tl_made_record(0, &record);
    tl_made_ledger(0, ledger);
    sample.values[0] = (double)NAN;
    sample.values[1] = (double)INFINITY;
    record.y[0] = (double)-INFINITY;
    record.measured[1] = (double)NAN;
    record.u[0] = (double)NAN;
    record.nominal[1] = (double)INFINITY;
    record.objective = (double)NAN;
    tl_recorder_put_sample(bench.recorder, &sample);
    tl_recorder_put_step(bench.recorder, &record, ledger);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "SELECT count(*) FROM samples WHERE value IS NULL"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(*) FROM outputs WHERE simulated IS NULL"));
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "SELECT count(*) FROM outputs WHERE error IS NULL"));
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "SELECT count(*) FROM adjustments WHERE correction IS NULL"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(*) FROM steps WHERE J IS NULL"));
}

static void test_the_row_of_a_run(void) {
    record_run(10);
    TEST_ASSERT_EQUAL_INT64(0x74776C6B, tl_sql_integer(bench.path, "PRAGMA application_id"));
    TEST_ASSERT_EQUAL_INT64(TL_DATABASE_VERSION, tl_sql_integer(bench.path, "PRAGMA user_version"));
    TEST_ASSERT_EQUAL_INT64(TL_MADE_PREDICTION, tl_sql_integer(bench.path, "SELECT lead FROM runs"));
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "PRAGMA auto_vacuum"));
    TEST_ASSERT_EQUAL_STRING("wal", tl_sql_text(bench.path, "PRAGMA journal_mode"));
    TEST_ASSERT_EQUAL_STRING("replay|motor bench|end of recording|10000000|2|lag|10|8|0|0",
                             tl_sql_text(bench.path,
                                         "SELECT verb || '|' || name || '|' || ended_reason || '|' || step_ns ||"
                                         " '|' || prediction || '|' || measurements || '|' || samples_written ||"
                                         " '|' || steps_written || '|' || events_written || '|' || entries_lost"
                                         " FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT ended >= started AND ended = committed FROM runs"));
    TEST_ASSERT_EQUAL_INT64(1,
                            tl_sql_integer(bench.path, "SELECT text LIKE '{ \"twinlock\": 1,%' FROM configurations JOIN"
                                                       " runs ON configuration = hash"));
    TEST_ASSERT_EQUAL_INT64(7, tl_sql_integer(bench.path, "SELECT count(*) FROM signals WHERE signals.run = 1"));
    TEST_ASSERT_EQUAL_STRING("motor.i|A|Real|plant.torque",
                             tl_sql_text(bench.path, "SELECT name || '|' || unit || '|' || type || '|' || compared_with"
                                                     " FROM main.signals WHERE kind = 'match' AND signal = 1"));
}

/* The ledger is that of the last step. Without a step, all counts are 0. */
static void test_the_ledger(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 1);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_STRING("drive 0, motor 0, plant 0",
                             tl_sql_text(bench.path,
                                         "SELECT group_concat(name || ' ' || (plain + predicted + executions +"
                                         " repeated + uncached), ', ') FROM components"));
    record_run(TICKS);
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    tl_made_ledger(TICKS - TL_MADE_PREDICTION - 1, ledger);
    for (size_t i = 0; i < TL_MADE_COMPONENTS; i++) {
        char sql[160];
        char expected[160];
        (void)snprintf(sql, sizeof sql,
                       "SELECT plain || ' ' || predicted || ' ' || executions || ' ' || repeated || ' ' || uncached"
                       " FROM main.components WHERE run = 2 AND component = %zu",
                       i);
        (void)snprintf(expected, sizeof expected, "%llu %llu %llu %llu %llu", (unsigned long long)ledger[i].plain,
                       (unsigned long long)ledger[i].predicted, (unsigned long long)ledger[i].executions,
                       (unsigned long long)ledger[i].repeated, (unsigned long long)ledger[i].uncached);
        TEST_ASSERT_EQUAL_STRING(expected, tl_sql_text(bench.path, sql));
    }
    TEST_ASSERT_EQUAL_INT64(
        (int64_t)(ledger[1].plain - ledger[1].executions),
        tl_sql_integer(bench.path, "SELECT saved FROM v_ledger WHERE run = 2 AND component = 'motor'"));
    TEST_ASSERT_EQUAL_INT64((int64_t)(ledger[1].executions - ledger[1].repeated - ledger[1].predicted),
                            tl_sql_integer(bench.path, "SELECT difference FROM v_ledger WHERE run = 2 AND component ="
                                                       " 'motor'"));
    TEST_ASSERT_EQUAL_STRING(
        "drive, motor, plant",
        tl_sql_text(bench.path, "SELECT group_concat(component, ', ') FROM v_ledger WHERE run = 2"));
}

/* The table has bits, the view has words. */
static void test_flags_have_words(void) {
    record_run(10);
    tl_sql_execute(bench.path,
                   "UPDATE steps SET flags = 5, held = 2 WHERE step = 3; UPDATE steps SET flags = 0, held = 3"
                   " WHERE step = 4; UPDATE steps SET flags = 2, held = 0 WHERE step = 5");
    TEST_ASSERT_EQUAL_STRING("fallback, without nominal|drive.u",
                             tl_sql_text(bench.path, "SELECT flags || '|' || held FROM v_steps WHERE step = 3"));
    TEST_ASSERT_EQUAL_STRING("motor.d, drive.u",
                             tl_sql_text(bench.path, "SELECT held FROM v_steps WHERE step = 4 AND flags IS NULL"));
    TEST_ASSERT_EQUAL_STRING("stagnated",
                             tl_sql_text(bench.path, "SELECT flags FROM v_steps WHERE step = 5 AND held IS NULL"));
}

static void test_codes_have_their_names(void) {
    record_run(10);
    for (int i = TL_FREE; i < TL_OUTCOMES; i++) {
        char sql[64];
        (void)snprintf(sql, sizeof sql, "SELECT name FROM outcomes WHERE code = %d", i);
        TEST_ASSERT_EQUAL_STRING(tl_outcome_name((tl_outcome)i), tl_sql_text(bench.path, sql));
    }
    TEST_ASSERT_EQUAL_STRING("time", tl_sql_text(bench.path, "SELECT name FROM stops WHERE code = 4"));
    TEST_ASSERT_EQUAL_STRING("no link", tl_sql_text(bench.path, "SELECT name FROM qualities WHERE code = 4"));
    TEST_ASSERT_EQUAL_STRING("outlier", tl_sql_text(bench.path, "SELECT name FROM qualities WHERE code = 5"));
    TEST_ASSERT_EQUAL_INT64(7, tl_sql_integer(bench.path, "SELECT count(*) FROM qualities"));
    TEST_ASSERT_EQUAL_STRING("warning", tl_sql_text(bench.path, "SELECT name FROM severities WHERE code = 1"));
}

static void test_views_are_for_people(void) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.verb = "run";
    tl_bench_open(&bench, &settings);
    tl_recorder_event(bench.recorder, 3, TL_EVENT_WARNING, "plant", "the link is down");
    tl_made_put(bench.recorder, 0, 10);
    tl_bench_close(&bench, "SIGTERM");
    TEST_ASSERT_EQUAL_INT64(1,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM v_runs WHERE ended_reason = 'SIGTERM'"));
    TEST_ASSERT_EQUAL_INT64(30, tl_sql_integer(bench.path, "SELECT count(*) FROM v_samples WHERE at LIKE '20__-%Z'"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(*) FROM v_samples WHERE quality = 'no link' AND"
                                                          " name = 'plant.door' AND tick = 0"));
    TEST_ASSERT_EQUAL_INT64(8,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM v_steps JOIN outcomes ON name = outcome"));
    TEST_ASSERT_EQUAL_DOUBLE(0.03, tl_sql_number(bench.path, "SELECT time_s FROM v_steps WHERE step = 2"));
    TEST_ASSERT_EQUAL_INT64(8,
                            tl_sql_integer(bench.path, "SELECT count(*) FROM v_outputs WHERE name = 'motor.omega' AND"
                                                       " compared_with = 'plant.omega' AND unit = 'rad/s'"));
    TEST_ASSERT_EQUAL_INT64(8, tl_sql_integer(bench.path, "SELECT count(*) FROM v_corrections WHERE name = 'motor.d'"));
    TEST_ASSERT_EQUAL_STRING("3|warning|plant|the link is down",
                             tl_sql_text(bench.path,
                                         "SELECT tick || '|' || severity || '|' || source || '|' || text FROM"
                                         " v_events"));
}

/* ---- Events ---- */

static void test_events_are_cut_and_repaired(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    char text[400];
    tl_bench_open(&bench, &settings);
    memset(text, 'x', sizeof text);
    memcpy(text + 222, "\xC3\xA4", 2); /* the cut is inside of this character */
    text[sizeof text - 1] = '\0';
    tl_recorder_event(bench.recorder, -1, TL_EVENT_INFO, "a source that is much longer than thirty-one bytes", text);
    tl_recorder_event(bench.recorder, 5, TL_EVENT_ERROR, "f\xFFmu",
                      "gr\xC3\xB6\xC3\x9F"
                      "e \xE2\x82 \xED\xA0\x80 \xF0\x9F\x98\x80");
    tl_recorder_event(bench.recorder, 0, TL_EVENT_INFO, "", "");
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(3, bench.counts.written);
    TEST_ASSERT_EQUAL_INT64(31, tl_sql_integer(bench.path, "SELECT length(source) FROM events WHERE events.event = 1"));
    TEST_ASSERT_EQUAL_INT64(223, tl_sql_integer(bench.path, "SELECT length(text) FROM events WHERE events.event = 1"));
    TEST_ASSERT_EQUAL_STRING("?",
                             tl_sql_text(bench.path, "SELECT substr(text, 223) FROM events WHERE events.event = 1"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT tick IS NULL FROM events WHERE events.event = 1"));
    TEST_ASSERT_EQUAL_STRING("f?mu", tl_sql_text(bench.path, "SELECT source FROM events WHERE events.event = 2"));
    TEST_ASSERT_EQUAL_STRING("größe ?? ??? \xF0\x9F\x98\x80",
                             tl_sql_text(bench.path, "SELECT text FROM events WHERE events.event = 2"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT tick FROM events WHERE events.event = 3"));
}

/* ---- Files ---- */

static void test_runs_are_added(void) {
    record_run(10);
    record_run(20);
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.configuration = "{}";
    tl_bench_open(&bench, &settings);
    tl_bench_close(&bench, "SIGINT");
    TEST_ASSERT_EQUAL_INT64(3, bench.counts.run);
    TEST_ASSERT_EQUAL_INT64(3, tl_sql_integer(bench.path, "SELECT count(*) FROM runs"));
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "SELECT count(*) FROM configurations"));
    TEST_ASSERT_EQUAL_STRING("44136fa355b3678a1146ad16f7e8649e94fb4fc21fe77e8310c060f61caaff8a",
                             tl_sql_text(bench.path, "SELECT configuration FROM main.runs WHERE run = 3"));
}

static void write_file(const char *bytes, size_t size) {
    FILE *file = fopen(bench.path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_size_t(size, fwrite(bytes, 1, size, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

static size_t read_file(char *bytes, size_t size) {
    FILE *file = fopen(bench.path, "rb");
    TEST_ASSERT_NOT_NULL(file);
    size_t length = fread(bytes, 1, size, file);
    (void)fclose(file);
    return length;
}

/* The log of a removed database must not be written into the new database. */
static void test_a_log_of_a_removed_database(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    char other[PATH_MAX + 8];
    (void)snprintf(other, sizeof other, "%s-keep", bench.path);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 100);
    usleep(100000);
    TEST_ASSERT_EQUAL_INT(0, link(bench.wal, other));
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT(0, unlink(bench.path));
    TEST_ASSERT_EQUAL_INT(0, rename(other, bench.wal));
    record_run(10);
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(bench.path, "PRAGMA integrity_check"));
    TEST_ASSERT_EQUAL_INT64(30, tl_sql_integer(bench.path, "SELECT count(*) FROM samples"));
}

/* The recorder refuses the file at `path` and does not change it. The error has the path and all
 * parts. */
static void expect_refused(tl_status status, const char *parts) {
    static char before[1 << 20];
    static char after[1 << 20];
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    size_t length = read_file(before, sizeof before);
    int files = tl_scratch_count(&bench.scratch);
    bench.error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(status, tl_recorder_open(&settings, &bench.recorder, &bench.error));
    TEST_ASSERT_NULL(bench.recorder);
    TEST_ASSERT_EQUAL_INT(status, bench.error.status);
    TL_EXPECT_PARTS(bench.path, bench.error.text);
    TL_EXPECT_PARTS(parts, bench.error.text);
    TEST_ASSERT_EQUAL_size_t(length, read_file(after, sizeof after));
    TEST_ASSERT_EQUAL_INT(0, memcmp(before, after, length));
    TEST_ASSERT_EQUAL_INT(files, tl_scratch_count(&bench.scratch));
}

static void test_foreign_files(void) {
    static char text[4096];
    memset(text, 'a', sizeof text);
    write_file("", 0);
    expect_refused(TL_BAD_DATA, "twinlock|0 bytes");
    write_file("time,omega\n0,1\n", 15);
    expect_refused(TL_BAD_DATA, "twinlock|15 bytes");
    write_file(text, sizeof text);
    expect_refused(TL_BAD_DATA, "twinlock|SQLite");
    (void)unlink(bench.path);
    tl_sql_execute(bench.path, "CREATE TABLE mine (x); INSERT INTO mine VALUES (1)");
    expect_refused(TL_BAD_DATA, "another program");
}

/* Older and newer formats: the file is not changed, and the error names both formats. */
static void test_another_format(void) {
    static const int formats[] = {0, 1, 2, 3, 4, 5, 6, 7, 9};
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++) {
        char text[200];
        (void)snprintf(text, sizeof text, "PRAGMA application_id = 1953983595; PRAGMA user_version = %d", formats[i]);
        tl_sql_execute(bench.path, text);
        (void)snprintf(text, sizeof text, "format %d|format 8|twinlock", formats[i]);
        expect_refused(TL_BAD_DATA, text);
    }
}

/* The recorder refuses a path that is not a regular file, and creates no file. */
static void expect_no_place(const char *given, tl_status status, const char *parts) {
    const tl_recorder_settings settings = tl_made_settings(given);
    int files = tl_scratch_count(&bench.scratch);
    TEST_ASSERT_EQUAL_INT(status, tl_recorder_open(&settings, &bench.recorder, &bench.error));
    TEST_ASSERT_NULL(bench.recorder);
    TL_EXPECT_PARTS(parts, bench.error.text);
    TEST_ASSERT_EQUAL_INT(files, tl_scratch_count(&bench.scratch));
    bench.error = (tl_error){TL_OK, ""};
}

static void test_paths_that_are_not_a_regular_file(void) {
    struct stat file;
    TEST_ASSERT_EQUAL_INT(0, mkfifo(bench.path, 0600));
    expect_no_place(bench.path, TL_BAD_DATA, "/run.db|file");
    TEST_ASSERT_TRUE(lstat(bench.path, &file) == 0 && S_ISFIFO(file.st_mode));
    (void)unlink(bench.path);
    TEST_ASSERT_EQUAL_INT(0, symlink("absent.db", bench.path));
    expect_no_place(bench.path, TL_BAD_DATA, "/run.db|symbolic link");
    TEST_ASSERT_TRUE(lstat(bench.path, &file) == 0 && S_ISLNK(file.st_mode));
    (void)unlink(bench.path);
    TEST_ASSERT_EQUAL_INT(0, symlink("run.db", bench.path));
    expect_no_place(bench.path, TL_TRY_AGAIN, "/run.db|Too many levels");
    expect_no_place(bench.scratch.folder, TL_BAD_DATA, "file");
    expect_no_place("", TL_BAD_USAGE, "database|empty");
}

static void test_a_link_to_a_database_is_followed(void) {
    char link[PATH_MAX];
    struct stat file;
    record_run(10);
    (void)snprintf(link, sizeof link, "%s", tl_scratch_path(&bench.scratch, "link.db"));
    TEST_ASSERT_EQUAL_INT(0, symlink("run.db", link));
    const tl_recorder_settings settings = tl_made_settings(link);
    tl_bench_open(&bench, &settings);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_TRUE(lstat(link, &file) == 0 && S_ISLNK(file.st_mode));
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(bench.path, "SELECT count(*) FROM runs"));
}

/* Foreign files with names of ours are not changed. If the recorder needs the name, it refuses. */
static void test_foreign_files_with_our_names(void) {
    static const char *const ends[] = {".new", ".new-journal", "-wal", "-shm", "-journal", "-writer"};
    char database[PATH_MAX];
    char content[8];
    (void)snprintf(database, sizeof database, "%s", bench.path);
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        (void)snprintf(bench.path, sizeof bench.path, "%s%s", tl_scratch_path(&bench.scratch, "run.db"), ends[i]);
        write_file("mine", 4);
        const tl_recorder_settings settings = tl_made_settings(database);
        if (ends[i][0] == '.') {
            tl_bench_open(&bench, &settings);
            tl_bench_close(&bench, "end");
        } else {
            expect_no_place(database, TL_BAD_DATA, bench.path);
        }
        TEST_ASSERT_EQUAL_size_t(4, read_file(content, sizeof content));
        TEST_ASSERT_EQUAL_MEMORY("mine", content, 4);
        tl_scratch_empty(&bench.scratch);
    }
}

/* The lock of a killed process is replaced. A folder with its name is refused. */
static void test_a_lock_of_a_killed_process(void) {
    char database[PATH_MAX];
    (void)snprintf(database, sizeof database, "%s", bench.path);
    (void)snprintf(bench.path, sizeof bench.path, "%s", tl_scratch_path(&bench.scratch, "run.db-writer"));
    write_file("12345\n", 6);
    const tl_recorder_settings settings = tl_made_settings(database);
    tl_bench_open(&bench, &settings);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_NOT_EQUAL_INT(0, access(bench.path, F_OK));
    TEST_ASSERT_EQUAL_INT(0, mkdir(bench.path, 0700));
    expect_no_place(database, TL_BAD_DATA, bench.path);
    TEST_ASSERT_EQUAL_INT(0, rmdir(bench.path));
}

/* Another program has the file open, and its log is not written back yet. */
static void test_a_foreign_log_is_not_written_back(void) {
    sqlite3 *owner = NULL;
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(bench.path, &owner));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK,
                          sqlite3_exec(owner, "PRAGMA journal_mode = WAL; CREATE TABLE mine (x)", NULL, NULL, NULL));
    expect_refused(TL_BAD_DATA, "another program");
    (void)sqlite3_close(owner);
}

/* A user has removed a table from our file. */
static void test_a_file_without_our_tables_is_bad_data(void) {
    record_run(10);
    tl_sql_execute(bench.path, "DROP TABLE signals");
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_recorder_open(&settings, &bench.recorder, &bench.error));
    TL_EXPECT_PARTS("/run.db|signals", bench.error.text);
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(*) FROM runs"));
}

static void test_paths_that_cannot_be_written(void) {
    tl_recorder_settings settings = tl_made_settings("/nowhere/run.db");
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_recorder_open(&settings, &bench.recorder, &bench.error));
    TL_EXPECT_PARTS("/nowhere/run.db|folder|No such file", bench.error.text);
    settings.path = bench.scratch.folder;
    TEST_ASSERT_NOT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &bench.recorder, &bench.error));
    TEST_ASSERT_NULL(bench.recorder);
    char writer[PATH_MAX + 8];
    (void)snprintf(writer, sizeof writer, "%s-writer", bench.scratch.folder);
    TEST_ASSERT_NOT_EQUAL_INT(0, access(writer, F_OK));
}

static void test_a_second_writer_is_refused(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_recorder *second = NULL;
    char owner[64];
    tl_bench_open(&bench, &settings);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_recorder_open(&settings, &second, &bench.error));
    TEST_ASSERT_NULL(second);
    (void)snprintf(owner, sizeof owner, "/run.db|twinlock|process %ld", (long)getpid());
    TL_EXPECT_PARTS(owner, bench.error.text);
    bench.error = (tl_error){TL_OK, ""};
    tl_made_put(bench.recorder, 0, 10);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(18, bench.counts.written);
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT count(*) FROM runs"));
    record_run(10);
}

static void test_a_run_without_an_end_gets_one(void) {
    record_run(10);
    tl_sql_execute(bench.path,
                   "UPDATE main.runs SET ended = NULL, ended_reason = NULL, committed = '2026-01-02T03:04:05.678Z'");
    record_run(10);
    TEST_ASSERT_EQUAL_STRING(
        "2026-01-02T03:04:05.678Z|not ended cleanly",
        tl_sql_text(bench.path, "SELECT ended || '|' || ended_reason FROM runs WHERE runs.run = 1"));
    TEST_ASSERT_EQUAL_STRING("end of recording",
                             tl_sql_text(bench.path, "SELECT ended_reason FROM runs WHERE runs.run = 2"));
}

/* A repeated tick, a bug of the caller, must not stop the recorder. */
static void test_a_repeated_tick(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_bench_open(&bench, &settings);
    tl_made_put(bench.recorder, 0, 10);
    tl_made_put(bench.recorder, 5, 10);
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(15 * TL_MADE_PLANT, tl_sql_integer(bench.path, "SELECT count(*) FROM samples"));
}

static void test_the_largest_run(void) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    static tl_recorder_signal many[TL_MAX_SIGNALS];
    static tl_sample sample;
    static tl_record record;
    static tl_execution_counts ledger[TL_RECORDER_COMPONENTS];
    settings.component_count = TL_RECORDER_COMPONENTS;
    tl_made_account()->components = TL_RECORDER_COMPONENTS;
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        many[i] = (tl_recorder_signal){.name = "plant.x", .unit = "", .to = "plant.x", .type = TL_REAL};
    }
    settings.plant = settings.match = settings.adjust = many;
    settings.plant_count = TL_MAX_SIGNALS;
    settings.match_count = TL_MAX_MATCH;
    settings.adjust_count = TL_MAX_ADJUST;
    settings.step = TL_SECOND / 1000;
    tl_bench_open(&bench, &settings);
    for (int64_t tick = 0; tick < 1000; tick++) {
        sample.tick = tick;
        record.step = tick;
        sample.values[63] = (double)tick;
        record.measured[15] = record.nominal[7] = (double)tick;
        ledger[TL_RECORDER_COMPONENTS - 1].executions = (uint64_t)tick;
        tl_recorder_put_sample(bench.recorder, &sample);
        tl_recorder_put_step(bench.recorder, &record, ledger);
    }
    tl_bench_close(&bench, "end");
    TEST_ASSERT_EQUAL_INT64(2000, bench.counts.written);
    TEST_ASSERT_EQUAL_INT64(64000, tl_sql_integer(bench.path, "SELECT count(*) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(
        1000, tl_sql_integer(bench.path, "SELECT count(*) FROM samples WHERE signal = 63 AND value = tick"));
    TEST_ASSERT_EQUAL_INT64(
        1000, tl_sql_integer(bench.path, "SELECT count(*) FROM outputs WHERE signal = 15 AND measured = step"));
    TEST_ASSERT_EQUAL_INT64(
        1000, tl_sql_integer(bench.path, "SELECT count(*) FROM adjustments WHERE signal = 7 AND nominal = step"));
    TEST_ASSERT_EQUAL_INT64(999, tl_sql_integer(bench.path, "SELECT executions FROM components WHERE component = 63"));
}

/* ---- Times ---- */

/* Compares our calendar with the system's for every fifth day of 10,000 years. */
static void test_utc_calendar(void) {
    enum { DAYS = 3652425, STEP = 5, DAY = 86400 };
    for (int day = 0; day < DAYS; day += STEP) {
        int64_t second = INT64_C(-62167219200) + (int64_t)day * DAY + 3723;
        time_t system = (time_t)second;
        struct tm utc;
        char wanted[96];
        char text[TL_UTC_TEXT];
        int64_t ms = 0;
        if (system != second) {
            continue; /* a time_t of 4 bytes has 136 years only */
        }
        TEST_ASSERT_NOT_NULL(gmtime_r(&system, &utc));
        (void)snprintf(wanted, sizeof wanted, "%04d-%02d-%02dT01:02:03.004Z", utc.tm_year + 1900, utc.tm_mon + 1,
                       utc.tm_mday);
        tl_utc_text(second * 1000 + 4, text);
        TEST_ASSERT_EQUAL_STRING(wanted, text);
        TEST_ASSERT_TRUE(tl_utc_parse(text, &ms));
        TEST_ASSERT_EQUAL_INT64(second * 1000 + 4, ms);
    }
}

static void test_utc_texts(void) {
    char text[TL_UTC_TEXT];
    int64_t ms = 0;
    tl_utc_text(0, text);
    TEST_ASSERT_EQUAL_STRING("1970-01-01T00:00:00.000Z", text);
    tl_utc_text(-1, text);
    TEST_ASSERT_EQUAL_STRING("1969-12-31T23:59:59.999Z", text);
    tl_utc_text(INT64_MAX, text);
    TEST_ASSERT_EQUAL_STRING("9999-12-31T23:59:59.999Z", text);
    tl_utc_text(INT64_MIN, text);
    TEST_ASSERT_EQUAL_STRING("0000-01-01T00:00:00.000Z", text);
    TEST_ASSERT_TRUE(tl_utc_parse("2024-02-29T23:59:59.25Z", &ms));
    tl_utc_text(ms, text);
    TEST_ASSERT_EQUAL_STRING("2024-02-29T23:59:59.250Z", text);
    TEST_ASSERT_TRUE(tl_utc_parse("2026-11-21", &ms));
    TEST_ASSERT_EQUAL_INT64(INT64_C(1795219200000), ms);
    TEST_ASSERT_TRUE(tl_utc_parse("2026-11-21 10:02", &ms));
    TEST_ASSERT_EQUAL_INT64(INT64_C(1795219200000) + (10 * 60 + 2) * 60000, ms);
    static const char *const wrong[] = {"",
                                        "2026",
                                        "2026-13-01",
                                        "2026-02-29",
                                        "2026-00-10",
                                        "2026-01-00",
                                        "2026-01-01T",
                                        "26-01-01",
                                        "2026-01-01T24:00",
                                        "2026-01-01x",
                                        "2026-01-01T10:02:03.",
                                        "2026-01-01T10:60",
                                        "2026-01-01T10:02:03+01:00"};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(tl_utc_parse(wrong[i], &ms), wrong[i]);
    }
}

int main(void) {
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_recorder");
    UNITY_BEGIN();
    RUN_TEST(test_everything_put_is_written);
    RUN_TEST(test_samples_come_back_bit_for_bit);
    RUN_TEST(test_steps_come_back_bit_for_bit);
    RUN_TEST(test_numbers_that_are_not_finite);
    RUN_TEST(test_the_row_of_a_run);
    RUN_TEST(test_the_ledger);
    RUN_TEST(test_flags_have_words);
    RUN_TEST(test_codes_have_their_names);
    RUN_TEST(test_views_are_for_people);
    RUN_TEST(test_events_are_cut_and_repaired);
    RUN_TEST(test_runs_are_added);
    RUN_TEST(test_a_log_of_a_removed_database);
    RUN_TEST(test_foreign_files);
    RUN_TEST(test_another_format);
    RUN_TEST(test_paths_that_are_not_a_regular_file);
    RUN_TEST(test_a_link_to_a_database_is_followed);
    RUN_TEST(test_foreign_files_with_our_names);
    RUN_TEST(test_a_lock_of_a_killed_process);
    RUN_TEST(test_a_foreign_log_is_not_written_back);
    RUN_TEST(test_a_file_without_our_tables_is_bad_data);
    RUN_TEST(test_paths_that_cannot_be_written);
    RUN_TEST(test_a_second_writer_is_refused);
    RUN_TEST(test_a_run_without_an_end_gets_one);
    RUN_TEST(test_a_repeated_tick);
    RUN_TEST(test_the_largest_run);
    RUN_TEST(test_utc_calendar);
    RUN_TEST(test_utc_texts);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
