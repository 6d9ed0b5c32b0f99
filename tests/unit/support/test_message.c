/* A part is found as a whole word or number, at any position. */
#include <unity.h>

#include "tests/support/message.h"

#define TEXT "plant.level: 18.55 m is outside 0 \342\200\246 5, \"a b\" and -3."

void setUp(void) {}

void tearDown(void) {}

static void test_parts_that_are_there(void) {
    TL_EXPECT_PARTS("plant.level|18.55|0|5|-3", TEXT);
    TL_EXPECT_PARTS("\"a b\"|outside 0", TEXT);
}

static void test_parts_that_are_not(void) {
    static const char *const others[] = {"18", "55", "8.55", "plant", "level", "3", "out", "plant.level|6", "||", ""};
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(tl_test_has_parts(TEXT, others[i]), others[i]);
    }
    TEST_ASSERT_FALSE(tl_test_has_parts("", ""));
    TEST_ASSERT_FALSE(tl_test_has_parts(NULL, "a"));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_parts_that_are_there);
    RUN_TEST(test_parts_that_are_not);
    return UNITY_END();
}
