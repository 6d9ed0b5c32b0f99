/* The watch reports changes, not states. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/report/watch.h"
#include "tests/support/message.h"
#include "tests/support/random_numbers.h"
#include "tests/support/stderr_capture.h"

static tl_config_signal signals[2];
static tl_config_source source = {.name = "plc"};
static tl_plan_adjust adjust[2];
static tl_config config;
static tl_journal journal;
static tl_watch watch;
static tl_sample sample;
static tl_record record;
static tl_twin_identifiability identifiability;

void setUp(void) {
    memset(&sample, 0, sizeof sample);
    memset(&record, 0, sizeof record);
    identifiability = (tl_twin_identifiability){.alike = 0};
    signals[0].plan.name = "torque";
    signals[0].feeds = true;
    signals[1].plan.name = "omega";
    config.signals = signals;
    config.sources = &source;
    config.signal_count = 2;
    adjust[0].variable = "motor.d";
    adjust[1].variable = "drive.u";
    config.adjust = adjust;
    config.adjust_count = 2;
    config.step = TL_SECOND / 100;
    config.fallback = "bobyqa";
    tl_journal_init(&journal, NULL);
    tl_watch_init(&watch, &config, &journal);
}

void tearDown(void) {}

/* Returns the lines logged since the last call; there must be `count` of them. The caller frees
 * them. */
static char *told_lines(size_t count) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_journal_drain(&journal);
    memset(&journal.repeats, 0, sizeof journal.repeats); /* no line counts as repeated */
    char *was_reported = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL(was_reported);
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, tl_test_count_lines(was_reported), was_reported);
    return was_reported;
}

static void expect_nothing(void) {
    char *was_reported = told_lines(0);
    TEST_ASSERT_EQUAL_STRING("", was_reported);
    free(was_reported);
}

/* One line with these parts was logged since the last call. */
static void expect_told(const char *parts) {
    char *was_reported = told_lines(1);
    TL_EXPECT_PARTS(parts, was_reported);
    free(was_reported);
}

/* The same with two lines. */
static void expect_two_told(const char *first_parts, const char *second_parts) {
    char *was_reported = told_lines(2);
    char *second = strchr(was_reported, '\n') + 1;
    second[-1] = '\0';
    TL_EXPECT_PARTS(first_parts, was_reported);
    TL_EXPECT_PARTS(second_parts, second);
    free(was_reported);
}

/* One line, which names the value `from` before the value `to`. */
static void expect_told_change(const char *parts, const char *from, const char *to) {
    char *was_reported = told_lines(1);
    TL_EXPECT_PARTS(parts, was_reported);
    TL_EXPECT_PARTS(from, was_reported);
    TL_EXPECT_PARTS(to, was_reported);
    TEST_ASSERT_TRUE_MESSAGE(strstr(was_reported, from) < strstr(was_reported, to), was_reported);
    free(was_reported);
}

static void see(tl_quality torque, tl_quality omega) {
    sample.quality[0] = (uint8_t)torque;
    sample.quality[1] = (uint8_t)omega;
    tl_watch_sample(&watch, &sample);
    sample.tick++;
}

static void records(tl_outcome outcome, int count) {
    for (int i = 0; i < count; i++) {
        record.outcome = outcome;
        tl_watch_record(&watch, record.step + 2, &record, &identifiability);
        record.step++;
    }
}

/* ---- a measured delay ---- */

static void delay(tl_delay_state state, tl_time value) {
    record.delay_state = state;
    record.delay = value;
    records(TL_FREE, 3);
}

static void test_a_delay_that_is_measured_drifts_and_is_lost(void) {
    const tl_time ms = TL_SECOND / 1000;
    const tl_config_delays delays = {.measure = true};
    config.delays = &delays;
    delay(TL_DELAY_UNKNOWN, 0);
    expect_nothing();
    delay(TL_DELAY_KNOWN, 8 * ms);
    expect_told("notice|twin|delay|\316\224o|8.000 ms");
    delay(TL_DELAY_KNOWN, 17 * ms); /* less than a step of 10 ms */
    expect_nothing();
    delay(TL_DELAY_KNOWN, 19 * ms);
    expect_told_change("warning|twin|delay|\316\224o", "8.000 ms", "19.000 ms");
    delay(TL_DELAY_KNOWN, 8 * ms);
    expect_told_change("warning|twin|delay|\316\224o", "19.000 ms", "8.000 ms");
    delay(TL_DELAY_LOST, 8 * ms);
    expect_told("warning|twin|delay|\316\224o|8.000 ms");
    delay(TL_DELAY_KNOWN, 9 * ms);
    expect_told("notice|twin|delay|\316\224o|9.000 ms");
    config.delays = NULL;
}

/* Only more than three steps of 10 ms are reported. */
static void test_a_delay_that_is_not_used_moves_far(void) {
    const tl_time ms = TL_SECOND / 1000;
    delay(TL_DELAY_KNOWN, 80 * ms);
    delay(TL_DELAY_KNOWN, 50 * ms);
    delay(TL_DELAY_LOST, 10 * ms);
    expect_nothing();
    delay(TL_DELAY_KNOWN, 49 * ms);
    expect_told("warning|twin|delay|31 ms later|clock|measure");
    delay(TL_DELAY_KNOWN, 79 * ms);
    expect_nothing();
    delay(TL_DELAY_KNOWN, 80 * ms);
    expect_told("warning|twin|delay|31 ms earlier");
}

/* If inputs are shifted, Δo is the measured rest plus that shift. */
static void test_a_delay_is_told_with_that_of_the_inputs(void) {
    const tl_config_delays delays = {.has_input = true, .input.delay = 5 * TL_SECOND / 1000, .measure = true};
    config.delays = &delays;
    delay(TL_DELAY_KNOWN, TL_SECOND / 1000);
    config.delays = NULL;
    expect_told("notice|\316\224o|6.000 ms");
}

/* ---- outliers ---- */

static void see_reading(double value, tl_quality quality) {
    sample.values[1] = value;
    sample.stamps[1] += TL_SECOND / 100;
    see(TL_GOOD, quality);
}

static void show_readings(tl_condition condition) {
    sample.stamps[1] = 0;
    signals[1].is_reading = true;
    signals[1].of = 1;
    signals[1].shows = 1;
    signals[1].condition = condition;
}

/* Without a gate, the next good reading decides. */
static void test_outliers_are_told_with_value_expected_and_count(void) {
    show_readings((tl_condition){.leap = 6});
    see_reading(50, TL_GOOD);
    see_reading(90, TL_OUTLIER);
    expect_nothing();
    see_reading(51, TL_GOOD);
    expect_told("warning|plant.omega|90|50|1 so far|keep");
    see_reading(20, TL_OUTLIER);
    see_reading(70, TL_OUTLIER);
    see_reading(52, TL_GOOD);
    expect_two_told("warning|plant.omega|20|51|2 so far", "warning|plant.omega|70|51|3 so far");
    for (int i = 0; i < 20; i++) {
        see_reading(99, TL_OUTLIER);
        see_reading(52, TL_GOOD);
        free(told_lines(i < TL_WATCH_REJECTED - 3 ? 1 : 0));
    }
    sample.tick += 6100;
    see_reading(98, TL_OUTLIER);
    see_reading(52, TL_GOOD);
    expect_two_told("13 more|minute", "98|52|24 so far");
    memset(&signals[1], 0, sizeof signals[1]);
}

static void test_a_step_is_not_told_as_an_outlier(void) {
    show_readings((tl_condition){.leap = 6});
    see_reading(50, TL_GOOD);
    see_reading(90, TL_OUTLIER);
    see_reading(89, TL_GOOD);
    see_reading(150, TL_OUTLIER);
    see_reading(300, TL_OUTLIER);
    see_reading(450, TL_GOOD);
    see_reading(449, TL_GOOD);
    expect_nothing();
    memset(&signals[1], 0, sizeof signals[1]);
}

static void test_an_outlier_before_the_first_good_reading_is_not_told(void) {
    show_readings((tl_condition){.leap = 6});
    see_reading(90, TL_OUTLIER);
    see_reading(50, TL_GOOD);
    expect_nothing();
    see_reading(90, TL_OUTLIER);
    see_reading(50, TL_GOOD);
    expect_told("warning|plant.omega|90|50|1 so far");
    memset(&signals[1], 0, sizeof signals[1]);
}

static void test_good_signals_are_not_reported(void) {
    see(TL_GOOD, TL_GOOD);
    see(TL_GOOD, TL_GOOD);
    expect_nothing();
}

static void test_a_signal_that_goes_bad_and_comes_back(void) {
    see(TL_GOOD, TL_GOOD);
    see(TL_GOOD, TL_STALE);
    see(TL_GOOD, TL_STALE);
    expect_told("warning|plant.omega|stale_s");
    see(TL_GOOD, TL_NO_LINK);
    expect_told("warning|plant.omega|plc|source");
    see(TL_GOOD, TL_NO_LINK);
    expect_nothing();
    see(TL_GOOD, TL_GOOD);
    expect_told("notice|plant.omega|good");
}

static void test_signals_are_watched_one_by_one(void) {
    see(TL_NOT_A_NUMBER, TL_OUT_OF_RANGE);
    TEST_ASSERT_EQUAL_UINT64(2, journal.head - journal.tail);
    expect_two_told("warning|plant.torque|not a number|initial value", "warning|plant.omega|out of range|scale");
    see(TL_GOOD, TL_OUT_OF_RANGE);
    expect_told("notice|plant.torque|good");
}

/* Searches with these variables held at nominal. */
static void searches(uint32_t held, int count) {
    record.held = held;
    record.stop = TL_STOP_SOLVER;
    records(TL_FIRST_GUESS, count);
    record.held = 0;
    record.stop = TL_STOP_NONE;
}

enum { MINUTE = 6000 }; /* steps */

static const char HELD[] = "warning|twin|motor.d|do not react|match an output|horizon.prediction";

static void test_a_variable_that_does_not_matter(void) {
    searches(0, 5);
    expect_nothing();
    searches(1, 1);
    expect_told(HELD);
    searches(1, 500);
    expect_nothing();
    records(TL_FIRST_GUESS, 2 * MINUTE); /* only searches count */
    records(TL_CAUGHT_UP, 500);
    searches(0, TL_WATCH_STEPS - 1);
    expect_nothing();
    searches(0, 1);
    expect_told("notice|twin|motor.d|501");
    searches(0, 2 * MINUTE);
    expect_nothing();
    searches(1, 1);
    expect_told("notice|twin|motor.d|do not react"); /* within an hour */
    searches(0, MINUTE);
    expect_told("notice|twin|motor.d|1");
}

/* A condition that comes and goes for an hour is two lines. */
static void test_a_variable_that_matters_now_and_then(void) {
    for (int i = 0; i < 60; i++) {
        searches(1, 1);
        searches(0, MINUTE - 1);
    }
    expect_told(HELD);
    searches(0, 1);
    expect_told("notice|twin|motor.d|60");
}

static void test_variables_are_watched_one_by_one(void) {
    searches(3, 10);
    expect_two_told(HELD, "warning|twin|drive.u|do not react");
    searches(1, MINUTE);
    expect_told("notice|twin|drive.u|10");
}

/* The twin finds it with solvers that hold nothing, and also in steps without a search. */
static void test_a_variable_without_effect(void) {
    identifiability.unseen = 1;
    records(TL_FIRST_GUESS, 10);
    expect_told(HELD);
    identifiability.unseen = 0;
    searches(0, MINUTE);
    expect_told("notice|twin|motor.d|react|10");
}

static void test_variables_that_act_alike(void) {
    identifiability = (tl_twin_identifiability){.alike = 3, .since = 250};
    searches(0, 100);
    expect_told(
        "warning|lock|since t = 2.5 s|motor.d and drive.u|one correction|output|adjust only one|horizon.prediction");
    identifiability.alike = 0;
    searches(0, MINUTE - 1);
    expect_nothing();
    searches(0, 1);
    expect_told("notice|lock|alike|100");
    identifiability.alike = UINT32_MAX - 3; /* no such variables */
    searches(0, 10);
    expect_nothing();
}

/* Searches with these flags. */
static void flagged(uint32_t flags, int count) {
    record.flags = flags;
    searches(0, count);
    record.flags = 0;
}

static void test_the_second_solver(void) {
    flagged(0, 10);
    expect_nothing();
    flagged(TL_FLAG_FALLBACK, 3);
    expect_told("warning|twin|bobyqa");
    flagged(0, 100);
    flagged(TL_FLAG_FALLBACK, 100);
    flagged(0, MINUTE - 1);
    expect_nothing();
    flagged(0, 1);
    expect_told("notice|twin|bobyqa|103");
    flagged(0, 2 * MINUTE);
    expect_nothing();
}

static void test_stagnation_is_reported_separately(void) {
    flagged(TL_FLAG_STAGNATED, 2);
    expect_told("warning|twin|progress");
    flagged(TL_FLAG_STAGNATED | TL_FLAG_FALLBACK, 3);
    expect_told("warning|twin|bobyqa");
    flagged(TL_FLAG_FALLBACK, MINUTE);
    expect_told("notice|twin|progress|5");
    flagged(TL_FLAG_WITHOUT_NOMINAL, MINUTE - 1); /* not reported */
    expect_nothing();
}

/* The first one, with the value; the record of another process may name anything. */
static void test_a_refused_trial_is_reported_once(void) {
    static tl_config_component components[] = {{.name = "motor"}};
    static tl_plan_match match[] = {{.variable = "motor.y"}};
    config.components = components;
    config.component_count = 1;
    record.refused = (tl_record_refused){.count = 2, .index = 1, .variable = 0, .u = 6.5};
    searches(0, 1);
    record.refused.index = 0;
    record.refused.variable = 2;
    searches(0, 1);
    expect_nothing();
    record.refused.variable = 0;
    searches(0, 2);
    expect_told("warning|twin|motor: |failed|motor.d = 6.5|max|motor.d");
    tl_watch_init(&watch, &config, &journal);
    config.match = match;
    config.match_count = 1;
    record.refused = (tl_record_refused){.count = 1, .by_output = 1, .index = 0, .variable = 1, .u = -6.5};
    searches(0, 1);
    expect_told("warning|twin|motor.y: |finite|drive.u = -6.5|min|drive.u");
    config.match_count = 0;
    config.component_count = 0;
}

/* Each output once, by its name, though it is matched and connected; its end a minute later. */
static void test_outputs_that_are_not_finite(void) {
    static tl_plan_match match[] = {{.variable = "motor.y"}};
    static tl_plan_connection connections[] = {{.from = "motor.y", .to = "drive.u"},
                                               {.from = "drive.y", .to = "motor.u"}};
    config.match = match;
    config.match_count = 1;
    config.connections = connections;
    config.connection_count = 2;
    record.step = 200;
    record.bad_outputs = 3;
    searches(0, 1);
    expect_told("warning|twin|motor.y: |finite|2 s|2.01 s|last value");
    record.bad_outputs = 7;
    searches(0, 1);
    expect_told("warning|twin|drive.y: |finite|2.01 s|2.02 s");
    record.bad_outputs = UINT64_MAX;
    searches(0, 8);
    expect_nothing();
    record.bad_outputs = 0;
    record.flags = TL_FLAG_RESET;
    searches(0, 1);
    expect_told("warning|lock|reset|step 210|finite|10 steps");
    record.flags = 0;
    searches(0, MINUTE - 2);
    expect_nothing();
    searches(0, 1);
    expect_two_told("notice|twin|motor.y: |10", "notice|twin|drive.y: |9");
    config.match_count = 0;
    config.connection_count = 0;
}

/* If a step is longer than TL_WATCH_REST, the number of searches counts. */
static void test_troubles_of_a_slow_twin(void) {
    config.step = 3600 * TL_SECOND;
    searches(1, 1);
    expect_told(HELD);
    searches(0, TL_WATCH_STEPS - 1);
    expect_nothing();
    searches(0, 1);
    expect_told("notice|twin|motor.d|1");
}

static void test_an_inexact_rollback_is_reported_once(void) {
    records(TL_FIRST_GUESS, 3);
    record.flags = TL_FLAG_DIFFERED;
    records(TL_FIRST_GUESS, 5);
    expect_told("warning|twin|FMU");
    record.flags = 0;
    records(TL_FIRST_GUESS, 1);
    expect_nothing();
    record.flags = TL_FLAG_DIFFERED;
    records(TL_FIRST_GUESS, 1);
    expect_told("warning|twin|FMU");
}

static void test_free_running(void) {
    records(TL_OPTIMISED, 3);
    expect_nothing();
    records(TL_FREE_RUN, 5);
    expect_told("warning|twin|nominal");
    records(TL_CAUGHT_UP, 2); /* missed ticks do not count */
    expect_nothing();
    records(TL_FIRST_GUESS, 5);
    expect_told("notice|twin|good");
}

/* A lost twin is an error, because the user must act. */
static void test_the_state_of_the_lock(void) {
    static const struct {
        tl_lock_state state;
        const char *was_reported;
    } cases[] = {
        {TL_LOCK_FREE, "warning|lock|free|cause 17"},  {TL_LOCK_LOCKED, "notice|lock|locked|cause 17"},
        {TL_LOCK_CORRECTED, "warning|lock: cause 17"}, {TL_LOCK_DEGRADED, "warning|lock|degraded|cause 17"},
        {TL_LOCK_LOST, "error|lock|lost|cause 17"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const tl_lock_change change = {.to = cases[i].state, .cause = "cause 17"};
        tl_watch_lock(&watch, 5, &change);
        expect_told(cases[i].was_reported);
    }
}

static void lock_change(int64_t tick, tl_lock_state to, bool is_update) {
    tl_lock_change change = {.to = to, .is_update = is_update};
    (void)snprintf(change.cause, sizeof change.cause, "cause %lld", (long long)tick);
    tl_watch_lock(&watch, tick, &change);
}

/* Within an hour a cause is a notice. While it returns, the hour doubles, up to a day; after a quiet
 * time it is an hour again. */
static void test_repeated_warnings(void) {
    enum { HOUR = 360000 };
    int warnings = 0;
    lock_change(0, TL_LOCK_CORRECTED, false);
    expect_told("warning|lock|cause 0\n");
    lock_change(1, TL_LOCK_CORRECTED, true);
    expect_told("notice|lock|cause 1\n");
    lock_change(2, TL_LOCK_LOST, false);
    expect_told("error|lost|cause 2\n");
    for (int i = 1; i < 4; i++) {
        lock_change(i * HOUR / 4, TL_LOCK_CORRECTED, false);
        expect_told("notice|lock|cause");
    }
    lock_change(HOUR, TL_LOCK_CORRECTED, false);
    expect_told("warning|lock|cause 360000 (3 more since t = 0 s)\n");
    watch.started = 1000;
    for (int hour = 2; hour < 24; hour++) {
        lock_change((int64_t)hour * HOUR, TL_LOCK_CORRECTED, false);
        char *line = told_lines(1);
        warnings += strstr(line, "warning") != NULL ? 1 : 0;
        if (hour == 7) {
            TL_EXPECT_PARTS("warning|(3 more since 03:00:01 UTC)", line);
        }
        free(line);
    }
    TEST_ASSERT_EQUAL_INT(3, warnings); /* after 3, 7 and 15 hours */
    lock_change(200 * HOUR, TL_LOCK_CORRECTED, false);
    expect_told("warning|8 more since");
    lock_change(201 * HOUR, TL_LOCK_CORRECTED, false);
    expect_told("warning|cause 72360000\n");
}

/* The pause of an error stays an hour: a person has to act. */
static void test_repeated_errors(void) {
    enum { HOUR = 360000 };
    for (int i = 0; i < 10; i++) {
        lock_change(i * HOUR, TL_LOCK_LOST, false);
        expect_told("error|lock|lost");
        lock_change(i * HOUR + 100, TL_LOCK_LOST, false);
        expect_told("notice|lock|lost");
    }
}

/* A long text loses its end, not the count. */
static void test_the_count_after_a_long_text(void) {
    static tl_lock_change change = {.to = TL_LOCK_CORRECTED};
    memset(change.cause, 'x', sizeof change.cause - 1);
    for (int64_t tick = 0; tick <= 360000; tick += 180000) {
        tl_watch_lock(&watch, tick, &change);
    }
    char *lines = told_lines(3);
    TEST_ASSERT_NOT_NULL(strstr(lines, "x (1 more since t = 0 s)\n"));
    free(lines);
}

static void test_missed_ticks_are_told_once_a_second(void) {
    tl_watch_skipped(&watch, 10, 3, 5 * TL_SECOND);
    expect_told("warning|cycle|3 ticks");
    tl_watch_skipped(&watch, 20, 1, 5 * TL_SECOND + TL_SECOND / 2);
    tl_watch_skipped(&watch, 30, 2, 6 * TL_SECOND - 1);
    expect_nothing();
    tl_watch_skipped(&watch, 31, 0, 6 * TL_SECOND);
    expect_told("warning|cycle|3 ticks");
    tl_watch_skipped(&watch, 1000, 0, 20 * TL_SECOND);
    expect_nothing();
}

static void stroke(tl_outcome outcome, double u, double objective, uint32_t evaluations) {
    records(TL_HELD, 3);
    record.outcome = TL_SEARCHING;
    record.evaluations = evaluations;
    records(TL_SEARCHING, 1);
    record.evaluations = 1;
    record.u[0] = u;
    record.objective = objective;
    records(outcome, 1);
    record.evaluations = 0;
    record.objective = (double)NAN;
}

static void test_strokes_are_reported_if_they_change_something(void) {
    config.event.start.signal = "plant.move";
    config.adjust_count = 1;
    record.u[0] = 0.01;
    record.nominal[0] = 0.01;
    stroke(TL_FIRST_GUESS, 0.01, 0.0, 0);
    expect_nothing();
    stroke(TL_OPTIMISED, 0.0231, 0.0, 7);
    expect_told_change("notice|twin|stroke|motor.d|optimised|J = 0|8 evaluations", "0.01", "0.0231");
    stroke(TL_FIRST_GUESS, 0.0231, 0.0, 0);
    expect_nothing();
    stroke(TL_NOMINAL, 0.01, 9.0, 20);
    expect_told_change("warning|twin|stroke|motor.d|nominal|J = 9|21 evaluations", "0.0231", "0.01");
    stroke(TL_NOMINAL, 0.01, 9.0, 20);
    expect_nothing();
    stroke(TL_FIRST_GUESS, 0.01, 0.0, 0);
    expect_told("notice|twin|stroke|tolerance|motor.d|0.01|J = 0");
    stroke(TL_BEST_SO_FAR, 0.01, 2.0, 20);
    expect_told("notice|twin|stroke|tolerance|motor.d|0.01|J = 2"); /* within an hour */
    record.flags = TL_FLAG_ABANDONED;
    records(TL_HELD, 1);
    expect_told("warning|twin|stroke|gap");
    records(TL_HELD, 5);
    expect_nothing();
    record.u[0] = 0.02;
    records(TL_HELD, 1);
    expect_told_change("notice|twin|stroke|motor.d|best", "0.01", "0.02");
    record.flags = 0;
    stroke(TL_BEST_SO_FAR, 0.02, 2.0, 20);
    expect_told("notice|twin|stroke|7");
    config.event.start.signal = NULL;
}

/* After a reset u is nominal, which is not reported as the best of a search. */
static void test_a_stroke_that_a_reset_ends(void) {
    config.event.start.signal = "plant.move";
    config.adjust_count = 1;
    record.u[0] = 0.01;
    record.nominal[0] = 0.01;
    stroke(TL_OPTIMISED, 0.0231, 0.0, 7);
    expect_told_change("stroke|motor.d", "0.01", "0.0231");
    record.u[0] = 0.01;
    record.flags = TL_FLAG_RESET | TL_FLAG_ABANDONED;
    records(TL_HELD, 1);
    expect_told("warning|twin|stroke|FMUs");
    record.flags = 0;
    stroke(TL_OPTIMISED, 0.02, 0.0, 3);
    expect_told_change("stroke|motor.d", "0.01", "0.02");
    record.u[0] = 0.01;
    record.flags = TL_FLAG_RESET;
    records(TL_HELD, 1);
    expect_nothing();
    record.flags = 0;
    stroke(TL_OPTIMISED, 0.02, 0.0, 3);
    expect_told_change("stroke|motor.d", "0.01", "0.02");
    config.event.start.signal = NULL;
}

/* A tolerance below three times the noise of the readings is reported once; see noise.h. */
static void test_a_tolerance_within_the_noise(void) {
    static tl_plan_match match = {.variable = "motor.omega", .to = "plant.omega", .tolerance = 0.5, .weight = 1.0};
    const char *matched_as[] = {"plant.omega"};
    const char *reading_as[] = {NULL};
    uint32_t seed = 1;
    config.match = &match;
    config.match_count = 1;
    config.matched_as = matched_as;
    config.reading_as = reading_as;
    config.synchronise = true;
    tl_watch_init(&watch, &config, &journal);
    for (int i = 0; i < 3000; i++) {
        sample.values[1] = tl_test_noise(&seed);
        sample.stamps[1] += TL_SECOND / 50;
        see(TL_GOOD, TL_GOOD);
    }
    expect_told("warning|twin|motor.omega|tolerance|0.5|noise");
    match.tolerance = 3.0;
    for (int i = 0; i < 3000; i++) {
        sample.values[1] = tl_test_noise(&seed);
        sample.stamps[1] += TL_SECOND / 50;
        see(TL_GOOD, TL_GOOD);
    }
    expect_told("notice|twin|motor.omega|tolerance|3|noise");
    config.match_count = 0;
    config.synchronise = false;
}

/* The choice of "keep": "auto" is reported once; with long names in several events. All are read
 * again. */
static void test_what_is_kept(void) {
    enum { COMPONENTS = TL_TWIN_UNSAVED + 2, LONGEST = 64 };
    static char names[COMPONENTS][LONGEST];
    static tl_config_component components[COMPONENTS];
    const uint64_t unsaved = UINT64_C(0x8000000000000aaa);
    uint64_t found = 0;
    config.components = components;
    config.component_count = COMPONENTS;
    for (int i = 0; i < COMPONENTS; i++) {
        (void)snprintf(names[i], LONGEST, "%c%062d", 'a' + i % 2, i);
        components[i] = (tl_config_component){.name = names[i]};
    }
    tl_watch_keep(&watch, 1, unsaved);
    expect_nothing();
    components[2].keep = TL_KEEP_AUTO;
    components[3].keep = TL_KEEP_AUTO;
    tl_watch_init(&watch, &config, &journal);
    tl_watch_keep(&watch, 1, unsaved);
    tl_watch_keep(&watch, 2, unsaved);
    expect_told_change("notice|twin|saving", "states", "none");
    for (int i = 0; i < COMPONENTS; i++) {
        components[i].keep = TL_KEEP_AUTO;
    }
    char text[TL_CONFIG_KEEP_TEXT];
    int events = 0;
    for (size_t next = 0; next < COMPONENTS; events++) {
        next = tl_config_write_keep(&config, unsaved, next, text);
        TEST_ASSERT_TRUE(tl_config_read_keep(&config, text, &found));
    }
    TEST_ASSERT_EQUAL_INT(COMPONENTS / 3, events);
    TEST_ASSERT_EQUAL_HEX64(unsaved, found);
    TEST_ASSERT_FALSE(tl_config_read_keep(&config, "u is searched again", &found));
    config.component_count = 0;
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_delay_that_is_measured_drifts_and_is_lost);
    RUN_TEST(test_a_delay_that_is_not_used_moves_far);
    RUN_TEST(test_a_delay_is_told_with_that_of_the_inputs);
    RUN_TEST(test_outliers_are_told_with_value_expected_and_count);
    RUN_TEST(test_a_step_is_not_told_as_an_outlier);
    RUN_TEST(test_an_outlier_before_the_first_good_reading_is_not_told);
    RUN_TEST(test_good_signals_are_not_reported);
    RUN_TEST(test_a_signal_that_goes_bad_and_comes_back);
    RUN_TEST(test_signals_are_watched_one_by_one);
    RUN_TEST(test_a_variable_that_does_not_matter);
    RUN_TEST(test_a_variable_that_matters_now_and_then);
    RUN_TEST(test_variables_are_watched_one_by_one);
    RUN_TEST(test_a_variable_without_effect);
    RUN_TEST(test_variables_that_act_alike);
    RUN_TEST(test_the_second_solver);
    RUN_TEST(test_stagnation_is_reported_separately);
    RUN_TEST(test_a_refused_trial_is_reported_once);
    RUN_TEST(test_outputs_that_are_not_finite);
    RUN_TEST(test_troubles_of_a_slow_twin);
    RUN_TEST(test_an_inexact_rollback_is_reported_once);
    RUN_TEST(test_free_running);
    RUN_TEST(test_the_state_of_the_lock);
    RUN_TEST(test_repeated_warnings);
    RUN_TEST(test_repeated_errors);
    RUN_TEST(test_the_count_after_a_long_text);
    RUN_TEST(test_missed_ticks_are_told_once_a_second);
    RUN_TEST(test_strokes_are_reported_if_they_change_something);
    RUN_TEST(test_a_stroke_that_a_reset_ends);
    RUN_TEST(test_a_tolerance_within_the_noise);
    RUN_TEST(test_what_is_kept);
    return UNITY_END();
}
