/* The restart record: what a supervisor keeps for the next one, and when restarts are a loop. */
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/live/restarts.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/stderr_capture.h"

static tl_scratch scratch;
static tl_restarts restarts;
static tl_error error;

void setUp(void) {
    tl_scratch_empty(&scratch);
    error = (tl_error){TL_OK, ""};
    restarts.lock = -1;
}

void tearDown(void) {
    tl_restarts_close(&restarts);
}

static void open_here(bool watchdog) {
    tl_restarts_close(&restarts);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_restarts_open(scratch.folder, watchdog, &restarts, &error), error.text);
}

static void write_account(const char *text) {
    FILE *file = fopen(tl_scratch_path(&scratch, "supervisor.json"), "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_GREATER_OR_EQUAL_INT(0, fputs(text, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* The same reason as without any record. */
static void expect_orderly_reason(void) {
    tl_restarts fresh;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_restarts_open(NULL, false, &fresh, &error));
    TEST_ASSERT_EQUAL_STRING("", fresh.reason);
    TEST_ASSERT_EQUAL_STRING(fresh.reason, restarts.reason);
}

static void test_an_orderly_life(void) {
    open_here(false);
    expect_orderly_reason();
    tl_restarts_begin(&restarts, false);
    tl_restarts_end(&restarts);
    open_here(false);
    TEST_ASSERT_EQUAL_UINT64(1, restarts.starts);
    TEST_ASSERT_EQUAL_UINT64(0, restarts.restarts);
    TEST_ASSERT_EQUAL_UINT(0, restarts.failures);
    expect_orderly_reason();
}

/* They stay listed after an orderly end, because the files stay the same. */
static void test_files_whose_states_are_not_loaded(void) {
    open_here(false);
    TEST_ASSERT_EQUAL_UINT64(0, restarts.unreadable);
    tl_restarts_note_unreadable(&restarts, 0xfedcba9876543210);
    tl_restarts_note_unreadable(&restarts, 0);
    tl_restarts_begin(&restarts, true);
    tl_restarts_end(&restarts);
    open_here(false);
    TEST_ASSERT_EQUAL_UINT64(0xfedcba9876543210, restarts.unreadable);
}

static void test_a_file_of_an_older_version(void) {
    write_account("{\"starts\": 3, \"restarts\": 1, \"failures\": 2, \"running\": false, \"boot\": \"\"}");
    open_here(false);
    TEST_ASSERT_EQUAL_UINT64(3, restarts.starts);
    TEST_ASSERT_EQUAL_UINT(2, restarts.failures);
    TEST_ASSERT_EQUAL_UINT64(0, restarts.unreadable);
    TEST_ASSERT_EQUAL_UINT(0, restarts.tries);
}

static void test_a_loop(void) {
    open_here(false);
    tl_restarts_begin(&restarts, false);
    for (int i = 1; i <= TL_RESTARTS_MOST; i++) {
        TEST_ASSERT_FALSE(tl_restarts_is_loop(&restarts));
        tl_restarts_fail(&restarts, "it hung");
        tl_restarts_begin(&restarts, true);
    }
    TEST_ASSERT_TRUE(tl_restarts_is_loop(&restarts));
    TEST_ASSERT_EQUAL_STRING("it hung", restarts.reason);
    TEST_ASSERT_EQUAL_UINT64(1 + TL_RESTARTS_MOST, restarts.starts);
    TEST_ASSERT_EQUAL_UINT64(TL_RESTARTS_MOST, restarts.restarts);
    tl_restarts_end(&restarts); /* an orderly stop resets the failures */
    open_here(false);
    TEST_ASSERT_FALSE(tl_restarts_is_loop(&restarts));
    TEST_ASSERT_EQUAL_UINT64(TL_RESTARTS_MOST, restarts.restarts);
}

/* Any number of failures is no loop if they are TL_RESTARTS_FORGIVEN or more apart. */
static void test_forgiven(void) {
    open_here(false);
    for (int i = 0; i < 50; i++) {
        tl_restarts_fail(&restarts, "it hung");
        tl_restarts_begin(&restarts, true);
        TEST_ASSERT_EQUAL_UINT(1, restarts.failures);
        tl_restarts_live(&restarts, TL_RESTARTS_FORGIVEN - 1);
        TEST_ASSERT_EQUAL_UINT(1, restarts.failures);
        tl_restarts_live(&restarts, 1);
        TEST_ASSERT_EQUAL_UINT(0, restarts.failures);
    }
    tl_restarts_live(&restarts, 10 * TL_RESTARTS_FORGIVEN);
    TEST_ASSERT_EQUAL_UINT(0, restarts.failures);
}

/* Time before a failure does not count after it. */
static void test_forgiven_by_life_since_the_start(void) {
    open_here(false);
    tl_restarts_begin(&restarts, false);
    tl_restarts_live(&restarts, TL_RESTARTS_FORGIVEN - 1);
    tl_restarts_fail(&restarts, "it hung");
    tl_restarts_begin(&restarts, true);
    tl_restarts_live(&restarts, 1);
    TEST_ASSERT_EQUAL_UINT(1, restarts.failures);
}

static void test_the_supervisor_was_killed(void) {
    open_here(false);
    tl_restarts_begin(&restarts, false);
    open_here(false);
    TL_EXPECT_PARTS("supervisor|killed", restarts.reason);
    TEST_ASSERT_TRUE(restarts.interrupted);
    TEST_ASSERT_EQUAL_UINT(0, restarts.failures);
}

/* Resets do not count as failures. Failures before the reset stay. */
static void test_the_box_was_reset(void) {
    write_account(
        "{\"starts\": 9, \"restarts\": 4, \"failures\": 4, \"running\": true, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0}");
    open_here(true);
    TL_EXPECT_PARTS("reset|watchdog", restarts.reason);
    TEST_ASSERT_EQUAL_UINT(4, restarts.failures);
    for (int i = 0; i < 50; i++) {
        open_here(false);
        TL_EXPECT_PARTS("reset|power", restarts.reason);
        TEST_ASSERT_TRUE(restarts.interrupted);
        TEST_ASSERT_FALSE(tl_restarts_is_loop(&restarts));
    }
    tl_restarts_fail(&restarts, "it hung");
    TEST_ASSERT_TRUE(tl_restarts_is_loop(&restarts));
    TEST_ASSERT_EQUAL_UINT64(9, restarts.starts);
    TEST_ASSERT_EQUAL_UINT64(4, restarts.restarts);
}

static void test_a_reset_after_an_orderly_end(void) {
    write_account(
        "{\"starts\": 9, \"restarts\": 4, \"failures\": 0, \"running\": false, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0}");
    open_here(true);
    expect_orderly_reason();
    TEST_ASSERT_FALSE(restarts.interrupted);
    TEST_ASSERT_EQUAL_UINT(0, restarts.failures);
}

static void fail_until_loop(void) {
    for (int i = 0; i < TL_RESTARTS_MOST; i++) {
        tl_restarts_fail(&restarts, "it hung");
    }
    TEST_ASSERT_TRUE(tl_restarts_is_loop(&restarts));
}

/* The hold time doubles up to 3600 s, also across power failures. */
static void test_retries(void) {
    static const tl_time seconds[] = {60, 120, 240, 480, 960, 1920, 3600, 3600};
    open_here(false);
    fail_until_loop();
    for (size_t i = 0; i < sizeof seconds / sizeof seconds[0]; i++) {
        TEST_ASSERT_EQUAL_INT64(seconds[i] * TL_SECOND, tl_restarts_hold_time(&restarts, TL_RESTARTS_HOLD));
        tl_restarts_retry(&restarts);
        tl_restarts_begin(&restarts, true);
        tl_restarts_fail(&restarts, "it hung");
        TEST_ASSERT_EQUAL_UINT(TL_RESTARTS_MOST, restarts.failures);
        open_here(false);
        TEST_ASSERT_EQUAL_UINT(i + 1, restarts.tries);
        TEST_ASSERT_TRUE(tl_restarts_is_loop(&restarts));
    }
}

/* A run long enough to forgive all failures resets the retries. So does an orderly end. */
static void test_retries_are_forgotten(void) {
    open_here(false);
    fail_until_loop();
    tl_restarts_retry(&restarts);
    for (int i = 0; i < TL_RESTARTS_MOST; i++) {
        TEST_ASSERT_EQUAL_UINT(1, restarts.tries);
        tl_restarts_live(&restarts, TL_RESTARTS_FORGIVEN);
    }
    TEST_ASSERT_EQUAL_UINT(0, restarts.tries);
    fail_until_loop();
    tl_restarts_retry(&restarts);
    tl_restarts_end(&restarts);
    open_here(false);
    TEST_ASSERT_EQUAL_UINT(0, restarts.tries);
}

static void test_a_damaged_account(void) {
    static const char *const texts[] = {
        "",
        "{\"starts\": 9, \"restarts\": 4, \"failures\"",
        "[]",
        "{\"starts\": -1, \"restarts\": 4, \"failures\": 0, \"running\": true, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0}",
        "{\"starts\": 9, \"restarts\": 4, \"failures\": 0, \"running\": 1, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0}",
        "{\"starts\": 9, \"restarts\": 4, \"failures\": 0, \"running\": true, \"boot\": 3, \"unreadable\": \"0\", \"tries\": 0}",
        "{\"starts\": 1e300, \"restarts\": 4, \"failures\": 0, \"running\": true, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0}",
        "{\"starts\": 9, \"restarts\": 4, \"failures\": 0, \"running\": true, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0} {}",
    };
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        write_account(texts[i]);
        TEST_ASSERT_TRUE(tl_stderr_capture_begin());
        open_here(true);
        char *said = tl_stderr_capture_end();
        TEST_ASSERT_TRUE_MESSAGE(tl_test_has_parts(said, "warning|supervisor.json|damaged"), texts[i]);
        free(said);
        TEST_ASSERT_EQUAL_UINT64(0, restarts.starts);
        TEST_ASSERT_EQUAL_UINT(0, restarts.failures);
    }
}

static void test_more_failures_than_make_a_loop(void) {
    write_account(
        "{\"starts\": 9, \"restarts\": 4, \"failures\": 4294967297, \"running\": true, \"boot\": \"another\", \"unreadable\": \"0\", \"tries\": 0}");
    open_here(false);
    TEST_ASSERT_TRUE(tl_restarts_is_loop(&restarts));
}

static void test_no_folder(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_restarts_open(NULL, false, &restarts, &error));
    tl_restarts_begin(&restarts, false);
    tl_restarts_fail(&restarts, "it hung");
    tl_restarts_end(&restarts);
    TEST_ASSERT_EQUAL_UINT64(1, restarts.starts);
}

static void test_folders_that_will_not_do(void) {
    char path[PATH_MAX + 8];
    char parts[PATH_MAX + 32];
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_restarts_open("/nowhere/state", false, &restarts, &error));
    (void)snprintf(parts, sizeof parts, "--state|/nowhere/state|%s", strerror(ENOENT));
    TL_EXPECT_PARTS(parts, error.text);
    write_account("a file");
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_restarts_open(scratch.path, false, &restarts, &error));
    (void)snprintf(parts, sizeof parts, "--state|%s|folder", scratch.path);
    TL_EXPECT_PARTS(parts, error.text);
    memset(path, 'a', sizeof path - 1);
    path[sizeof path - 1] = '\0';
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_restarts_open(path, false, &restarts, &error));
}

static void test_one_supervisor_at_a_time(void) {
    tl_restarts other;
    char parts[PATH_MAX + 32];
    open_here(false);
    tl_restarts_begin(&restarts, false);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_restarts_open(scratch.folder, false, &other, &error));
    (void)snprintf(parts, sizeof parts, "--state|%s|supervisor", scratch.folder);
    TL_EXPECT_PARTS(parts, error.text);
    tl_restarts_close(&restarts);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_restarts_open(scratch.folder, false, &other, &error));
    TEST_ASSERT_EQUAL_UINT64(1, other.starts);
    tl_restarts_close(&other);
}

/* It is logged once, and the supervisor continues. */
static void test_a_folder_that_disappears(void) {
    open_here(false);
    (void)snprintf(restarts.path, sizeof restarts.path, "/nowhere/supervisor.json");
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_restarts_begin(&restarts, false);
    tl_restarts_begin(&restarts, true);
    tl_restarts_end(&restarts);
    char *said = tl_stderr_capture_end();
    TL_EXPECT_PARTS("warning|restarts|/nowhere/supervisor.json", said);
    TEST_ASSERT_EQUAL_size_t(1, tl_test_count_lines(said));
    free(said);
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_restarts");
    RUN_TEST(test_an_orderly_life);
    RUN_TEST(test_files_whose_states_are_not_loaded);
    RUN_TEST(test_a_file_of_an_older_version);
    RUN_TEST(test_a_loop);
    RUN_TEST(test_forgiven);
    RUN_TEST(test_forgiven_by_life_since_the_start);
    RUN_TEST(test_the_supervisor_was_killed);
    RUN_TEST(test_the_box_was_reset);
    RUN_TEST(test_a_reset_after_an_orderly_end);
    RUN_TEST(test_retries);
    RUN_TEST(test_retries_are_forgotten);
    RUN_TEST(test_a_damaged_account);
    RUN_TEST(test_more_failures_than_make_a_loop);
    RUN_TEST(test_no_folder);
    RUN_TEST(test_folders_that_will_not_do);
    RUN_TEST(test_one_supervisor_at_a_time);
    RUN_TEST(test_a_folder_that_disappears);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
