/* Time limit of FMU calls: periodic checks, and when the limit is exceeded. */
#include "firmware/process/fmu_call_timeout.h"

#include <string.h>
#include <unity.h>

#include "tests/support/message.h"

static const tl_time LOOK = TL_SECOND / 2;

static tl_fmu_call_timeout patience;
static tl_fmu_call_timeout_view view;
static tl_fmu_call call;
static char text[256];

void setUp(void) {
    patience = (tl_fmu_call_timeout){.limit = 3 * TL_SECOND};
    call = (tl_fmu_call){.begun = 7, .function = "fmi2DoStep", .fmu = "motor"};
    view = (tl_fmu_call_timeout_view){.now = TL_SECOND, .call = &call};
    text[0] = '\0';
}

void tearDown(void) {}

static bool look(void) {
    view.now += LOOK;
    return tl_fmu_call_timeout_is_over(&patience, &view, text, sizeof text);
}

/* Returns the number of checks until the limit is exceeded, at most `most`. */
static int looks(int most) {
    int count = 0;
    while (count < most && !look()) {
        count++;
    }
    return count;
}

static void a_call_may_last_as_long_as_the_limit(void) {
    TEST_ASSERT_EQUAL_INT(6, looks(100)); /* the first check only stores the start */
    TL_EXPECT_PARTS("motor|fmi2DoStep|3 s|--call-limit", text);
}

static void many_calls_may_last_longer_than_the_limit(void) {
    for (int i = 0; i < 100; i++) {
        call.begun++;
        TEST_ASSERT_EQUAL_INT(3, looks(3));
    }
}

static void the_time_between_two_calls_does_not_count(void) {
    TEST_ASSERT_EQUAL_INT(5, looks(5));
    view.call = NULL;
    TEST_ASSERT_EQUAL_INT(100, looks(100));
    view.call = &call; /* a new call, so the time starts again */
    call.begun++;
    TEST_ASSERT_EQUAL_INT(6, looks(100));
}

static void without_a_limit_a_call_may_last_for_ever(void) {
    patience.limit = 0;
    TEST_ASSERT_EQUAL_INT(1000, looks(1000));
}

static void after_a_signal_a_call_has_five_seconds(void) {
    patience.limit = 0;
    TEST_ASSERT_EQUAL_INT(50, looks(50));
    view.asked = "SIGTERM";
    view.times = 1;
    TEST_ASSERT_EQUAL_INT(9, looks(100));
    TL_EXPECT_PARTS("SIGTERM|motor|fmi2DoStep|30 s", text);
}

static void a_call_that_begins_after_a_signal_has_five_seconds(void) {
    patience.limit = 0;
    view.asked = "SIGINT";
    view.times = 1;
    TEST_ASSERT_EQUAL_INT(8, looks(8));
    call.begun++;
    TEST_ASSERT_EQUAL_INT(10, looks(100));
}

static void a_second_signal_ends_it_at_once_but_not_within_a_second(void) {
    patience.limit = 0;
    view.asked = "SIGINT";
    view.times = 1;
    TEST_ASSERT_FALSE(look());
    view.times = 2; /* terminal and supervisor may both send a signal at once */
    TEST_ASSERT_EQUAL_INT(8, looks(8));
    view.times = 3;
    TEST_ASSERT_TRUE(look());
    TL_EXPECT_PARTS("SIGINT|motor|fmi2DoStep", text);
}

/* Signals between two checks count as one request, because the process may have been suspended. */
static void signals_between_two_checks_count_once(void) {
    patience.limit = 0;
    view.asked = "SIGTERM";
    view.times = 3;
    TEST_ASSERT_FALSE(look());
    view.now += TL_SECOND;
    view.times = 5;
    TEST_ASSERT_EQUAL_INT(8, looks(100));
    TL_EXPECT_PARTS("SIGTERM|motor|fmi2DoStep", text);
}

static void without_a_call_signals_end_no_wait(void) {
    view.call = NULL;
    view.asked = "SIGINT";
    view.times = 5;
    TEST_ASSERT_EQUAL_INT(1000, looks(1000));
}

static void a_suspension_does_not_count(void) {
    TEST_ASSERT_FALSE(look());
    view.now += 3600 * TL_SECOND;
    TEST_ASSERT_FALSE(look());
    TEST_ASSERT_EQUAL_INT(3, looks(100)); /* at most 1 s of the pause counts */
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_call_may_last_as_long_as_the_limit);
    RUN_TEST(many_calls_may_last_longer_than_the_limit);
    RUN_TEST(the_time_between_two_calls_does_not_count);
    RUN_TEST(without_a_limit_a_call_may_last_for_ever);
    RUN_TEST(after_a_signal_a_call_has_five_seconds);
    RUN_TEST(a_call_that_begins_after_a_signal_has_five_seconds);
    RUN_TEST(a_second_signal_ends_it_at_once_but_not_within_a_second);
    RUN_TEST(signals_between_two_checks_count_once);
    RUN_TEST(without_a_call_signals_end_no_wait);
    RUN_TEST(a_suspension_does_not_count);
    return UNITY_END();
}
