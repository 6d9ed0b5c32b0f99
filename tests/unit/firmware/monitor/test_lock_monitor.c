/* The lock monitor with made-up records: when each state begins, and that no state oscillates. */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/lock_monitor.h"
#include "tests/support/message.h"

enum { WINDOW = 100, PART = 10 }; /* steps of 10 ms */

static const double WITHIN = 0.3;
static const double OUTSIDE = 4;
static const double FAR_AWAY = 1000;

static tl_config_signal signals[2];
static tl_plan_adjust adjust[2];
static tl_plan_match match[2];
static tl_config config;
static tl_account account;
static tl_lock_monitor lock_monitor;
static tl_record record;
static tl_sample sample;
static tl_lock_change was_reported; /* the last change */
static int changes;                 /* since the last look */
static int updates;                 /* of the reason, likewise */

void setUp(void) {
    memset(&record, 0, sizeof record);
    memset(&sample, 0, sizeof sample);
    memset(&config, 0, sizeof config);
    memset(&was_reported, 0, sizeof was_reported);
    changes = 0;
    updates = 0;
    signals[0].plan.name = "torque";
    signals[1].plan.name = "omega";
    adjust[0] = (tl_plan_adjust){.variable = "motor.d"};
    adjust[1].variable = "valve.open";
    match[0] = (tl_plan_match){.variable = "motor.omega", .to = "plant.omega", .tolerance = 2, .weight = 1};
    config.signals = signals;
    config.signal_count = 2;
    config.adjust = adjust;
    config.adjust_count = 2;
    config.match = match;
    config.match_count = 1;
    config.step = TL_SECOND / 100;
    account.match[0] = (tl_account_match){.unit = "rad/s"};
    account.adjust[0] = (tl_account_adjust){.unit = "N.m", .type = TL_REAL, .step = 0.1, .lower = -1, .upper = 2};
    account.adjust[1] = (tl_account_adjust){.type = TL_BOOLEAN};
    tl_lock_monitor_init(&lock_monitor, &config, &account);
}

void tearDown(void) {}

static void step(void) {
    tl_lock_monitor_sample(&lock_monitor, &sample);
    const tl_lock_change *change = tl_lock_monitor_step(&lock_monitor, &record);
    if (change != NULL) {
        was_reported = *change;
        changes += change->is_update ? 0 : 1;
        updates += change->is_update ? 1 : 0;
    }
    record.step++;
}

/* A step with an error of `away` tolerances (of 2). */
static void one(double away) {
    record.y[0] = 2 * away;
    record.objective = away * away;
    record.outcome = away < 1 ? TL_FIRST_GUESS : TL_NOMINAL;
    step();
}

static void many(double away, int count) {
    for (int i = 0; i < count; i++) {
        one(away);
    }
}

/* `of_ten` of ten steps have an error of `away` tolerances. */
static void mixed(int of_ten, double away, int count) {
    for (int i = 0; i < count; i++) {
        one(i % 10 < of_ten ? away : WITHIN);
    }
}

static void lock(void) {
    many(WITHIN, WINDOW);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, was_reported.to);
    changes = 0;
}

/* There was one change, to this state, and its cause has these parts. */
static void expect_change(tl_lock_state state, const char *cause) {
    TEST_ASSERT_EQUAL_INT(1, changes);
    TEST_ASSERT_EQUAL_STRING(tl_lock_state_name(state), tl_lock_state_name(was_reported.to));
    TL_EXPECT_PARTS(cause, was_reported.cause);
    changes = 0;
}

static void expect_no_change(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, changes, was_reported.cause);
}

static tl_lock_tally tally(void) {
    tl_lock_tally found;
    tl_lock_monitor_get(&lock_monitor, &found);
    return found;
}

static uint64_t total(void) {
    tl_lock_tally found = tally();
    return tl_lock_tally_total(&found);
}

/* ---- locked and lost ---- */

static void test_locked_when_a_window_is_full(void) {
    many(WITHIN, WINDOW - 1);
    expect_no_change();
    one(WITHIN);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    many(WITHIN, 10 * WINDOW);
    expect_no_change();
    TEST_ASSERT_EQUAL_UINT64(11 * WINDOW, tally().steps[TL_LOCK_LOCKED]);
    TEST_ASSERT_EQUAL_UINT64(10 * WINDOW / PART + 1, tally().windows);
}

/* A returned change stays valid until the next one. */
static void test_a_returned_change_stays_valid(void) {
    const tl_lock_change *first = NULL;
    record.outcome = TL_FIRST_GUESS;
    for (int i = 0; i < WINDOW; i++) {
        first = tl_lock_monitor_step(&lock_monitor, &record);
    }
    TEST_ASSERT_NOT_NULL(first);
    const tl_lock_change before = *first;
    mixed(2, OUTSIDE, 3 * WINDOW);
    expect_no_change();
    TEST_ASSERT_EQUAL_MEMORY(&before, first, sizeof before);
}

static void test_lost_and_found(void) {
    lock();
    many(OUTSIDE, WINDOW / 2 - 1);
    expect_no_change();
    one(OUTSIDE);
    expect_change(TL_LOCK_LOST, "50 %|100 steps|tolerance");
    TEST_ASSERT_FALSE(lock_monitor.is_astray);
    many(WITHIN, WINDOW + PART);
    expect_change(TL_LOCK_LOCKED, "80 %|100 steps");
    TEST_ASSERT_EQUAL_UINT64(1, tally().losses);
    TEST_ASSERT_EQUAL_UINT64(2, tally().changes);
}

/* If the tolerance is one standard deviation of the noise, a third of the steps is outside. */
static void test_noise_is_no_loss(void) {
    mixed(3, OUTSIDE, 20 * WINDOW);
    expect_change(TL_LOCK_LOCKED, "70 %|100 steps");
}

/* Between the two limits the state does not change. */
static void test_no_oscillation_between_states(void) {
    lock();
    mixed(4, OUTSIDE, 5 * WINDOW);
    expect_no_change();
    mixed(6, OUTSIDE, 5 * WINDOW);
    expect_change(TL_LOCK_LOST, "50 %|100 steps|tolerance");
    mixed(4, OUTSIDE, 5 * WINDOW);
    expect_no_change();
    mixed(2, OUTSIDE, 5 * WINDOW);
    TEST_ASSERT_EQUAL_INT(1, changes);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, was_reported.to);
}

/* Every second step is within tolerance, the others are far off. */
static void test_a_twin_that_swings_is_lost(void) {
    lock();
    for (int i = 0; i < WINDOW / 2; i++) {
        record.u[0] = i % 2 == 0 ? 103 : 0.0031;
        one(i % 2 == 0 ? 1e-11 : FAR_AWAY);
    }
    TEST_ASSERT_EQUAL_INT(1, changes);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, was_reported.to);
    TEST_ASSERT_TRUE(lock_monitor.is_astray);
    TL_EXPECT_PARTS("10 %|100 steps|10 tolerances|1e+03", was_reported.cause);
}

/* With a limit cycle of u the limit is lower, because no search converges. */
static void test_a_limit_cycle(void) {
    lock();
    for (int i = 0; i < 3 * WINDOW; i++) {
        record.u[0] = i % 3 == 0 ? 1.5 : 0.0;
        record.nominal[0] = 0.5;
        one(i % 5 == 0 ? OUTSIDE : WITHIN);
    }
    expect_change(TL_LOCK_LOST, "12 %|100 steps|10 %|motor.d|0|1.5|3 steps");
    record.u[0] = 0.5;
    many(WITHIN, 2 * WINDOW);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, was_reported.to);
}

static void test_what_is_no_limit_cycle(void) {
    uint32_t seed = 1;
    lock();
    for (int i = 0; i < 4 * WINDOW; i++) {
        record.u[0] = i % 2 == 0 ? 0.09 : 0.0; /* less than a first step of the search */
        record.u[1] = i % 2;                   /* a Boolean is ignored */
        one(i % 5 == 0 ? OUTSIDE : WITHIN);
    }
    expect_no_change();
    for (int i = 0; i < 4 * WINDOW; i++) {
        seed = seed * 1103515245U + 12345U;
        record.u[0] = (seed >> 16) % 1000 / 1000.0; /* noise */
        record.nominal[0] = 0.5;
        one(i % 5 == 0 ? OUTSIDE : WITHIN);
    }
    expect_no_change();
}

/* If only the measurement jumps, the twin is lost but not astray. */
static void test_a_plant_that_jumps(void) {
    lock();
    for (int i = 0; i < WINDOW; i++) {
        record.measured[0] = i % 2 == 0 ? 1000 : -1000;
        one(0);
    }
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, was_reported.to);
    TEST_ASSERT_FALSE(lock_monitor.is_astray);
}

/* Astray at first, then exact: the first full window reports a loss, but no reset is due. */
static void test_a_twin_that_has_recovered(void) {
    for (int i = 0; i < 4 * PART; i++) {
        one(i % 2 == 0 ? FAR_AWAY : -FAR_AWAY);
    }
    many(WITHIN, WINDOW - 4 * PART);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, was_reported.to);
    TEST_ASSERT_FALSE(lock_monitor.is_astray);
}

/* An output without a good measurement does not count. */
static void test_what_swings_unmeasured(void) {
    match[1] = (tl_plan_match){.variable = "motor.i", .to = "plant.i", .tolerance = 1, .weight = 1};
    config.match_count = 2;
    lock();
    record.measured_quality[1] = TL_STALE;
    for (int i = 0; i < 2 * WINDOW; i++) {
        record.y[1] = i % 2 == 0 ? FAR_AWAY : -FAR_AWAY;
        one(WITHIN);
    }
    expect_no_change();
    TEST_ASSERT_FALSE(lock_monitor.is_astray);
}

/* A steadily growing error is that of a wrong model, which a reset does not improve. */
static void test_a_twin_that_is_elsewhere(void) {
    lock();
    for (int i = 0; i < 20 * WINDOW; i++) {
        one(9.9 * i);
    }
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, was_reported.to);
    TEST_ASSERT_FALSE(lock_monitor.is_astray);
}

static void test_huge_errors(void) {
    lock();
    many(1e300, 3 * PART);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, was_reported.to);
}

/* One step is enough, both in a full window and in the steps left at the end. It is counted. */
static void test_a_runaway(void) {
    lock();
    one(0.9e9);
    many(WITHIN, PART - 1);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, tally().state);
    TEST_ASSERT_EQUAL_UINT64(0, tally().ran_away);
    one(1.1e9);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, tally().state); /* as if the run ended here */
    expect_no_change();
    many(WITHIN, PART - 1);
    expect_change(TL_LOCK_LOST, "1e+09 tolerances|1|100 steps");
    TEST_ASSERT_EQUAL_UINT64(1, tally().ran_away);
    many(WITHIN, WINDOW);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
}

static void test_an_objective_that_is_not_finite(void) {
    static const struct {
        tl_outcome outcome;
        tl_stop stop;
        uint64_t ran_away;
    } cases[] = {{TL_OPTIMISED, TL_STOP_NONE, 1},
                 {TL_BEST_SO_FAR, TL_STOP_NONE, 1},
                 {TL_BEST_SO_FAR, TL_STOP_TIME, 0},
                 {TL_NOMINAL, TL_STOP_NONE, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        setUp();
        lock();
        record.outcome = cases[i].outcome;
        record.stop = cases[i].stop;
        record.objective = (double)NAN;
        step();
        TEST_ASSERT_EQUAL_UINT64(cases[i].ran_away, tally().ran_away);
    }
}

/* It is not compared, as if its measurement were bad. */
static void test_an_output_that_is_not_finite(void) {
    lock();
    many((double)NAN, PART);
    TEST_ASSERT_EQUAL_UINT64(0, tally().ran_away);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, tally().state);
    expect_no_change();
    many((double)NAN, WINDOW);
    expect_change(TL_LOCK_FREE, "100 steps");
    many(WITHIN, WINDOW);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, tally().state);
    TEST_ASSERT_EQUAL_UINT64(0, tally().losses);
}

static void test_at_a_bound_for_a_minute(void) {
    int reached = 0;
    int left = 0;
    for (int i = 0; i < 20000; i++) {
        record.u[0] = i < 10000 ? 2 : 0.5;
        record.u[1] = 1;
        one(WITHIN);
        reached += lock_monitor.stay[0].turn == TL_BOUND_REACHED ? 1 : 0;
        left += lock_monitor.stay[0].turn == TL_BOUND_LEFT ? 1 : 0;
        TEST_ASSERT_EQUAL_INT(TL_BOUND_AS_BEFORE, lock_monitor.stay[1].turn);
    }
    TEST_ASSERT_EQUAL_INT(1, reached);
    TEST_ASSERT_EQUAL_INT(1, left);
}

static void test_the_objective_of_a_search_does_not_count(void) {
    record.outcome = TL_BEST_SO_FAR;
    record.objective = 40;
    record.y[0] = 1.9;
    for (int i = 0; i < WINDOW; i++) {
        step();
    }
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    record.outcome = TL_CAUGHT_UP;
    record.objective = (double)NAN;
    record.y[0] = -2.1;
    for (int i = 0; i < WINDOW / 2; i++) {
        step();
    }
    expect_change(TL_LOCK_LOST, "50 %|100 steps|tolerance");
}

/* The weighted sum of the squared errors counts. An output without a good measurement does not. */
static void test_several_outputs(void) {
    match[1] = (tl_plan_match){.variable = "motor.i", .to = "plant.i", .tolerance = 1, .weight = 3};
    config.match_count = 2;
    record.outcome = TL_OPTIMISED;
    record.y[0] = 3;   /* 1.5 tolerances, squared 2.25 */
    record.y[1] = 0.7; /* 0.49, three times */
    for (int i = 0; i < WINDOW; i++) {
        step();
    }
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    record.measured_quality[1] = TL_STALE;
    for (int i = 0; i < WINDOW / 2; i++) {
        step();
    }
    expect_change(TL_LOCK_LOST, "50 %|100 steps|tolerance");
}

/* Steps of an earlier run were assessed there. */
static void test_followed_steps_do_not_count(void) {
    record.outcome = TL_RESUMED;
    for (int i = 0; i < 10 * WINDOW; i++) {
        step();
    }
    expect_no_change();
    TEST_ASSERT_EQUAL_UINT64(0, total());
}

/* ---- free ---- */

static void test_no_good_matched_signal(void) {
    lock();
    record.measured_quality[0] = TL_NO_LINK;
    record.objective = (double)NAN;
    record.outcome = TL_FREE_RUN;
    for (int i = 0; i < WINDOW / 2; i++) {
        step();
    }
    expect_change(TL_LOCK_FREE, "signal|50 %|100 steps");
    record.measured_quality[0] = TL_GOOD;
    many(WITHIN, WINDOW);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, was_reported.to);
    TEST_ASSERT_EQUAL_INT(1, changes);
}

static void test_a_signal_that_is_only_compared(void) {
    match[0].weight = 0;
    many(WITHIN, WINDOW);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_FREE, was_reported.to);
}

/* Between two messages a step has no measurement, but the horizon may have some. */
static void test_a_step_between_two_measurements(void) {
    for (int i = 0; i < WINDOW; i++) {
        record.measured_quality[0] = (uint8_t)(i % 3 == 0 ? TL_GOOD : TL_STALE);
        many(WITHIN, 1);
    }
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOCKED, was_reported.to);
    for (int i = 0; i < WINDOW; i++) {
        record.measured_quality[0] = (uint8_t)(i % 3 == 0 ? TL_GOOD : TL_STALE);
        many(3.0, 1); /* the compared steps are out of tolerance */
    }
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, was_reported.to);
    TL_EXPECT_PARTS("tolerance|50 %", was_reported.cause);
    record.measured_quality[0] = TL_STALE;
    many(WITHIN, 2 * WINDOW);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_FREE, was_reported.to); /* no step is compared any more */
}

static void test_nothing_is_adjusted(void) {
    config.adjust_count = 0;
    record.outcome = TL_FREE;
    for (int i = 0; i < WINDOW; i++) {
        step();
    }
    expect_no_change();
    TEST_ASSERT_EQUAL_UINT64(0, total());
}

/* ---- degraded ---- */

static void test_a_signal_of_the_plant_is_bad(void) {
    lock();
    sample.quality[0] = TL_STALE;
    many(WITHIN, WINDOW / 2);
    expect_change(TL_LOCK_DEGRADED, "plant.torque|50 %|100 samples");
    sample.quality[0] = TL_GOOD;
    many(WITHIN, WINDOW / 2);
    expect_no_change();
    many(WITHIN, WINDOW / 2);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
}

/* One such step in a window is enough, because a twin without exact rollback may fit by chance. */
static void test_an_inexact_rollback(void) {
    lock();
    record.flags = TL_FLAG_DIFFERED;
    one(WITHIN);
    record.flags = 0;
    many(WITHIN, WINDOW / 10 - 1);
    expect_change(TL_LOCK_DEGRADED, "FMU|1|100 steps");
    many(WITHIN, WINDOW - WINDOW / 10);
    expect_no_change();
    many(WITHIN, WINDOW / 10);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    record.flags = TL_FLAG_DIFFERED;
    many(WITHIN, 2 * WINDOW);
    TEST_ASSERT_EQUAL_INT(1, changes); /* the state stays */
    record.flags = 0;
}

/* ---- corrected ---- */

/* Steps of a block: a quarter of a release. */
enum { RELEASE = 400, BLOCK = RELEASE / 4, LASTS = 6000 };

/* The released twin is off by `away` tolerances, the twin itself by `own`. Its age allows a
 * comparison. */
static void released(double away, double own, int count) {
    record.release_age = RELEASE / 2;
    record.released[0] = 2 * away;
    many(own, count);
}

static void use_releases(void) {
    config.released_steps = RELEASE;
    tl_lock_monitor_init(&lock_monitor, &config, &account);
}

static void test_a_released_twin_that_leaves_the_plant(void) {
    use_releases();
    released(0.9, WITHIN, WINDOW);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    released(0.9, WITHIN, 10 * BLOCK);
    expect_no_change();
    record.nominal[0] = 0.5;
    record.u[0] = 0.52;
    released(3.1, WITHIN, BLOCK);
    expect_change(TL_LOCK_CORRECTED, "locked, but motor.omega 6.2 rad/s off without corrections since t = 11 s");
    record.u[0] = 0.5;
    released(0.8, WITHIN, 2 * LASTS); /* below the limit to enter it, but not below that to leave it */
    expect_no_change();
    released(0.6, WITHIN, LASTS - PART);
    expect_no_change();
    released(0.6, WITHIN, 2 * BLOCK);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    TEST_ASSERT_TRUE(tally().steps[TL_LOCK_CORRECTED] > 3 * LASTS - 3 * BLOCK);
}

/* A young released twin has not left the twin yet, and one that is missing shows nothing. */
static void test_a_young_released_twin_shows_nothing(void) {
    use_releases();
    record.released[0] = 100;
    for (int i = 0; i < 10 * BLOCK; i++) {
        record.release_age = (uint32_t)(i % BLOCK);
        one(WITHIN);
    }
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    record.release_age = BLOCK;
    many(WITHIN, BLOCK);
    expect_change(TL_LOCK_CORRECTED, "motor.omega 100 rad/s off|t = 10 s");
}

/* A value that is not finite is far off. A measurement that is not good is not compared. */
static void test_a_released_twin_without_a_value(void) {
    use_releases();
    lock();
    released((double)NAN, WITHIN, BLOCK);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_CORRECTED, was_reported.to);
    use_releases();
    record.measured_quality[0] = TL_STALE;
    released(100, WITHIN, BLOCK);
    record.measured_quality[0] = TL_GOOD;
    TEST_ASSERT_FALSE(lock_monitor.release.is_corrected);
}

/* Also without released twins: the mean over 150 steps, and not single corrections. */
static void test_a_standing_correction(void) {
    record.nominal[0] = 0.5;
    for (int i = 0; i < 600; i++) {
        record.u[0] = i % 2 == 0 ? 0.0 : 1.0;
        one(WITHIN);
    }
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    record.u[0] = 0.5 - 0.11;
    many(WITHIN, 150);
    expect_change(TL_LOCK_CORRECTED, "locked, corrected: motor.d -0.11 N.m since t = 6 s|"
                                     "\"approved\": -0.11 in synchronise.adjust.motor.d");
    record.u[0] = 0.5;
    record.u[1] = 1; /* a Boolean has no step */
    many(WITHIN, LASTS + 200);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
}

static void expect_update(const char *cause) {
    TEST_ASSERT_EQUAL_INT(1, updates);
    TL_EXPECT_PARTS(cause, was_reported.cause);
    updates = 0;
}

/* The correction begins within a block, so the next block has another mean. Later updates come once
 * an hour, if the mean has changed by a tenth. */
static void test_a_correction_that_grows(void) {
    enum { HOUR = 360000, STEPS = 150 };
    lock();
    record.u[0] = 0.5;
    many(WITHIN, 50);
    expect_change(TL_LOCK_CORRECTED, "motor.d +0.167 N.m since t = 0 s");
    many(WITHIN, STEPS);
    expect_update("motor.d +0.5 N.m since t = 0 s");
    record.u[0] = 0.54;
    many(WITHIN, HOUR);
    TEST_ASSERT_EQUAL_INT(0, updates);
    record.u[0] = 0.6;
    many(WITHIN, HOUR);
    expect_update("motor.d +0.6 N.m since t = 0 s");
    record.u[0] = 2.0;
    many(WITHIN, HOUR);
    expect_update("motor.d at bound 2 N.m since t = 0 s");
    expect_no_change();
    const tl_lock_standing standing = tally().standing;
    TEST_ASSERT_EQUAL_INT(TL_LOCK_REASON_BOUND, standing.reason);
    TEST_ASSERT_DOUBLE_WITHIN(3.0, 3.0 * HOUR / 100, standing.now_s);
}

/* The last reason stays while the state does. A later correction is a new period. */
static void test_the_beginning_of_a_correction(void) {
    lock_monitor.started = 1000;
    lock();
    many(WITHIN, 50);
    record.u[0] = -0.3;
    many(WITHIN, 150);
    expect_change(TL_LOCK_CORRECTED, "motor.d -0.3 N.m since 00:00:02 UTC (t = 1.5 s)");
    record.u[0] = 0;
    many(WITHIN, 300);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_REASON_CORRECTION, tally().standing.reason);
    many(WITHIN, LASTS);
    expect_change(TL_LOCK_LOCKED, "100 %");
    TEST_ASSERT_EQUAL_INT(TL_LOCK_REASON_NONE, tally().standing.reason);
    record.u[0] = 0.3;
    many(WITHIN, 300);
    expect_change(TL_LOCK_CORRECTED, "motor.d +0.3 N.m since 00:01:07 UTC (t = 66 s)");
    TEST_ASSERT_EQUAL_DOUBLE(66.0, tally().standing.since_s);
    TEST_ASSERT_EQUAL_INT64(1000, tally().standing.started);
}

/* An approved correction is not one, a missing one is; beyond the bounds the bound is approved. */
static void test_an_approved_correction(void) {
    adjust[0].approved = 0.5;
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    record.u[0] = 0.55;
    many(WITHIN, 600);
    expect_change(TL_LOCK_LOCKED, "100 %");
    record.u[0] = 0.39;
    many(WITHIN, 150);
    expect_change(TL_LOCK_CORRECTED, "motor.d +0.39 N.m since t = 6 s|\"approved\": 0.39 in");
    adjust[0].approved = -5.0;
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    record.u[0] = -0.95;
    many(WITHIN, 600);
    expect_change(TL_LOCK_LOCKED, "100 %");
}

/* The period ends when its correction is approved, and begins again if the value was wrong. */
static void test_a_correction_that_is_approved(void) {
    tl_tuning tuning;
    account.adjust[0].least = -1;
    account.adjust[0].most = 2;
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    record.u[0] = 0.5;
    many(WITHIN, 150);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_CORRECTED, was_reported.to);
    changes = 0;
    tl_config_tuning(&config, &tuning);
    tuning.adjust[0].lower = -1;
    tuning.adjust[0].upper = 2;
    tl_lock_monitor_retune(&lock_monitor, &tuning);
    many(WITHIN, 150);
    expect_no_change();
    tuning.adjust[0].approved = 0.5;
    tl_lock_monitor_retune(&lock_monitor, &tuning);
    many(WITHIN, PART);
    expect_change(TL_LOCK_LOCKED, "100 %");
    many(WITHIN, LASTS);
    expect_no_change();
    tuning.adjust[0].approved = 0.7;
    tl_lock_monitor_retune(&lock_monitor, &tuning);
    many(WITHIN, 150);
    expect_change(TL_LOCK_CORRECTED, "motor.d +0.5 N.m since");
}

static void test_corrections_that_do_harm(void) {
    use_releases();
    released(0.2, 0.33, TL_RELEASE_SURE * BLOCK); /* 1.2 times, and a tenth of a tolerance */
    TEST_ASSERT_FALSE(lock_monitor.release.is_worse);
    released(0.2, 0.4, TL_RELEASE_SURE * BLOCK - 1);
    TEST_ASSERT_FALSE(lock_monitor.release.is_worse);
    released(0.2, 0.4, 1);
    TEST_ASSERT_EQUAL_INT(TL_RELEASE_WORSE, lock_monitor.release.turn);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.4, lock_monitor.release.error[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.2, lock_monitor.release.error[1]);
    released(0.2, 0.4, 1);
    TEST_ASSERT_EQUAL_INT(TL_RELEASE_AS_BEFORE, lock_monitor.release.turn);
    released(0.2, 0.4, 10 * BLOCK - 1);
    TEST_ASSERT_TRUE(lock_monitor.release.is_worse);
    released(0.2, 0.3, TL_RELEASE_SURE * BLOCK);
    TEST_ASSERT_EQUAL_INT(TL_RELEASE_BETTER, lock_monitor.release.turn);
    TEST_ASSERT_FALSE(lock_monitor.release.is_worse);
}

static void let_it_do_harm(void) {
    use_releases();
    released(0.2, 0.4, TL_RELEASE_SURE * BLOCK);
    TEST_ASSERT_TRUE(lock_monitor.release.is_worse);
}

static void test_a_harmful_lock_rests(void) {
    config.rests = true;
    let_it_do_harm();
    TEST_ASSERT_TRUE(lock_monitor.release.rests);
    released(0.9, 0.9, 4 * BLOCK);  /* the first release does not count */
    released(0.2, 0.2, 10 * BLOCK); /* at rest both are the same */
    TEST_ASSERT_TRUE(lock_monitor.release.rests);
    TEST_ASSERT_TRUE(lock_monitor.release.is_worse);
    released(0.7, 0.7, BLOCK); /* more than 1.2 times 0.4, and a tenth of a tolerance */
    TEST_ASSERT_TRUE(lock_monitor.release.rests);
    released(0.5, 0.5, BLOCK);
    released(0.7, 0.7, TL_RELEASE_BACK * BLOCK);
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
    TEST_ASSERT_EQUAL_INT(TL_RELEASE_ENDS, lock_monitor.release.turn);
    released(0.2, 0.4, TL_RELEASE_SURE * BLOCK - 1);
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
    released(0.2, 0.4, 1);
    TEST_ASSERT_TRUE(lock_monitor.release.rests);
}

/* Without released twins the twin at rest is judged by itself. */
static void test_a_rest_ends_without_released_twins(void) {
    config.rests = true;
    let_it_do_harm();
    record.release_age = 0;
    many(0.7, (4 + TL_RELEASE_BACK) * BLOCK);
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
}

static void test_what_does_not_rest(void) {
    let_it_do_harm(); /* forbidden */
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
    config.rests = true;
    config.free_twin = true;
    let_it_do_harm();
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
    config.free_twin = false;
    adjust[0].approved = 0.1;
    let_it_do_harm();
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
    adjust[0].approved = 0;
}

static void test_a_reset_and_a_tuning_end_a_rest(void) {
    config.rests = true;
    let_it_do_harm();
    record.flags = TL_FLAG_RESET;
    one(WITHIN);
    record.flags = 0;
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
    let_it_do_harm();
    tl_tuning tuning = {.adjusts = 2};
    tuning.adjust[0].approved = 0.7;
    tl_lock_monitor_retune(&lock_monitor, &tuning);
    TEST_ASSERT_FALSE(lock_monitor.release.rests);
}

static void test_at_a_bound(void) {
    lock();
    record.u[0] = 2;
    many(WITHIN, WINDOW / 2);
    expect_change(TL_LOCK_CORRECTED, "locked, corrected: motor.d at bound 2 N.m since t = 0 s");
    record.u[0] = 0;
    record.u[1] = 1; /* a Boolean is always at a bound */
    many(WITHIN, LASTS + 2 * WINDOW);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
}

/* ---- windows ---- */

/* A part has two steps if 0.1 s has fewer. */
static void test_a_slow_twin(void) {
    config.step = TL_SECOND;
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    many(WITHIN, 20);
    expect_change(TL_LOCK_LOCKED, "100 %|20 steps");
}

/* The unit is a stroke, and three are a window. */
static void test_strokes(void) {
    config.event.start.signal = "plant.valve";
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    for (int stroke = 0; stroke < 3; stroke++) {
        record.outcome = TL_HELD;
        for (int i = 0; i < WINDOW; i++) {
            step();
        }
        one(WITHIN);
    }
    expect_change(TL_LOCK_LOCKED, "100 %|3 strokes");
    many(OUTSIDE, 3);
    expect_change(TL_LOCK_LOST, "50 %|6 strokes|tolerance");
    TEST_ASSERT_EQUAL_UINT64(6, total());
}

/* Its state is determined at its end from the steps that there are. */
static void test_a_run_shorter_than_a_window(void) {
    many(OUTSIDE, PART + 3);
    tl_lock_tally found = tally();
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, found.state);
    TEST_ASSERT_EQUAL_UINT64(PART + 3, found.steps[TL_LOCK_LOST]);
    many(OUTSIDE, WINDOW - PART - 3); /* tally() does not change the monitor */
    TEST_ASSERT_EQUAL_INT(1, changes);
    TEST_ASSERT_EQUAL_UINT64(WINDOW, tally().steps[TL_LOCK_LOST]);
}

static void test_a_reset_starts_a_new_window(void) {
    lock();
    for (int i = 0; i < WINDOW; i++) {
        one(i % 2 == 0 ? FAR_AWAY : -FAR_AWAY);
    }
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, was_reported.to);
    changes = 0;
    TEST_ASSERT_TRUE(lock_monitor.is_astray);
    record.flags = TL_FLAG_RESET;
    one(WITHIN);
    record.flags = 0;
    TEST_ASSERT_FALSE(lock_monitor.is_astray);
    many(WITHIN, WINDOW - 1);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    TEST_ASSERT_EQUAL_UINT64(3 * WINDOW, total());
}

/* A new tolerance applies from the next step on. A new bound is limited to the range of the FMU. */
static void test_a_tuning_applies_from_the_next_step_on(void) {
    tl_tuning tuning;
    adjust[0].lower = -1;
    adjust[0].upper = 2;
    account.adjust[0].least = -0.5;
    account.adjust[0].most = 10;
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    lock();
    tl_config_tuning(&config, &tuning);
    tuning.match[0].tolerance = match[0].tolerance * WITHIN / OUTSIDE; /* WITHIN is outside now */
    tuning.adjust[0].lower = -5;
    tuning.adjust[0].upper = 5;
    tl_config_retune(&config, &tuning);
    tl_lock_monitor_retune(&lock_monitor, &tuning);
    TEST_ASSERT_EQUAL_DOUBLE(-0.5, lock_monitor.adjust[0].lower);
    TEST_ASSERT_EQUAL_DOUBLE(5, lock_monitor.adjust[0].upper);
    many(WITHIN, WINDOW / 2);
    expect_change(TL_LOCK_LOST, "50 %|100 steps|tolerance");
    tuning.match[0].tolerance = 2;
    tl_config_retune(&config, &tuning);
    tl_lock_monitor_retune(&lock_monitor, &tuning);
    many(WITHIN, WINDOW / 4);
    expect_no_change();
    many(WITHIN, WINDOW / 2 + PART / 2);
    expect_change(TL_LOCK_LOCKED, "80 %|100 steps");
}

/* The other tolerances replace those of the configuration, also for further outputs. */
static void test_other_tolerances(void) {
    const tl_lock_tolerances tolerances = {.match[0] = {match[0].tolerance, match[0].weight}};
    match[0].tolerance = 1e300;
    match[0].weight = 1e-300;
    match[1] = (tl_plan_match){.variable = "motor.i", .to = "plant.i", .tolerance = 1e300, .weight = 1e300};
    config.match_count = 2;
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    many(2.0, WINDOW);
    expect_change(TL_LOCK_LOCKED, "100 %|100 steps");
    lock_monitor.tolerances = &tolerances;
    many(2.0, WINDOW / 2);
    expect_change(TL_LOCK_LOST, "50 %|100 steps|tolerance");
    many(0.5, WINDOW + PART);
    expect_change(TL_LOCK_LOCKED, "80 %|100 steps");
}

/* A stroke is within tolerance if its J with the other tolerances is below 1. */
static void test_strokes_with_other_tolerances(void) {
    const tl_lock_tolerances tolerances = {.match[0] = {match[0].tolerance, match[0].weight}};
    match[0].tolerance = 10 * match[0].tolerance;
    config.event.start.signal = "plant.valve";
    tl_lock_monitor_init(&lock_monitor, &config, &account);
    lock_monitor.tolerances = &tolerances;
    many(0.09, 3);
    expect_change(TL_LOCK_LOCKED, "100 %|3 strokes");
    many(0.2, 3);
    expect_change(TL_LOCK_LOST, "50 %|6 strokes|tolerance");
    match[0].weight = 0.0; /* the search ignores it */
    many(0.0, 20);
    TEST_ASSERT_EQUAL_INT(TL_LOCK_LOST, tally().state);
}

/* Ten parts of 0.1 s or two steps; or three strokes of any length. */
static void test_the_window(void) {
    tl_lock_window window = tl_lock_monitor_window(&config);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND, window.time);
    TEST_ASSERT_EQUAL_UINT32(0, window.strokes);
    config.step = 3 * TL_SECOND;
    TEST_ASSERT_EQUAL_INT64(60 * TL_SECOND, tl_lock_monitor_window(&config).time);
    config.event = (tl_plan_event){.start.signal = "plant.torque", .longest = 7 * TL_SECOND};
    window = tl_lock_monitor_window(&config);
    TEST_ASSERT_EQUAL_INT64(21 * TL_SECOND, window.time);
    TEST_ASSERT_EQUAL_UINT32(3, window.strokes);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_tuning_applies_from_the_next_step_on);
    RUN_TEST(test_locked_when_a_window_is_full);
    RUN_TEST(test_a_returned_change_stays_valid);
    RUN_TEST(test_lost_and_found);
    RUN_TEST(test_noise_is_no_loss);
    RUN_TEST(test_no_oscillation_between_states);
    RUN_TEST(test_a_twin_that_swings_is_lost);
    RUN_TEST(test_a_limit_cycle);
    RUN_TEST(test_what_is_no_limit_cycle);
    RUN_TEST(test_a_plant_that_jumps);
    RUN_TEST(test_a_twin_that_has_recovered);
    RUN_TEST(test_what_swings_unmeasured);
    RUN_TEST(test_a_twin_that_is_elsewhere);
    RUN_TEST(test_huge_errors);
    RUN_TEST(test_a_runaway);
    RUN_TEST(test_an_objective_that_is_not_finite);
    RUN_TEST(test_an_output_that_is_not_finite);
    RUN_TEST(test_at_a_bound_for_a_minute);
    RUN_TEST(test_the_objective_of_a_search_does_not_count);
    RUN_TEST(test_several_outputs);
    RUN_TEST(test_followed_steps_do_not_count);
    RUN_TEST(test_no_good_matched_signal);
    RUN_TEST(test_a_signal_that_is_only_compared);
    RUN_TEST(test_a_step_between_two_measurements);
    RUN_TEST(test_nothing_is_adjusted);
    RUN_TEST(test_a_signal_of_the_plant_is_bad);
    RUN_TEST(test_an_inexact_rollback);
    RUN_TEST(test_a_released_twin_that_leaves_the_plant);
    RUN_TEST(test_a_young_released_twin_shows_nothing);
    RUN_TEST(test_a_released_twin_without_a_value);
    RUN_TEST(test_a_standing_correction);
    RUN_TEST(test_a_correction_that_grows);
    RUN_TEST(test_the_beginning_of_a_correction);
    RUN_TEST(test_an_approved_correction);
    RUN_TEST(test_a_correction_that_is_approved);
    RUN_TEST(test_corrections_that_do_harm);
    RUN_TEST(test_a_harmful_lock_rests);
    RUN_TEST(test_a_rest_ends_without_released_twins);
    RUN_TEST(test_what_does_not_rest);
    RUN_TEST(test_a_reset_and_a_tuning_end_a_rest);
    RUN_TEST(test_at_a_bound);
    RUN_TEST(test_a_slow_twin);
    RUN_TEST(test_strokes);
    RUN_TEST(test_other_tolerances);
    RUN_TEST(test_strokes_with_other_tolerances);
    RUN_TEST(test_a_run_shorter_than_a_window);
    RUN_TEST(test_a_reset_starts_a_new_window);
    RUN_TEST(test_the_window);
    return UNITY_END();
}
