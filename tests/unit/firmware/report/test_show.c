/* `twinlock show`: the page, the JSON object and the tables, on terminals and in pipes; and its
 * errors. */
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cjson/cJSON.h>
#include <unity.h>

#include "firmware/base/text.h"
#include "firmware/cli/command_line.h"
#include "firmware/report/show.h"
#include "firmware/store/recorder.h"
#include "tests/support/kept_file.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/stderr_capture.h"

enum { STEPS = 1600, CHANGE = 1000, OUTPUT = 1 << 20, ARGUMENTS = 13 };

static tl_scratch scratch;
static char path[PATH_MAX];
static char output[OUTPUT];
static char *errors;
static tl_error error;

/* Copies of the databases that record_known() records. */
static tl_kept_file known_run;
static tl_kept_file known_replay;

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    errors = NULL;
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    free(errors);
    tl_scratch_empty(&scratch);
}

/* ---- Running the verb ---- */

/* Runs the program with standard output in `descriptor`. */
static int show_into(int descriptor, int argc, char **argv) {
    (void)fflush(stdout);
    int kept = dup(STDOUT_FILENO);
    TEST_ASSERT_TRUE(kept >= 0 && dup2(descriptor, STDOUT_FILENO) >= 0);
    free(errors);
    errors = NULL;
    bool captured = tl_stderr_capture_begin();
    int code = tl_command_line_run(argc, argv);
    errors = captured ? tl_stderr_capture_end() : NULL;
    (void)fflush(stdout);
    (void)dup2(kept, STDOUT_FILENO);
    (void)close(kept);
    return code;
}

/* Runs `twinlock show` with these arguments. Its output is in `output` and `errors`. */
#define SHOW(...) show((const char *const[]){__VA_ARGS__, NULL})

static int show(const char *const *arguments) {
    static char words[ARGUMENTS][PATH_MAX];
    char *argv[ARGUMENTS + 1] = {words[0], words[1]};
    int argc = 2;
    (void)snprintf(words[0], sizeof words[0], "twinlock");
    (void)snprintf(words[1], sizeof words[1], "show");
    for (; *arguments != NULL && argc < ARGUMENTS; arguments++) {
        (void)snprintf(words[argc], sizeof words[argc], "%s", *arguments);
        argv[argc] = words[argc];
        argc++;
    }
    FILE *file = tmpfile();
    TEST_ASSERT_NOT_NULL(file);
    int code = show_into(fileno(file), argc, argv);
    rewind(file);
    output[fread(output, 1, sizeof output - 1, file)] = '\0';
    (void)fclose(file);
    return code;
}

static void expect_in(const char *part, const char *text) {
    if (text == NULL || strstr(text, part) == NULL) {
        (void)fprintf(stderr, "--- expected \"%s\" in:\n%s\n", part, text == NULL ? "(nothing)" : text);
        TEST_FAIL_MESSAGE(part);
    }
}

static void expect_shown(const char *part) {
    expect_in(part, output);
}

/* One line of the text has all parts. */
static void expect_line_in(const char *parts, const char *text) {
    if (tl_test_has_line(text, parts)) {
        return;
    }
    (void)fprintf(stderr, "--- expected a line with \"%s\" in:\n%s\n", parts, text);
    TEST_FAIL_MESSAGE(parts);
}

static void expect_line(const char *parts) {
    expect_line_in(parts, output);
}

static void expect_error(const char *parts) {
    TL_EXPECT_PARTS(parts, errors);
}

/* A row of a table: several blanks count as one. */
static void expect_row(const char *row) {
    static char squeezed[OUTPUT];
    size_t end = 0;
    for (const char *c = output; *c != '\0'; c++) {
        if (*c != ' ' || (end > 0 && squeezed[end - 1] != ' ')) {
            squeezed[end++] = *c;
        }
    }
    squeezed[end] = '\0';
    expect_in(row, squeezed);
}

static void expect_not_shown(const char *part) {
    TEST_ASSERT_NULL_MESSAGE(strstr(output, part), part);
}

/* ---- A run with a known change ---- */

/* motor.d is 0.002 above its nominal value before step CHANGE, and 0.005 above it afterwards.
 * drive.u is at its nominal value. */
static void known_record(int64_t step, tl_record *record) {
    memset(record, 0, sizeof *record);
    record->step = step;
    record->outcome = step % 100 == 0 ? TL_OPTIMISED : TL_FIRST_GUESS;
    record->stop = step % 200 == 0 ? TL_STOP_TIME : TL_STOP_TOLERANCE;
    record->evaluations = 2;
    record->executions = 8;
    record->predicted = 9;
    record->y[0] = 10.0 + (step % 2 == 0 ? 0.5 : -0.5);
    record->measured[0] = 10.0;
    record->y[1] = 3.0;
    record->measured[1] = 1.0;
    record->readings[0] = (tl_record_readings){.count = 1, .rejected = step % 16 == 0 ? 1 : 0, .squares = 0.36};
    record->measured_quality[1] = step % 4 == 0 ? TL_GOOD : TL_STALE;
    record->u[0] = 0.003 + (step < CHANGE ? 0.002 : 0.005) + (step % 2 == 0 ? 1e-5 : -1e-5);
    record->nominal[0] = 0.003;
    record->u[1] = record->nominal[1] = 24.0;
}

static void record_new(const char *verb) {
    tl_recorder_settings settings = tl_made_settings(path);
    tl_recorder *recorder = NULL;
    tl_sample sample;
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    settings.verb = verb;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, &error));
    tl_recorder_event(recorder, 17, TL_EVENT_WARNING, "plant", "the drive does not answer");
    for (int64_t tick = 0; tick < STEPS; tick++) {
        tl_made_sample(tick, &sample);
        tl_recorder_put_sample(recorder, &sample);
        known_record(tick, &record);
        tl_made_ledger(tick, ledger);
        tl_recorder_put_step(recorder, &record, ledger);
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "end of recording", NULL, &error));
}

/* Records a run. A second test that needs the same file gets a copy of it. */
static void record_known(const char *verb) {
    tl_kept_file *kept = strcmp(verb, "run") == 0 ? &known_run : &known_replay;
    bool is_new = access(path, F_OK) != 0;
    if (is_new && kept->bytes != NULL) {
        tl_kept_file_write(kept, path);
        return;
    }
    record_new(verb);
    if (is_new) {
        tl_kept_file_read(kept, path);
    }
}

/* ---- The page ---- */

static void test_the_page(void) {
    record_known("replay");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--verbose"));
    TEST_ASSERT_EQUAL_STRING("", errors);
    expect_shown("Run 1: motor bench\n");
    expect_shown("ended: end of recording");
    expect_line("steps|1600|0.01 s|16 s");
    expect_line("horizon|2 steps|lag");
    expect_line("1584 first guess|16 optimised");
    expect_line("search|time|8");
    /* (21 + 22 + 23)·1600, (20 + 21 + 22)·1600, 3·40·1600; (0 + 1 + 2)·1600, 1600 + 800 + 533 */
    expect_line("executions|105600|predicted 100800|192000|45.0 %");
    expect_line("4800|2933");
    expect_line("recorded|1600 samples|1600 steps|1 events");
    /* 0.25 and 0.36, each times 1600/1599 */
    expect_row("motor.omega plant.omega 0.50016 0.5 - rad/s 0 1600 0.25016 0.36023 1600 100\n");
    expect_row("motor.i plant.torque 2.0025 2 - A 1200 400 4.01 - 0 0\n");
    expect_row("motor.d +0.003125 0.00501 0.00799 0.006125 0.00499 0.00801 N.m.s/rad\n");
    expect_row("drive.u 0 24 24 24 24 24 V\n");
    expect_line("motor.d|10.00 s|+0.002 -> +0.005 N.m.s/rad");
    expect_line("drive.u|no change");
    /* 40 of 64 columns are before the change */
    expect_shown("    |________________________________________########################|");
    expect_line("warning|plant|the drive does not answer|tick 17");
}

/* In a pipe: ASCII only, no terminal control sequence, no blanks at the end of a line. */
static void test_a_pipe_gets_plain_text(void) {
    record_known("run");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    for (const char *c = output; *c != '\0'; c++) {
        TEST_ASSERT_TRUE((*c >= 0x20 && *c < 0x7F) || *c == '\n');
    }
    expect_not_shown(" \n");
}

static void test_a_live_run_has_dates(void) {
    record_known("run");
    tl_sql_execute(path, "UPDATE runs SET started = '2026-11-21T10:00:00.000Z', committed = '2026-11-21T10:00:16.500Z',"
                         " ended = NULL, ended_reason = NULL; UPDATE events SET at = '2026-11-21T10:00:05.000Z'");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_line("2026-11-21 10:00:00|2026-11-21 10:00:16|UTC|17 s|killed");
    expect_line("motor.d|2026-11-21 10:00:10|+0.002 -> +0.005");
    expect_line("2026-11-21 10:00:05|warning");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "2026-11-21T10:00:08"));
    expect_line("steps|800|0.01 s");
    expect_line("step 800");
    expect_not_shown("warning"); /* is older */
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "2026-11-21 10:00"));
    expect_line("steps|1600|0.01 s");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "2027-01-01"));
    expect_line("steps|0|0.01 s");
}

static void test_since_counts_back_from_the_end(void) {
    record_known("replay");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "2s"));
    expect_line("steps|200|0.01 s");
    expect_row("motor.d +0.005 0.00801 0.00799 0.008 0.00799 0.00801");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "0.1m"));
    expect_line("steps|600|0.01 s");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "3d"));
    expect_line("steps|1600|0.01 s");
    TEST_ASSERT_EQUAL_INT(2, SHOW(path, "--since", "2026-11-21"));
    expect_error("run 1|replay|date");
}

/* Steps before the first lock event count as its state. Other events do not change the state. */
static void test_the_shares_of_the_lock(void) {
    record_known("run");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_not_shown("  lock  ");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--json"));
    expect_shown("\"lock\":\tnull");
    tl_sql_execute(
        path,
        "INSERT INTO events (run, at, tick, severity, source, text) SELECT 1, (SELECT max(at) FROM events), column1 + "
        "coalesce((SELECT lead FROM runs), 0), 1, column2, column3 FROM (VALUES (99, 'lock', 'locked: 100 %'), "
        "(400, 'lock', 'lost: far off'), (500, 'lock', 'reset: of step 500'), (600, 'twin', 'free: no'), "
        "(800, 'lock', 'locked, corrected: at a bound'), (1200, 'lock', 'locked: again'), (5000, 'lock', 'free: later'))");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_line("in lock|75.0 %|corrected 25.0 %|lost 25.0 %");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--json"));
    cJSON *json = cJSON_Parse(output);
    char *lock = cJSON_PrintUnformatted(cJSON_GetObjectItemCaseSensitive(json, "lock"));
    TEST_ASSERT_EQUAL_STRING(
        "{\"state\":\"locked\",\"percent\":75,\"steps\":{\"free\":0,\"locked\":800,\"corrected\":400,\"degraded\":0,"
        "\"lost\":400},\"changes\":3,\"losses\":1,\"corrected\":null}",
        lock);
    cJSON_free(lock);
    cJSON_Delete(json);
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "8s"));
    expect_line("in lock|100.0 %|corrected 50.0 %");
    expect_not_shown("% lost");
}

/* The last event of the state counts, also if it is an update; the mean is that of the last steps. */
static void test_a_standing_correction(void) {
    record_known("run");
    tl_sql_execute(
        path, "INSERT INTO events (run, at, tick, severity, source, text) SELECT 1, (SELECT max(at) FROM events), "
              "column1 + coalesce((SELECT lead FROM runs), 0), 1, 'lock', column2 FROM (VALUES (99, 'locked: 100 %'), "
              "(800, 'locked, corrected: gear.d +2 N.m since t = 7.5 s; to accept it: \"approved\"'), "
              "(900, 'locked, corrected: gear.d +5 N.m since 10:00:07 UTC (t = 7.5 s)'))");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_line("in lock|100.0 %|at the end corrected|corrected 50.0 %");
    expect_line("   locked, corrected: gear.d +5 N.m since |UTC");
    expect_line("   to accept it: \"approved\": 5 in synchronise.adjust.gear.d");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--json"));
    cJSON *json = cJSON_Parse(output);
    const cJSON *lock = cJSON_GetObjectItemCaseSensitive(json, "lock");
    TEST_ASSERT_EQUAL_DOUBLE(1, cJSON_GetObjectItemCaseSensitive(lock, "changes")->valuedouble);
    char *corrected = cJSON_PrintUnformatted(cJSON_GetObjectItemCaseSensitive(lock, "corrected"));
    static const char start[] = "{\"reason\":\"correction\",\"variable\":\"gear.d\",\"value\":5,\"unit\":\"N.m\","
                                "\"since_s\":7.5,\"since\":\"2";
    TEST_ASSERT_EQUAL_STRING_LEN(start, corrected, sizeof start - 1);
    cJSON_free(corrected);
    cJSON_Delete(json);
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--since", "8s"));
    expect_line("   locked, corrected: gear.d +5 N.m since |UTC");
    tl_sql_execute(path, "UPDATE events SET text = replace(text, 'gear.d', 'motor.d')");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_line("   locked, corrected: motor.d +0.005 N.m since |UTC");
    tl_sql_execute(path, "UPDATE events SET text = replace(text, '7.5 s', '15.9 s')");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_line("   locked, corrected: motor.d +0.005 N.m since |UTC");
}

static void test_the_run_can_be_chosen(void) {
    record_known("replay");
    record_known("run");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_shown("Run 2: motor bench");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--run", "1"));
    expect_shown("Run 1: motor bench");
    TEST_ASSERT_EQUAL_INT(0, SHOW("--run=last", path));
    expect_shown("Run 2: motor bench");
    TEST_ASSERT_EQUAL_INT(65, SHOW(path, "--run", "3"));
    expect_error("run.db|run 3");
}

static void test_many_runs_and_events(void) {
    for (int i = 0; i < 12; i++) {
        tl_recorder_settings settings = tl_made_settings(path);
        tl_recorder *recorder = NULL;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, &error));
        for (int k = 0; k < 15; k++) {
            char text[32];
            (void)snprintf(text, sizeof text, "event number %d.", k);
            tl_recorder_event(recorder, -1, TL_EVENT_INFO, "cycle", text);
        }
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "SIGINT", NULL, &error));
    }
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_line("2 older|--json");
    expect_line("steps|0|0.01 s");
    expect_not_shown("event number 4.");
    expect_shown("event number 5.");
    expect_shown("event number 14.");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--events"));
    expect_shown("event number 0.");
}

static void test_removed_and_lost_entries(void) {
    record_known("replay");
    tl_sql_execute(
        path, "UPDATE main.runs SET removed_before = 400, entries_lost = 7; DELETE FROM main.steps WHERE step < 400;"
              " DELETE FROM main.outputs WHERE step < 400; DELETE FROM main.adjustments WHERE step < 400");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_line("recorded|7|lost|400|removed");
    expect_line("steps|1200|0.01 s");
    expect_row("4.00 s +0.002 0\n");
    expect_line("drive.u|correction 0");
}

/* ---- Terminals ---- */

/* Shows the page on a pseudo-terminal with this locale. The page fits into the terminal's
 * buffer, so that one thread can write and read. */
static void show_on_terminal(const char *locale) {
    char program[] = "twinlock";
    char verb[] = "show";
    char *argv[] = {program, verb, path, NULL};
    int master = posix_openpt(O_RDWR | O_NOCTTY);
    if (master < 0 && (errno == ENODEV || errno == ENOENT || errno == ENOSPC)) {
        TEST_IGNORE_MESSAGE("no pseudo-terminals here (is devpts mounted?)");
    }
    TEST_ASSERT_TRUE(master >= 0 && grantpt(master) == 0 && unlockpt(master) == 0);
    int slave = open(ptsname(master), O_RDWR | O_NOCTTY); // NOLINT(concurrency-mt-unsafe): one thread
    TEST_ASSERT_TRUE(slave >= 0);
    TEST_ASSERT_EQUAL_INT(0, setenv("LC_ALL", locale, 1));
    TEST_ASSERT_EQUAL_INT(0, setenv("TERM", "xterm", 1));
    TEST_ASSERT_EQUAL_INT(0, fcntl(slave, F_SETFL, O_NONBLOCK));
    TEST_ASSERT_EQUAL_INT(0, show_into(slave, 3, argv));
    TEST_ASSERT_EQUAL_INT(0, fcntl(master, F_SETFL, O_NONBLOCK));
    size_t length = 0;
    ssize_t now = 0;
    while ((now = read(master, output + length, sizeof output - 1 - length)) > 0) {
        length += (size_t)now;
    }
    output[length] = '\0';
    (void)close(slave);
    (void)close(master);
}

static void test_a_terminal_that_shows_unicode(void) {
    record_known("replay");
    (void)unsetenv("NO_COLOR");
    show_on_terminal("de_DE.UTF-8");
    expect_shown("▁▁▁▁████");
    expect_shown("+0.002 → +0.005");
    expect_shown("\x1b[1mRun 1: motor bench\x1b[0m");
    expect_shown("\x1b[33mwarning\x1b[0m");
    TEST_ASSERT_EQUAL_INT(0, setenv("NO_COLOR", "1", 1));
    show_on_terminal("C.utf8");
    expect_shown("+0.002 → +0.005");
    expect_not_shown("\x1b");
    (void)unsetenv("NO_COLOR");
}

static void test_a_terminal_that_does_not(void) {
    record_known("replay");
    tl_sql_execute(path, "UPDATE runs SET name = 'Prüfstand'; UPDATE events SET text = 'a' || char(0x9b) || '31m'");
    show_on_terminal("POSIX");
    expect_shown("+0.002 -> +0.005");
    expect_shown("Run 1: Pr?fstand");
    for (const char *c = output; *c != '\0'; c++) {
        TEST_ASSERT_TRUE((unsigned char)*c < 0x80);
    }
}

/* A text in a database must not send control sequences to the terminal. */
static void test_texts_are_harmless(void) {
    record_known("replay");
    tl_sql_execute(path, "UPDATE runs SET name = 'a' || char(27) || '[2Jb', ended_reason = 'c' || char(10) || 'd';"
                         " UPDATE events SET text = 'e' || char(7) || 'f' || char(0x9b) || '31mg', source = char(27);"
                         " UPDATE signals SET name = 'x' || char(27) || 'y', unit = char(13) WHERE kind = 'adjust'");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path));
    expect_shown("Run 1: a?[2Jb\n");
    expect_shown("ended: c?d\n");
    expect_shown("e?f?31mg");
    expect_shown("x?y");
    for (const char *c = output; *c != '\0'; c++) {
        TEST_ASSERT_TRUE((unsigned char)*c >= 0x20 || *c == '\n');
    }
}

/* ---- JSON ---- */

static double number_of(const cJSON *object, const char *first, const char *second, const char *third) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, first);
    item = second == NULL ? item : cJSON_GetObjectItemCaseSensitive(item, second);
    item = third == NULL ? item : cJSON_GetObjectItemCaseSensitive(item, third);
    TEST_ASSERT_TRUE_MESSAGE(cJSON_IsNumber(item), first);
    return item->valuedouble;
}

/* The numbers equal those that SQL computes from the database. */
static void test_json(void) {
    record_known("replay");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--json"));
    cJSON *root = cJSON_Parse(output);
    TEST_ASSERT_NOT_NULL(root);
    TEST_ASSERT_EQUAL_DOUBLE(1, number_of(root, "run", NULL, NULL));
    TEST_ASSERT_EQUAL_DOUBLE(1600, number_of(root, "steps", NULL, NULL));
    TEST_ASSERT_EQUAL_DOUBLE(3200, number_of(root, "evaluations", NULL, NULL));
    TEST_ASSERT_EQUAL_DOUBLE(1600, number_of(root, "optimised_steps", NULL, NULL));
    TEST_ASSERT_EQUAL_DOUBLE(16, number_of(root, "outcomes", "optimised", NULL));
    TEST_ASSERT_EQUAL_DOUBLE(tl_sql_number(path, "SELECT sum(error * error) / (count(*) - 1) FROM outputs WHERE"
                                                 " signal = 0 AND quality = 0"),
                             number_of(root, "match", "motor.omega", "mse"));
    TEST_ASSERT_EQUAL_DOUBLE(1200, number_of(root, "match", "motor.i", "left_out"));
    TEST_ASSERT_EQUAL_DOUBLE(2, number_of(root, "match", "motor.i", "max"));
    TEST_ASSERT_TRUE(fabs(tl_sql_number(path, "SELECT avg(correction) FROM adjustments WHERE signal = 0") -
                          number_of(root, "adjust", "motor.d", "correction_mean")) < 1e-15);
    TEST_ASSERT_EQUAL_DOUBLE(tl_sql_number(path, "SELECT max(applied) FROM adjustments WHERE signal = 0"),
                             number_of(root, "adjust", "motor.d", "max"));
    TEST_ASSERT_EQUAL_DOUBLE(24, number_of(root, "adjust", "drive.u", "last"));
    const cJSON *windows = cJSON_GetObjectItem(
        cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItem(root, "adjust"), "motor.d"), "windows");
    TEST_ASSERT_EQUAL_INT(8, cJSON_GetArraySize(windows));
    TEST_ASSERT_EQUAL_DOUBLE(1000, number_of(cJSON_GetArrayItem(windows, 5), "from_step", NULL, NULL));
    TEST_ASSERT_EQUAL_DOUBLE(10, number_of(cJSON_GetArrayItem(windows, 5), "from_s", NULL, NULL));
    TEST_ASSERT_TRUE(fabs(number_of(cJSON_GetArrayItem(windows, 5), "correction_mean", NULL, NULL) - 0.005) < 1e-12);
    TEST_ASSERT_EQUAL_DOUBLE(2,
                             number_of(cJSON_GetArrayItem(cJSON_GetObjectItem(root, "runs"), 0), "lead", NULL, NULL));
    const cJSON *ledger = cJSON_GetObjectItem(root, "ledger");
    TEST_ASSERT_EQUAL_DOUBLE(105600, number_of(ledger, "total", "executions", NULL));
    TEST_ASSERT_EQUAL_DOUBLE(100800, number_of(ledger, "total", "predicted", NULL));
    TEST_ASSERT_EQUAL_DOUBLE(192000, number_of(ledger, "total", "plain", NULL));
    TEST_ASSERT_EQUAL_DOUBLE(35200, number_of(ledger, "components", "motor", "executions"));
    TEST_ASSERT_EQUAL_DOUBLE(3200, number_of(ledger, "components", "plant", "repeated"));
    TEST_ASSERT_EQUAL_DOUBLE(800, number_of(ledger, "components", "motor", "uncached"));
    TEST_ASSERT_EQUAL_DOUBLE(86400, number_of(ledger, "total", "saved", NULL));
    TEST_ASSERT_EQUAL_DOUBLE(1600 - 3200, number_of(ledger, "components", "plant", "difference"));
    TEST_ASSERT_EQUAL_STRING(
        "the drive does not answer",
        cJSON_GetObjectItem(cJSON_GetArrayItem(cJSON_GetObjectItem(root, "events"), 0), "text")->valuestring);
    cJSON_Delete(root);
}

/* Numbers that are missing are null, not NaN. */
static void test_json_of_an_empty_run(void) {
    const tl_recorder_settings settings = tl_made_settings(path);
    tl_recorder *recorder = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "SIGINT", NULL, &error));
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--json"));
    cJSON *root = cJSON_Parse(output);
    TEST_ASSERT_NOT_NULL(root);
    const cJSON *adjust = cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItem(root, "adjust"), "motor.d");
    TEST_ASSERT_TRUE(cJSON_IsNull(cJSON_GetObjectItem(adjust, "mean")));
    TEST_ASSERT_EQUAL_INT(0, cJSON_GetArraySize(cJSON_GetObjectItem(adjust, "windows")));
    cJSON_Delete(root);
}

/* ---- CSV ---- */

static const char *next_line(const char *line) {
    const char *end = strchr(line, '\n');
    TEST_ASSERT_NOT_NULL(end);
    return end + 1;
}

/* Returns field `index` of a line without quotes; NaN if it is empty. */
static double field(const char *line, int index) {
    for (; index > 0; index--) {
        line = strchr(line, ',');
        TEST_ASSERT_NOT_NULL(line);
        line++;
    }
    return *line == ',' || *line == '\n' ? (double)NAN : strtod(line, NULL);
}

static void expect_same(double expected, double found) {
    TEST_ASSERT_EQUAL_MEMORY(&expected, &found, sizeof expected);
}

static void test_csv_of_samples_reads_back_bit_for_bit(void) {
    record_known("replay");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "samples"));
    const char *line = output;
    TEST_ASSERT_EQUAL_INT(
        0, strncmp(line, "time,tick,torque,torque quality,omega,omega quality,door,door quality\n0,0,", 74));
    for (int64_t tick = 0; tick < STEPS; tick++) {
        tl_sample sample;
        tl_made_sample(tick, &sample);
        line = next_line(line);
        TEST_ASSERT_EQUAL_DOUBLE((double)tick / 100.0, field(line, 0));
        for (int i = 0; i < TL_MADE_PLANT; i++) {
            if (sample.quality[i] == TL_GOOD || sample.quality[i] == TL_OUT_OF_RANGE) {
                expect_same(sample.values[i], field(line, 2 + 2 * i));
            } else {
                TEST_ASSERT_TRUE(isnan(field(line, 2 + 2 * i)));
            }
        }
    }
    TEST_ASSERT_EQUAL_STRING("", next_line(line));
}

/* An outlier has a value, like a value that is out of range. */
static void test_csv_of_outliers(void) {
    record_known("replay");
    tl_sql_execute(path, "UPDATE samples SET value = 3.5, quality = 5 WHERE tick = 0 AND signal = 1;"
                         " UPDATE outputs SET quality = 5 WHERE step = 1 AND signal = 0");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "samples"));
    TEST_ASSERT_EQUAL_DOUBLE(3.5, field(next_line(output), 4));
    expect_shown(",3.5,outlier,");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "outputs"));
    expect_shown("\n0.02,1,9.5,10,-0.5,outlier,3,1,2,stale\n");
}

static void test_a_run_in_mode_hold(void) {
    record_known("replay");
    tl_sql_execute(path, "UPDATE runs SET measurements = 'hold'");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--verbose"));
    expect_line("2 steps|hold");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--json"));
    expect_shown("\"hold\"");
}

static void test_csv_of_the_other_tables(void) {
    tl_record record;
    record_known("replay");
    known_record(1, &record);
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "outputs"));
    expect_shown(
        "time,step,motor.omega simulated,plant.omega measured,motor.omega error,plant.omega quality,motor.i simulated,"
        "plant.torque measured,");
    expect_shown("\n0.02,1,9.5,10,-0.5,good,3,1,2,stale\n"); /* y_2 */
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv=adjustments"));
    const char *line = next_line(next_line(output));
    TEST_ASSERT_EQUAL_DOUBLE(0.01, field(line, 0));
    expect_same(record.u[0], field(line, 2));
    expect_same(record.nominal[0], field(line, 3));
    expect_same(record.u[0] - record.nominal[0], field(line, 4));
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "steps", "--since", "0.02s"));
    TEST_ASSERT_EQUAL_STRING("time,step,outcome,stop,J,J_nominal,evaluations,executions,used_ns,predicted,flags,held\n"
                             "15.98,1598,first guess,tolerance,0,0,2,8,0,9,,\n"
                             "15.99,1599,first guess,tolerance,0,0,2,8,0,9,,\n",
                             output);
    tl_sql_execute(path, "UPDATE steps SET flags = 7, held = 3 WHERE step = 1598;"
                         "UPDATE steps SET flags = 1, held = 2 WHERE step = 1599");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "steps", "--since", "0.02s"));
    expect_shown(",9,\"fallback, stagnated, without nominal\",\"motor.d, drive.u\"\n");
    expect_shown(",9,fallback,drive.u\n");
    tl_sql_execute(path, "UPDATE events SET at = '2026-11-21T10:00:05.000Z', text = 'he said \"no\", and left'");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "events"));
    TEST_ASSERT_EQUAL_STRING("at,tick,severity,source,text\n"
                             "2026-11-21T10:00:05.000Z,17,warning,plant,\"he said \"\"no\"\", and left\"\n",
                             output);
}

static void test_another_format(void) {
    record_known("replay");
    tl_sql_execute(path, "PRAGMA user_version = 4");
    TEST_ASSERT_EQUAL_INT(65, SHOW(path));
    expect_error("run.db|format 4|format 8|twinlock");
    TEST_ASSERT_EQUAL_INT64(4, tl_sql_integer(path, "PRAGMA user_version"));
}

static void test_a_ledger_without_names(void) {
    record_known("replay");
    tl_sql_execute(path,
                   "ALTER TABLE components RENAME TO other; CREATE TABLE components AS SELECT run, component, NULL"
                   " AS name, plain, predicted, executions, repeated, uncached FROM other");
    TEST_ASSERT_EQUAL_INT(65, SHOW(path));
    expect_error("run.db|damaged|components|key");
    (void)unlink(path);
    record_known("replay");
    tl_sql_execute(path, "UPDATE components SET name = x'41'");
    TEST_ASSERT_EQUAL_INT(65, SHOW(path));
    expect_error("run.db|damaged|components|run 1");
}

/* Texts of an FMU and names of a plant cannot control a terminal or begin a row. */
static void test_csv_without_control_characters(void) {
    record_known("replay");
    tl_sql_execute(path, "UPDATE events SET at = '2026-11-21T10:00:05.000Z', source = 'F' || char(27) || 'MU', text ="
                         " char(27) || ']0;x' || char(7) || char(13, 10) || '=1,2' || char(0x7f, 0x9b) || 'é'");
    tl_sql_execute(path, "UPDATE signals SET name = 'plant.' || char(27) || '[2J', compared_with = 'a' || char(10)");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "events"));
    expect_shown("\n2026-11-21T10:00:05.000Z,17,warning,F?MU,\"?]0;x?\?\?=1,2?\?é\"\n");
    for (size_t i = 0; i < 3; i++) {
        static const char *const tables[] = {"samples", "outputs", "adjustments"};
        TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", tables[i]));
        expect_shown("?[2J");
        expect_not_shown("\x1b");
    }
}

static void test_csv_of_a_live_run_has_dates(void) {
    record_known("run");
    tl_sql_execute(path, "UPDATE runs SET started = '2026-11-21T10:00:00.000Z'");
    TEST_ASSERT_EQUAL_INT(0, SHOW(path, "--csv", "outputs"));
    expect_shown("time,at,step,");
    expect_shown("\n0.02,2026-11-21T10:00:00.020Z,1,9.5,10,");
}

/* ---- Errors ---- */

static void test_usage(void) {
    TEST_ASSERT_EQUAL_INT(0, SHOW("--help"));
    expect_shown("usage: twinlock show DATABASE [options]");
    TEST_ASSERT_EQUAL_STRING("", errors);
    TEST_ASSERT_EQUAL_INT(2, SHOW(NULL));
    expect_error("show|one database");
    TEST_ASSERT_EQUAL_INT(2, SHOW(path, path));
    TEST_ASSERT_EQUAL_INT(2, SHOW(path, "--json", "--csv", "steps"));
    TEST_ASSERT_EQUAL_INT(2, SHOW(path, "--unknown"));
    TEST_ASSERT_EQUAL_INT(2, SHOW(path, "--csv", "u"));
    expect_error("--csv|\"u\"|outputs|adjustments|steps|samples|events");
    static const char *const runs[] = {"0", "-1", "x", "1x", "", "99999999999999999999"};
    for (size_t i = 0; i < sizeof runs / sizeof runs[0]; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(2, SHOW(path, "--run", runs[i]), runs[i]);
    }
    static const char *const times[] = {"yesterday", "5", "5w", "-5s", "1e999d", "2026-13-01", "s", "infs"};
    for (size_t i = 0; i < sizeof times / sizeof times[0]; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(2, SHOW(path, "--since", times[i]), times[i]);
    }
    TEST_ASSERT_EQUAL_STRING("", output);
}

static void test_files_that_cannot_be_shown(void) {
    TEST_ASSERT_EQUAL_INT(65, SHOW(path));
    expect_error("run.db|No such file");
    tl_sql_execute(path, "CREATE TABLE mine (x)");
    TEST_ASSERT_EQUAL_INT(65, SHOW(path));
    expect_error("run.db|SQLite|another program");
    TEST_ASSERT_EQUAL_STRING("", output);
}

static void test_a_database_without_runs(void) {
    record_known("replay");
    tl_sql_execute(path, "DELETE FROM runs");
    TEST_ASSERT_EQUAL_INT(65, SHOW(path));
    expect_error("run.db|no run");
}

static void test_a_locked_database(void) {
    sqlite3 *other = NULL;
    record_known("replay");
    TEST_ASSERT_EQUAL_INT(SQLITE_OK, sqlite3_open(path, &other));
    TEST_ASSERT_EQUAL_INT(SQLITE_OK,
                          sqlite3_exec(other, "PRAGMA locking_mode = EXCLUSIVE; BEGIN IMMEDIATE", NULL, NULL, NULL));
    TEST_ASSERT_EQUAL_INT(75, SHOW(path));
    expect_error("run.db|locked");
    (void)sqlite3_close(other);
}

static void test_damage_is_reported(void) {
    static const char *const damages[] = {
        "UPDATE adjustments SET signal = 5 WHERE signal = 1",
        "UPDATE outputs SET signal = -1 WHERE signal = 0",
        "UPDATE steps SET step = 9223372036854775807 WHERE step = 4",
        "DELETE FROM signals WHERE kind = 'match' AND signal = 0",
        "DROP TABLE adjustments",
    };
    for (size_t i = 0; i < sizeof damages / sizeof damages[0]; i++) {
        record_known("replay");
        tl_sql_execute(path, damages[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(65, SHOW(path), damages[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(65, SHOW(path, "--json"), damages[i]);
        TEST_ASSERT_EQUAL_STRING("", output);
        (void)unlink(path);
    }
}

/* If pages are damaged, SQLite's integrity check reports more than the statement that failed. */
static void test_damaged_pages_are_named(void) {
    enum { PAGE = 4096 };
    record_known("replay");
    int64_t root = tl_sql_integer(path, "SELECT rootpage FROM sqlite_schema WHERE name = 'steps'");
    FILE *file = fopen(path, "r+b");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_INT(0, fseek(file, (long)(root - 1) * PAGE, SEEK_SET));
    for (int i = 0; i < PAGE; i++) {
        (void)fputc('U', file);
    }
    (void)fclose(file);
    TEST_ASSERT_EQUAL_INT(65, SHOW(path));
    expect_error("run.db|damaged|malformed|copy|SQLite");
}

/* Values that the recorder never writes: each one is reported as damage. */
static void test_nonsense_is_damage(void) {
    static const char *const nonsense[] = {
        "UPDATE runs SET started = 'x'",
        "UPDATE runs SET committed = ''",
        "UPDATE main.runs SET ended_reason = NULL",
        "UPDATE runs SET step_ns = 9223372036854775807",
        "UPDATE runs SET prediction = -1",
        "UPDATE runs SET measurements = 'often'",
        "UPDATE runs SET name = CAST(x'ff41' AS TEXT)",
        "UPDATE runs SET name = printf('%5000d', 1)",
        "UPDATE runs SET steps_written = -1",
        "UPDATE adjustments SET applied = 'text' WHERE step = 20",
        "UPDATE adjustments SET nominal = 9e999 WHERE step = 20",
        "UPDATE outputs SET simulated = x'00' WHERE step = 20",
        "UPDATE outputs SET quality = -1 WHERE step = 20",
        "UPDATE steps SET J = 'a' WHERE step = 20",
        "UPDATE steps SET used_ns = -5 WHERE step = 20",
        "UPDATE steps SET evaluations = 1.5 WHERE step = 20",
        "UPDATE signals SET type = 'Complex' WHERE kind = 'match'",
        "UPDATE events SET at = 'now'",
        "UPDATE events SET text = x'00'",
        "UPDATE events SET tick = -7",
        "UPDATE main.components SET plain = -1",
    };
    static const char *const tables[] = {"outputs", "adjustments", "steps", "events"};
    for (size_t i = 0; i < sizeof nonsense / sizeof nonsense[0]; i++) {
        record_known("run");
        tl_sql_execute(path, "INSERT INTO events (run, at, severity, source, text)"
                             " SELECT run, committed, 0, 'cycle', 'text' FROM runs");
        tl_sql_execute(path, "UPDATE runs SET events_written = 1");
        tl_sql_execute(path, nonsense[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(65, SHOW(path), nonsense[i]);
        expect_error("run.db|damaged|copy|file");
        TEST_ASSERT_EQUAL_INT_MESSAGE(65, SHOW(path, "--json"), nonsense[i]);
        for (size_t k = 0; k < sizeof tables / sizeof tables[0]; k++) {
            int code = SHOW(path, "--csv", tables[k]);
            TEST_ASSERT_TRUE_MESSAGE(code == 0 || code == 65, nonsense[i]);
        }
        (void)unlink(path);
    }
}

static void test_a_run_that_is_being_written(void) {
    const tl_recorder_settings settings = tl_made_settings(path);
    tl_recorder *recorder = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, &error));
    int codes = 0;
    for (int i = 0; i < 20; i++) {
        tl_made_put(recorder, i * 500, 500);
        codes += SHOW(path);
    }
    tl_status status = tl_recorder_close(recorder, "end", NULL, &error);
    TEST_ASSERT_EQUAL_INT(0, codes);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    expect_line("killed");
}

/* ---- Text ---- */

/* The newest ones of this run, in their order. */
static void test_more_findings_than_are_shown(void) {
    static tl_history_finding findings[3 * TL_SHOW_FINDINGS];
    static tl_run_finding rows[TL_SHOW_FINDINGS];
    const size_t count = sizeof findings / sizeof findings[0];
    tl_run_changes changes;
    for (size_t i = 0; i < count; i++) {
        findings[i] = (tl_history_finding){.row = {.number = (int64_t)i + 1}, .run = i % 2 == 0 ? 1 : 2, .started = 5};
    }
    const tl_show_changes all = {.finding = findings, .count = count};
    tl_show_changes_of_run(&all, 2, rows, &changes);
    TEST_ASSERT_EQUAL_size_t(TL_SHOW_FINDINGS, changes.count);
    TEST_ASSERT_EQUAL_INT64(count, rows[TL_SHOW_FINDINGS - 1].number);
    TEST_ASSERT_EQUAL_INT64(count - 2 * (TL_SHOW_FINDINGS - 1), rows[0].number);
    tl_show_changes_of_run(&(tl_show_changes){.finding = findings, .count = 5}, 1, rows, &changes);
    TEST_ASSERT_EQUAL_size_t(3, changes.count);
    TEST_ASSERT_EQUAL_INT64(1, rows[0].number);
    tl_show_changes_of_run(&all, 3, rows, &changes);
    TEST_ASSERT_EQUAL_size_t(0, changes.count);
}

static void test_durations_and_sizes(void) {
    static const struct {
        double seconds;
        const char *text;
    } durations[] = {{0.0, "0 s"},         {0.35, "0.35 s"},     {14.0, "14 s"},        {59.4, "59 s"},
                     {59.6, "1 min 0 s"},  {90.0, "1 min 30 s"}, {3599.7, "1 h 0 min"}, {7500.0, "2 h 5 min"},
                     {86400.0, "1 d 0 h"}, {277200.0, "3 d 5 h"}};
    char text[64];
    for (size_t i = 0; i < sizeof durations / sizeof durations[0]; i++) {
        tl_show_duration(durations[i].seconds, text, sizeof text);
        TEST_ASSERT_EQUAL_STRING(durations[i].text, text);
    }
    tl_show_bytes(0.0, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("0 B", text);
    tl_show_bytes(999.7, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("1.0 kB", text);
    tl_show_bytes(12400000.0, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("12.4 MB", text);
    tl_show_exact(0.1, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("0.1", text);
    tl_show_number(-0.0, true, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("0", text);
    tl_show_number((double)NAN, true, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("-", text);
}

static void test_curves(void) {
    const tl_show_style unicode = {.unicode = true};
    const tl_show_style plain = {.unicode = false};
    const double rising[] = {0, 1, 2, 3, 4, 5, 6, 7};
    const double with_gap[] = {-1.0, (double)NAN, 1.0};
    const double flat[] = {2.5, 2.5};
    char text[TL_SHOW_CURVE];
    tl_show_curve(unicode, rising, 8, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("▁▂▃▄▅▆▇█", text);
    tl_show_curve(plain, with_gap, 3, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("_ #", text);
    tl_show_curve(unicode, flat, 2, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("▄▄", text);
    const double huge[] = {-1.7e308, (double)INFINITY, 1.7e308, (double)-INFINITY, 0.0};
    tl_show_curve(plain, huge, 5, text, sizeof text);
    TEST_ASSERT_EQUAL_STRING("_ # ~", text);
    tl_show_curve(unicode, rising, 8, text, 8); /* whole characters only */
    TEST_ASSERT_EQUAL_STRING("▁▂", text);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_show");
    UNITY_BEGIN();
    RUN_TEST(test_the_page);
    RUN_TEST(test_a_pipe_gets_plain_text);
    RUN_TEST(test_a_live_run_has_dates);
    RUN_TEST(test_since_counts_back_from_the_end);
    RUN_TEST(test_the_shares_of_the_lock);
    RUN_TEST(test_a_standing_correction);
    RUN_TEST(test_the_run_can_be_chosen);
    RUN_TEST(test_many_runs_and_events);
    RUN_TEST(test_removed_and_lost_entries);
    RUN_TEST(test_a_terminal_that_shows_unicode);
    RUN_TEST(test_a_terminal_that_does_not);
    RUN_TEST(test_texts_are_harmless);
    RUN_TEST(test_json);
    RUN_TEST(test_json_of_an_empty_run);
    RUN_TEST(test_csv_of_samples_reads_back_bit_for_bit);
    RUN_TEST(test_csv_of_outliers);
    RUN_TEST(test_a_run_in_mode_hold);
    RUN_TEST(test_csv_of_the_other_tables);
    RUN_TEST(test_another_format);
    RUN_TEST(test_a_ledger_without_names);
    RUN_TEST(test_csv_without_control_characters);
    RUN_TEST(test_csv_of_a_live_run_has_dates);
    RUN_TEST(test_usage);
    RUN_TEST(test_files_that_cannot_be_shown);
    RUN_TEST(test_a_database_without_runs);
    RUN_TEST(test_a_locked_database);
    RUN_TEST(test_damage_is_reported);
    RUN_TEST(test_damaged_pages_are_named);
    RUN_TEST(test_nonsense_is_damage);
    RUN_TEST(test_a_run_that_is_being_written);
    RUN_TEST(test_more_findings_than_are_shown);
    RUN_TEST(test_durations_and_sizes);
    RUN_TEST(test_curves);
    tl_kept_file_free(&known_run);
    tl_kept_file_free(&known_replay);
    return tl_scratch_finish(&scratch, UNITY_END());
}
