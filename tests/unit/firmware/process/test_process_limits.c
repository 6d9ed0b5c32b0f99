/* Raising of limits, as far as permitted. test_confine.c tests limits that a process sets for
 * itself. */
#include <sys/resource.h>

#include <unity.h>

#include "firmware/process/confine.h"

enum { SOFT = 20, BETWEEN = 30 };

static struct rlimit before;

/* Sets a soft limit that no test reaches otherwise. */
void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &before));
    const struct rlimit soft = {.rlim_cur = SOFT, .rlim_max = before.rlim_max};
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &soft));
}

void tearDown(void) {
    TEST_ASSERT_EQUAL_INT(0, setrlimit(RLIMIT_NOFILE, &before));
}

static struct rlimit now(void) {
    struct rlimit limit;
    TEST_ASSERT_EQUAL_INT(0, getrlimit(RLIMIT_NOFILE, &limit));
    return limit;
}

static void test_as_much_as_is_wanted(void) {
    tl_process_limits_permit(RLIMIT_NOFILE, BETWEEN);
    TEST_ASSERT_EQUAL_UINT64(BETWEEN, now().rlim_cur);
    TEST_ASSERT_EQUAL_UINT64(before.rlim_max, now().rlim_max);
}

static void test_never_less(void) {
    tl_process_limits_permit(RLIMIT_NOFILE, SOFT - 1);
    TEST_ASSERT_EQUAL_UINT64(SOFT, now().rlim_cur);
}

/* More than the hard limit. */
static void test_as_much_as_there_is(void) {
    tl_process_limits_permit(RLIMIT_NOFILE, RLIM_INFINITY);
    TEST_ASSERT_EQUAL_UINT64(before.rlim_max, now().rlim_cur);
    TEST_ASSERT_EQUAL_UINT64(before.rlim_max, now().rlim_max);
}

static void test_what_is_no_resource(void) {
    tl_process_limits_permit(10000, 1);
    TEST_ASSERT_EQUAL_UINT64(SOFT, now().rlim_cur);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_as_much_as_is_wanted);
    RUN_TEST(test_never_less);
    RUN_TEST(test_as_much_as_there_is);
    RUN_TEST(test_what_is_no_resource);
    return UNITY_END();
}
