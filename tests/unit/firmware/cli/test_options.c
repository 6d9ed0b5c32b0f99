/* The options of all verbs: values, defaults, rules between options, and the option table. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/cli/options.h"
#include "firmware/report/show.h"
#include "firmware/retune/control.h"
#include "tests/support/message.h"
#include "tests/support/stderr_capture.h"

enum { ARGUMENTS = 12, LONGEST = 128 };

static tl_options options;
static char *said;

void setUp(void) {
    said = NULL;
}

void tearDown(void) {
    free(said);
}

/* Reads the words after a verb, to which the options may point. `said` holds the output on standard
 * error. */
#define READ(verb, ...) read_words(verb, (const char *const[]){__VA_ARGS__, NULL})

static tl_options_outcome read_words(tl_verb verb, const char *const *words) {
    static char copies[ARGUMENTS][LONGEST];
    static char *argv[ARGUMENTS + 1];
    int argc = 1;
    memset(argv, 0, sizeof argv);
    argv[0] = copies[0];
    for (; *words != NULL && argc < ARGUMENTS; words++) {
        (void)snprintf(copies[argc], sizeof copies[argc], "%s", *words);
        argv[argc] = copies[argc];
        argc++;
    }
    free(said);
    bool captured = tl_stderr_capture_begin();
    tl_options_outcome outcome = tl_options_read(verb, argc, argv, &options);
    said = captured ? tl_stderr_capture_end() : NULL;
    return outcome;
}

/* Checks the message, which is the first line, and that the usage of the verb follows. */
static void expect_said(tl_verb verb, const char *parts) {
    char usage[LONGEST];
    TEST_ASSERT_NOT_NULL(said);
    char *end = strchr(said, '\n');
    TEST_ASSERT_NOT_NULL_MESSAGE(end, said);
    (void)snprintf(usage, sizeof usage, "usage: twinlock %s", tl_verb_rows[verb].name);
    TEST_ASSERT_EQUAL_STRING_LEN(usage, end + 1, strlen(usage));
    *end = '\0';
    TL_EXPECT_PARTS(parts, said);
}

static void expect_wrong(tl_verb verb, const char *option, const char *value, const char *expected) {
    char parts[LONGEST];
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OPTIONS_WRONG, READ(verb, "subject", option, value), value);
    (void)snprintf(parts, sizeof parts, "twinlock %s|%s|\"%s\"|%s", tl_verb_rows[verb].name, option, value, expected);
    expect_said(verb, parts);
}

static void test_defaults(void) {
    for (tl_verb verb = 0; verb < TL_VERB_COUNT; verb++) {
        const tl_options wanted = {
            .call_limit_s = 60, .watchdog_s = 30, .seed = 1, .table = TL_OPTIONS_NO_TABLE, .right = TL_RIGHT_BOX};
        TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(verb, "subject"));
        TEST_ASSERT_EQUAL_STRING("subject", options.subject);
        TEST_ASSERT_EQUAL_STRING("", said);
        TEST_ASSERT_EQUAL_size_t(verb == TL_VERB_INIT ? 1 : 0, options.fmu_count);
        options.subject = NULL;
        options.fmus = NULL;
        options.fmu_count = 0;
        TEST_ASSERT_EQUAL_MEMORY(&wanted, &options, sizeof wanted);
    }
}

static void test_every_option_sets_its_own(void) {
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_REPLAY, "--recording", "r", "--run", "7", "c", "--db", "d",
                                                "--csv=t", "--report", "p", "--call-limit=0.5"));
    TEST_ASSERT_EQUAL_STRING("r", options.recording);
    TEST_ASSERT_EQUAL_UINT64(7, options.run);
    TEST_ASSERT_EQUAL_STRING("c", options.subject);
    TEST_ASSERT_EQUAL_STRING("d", options.database);
    TEST_ASSERT_EQUAL_STRING("t", options.trajectory);
    TEST_ASSERT_EQUAL_STRING("p", options.report);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, options.call_limit_s);
    TEST_ASSERT_FALSE(options.json || options.plain || options.realtime);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_REPLAY, "--json", "--plain", "--realtime", "--", "-c"));
    TEST_ASSERT_TRUE(options.json && options.plain && options.realtime);
    TEST_ASSERT_EQUAL_STRING("-c", options.subject);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_RUN, "c", "--supervise", "--watchdog", "w", "--state", "s",
                                                "--watchdog-timeout", "3600", "--duration", "1e-3", "--status"));
    TEST_ASSERT_TRUE(options.supervise && options.status);
    TEST_ASSERT_EQUAL_STRING("w", options.watchdog);
    TEST_ASSERT_EQUAL_STRING("s", options.state);
    TEST_ASSERT_EQUAL_DOUBLE(3600, options.watchdog_s);
    TEST_ASSERT_EQUAL_DOUBLE(1e-3, options.duration_s);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_PLANT, "c", "--for", "l", "--fifo", "f", "--real-bus", "--seed",
                                                "18446744073709551615"));
    TEST_ASSERT_EQUAL_STRING("l", options.listener);
    TEST_ASSERT_EQUAL_STRING("f", options.fifo);
    TEST_ASSERT_TRUE(options.real_bus);
    TEST_ASSERT_EQUAL_UINT64(UINT64_MAX, options.seed);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_PLANT, "c", "--record", "w"));
    TEST_ASSERT_EQUAL_STRING("w", options.record);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_CHECK, "c", "--variables", "--memory-limit", "2048"));
    TEST_ASSERT_EQUAL_UINT64(2048, options.memory_limit_mib);
    TEST_ASSERT_TRUE(options.variables);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_PROBE, "c", "--json", "--duration", "0.5"));
    TEST_ASSERT_TRUE(options.json && options.duration_s == 0.5);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_INIT, "a.fmu", "--recording", "r", "b.fmu", "--plant", "p",
                                                "--step", "0.5", "--output", "o"));
    TEST_ASSERT_EQUAL_size_t(2, options.fmu_count);
    TEST_ASSERT_EQUAL_STRING("b.fmu", options.fmus[1]);
    TEST_ASSERT_EQUAL_STRING("r", options.recording);
    TEST_ASSERT_EQUAL_STRING("p", options.plant);
    TEST_ASSERT_EQUAL_STRING("o", options.output);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, options.step_s);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_INIT, "a.fmu", "--modbus", "m:1"));
    TEST_ASSERT_EQUAL_STRING("m:1", options.modbus);
}

static void test_the_lesser_right_counts(void) {
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_RELOAD, "-", "--right", "retune", "--right", "commission"));
    TEST_ASSERT_EQUAL_STRING("-", options.subject);
    TEST_ASSERT_EQUAL_UINT32(TL_RIGHT_RETUNE, options.right);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_RELOAD, "--right", "commission", "-", "--rig=read"));
    TEST_ASSERT_EQUAL_UINT32(TL_RIGHT_READ, options.right);
    expect_wrong(TL_VERB_RELOAD, "--right", "box", "read|retune|commission");
}

static void test_tables_and_runs_of_show(void) {
    static const tl_show_csv_table tables[] = {TL_SHOW_OUTPUTS, TL_SHOW_ADJUSTMENTS, TL_SHOW_STEPS, TL_SHOW_SAMPLES,
                                               TL_SHOW_EVENTS};
    static const char *const names[] = {"outputs", "adjustments", "steps", "samples", "events"};
    for (size_t i = 0; i < sizeof tables / sizeof tables[0]; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_SHOW, "d", "--csv", names[i], "--events"));
        TEST_ASSERT_TRUE(options.events);
        TEST_ASSERT_EQUAL_INT(tables[i], options.table);
    }
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_SHOW, "d", "--run", "9223372036854775807"));
    TEST_ASSERT_EQUAL_UINT64(INT64_MAX, options.run);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_SHOW, "d", "--run", "last"));
    TEST_ASSERT_EQUAL_UINT64(0, options.run);
}

static void test_since(void) {
    static const char *const backs[] = {"90s", "1.5m", "0.5h", "2d"};
    static const double seconds[] = {90, 90, 1800, 172800};
    for (size_t i = 0; i < sizeof backs / sizeof backs[0]; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_SHOW, "d", "--since", backs[i]));
        TEST_ASSERT_EQUAL_STRING(backs[i], options.since.text);
        TEST_ASSERT_FALSE(options.since.is_date);
        TEST_ASSERT_EQUAL_DOUBLE(seconds[i], options.since.back_s);
    }
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_SHOW, "d", "--since", "1970-01-02"));
    TEST_ASSERT_TRUE(options.since.is_date);
    TEST_ASSERT_EQUAL_INT64(86400000, options.since.at);
}

static void test_values_that_are_refused(void) {
    static const char *const limits[] = {"0", "-1", "1e9", "nan", "inf", "1e999", "1e-310", "2 s", ""};
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        expect_wrong(TL_VERB_RUN, "--duration", limits[i], "seconds|0|1e9");
        expect_wrong(TL_VERB_PROBE, "--duration", limits[i], "seconds|0|1e9");
        expect_wrong(TL_VERB_CHECK, "--call-limit", limits[i], "seconds|0|1e9");
    }
    static const char *const sizes[] = {"0", "63", "1048577", "-64", "64M", "1e3", "99999999999999999999", ""};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++) {
        expect_wrong(TL_VERB_PLANT, "--memory-limit", sizes[i], "MiB|64|1048576");
    }
    static const char *const timeouts[] = {"0", "0.5", "2.5", "3601", "soon", "-3", "nan", ""};
    for (size_t i = 0; i < sizeof timeouts / sizeof timeouts[0]; i++) {
        expect_wrong(TL_VERB_RUN, "--watchdog-timeout", timeouts[i], "whole seconds|1|3600");
        expect_wrong(TL_VERB_RELOAD, "--shadow", timeouts[i], "whole seconds|1|3600");
    }
    static const char *const runs[] = {"0", "-1", "x", "1x", "", "9223372036854775808", "99999999999999999999"};
    for (size_t i = 0; i < sizeof runs / sizeof runs[0]; i++) {
        expect_wrong(TL_VERB_REPLAY, "--run", runs[i], "number");
        expect_wrong(TL_VERB_SHOW, "--run", runs[i], "number|last");
    }
    expect_wrong(TL_VERB_REPLAY, "--run", "last", "number");
    expect_wrong(TL_VERB_PLANT, "--seed", " -5", "whole number");
    expect_wrong(TL_VERB_PLANT, "--seed", "18446744073709551616", "whole number");
    expect_wrong(TL_VERB_SHOW, "--since", "yesterday", "date|90s|15m|8h|2d");
    expect_wrong(TL_VERB_SHOW, "--csv", "step", "outputs|adjustments|steps|samples|events");
}

static void test_options_that_need_another(void) {
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_WRONG, READ(TL_VERB_RUN, "c", "--state", "s"));
    expect_said(TL_VERB_RUN, "--state|--supervise");
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_WRONG, READ(TL_VERB_RUN, "c", "--watchdog-timeout", "3", "--supervise"));
    expect_said(TL_VERB_RUN, "--watchdog-timeout|--watchdog DEVICE");
}

/* A supervised run has its own time limit for calls. */
static void test_options_that_exclude_each_other(void) {
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_WRONG, READ(TL_VERB_INIT, "a.fmu", "--modbus", "m", "--plant", "p"));
    expect_said(TL_VERB_INIT, "--modbus|--plant");
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_RUN, "c", "--call-limit", "2.5"));
    TEST_ASSERT_EQUAL_DOUBLE(2.5, options.call_limit_s);
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_WRONG, READ(TL_VERB_RUN, "c", "--call-limit", "2.5", "--supervise"));
    expect_said(TL_VERB_RUN, "--supervise|--call-limit");
}

/* An option that would have no effect is rejected. */
static void test_options_without_effect(void) {
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_WRONG, READ(TL_VERB_RELOAD, "c", "--state", "--probation", "3"));
    expect_said(TL_VERB_RELOAD, "--probation|--state");
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_WRONG, READ(TL_VERB_RELOAD, "c", "--why", "x", "--confirm"));
    expect_said(TL_VERB_RELOAD, "--why|--confirm");
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_RELOAD, "c", "--versions", "--control", "s"));
    TEST_ASSERT_EQUAL_INT(TL_OPTIONS_READ, READ(TL_VERB_RELOAD, "c", "--rollback", "--why", "x", "--wait"));
}

/* Each verb has an option at most once. An option with a checked value describes that value. */
static void test_the_table(void) {
    TEST_ASSERT_LESS_OR_EQUAL_size_t(TL_OPTIONS_MOST, tl_verb_table.option_count);
    for (size_t i = 0; i < tl_verb_table.option_count; i++) {
        const tl_option *option = &tl_verb_table.options[i];
        TEST_ASSERT_NOT_NULL(option->name);
        bool is_text = option->read == tl_option_text;
        bool checked = option->read != NULL && option->read != tl_option_switch && !is_text;
        TEST_ASSERT_EQUAL_MESSAGE(checked, option->expected != NULL, option->name);
        TEST_ASSERT_EQUAL_MESSAGE(checked || is_text, option->value != NULL, option->name);
        for (size_t k = 0; k < i; k++) {
            bool same = strcmp(option->name, tl_verb_table.options[k].name) == 0;
            TEST_ASSERT_FALSE_MESSAGE(same && (option->verbs & tl_verb_table.options[k].verbs) != 0, option->name);
        }
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_defaults);
    RUN_TEST(test_every_option_sets_its_own);
    RUN_TEST(test_the_lesser_right_counts);
    RUN_TEST(test_tables_and_runs_of_show);
    RUN_TEST(test_since);
    RUN_TEST(test_values_that_are_refused);
    RUN_TEST(test_options_that_need_another);
    RUN_TEST(test_options_that_exclude_each_other);
    RUN_TEST(test_options_without_effect);
    RUN_TEST(test_the_table);
    return UNITY_END();
}
