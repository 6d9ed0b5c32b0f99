/* The numbers of a plan: a number in range passes; one out of range is one problem with its path
 * and value. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "master/plan/plan.h"
#include "tests/support/message.h"

enum { WORDS = 512 };

static tl_plan_adjust adjust[2];
static tl_plan_match match[2];
static tl_plan plan;
static char found_where[64];
static char found_text[WORDS];

static void keep(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    (void)strncpy(found_where, where, sizeof found_where - 1);
    (void)strncpy(found_text, text, sizeof found_text - 1);
}

/* A valid plan. */
void setUp(void) {
    adjust[0] = (tl_plan_adjust){.where = "adjust.first", .step = 1.0, .lower = -HUGE_VAL, .upper = HUGE_VAL};
    adjust[1] = adjust[0];
    adjust[1].where = "adjust.second";
    match[0] = (tl_plan_match){.where = "match.first", .tolerance = 0.5, .weight = 1.0};
    match[1] = match[0];
    match[1].where = "match.second";
    plan = (tl_plan){.step = TL_SECOND, .adjust = adjust, .adjust_count = 2, .match = match, .match_count = 2};
    memset(found_where, 0, sizeof found_where);
    memset(found_text, 0, sizeof found_text);
}

void tearDown(void) {}

/* Checks the plan and returns the number of problems. With these problems a build is still
 * possible. */
static size_t problems(void) {
    tl_report report = {.add = keep};
    TEST_ASSERT_TRUE(tl_plan_check(&plan, &report));
    return report.count;
}

static void expect_none(void) {
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(0, problems(), found_text);
}

/* Exactly one problem. */
static void expect_problem(const char *where, const char *parts) {
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(1, problems(), found_text);
    TEST_ASSERT_EQUAL_STRING(where, found_where);
    TL_EXPECT_PARTS(parts, found_text);
}

/* The number must be 0 or more, and finite. */
static void expect_from_zero(double *number, const char *where, const char *parts) {
    static const double right[] = {-0.0, 0.0, 4.9e-324, 1.0, 1e300};
    static const double wrong[] = {-4.9e-324, -1.0, -HUGE_VAL, HUGE_VAL, (double)NAN};
    for (size_t i = 0; i < sizeof right / sizeof *right; i++) {
        *number = right[i];
        expect_none();
    }
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        char all[64];
        *number = wrong[i];
        (void)snprintf(all, sizeof all, "%s|%g|0", parts, wrong[i]);
        expect_problem(where, all);
    }
    *number = 0.0;
}

static void a_plan_of_ordinary_numbers_passes(void) {
    expect_none();
    adjust[0].deviation_penalty = 0.1;
    adjust[0].rate_penalty = 2.0;
    adjust[1].dwell = TL_SECOND;
    match[0].huber = 3.0;
    plan.noise_floor = 0.05;
    plan.shape = TL_DYNAMIC;
    plan.measurements = TL_HOLD;
    plan.evaluations = UINT32_MAX;
    plan.saving = (tl_plan_saving){.structure = true, .sequences = true, .nodes = UINT32_MAX};
    expect_none();
}

static void an_approved_correction_is_finite(void) {
    adjust[1].approved = -3.5;
    expect_none();
    adjust[1].approved = (double)NAN;
    expect_problem("adjust.second", "\"approved\"|nan");
}

static void penalties_are_numbers_from_zero(void) {
    expect_from_zero(&adjust[1].deviation_penalty, "adjust.second", "\"penalty\"|deviation");
    expect_from_zero(&adjust[0].rate_penalty, "adjust.first", "\"penalty\"|rate");
    adjust[0].rate_penalty = -0.25;
    expect_problem("adjust.first", "\"penalty\"|rate|-0.25|0");
}

static void a_dwell_is_a_time_from_zero(void) {
    adjust[1].dwell = INT64_MAX;
    expect_none();
    adjust[1].dwell = -TL_SECOND / 2;
    expect_problem("adjust.second", "\"dwell_s\"|-0.5 s|0");
    adjust[1].dwell = -1;
    TEST_ASSERT_EQUAL_UINT64(1, problems());
}

static void a_huber_limit_is_a_number_from_zero(void) {
    expect_from_zero(&match[1].huber, "match.second", "\"huber\"");
    match[1].huber = -3.0;
    expect_problem("match.second", "\"huber\"|-3|0");
}

static void a_weight_is_a_number_from_zero(void) {
    expect_from_zero(&match[0].weight, "match.first", "\"weight\"");
}

static void a_noise_floor_is_a_number_from_zero(void) {
    expect_from_zero(&plan.noise_floor, "synchronise.noise_floor", "noise floor");
    plan.noise_floor = -0.05;
    expect_problem("synchronise.noise_floor", "noise floor|-0.05|0");
}

static void a_margin_is_below_one(void) {
    plan.margin = 1.0;
    expect_problem("synchronise.margin", "margin|0|1");
}

static void choices_must_exist(void) {
    for (int i = 0; i <= TL_HOLD; i++) {
        plan.measurements = (tl_pairing)i;
        expect_none();
    }
    plan.measurements = (tl_pairing)(TL_HOLD + 1);
    expect_problem("synchronise.horizon.measurements", "3|0|2");
    plan.measurements = TL_LAG;
    plan.shape = (tl_shape)(TL_DYNAMIC + 1);
    expect_problem("synchronise.horizon.shape", "2|0|1");
    plan.shape = (tl_shape)-1;
    TEST_ASSERT_EQUAL_UINT64(1, problems());
}

static void every_problem_is_reported(void) {
    adjust[0].deviation_penalty = -1.0;
    adjust[0].rate_penalty = -1.0;
    adjust[1].dwell = -1;
    match[0].huber = -1.0;
    plan.noise_floor = -1.0;
    TEST_ASSERT_EQUAL_UINT64(5, problems());
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_plan_of_ordinary_numbers_passes);
    RUN_TEST(an_approved_correction_is_finite);
    RUN_TEST(penalties_are_numbers_from_zero);
    RUN_TEST(a_dwell_is_a_time_from_zero);
    RUN_TEST(a_huber_limit_is_a_number_from_zero);
    RUN_TEST(a_weight_is_a_number_from_zero);
    RUN_TEST(a_noise_floor_is_a_number_from_zero);
    RUN_TEST(a_margin_is_below_one);
    RUN_TEST(choices_must_exist);
    RUN_TEST(every_problem_is_reported);
    return UNITY_END();
}
