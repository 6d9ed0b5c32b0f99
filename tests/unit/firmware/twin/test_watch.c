/* The watch: changes are told, not states. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/watch.h"
#include "tests/support/random_numbers.h"
#include "tests/support/stderr_capture.h"

static tl_config_signal signals[2];
static tl_plan_adjust adjust[2];
static tl_config config;
static tl_journal journal;
static tl_watch watch;
static tl_sample sample;
static tl_record record;

void setUp(void) {
    memset(&sample, 0, sizeof sample);
    memset(&record, 0, sizeof record);
    signals[0].plan.name = "torque";
    signals[1].plan.name = "omega";
    config.signals = signals;
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

/* What was told since the last time. */
static void expect_told(const char *expected) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_journal_drain(&journal);
    tl_stderr_expect(expected);
}

/* `text` must be part of the only thing that was told. */
static void expect_told_with(const char *text) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_journal_drain(&journal);
    char *told = tl_stderr_capture_end();
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(told, text), told);
    TEST_ASSERT_EQUAL_PTR(told + strlen(told) - 1, strchr(told, '\n'));
    free(told);
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
        tl_watch_record(&watch, record.step + 2, &record);
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
    delay(TL_DELAY_UNKNOWN, 0);
    expect_told("");
    delay(TL_DELAY_KNOWN, 8 * ms);
    expect_told("twinlock: notice: twin: delay: \316\224o = 8.000 ms measured, and used from now on\n");
    delay(TL_DELAY_KNOWN, 17 * ms); /* less than a step of 10 ms */
    expect_told("");
    delay(TL_DELAY_KNOWN, 19 * ms);
    expect_told("twinlock: warning: twin: delay: \316\224o has drifted from 8.000 ms to 19.000 ms\n");
    delay(TL_DELAY_KNOWN, 8 * ms);
    expect_told_with("has drifted from 19.000 ms to 8.000 ms");
    delay(TL_DELAY_LOST, 8 * ms);
    expect_told("twinlock: warning: twin: delay: what is measured is not sure any more; \316\224o = 8.000 ms stays in "
                "use\n");
    delay(TL_DELAY_KNOWN, 9 * ms);
    expect_told("twinlock: notice: twin: delay: \316\224o = 9.000 ms is measured surely again\n");
}

/* What is measured is what is left of Δo where inputs are shifted. */
static void test_a_delay_is_told_with_that_of_the_inputs(void) {
    const tl_config_delays delays = {.has_input = true, .input.delay = 5 * TL_SECOND / 1000, .measure = true};
    config.delays = &delays;
    delay(TL_DELAY_KNOWN, TL_SECOND / 1000);
    config.delays = NULL;
    expect_told_with("\316\224o = 6.000 ms measured");
}

static void test_good_signals_are_not_worth_a_word(void) {
    see(TL_GOOD, TL_GOOD);
    see(TL_GOOD, TL_GOOD);
    expect_told("");
}

static void test_a_signal_that_goes_bad_and_comes_back(void) {
    see(TL_GOOD, TL_GOOD);
    see(TL_GOOD, TL_STALE);
    see(TL_GOOD, TL_STALE);
    expect_told("twinlock: warning: plant: plant.omega: stale; its last good value is held and takes no part in "
                "matching\n");
    see(TL_GOOD, TL_NO_LINK);
    expect_told_with("plant.omega: no link");
    see(TL_GOOD, TL_NO_LINK);
    expect_told("");
    see(TL_GOOD, TL_GOOD);
    expect_told("twinlock: notice: plant: plant.omega: good again\n");
}

static void test_signals_are_watched_one_by_one(void) {
    see(TL_NOT_A_NUMBER, TL_OUT_OF_RANGE);
    TEST_ASSERT_EQUAL_UINT64(2, journal.head - journal.tail);
    expect_told(
        "twinlock: warning: plant: plant.torque: not a number; its last good value is held and takes no part in "
        "matching\n"
        "twinlock: warning: plant: plant.omega: out of range; its last good value is held and takes no part in "
        "matching\n");
    see(TL_GOOD, TL_OUT_OF_RANGE);
    expect_told("twinlock: notice: plant: plant.torque: good again\n");
}

/* Searches in which these variables were held. */
static void searches(uint32_t held, int count) {
    record.held = held;
    record.stop = TL_STOP_SOLVER;
    records(TL_FIRST_GUESS, count);
    record.held = 0;
    record.stop = TL_STOP_NONE;
}

enum { MINUTE = 6000 }; /* steps */

static const char HELD[] =
    "twinlock: warning: twin: motor.d: the matched outputs do not react to it; held at nominal\n";

static void test_a_variable_that_does_not_matter(void) {
    searches(0, 5);
    expect_told("");
    searches(1, 1);
    expect_told(HELD);
    searches(1, 500);
    expect_told("");
    records(TL_FIRST_GUESS, 2 * MINUTE); /* without a search nothing is known of it */
    records(TL_CAUGHT_UP, 500);
    searches(0, TL_WATCH_STEPS - 1);
    expect_told("");
    searches(0, 1);
    expect_told("twinlock: notice: twin: motor.d: the matched outputs react to it again; steps held: 501\n");
    searches(0, 2 * MINUTE);
    expect_told("");
    searches(1, 1);
    expect_told(HELD);
    searches(0, MINUTE);
    expect_told("twinlock: notice: twin: motor.d: the matched outputs react to it again; steps held: 1\n");
}

/* It comes and goes, for an hour: two lines. */
static void test_a_variable_that_matters_now_and_then(void) {
    for (int i = 0; i < 60; i++) {
        searches(1, 1);
        searches(0, MINUTE - 1);
    }
    expect_told(HELD);
    searches(0, 1);
    expect_told("twinlock: notice: twin: motor.d: the matched outputs react to it again; steps held: 60\n");
}

static void test_variables_are_watched_one_by_one(void) {
    searches(3, 10);
    expect_told("twinlock: warning: twin: motor.d: the matched outputs do not react to it; held at nominal\n"
                "twinlock: warning: twin: drive.u: the matched outputs do not react to it; held at nominal\n");
    searches(1, MINUTE);
    expect_told("twinlock: notice: twin: drive.u: the matched outputs react to it again; steps held: 10\n");
}

/* Searches with these flags. */
static void flagged(uint32_t flags, int count) {
    record.flags = flags;
    searches(0, count);
    record.flags = 0;
}

static void test_the_second_solver(void) {
    flagged(0, 10);
    expect_told("");
    flagged(TL_FLAG_FALLBACK, 3);
    expect_told("twinlock: warning: twin: the solver finds no more; the second one, bobyqa, takes over\n");
    flagged(0, 100);
    flagged(TL_FLAG_FALLBACK, 100);
    flagged(0, MINUTE - 1);
    expect_told("");
    flagged(0, 1);
    expect_told(
        "twinlock: notice: twin: the solver does without the second one, bobyqa, again; searches it took over: 103\n");
    flagged(0, 2 * MINUTE);
    expect_told("");
}

static void test_stagnation_is_told_apart(void) {
    flagged(TL_FLAG_STAGNATED, 2);
    expect_told("twinlock: warning: twin: a search made no progress and was ended\n");
    flagged(TL_FLAG_STAGNATED | TL_FLAG_FALLBACK, 3);
    expect_told("twinlock: warning: twin: the solver finds no more; the second one, bobyqa, takes over\n");
    flagged(TL_FLAG_FALLBACK, MINUTE);
    expect_told("twinlock: notice: twin: searches make progress again; ended before: 5\n");
    flagged(TL_FLAG_WITHOUT_NOMINAL, MINUTE - 1); /* not worth a word */
    expect_told("");
}

/* With a macro step that is longer than the rest, it is searches that count. */
static void test_troubles_of_a_slow_twin(void) {
    config.step = 3600 * TL_SECOND;
    searches(1, 1);
    expect_told(HELD);
    searches(0, TL_WATCH_STEPS - 1);
    expect_told("");
    searches(0, 1);
    expect_told_with("react to it again");
}

static void test_an_fmu_that_does_not_come_back_is_told_once(void) {
    records(TL_FIRST_GUESS, 3);
    record.flags = TL_FLAG_DIFFERED;
    records(TL_FIRST_GUESS, 5);
    expect_told("twinlock: warning: twin: an FMU does not come back to where it was\n");
    record.flags = 0;
    records(TL_FIRST_GUESS, 1);
    expect_told("");
    record.flags = TL_FLAG_DIFFERED;
    records(TL_FIRST_GUESS, 1);
    expect_told("twinlock: warning: twin: an FMU does not come back to where it was\n");
}

static void test_free_running(void) {
    records(TL_OPTIMISED, 3);
    expect_told("");
    records(TL_FREE_RUN, 5);
    expect_told_with("the twin runs free on the last good values");
    records(TL_CAUGHT_UP, 2); /* a missed tick tells nothing of the measurements */
    expect_told("");
    records(TL_FIRST_GUESS, 5);
    expect_told_with("synchronising again");
}

/* A lost twin is what somebody must do something about. */
static void test_the_state_of_the_lock(void) {
    static const struct {
        tl_lock_state state;
        const char *told;
    } cases[] = {
        {TL_LOCK_FREE, "twinlock: warning: lock: free: why\n"},
        {TL_LOCK_LOCKED, "twinlock: notice: lock: locked: why\n"},
        {TL_LOCK_TRACKING, "twinlock: warning: lock: tracking: why\n"},
        {TL_LOCK_DEGRADED, "twinlock: warning: lock: degraded: why\n"},
        {TL_LOCK_LOST, "twinlock: error: lock: lost: why\n"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const tl_lock_change change = {.to = cases[i].state, .cause = "why"};
        tl_watch_lock(&watch, 5, &change);
        expect_told(cases[i].told);
    }
}

static void test_missed_ticks_are_told_once_a_second(void) {
    tl_watch_skipped(&watch, 10, 3, 5 * TL_SECOND);
    expect_told("twinlock: warning: cycle: 3 ticks missed and made up without a search\n");
    tl_watch_skipped(&watch, 20, 1, 5 * TL_SECOND + TL_SECOND / 2);
    tl_watch_skipped(&watch, 30, 2, 6 * TL_SECOND - 1);
    expect_told("");
    tl_watch_skipped(&watch, 31, 0, 6 * TL_SECOND);
    expect_told("twinlock: warning: cycle: 3 ticks missed and made up without a search\n");
    tl_watch_skipped(&watch, 1000, 0, 20 * TL_SECOND);
    expect_told("");
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

static void test_strokes_are_told_where_they_change_something(void) {
    config.event.start.signal = "plant.move";
    config.adjust_count = 1;
    record.u[0] = 0.01;
    record.nominal[0] = 0.01;
    stroke(TL_FIRST_GUESS, 0.01, 0.0, 0);
    expect_told("");
    stroke(TL_OPTIMISED, 0.0231, 0.0, 7);
    expect_told("twinlock: notice: twin: stroke: motor.d from 0.01 to 0.0231 (optimised, J = 0, 8 evaluations)\n");
    stroke(TL_FIRST_GUESS, 0.0231, 0.0, 0);
    expect_told("");
    stroke(TL_NOMINAL, 0.01, 9.0, 20);
    expect_told("twinlock: warning: twin: stroke: motor.d from 0.0231 to 0.01 (nominal, J = 9, 21 evaluations)\n");
    stroke(TL_NOMINAL, 0.01, 9.0, 20);
    expect_told("");
    stroke(TL_FIRST_GUESS, 0.01, 0.0, 0);
    expect_told("twinlock: notice: twin: stroke: within tolerance again with motor.d at 0.01 (J = 0)\n");
    stroke(TL_BEST_SO_FAR, 0.01, 2.0, 20);
    expect_told("twinlock: warning: twin: stroke: out of tolerance with motor.d at 0.01 (J = 2)\n");
    record.flags = TL_FLAG_ABANDONED;
    records(TL_HELD, 1);
    expect_told_with("stroke: not searched to its end");
    records(TL_HELD, 5);
    expect_told("");
    record.u[0] = 0.02;
    records(TL_HELD, 1);
    expect_told("twinlock: notice: twin: stroke: motor.d from 0.01 to 0.02, the best so far\n");
    record.flags = 0;
    stroke(TL_BEST_SO_FAR, 0.02, 2.0, 20);
    expect_told_with("stroke: searched again; strokes that were not: 7");
    config.event.start.signal = NULL;
}

/* What was in force before is no more: nominal is, and that is not the best of a search. */
static void test_a_stroke_that_a_reset_gave_up(void) {
    config.event.start.signal = "plant.move";
    config.adjust_count = 1;
    record.u[0] = 0.01;
    record.nominal[0] = 0.01;
    stroke(TL_OPTIMISED, 0.0231, 0.0, 7);
    expect_told_with("stroke: motor.d from 0.01 to 0.0231");
    record.u[0] = 0.01;
    record.flags = TL_FLAG_RESET | TL_FLAG_ABANDONED;
    records(TL_HELD, 1);
    expect_told("twinlock: warning: twin: stroke: not searched to its end; the FMUs began anew\n");
    record.flags = 0;
    stroke(TL_OPTIMISED, 0.02, 0.0, 3);
    expect_told_with("stroke: motor.d from 0.01 to 0.02");
    record.u[0] = 0.01;
    record.flags = TL_FLAG_RESET;
    records(TL_HELD, 1);
    expect_told("");
    record.flags = 0;
    stroke(TL_OPTIMISED, 0.02, 0.0, 3);
    expect_told_with("stroke: motor.d from 0.01 to 0.02");
    config.event.start.signal = NULL;
}

/* A tolerance below three times the noise of the readings, once; see noise.h. */
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
    expect_told_with(
        "twinlock: warning: twin: motor.omega: its tolerance, 0.5, is below three times the noise of its readings, 0.");
    match.tolerance = 3.0;
    for (int i = 0; i < 3000; i++) {
        sample.values[1] = tl_test_noise(&seed);
        sample.stamps[1] += TL_SECOND / 50;
        see(TL_GOOD, TL_GOOD);
    }
    expect_told_with("motor.omega: its tolerance, 3, is three times the noise of its readings again");
    config.match_count = 0;
    config.synchronise = false;
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_delay_that_is_measured_drifts_and_is_lost);
    RUN_TEST(test_a_delay_is_told_with_that_of_the_inputs);
    RUN_TEST(test_good_signals_are_not_worth_a_word);
    RUN_TEST(test_a_signal_that_goes_bad_and_comes_back);
    RUN_TEST(test_signals_are_watched_one_by_one);
    RUN_TEST(test_a_variable_that_does_not_matter);
    RUN_TEST(test_a_variable_that_matters_now_and_then);
    RUN_TEST(test_variables_are_watched_one_by_one);
    RUN_TEST(test_the_second_solver);
    RUN_TEST(test_stagnation_is_told_apart);
    RUN_TEST(test_troubles_of_a_slow_twin);
    RUN_TEST(test_an_fmu_that_does_not_come_back_is_told_once);
    RUN_TEST(test_free_running);
    RUN_TEST(test_the_state_of_the_lock);
    RUN_TEST(test_missed_ticks_are_told_once_a_second);
    RUN_TEST(test_strokes_are_told_where_they_change_something);
    RUN_TEST(test_a_stroke_that_a_reset_gave_up);
    RUN_TEST(test_a_tolerance_within_the_noise);
    return UNITY_END();
}
