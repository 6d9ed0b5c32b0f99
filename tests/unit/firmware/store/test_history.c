/* History: reads recorded runs, also during recording, and rejects damaged ones. */
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/text.h"
#include "firmware/store/database.h"
#include "firmware/store/history.h"
#include "tests/support/faulty_vfs.h"
#include "tests/support/kept_file.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/recorder_bench.h"
#include "tests/support/sql.h"

enum { TICKS = 700 };

static tl_recorder_bench bench;
static tl_history *history;
static tl_history_ticks *ticks;
static const tl_history_run *run;

void setUp(void) {
    tl_bench_begin(&bench);
    history = NULL;
    ticks = NULL;
}

static void close_history(void) {
    tl_history_ticks_end(ticks);
    tl_history_close(history);
    ticks = NULL;
    history = NULL;
}

void tearDown(void) {
    close_history();
    tl_bench_end(&bench);
}

static void expect_ok(tl_status status) {
    tl_bench_expect_ok(&bench, status);
}

static void close_recorder(void) {
    tl_bench_close(&bench, "end of recording");
}

static void record_with(const tl_recorder_settings *settings, int64_t count) {
    tl_bench_open(&bench, settings);
    tl_made_put(bench.recorder, 0, count);
    close_recorder();
}

static void record_run(int64_t count) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    record_with(&settings, count);
}

static void open_history(void) {
    expect_ok(tl_history_open(bench.path, &history, &bench.error));
}

static void begin_ticks(int64_t id) {
    expect_ok(tl_history_find(history, id, &run, &bench.error));
    expect_ok(tl_history_ticks_begin(history, run, 0, &ticks, &bench.error));
}

/* ---- Runs ---- */

static void test_runs_are_listed(void) {
    const tl_history_run *runs = NULL;
    size_t count = 0;
    int64_t time = 0;
    record_run(10);
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.verb = "run";
    settings.name = "zweite Prüfung";
    settings.measurements = TL_AHEAD;
    tl_made_account()->prediction = 5;
    record_with(&settings, 20);
    open_history();
    expect_ok(tl_history_runs(history, &runs, &count, &bench.error));
    TEST_ASSERT_EQUAL_size_t(2, count);
    TEST_ASSERT_EQUAL_INT64(1, runs[0].run);
    TEST_ASSERT_EQUAL_STRING("replay", runs[0].verb);
    TEST_ASSERT_EQUAL_STRING("end of recording", runs[0].ended_reason);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 100, runs[0].step);
    TEST_ASSERT_EQUAL_UINT64(10, runs[0].samples);
    TEST_ASSERT_EQUAL_UINT64(8, runs[0].steps);
    TEST_ASSERT_EQUAL_INT(TL_LAG, runs[0].measurements);
    TEST_ASSERT_EQUAL_STRING("zweite Prüfung", runs[1].name);
    TEST_ASSERT_EQUAL_INT(TL_AHEAD, runs[1].measurements);
    TEST_ASSERT_EQUAL_UINT32(5, runs[1].prediction);
    TEST_ASSERT_TRUE(tl_utc_parse(runs[1].started, &time));
    TEST_ASSERT_EQUAL_STRING(runs[1].committed, runs[1].ended);
    TEST_ASSERT_EQUAL_size_t(64, strlen(runs[1].configuration_hash));
}

static void test_a_run_is_found(void) {
    record_run(10);
    record_run(10);
    open_history();
    expect_ok(tl_history_find(history, 0, &run, &bench.error));
    TEST_ASSERT_EQUAL_INT64(2, run->run);
    expect_ok(tl_history_find(history, 1, &run, &bench.error));
    TEST_ASSERT_EQUAL_INT64(1, run->run);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_history_find(history, 3, &run, &bench.error));
    TL_EXPECT_PARTS("/run.db|run 3", bench.error.text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_history_find(history, -1, &run, &bench.error));
}

static void test_a_database_without_runs(void) {
    const tl_history_run *runs = NULL;
    size_t count = 1;
    record_run(10);
    tl_sql_execute(bench.path, "DELETE FROM runs");
    open_history();
    expect_ok(tl_history_runs(history, &runs, &count, &bench.error));
    TEST_ASSERT_EQUAL_size_t(0, count);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_history_find(history, 0, &run, &bench.error));
    TL_EXPECT_PARTS("/run.db|no run", bench.error.text);
}

static void test_signals_and_configuration(void) {
    const tl_recorder_signal *signals = NULL;
    const char *text = NULL;
    size_t count = 0;
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    record_run(10);
    open_history();
    expect_ok(tl_history_find(history, 0, &run, &bench.error));
    expect_ok(tl_history_signals(history, run, TL_HISTORY_PLANT, &signals, &count, &bench.error));
    TEST_ASSERT_EQUAL_size_t(TL_MADE_PLANT, count);
    TEST_ASSERT_EQUAL_STRING("plant.door", signals[2].name);
    TEST_ASSERT_EQUAL_INT(TL_BOOLEAN, signals[2].type);
    TEST_ASSERT_NULL(signals[2].to);
    expect_ok(tl_history_signals(history, run, TL_HISTORY_MATCH, &signals, &count, &bench.error));
    TEST_ASSERT_EQUAL_size_t(TL_MADE_MATCH, count);
    TEST_ASSERT_EQUAL_STRING("plant.omega", signals[0].to);
    expect_ok(tl_history_signals(history, run, TL_HISTORY_ADJUST, &signals, &count, &bench.error));
    TEST_ASSERT_EQUAL_size_t(TL_MADE_ADJUST, count);
    TEST_ASSERT_EQUAL_STRING("N.m.s/rad", signals[0].unit);
    expect_ok(tl_history_configuration_text(history, run->configuration_hash, &text, &bench.error));
    TEST_ASSERT_EQUAL_STRING(settings.configuration, text);
}

/* ---- Ticks ---- */

static void expect_tick(const tl_history_tick *tick, int64_t number) {
    tl_sample sample;
    tl_made_sample(number, &sample);
    TEST_ASSERT_EQUAL_INT64(number, tick->sample.tick);
    TEST_ASSERT_EQUAL_MEMORY(sample.values, tick->sample.values, TL_MADE_PLANT * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(sample.stamps, tick->sample.stamps, TL_MADE_PLANT * sizeof(tl_time));
    TEST_ASSERT_EQUAL_MEMORY(sample.quality, tick->sample.quality, TL_MADE_PLANT);
    for (size_t i = TL_MADE_PLANT; i < TL_MAX_SIGNALS; i++) {
        TEST_ASSERT_EQUAL_INT(TL_NO_LINK, tick->sample.quality[i]);
        TEST_ASSERT_TRUE(tick->sample.stamps[i] == TL_TIME_NEVER && tick->sample.values[i] == 0.0);
    }
}

static void expect_step(const tl_history_tick *tick, int64_t step) {
    tl_record record;
    tl_made_record(step, &record);
    TEST_ASSERT_TRUE(tick->has_step);
    TEST_ASSERT_EQUAL_INT64(step, tick->step.step);
    TEST_ASSERT_EQUAL_INT(record.outcome, tick->step.outcome);
    TEST_ASSERT_EQUAL_INT(record.stop, tick->step.stop);
    TEST_ASSERT_EQUAL_UINT32(record.evaluations, tick->step.evaluations);
    TEST_ASSERT_EQUAL_HEX32(record.flags, tick->step.flags);
}

/* Reads `count` ticks. Each has the step that was computed `lead` ticks before it, if there is
 * one. */
static void expect_ticks_with_steps(int64_t count, int64_t lead) {
    tl_history_tick tick;
    bool end = false;
    for (int64_t number = 0; number < count; number++) {
        int64_t step = number - lead;
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
        TEST_ASSERT_FALSE(end);
        expect_tick(&tick, number);
        if (step >= 0 && step < count - TL_MADE_PREDICTION) {
            expect_step(&tick, step);
        } else {
            TEST_ASSERT_FALSE(tick.has_step);
        }
    }
}

static void test_ticks_come_back_bit_for_bit(void) {
    tl_history_tick tick;
    bool end = false;
    record_run(TICKS);
    open_history();
    begin_ticks(0);
    expect_ticks_with_steps(TICKS, TL_MADE_PREDICTION);
    for (int i = 0; i < 3; i++) {
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
        TEST_ASSERT_TRUE(end);
    }
}

static void test_ahead_the_step_is_the_ticks_own(void) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.measurements = TL_AHEAD;
    tl_made_account()->prediction = 4;
    tl_made_account()->lead = 0;
    record_with(&settings, 100);
    open_history();
    begin_ticks(0);
    expect_ticks_with_steps(100, 0);
}

/* Conditioned measurements delay the steps, so that the recorded lead counts. */
static void test_the_lead_is_the_recorded_one(void) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_made_account()->lead = 70; /* more ticks than one statement reads */
    record_with(&settings, 200);
    open_history();
    begin_ticks(0);
    TEST_ASSERT_EQUAL_UINT32(70, run->lead);
    expect_ticks_with_steps(200, 70);
}

static void test_the_ledger(void) {
    const tl_run_component *components = NULL;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    size_t count = 0;
    record_run(10);
    record_run(100);
    open_history();
    expect_ok(tl_history_find(history, 0, &run, &bench.error));
    expect_ok(tl_history_ledger(history, run, &components, &count, &bench.error));
    TEST_ASSERT_EQUAL_size_t(TL_MADE_COMPONENTS, count);
    tl_made_ledger(99 - TL_MADE_PREDICTION, ledger);
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_MEMORY(&ledger[i], &components[i].counts, sizeof ledger[i]);
    }
    TEST_ASSERT_EQUAL_STRING("drive", components[0].name);
    TEST_ASSERT_EQUAL_STRING("plant", components[2].name);
}

/* In mode hold, a step is computed one tick later for each prediction. */
static void test_hold_the_step_is_of_the_tick_before(void) {
    tl_recorder_settings settings = tl_made_settings(bench.path);
    settings.measurements = TL_HOLD;
    tl_made_account()->prediction = 4;
    tl_made_account()->lead = 1;
    record_with(&settings, 100);
    open_history();
    begin_ticks(0);
    TEST_ASSERT_EQUAL_INT(TL_HOLD, run->measurements);
    TEST_ASSERT_EQUAL_STRING("hold", tl_sql_text(bench.path, "SELECT measurements FROM runs"));
    expect_ticks_with_steps(100, 1);
}

/* Two runs in one file can be read at the same time. */
static void test_two_walks_at_once(void) {
    tl_history_tick tick;
    tl_history_ticks *other = NULL;
    bool end = false;
    record_run(100);
    record_run(300);
    open_history();
    expect_ok(tl_history_find(history, 1, &run, &bench.error));
    expect_ok(tl_history_ticks_begin(history, run, 0, &other, &bench.error));
    begin_ticks(2);
    for (int64_t number = 0; number < 100; number++) {
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
        expect_tick(&tick, number);
        expect_ok(tl_history_ticks_next(other, &tick, &end, &bench.error));
        expect_tick(&tick, number);
    }
    expect_ok(tl_history_ticks_next(other, &tick, &end, &bench.error));
    TEST_ASSERT_TRUE(end);
    expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
    TEST_ASSERT_FALSE(end);
    tl_history_ticks_end(other);
}

/* Ticks that were lost or removed are skipped. */
static void test_gaps(void) {
    tl_history_tick tick;
    bool end = false;
    record_run(1000);
    tl_sql_execute(
        bench.path,
        "DELETE FROM main.samples WHERE tick < 10 OR tick BETWEEN 100 AND 899; DELETE FROM main.steps WHERE step = 20");
    open_history();
    begin_ticks(0);
    for (int64_t number = 10; number < 1000; number = number == 99 ? 900 : number + 1) {
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
        TEST_ASSERT_FALSE(end);
        expect_tick(&tick, number);
        TEST_ASSERT_EQUAL_INT(number != 22, tick.has_step);
    }
    expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
    TEST_ASSERT_TRUE(end);
}

/* Records ten ticks, changes them, and returns the first one. */
static tl_history_tick first_tick_after(const char *change) {
    tl_history_tick tick;
    bool end = false;
    record_run(10);
    tl_sql_execute(bench.path, change);
    open_history();
    begin_ticks(0);
    expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
    return tick;
}

/* A missing value is not a number, whatever its quality is. */
static void test_a_missing_value_is_not_good(void) {
    tl_history_tick tick = first_tick_after("UPDATE samples SET value = NULL, quality = 0 WHERE signal = 1");
    TEST_ASSERT_EQUAL_INT(TL_NOT_A_NUMBER, tick.sample.quality[1]);
    TEST_ASSERT_TRUE(tick.sample.values[1] == 0.0);
}

/* The largest number of a quality. */
static void test_an_outlier_is_read(void) {
    tl_history_tick tick = first_tick_after("UPDATE samples SET value = 3.5, quality = 5 WHERE signal = 1");
    TEST_ASSERT_EQUAL_INT(TL_OUTLIER, tick.sample.quality[1]);
    TEST_ASSERT_EQUAL_DOUBLE(3.5, tick.sample.values[1]);
}

/* Another connection reads during recording: it gets each tick exactly once. */
static void test_reading_while_it_is_written(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_history_tick tick;
    bool end = false;
    int64_t next = 0;
    tl_bench_open(&bench, &settings);
    open_history();
    begin_ticks(0);
    TEST_ASSERT_NULL(run->ended);
    for (int64_t put = 0; put < 20000; put += 40) {
        tl_made_put(bench.recorder, put, 40);
        for (end = false; !end;) {
            expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
            if (!end) {
                expect_tick(&tick, next++);
            }
        }
    }
    close_recorder();
    for (end = false; !end;) {
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
        if (!end) {
            expect_tick(&tick, next++);
        }
    }
    TEST_ASSERT_EQUAL_INT64(20000, next);
    expect_ok(tl_history_find(history, 0, &run, &bench.error));
    TEST_ASSERT_EQUAL_STRING("end of recording", run->ended_reason);
}

/* Reading leaves no file, and does not block a recorder. */
static void test_reading_changes_nothing(void) {
    sqlite3 *reader = NULL;
    tl_history_tick tick;
    bool end = false;
    record_run(100);
    open_history();
    begin_ticks(0);
    expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
    expect_ok(tl_database_open(bench.path, false, &reader, &bench.error));
    TEST_ASSERT_EQUAL_INT(SQLITE_READONLY, sqlite3_exec(reader, "DELETE FROM runs", NULL, NULL, NULL) & 0xFF);
    (void)sqlite3_close(reader);
    record_run(50); /* during the read */
    for (; !end;) {
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
    }
    close_history();
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&bench.scratch));
}

/* On a read-only medium, SQLite can create neither -wal nor -shm, and needs neither. */
static void test_a_medium_that_cannot_be_written(void) {
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    tl_history_tick tick;
    bool end = false;
    (void)snprintf(bench.path, sizeof bench.path, "%s", tl_scratch_path(&bench.scratch, "ein 100 % #1? \xC3\xA4.db"));
    record_run(100);
    tl_faulty_vfs_read_only(true);
    tl_status status = tl_history_open(bench.path, &history, &bench.error);
    tl_status refused = tl_recorder_open(&settings, &bench.recorder, NULL);
    tl_faulty_vfs_read_only(false);
    expect_ok(status);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, refused);
    begin_ticks(0);
    for (int64_t number = 0; number < 100; number++) {
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
        expect_tick(&tick, number);
    }
    close_history();
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&bench.scratch));
}

/* ---- Invalid files ---- */

/* The error names the file, and has all parts. */
static void expect_refused(tl_status status, const char *parts) {
    bench.error = (tl_error){TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(status, tl_history_open(bench.path, &history, &bench.error));
    TEST_ASSERT_NULL(history);
    TL_EXPECT_PARTS(bench.path, bench.error.text);
    TL_EXPECT_PARTS(parts, bench.error.text);
}

static void test_invalid_files(void) {
    expect_refused(TL_BAD_DATA, "No such file");
    FILE *file = fopen(bench.path, "wb");
    TEST_ASSERT_NOT_NULL(file);
    (void)fclose(file);
    expect_refused(TL_BAD_DATA, "0 bytes");
    (void)unlink(bench.path);
    tl_sql_execute(bench.path, "CREATE TABLE mine (x)");
    expect_refused(TL_BAD_DATA, "another program");
    (void)snprintf(bench.path, sizeof bench.path, "%s", bench.scratch.folder);
    expect_refused(TL_BAD_DATA, "file");
}

static void test_a_damaged_file(void) {
    record_run(2000);
    FILE *file = fopen(bench.path, "r+b");
    TEST_ASSERT_NOT_NULL(file);
    for (long at = 4096; at < 60 * 4096; at += 512) {
        (void)fseek(file, at, SEEK_SET);
        (void)fputs("damaged damaged damaged", file);
    }
    (void)fclose(file);
    tl_status status = tl_history_open(bench.path, &history, &bench.error);
    if (status == TL_OK) {
        status = tl_history_find(history, 0, &run, &bench.error);
    }
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    TL_EXPECT_PARTS(bench.path, bench.error.text);
}

/* Copy of the undamaged database, recorded once. */
static tl_kept_file sound;

static void begin_sound(void) {
    if (sound.bytes != NULL) {
        tl_kept_file_write(&sound, bench.path);
        return;
    }
    record_run(10);
    tl_kept_file_read(&sound, bench.path);
}

/* A change to a value that the recorder never writes is reported as damage. */
static void expect_damage(const char *sql) {
    tl_history_tick tick;
    tl_status status = TL_OK;
    const tl_recorder_signal *signals = NULL;
    size_t count = 0;
    begin_sound();
    tl_sql_execute(bench.path, sql);
    open_history();
    status = tl_history_find(history, 0, &run, &bench.error);
    if (status == TL_OK) {
        status = tl_history_signals(history, run, TL_HISTORY_MATCH, &signals, &count, &bench.error);
    }
    if (status == TL_OK) {
        status = tl_history_ticks_begin(history, run, 0, &ticks, &bench.error);
    }
    for (bool end = false; status == TL_OK && !end;) {
        status = tl_history_ticks_next(ticks, &tick, &end, &bench.error);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, status, sql);
    TL_EXPECT_PARTS("/run.db|damaged", bench.error.text);
    close_history();
    tl_scratch_empty(&bench.scratch);
    bench.error = (tl_error){TL_OK, ""};
}

static void test_impossible_values_are_damage(void) {
    expect_damage("UPDATE samples SET quality = 7 WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET quality = -1 WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET signal = 64 WHERE tick = 4 AND signal = 2");
    expect_damage("UPDATE samples SET signal = -1 WHERE tick = 4 AND signal = 2");
    expect_damage("UPDATE samples SET tick = 9223372036854775807 WHERE tick = 9");
    expect_damage("UPDATE steps SET outcome = 99 WHERE step = 3");
    expect_damage("UPDATE steps SET stop = 'x' || 1 WHERE step = 3; UPDATE steps SET stop = -7 WHERE step = 3");
    expect_damage("DELETE FROM signals WHERE kind = 'plant' AND signal = 0");
    expect_damage("UPDATE signals SET signal = 7 WHERE kind = 'match' AND signal = 1");
    expect_damage("UPDATE runs SET step_ns = 0");
}

/* Ticks before the damage can be read, and the error names the damaged row. */
static void test_damage_behind_a_sound_block(void) {
    tl_history_tick tick;
    bool end = false;
    record_run(200);
    tl_sql_execute(bench.path, "UPDATE steps SET outcome = 99 WHERE step = 180");
    open_history();
    expect_ok(tl_history_find(history, 0, &run, &bench.error));
    expect_ok(tl_history_ticks_begin(history, run, 100, &ticks, &bench.error));
    for (int64_t number = 100; number < 164; number++) {
        expect_ok(tl_history_ticks_next(ticks, &tick, &end, &bench.error));
        expect_tick(&tick, number);
    }
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_history_ticks_next(ticks, &tick, &end, &bench.error));
    TL_EXPECT_PARTS("/run.db|damaged|step 180|run 1", bench.error.text);
}

/* ---- Malicious files ---- */

/* Reorders the first rows of each page of tables with a key of several columns: 0, 3, 6, … 1, 4,
 * 7, … Only their pointers change. The samples of 64 ticks, which one statement reads, are then
 * in the order of their signals. */
static void shuffle_rows(void) {
    enum { PAGE = 4096, LEAF = 0x0A, POINTERS = 8, ROWS = 64 * TL_MADE_PLANT, FEW = 20 };
    unsigned char page[PAGE];
    FILE *file = fopen(bench.path, "r+b");
    TEST_ASSERT_NOT_NULL(file);
    for (long at = PAGE; fseek(file, at, SEEK_SET) == 0 && fread(page, 1, PAGE, file) == PAGE; at += PAGE) {
        unsigned char pointers[PAGE];
        size_t count = (size_t)page[3] << 8 | page[4];
        count = count < ROWS ? count : ROWS;
        if (page[0] != LEAF || count < FEW || POINTERS + 2 * count > PAGE) {
            continue;
        }
        memcpy(pointers, page + POINTERS, 2 * count);
        for (size_t from = 0, to = 0, start = 0; to < count; to++) {
            memcpy(page + POINTERS + 2 * to, pointers + 2 * from, 2);
            from += 3;
            if (from >= count) {
                from = ++start;
            }
        }
        (void)fseek(file, at, SEEK_SET);
        TEST_ASSERT_EQUAL_size_t(PAGE, fwrite(page, 1, PAGE, file));
    }
    (void)fclose(file);
}

/* Reads all ticks of the last run. */
static tl_status read_all(void) {
    tl_history_tick tick;
    bool end = false;
    tl_status status = tl_history_open(bench.path, &history, &bench.error);
    if (status == TL_OK) {
        status = tl_history_find(history, 0, &run, &bench.error);
    }
    if (status == TL_OK) {
        status = tl_history_ticks_begin(history, run, 0, &ticks, &bench.error);
    }
    while (status == TL_OK && !end) {
        status = tl_history_ticks_next(ticks, &tick, &end, &bench.error);
    }
    close_history();
    return status;
}

/* SQLite returns rows in the order of the file: three times as many ticks as the buffer of 64
 * has. */
static void test_rows_in_wrong_order(void) {
    record_run(TICKS);
    shuffle_rows();
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_all());
    TL_EXPECT_PARTS("/run.db|damaged", bench.error.text);
}

/* A reader must not run code that the file contains. */
static void test_code_in_a_file_is_not_run(void) {
    static const char endless[] = "ALTER TABLE samples RENAME TO other; CREATE VIEW samples AS WITH RECURSIVE"
                                  " r (run, tick, signal, value, quality, stamp_ns) AS (SELECT 1, 0, 0, 0.0, 0, 0"
                                  " UNION ALL SELECT 1, tick + 1, 0, 0.0, 0, 0 FROM r) SELECT * FROM r";
    const char *const attacks[] = {
        "CREATE TRIGGER t AFTER UPDATE ON runs BEGIN DELETE FROM samples; END",
        "CREATE VIRTUAL TABLE v USING fts5(x)",
        "ALTER TABLE samples RENAME TO other; CREATE VIEW samples AS SELECT * FROM other",
        endless,
        "ALTER TABLE samples RENAME TO other; CREATE TABLE samples AS SELECT * FROM other",
        "ALTER TABLE runs RENAME TO other; CREATE TABLE runs AS SELECT * FROM other",
    };
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    for (size_t i = 0; i < sizeof attacks / sizeof attacks[0]; i++) {
        bench.error = (tl_error){TL_OK, ""};
        record_run(20);
        tl_sql_execute(bench.path, attacks[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, read_all(), attacks[i]);
        TL_EXPECT_PARTS("/run.db|damaged", bench.error.text);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, tl_recorder_open(&settings, &bench.recorder, &bench.error),
                                      attacks[i]);
        tl_scratch_empty(&bench.scratch);
    }
    bench.error = (tl_error){TL_OK, ""};
}

/* A query that does not end, for example because pages refer to each other, is aborted. The next
 * query works. This one makes more additions than rows, because the cheap steps of SQLite's
 * virtual machine are counted. */
static void test_an_endless_query(void) {
#define TEN_TIMES "+ 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1 + 1"
    static const char endless[] =
        "WITH RECURSIVE r (i) AS (SELECT 1 UNION ALL SELECT i " TEN_TIMES TEN_TIMES TEN_TIMES TEN_TIMES TEN_TIMES
        " FROM r) SELECT count(*) FROM r";
#undef TEN_TIMES
    sqlite3 *reader = NULL;
    record_run(20);
    open_history();
    expect_ok(tl_database_open(bench.path, false, &reader, &bench.error));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_database_execute(reader, endless, &bench.error));
    (void)sqlite3_close(reader);
    TL_EXPECT_PARTS("/run.db|damaged", bench.error.text);
    bench.error = (tl_error){TL_OK, ""};
    expect_ok(tl_history_find(history, 0, &run, &bench.error));
}

static void test_more_impossible_values(void) {
    expect_damage("UPDATE samples SET value = 'text' WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET value = x'00' WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET value = 9e999 WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET stamp_ns = -9223372036854775808 WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET stamp_ns = 1.5 WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET quality = 0.5 WHERE tick = 4 AND signal = 0");
    expect_damage("UPDATE samples SET tick = 3e17 WHERE tick = 9");
    expect_damage("UPDATE steps SET step = -2 WHERE step = 3");
    expect_damage("UPDATE steps SET evaluations = -1 WHERE step = 3");
    expect_damage("UPDATE steps SET evaluations = 4294967296 WHERE step = 3");
    expect_damage("UPDATE steps SET executions = 'many' WHERE step = 3");
    expect_damage("UPDATE steps SET flags = -1 WHERE step = 3");
    expect_damage("UPDATE adjustments SET signal = 8 WHERE step = 3 AND signal = 1");
    expect_damage("UPDATE adjustments SET applied = 'text' WHERE step = 3 AND signal = 1");
    expect_damage("UPDATE adjustments SET applied = -9e999 WHERE step = 3 AND signal = 1");
    expect_damage("UPDATE signals SET type = 'Complex' WHERE kind = 'match'");
    expect_damage("UPDATE signals SET unit = x'41' WHERE kind = 'match'");
    expect_damage("UPDATE runs SET step_ns = 3600000000001");
    expect_damage("UPDATE runs SET step_ns = 'long'");
    expect_damage("UPDATE runs SET lead = -1");
    expect_damage("UPDATE runs SET prediction = 4294967297");
    expect_damage("UPDATE main.runs SET ended_reason = NULL");
    expect_damage("UPDATE runs SET started = '2026-13-01T00:00:00.000Z'");
    expect_damage("UPDATE runs SET measurements = 'often'");
    expect_damage("UPDATE runs SET run = -1");
    expect_damage("UPDATE beginnings SET start_ns = 9223372036854775807");
    expect_damage("UPDATE beginnings SET resumed_tick = -1, resumed_from = 'start', resumed_run = 1");
    expect_damage("UPDATE beginnings SET resumed_from = 'nowhere'");
}

/* ---- Access ---- */

static void expect_mode(const char *end, mode_t mode) {
    char name[PATH_MAX + 16];
    struct stat file;
    (void)snprintf(name, sizeof name, "%s%s", bench.path, end);
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, stat(name, &file), name);
    TEST_ASSERT_EQUAL_HEX_MESSAGE(mode, file.st_mode & 0777, name);
}

static void test_the_mode_of_a_new_database(void) {
    static const struct {
        mode_t mask;
        mode_t mode;
    } cases[] = {{0022, 0640}, {0077, 0600}, {0, 0640}};
    static const char *const ends[] = {"", "-wal", "-shm", "-writer"};
    const tl_recorder_settings settings = tl_made_settings(bench.path);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        mode_t before = umask(cases[i].mask);
        tl_status status = tl_recorder_open(&settings, &bench.recorder, &bench.error);
        (void)umask(before);
        expect_ok(status);
        tl_made_put(bench.recorder, 0, 20);
        for (size_t k = 0; k < sizeof ends / sizeof ends[0]; k++) {
            expect_mode(ends[k], cases[i].mode);
        }
        close_recorder();
        open_history(); /* a reader creates -shm, too */
        expect_mode("-shm", cases[i].mode);
        close_history();
        expect_mode("", cases[i].mode);
        tl_scratch_empty(&bench.scratch);
    }
}

int main(void) {
    tl_faulty_vfs_install();
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_history");
    UNITY_BEGIN();
    RUN_TEST(test_runs_are_listed);
    RUN_TEST(test_a_run_is_found);
    RUN_TEST(test_a_database_without_runs);
    RUN_TEST(test_signals_and_configuration);
    RUN_TEST(test_ticks_come_back_bit_for_bit);
    RUN_TEST(test_ahead_the_step_is_the_ticks_own);
    RUN_TEST(test_hold_the_step_is_of_the_tick_before);
    RUN_TEST(test_the_lead_is_the_recorded_one);
    RUN_TEST(test_the_ledger);
    RUN_TEST(test_two_walks_at_once);
    RUN_TEST(test_gaps);
    RUN_TEST(test_a_missing_value_is_not_good);
    RUN_TEST(test_an_outlier_is_read);
    RUN_TEST(test_reading_while_it_is_written);
    RUN_TEST(test_reading_changes_nothing);
    RUN_TEST(test_a_medium_that_cannot_be_written);
    RUN_TEST(test_invalid_files);
    RUN_TEST(test_a_damaged_file);
    RUN_TEST(test_impossible_values_are_damage);
    RUN_TEST(test_damage_behind_a_sound_block);
    RUN_TEST(test_more_impossible_values);
    RUN_TEST(test_rows_in_wrong_order);
    RUN_TEST(test_code_in_a_file_is_not_run);
    RUN_TEST(test_an_endless_query);
    RUN_TEST(test_the_mode_of_a_new_database);
    tl_kept_file_free(&sound);
    return tl_scratch_finish(&bench.scratch, UNITY_END());
}
