/* Repeated log lines: which are of one kind, when they are logged, and their counts. */
#include "firmware/base/log_repeats.h"

#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "tests/support/stderr_capture.h"

#define MINUTE (60 * TL_SECOND)

static tl_log_repeats repeats;
static tl_time now;

void setUp(void) {
    memset(&repeats, 0, sizeof repeats);
    now = 1000 * TL_SECOND;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
}

void tearDown(void) {}

static void add(const char *line) {
    tl_log_repeats_add(&repeats, TL_LOG_WARNING, line, now);
}

/* Lets the time pass in steps of a second. */
static void wait(tl_time time) {
    for (tl_time end = now + time; now < end; now += TL_SECOND) {
        tl_log_repeats_poll(&repeats, now);
    }
    tl_log_repeats_poll(&repeats, now);
}

static void numbers_make_no_kind_but_names_do(void) {
    add("x1: 0.1 s old");
    add("x2: 0.1 s old");
    add("x1: 0.25 s old");
    add("x1: -12 s old");
    add("x2: 1e-9 s old"); /* the exponent is a name */
    add("x1[3]: 7 s old");
    tl_log_repeats_end(&repeats);
    tl_stderr_expect("twinlock: warning: x1: 0.1 s old\n"
                     "twinlock: warning: x2: 0.1 s old\n"
                     "twinlock: warning: x1: 0.25 s old\n"
                     "twinlock: warning: x2: 1e-9 s old\n"
                     "twinlock: warning: x1[3]: 7 s old\n"
                     "twinlock: warning: x1: -12 s old\n");
}

/* Two kinds alternate. The log ends with the last of both, in their order, a minute later. */
static void the_last_line_is_logged_after_a_quiet_minute(void) {
    for (int i = 0; i < 10; i++) {
        add("bad");
        wait(TL_SECOND);
        add("good");
        wait(TL_SECOND);
    }
    add("bad");
    wait(2 * MINUTE);
    add("bad"); /* a new beginning */
    tl_log_repeats_end(&repeats);
    tl_stderr_expect("twinlock: warning: bad\n"
                     "twinlock: warning: good\n"
                     "twinlock: warning: bad\n"
                     "twinlock: warning: good\n"
                     "twinlock: warning: good (7 more were not logged)\n"
                     "twinlock: warning: bad (8 more were not logged)\n"
                     "twinlock: warning: bad\n");
}

static void lines_that_go_on_are_counted_each_hour(void) {
    for (int i = 0; i < 2 * 3600 + 10; i++) {
        add("bad");
        wait(TL_SECOND);
    }
    tl_log_repeats_end(&repeats);
    tl_stderr_expect("twinlock: warning: bad\n"
                     "twinlock: warning: bad\n"
                     "twinlock: warning: bad (3599 more were not logged)\n"
                     "twinlock: warning: bad (3599 more were not logged)\n"
                     "twinlock: warning: bad (7 more were not logged)\n");
}

/* A count is not lost with its kind. */
static void the_oldest_kind_is_replaced(void) {
    for (int i = 0; i < 4; i++) {
        add("first");
    }
    for (int i = 0; i < TL_LOG_REPEATS_KINDS; i++) {
        char line[16];
        now += TL_SECOND;
        (void)snprintf(line, sizeof line, "line%d", i);
        tl_log_repeats_add(&repeats, TL_LOG_DEBUG, line, now); /* not shown */
    }
    tl_log_repeats_end(&repeats);
    tl_stderr_expect("twinlock: warning: first\n"
                     "twinlock: warning: first\n"
                     "twinlock: warning: first (1 more were not logged)\n");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(numbers_make_no_kind_but_names_do);
    RUN_TEST(the_last_line_is_logged_after_a_quiet_minute);
    RUN_TEST(lines_that_go_on_are_counted_each_hour);
    RUN_TEST(the_oldest_kind_is_replaced);
    return UNITY_END();
}
