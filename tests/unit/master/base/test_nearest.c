/* The known name nearest to a misspelled one. */
#include <string.h>

#include <unity.h>

#include "master/base/text.h"

void setUp(void) {}

void tearDown(void) {}

static void expect_distance(const char *text, const char *candidate, size_t distance) {
    tl_nearest nearest = {.text = text};
    tl_nearest_offer(&nearest, candidate);
    TEST_ASSERT_NOT_NULL_MESSAGE(nearest.best, text);
    TEST_ASSERT_EQUAL_STRING(candidate, nearest.best);
    TEST_ASSERT_EQUAL_size_t(distance, nearest.distance);
}

static void expect_far(const char *text, const char *candidate) {
    tl_nearest nearest = {.text = text};
    tl_nearest_offer(&nearest, candidate);
    TEST_ASSERT_NULL_MESSAGE(nearest.best, text);
}

static void test_one_edit(void) {
    expect_distance("name", "name", 0);
    expect_distance("NAME", "name", 0);
    expect_distance("Zone_az", "zONE_AZ", 0);
    expect_distance("nam", "name", 1);
    expect_distance("ame", "name", 1);
    expect_distance("names", "name", 1);
    expect_distance("xname", "name", 1);
    expect_distance("nome", "name", 1);
    expect_distance("anme", "name", 1);
    expect_distance("naem", "name", 1);
    expect_distance("nMae", "name", 1);
}

static void test_two_edits(void) {
    expect_distance("tolrnce", "tolerance", 2);
    expect_distance("xtolerancex", "tolerance", 2);
    expect_distance("otleranec", "tolerance", 2);
    expect_distance("toterance", "tolerance", 1);
}

static void test_too_far(void) {
    expect_far("toxxxance", "tolerance");
    expect_far("tolera", "tolerance");
    expect_far("tolerancexyz", "tolerance");
    expect_far("time", "file"); /* 2 of 4 characters differ */
    expect_far("mix", "me");
    expect_far("x", "to");
    expect_far("", "");
}

static void test_the_nearest_of_several(void) {
    static const char *const candidates[] = {"sources", "source_", "source", "sourse"};
    tl_nearest nearest = {.text = "sorce"};
    for (size_t i = 0; i < 4; i++) {
        tl_nearest_offer(&nearest, candidates[i]);
    }
    TEST_ASSERT_EQUAL_STRING("source", nearest.best);
    TEST_ASSERT_EQUAL_size_t(1, nearest.distance);
}

static void test_long_names(void) {
    char a[80];
    char b[80];
    memset(a, 'a', sizeof a);
    memset(b, 'a', sizeof b);
    a[63] = '\0';
    b[63] = '\0';
    b[62] = 'b';
    expect_distance(a, b, 1);
    a[63] = 'a';
    a[64] = '\0';
    expect_far(a, b);
    expect_far(b, a);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_one_edit);
    RUN_TEST(test_two_edits);
    RUN_TEST(test_too_far);
    RUN_TEST(test_the_nearest_of_several);
    RUN_TEST(test_long_names);
    return UNITY_END();
}
