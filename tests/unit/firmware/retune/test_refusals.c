/* Refused candidates: their records, the limit of their number, damaged files and disk errors. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/retune/versions.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static tl_versions versions;
static tl_refused_changes refusals;
static tl_error error;

void setUp(void) {
    tl_scratch_empty(&scratch);
    versions = (tl_versions){.count = 0};
    (void)snprintf(versions.folder, sizeof versions.folder, "%s", scratch.folder);
    tl_refused_changes_open(&refusals, &versions);
}

void tearDown(void) {}

static tl_status add(const char *who, const char *reason) {
    tl_control_request candidate;
    memset(&candidate, 0, sizeof candidate);
    tl_sha256(reason, strlen(reason), candidate.hash);
    candidate.origin = TL_ORIGIN_LIMITED;
    (void)snprintf(candidate.who, sizeof candidate.who, "%s", who);
    (void)snprintf(candidate.why, sizeof candidate.why, "a new seal");
    return tl_refused_changes_add(&refusals, &candidate, "refused", reason, &error);
}

static void test_there_is_none(void) {
    TEST_ASSERT_EQUAL_size_t(0, refusals.count);
}

static void test_one(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, add("ann\033", "2 problems"), error.text);
    for (int i = 0; i < 2; i++) { /* in memory, then read from disk */
        TEST_ASSERT_EQUAL_size_t(1, refusals.count);
        TEST_ASSERT_EQUAL_UINT64(1, refusals.list[0].version);
        TEST_ASSERT_EQUAL_size_t(TL_SHA256_TEXT - 1, strlen(refusals.list[0].hash));
        TEST_ASSERT_EQUAL_STRING("limited", refusals.list[0].origin);
        TEST_ASSERT_EQUAL_STRING("refused: 2 problems", refusals.list[0].result);
        TEST_ASSERT_NULL(strchr(refusals.list[0].who, '\033'));
        TEST_ASSERT_EQUAL_STRING("a new seal", refusals.list[0].why);
        TEST_ASSERT_NOT_EQUAL_INT(0, refusals.list[0].at[0]);
        tl_refused_changes_open(&refusals, &versions);
    }
}

static void test_only_the_newest(void) {
    char reason[32];
    for (int i = 1; i <= TL_REFUSED_CHANGES_MOST + 7; i++) {
        (void)snprintf(reason, sizeof reason, "problem %d", i);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, add("ann", reason), error.text);
    }
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_size_t(TL_REFUSED_CHANGES_MOST, refusals.count);
        TEST_ASSERT_EQUAL_STRING("refused: problem 8", refusals.list[0].result);
        TEST_ASSERT_EQUAL_STRING("refused: problem 27", refusals.list[TL_REFUSED_CHANGES_MOST - 1].result);
        tl_refused_changes_open(&refusals, &versions);
    }
}

static void write_file(const char *name, const char *text) {
    char path[PATH_MAX + 32];
    (void)snprintf(path, sizeof path, "%s/%s", scratch.folder, name);
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs(text, file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

/* Damaged files are skipped. The next record gets the number after the existing ones. */
static void test_what_is_damaged(void) {
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, add("ann", "2 problems"), error.text);
    }
    write_file("refused-1.json", "{\"number\": 1");
    write_file("refused-2.json", "{\"number\": 99}");
    write_file("refused-19.json",
               "{\"number\": 5, \"hash\": \"\", \"origin\": \"\", \"result\": \"\", \"who\": \"\", \"why\": \"\","
               " \"reason\": \"\", \"at\": \"\"}"); /* number and name differ */
    tl_refused_changes_open(&refusals, &versions);
    TEST_ASSERT_EQUAL_size_t(2, refusals.count);
    TEST_ASSERT_EQUAL_UINT64(3, refusals.list[0].version);
    TEST_ASSERT_EQUAL_UINT64(4, refusals.list[1].version);
    TEST_ASSERT_EQUAL_INT(TL_OK, add("ann", "3 problems"));
    TEST_ASSERT_EQUAL_UINT64(5, refusals.list[2].version);
}

static void test_a_disk_that_refuses(void) {
    (void)snprintf(refusals.folder, sizeof refusals.folder, "%.*s/nowhere", PATH_MAX - 16, scratch.folder);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, add("ann", "2 problems"));
    TEST_ASSERT_EQUAL_size_t(1, refusals.count); /* in memory only */
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "refusals");
    UNITY_BEGIN();
    RUN_TEST(test_there_is_none);
    RUN_TEST(test_one);
    RUN_TEST(test_only_the_newest);
    RUN_TEST(test_what_is_damaged);
    RUN_TEST(test_a_disk_that_refuses);
    return tl_scratch_finish(&scratch, UNITY_END());
}
