/* J = Σ weight·((y − ŷ)/tolerance)² over what is good. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/sync/objective.h"
#include "tests/support/test_plan.h"

enum { SIGNAL_A, SIGNAL_B, SIGNAL_ON };
enum { TERM_A, TERM_B, TERM_ON, TERMS };

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_arena arena;
static tl_graph graph;
static tl_exchange exchange;
static tl_sample sample;
static tl_objective_term terms[TERMS];
static tl_objective objective;
static double *y; /* of the two Real terms */
static fmi2Boolean *on;

void setUp(void) {
    static const char *const variables[TERMS] = {"m.y0", "m.y1", "m.flag_out"};
    tl_error error;
    tl_arena_init(&arena);
    memset(&graph, 0, sizeof graph);
    memset(&exchange, 0, sizeof exchange);
    memset(&sample, 0, sizeof sample);
    tl_test_plan_init(&plan, TL_SECOND);
    tl_test_fmu_init(&fmu, 2, true, &call_log);
    tl_test_plan_component(&plan, "m", &fmu);
    tl_test_plan_signal(&plan, "a", TL_REAL, "");
    tl_test_plan_signal(&plan, "b", TL_REAL, "");
    tl_test_plan_signal(&plan, "on", TL_BOOLEAN, "");
    plan.plan.match_count = TERMS;
    tl_graph_build(&graph, &arena, &plan.plan, &plan.report);
    for (size_t i = 0; i < TERMS; i++) {
        terms[i] = (tl_objective_term){.port = tl_graph_output(&graph, variables[i], "", &plan.report),
                                       .signal = i,
                                       .conversion = {1.0, 0.0},
                                       .tolerance = 1.0,
                                       .weight = 1.0};
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_init(&exchange, &arena, &graph, 4, &error));
    objective = (tl_objective){&exchange, terms, TERMS};
    y = graph.components[0].outputs.reals;
    on = graph.components[0].outputs.booleans;
    y[0] = 0.0;
    y[1] = 0.0;
    *on = fmi2False;
}

void tearDown(void) {
    tl_arena_release(&arena);
}

static void push(double a, double b, bool is_on) {
    sample.values[SIGNAL_A] = a;
    sample.values[SIGNAL_B] = b;
    sample.values[SIGNAL_ON] = is_on ? 1.0 : 0.0;
    tl_plant_push(&exchange.plant, &sample);
    sample.tick++;
}

static void it_sums_squares_in_units_of_the_tolerances(void) {
    push(3.0, -1.0, false);
    y[0] = 1.0;
    y[1] = 4.0;
    terms[TERM_A].tolerance = 0.5; /* (−2/0.5)² = 16 */
    terms[TERM_B].tolerance = 10.0;
    terms[TERM_B].weight = 3.0; /* 3·(5/10)² = 0.75 */
    TEST_ASSERT_EQUAL_DOUBLE(16.75, tl_objective_at(&objective, 0));
}

static void a_difference_of_one_tolerance_is_1(void) {
    push(1.0, 0.0, false);
    y[0] = 1.25;
    terms[TERM_A].tolerance = 0.25;
    TEST_ASSERT_EQUAL_DOUBLE(TL_OBJECTIVE_TOLERANCE, tl_objective_at(&objective, 0));
}

static void a_boolean_counts_by_its_tolerance(void) {
    push(0.0, 0.0, true);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, tl_objective_at(&objective, 0));
    terms[TERM_ON].tolerance = 0.5;
    TEST_ASSERT_EQUAL_DOUBLE(4.0, tl_objective_at(&objective, 0));
    *on = fmi2True;
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_objective_at(&objective, 0));
}

static void the_measurement_is_converted_to_the_outputs_unit(void) {
    tl_quality quality;
    push(20.0, 0.0, false);
    terms[TERM_A].conversion = (tl_conversion){1.0, 273.15};
    y[0] = 293.15;
    TEST_ASSERT_EQUAL_DOUBLE(293.15, tl_objective_y_hat(&objective, TERM_A, 0, &quality));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_objective_at(&objective, 0));
}

static void bad_measurements_are_left_out(void) {
    tl_quality quality;
    push(1.0, 2.0, false);
    sample.quality[SIGNAL_A] = TL_STALE;
    push(100.0, 5.0, false);
    TEST_ASSERT_EQUAL_DOUBLE(25.0, tl_objective_at(&objective, 1));                     /* of b alone */
    TEST_ASSERT_EQUAL_DOUBLE(1.0, tl_objective_y_hat(&objective, TERM_A, 1, &quality)); /* the last good one */
    TEST_ASSERT_EQUAL_INT(TL_STALE, quality);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, tl_objective_at(&objective, 0)); /* at its own instant it still counts */
}

static void a_weight_of_0_is_compared_only(void) {
    push(1.0, 2.0, false);
    terms[TERM_B].weight = 0.0;
    terms[TERM_B].tolerance = 0.0; /* need not be one */
    TEST_ASSERT_EQUAL_DOUBLE(1.0, tl_objective_at(&objective, 0));
}

static void each_tick_has_its_own_measurement_and_the_newest_stands_for_later_ones(void) {
    push(1.0, 0.0, false);
    push(2.0, 0.0, false);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, tl_objective_at(&objective, 0));
    TEST_ASSERT_EQUAL_DOUBLE(4.0, tl_objective_at(&objective, 1));
    TEST_ASSERT_EQUAL_DOUBLE(4.0, tl_objective_at(&objective, 2));
}

static void it_is_measured_where_one_weighted_term_is_good_once(void) {
    terms[TERM_ON].weight = 0.0;
    for (size_t i = 0; i < 3; i++) {
        sample.quality[SIGNAL_A] = TL_NO_LINK;
        sample.quality[SIGNAL_B] = i == 1 ? TL_GOOD : TL_OUT_OF_RANGE;
        sample.quality[SIGNAL_ON] = TL_GOOD; /* but without weight */
        push(0.0, 0.0, false);
    }
    TEST_ASSERT_FALSE(tl_objective_is_measured(&objective, 0, 0));
    TEST_ASSERT_TRUE(tl_objective_is_measured(&objective, 1, 1));
    TEST_ASSERT_TRUE(tl_objective_is_measured(&objective, 0, 2));
    TEST_ASSERT_FALSE(tl_objective_is_measured(&objective, 2, 2));
    TEST_ASSERT_FALSE(tl_objective_is_measured(&objective, 3, 9)); /* the newest stands for them */
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(it_sums_squares_in_units_of_the_tolerances);
    RUN_TEST(a_difference_of_one_tolerance_is_1);
    RUN_TEST(a_boolean_counts_by_its_tolerance);
    RUN_TEST(the_measurement_is_converted_to_the_outputs_unit);
    RUN_TEST(bad_measurements_are_left_out);
    RUN_TEST(a_weight_of_0_is_compared_only);
    RUN_TEST(each_tick_has_its_own_measurement_and_the_newest_stands_for_later_ones);
    RUN_TEST(it_is_measured_where_one_weighted_term_is_good_once);
    return UNITY_END();
}
