/* The horizon: T_D by pairs, T_P, unknowns, Γ_k, C_k, and problems. TL_TEST_GRAPHS sets the number
 * of random networks (default 500). */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "tests/support/message.h"
#include "tests/support/random_network.h"
#include "tests/support/test_rig.h"

static tl_test_log call_log;
static tl_test_plan plan;
static tl_test_network network;
static tl_test_rig rig;
static tl_test_problem problems[8];

static void add_problem(void *context, tl_status status, const char *where, const char *text) {
    tl_report *report = context;
    TEST_ASSERT_TRUE(report->count <= sizeof problems / sizeof problems[0]);
    tl_test_problem *problem = &problems[report->count - 1];
    problem->status = status;
    (void)snprintf(problem->where, sizeof problem->where, "%s", where);
    (void)snprintf(problem->text, sizeof problem->text, "%s", text);
}

void setUp(void) {
    tl_test_log_clear(&call_log);
    memset(problems, 0, sizeof problems);
}

void tearDown(void) {
    tl_test_rig_end(&rig);
    tl_test_network_end(&network);
}

static void begin(size_t components) {
    tl_test_network_init(&network, &plan, &call_log, components);
}

static void begin_chain(size_t length) {
    begin(length);
    for (size_t k = 0; k + 1 < length; k++) {
        (void)tl_test_network_edge(&network, (int)k, k + 1);
    }
}

static const tl_horizon *measure(uint32_t prediction, tl_shape shape) {
    tl_test_network_build(&network);
    plan.plan.prediction = prediction;
    plan.plan.shape = shape;
    plan.report = (tl_report){.add = add_problem, .context = &plan.report};
    tl_test_rig_plan(&rig, &plan);
    return &rig.horizon;
}

/* The same for a plan without problems. */
static const tl_horizon *find(uint32_t prediction, tl_shape shape) {
    const tl_horizon *horizon = measure(prediction, shape);
    TEST_ASSERT_EQUAL_UINT64_MESSAGE(0, plan.report.count, problems[0].text);
    return horizon;
}

static void assert_problem(size_t number, const char *where, const char *parts) {
    TEST_ASSERT_TRUE(number < plan.report.count);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, problems[number].status);
    TEST_ASSERT_EQUAL_STRING(where, problems[number].where);
    TL_EXPECT_PARTS(parts, problems[number].text);
}

/* ---- paths ---- */

static void a_chain_has_its_length_as_distance(void) {
    begin_chain(4);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_match(&network, 3);
    const tl_horizon *horizon = find(0, TL_DYNAMIC);
    TEST_ASSERT_EQUAL_UINT32(4, horizon->distance);
    TEST_ASSERT_EQUAL_UINT32(4, horizon->prediction);
    TEST_ASSERT_EQUAL_UINT64(5, horizon->nodes);
    for (uint32_t k = 0; k < 4; k++) {
        TEST_ASSERT_EQUAL_UINT32(k + 1, horizon->reach[k]);
        TEST_ASSERT_EQUAL_UINT32(k, horizon->nearest[k]);
        TEST_ASSERT_EQUAL_UINT32(0, horizon->longer[k]);
        TEST_ASSERT_EQUAL_UINT32(1, tl_horizon_next_need(horizon, k, horizon->reach[k]));
    }
    TEST_ASSERT_EQUAL_UINT32(0, horizon->reach[4]); /* no path leads from the plant */
    TEST_ASSERT_EQUAL_UINT32(TL_NEVER, horizon->nearest[4]);
    TEST_ASSERT_EQUAL_UINT32(TL_NEVER, horizon->longer[4]);
}

/* u → 0 → 1 → y, and a detour 0 → 2 → 3 → 1. Component 4 is not on a path to y; 5 is not reached
 * from u. */
static void a_longer_way_is_longer_by_its_detour(void) {
    begin(6);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_edge(&network, 0, 1);
    (void)tl_test_network_edge(&network, 0, 2);
    (void)tl_test_network_edge(&network, 2, 3);
    (void)tl_test_network_edge(&network, 3, 1);
    (void)tl_test_network_edge(&network, 1, 4);
    (void)tl_test_network_edge(&network, 5, 3);
    (void)tl_test_network_match(&network, 1);
    static const uint32_t reach[] = {4, 5, 3, 4, 0, 3};
    static const uint32_t longer[] = {0, 0, 2, 2, TL_NEVER, TL_NEVER};
    static const uint32_t nearest[] = {0, 1, 1, 2, 2, TL_NEVER};
    const tl_horizon *horizon = find(5, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT32(2, horizon->distance);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(reach, horizon->reach, 6);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(longer, horizon->longer, 6);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(nearest, horizon->nearest, 6);
    TEST_ASSERT_EQUAL_UINT32(4, tl_horizon_next_need(horizon, 0, 4)); /* T_P − T_D + 1 − C_k */
    TEST_ASSERT_EQUAL_UINT32(2, tl_horizon_next_need(horizon, 2, 3));
    TEST_ASSERT_EQUAL_UINT32(0, tl_horizon_next_need(horizon, 5, 3));
}

/* An adjusted input cuts its connection. The loop is open, and component 1 is upstream of u. */
static void an_adjusted_input_cuts_what_drove_it(void) {
    begin(2);
    tl_test_link *link = tl_test_network_edge(&network, 1, 0);
    link->adjusted = 1;
    (void)tl_test_network_edge(&network, 0, 1);
    (void)tl_test_network_match(&network, 0);
    const tl_horizon *horizon = find(3, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT32(1, horizon->distance);
    TEST_ASSERT_EQUAL_UINT32(3, horizon->reach[0]);
    TEST_ASSERT_EQUAL_UINT32(0, horizon->reach[1]);
    TEST_ASSERT_EQUAL_UINT32(TL_NEVER, horizon->longer[1]);
}

static void signals_of_the_plant_have_ways_too(void) {
    begin_chain(3);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_edge(&network, -1, 1);
    (void)tl_test_network_edge(&network, -1, 2);
    tl_test_link *cut = tl_test_network_edge(&network, -2, 0);
    cut->adjusted = 1;
    (void)tl_test_network_match(&network, 2);
    static const uint32_t first[] = {TL_NEVER, 0, 0, TL_NEVER};
    static const uint32_t second[] = {TL_NEVER, TL_NEVER, TL_NEVER, TL_NEVER};
    const tl_horizon *horizon = find(5, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(first, &horizon->from_signal[0], 4);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(second, &horizon->from_signal[4], 4);
    /* the plant feeds an input of the matched component */
    TEST_ASSERT_EQUAL_UINT32(4, horizon->reach[3]);
}

static void outputs_without_weight_do_not_count(void) {
    begin_chain(3);
    (void)tl_test_network_adjust(&network, 0);
    tl_test_network_match(&network, 0)->weight = 0.0;
    (void)tl_test_network_match(&network, 2);
    const tl_horizon *horizon = find(0, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT32(3, horizon->distance);
    TEST_ASSERT_EQUAL_UINT32(TL_NEVER, horizon->match_distance[0]);
    TEST_ASSERT_EQUAL_UINT32(3, horizon->match_distance[1]);
    TEST_ASSERT_EQUAL_UINT32(1, horizon->reach[0]);
}

static void nothing_adjusted_is_a_step_of_one(void) {
    begin_chain(2);
    (void)tl_test_network_match(&network, 1);
    const tl_horizon *horizon = find(0, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT32(0, horizon->distance);
    TEST_ASSERT_EQUAL_UINT32(1, horizon->prediction);
    TEST_ASSERT_EQUAL_UINT64(0, horizon->count);
    TEST_ASSERT_EQUAL_UINT32(0, horizon->reach[0]);
}

/* ---- unknowns ---- */

/* u0 → 0 → 1 → 2 → y, and u1 → 1; T_D of the pairs is 3 and 2. */
static void make_pairs(void) {
    begin_chain(3);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_adjust(&network, 1);
    (void)tl_test_network_match(&network, 2);
}

static void unknowns_follow_the_distance_of_each_variable(void) {
    make_pairs();
    const tl_horizon *horizon = find(5, TL_DYNAMIC);
    TEST_ASSERT_EQUAL_UINT32(2, horizon->distance);
    TEST_ASSERT_EQUAL_UINT32(3, horizon->variable_distance[0]);
    TEST_ASSERT_EQUAL_UINT32(2, horizon->variable_distance[1]);
    TEST_ASSERT_EQUAL_UINT32(2, horizon->match_distance[0]);
    TEST_ASSERT_EQUAL_UINT32(3, horizon->length[0]); /* T_P − T_D + 1 */
    TEST_ASSERT_EQUAL_UINT32(4, horizon->length[1]);
    TEST_ASSERT_EQUAL_UINT64(0, horizon->offset[0]);
    TEST_ASSERT_EQUAL_UINT64(3, horizon->offset[1]);
    TEST_ASSERT_EQUAL_UINT64(7, horizon->count);
    TEST_ASSERT_EQUAL_UINT32(4, horizon->longest);
}

static void a_static_search_has_one_unknown_each(void) {
    make_pairs();
    const tl_horizon *horizon = find(5, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT64(2, horizon->count);
    TEST_ASSERT_EQUAL_UINT64(1, horizon->offset[1]);
    TEST_ASSERT_EQUAL_UINT32(1, horizon->longest);
}

/* Within T_P each variable reaches an output, and each output is reached. */
static void the_shortest_prediction_is_the_longest_distance(void) {
    begin_chain(4);
    (void)tl_test_network_adjust(&network, 2);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_match(&network, 2);
    (void)tl_test_network_match(&network, 0);
    (void)tl_test_network_match(&network, 3);
    const tl_horizon *horizon = find(0, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT32(1, horizon->distance);
    TEST_ASSERT_EQUAL_UINT32(2, horizon->prediction);
    TEST_ASSERT_EQUAL_UINT32(2, horizon->match_distance[2]);
}

static void a_candidate_is_read_by_variable_and_depth(void) {
    static const double u[] = {1.0, 2.0, 3.0, 10.0, 20.0, 30.0, 40.0};
    static const double first[] = {1.0, 2.0, 3.0, 3.0, 3.0};
    static const double second[] = {10.0, 20.0, 30.0, 40.0, 40.0};
    make_pairs();
    const tl_horizon *horizon = find(5, TL_DYNAMIC);
    for (uint32_t depth = 0; depth < 5; depth++) {
        TEST_ASSERT_TRUE(tl_horizon_value(horizon, u, 0, depth) == first[depth]);
        TEST_ASSERT_TRUE(tl_horizon_value(horizon, u, 1, depth) == second[depth]);
    }
}

static void a_sequence_is_held_and_shifted(void) {
    static const double values[] = {5.0, 7.0};
    static const double held[] = {5.0, 5.0, 5.0, 7.0, 7.0, 7.0, 7.0};
    static const double shifted[] = {2.0, 3.0, 3.0, 20.0, 30.0, 40.0, 40.0};
    double u[] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    double moved[] = {1.0, 2.0, 3.0, 10.0, 20.0, 30.0, 40.0};
    make_pairs();
    const tl_horizon *horizon = find(5, TL_DYNAMIC);
    tl_horizon_hold(horizon, values, u);
    TEST_ASSERT_EQUAL_MEMORY(held, u, sizeof held);
    tl_horizon_shift(horizon, moved);
    TEST_ASSERT_EQUAL_MEMORY(shifted, moved, sizeof shifted);
}

static void one_unknown_is_shifted_onto_itself(void) {
    double u[] = {1.0, 2.0};
    make_pairs();
    tl_horizon_shift(find(5, TL_STATIC), u);
    TEST_ASSERT_TRUE(u[0] == 1.0 && u[1] == 2.0);
}

/* ---- problems ---- */

static void a_variable_that_reaches_nothing_is_reported(void) {
    begin(3);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_adjust(&network, 2);
    (void)tl_test_network_edge(&network, 0, 1);
    (void)tl_test_network_match(&network, 1);
    (void)measure(0, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
    assert_problem(0, "adjust.k2.u0", "k2.u0|path");
}

static void an_output_that_nothing_reaches_is_reported(void) {
    begin(3);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_edge(&network, 0, 1);
    (void)tl_test_network_match(&network, 1);
    (void)tl_test_network_match(&network, 2);
    (void)measure(0, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
    assert_problem(0, "match.k2.sum", "k2.sum|path|weight");
}

/* If no variable reaches an output, the outputs are not reported too. */
static void without_any_path_only_the_variables_are_reported(void) {
    begin(3);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_adjust(&network, 1);
    (void)tl_test_network_match(&network, 2);
    const tl_horizon *horizon = measure(0, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT64(2, plan.report.count);
    assert_problem(0, "adjust.k0.u0", "k0.u0|path");
    assert_problem(1, "adjust.k1.u0", "k1.u0|path");
    TEST_ASSERT_EQUAL_UINT32(0, horizon->distance);
}

static void only_weight_zero_is_no_match(void) {
    begin_chain(2);
    (void)tl_test_network_adjust(&network, 0);
    tl_test_network_match(&network, 1)->weight = 0.0;
    (void)measure(0, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
    assert_problem(0, "adjust.k0.u0", "k0.u0|path");
}

static void a_prediction_that_is_too_short_is_reported(void) {
    begin_chain(3);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_match(&network, 2);
    (void)measure(2, TL_STATIC);
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
    assert_problem(0, "synchronise.horizon.prediction", "2|3");
}

static void too_many_unknowns_are_reported(void) {
    begin_chain(1);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_adjust(&network, 0);
    (void)tl_test_network_match(&network, 0);
    TEST_ASSERT_EQUAL_UINT64(TL_MAX_UNKNOWNS, find(TL_MAX_UNKNOWNS / 2, TL_DYNAMIC)->count);
    tl_test_rig_end(&rig);
    plan.plan.prediction = TL_MAX_UNKNOWNS / 2 + 1;
    tl_test_rig_plan(&rig, &plan);
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
    assert_problem(0, "synchronise.horizon", "258|256");
    tl_test_rig_end(&rig);
    plan.plan.shape = TL_STATIC;
    tl_test_rig_plan(&rig, &plan);
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count); /* no new problem */
}

/* ---- random networks, compared with another algorithm ---- */

static uint32_t known(uint32_t way) {
    return way >= TL_TEST_FAR ? TL_NEVER : way;
}

static uint32_t way_from_signal(size_t signal, size_t k) {
    uint32_t nearest = TL_TEST_FAR;
    for (size_t i = 0; i < network.link_count; i++) {
        const tl_test_link *link = &network.links[i];
        if (link->from == -1 - (int)signal && link->adjusted == 0 && network.way[link->to][k] < nearest) {
            nearest = network.way[link->to][k];
        }
    }
    return known(nearest);
}

static void assert_component(const tl_horizon *horizon, size_t k) {
    uint32_t from_u = tl_test_network_from_u(&network, k);
    uint32_t to_y = tl_test_network_to_y(&network, k);
    uint32_t reach = to_y < horizon->prediction ? horizon->prediction - to_y : 0;
    bool on_path = from_u < TL_TEST_FAR && reach != 0;
    TEST_ASSERT_EQUAL_UINT32(known(from_u), horizon->nearest[k]);
    TEST_ASSERT_EQUAL_UINT32(reach, horizon->reach[k]);
    TEST_ASSERT_EQUAL_UINT32(on_path ? from_u + to_y + 1 - horizon->distance : TL_NEVER, horizon->longer[k]);
    TEST_ASSERT_EQUAL_UINT32(on_path ? tl_test_network_most(&network, k, horizon->prediction) : 0,
                             tl_horizon_next_need(horizon, k, reach));
    for (size_t s = 0; s < network.signals; s++) {
        TEST_ASSERT_EQUAL_UINT32(way_from_signal(s, k), horizon->from_signal[s * horizon->nodes + k]);
    }
}

static void random_networks_agree_with_floyd_and_warshall(void) {
    size_t graphs = tl_test_campaign("TL_TEST_GRAPHS", 500);
    for (uint64_t seed = 1; seed <= graphs; seed++) {
        tl_test_random random = {tl_test_mix(seed + 17)};
        tl_test_random_network(&network, &plan, &call_log, &random, tl_test_random_chance(&random, 50));
        plan.plan.prediction = tl_test_network_least(&network) + (uint32_t)tl_test_random_below(&random, 7);
        plan.report = (tl_report){.add = add_problem, .context = &plan.report};
        tl_test_rig_plan(&rig, &plan);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(0, plan.report.count, problems[0].text);
        TEST_ASSERT_EQUAL_UINT32(tl_test_network_distance(&network), rig.horizon.distance);
        for (size_t k = 0; k < network.count; k++) {
            assert_component(&rig.horizon, k);
        }
        tl_test_rig_end(&rig);
        plan.plan.prediction = 0;
        tl_test_rig_plan(&rig, &plan);
        TEST_ASSERT_EQUAL_UINT32(tl_test_network_least(&network), rig.horizon.prediction);
        tl_test_rig_end(&rig);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_chain_has_its_length_as_distance);
    RUN_TEST(a_longer_way_is_longer_by_its_detour);
    RUN_TEST(an_adjusted_input_cuts_what_drove_it);
    RUN_TEST(signals_of_the_plant_have_ways_too);
    RUN_TEST(outputs_without_weight_do_not_count);
    RUN_TEST(nothing_adjusted_is_a_step_of_one);
    RUN_TEST(unknowns_follow_the_distance_of_each_variable);
    RUN_TEST(a_static_search_has_one_unknown_each);
    RUN_TEST(the_shortest_prediction_is_the_longest_distance);
    RUN_TEST(a_candidate_is_read_by_variable_and_depth);
    RUN_TEST(a_sequence_is_held_and_shifted);
    RUN_TEST(one_unknown_is_shifted_onto_itself);
    RUN_TEST(a_variable_that_reaches_nothing_is_reported);
    RUN_TEST(an_output_that_nothing_reaches_is_reported);
    RUN_TEST(without_any_path_only_the_variables_are_reported);
    RUN_TEST(only_weight_zero_is_no_match);
    RUN_TEST(a_prediction_that_is_too_short_is_reported);
    RUN_TEST(too_many_unknowns_are_reported);
    RUN_TEST(random_networks_agree_with_floyd_and_warshall);
    return UNITY_END();
}
