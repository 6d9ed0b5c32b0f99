/* After a case that fails or is ignored, tearDown() runs to its end. */
#include <unity.h>

static int torn_down;

void setUp(void) {}

void tearDown(void) {
    TEST_ASSERT_EQUAL_STRING("", ""); /* Unity's own runner leaves here */
    torn_down++;
}

static void fails(void) {
    TEST_FAIL_MESSAGE("on purpose");
}

static void is_ignored(void) {
    TEST_IGNORE_MESSAGE("on purpose");
}

static void test_all_were_torn_down(void) {
    TEST_ASSERT_EQUAL_INT(2, torn_down);
    TEST_ASSERT_EQUAL_INT(1, Unity.TestFailures);
    TEST_ASSERT_EQUAL_INT(1, Unity.TestIgnores);
    Unity.TestFailures = 0;
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(fails);
    RUN_TEST(is_ignored);
    RUN_TEST(test_all_were_torn_down);
    return UNITY_END();
}
