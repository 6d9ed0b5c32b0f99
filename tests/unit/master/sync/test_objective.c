/* J = Σ weight·((y − ŷ)/tolerance)² over good samples. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/solve/optimiser.h"
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
static tl_horizon horizon;
static tl_objective_penalty penalties[TL_MAX_ADJUST];
static tl_objective objective;
static bool damps;
static double *y; /* of both Real terms */
static fmi2Boolean *on;
static double residuals[32];
static double course[32];

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
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_init(&exchange, &arena, &graph, 8, &error));
    horizon = (tl_horizon){
        .distance = 1, .prediction = 1, .variables = 1, .count = 1, .length = {1}, .match_distance = {1, 1, 1}};
    memset(penalties, 0, sizeof penalties);
    damps = true;
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

/* With the present terms, horizon and penalties. */
static void init(void) {
    const tl_objective_settings settings = {.exchange = &exchange,
                                            .horizon = &horizon,
                                            .terms = terms,
                                            .term_count = TERMS,
                                            .penalties = penalties,
                                            .damps = damps};
    TEST_ASSERT_TRUE(tl_objective_init(&objective, &arena, &settings));
    TEST_ASSERT_TRUE(objective.residual_count <= sizeof residuals / sizeof residuals[0]);
}

static double at(uint32_t depth) {
    return tl_objective_at(&objective, depth, residuals, course);
}

/* Returns J of a horizon of one step that ends with the sample of `tick`. */
static double value_at(int64_t tick) {
    init();
    TEST_ASSERT_TRUE(tl_objective_prepare(&objective, tick - 1));
    return at(1);
}

static void it_sums_squares_in_units_of_the_tolerances(void) {
    push(3.0, -1.0, false);
    y[0] = 1.0;
    y[1] = 4.0;
    terms[TERM_A].tolerance = 0.5; /* (−2/0.5)² = 16 */
    terms[TERM_B].tolerance = 10.0;
    terms[TERM_B].weight = 3.0; /* 3·(5/10)² = 0.75 */
    TEST_ASSERT_EQUAL_DOUBLE(16.75, value_at(0));
    TEST_ASSERT_EQUAL_DOUBLE(-4.0, residuals[0]);
    TEST_ASSERT_EQUAL_DOUBLE(sqrt(0.75), residuals[1]);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, residuals[2]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, course[0]);
    TEST_ASSERT_EQUAL_DOUBLE(4.0, course[1]);
}

static void a_difference_of_one_tolerance_is_1(void) {
    push(1.0, 0.0, false);
    y[0] = 1.25;
    terms[TERM_A].tolerance = 0.25;
    TEST_ASSERT_EQUAL_DOUBLE(TL_OBJECTIVE_TOLERANCE, value_at(0));
}

static void a_boolean_counts_by_its_tolerance(void) {
    push(0.0, 0.0, true);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, value_at(0));
    terms[TERM_ON].tolerance = 0.5;
    TEST_ASSERT_EQUAL_DOUBLE(4.0, value_at(0));
    *on = fmi2True;
    TEST_ASSERT_EQUAL_DOUBLE(0.0, at(1));
}

static void the_measurement_is_converted_to_the_outputs_unit(void) {
    tl_quality quality;
    push(20.0, 0.0, false);
    terms[TERM_A].conversion = (tl_conversion){1.0, 273.15};
    y[0] = 293.15;
    TEST_ASSERT_EQUAL_DOUBLE(293.15, tl_objective_measured(&objective, TERM_A, 0, &quality));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, value_at(0));
}

static void bad_measurements_are_left_out(void) {
    tl_quality quality;
    push(1.0, 2.0, false);
    sample.quality[SIGNAL_A] = TL_STALE;
    push(100.0, 5.0, false);
    TEST_ASSERT_EQUAL_DOUBLE(25.0, value_at(1)); /* b alone */
    TEST_ASSERT_EQUAL_DOUBLE(0.0, residuals[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, tl_objective_measured(&objective, TERM_A, 1, &quality)); /* the last good value */
    TEST_ASSERT_EQUAL_INT(TL_STALE, quality);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, value_at(0)); /* it counts at its own instant */
}

static void a_weight_of_0_is_compared_only(void) {
    push(1.0, 2.0, false);
    terms[TERM_B].weight = 0.0;
    terms[TERM_B].tolerance = 0.0; /* without weight it needs no tolerance */
    TEST_ASSERT_EQUAL_DOUBLE(1.0, value_at(0));
    TEST_ASSERT_EQUAL_UINT64(2, objective.residual_count);
}

static void each_tick_has_its_own_measurement_and_the_newest_stands_for_later_ones(void) {
    push(1.0, 0.0, false);
    push(2.0, 0.0, false);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, value_at(0));
    TEST_ASSERT_EQUAL_DOUBLE(4.0, value_at(1));
    TEST_ASSERT_EQUAL_DOUBLE(4.0, value_at(2));
}

static bool is_measured(int64_t first, int64_t last) {
    horizon.prediction = (uint32_t)(last - first) + 1;
    init();
    return tl_objective_prepare(&objective, first - 1);
}

static void it_is_measured_where_one_weighted_term_is_good_once(void) {
    terms[TERM_ON].weight = 0.0;
    for (size_t i = 0; i < 3; i++) {
        sample.quality[SIGNAL_A] = TL_NO_LINK;
        sample.quality[SIGNAL_B] = i == 1 ? TL_GOOD : TL_OUT_OF_RANGE;
        sample.quality[SIGNAL_ON] = TL_GOOD; /* has no weight */
        push(0.0, 0.0, false);
    }
    TEST_ASSERT_FALSE(is_measured(0, 0));
    TEST_ASSERT_TRUE(is_measured(1, 1));
    TEST_ASSERT_TRUE(is_measured(0, 2));
    TEST_ASSERT_FALSE(is_measured(2, 2));
    TEST_ASSERT_FALSE(is_measured(3, 9)); /* the newest sample replaces them */
}

/* ---- the horizon ---- */

static void each_sample_of_the_horizon_has_its_place(void) {
    horizon.distance = 2;
    horizon.prediction = 4;
    terms[TERM_ON].weight = 0.0;
    for (int i = 0; i < 7; i++) {
        push((double)i, 10.0 * (double)i, false);
    }
    init();
    TEST_ASSERT_EQUAL_UINT64(3, tl_objective_samples(&objective));
    TEST_ASSERT_EQUAL_UINT64(6, objective.residual_count);
    TEST_ASSERT_TRUE(tl_objective_prepare(&objective, 1)); /* matched with the samples 3, 4 and 5 */
    for (uint32_t depth = 2; depth <= 4; depth++) {
        y[0] = 100.0 + (double)depth;
        y[1] = 200.0 + (double)depth;
        double a = 100.0 + (double)depth - (1.0 + (double)depth);
        double b = 200.0 + (double)depth - 10.0 * (1.0 + (double)depth);
        TEST_ASSERT_EQUAL_DOUBLE(a * a + b * b, at(depth));
        TEST_ASSERT_EQUAL_DOUBLE(a, residuals[2 * (depth - 2)]);
        TEST_ASSERT_EQUAL_DOUBLE(b, residuals[2 * (depth - 2) + 1]);
        TEST_ASSERT_EQUAL_DOUBLE(y[1], course[2 * (depth - 2) + 1]);
    }
}

static void before_its_own_distance_an_output_does_not_count(void) {
    horizon.prediction = 2;
    horizon.match_distance[TERM_B] = 2;
    terms[TERM_ON].weight = 0.0;
    push(1.0, 1.0, false);
    push(1.0, 1.0, false);
    push(1.0, 1.0, false);
    init();
    TEST_ASSERT_TRUE(tl_objective_prepare(&objective, 0));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, at(1)); /* y0 alone */
    TEST_ASSERT_EQUAL_DOUBLE(0.0, residuals[1]);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, at(2));
}

/* ---- robustness and penalties ---- */

static void beyond_huber_a_difference_counts_linearly(void) {
    terms[TERM_A].huber = 2.0;
    terms[TERM_A].weight = 4.0;
    push(0.0, 0.0, false);
    init();
    TEST_ASSERT_TRUE(tl_objective_prepare(&objective, -1));
    static const double differences[] = {-1.5, 2.0, 10.0, -102.0};
    static const double values[] = {4.0 * 2.25, 4.0 * 4.0, 4.0 * 2.0 * (20.0 - 2.0), 4.0 * 2.0 * (204.0 - 2.0)};
    for (size_t i = 0; i < 4; i++) {
        y[0] = differences[i];
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, values[i], at(1));
        TEST_ASSERT_EQUAL_INT(differences[i] < 0.0, residuals[0] < 0.0);
    }
}

static void penalties_are_residuals_of_their_own(void) {
    static const double u[] = {5.0, 7.0, 7.5};
    static const double nominal[] = {4.0};
    static const double before[] = {3.0};
    horizon.prediction = 3;
    horizon.count = 3;
    horizon.length[0] = 3;
    penalties[0] = (tl_objective_penalty){.deviation = 4.0, .rate = 0.25, .step = 0.5};
    init();
    TEST_ASSERT_EQUAL_UINT64(9 + 6, objective.residual_count);
    /* distances 1, 3, 3.5 and rates 2, 2, 0.5, each in steps of 0.5 */
    double expected = 4.0 * (4.0 + 36.0 + 49.0) + 0.25 * (16.0 + 16.0 + 1.0);
    TEST_ASSERT_EQUAL_DOUBLE(expected, tl_objective_penalise(&objective, u, nominal, before, residuals));
    double sum = 0.0;
    for (size_t i = 9; i < 15; i++) {
        sum += residuals[i] * residuals[i];
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, expected, sum);
    TEST_ASSERT_EQUAL_DOUBLE(4.0, residuals[9]);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, residuals[10]);
}

/* ---- unknowns that no sample sees ---- */

static const double rising[] = {5.0, 7.0, 7.5};
static const double from[] = {3.0};

/* A dynamic horizon of three steps. The measurements at their ends are good or not. */
static void prepare_three(bool first, bool second, bool third) {
    static uint32_t way[] = {0, 1};
    const bool good[] = {true, first, second, third};
    horizon.prediction = 3;
    horizon.count = horizon.longest = horizon.length[0] = 3;
    horizon.nodes = 2;
    horizon.from_adjust = way;
    penalties[0].step = 0.5;
    for (size_t i = 0; i < 4; i++) {
        sample.quality[SIGNAL_A] = sample.quality[SIGNAL_B] = sample.quality[SIGNAL_ON] =
            (uint8_t)(good[i] ? TL_GOOD : TL_STALE);
        push(0.0, 0.0, false);
    }
    init();
    (void)tl_objective_prepare(&objective, sample.tick - 4);
}

static double damping(void) {
    return tl_objective_penalise(&objective, rising, from, from, residuals);
}

static void what_a_sample_sees_is_not_damped(void) {
    prepare_three(true, true, true);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, damping());
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, sqrt(TL_UNSEEN_RATE) * 4.0, residuals[9]); /* filled, although it does not count */
}

static void what_no_sample_sees_is_damped(void) {
    prepare_three(false, true, false);
    TEST_ASSERT_EQUAL_UINT64(9 + 3, objective.residual_count);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, TL_UNSEEN_RATE * (16.0 + 1.0), damping()); /* rates 4, 4, 1 in steps of 0.5 */
    penalties[0].rate = 0.5 * TL_UNSEEN_RATE;
    prepare_three(true, false, true);
    TEST_ASSERT_EQUAL_UINT64(9 + 3 + 6, objective.residual_count);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, TL_UNSEEN_RATE * (16.0 + 0.5 * 33.0), damping());
}

static void one_of_several_outputs_is_enough(void) {
    prepare_three(true, true, true);
    horizon.prediction = 3;
    sample.quality[SIGNAL_A] = TL_STALE;
    sample.quality[SIGNAL_B] = TL_GOOD;
    for (size_t i = 0; i < 3; i++) {
        push(0.0, 0.0, false);
    }
    TEST_ASSERT_TRUE(tl_objective_prepare(&objective, 3));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, damping());
    terms[TERM_B].weight = 0.0;
    terms[TERM_ON].weight = 0.0;
    init();
    TEST_ASSERT_FALSE(tl_objective_prepare(&objective, 3));
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, TL_UNSEEN_RATE * 33.0, damping());
}

static void a_rate_that_costs_enough_is_damping_enough(void) {
    penalties[0].rate = TL_UNSEEN_RATE;
    prepare_three(false, false, true);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, TL_UNSEEN_RATE * 33.0, damping());
}

static void a_boolean_is_not_damped(void) {
    damps = false;
    prepare_three(false, false, true);
    TEST_ASSERT_EQUAL_UINT64(9, objective.residual_count);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, damping());
}

static void without_penalties_nothing_is_added(void) {
    static const double u[] = {5.0};
    init();
    TEST_ASSERT_EQUAL_UINT64(3, objective.residual_count);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_objective_penalise(&objective, u, u, u, NULL));
}

/* ---- forecast ---- */

static void a_forecast_moves_one_nearer_and_goes_on(void) {
    /* y0 and y1 along the horizon, one line for each sample */
    static const double old_course[] = {1.0, 10.0, 3.0, 30.0, 6.0, 70.0};
    static const double earlier[] = {3.0, 30.0};
    static const double expected[] = {3.0, 30.0, 6.0, 70.0, 9.0, 110.0};
    horizon.prediction = 3;
    terms[TERM_ON].weight = 0.0;
    penalties[0].rate = 1.0;
    for (int i = 0; i < 5; i++) {
        push(0.5, 0.25, false);
    }
    init();
    TEST_ASSERT_TRUE(tl_objective_prepare(&objective, 0));
    tl_objective_forecast(&objective, old_course, earlier, residuals);
    for (size_t i = 0; i < 6; i++) {
        TEST_ASSERT_EQUAL_DOUBLE(expected[i] - (i % 2 == 0 ? 0.5 : 0.25), residuals[i]);
    }
    for (size_t i = 6; i < objective.residual_count; i++) {
        TEST_ASSERT_EQUAL_DOUBLE(0.0, residuals[i]); /* penalties are left out */
    }
}

static void a_change_is_the_largest_of_a_sample(void) {
    static const double here[] = {1.0, -2.0, 3.0, 100.0, 0.0};
    static const double there[] = {1.5, 1.0, 3.0, 0.0, 0.0};
    penalties[0].rate = 1.0;
    init();
    TEST_ASSERT_EQUAL_DOUBLE(3.0, tl_objective_change(&objective, here, there)); /* without the penalty */
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
    RUN_TEST(each_sample_of_the_horizon_has_its_place);
    RUN_TEST(before_its_own_distance_an_output_does_not_count);
    RUN_TEST(beyond_huber_a_difference_counts_linearly);
    RUN_TEST(penalties_are_residuals_of_their_own);
    RUN_TEST(what_a_sample_sees_is_not_damped);
    RUN_TEST(what_no_sample_sees_is_damped);
    RUN_TEST(one_of_several_outputs_is_enough);
    RUN_TEST(a_rate_that_costs_enough_is_damping_enough);
    RUN_TEST(a_boolean_is_not_damped);
    RUN_TEST(without_penalties_nothing_is_added);
    RUN_TEST(a_forecast_moves_one_nearer_and_goes_on);
    RUN_TEST(a_change_is_the_largest_of_a_sample);
    return UNITY_END();
}
