/* Probation: each way to end it, and its resumption. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/retune/probation.h"
#include "tests/support/message.h"

enum { RATE = 100 }; /* steps a second */

static tl_probation probation;
static tl_run_status now;

void setUp(void) {
    now = (tl_run_status){.twin_alive = true, .lock = {.state = TL_LOCK_LOCKED}};
}

void tearDown(void) {}

static void begin(uint32_t given_s, double require_lock, bool must_confirm) {
    const tl_probation_terms terms = {given_s, require_lock, must_confirm};
    tl_probation_begin(&probation, &terms, &now, &now);
}

/* 0.1 s pass; each step has the current state of the lock. */
static tl_probation_result pass(void) {
    now.steps += RATE / 10;
    now.ticks += RATE / 10;
    now.lock.steps[now.lock.state] += RATE / 10;
    now.pairs += now.lock.state != TL_LOCK_FREE ? RATE / 10 : 0;
    return tl_probation_feed(&probation, TL_SECOND / 10, &now);
}

static tl_probation_result pass_seconds(double seconds) {
    tl_probation_result result = TL_PROBATION_CONTINUES;
    for (int i = 0; i < (int)(10.0 * seconds + 0.5); i++) {
        result = pass();
    }
    return result;
}

/* The probation ends after this time with this result, and its reason has all parts. */
static void expect_end(double goes_on_s, tl_probation_result result, const char *parts) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_PROBATION_CONTINUES, pass_seconds(goes_on_s - 0.1), probation.why);
    TEST_ASSERT_EQUAL_STRING("", probation.why);
    TEST_ASSERT_EQUAL_INT_MESSAGE(result, pass(), probation.why);
    TL_EXPECT_PARTS(parts, probation.why);
    TEST_ASSERT_EQUAL_INT(result, pass_seconds(100));
    TL_EXPECT_PARTS(parts, probation.why);
}

/* ---- end of its duration ---- */

static void test_kept_by_its_lock(void) {
    begin(60, 95.0, false);
    now.lock.state = TL_LOCK_CORRECTED;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(30));
    now.lock.state = TL_LOCK_DEGRADED;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(3));
    now.lock.state = TL_LOCK_LOCKED;
    expect_end(27, TL_PROBATION_KEPT, "lock|95 %");
}

static void test_too_little_lock(void) {
    begin(60, 95.0, false);
    now.lock.state = TL_LOCK_DEGRADED;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(17.4));
    now.lock.state = TL_LOCK_LOCKED;
    expect_end(42.6, TL_PROBATION_ROLLED_BACK, "lock|71 %|95 %");
}

/* Steps before the probation do not count. */
static void test_only_its_own_steps_count(void) {
    now.lock.steps[TL_LOCK_LOST] = 1000000;
    now.steps = now.ticks = 1000000;
    begin(10, 100.0, false);
    expect_end(10, TL_PROBATION_KEPT, "lock|100 %");
}

static void test_no_lock_is_asked(void) {
    now.lock.state = TL_LOCK_FREE;
    begin(10, 0.0, false);
    expect_end(10, TL_PROBATION_KEPT, "failure");
}

static void test_no_step_was_judged(void) {
    const tl_probation_terms terms = {10, 50.0, false};
    tl_probation_begin(&probation, &terms, &now, &now);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, tl_probation_feed(&probation, 10 * TL_SECOND, &now));
    TL_EXPECT_PARTS("too short|lock", probation.why);
}

/* With an event horizon, no step is judged before a stroke has ended. */
static void test_steps_of_which_none_was_judged(void) {
    const tl_probation_terms terms = {10, 50.0, false};
    tl_probation_begin(&probation, &terms, &now, &now);
    now.ticks += 1000;
    now.steps += 1000;
    now.pairs += 1000;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_KEPT, tl_probation_feed(&probation, 10 * TL_SECOND, &now));
    TL_EXPECT_PARTS("failure|lock", probation.why);
}

/* The result could not be written to disk: the probation continues, and its next result is the
 * same. */
static void test_result_that_could_not_be_written(void) {
    begin(10, 0.0, false);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_KEPT, tl_probation_feed(&probation, 10 * TL_SECOND, &now));
    probation.result = TL_PROBATION_CONTINUES;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_KEPT, tl_probation_feed(&probation, TL_SECOND, &now));
    TL_EXPECT_PARTS("failure", probation.why);
}

static void test_nobody_confirmed(void) {
    begin(10, 95.0, true);
    expect_end(10, TL_PROBATION_ROLLED_BACK, "confirmed");
}

static void test_twin_that_does_not_run_at_the_end(void) {
    begin(10, 0.0, false);
    now.twin_alive = false;
    expect_end(10, TL_PROBATION_ROLLED_BACK, "twin");
}

/* ---- sources of the plant ---- */

static void test_sources_that_cannot_be_opened(void) {
    begin(60, 0.0, false);
    now.plant_is_shut = true;
    expect_end(10, TL_PROBATION_ROLLED_BACK, "plant|10 s|sources");
    now.lock.state = TL_LOCK_LOCKED;
    begin(5, 0.0, false);
    expect_end(5, TL_PROBATION_ROLLED_BACK, "plant|sources");
}

static void test_a_device_that_does_not_answer(void) {
    begin(60, 95.0, false);
    now.lock.state = TL_LOCK_FREE;
    expect_end(60, TL_PROBATION_ROLLED_BACK, "lock|0 %|95 %");
    begin(60, 0.0, false); /* no lock is required */
    expect_end(60, TL_PROBATION_KEPT, "failure");
}

/* With an event horizon, no stroke is seen, so that none is judged. */
static void test_a_device_that_does_not_answer_with_an_event_horizon(void) {
    const tl_probation_terms terms = {10, 50.0, false};
    tl_probation_begin(&probation, &terms, &now, &now);
    now.ticks += 1000;
    now.steps += 1000;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, tl_probation_feed(&probation, 10 * TL_SECOND, &now));
    TL_EXPECT_PARTS("signal|lock", probation.why);
}

/* ---- decisions of a user ---- */

static void test_confirmed(void) {
    begin(10, 95.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(1));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_KEPT,
                          tl_probation_decide(&probation, TL_PROBATION_KEPT, "anna has confirmed it"));
    TEST_ASSERT_EQUAL_STRING("anna has confirmed it", probation.why);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_KEPT, tl_probation_decide(&probation, TL_PROBATION_ROLLED_BACK, "too late"));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_KEPT, pass_seconds(20));
    TEST_ASSERT_EQUAL_STRING("anna has confirmed it", probation.why);
}

static void test_refused(void) {
    begin(10, 0.0, false);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK,
                          tl_probation_decide(&probation, TL_PROBATION_ROLLED_BACK, "anna wants it back"));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, tl_probation_decide(&probation, TL_PROBATION_KEPT, "ben"));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, pass_seconds(20));
    TEST_ASSERT_EQUAL_STRING("anna wants it back", probation.why);
}

/* ---- failures ---- */

static void test_twin_that_fails(void) {
    now.twin_failures = 7;
    begin(60, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(5));
    now.twin_failures = 8;
    expect_end(0.1, TL_PROBATION_ROLLED_BACK, "twin|failed");
}

static void test_reason_of_the_failure(void) {
    begin(60, 0.0, true);
    now.twin_failures = 1;
    memset(now.failure, 'x', sizeof now.failure);
    memcpy(now.failure, "it hung ", 8);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, pass_seconds(0.1));
    TL_EXPECT_PARTS("twin|failed", probation.why);
    const char *failure = strstr(probation.why, "it hung xx"); /* complete */
    TEST_ASSERT_NOT_NULL_MESSAGE(failure, probation.why);
    TEST_ASSERT_EQUAL_size_t(TL_RUN_FAILURE - 1, strlen(failure));
}

static void test_another_run_that_fails(void) {
    now.twin_failures = 7;
    begin(60, 0.0, true);
    now.twin_failures = 0;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(5));
    now.twin_failures = 1;
    expect_end(0.1, TL_PROBATION_ROLLED_BACK, "twin|failed");
}

static void test_twin_that_does_not_run(void) {
    begin(600, 0.0, false);
    now.twin_alive = false;
    now.lock.state = TL_LOCK_LOST; /* its last state */
    expect_end(30.1, TL_PROBATION_ROLLED_BACK, "twin|30 s");
}

static void test_twin_that_runs_late(void) {
    begin(600, 0.0, false);
    for (int i = 0; i < 5; i++) {
        now.twin_alive = false;
        TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(29));
        now.twin_alive = true;
        TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass());
    }
}

/* ---- deadlines ---- */

/* 1 s passes, with this many more steps and missed deadlines. */
static tl_probation_result miss(uint64_t steps, uint64_t misses) {
    now.steps += steps;
    now.ticks += steps;
    now.deadline_misses += misses;
    return tl_probation_feed(&probation, TL_SECOND, &now);
}

static void test_missed_deadlines(void) {
    begin(600, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, miss(1, 1)); /* too few steps to judge */
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, miss(1, 1));
    now.ticks += 4;
    now.skipped += 4;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, miss(2, 1));
    TL_EXPECT_PARTS("3|4|deadlines|75 %|0 %|4 ticks", probation.why);
}

static void test_one_percent_is_no_more_than_that(void) {
    begin(600, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, miss(1000, 10));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, miss(1, 1));
}

static void test_one_that_missed_before(void) {
    now.steps = now.ticks = 10000;
    now.deadline_misses = 200;
    begin(600, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, miss(1000, 60)); /* three times the share before */
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, miss(10, 2));
    TL_EXPECT_PARTS("62|1010|deadlines|6.14 %|2 %|0 ticks", probation.why);
}

/* The skipped ticks of a restart do not lower the share of missed deadlines. */
static void test_a_gap_hides_no_misses(void) {
    begin(600, 0.0, true);
    now.ticks += 6000;
    now.skipped += 6000;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, miss(100, 3));
}

static void test_another_run_begins_at_0(void) {
    const tl_probation_terms terms = {600, 95.0, false};
    now.steps = now.ticks = 10000;
    now.deadline_misses = 300;
    now.lock.steps[TL_LOCK_LOCKED] = 10000;
    tl_probation_begin(&probation, &terms, &now, NULL);
    now = (tl_run_status){.ticks = 20, .steps = 20, .deadline_misses = 2, .twin_alive = true};
    now.lock.steps[TL_LOCK_FREE] = 20;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, tl_probation_feed(&probation, TL_SECOND, &now));
    TEST_ASSERT_EQUAL_UINT64(2, probation.account.misses);
    TEST_ASSERT_EQUAL_UINT64(20, probation.account.steps);
    now.ticks = now.steps = 15; /* a third run */
    now.deadline_misses = 3;
    now.lock.steps[TL_LOCK_FREE] = 0;
    now.lock.steps[TL_LOCK_LOCKED] = 15;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, tl_probation_feed(&probation, TL_SECOND, &now));
    TEST_ASSERT_EQUAL_UINT64(5, probation.account.misses);
    TEST_ASSERT_EQUAL_UINT64(35, probation.account.steps);
    TEST_ASSERT_EQUAL_UINT64(20, probation.account.lock.steps[TL_LOCK_FREE]);
    TEST_ASSERT_EQUAL_UINT64(15, probation.account.lock.steps[TL_LOCK_LOCKED]);
}

/* ---- a lost lock ---- */

static void test_lost_lock(void) {
    begin(600, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(20));
    now.lock.state = TL_LOCK_LOST;
    expect_end(2.1, TL_PROBATION_ROLLED_BACK, "lost|2.0 s");
}

/* Time passes in lock by its own tolerances, and in this state by those of the version before. */
static tl_probation_result pass_before(tl_lock_state before, double seconds) {
    tl_probation_result result = TL_PROBATION_CONTINUES;
    for (int i = 0; i < (int)(10.0 * seconds + 0.5); i++) {
        now.lock_before.state = before;
        now.lock_before.steps[before] += RATE / 10;
        result = pass();
    }
    return result;
}

static void begin_wider(uint32_t given_s, double require_lock, bool must_confirm) {
    begin(given_s, require_lock, must_confirm);
    probation.account.tolerances.match[0].tolerance = 1.0;
    probation.account.tolerances.match[0].weight = 1.0;
    (void)snprintf(probation.account.widened, TL_PROBATION_WIDENED, "motor.omega: tolerance 1 → 3");
}

static void test_lost_by_the_tolerances_before(void) {
    begin_wider(600, 0.0, false);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_before(TL_LOCK_LOCKED, 20));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_before(TL_LOCK_LOST, 2));
    TEST_ASSERT_TRUE(tl_probation_is_lost_by_previous(&probation));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, pass_before(TL_LOCK_LOST, 0.1));
    TL_EXPECT_PARTS("tolerances|lost|2.0 s|motor.omega|1 → 3", probation.why);
}

/* No lock is required, and the probation is too short for a loss of 2 s. */
static void test_lost_before_when_a_short_one_ends(void) {
    begin_wider(1, 0.0, false);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_before(TL_LOCK_LOST, 0.9));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, pass_before(TL_LOCK_LOST, 0.1));
    TL_EXPECT_PARTS("tolerances|lost|motor.omega|1 → 3", probation.why);
}

static void test_too_little_lock_by_the_tolerances_before(void) {
    begin_wider(10, 95.0, false);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_before(TL_LOCK_LOST, 1));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, pass_before(TL_LOCK_LOCKED, 9));
    TL_EXPECT_PARTS("tolerances|lock|90 %|95 %|motor.omega|1 → 3", probation.why);
}

/* If a user must confirm, a loss by the tolerances before does not end the probation early. */
static void test_lost_before_until_it_is_confirmed(void) {
    begin_wider(600, 95.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_before(TL_LOCK_LOST, 500));
    TEST_ASSERT_TRUE(tl_probation_is_lost_by_previous(&probation));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, pass_before(TL_LOCK_LOST, 100));
    TL_EXPECT_PARTS("confirmed", probation.why);
}

static void test_lost_with_breaks(void) {
    begin(600, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(20));
    for (int i = 0; i < 20; i++) {
        now.lock.state = TL_LOCK_LOST;
        TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(2));
        now.lock.state = TL_LOCK_DEGRADED;
        TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass());
    }
}

/* A lock that is lost at the begin has a grace of 10 s in addition to 2 s. */
static void test_grace(void) {
    now.lock.state = TL_LOCK_LOST;
    begin(600, 0.0, true);
    expect_end(12, TL_PROBATION_ROLLED_BACK, "lost|2.0 s");
}

static void test_grace_of_a_short_one(void) {
    now.lock.state = TL_LOCK_LOST;
    begin(6, 0.0, true);
    expect_end(5, TL_PROBATION_ROLLED_BACK, "lost|2.0 s");
}

/* A single poll does not prove a loss, also if the last poll was long ago. */
static void test_one_poll(void) {
    begin(600, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(20));
    now.lock.state = TL_LOCK_LOST;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, tl_probation_feed(&probation, 5 * TL_SECOND, &now));
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_ROLLED_BACK, tl_probation_feed(&probation, 5 * TL_SECOND, &now));
}

/* ---- resumption ---- */

static void test_resumption_with_the_rest_of_its_time(void) {
    begin(60, 95.0, false);
    now.lock.state = TL_LOCK_DEGRADED;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(3));
    now.lock.state = TL_LOCK_LOCKED;
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(27));
    TEST_ASSERT_EQUAL_UINT64(30000, probation.account.left_ms);
    const tl_probation_account account = probation.account;
    memset(&probation, 0xFF, sizeof probation);
    now.steps = now.ticks = 12345; /* not judged */
    now.deadline_misses = 12345;
    now.twin_failures = 3;
    tl_probation_resume(&probation, &account);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, tl_probation_feed(&probation, 0, &now));
    expect_end(30, TL_PROBATION_KEPT, "lock|95 %");
}

static void test_grace_again(void) {
    begin(600, 0.0, true);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, pass_seconds(20));
    const tl_probation_account account = probation.account;
    now.lock.state = TL_LOCK_LOST;
    tl_probation_resume(&probation, &account);
    expect_end(12, TL_PROBATION_ROLLED_BACK, "lost|2.0 s");
}

static void test_an_invalid_account(void) {
    const tl_probation_account account = {.terms = {0, 1000.0, true}, .left_ms = UINT64_MAX};
    tl_probation_resume(&probation, &account);
    TEST_ASSERT_EQUAL_UINT64(1000, probation.account.left_ms);
    TEST_ASSERT_EQUAL_DOUBLE(100.0, probation.account.terms.require_lock);
    expect_end(1, TL_PROBATION_ROLLED_BACK, "confirmed");
    const tl_probation_account long_one = {.terms = {UINT32_MAX, -5.0, true}, .left_ms = UINT64_MAX};
    tl_probation_resume(&probation, &long_one);
    TEST_ASSERT_EQUAL_UINT64(1000 * (uint64_t)TL_PROBATION_LONGEST_S, probation.account.left_ms);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, probation.account.terms.require_lock);
}

/* A negative time does not count. A huge time ends the probation. */
static void test_clock_that_jumps(void) {
    begin(10, 0.0, false);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_CONTINUES, tl_probation_feed(&probation, -TL_SECOND, &now));
    TEST_ASSERT_EQUAL_UINT64(10000, probation.account.left_ms);
    TEST_ASSERT_EQUAL_INT(TL_PROBATION_KEPT, tl_probation_feed(&probation, INT64_MAX, &now));
    TEST_ASSERT_EQUAL_UINT64(0, probation.account.left_ms);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_kept_by_its_lock);
    RUN_TEST(test_too_little_lock);
    RUN_TEST(test_only_its_own_steps_count);
    RUN_TEST(test_no_lock_is_asked);
    RUN_TEST(test_no_step_was_judged);
    RUN_TEST(test_steps_of_which_none_was_judged);
    RUN_TEST(test_result_that_could_not_be_written);
    RUN_TEST(test_nobody_confirmed);
    RUN_TEST(test_twin_that_does_not_run_at_the_end);
    RUN_TEST(test_sources_that_cannot_be_opened);
    RUN_TEST(test_a_device_that_does_not_answer);
    RUN_TEST(test_a_device_that_does_not_answer_with_an_event_horizon);
    RUN_TEST(test_confirmed);
    RUN_TEST(test_refused);
    RUN_TEST(test_twin_that_fails);
    RUN_TEST(test_reason_of_the_failure);
    RUN_TEST(test_another_run_that_fails);
    RUN_TEST(test_twin_that_does_not_run);
    RUN_TEST(test_twin_that_runs_late);
    RUN_TEST(test_missed_deadlines);
    RUN_TEST(test_one_percent_is_no_more_than_that);
    RUN_TEST(test_one_that_missed_before);
    RUN_TEST(test_a_gap_hides_no_misses);
    RUN_TEST(test_another_run_begins_at_0);
    RUN_TEST(test_lost_lock);
    RUN_TEST(test_lost_by_the_tolerances_before);
    RUN_TEST(test_lost_before_when_a_short_one_ends);
    RUN_TEST(test_too_little_lock_by_the_tolerances_before);
    RUN_TEST(test_lost_before_until_it_is_confirmed);
    RUN_TEST(test_lost_with_breaks);
    RUN_TEST(test_grace);
    RUN_TEST(test_grace_of_a_short_one);
    RUN_TEST(test_one_poll);
    RUN_TEST(test_resumption_with_the_rest_of_its_time);
    RUN_TEST(test_grace_again);
    RUN_TEST(test_an_invalid_account);
    RUN_TEST(test_clock_that_jumps);
    return UNITY_END();
}
