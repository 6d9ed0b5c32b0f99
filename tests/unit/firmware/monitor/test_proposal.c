/* Proposals from a survey: each rule, its reason, and what a pairing mode or a type excludes. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/cli/emulation.h"
#include "firmware/monitor/proposal.h"
#include "tests/support/message.h"

enum { TORQUE, OMEGA, COUNT = 1000 };

static tl_config_signal signals[2];
static tl_plan_match match;
static tl_config config;
static tl_survey survey;
static tl_proposal proposal;
static tl_noise_point points[COUNT];

static tl_survey_signal *omega(void) {
    return &survey.signals[OMEGA];
}

static tl_survey_signal *torque(void) {
    return &survey.signals[TORQUE];
}

/* A plant that oscillates by `amplitude` at 1 Hz, read each 30 ms. */
static void make(double amplitude) {
    tl_random noise = {.state = 1};
    for (int i = 0; i < COUNT; i++) {
        points[i].stamp = i * (3 * TL_SECOND / 100);
        points[i].value = amplitude * sin(6.2831853 * tl_seconds(points[i].stamp)) + 0.1 * tl_random_normal(&noise);
    }
}

void setUp(void) {
    memset(&survey, 0, sizeof survey);
    signals[TORQUE] = (tl_config_signal){.plan = {.name = "torque", .unit = "N.m"}, .of = TORQUE, .feeds = true};
    signals[OMEGA] = (tl_config_signal){.plan = {.name = "omega", .unit = "rad/s"}, .of = OMEGA, .is_matched = true};
    match =
        (tl_plan_match){.where = "", .variable = "motor.omega", .to = "plant.omega", .tolerance = 0.1, .weight = 1.0};
    config = (tl_config){.signals = signals,
                         .signal_count = 2,
                         .match = &match,
                         .match_count = 1,
                         .synchronise = true,
                         .step = TL_SECOND / 100,
                         .measurements = TL_LAG};
    survey.count = 2;
    for (size_t i = 0; i < 2; i++) {
        survey.signals[i] = (tl_survey_signal){.good = COUNT,
                                               .median = 3 * TL_SECOND / 100,
                                               .most = 3 * TL_SECOND / 100,
                                               .rare = 4 * TL_SECOND / 100,
                                               .worst = TL_SECOND,
                                               .sigma = 0.1,
                                               .jump = 0.5,
                                               .noise = {.count = COUNT, .sigma = 0.1, .is_enough = true}};
    }
    make(0.0);
    omega()->kept = points;
    omega()->kept_count = COUNT;
}

void tearDown(void) {}

static const tl_proposal_match *propose(void) {
    tl_proposal_make(&config, &survey, &proposal);
    return &proposal.match[0];
}

static void expect_reason(const tl_proposal_reason *reason, const char *parts) {
    TL_EXPECT_PARTS(parts, reason->text);
}

static void test_readings_rarer_than_steps(void) {
    const tl_proposal_match *made = propose();
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LINE, made->between);
    expect_reason(&made->why_between, "0.015 s|0.01 s");
    TEST_ASSERT_EQUAL_INT64(4 * TL_SECOND / 100, proposal.every[OMEGA]);
    TEST_ASSERT_EQUAL_INT64(0, proposal.every[TORQUE]);
}

static void test_a_reading_in_each_step(void) {
    make(100.0); /* so that no low-pass is proposed, which needs a line */
    omega()->median = omega()->most = omega()->rare = config.step;
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, propose()->between);
    expect_reason(&proposal.match[0].why_between, "reading|step");
    TEST_ASSERT_FALSE(tl_test_has_parts(proposal.match[0].why_between.text, "0.01 s"));
    TEST_ASSERT_EQUAL_INT64(0, proposal.every[OMEGA]);
}

/* A signal at rest is filtered. A fast signal, or one of unknown noise, is not. */
static void test_a_low_pass(void) {
    tl_time slow = propose()->condition.low_pass;
    TEST_ASSERT_TRUE(slow >= omega()->median && slow <= 5 * omega()->median / 2);
    char parts[32];
    (void)snprintf(parts, sizeof parts, "%g s|0.1", tl_seconds(slow));
    expect_reason(&proposal.match[0].why_condition, parts);
    make(2.0);
    tl_time faster = propose()->condition.low_pass;
    TEST_ASSERT_TRUE(faster > 0 && faster < slow);
    make(100.0);
    TEST_ASSERT_EQUAL_INT64(0, propose()->condition.low_pass);
    expect_reason(&proposal.match[0].why_condition, "low-pass|noise");
    make(0.0);
    omega()->noise.is_too_fast = true;
    TEST_ASSERT_EQUAL_INT64(0, propose()->condition.low_pass);
    expect_reason(&proposal.match[0].why_condition, "too fast");
    omega()->noise.is_too_fast = false;
    omega()->sigma = 0.0;
    TEST_ASSERT_EQUAL_INT64(0, propose()->condition.low_pass);
    expect_reason(&proposal.match[0].why_condition, "no noise");
}

/* A gate if the outliers exceed the jumps of the plant, else a median. One outlier is ignored. */
static void test_outliers(void) {
    omega()->outliers = 1;
    omega()->nearest = 20.0;
    TEST_ASSERT_FALSE(propose()->condition.gate > 0.0);
    omega()->outliers = 20;
    double gate = propose()->condition.gate;
    TEST_ASSERT_TRUE(gate > 3.9 && gate < 4.2); /* between 0.8 and 20 */
    TEST_ASSERT_EQUAL_UINT32(0, proposal.match[0].condition.median);
    expect_reason(&proposal.match[0].why_condition, "2 %|outliers|20");
    omega()->jump = 19.0;
    TEST_ASSERT_EQUAL_UINT32(5, propose()->condition.median);
    TEST_ASSERT_FALSE(proposal.match[0].condition.gate > 0.0);
    config.measurements = TL_AHEAD;
    TEST_ASSERT_EQUAL_UINT32(0, propose()->condition.median);
}

static void test_tolerances(void) {
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.3, propose()->tolerance);
    TEST_ASSERT_TRUE(proposal.match[0].is_within_noise);
    match.tolerance = 0.5;
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.5, propose()->tolerance);
    expect_reason(&proposal.match[0].why_tolerance, "5|noise|0.1");
    TEST_ASSERT_FALSE(proposal.match[0].is_within_noise);
    match.tolerance = 5.0;
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.3, propose()->tolerance);
    TEST_ASSERT_FALSE(proposal.match[0].is_within_noise);
    omega()->is_at_rest = true;
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 0.6, propose()->tolerance);
    expect_reason(&proposal.match[0].why_tolerance, "0.1|plant|5");
    config.has_epsilon = true;
    expect_reason(&propose()->why_tolerance, "epsilon");
    match.weight = 0.0;
    TEST_ASSERT_EQUAL_DOUBLE(0.0, propose()->tolerance);
    expect_reason(&proposal.match[0].why_tolerance, "compared");
    match.weight = 1.0;
    omega()->sigma = 0.0;
    TEST_ASSERT_EQUAL_DOUBLE(0.0, propose()->tolerance);
}

static void test_inputs(void) {
    torque()->move = 0.1;
    (void)propose();
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, proposal.inputs[TORQUE].between);
    expect_reason(&proposal.inputs[TORQUE].why, "0.1 N.m|noise|0.1");
    torque()->move = 1.0;
    (void)propose();
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_MEAN, proposal.inputs[TORQUE].between);
    TEST_ASSERT_EQUAL_INT64(4 * TL_SECOND / 100, proposal.every[TORQUE]);
    torque()->is_polled = true;
    (void)propose();
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, proposal.inputs[TORQUE].between);
    torque()->is_switched = true;
    (void)propose();
    expect_reason(&proposal.inputs[TORQUE].why, "values");
}

/* No condition that would have no effect is proposed. */
static void test_modes_and_types(void) {
    config.measurements = TL_HOLD;
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, propose()->between);
    TEST_ASSERT_TRUE(proposal.match[0].condition.low_pass > 0);
    config.measurements = TL_AHEAD;
    TEST_ASSERT_EQUAL_INT64(0, propose()->condition.low_pass);
    config.measurements = TL_LAG;
    signals[OMEGA].plan.type = TL_BOOLEAN;
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, propose()->between);
    TEST_ASSERT_FALSE(tl_condition_is_needed(&proposal.match[0].condition));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, proposal.match[0].tolerance);
    signals[OMEGA].plan.type = TL_REAL;
    omega()->rare = 100 * TL_SECOND;
    TEST_ASSERT_EQUAL_INT(TL_BETWEEN_LAST, propose()->between);
    expect_reason(&proposal.match[0].why_between, "rare|steps");
    omega()->rare = TL_SECOND / 50;
    config.event.start.signal = "plant.torque";
    TEST_ASSERT_FALSE(tl_condition_is_needed(&propose()->condition));
    config.event.start.signal = NULL;
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_readings_rarer_than_steps);
    RUN_TEST(test_a_reading_in_each_step);
    RUN_TEST(test_a_low_pass);
    RUN_TEST(test_outliers);
    RUN_TEST(test_tolerances);
    RUN_TEST(test_inputs);
    RUN_TEST(test_modes_and_types);
    return UNITY_END();
}
