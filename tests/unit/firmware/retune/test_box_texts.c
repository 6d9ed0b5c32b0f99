/* The administrator's list and the configuration's file: valid ones, and the error of invalid
 * ones. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/retune/box_texts.h"
#include "firmware/retune/control.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static char path[PATH_MAX + 32];
static char fault[TL_BOX_FAULT];

void setUp(void) {
    tl_scratch_empty(&scratch);
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "allowed"));
}

void tearDown(void) {}

static void write_bytes(const char *bytes, size_t size) {
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_EQUAL_size_t(size, fwrite(bytes, 1, size, file));
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_INT(0, chmod(path, 0644));
}

static void write_text(const char *text) {
    write_bytes(text, strlen(text));
}

static void expect_fault(const char *parts) {
    TEST_ASSERT_NULL(tl_box_read_list(path, fault));
    TL_EXPECT_PARTS(parts, fault);
}

static void expect_list(const char *text) {
    char *found = tl_box_read_list(path, fault);
    TEST_ASSERT_EQUAL_STRING("", fault);
    TEST_ASSERT_EQUAL_STRING(text, found);
    free(found);
}

static void test_a_list(void) {
    TEST_ASSERT_NULL(tl_box_read_list(path, fault)); /* a missing list is no fault */
    TEST_ASSERT_EQUAL_STRING("", fault);
    write_text("# these\nfile /run/a\nlibrary libb.so\n");
    expect_list("# these\nfile /run/a\nlibrary libb.so\n");
    write_text("");
    expect_list("");
}

static void test_invalid_lists(void) {
    char *large = calloc(1, TL_BOX_LIST_MOST + 1);
    TEST_ASSERT_NOT_NULL(large);
    memset(large, '\n', TL_BOX_LIST_MOST + 1);
    write_bytes(large, TL_BOX_LIST_MOST + 1);
    expect_fault("/allowed|65536 bytes");
    free(large);
    write_bytes("file /a\0", 8);
    expect_fault("/allowed|text");
    write_text("file /run/a\n/run/b\n");
    expect_fault("/allowed|line 2|\"/run/b\"");
    write_text("file /run/a\n");
    for (unsigned i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_INT(0, chmod(path, i == 0 ? 0664 : 0646));
        expect_fault("/allowed|root");
    }
    if (geteuid() == 0) {
        TEST_ASSERT_EQUAL_INT(0, chmod(path, 0644));
        TEST_ASSERT_EQUAL_INT(0, chown(path, 12345, 0));
        expect_fault("/allowed|root");
    }
}

/* Opening a FIFO must not block. */
static void test_what_is_no_file(void) {
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path, 0600));
    expect_fault("/allowed|Invalid argument");
    TEST_ASSERT_NULL(tl_box_read_file(path));
    TEST_ASSERT_EQUAL_INT(0, unlink(path));
    TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0700));
    expect_fault("/allowed|Invalid argument");
    TEST_ASSERT_NULL(tl_box_read_file(path));
}

static void test_a_configuration(void) {
    TEST_ASSERT_NULL(tl_box_read_file(path));
    write_text("{}");
    char *text = tl_box_read_file(path);
    TEST_ASSERT_EQUAL_STRING("{}", text);
    free(text);
    TEST_ASSERT_EQUAL_INT(0, truncate(path, TL_CONTROL_MOST + 1));
    TEST_ASSERT_NULL(tl_box_read_file(path));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_box_texts");
    UNITY_BEGIN();
    RUN_TEST(test_a_list);
    RUN_TEST(test_invalid_lists);
    RUN_TEST(test_what_is_no_file);
    RUN_TEST(test_a_configuration);
    return tl_scratch_finish(&scratch, UNITY_END());
}
