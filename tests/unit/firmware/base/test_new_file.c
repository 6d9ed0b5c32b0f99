/* Atomic creation of a file: what remains after an error, and which targets are never replaced. */
#include <limits.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static tl_new_file made;
static tl_error error;
static char path[PATH_MAX];
static char other[PATH_MAX];

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "report.html"));
    (void)snprintf(other, sizeof other, "%s", tl_scratch_path(&scratch, "other"));
    made = (tl_new_file){0};
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

static void write_old(const char *name) {
    FILE *file = fopen(name, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("old", file);
    (void)fclose(file);
}

static void expect_text(const char *name, const char *expected) {
    char *text = tl_test_read_text(name);
    TEST_ASSERT_NOT_NULL(text);
    TEST_ASSERT_EQUAL_STRING(expected, text);
    free(text);
}

static void begin(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_new_file_open(path, &made, &error));
    (void)fputs("new", made.file);
}

static void keep(void) {
    begin();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_new_file_keep(&made, &error));
}

static void expect_refused(tl_status status, const char *parts) {
    TEST_ASSERT_EQUAL_INT(status, tl_new_file_open(path, &made, &error));
    TL_EXPECT_PARTS(parts, error.text);
    TEST_ASSERT_NULL(made.file);
}

/* Afterwards the folder holds the new file only. */
static void expect_kept(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_new_file_keep(&made, &error));
    expect_text(path, "new");
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&scratch));
}

static void test_it_appears_at_the_end(void) {
    begin();
    TEST_ASSERT_NOT_EQUAL_INT(0, access(path, F_OK));
    expect_kept();
}

static void test_the_old_file_stays_until_then(void) {
    write_old(path);
    begin();
    expect_text(path, "old");
    expect_kept();
}

static void test_a_discarded_file_leaves_nothing(void) {
    write_old(path);
    begin();
    tl_new_file_discard(&made);
    tl_new_file_discard(&made);
    expect_text(path, "old");
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&scratch));
}

static void test_permissions_are_kept(void) {
    struct stat status;
    write_old(path);
    TEST_ASSERT_EQUAL_INT(0, chmod(path, 0640));
    keep();
    TEST_ASSERT_EQUAL_INT(0, stat(path, &status));
    TEST_ASSERT_EQUAL_INT(0640, status.st_mode & 07777);
}

static void test_a_new_one_has_the_usual_permissions(void) {
    struct stat status;
    mode_t mask = umask(027);
    keep();
    (void)umask(mask);
    TEST_ASSERT_EQUAL_INT(0, stat(path, &status));
    TEST_ASSERT_EQUAL_INT(0640, status.st_mode & 07777);
}

static void test_a_link_is_followed(void) {
    struct stat status;
    write_old(other);
    TEST_ASSERT_EQUAL_INT(0, symlink("other", path));
    keep();
    expect_text(other, "new");
    TEST_ASSERT_EQUAL_INT(0, lstat(path, &status));
    TEST_ASSERT_TRUE(S_ISLNK(status.st_mode));
}

static void test_a_link_that_leads_nowhere_is_left(void) {
    TEST_ASSERT_EQUAL_INT(0, symlink("nowhere", path));
    expect_refused(TL_BAD_DATA, "report.html|symbolic link");
}

static void test_a_folder_and_a_fifo_are_left(void) {
    TEST_ASSERT_EQUAL_INT(0, mkfifo(path, 0600));
    expect_refused(TL_BAD_DATA, "report.html|file");
    (void)snprintf(path, sizeof path, "%s", scratch.folder);
    expect_refused(TL_BAD_DATA, "file");
    TL_EXPECT_PARTS(scratch.folder, error.text);
}

static void test_a_folder_that_is_not_there(void) {
    (void)snprintf(path, sizeof path, "/nowhere/report.html");
    expect_refused(TL_TRY_AGAIN, "/nowhere/report.html|No such file");
}

static void test_no_name(void) {
    path[0] = '\0';
    expect_refused(TL_BAD_USAGE, "empty|name");
}

static void test_standard_output(void) {
    (void)snprintf(path, sizeof path, "-");
    expect_refused(TL_BAD_USAGE, "standard output");
}

static void test_a_name_that_is_too_long(void) {
    memset(path, 'x', sizeof path - 2);
    path[0] = '/';
    path[sizeof path - 2] = '\0';
    expect_refused(TL_TRY_AGAIN, "File name too long");
}

static void test_a_full_disk(void) {
    struct rlimit original;
    write_old(path);
    (void)signal(SIGXFSZ, SIG_IGN);
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_FSIZE, &original));
    struct rlimit small = {1000, original.rlim_max};
    begin();
    for (int i = 0; i < 1000; i++) {
        (void)fputs("more than fits into the limit\n", made.file);
    }
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &small));
    tl_status status = tl_new_file_keep(&made, &error);
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_FSIZE, &original));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
    TL_EXPECT_PARTS("report.html|File too large", error.text);
    expect_text(path, "old");
    TEST_ASSERT_EQUAL_INT(1, tl_scratch_count(&scratch));
}

/* Meanwhile the target has become a folder. */
static void test_a_folder_in_place_of_the_target(void) {
    begin();
    TEST_ASSERT_EQUAL_INT(0, mkdir(path, 0700));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_new_file_keep(&made, &error));
    TL_EXPECT_PARTS("report.html|Is a directory", error.text);
    TEST_ASSERT_EQUAL_INT(0, rmdir(path));
    TEST_ASSERT_EQUAL_INT(0, tl_scratch_count(&scratch));
}

static void test_one_file_by_two_names(void) {
    write_old(path);
    TEST_ASSERT_TRUE(tl_new_file_would_replace("nowhere", "nowhere"));
    TEST_ASSERT_FALSE(tl_new_file_would_replace(path, other));
    TEST_ASSERT_EQUAL_INT(0, symlink(path, other));
    TEST_ASSERT_TRUE(tl_new_file_would_replace(path, other));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_new_file");
    UNITY_BEGIN();
    RUN_TEST(test_it_appears_at_the_end);
    RUN_TEST(test_the_old_file_stays_until_then);
    RUN_TEST(test_a_discarded_file_leaves_nothing);
    RUN_TEST(test_permissions_are_kept);
    RUN_TEST(test_a_new_one_has_the_usual_permissions);
    RUN_TEST(test_a_link_is_followed);
    RUN_TEST(test_a_link_that_leads_nowhere_is_left);
    RUN_TEST(test_a_folder_and_a_fifo_are_left);
    RUN_TEST(test_a_folder_that_is_not_there);
    RUN_TEST(test_no_name);
    RUN_TEST(test_standard_output);
    RUN_TEST(test_a_name_that_is_too_long);
    RUN_TEST(test_a_full_disk);
    RUN_TEST(test_a_folder_in_place_of_the_target);
    RUN_TEST(test_one_file_by_two_names);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
