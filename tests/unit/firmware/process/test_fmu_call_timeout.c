/* Patience with FMUs: what one look after the other sees, and when it is over. */
#include "firmware/process/fmu_call_timeout.h"

#include <string.h>
#include <unity.h>

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

/* How many looks until it is over; `most` if it is not. */
static int looks(int most) {
    int count = 0;
    while (count < most && !look()) {
        count++;
    }
    return count;
}

static void a_call_may_last_as_long_as_the_limit(void) {
    TEST_ASSERT_EQUAL_INT(6, looks(100)); /* the first look has seen nothing pass */
    TEST_ASSERT_EQUAL_STRING("FMU motor has not returned from fmi2DoStep for 3 s: it hangs, or needs longer; "
                             "--call-limit S permits that",
                             text);
}

static void many_calls_may_last_as_long_as_they_like(void) {
    for (int i = 0; i < 100; i++) {
        call.begun++;
        TEST_ASSERT_EQUAL_INT(3, looks(3));
    }
}

static void between_two_calls_nobody_is_waited_for(void) {
    TEST_ASSERT_EQUAL_INT(5, looks(5));
    view.call = NULL;
    TEST_ASSERT_EQUAL_INT(100, looks(100));
    view.call = &call; /* the counter has gone round, or it was the same look: it begins anew */
    call.begun++;
    TEST_ASSERT_EQUAL_INT(6, looks(100));
}

static void without_a_limit_a_call_may_last_for_ever(void) {
    patience.limit = 0;
    TEST_ASSERT_EQUAL_INT(1000, looks(1000));
}

static void asked_to_end_a_call_has_five_seconds(void) {
    patience.limit = 0;
    TEST_ASSERT_EQUAL_INT(50, looks(50));
    view.asked = "SIGTERM";
    view.times = 1;
    TEST_ASSERT_EQUAL_INT(9, looks(100));
    TEST_ASSERT_NOT_NULL(strstr(text, "SIGTERM asked to end, and FMU motor has not returned from fmi2DoStep for 30 s"));
}

static void a_call_that_begins_after_that_has_five_seconds_too(void) {
    patience.limit = 0;
    view.asked = "SIGINT";
    view.times = 1;
    TEST_ASSERT_EQUAL_INT(8, looks(8));
    call.begun++;
    TEST_ASSERT_EQUAL_INT(10, looks(100));
}

static void asked_twice_it_ends_at_once_but_not_within_a_second(void) {
    patience.limit = 0;
    view.asked = "SIGINT";
    view.times = 1;
    TEST_ASSERT_FALSE(look());
    view.times = 2; /* a terminal's and a supervisor's come together */
    TEST_ASSERT_EQUAL_INT(8, looks(8));
    view.times = 3;
    TEST_ASSERT_TRUE(look());
    TEST_ASSERT_EQUAL_STRING("asked twice to end, by SIGINT: ended at once, in FMU motor's fmi2DoStep", text);
}

/* The process did not run for a while: what came meanwhile is one request. */
static void signals_between_two_looks_ask_once(void) {
    patience.limit = 0;
    view.asked = "SIGTERM";
    view.times = 3;
    TEST_ASSERT_FALSE(look());
    view.now += TL_SECOND;
    view.times = 5;
    TEST_ASSERT_EQUAL_INT(8, looks(100));
    TEST_ASSERT_NOT_NULL(strstr(text, "SIGTERM asked to end"));
}

static void asked_twice_without_a_call_it_ends_by_itself(void) {
    view.call = NULL;
    view.asked = "SIGINT";
    view.times = 5;
    TEST_ASSERT_EQUAL_INT(1000, looks(1000));
}

static void who_was_stopped_was_not_patient(void) {
    TEST_ASSERT_FALSE(look());
    view.now += 3600 * TL_SECOND;
    TEST_ASSERT_FALSE(look());
    TEST_ASSERT_EQUAL_INT(3, looks(100)); /* a second of it counts */
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_call_may_last_as_long_as_the_limit);
    RUN_TEST(many_calls_may_last_as_long_as_they_like);
    RUN_TEST(between_two_calls_nobody_is_waited_for);
    RUN_TEST(without_a_limit_a_call_may_last_for_ever);
    RUN_TEST(asked_to_end_a_call_has_five_seconds);
    RUN_TEST(a_call_that_begins_after_that_has_five_seconds_too);
    RUN_TEST(asked_twice_it_ends_at_once_but_not_within_a_second);
    RUN_TEST(signals_between_two_looks_ask_once);
    RUN_TEST(asked_twice_without_a_call_it_ends_by_itself);
    RUN_TEST(who_was_stopped_was_not_patient);
    return UNITY_END();
}
