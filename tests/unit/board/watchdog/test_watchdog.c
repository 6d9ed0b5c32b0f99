/* The watchdog driver refuses a file that is no watchdog. tests/hil/box/test_watchdog.py tests a
 * real reset. */
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "board/watchdog/watchdog.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

static tl_watchdog watchdog;
static tl_error error;
static tl_scratch scratch;

void setUp(void) {
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {}

static void expect_refusal(const char *path, const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_PLANT_DOWN, tl_watchdog_open(path, 10, &watchdog, &error));
    TL_EXPECT_PARTS(path, error.text);
    TL_EXPECT_PARTS(parts, error.text);
    TEST_ASSERT_EQUAL_INT(-1, watchdog.file);
}

static void test_absent(void) {
    expect_refusal("/nowhere/watchdog", "driver|--watchdog");
}

/* The driver writes nothing to it. */
static void test_a_plain_file(void) {
    struct stat about;
    const char *path = tl_scratch_path(&scratch, "watchdog");
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fclose(file);
    expect_refusal(path, "device");
    TEST_ASSERT_EQUAL_INT(0, stat(path, &about));
    TEST_ASSERT_EQUAL_INT(0, about.st_size);
}

static void test_a_device_that_is_none(void) {
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("not in an emulator");
    }
    expect_refusal("/dev/null", "Inappropriate ioctl for device");
}

static void test_left_twice(void) {
    (void)tl_watchdog_open("/dev/null", 10, &watchdog, &error);
    tl_watchdog_release(&watchdog);
    tl_watchdog_release(&watchdog);
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
