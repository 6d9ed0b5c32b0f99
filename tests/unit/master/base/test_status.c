/* Errors with texts, reports of several problems, exit codes, signal types and times. */
#include <string.h>
#include <unity.h>

#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

void setUp(void) {}

void tearDown(void) {}

static void a_failure_has_a_status_and_a_text(void) {
    tl_error error = {TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_fail(&error, TL_BAD_DATA, "%s is %d", "motor.J", 7));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, error.status);
    TEST_ASSERT_EQUAL_STRING("motor.J is 7", error.text);
}

static void a_failure_may_have_nowhere_to_go(void) {
    TEST_ASSERT_EQUAL_INT(TL_FMU_FATAL, tl_fail(NULL, TL_FMU_FATAL, "%s", "gone"));
}

static void a_long_text_is_cut_not_overrun(void) {
    char longer[2 * TL_ERROR_TEXT];
    memset(longer, 'x', sizeof longer - 1);
    longer[sizeof longer - 1] = '\0';
    tl_error error;
    (void)tl_fail(&error, TL_BAD_DATA, "%s", longer);
    TEST_ASSERT_EQUAL_UINT64(TL_ERROR_TEXT - 1, strlen(error.text));
}

typedef struct kept {
    size_t count;
    tl_status status;
    char where[32];
    char text[TL_ERROR_TEXT];
} kept;

static void keep(void *context, tl_status status, const char *where, const char *text) {
    kept *last = context;
    last->count++;
    last->status = status;
    (void)strncpy(last->where, where, sizeof last->where - 1);
    (void)strncpy(last->text, text, sizeof last->text - 1);
}

static void a_report_takes_every_problem_and_remembers_the_first_status(void) {
    kept last = {0};
    tl_report report = {.add = keep, .context = &last};
    TEST_ASSERT_EQUAL_INT(TL_OK, report.first_status);
    tl_report_add(&report, TL_BAD_DATA, "connect[2][0]", "found %s", "\"x\"");
    TEST_ASSERT_EQUAL_STRING("connect[2][0]", last.where);
    TEST_ASSERT_EQUAL_STRING("found \"x\"", last.text);
    tl_report_add(&report, TL_TRY_AGAIN, NULL, "no memory");
    TEST_ASSERT_EQUAL_STRING("", last.where);
    TEST_ASSERT_EQUAL_UINT64(2, last.count);
    TEST_ASSERT_EQUAL_UINT64(2, report.count);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, last.status);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, report.first_status);
}

static void a_report_may_only_count(void) {
    tl_report report = {0};
    tl_report_add(&report, TL_BAD_DATA, "x", "y");
    TEST_ASSERT_EQUAL_UINT64(1, report.count);
}

static void exit_codes_are_those_of_the_manual(void) {
    TEST_ASSERT_EQUAL_INT(0, tl_exit_code(TL_OK));
    TEST_ASSERT_EQUAL_INT(2, tl_exit_code(TL_BAD_USAGE));
    TEST_ASSERT_EQUAL_INT(65, tl_exit_code(TL_BAD_DATA));
    TEST_ASSERT_EQUAL_INT(69, tl_exit_code(TL_PLANT_DOWN));
    TEST_ASSERT_EQUAL_INT(70, tl_exit_code(TL_FMU_FAILED));
    TEST_ASSERT_EQUAL_INT(70, tl_exit_code(TL_FMU_FATAL));
    TEST_ASSERT_EQUAL_INT(75, tl_exit_code(TL_TRY_AGAIN));
    TEST_ASSERT_EQUAL_INT(75, tl_exit_code(TL_INTERRUPTED));
}

static void qualities_and_types_have_names(void) {
    TEST_ASSERT_EQUAL_STRING("good", tl_quality_name(TL_GOOD));
    TEST_ASSERT_EQUAL_STRING("stale", tl_quality_name(TL_STALE));
    TEST_ASSERT_EQUAL_STRING("out of range", tl_quality_name(TL_OUT_OF_RANGE));
    TEST_ASSERT_EQUAL_STRING("not a number", tl_quality_name(TL_NOT_A_NUMBER));
    TEST_ASSERT_EQUAL_STRING("no link", tl_quality_name(TL_NO_LINK));
    TEST_ASSERT_EQUAL_STRING("outlier", tl_quality_name(TL_OUTLIER));
    TEST_ASSERT_EQUAL_STRING("frozen", tl_quality_name(TL_FROZEN));
    TEST_ASSERT_EQUAL_STRING("Real", tl_type_name(TL_REAL));
    TEST_ASSERT_EQUAL_STRING("Integer", tl_type_name(TL_INTEGER));
    TEST_ASSERT_EQUAL_STRING("Boolean", tl_type_name(TL_BOOLEAN));
    TEST_ASSERT_EQUAL_STRING("String", tl_type_name(TL_STRING));
    TEST_ASSERT_EQUAL_STRING("Enumeration", tl_type_name(TL_ENUMERATION));
}

static void an_instant_is_computed_from_its_index(void) {
    tl_time step = tl_time_of_seconds(0.1); /* a whole number of ns, not a double */
    TEST_ASSERT_EQUAL_INT64(100000000, step);
    TEST_ASSERT_EQUAL_INT64(5 + 100000000 * INT64_C(31536000000), tl_time_of_step(5, step, INT64_C(31536000000)));
    TEST_ASSERT_TRUE(tl_seconds(tl_time_of_step(0, step, 3)) == 0.3);
    TEST_ASSERT_EQUAL_INT64(-1500000000, tl_time_of_seconds(-1.5));
}

/* A database may contain any stamp. */
static void test_the_age_of_a_reading(void) {
    static tl_sample sample = {.instant = 1000};
    sample.stamps[0] = TL_TIME_NEVER;
    sample.stamps[1] = 400;
    sample.stamps[2] = 2000;
    sample.stamps[3] = INT64_MIN + 1;
    TEST_ASSERT_EQUAL_INT64(0, tl_sample_age(&sample, 0));
    TEST_ASSERT_EQUAL_INT64(600, tl_sample_age(&sample, 1));
    TEST_ASSERT_EQUAL_INT64(0, tl_sample_age(&sample, 2));
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_sample_age(&sample, 3));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_failure_has_a_status_and_a_text);
    RUN_TEST(a_failure_may_have_nowhere_to_go);
    RUN_TEST(a_long_text_is_cut_not_overrun);
    RUN_TEST(a_report_takes_every_problem_and_remembers_the_first_status);
    RUN_TEST(a_report_may_only_count);
    RUN_TEST(exit_codes_are_those_of_the_manual);
    RUN_TEST(qualities_and_types_have_names);
    RUN_TEST(an_instant_is_computed_from_its_index);
    RUN_TEST(test_the_age_of_a_reading);
    return UNITY_END();
}
