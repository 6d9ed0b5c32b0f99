/* The log relay of a run: processes that follow each other print into one pipe. */
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/live/log_relay.h"
#include "tests/support/stderr_capture.h"

static tl_heartbeats beats;
static tl_log_relay relay;

void setUp(void) {
    tl_error error;
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_log_relay_start(&relay, &beats, false, NULL, &error));
}

void tearDown(void) {}

static void print(int pipe, const char *text) {
    TEST_ASSERT_EQUAL_INT((int)strlen(text), (int)write(pipe, text, strlen(text)));
}

static void expect(const char *lines) {
    tl_log_relay_stop(&relay);
    tl_stderr_expect(lines);
}

static void test_a_line_ends_with_the_process_that_printed_it(void) {
    print(tl_log_relay_pipe(&relay, 1), "<4>first\n<3>half of a li");
    print(tl_log_relay_pipe(&relay, 1), "<4>second\n");
    expect("twinlock: warning: first\ntwinlock: error: half of a li\ntwinlock: warning: second\n");
}

/* All processes print the same line: the first two are logged, further ones are counted. */
static void test_repeats_of_later_processes_are_counted(void) {
    for (int i = 0; i < 5; i++) {
        print(tl_log_relay_pipe(&relay, 0), "<4>the same\n");
    }
    expect("twinlock: warning: the same\ntwinlock: warning: the same\n");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_line_ends_with_the_process_that_printed_it);
    RUN_TEST(test_repeats_of_later_processes_are_counted);
    return UNITY_END();
}
