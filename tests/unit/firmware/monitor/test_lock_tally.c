/* The summary of the lock states, and when a run was locked long enough. */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "firmware/monitor/lock_tally.h"
#include "tests/support/message.h"

void setUp(void) {}

void tearDown(void) {}

static void expect_parts(const char *parts, tl_lock_tally tally) {
    char text[TL_LOCK_SENTENCE];
    tl_lock_tally_write(&tally, "steps", text);
    TL_EXPECT_PARTS(parts, text);
}

static void test_the_summary(void) {
    expect_parts("no steps", (tl_lock_tally){0});
    expect_parts("100.0 %|7 steps|locked", (tl_lock_tally){.state = TL_LOCK_LOCKED, .steps = {[TL_LOCK_LOCKED] = 7}});
    expect_parts("65.0 %|100 steps|free 10.0 %|corrected 15.0 %|degraded 5.0 %|lost 20.0 %",
                 (tl_lock_tally){.state = TL_LOCK_LOST, .steps = {10, 50, 15, 5, 20}});
}

/* No data must not look like a perfect fit. */
static void test_a_run_that_was_never_locked(void) {
    expect_parts("never|signal", (tl_lock_tally){.steps = {[TL_LOCK_FREE] = 1000}});
    expect_parts("never|10 steps|lost 100.0 %", (tl_lock_tally){.state = TL_LOCK_LOST, .steps = {[TL_LOCK_LOST] = 10}});
}

static void test_what_is_enough(void) {
    const tl_lock_tally some = {.steps = {[TL_LOCK_LOCKED] = 90, [TL_LOCK_CORRECTED] = 5, [TL_LOCK_DEGRADED] = 5},
                                .windows = 9};
    TEST_ASSERT_EQUAL_DOUBLE(95, tl_lock_tally_percent(&some));
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&some, 0));
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&some, 95));
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&some, 95.1));
}

/* Without a percentage one step is enough to fail. A percentage ignores it. */
static void test_what_ran_away_is_not_enough(void) {
    const tl_lock_tally tally = {.steps = {[TL_LOCK_LOCKED] = 99, [TL_LOCK_LOST] = 1}, .ran_away = 1, .windows = 9};
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&tally, 0));
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&tally, 99));
    expect_parts("free|99.0 %|lost 1.0 %|1 of them", tally);
}

static void test_what_is_enough_at_least(void) {
    tl_lock_tally never = {.steps = {[TL_LOCK_FREE] = 5, [TL_LOCK_LOST] = 5}, .windows = 1};
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 0));
    expect_parts("never|10 steps|lost 50.0 %", never);
    never.steps[TL_LOCK_DEGRADED] = 100;
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 0));
    never.windows = 0;
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 0));
    TEST_ASSERT_FALSE(tl_lock_tally_is_enough(&never, 1));
    never.steps[TL_LOCK_LOCKED] = 1;
    TEST_ASSERT_TRUE(tl_lock_tally_is_enough(&never, 0));
}

static void expect_instant(const char *wanted, double instant_s, double now_s, int64_t started, bool is_event) {
    char text[TL_LOCK_INSTANT];
    tl_lock_instant_write(instant_s, now_s, started, is_event, text);
    TEST_ASSERT_EQUAL_STRING(wanted, text);
}

/* A replay has no calendar time. */
static void test_instants(void) {
    const int64_t midnight = INT64_C(1795824000000); /* 2026-11-28 */
    expect_instant("t = 18006.5 s", 18006.5, 20000, 0, false);
    expect_instant("05:00:06 UTC", 18006.5, 20000, midnight, false);
    expect_instant("05:00:06 UTC (t = 18006.5 s)", 18006.5, 20000, midnight, true);
    expect_instant("2026-11-28 05:00 UTC", 18006.5, 86400, midnight, false);
    expect_instant("2026-11-28 05:00 UTC (t = 18006.5 s)", 18006.5, 86400, midnight, true);
}

/* Numbers of another process. */
static void test_instants_that_cannot_be(void) {
    TEST_ASSERT_EQUAL_INT64(INT64_C(1795824001500), tl_lock_utc(1.5, INT64_C(1795824000000)));
    TEST_ASSERT_EQUAL_INT64(0, tl_lock_utc((double)NAN, 1000));
    TEST_ASSERT_EQUAL_INT64(0, tl_lock_utc(-1e300, 1000));
    TEST_ASSERT_EQUAL_INT64(0, tl_lock_utc(1.0, INT64_MAX));
    TEST_ASSERT_EQUAL_INT64(0, tl_lock_utc(1.0, INT64_MIN));
}

/* `show` reads what an event says. */
static void expect_event(const char *wanted, const char *remedy, const tl_lock_standing *standing) {
    char text[TL_LOCK_CLAUSE];
    tl_lock_standing found;
    tl_lock_standing_write(standing, true, text);
    TEST_ASSERT_EQUAL_STRING(wanted, text);
    TEST_ASSERT_TRUE(tl_lock_standing_parse(text, &found));
    TEST_ASSERT_EQUAL_INT(standing->reason, found.reason);
    TEST_ASSERT_EQUAL_STRING(standing->variable, found.variable);
    TEST_ASSERT_EQUAL_STRING(standing->unit, found.unit);
    TEST_ASSERT_EQUAL_DOUBLE(standing->value, found.value);
    TEST_ASSERT_EQUAL_DOUBLE(standing->since_s, found.since_s);
    tl_lock_standing_write_remedy(standing, text);
    TEST_ASSERT_EQUAL_STRING(remedy, text);
}

static void test_the_reason_of_corrected(void) {
    tl_lock_standing standing = {.reason = TL_LOCK_REASON_CORRECTION, .variable = "heater.Q", .unit = "W", .value = 5};
    standing.since_s = 18006;
    expect_event("locked, corrected: heater.Q +5 W since t = 18006 s",
                 "to accept it: \"approved\": 5 in synchronise.adjust.heater.Q", &standing);
    standing.started = 1;
    standing.reason = TL_LOCK_REASON_BOUND;
    expect_event("locked, corrected: heater.Q at bound 5 W since 05:00:06 UTC (t = 18006 s)", "", &standing);
    standing.reason = TL_LOCK_REASON_RELEASED;
    standing.unit[0] = '\0';
    expect_event("locked, but heater.Q 5 off without corrections since 05:00:06 UTC (t = 18006 s)", "", &standing);
    memset(standing.variable, 'x', sizeof standing.variable); /* without an end, from another process */
    memset(standing.unit, 'y', sizeof standing.unit);
    char text[TL_LOCK_CLAUSE];
    tl_lock_standing_write(&standing, false, text);
    TEST_ASSERT_EQUAL_STRING("locked, but 5 yyyyyyyyyyyyyyyyyyyyyyy off without corrections since 05:00:06 UTC", text);
    tl_lock_standing_write(&standing, true, text);
    TEST_ASSERT_NOT_NULL(strstr(text, "xxx 5 yyy"));
    TEST_ASSERT_NOT_NULL(strstr(text, "yyy off without"));
    standing.reason = (tl_lock_reason)77;
    tl_lock_standing_write(&standing, false, text);
    TEST_ASSERT_EQUAL_STRING("", text);
}

static void test_texts_without_a_reason(void) {
    static const char *const others[] = {"",
                                         "locked: 100 %",
                                         "tracking: at a bound",
                                         "locked, corrected: ",
                                         "locked, corrected: heater.Q +5 W",
                                         "locked, corrected: heater.Q since t = 5 s",
                                         "locked, corrected: heater.Q +5 W since 05:00:06 UTC",
                                         "locked, corrected: heater.Q +5 W since t = inf s",
                                         "locked, but heater.Q 5 W since t = 1 s"};
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        tl_lock_standing found = {.reason = TL_LOCK_REASON_BOUND};
        TEST_ASSERT_FALSE_MESSAGE(tl_lock_standing_parse(others[i], &found), others[i]);
        TEST_ASSERT_EQUAL_INT(TL_LOCK_REASON_NONE, found.reason);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_instants);
    RUN_TEST(test_instants_that_cannot_be);
    RUN_TEST(test_the_reason_of_corrected);
    RUN_TEST(test_texts_without_a_reason);
    RUN_TEST(test_the_summary);
    RUN_TEST(test_a_run_that_was_never_locked);
    RUN_TEST(test_what_is_enough);
    RUN_TEST(test_what_ran_away_is_not_enough);
    RUN_TEST(test_what_is_enough_at_least);
    return UNITY_END();
}
