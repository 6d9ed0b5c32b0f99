/* Reports about a link, and their count. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "board/io/link.h"

static size_t reports;
static size_t failures;
static bool last_up;
static char last_text[2 * TL_LINK_TEXT];

static void on_link(void *context, bool up, const char *text) {
    TEST_ASSERT_EQUAL_PTR(&reports, context);
    reports++;
    last_up = up;
    (void)snprintf(last_text, sizeof last_text, "%s", text);
}

static const tl_plant_io_sink SINK = {.link = on_link, .context = &reports};

void setUp(void) {
    reports = 0;
    failures = 0;
    last_text[0] = '\0';
}

void tearDown(void) {}

static void expect_report(size_t times, bool up, const char *text) {
    TEST_ASSERT_EQUAL_size_t(times, reports);
    TEST_ASSERT_EQUAL_INT(up, last_up);
    TEST_ASSERT_EQUAL_STRING(text, last_text);
}

/* A device that is down from the start is reported too. */
static void test_the_first_state_is_news(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_FALSE(tl_link_is_up(&link));
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, false, "device", "absent"));
    expect_report(1, false, "device: absent");
    link = (tl_link){.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, true, "device", "there"));
    expect_report(2, true, "device: there");
}

static void test_a_change_is_reported_once(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, true, "device", "there"));
    TEST_ASSERT_FALSE(tl_link_set(&link, &SINK, true, "device", "still there"));
    expect_report(1, true, "device: there");
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, false, "device", "gone"));
    TEST_ASSERT_FALSE(tl_link_set(&link, &SINK, false, "device", "gone for another reason"));
    expect_report(2, false, "device: gone");
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, true, "device", "back"));
    expect_report(3, true, "device: back");
    TEST_ASSERT_TRUE(tl_link_is_up(&link));
}

static void test_a_report_leaves_the_link_as_it_is(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    tl_link_report(&link, &SINK, false, "device", "not known yet");
    expect_report(1, false, "device: not known yet");
    TEST_ASSERT_TRUE(tl_link_change(&link, true));
    tl_link_report(&link, &SINK, true, "part", "good again");
    expect_report(2, true, "part: good again");
    TEST_ASSERT_TRUE(tl_link_is_up(&link));
}

static void on_part_failed(void *context, const char *text) {
    TEST_ASSERT_EQUAL_PTR(&reports, context);
    failures++;
    (void)snprintf(last_text, sizeof last_text, "%s", text);
}

/* Without a function for failed parts, link() gets them. */
static void test_a_failed_part(void) {
    static const tl_plant_io_sink both = {.link = on_link, .part_failed = on_part_failed, .context = &reports};
    tl_link link = {.state = TL_LINK_UP};
    tl_link_report(&link, &SINK, false, NULL, "part: in trouble");
    expect_report(1, true, "part: in trouble");
    tl_link_report(&link, &both, false, "part", "in trouble again");
    TEST_ASSERT_EQUAL_STRING("part: in trouble again", last_text);
    TEST_ASSERT_EQUAL_size_t(1, failures);
    TEST_ASSERT_EQUAL_size_t(1, reports);
    link.state = TL_LINK_DOWN;
    tl_link_report(&link, &both, false, "part", "in trouble");
    expect_report(2, false, "part: in trouble");
    TEST_ASSERT_EQUAL_size_t(1, failures);
}

static void test_change_reports_nothing(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_TRUE(tl_link_change(&link, false));
    TEST_ASSERT_FALSE(tl_link_change(&link, false));
    TEST_ASSERT_TRUE(tl_link_change(&link, true));
    TEST_ASSERT_EQUAL_size_t(0, reports);
}

/* The device's path may be longer than the whole text. */
static void test_a_long_text_is_cut(void) {
    char device[2 * TL_LINK_TEXT];
    tl_link link = {.state = TL_LINK_UP};
    memset(device, 'w', sizeof device - 1);
    device[sizeof device - 1] = '\0';
    tl_link_report(&link, &SINK, false, device, "in trouble");
    TEST_ASSERT_EQUAL_size_t(TL_LINK_TEXT - 1, strlen(last_text));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_first_state_is_news);
    RUN_TEST(test_a_change_is_reported_once);
    RUN_TEST(test_a_report_leaves_the_link_as_it_is);
    RUN_TEST(test_a_failed_part);
    RUN_TEST(test_change_reports_nothing);
    RUN_TEST(test_a_long_text_is_cut);
    return UNITY_END();
}
