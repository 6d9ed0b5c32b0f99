/* A live run whose steps were late, recorded and replayed from its database: the same bits. */
#include <limits.h>
#include <math.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/replay.h"
#include "tests/support/assembly_recorder.h"
#include "tests/support/read_assembly.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/start_twin.h"

enum { TICKS = 1200 };

/* %s: shape of the horizon, and the adjusted variables. The tolerance is often missed. */
#define CONFIGURATION                                                                                                  \
    "{ \"twinlock\": 1, \"name\": \"late\", \"step_s\": 0.01,\n"                                                       \
    "  \"components\": { \"drive\": { \"fmu\": \"drive.fmu\", \"set\": { \"ref\": 10 } },\n"                           \
    "                    \"motor\": { \"fmu\": \"motor.fmu\", \"set\": { \"J\": 0.0515 } } },\n"                       \
    "  \"plant\": { \"torque\": { \"unit\": \"N.m\" }, \"omega\": { \"unit\": \"rad/s\" } },\n"                        \
    "  \"connect\": [ [\"plant.torque\", \"motor.M_w\"], [\"drive.u_R\", \"motor.I_in\"],\n"                           \
    "                 [\"motor.omega\", \"drive.y\"] ],\n"                                                             \
    "  \"synchronise\": { \"match\": { \"motor.omega\": { \"to\": \"plant.omega\", \"tolerance\": 0.02 } },\n"         \
    "                     \"budget\": { \"evaluations\": 30, \"time_s\": 0.00005 },\n"                                 \
    "                     \"horizon\": { %s },\n %s } }\n"

#define ONE "\"adjust\": { \"motor.d\": { \"nominal\": 0.0031, \"step\": 0.05 } }"
#define TWO                                                                                                            \
    "\"adjust\": { \"motor.d\": { \"nominal\": 0.0031, \"step\": 0.05 },"                                              \
    " \"drive.P\": { \"nominal\": 1, \"step\": 0.1 } }, \"noise_floor\": 0"

static tl_scratch scratch;
static char config_path[PATH_MAX];
static char live_path[PATH_MAX];
static char again_path[PATH_MAX];
static tl_assembly assembly;
static tl_recorder *recorder;
static tl_error error;
static uint32_t random_state;
static tl_time clock_now;

/* Conditions in SQL: how a step can be limited. */
static const char *const ways[] = {
    "stop = 4 AND outcome IN (2, 3)", /* time ended the search, with a result, */
    "stop = 4 AND outcome = 4",       /* without one, */
    "stop = 4 AND evaluations = 0",   /* before the first evaluation */
    "flags & 4 AND evaluations > 1",  /* no time for the nominal value */
    "outcome = 5",
    "outcome = 6",
    "stop = 1",
    "stop = 4 AND held IN (1, 2)", /* one of two variables is held */
};

enum { WAYS = sizeof ways / sizeof ways[0], HELD = WAYS - 1 };

static int64_t seen[WAYS]; /* number of steps, in all runs of a test */

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    (void)snprintf(config_path, sizeof config_path, "%s", tl_scratch_path(&scratch, "config.json"));
    (void)snprintf(live_path, sizeof live_path, "%s", tl_scratch_path(&scratch, "live.db"));
    (void)snprintf(again_path, sizeof again_path, "%s", tl_scratch_path(&scratch, "again.db"));
    assembly = (tl_assembly){0};
    recorder = NULL;
    error = (tl_error){TL_OK, ""};
    random_state = 1;
    clock_now = 0;
    memset(seen, 0, sizeof seen);
}

void tearDown(void) {
    (void)tl_recorder_close(recorder, "test", NULL, &error);
    tl_assembly_free(&assembly);
    tl_scratch_empty(&scratch);
}

static void expect_ok(tl_status status) {
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

static uint32_t random_below(uint32_t bound) {
    random_state = random_state * 1664525U + 1013904223U;
    return (random_state >> 8) % bound;
}

/* Each read of the clock takes time, sometimes much. */
static tl_time unsteady_clock(void *context) {
    (void)context;
    clock_now += 100 + (random_below(40) == 0 ? (tl_time)random_below(60000) : 0);
    return clock_now;
}

static void open_run(const char *database) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(config_path, &assembly));
    expect_ok(tl_test_record(&assembly, "run", database, &recorder, &error));
}

static void close_run(void) {
    expect_ok(tl_recorder_close(recorder, "end", NULL, &error));
    recorder = NULL;
    tl_assembly_free(&assembly);
    assembly = (tl_assembly){0};
}

static void make_sample(int64_t tick, tl_sample *sample) {
    sample->tick = tick;
    sample->values[0] = 0.5 + 0.4 * sin(0.05 * (double)tick);
    sample->values[1] = 62.9 + 2.0 * sin(0.11 * (double)tick) + 0.001 * (double)random_below(1000);
    sample->quality[1] = tick / 8 % 9 == 8 ? TL_STALE : TL_GOOD;
}

static void live_tick(int64_t tick) {
    static tl_sample sample;
    tl_record record;
    bool ready = false;
    const tl_budget budget = {.evaluations = assembly.config.budget_evaluations,
                              .time = assembly.config.budget_time,
                              .started = clock_now,
                              .now = unsteady_clock};
    make_sample(tick, &sample);
    tl_recorder_put_sample(recorder, &sample);
    if (random_below(20) == 0) {
        expect_ok(tl_twin_catch_up(assembly.twin, &sample, &record, &ready, &error));
    } else {
        expect_ok(tl_twin_step(assembly.twin, &sample, &budget, &record, &ready, &error));
    }
    if (ready) {
        tl_test_put_step(recorder, &record, assembly.twin);
    }
}

static void run_live(void) {
    open_run(live_path);
    for (int64_t tick = 0; tick < TICKS; tick++) {
        live_tick(tick);
    }
    close_run();
}

static void run_again(void) {
    static tl_account account;
    static tl_lock_monitor lock_monitor;
    static tl_journal journal;
    static tl_watch watch;
    tl_replay replay = {
        .config = &assembly.config, .account = &account, .watch = &watch, .lock_monitor = &lock_monitor};
    tl_summary summary;
    open_run(again_path);
    tl_twin_child *child = tl_test_start_twin(&assembly.config, TL_ATTACHED_COUNTS, &account);
    tl_lock_monitor_init(&lock_monitor, &assembly.config, &account);
    tl_journal_init(&journal, NULL);
    tl_watch_init(&watch, &assembly.config, &journal);
    expect_ok(tl_recording_open(live_path, &assembly.config, &replay.recording, &error));
    const tl_twin_feed_settings settings = {
        .config = &assembly.config, .account = &account, .recording = replay.recording, .child = child};
    expect_ok(tl_twin_feed_open(&settings, &replay.feed, &error));
    replay.recorder = recorder;
    tl_status status = tl_replay_run(&replay, &summary, &error);
    tl_twin_feed_close(replay.feed);
    tl_twin_child_close(child);
    tl_recording_close(replay.recording);
    expect_ok(status);
    close_run();
}

/* ---- comparison ---- */

static sqlite3_stmt *ask(const char *path, const char *sql, sqlite3 **database) {
    sqlite3_stmt *statement = NULL;
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(path, database));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_prepare_v2(*database, sql, -1, &statement, NULL));
    return statement;
}

static void expect_same_row(sqlite3_stmt *one, sqlite3_stmt *other, const char *what) {
    char text[160];
    for (int i = 0; i < sqlite3_column_count(one); i++) {
        double values[2] = {sqlite3_column_double(one, i), sqlite3_column_double(other, i)};
        (void)snprintf(text, sizeof text, "%s: %s of step %lld is %.17g, replayed %.17g", what,
                       sqlite3_column_name(one, i), (long long)sqlite3_column_int64(one, 0), values[0], values[1]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(sqlite3_column_type(one, i), sqlite3_column_type(other, i), text);
        TEST_ASSERT_EQUAL_MEMORY_MESSAGE(&values[0], &values[1], sizeof values[0], text);
    }
}

/* Both databases have the same rows, bit for bit. */
static void expect_same(const char *sql, const char *what) {
    sqlite3 *databases[2];
    sqlite3_stmt *live = ask(live_path, sql, &databases[0]);
    sqlite3_stmt *again = ask(again_path, sql, &databases[1]);
    int rows = 0;
    while (sqlite3_step(live) == SQLITE_ROW) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(SQLITE_ROW, sqlite3_step(again), what);
        expect_same_row(live, again, what);
        rows++;
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(SQLITE_DONE, sqlite3_step(again), what);
    TEST_ASSERT_GREATER_THAN_INT_MESSAGE(TICKS - 10, rows, what);
    (void)sqlite3_finalize(live);
    (void)sqlite3_finalize(again);
    (void)sqlite3_close(databases[0]);
    (void)sqlite3_close(databases[1]);
}

/* ---- tests ---- */

static void configure(const char *horizon, const char *search) {
    FILE *file = fopen(config_path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fprintf(file, CONFIGURATION, horizon, search);
    (void)fclose(file);
}

static void count_ways(void) {
    for (size_t i = 0; i < WAYS; i++) {
        char sql[128];
        (void)snprintf(sql, sizeof sql, "SELECT count(*) FROM steps WHERE %s", ways[i]);
        seen[i] += tl_sql_integer(live_path, sql);
    }
}

/* All except HELD, which needs several variables. */
static void expect_all_ways(void) {
    for (size_t i = 0; i < HELD; i++) {
        TEST_ASSERT_GREATER_THAN_INT64_MESSAGE(0, seen[i], ways[i]);
    }
}

static void expect_repeated(const char *horizon, const char *search) {
    char what[512];
    (void)snprintf(what, sizeof what, "%s; %s", horizon, search);
    configure(horizon, search);
    run_live();
    count_ways();
    run_again();
    expect_same("SELECT step, outcome, J, J_nominal, evaluations, held, flags FROM steps ORDER BY step", what);
    expect_same("SELECT step, simulated, measured, quality FROM outputs ORDER BY step", what);
    expect_same("SELECT step, signal, applied, nominal FROM adjustments ORDER BY step, signal", what);
    tl_scratch_empty(&scratch);
}

static void test_every_solver(void) {
    static const char *const solvers[] = {"secant", "nelder-mead", "bobyqa", "l-bfgs", "sbplx"};
    for (size_t i = 0; i < sizeof solvers / sizeof solvers[0]; i++) {
        char search[256];
        (void)snprintf(search, sizeof search, "\"algorithm\": \"%s\", " ONE, solvers[i]);
        expect_repeated("\"prediction\": 3, \"shape\": \"dynamic\"", search);
        (void)snprintf(search, sizeof search, "\"algorithm\": \"%s\", " TWO, solvers[i]);
        expect_repeated("\"prediction\": 3", search);
    }
    expect_all_ways();
}

/* Time runs out at other places: also after the evaluation that is within tolerance. */
static void test_many_clocks(void) {
    for (uint32_t seed = 2; seed < 12; seed++) {
        random_state = seed;
        expect_repeated("\"prediction\": 3, \"shape\": \"dynamic\"", "\"algorithm\": \"secant\", " ONE);
    }
}

static void test_every_mode(void) {
    expect_repeated("\"prediction\": 1", "\"algorithm\": \"nelder-mead\", " ONE);
    expect_repeated("\"prediction\": 1, \"measurements\": \"ahead\"", "\"algorithm\": \"nelder-mead\", " ONE);
    expect_repeated("\"prediction\": 4, \"measurements\": \"hold\"", "\"algorithm\": \"nelder-mead\", " ONE);
    expect_repeated("\"prediction\": 4, \"measurements\": \"ahead\", \"shape\": \"dynamic\"",
                    "\"algorithm\": \"nelder-mead\", " TWO);
    expect_all_ways();
}

static void test_two_solvers(void) {
    expect_repeated("\"prediction\": 2",
                    "\"algorithm\": \"secant\", \"fallback\": \"nelder-mead\", \"stagnation\": 3, " TWO);
    expect_repeated("\"prediction\": 3, \"shape\": \"dynamic\"",
                    "\"algorithm\": \"bobyqa\", \"fallback\": \"secant\", \"stagnation\": 4, " ONE);
    expect_all_ways();
}

/* A variable without influence returns to nominal at the end of a search, if time remains. */
static void test_variables_that_are_held(void) {
    static const char held[] = "\"adjust\": { \"motor.d\": { \"nominal\": 0.0031, \"step\": 0.05 },"
                               " \"drive.P\": { \"nominal\": 1, \"step\": 0.1 } }, \"noise_floor\": 5";
    static const char *const solvers[] = {"\"bobyqa\"", "\"nelder-mead\"",
                                          "\"secant\", \"fallback\": \"nelder-mead\", \"stagnation\": 3"};
    for (size_t i = 0; i < sizeof solvers / sizeof solvers[0]; i++) {
        char search[256];
        (void)snprintf(search, sizeof search, "\"algorithm\": %s, %s", solvers[i], held);
        expect_repeated("\"prediction\": 3", search);
    }
    TEST_ASSERT_GREATER_THAN_INT64(0, seen[HELD]);
}

int main(int argc, char **argv) {
    (void)argc;
    tl_test_be_twin(argv);
    UNITY_BEGIN();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_replay");
    RUN_TEST(test_every_solver);
    RUN_TEST(test_many_clocks);
    RUN_TEST(test_every_mode);
    RUN_TEST(test_two_solvers);
    RUN_TEST(test_variables_that_are_held);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
