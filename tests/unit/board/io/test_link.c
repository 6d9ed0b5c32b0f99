/* What is told of a link, and how often. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "board/io/link.h"

static size_t told;
static bool last_up;
static char last_text[2 * TL_LINK_TEXT];

static void on_link(void *context, bool up, const char *text) {
    TEST_ASSERT_EQUAL_PTR(&told, context);
    told++;
    last_up = up;
    (void)snprintf(last_text, sizeof last_text, "%s", text);
}

static const tl_plant_io_sink SINK = {.link = on_link, .context = &told};

void setUp(void) {
    told = 0;
    last_text[0] = '\0';
}

void tearDown(void) {}

static void expect_told(size_t times, bool up, const char *text) {
    TEST_ASSERT_EQUAL_size_t(times, told);
    TEST_ASSERT_EQUAL_INT(up, last_up);
    TEST_ASSERT_EQUAL_STRING(text, last_text);
}

/* Whichever it is: a device that is down from the beginning is told too. */
static void test_the_first_state_is_news(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_FALSE(tl_link_is_up(&link));
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, false, "device", "absent"));
    expect_told(1, false, "device: absent");
    link = (tl_link){.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, true, "device", "there"));
    expect_told(2, true, "device: there");
}

static void test_a_change_is_told_once(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, true, "device", "there"));
    TEST_ASSERT_FALSE(tl_link_set(&link, &SINK, true, "device", "still there"));
    expect_told(1, true, "device: there");
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, false, "device", "gone"));
    TEST_ASSERT_FALSE(tl_link_set(&link, &SINK, false, "device", "gone for another reason"));
    expect_told(2, false, "device: gone");
    TEST_ASSERT_TRUE(tl_link_set(&link, &SINK, true, "device", "back"));
    expect_told(3, true, "device: back");
    TEST_ASSERT_TRUE(tl_link_is_up(&link));
}

static void test_trouble_leaves_the_link_as_it_is(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    tl_link_report(&link, &SINK, "device", "not known yet");
    expect_told(1, false, "device: not known yet");
    TEST_ASSERT_TRUE(tl_link_change(&link, true));
    tl_link_report(&link, &SINK, "part", "in trouble");
    tl_link_report(&link, &SINK, "part", "in trouble");
    expect_told(3, true, "part: in trouble");
    TEST_ASSERT_TRUE(tl_link_is_up(&link));
}

static void test_change_tells_nothing(void) {
    tl_link link = {.state = TL_LINK_UNKNOWN};
    TEST_ASSERT_TRUE(tl_link_change(&link, false));
    TEST_ASSERT_FALSE(tl_link_change(&link, false));
    TEST_ASSERT_TRUE(tl_link_change(&link, true));
    TEST_ASSERT_EQUAL_size_t(0, told);
}

/* A path may be longer than all of it. */
static void test_a_long_text_is_cut(void) {
    char who[2 * TL_LINK_TEXT];
    tl_link link = {.state = TL_LINK_UP};
    memset(who, 'w', sizeof who - 1);
    who[sizeof who - 1] = '\0';
    tl_link_report(&link, &SINK, who, "in trouble");
    TEST_ASSERT_EQUAL_size_t(TL_LINK_TEXT - 1, strlen(last_text));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_first_state_is_news);
    RUN_TEST(test_a_change_is_told_once);
    RUN_TEST(test_trouble_leaves_the_link_as_it_is);
    RUN_TEST(test_change_tells_nothing);
    RUN_TEST(test_a_long_text_is_cut);
    return UNITY_END();
}
