/* Resolved path of a database: the same before and after its creation. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/store/database.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, chdir(scratch.folder));
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

static void expect_same(const char *given) {
    char before[PATH_MAX];
    char after[PATH_MAX];
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_database_resolve(given, before, NULL));
    FILE *file = fopen(given, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fclose(file);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_database_resolve(given, after, NULL));
    TEST_ASSERT_EQUAL_STRING(after, before);
    TEST_ASSERT_EQUAL_INT('/', before[0]);
    TEST_ASSERT_EQUAL_INT(0, unlink(given));
}

/* A successor must find the file that its predecessor has created. */
static void test_same_path_before_and_after_creation(void) {
    TEST_ASSERT_EQUAL_INT(0, symlink(".", "link"));
    expect_same("run.db");
    expect_same("./run.db");
    expect_same("link/run.db");
    expect_same(tl_scratch_path(&scratch, "link/run.db"));
    TEST_ASSERT_EQUAL_INT(0, unlink("link"));
}

static void test_a_missing_folder(void) {
    char path[PATH_MAX];
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_database_resolve("nowhere/run.db", path, &error));
    TEST_ASSERT_EQUAL_STRING("", path);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "database_place");
    UNITY_BEGIN();
    RUN_TEST(test_same_path_before_and_after_creation);
    RUN_TEST(test_a_missing_folder);
    return tl_scratch_finish(&scratch, UNITY_END());
}
