/* The watchdog: what is none is refused, and left as it is. One that bites is tests/hil/box/test_watchdog.py's. */
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "board/watchdog/watchdog.h"
#include "tests/support/scratch.h"

static tl_watchdog watchdog;
static tl_error error;
static tl_scratch scratch;

void setUp(void) {
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {}

static void expect_refusal(const char *path, const char *text) {
    TEST_ASSERT_EQUAL_INT(TL_PLANT_DOWN, tl_watchdog_open(path, 10, &watchdog, &error));
    TEST_ASSERT_EQUAL_STRING(text, error.text);
    TEST_ASSERT_EQUAL_INT(-1, watchdog.file);
}

static void test_absent(void) {
    expect_refusal("/nowhere/watchdog", "watchdog /nowhere/watchdog: no such device: load the driver of the box's "
                                        "watchdog, or leave --watchdog out");
}

/* Not made, not written to. */
static void test_a_plain_file(void) {
    char text[PATH_MAX + 64];
    struct stat about;
    const char *path = tl_scratch_path(&scratch, "watchdog");
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fclose(file);
    (void)snprintf(text, sizeof text, "watchdog %s: is no device", path);
    expect_refusal(path, text);
    TEST_ASSERT_EQUAL_INT(0, stat(path, &about));
    TEST_ASSERT_EQUAL_INT(0, about.st_size);
}

static void test_a_device_that_is_none(void) {
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("an emulator knows no watchdog");
    }
    expect_refusal("/dev/null", "watchdog /dev/null: is no watchdog (Inappropriate ioctl for device)");
}

static void test_left_twice(void) {
    (void)tl_watchdog_open("/dev/null", 10, &watchdog, &error);
    tl_watchdog_leave(&watchdog);
    tl_watchdog_leave(&watchdog);
    TEST_ASSERT_EQUAL_INT(-1, watchdog.file);
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_watchdog");
    RUN_TEST(test_absent);
    RUN_TEST(test_a_plain_file);
    RUN_TEST(test_a_device_that_is_none);
    RUN_TEST(test_left_twice);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
