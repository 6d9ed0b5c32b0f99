/* Identity of files: equal by name and by descriptor. A digest from another process is checked. */
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/identity.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static char paths[2][4096];
static const char *const both[] = {paths[0], paths[1]};

static void write_file(const char *path, const char *text) {
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(fputs(text, file) >= 0 && fclose(file) == 0);
}

void setUp(void) {
    (void)snprintf(paths[0], sizeof paths[0], "%s", tl_scratch_path(&scratch, "one"));
    (void)snprintf(paths[1], sizeof paths[1], "%s", tl_scratch_path(&scratch, "two"));
    write_file(paths[0], "one");
    write_file(paths[1], "two");
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

/* The digest covers the digests of the files, in this order. */
static void files_have_a_digest(void) {
    char text[TL_SHA256_TEXT];
    char right[TL_SHA256_TEXT];
    char each[2][TL_SHA256_TEXT];
    tl_sha256("one", 3, each[0]);
    tl_sha256("two", 3, each[1]);
    tl_sha256(each, sizeof each, right);
    tl_identity_files(both, 2, text);
    TEST_ASSERT_EQUAL_STRING(right, text);
    TEST_ASSERT_TRUE(tl_identity_is_sound(text));
}

/* The digest is that of the open file, also after its name was replaced. The read position is
 * kept. */
static void open_files_have_the_same(void) {
    char text[TL_SHA256_TEXT];
    char right[TL_SHA256_TEXT];
    int descriptors[2];
    char letter = 0;
    tl_identity_files(both, 2, right);
    for (int i = 0; i < 2; i++) {
        descriptors[i] = open(paths[i], O_RDONLY | O_CLOEXEC);
        TEST_ASSERT_EQUAL_INT(1, read(descriptors[i], &letter, 1));
    }
    TEST_ASSERT_EQUAL_INT(0, unlink(paths[0]));
    write_file(paths[0], "another one");
    tl_identity_open_files(descriptors, 2, text);
    TEST_ASSERT_EQUAL_STRING(right, text);
    TEST_ASSERT_EQUAL_INT(1, read(descriptors[0], &letter, 1));
    TEST_ASSERT_EQUAL_INT('n', letter);
    tl_identity_files(both, 2, text);
    TEST_ASSERT_TRUE(strcmp(right, text) != 0);
    TEST_ASSERT_EQUAL_INT(0, close(descriptors[0]) + close(descriptors[1]));
}

/* A reopened file has the same number. A replaced or changed file has another one. */
static void open_files_have_a_number(void) {
    uint64_t numbers[3];
    for (int i = 0; i < 3; i++) {
        int descriptors[2] = {open(paths[0], O_RDONLY | O_CLOEXEC), open(paths[1], O_RDONLY | O_CLOEXEC)};
        numbers[i] = tl_identity_number_of_open_files(descriptors, 2);
        TEST_ASSERT_EQUAL_INT(0, close(descriptors[0]) + close(descriptors[1]));
        if (i == 1) {
            write_file(paths[1], "longer");
        }
    }
    TEST_ASSERT_TRUE(numbers[0] != 0 && numbers[0] == numbers[1] && numbers[1] != numbers[2]);
    const int none[1] = {-1};
    TEST_ASSERT_TRUE(tl_identity_number_of_open_files(none, 1) != 0);
}

static void one_that_cannot_be_read_makes_it_none(void) {
    char text[TL_SHA256_TEXT] = "before";
    TEST_ASSERT_EQUAL_INT(0, unlink(paths[1]));
    tl_identity_files(both, 2, text);
    TEST_ASSERT_EQUAL_STRING("", text);
    TEST_ASSERT_TRUE(tl_identity_is_sound(text));
    write_file(paths[1], "");
    tl_identity_files(both, 2, text);
    TEST_ASSERT_EQUAL_STRING("", text);
}

static void what_is_no_digest(void) {
    char text[TL_SHA256_TEXT];
    memset(text, 'a', sizeof text);
    TEST_ASSERT_FALSE(tl_identity_is_sound(text)); /* not terminated */
    text[TL_SHA256_TEXT - 1] = '\0';
    TEST_ASSERT_TRUE(tl_identity_is_sound(text));
    text[5] = 'A';
    TEST_ASSERT_FALSE(tl_identity_is_sound(text));
    text[5] = '\0';
    TEST_ASSERT_FALSE(tl_identity_is_sound(text));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_identity");
    UNITY_BEGIN();
    RUN_TEST(files_have_a_digest);
    RUN_TEST(open_files_have_the_same);
    RUN_TEST(open_files_have_a_number);
    RUN_TEST(one_that_cannot_be_read_makes_it_none);
    RUN_TEST(what_is_no_digest);
    return tl_scratch_finish(&scratch, UNITY_END());
}
