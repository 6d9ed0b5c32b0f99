/* The running co-simulation: Jacobi steps, conversions, initialisation, snapshots. */
#include <math.h>
#include <string.h>
#include <unity.h>

#include "master/graph/exchange.h"
#include "tests/support/message.h"
#include "tests/support/test_plan.h"

static const tl_unit kelvin = {"K", true, {0, 0, 0, 0, 1}, 1.0, 0.0};
static const tl_unit celsius = {"degC", true, {0, 0, 0, 0, 1}, 1.0, 273.15};

static tl_test_log call_log;
static tl_test_fmu fmus[4];
static tl_test_plan plan;
static tl_arena arena;
static tl_graph graph;
static tl_exchange exchange;
static tl_sample sample;
static tl_error error;

void setUp(void) {
    tl_test_log_clear(&call_log);
    tl_test_plan_init(&plan, TL_SECOND / 10);
    tl_arena_init(&arena);
    memset(&graph, 0, sizeof graph);
    memset(&exchange, 0, sizeof exchange);
    memset(&sample, 0, sizeof sample);
}

void tearDown(void) {
    for (size_t i = 0; i < graph.component_count; i++) {
        tl_exchange_end_component(&exchange, i);
        tl_component_free(&graph.components[i]);
        tl_test_fmu_end(&fmus[i]);
    }
    tl_arena_release(&arena);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

static tl_test_fmu *add(const char *name, size_t width, bool discrete) {
    tl_test_fmu *fmu = &fmus[plan.plan.component_count];
    tl_test_fmu_init(fmu, width, discrete, &call_log);
    tl_test_plan_component(&plan, name, fmu);
    return fmu;
}

/* Builds the graph and the exchange, and creates the instances. */
static void build(void) {
    tl_graph_build(&graph, &arena, &plan.plan, &plan.report);
    TEST_ASSERT_EQUAL_UINT64(0, plan.report.count);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_init(&exchange, &arena, &graph, 8, &error));
    for (size_t i = 0; i < graph.component_count; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK,
                              tl_component_instantiate(&graph.components[i], &fmus[i].callbacks, "file:///r", &error));
    }
}

/* The next sample: all signals are good, and the first one has this value. */
static void push(double first) {
    sample.values[0] = first;
    tl_plant_push(&exchange.plant, &sample);
    sample.tick++;
}

static void initialize(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(
        TL_OK,
        tl_exchange_initialize(&exchange, 0, tl_plant_sample(&exchange.plant, exchange.plant.newest)->values, &error),
        error.text);
}

/* A committed step. */
static void step(int64_t number) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_exchange_commit(&exchange, number, &error), error.text);
}

/* A candidate's step. */
static void try(int64_t number, uint32_t depth) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_exchange_try(&exchange, number, depth, &error), error.text);
}

static double output(size_t component) {
    return graph.components[component].outputs.reals[0];
}

static double input(size_t component) {
    return graph.components[component].inputs.reals[0];
}

/* plant.cmd → in → k1 → out, in this order or the other way round in the plan. */
static void make_chain(bool reversed) {
    static const char *const names[] = {"in", "k1", "out"};
    for (size_t i = 0; i < 3; i++) {
        (void)add(names[reversed ? 2 - i : i], 1, false);
    }
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_connect(&plan, "k1.y0", "out.u0");
    tl_test_plan_connect(&plan, "in.y0", "k1.u0");
    tl_test_plan_connect(&plan, "plant.cmd", "in.u0");
}

/* Adds the output of "out" to the graph, as a match would. */
static void read_out(size_t out) {
    const tl_port *port = tl_graph_output(&graph, "out.y0", "", &plan.report);
    TEST_ASSERT_EQUAL_UINT64(out, port->node);
}

/* As build(), with an output that no connection reads. */
static void build_reading_out(size_t out) {
    plan.plan.match_count = 1; /* reserves a port */
    tl_graph_build(&graph, &arena, &plan.plan, &plan.report);
    read_out(out);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_init(&exchange, &arena, &graph, 8, &error));
    for (size_t i = 0; i < graph.component_count; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK,
                              tl_component_instantiate(&graph.components[i], &fmus[i].callbacks, "file:///r", &error));
    }
}

/* ---- Jacobi ---- */

static void assert_steps_through_chain(size_t in, size_t k1, size_t out) {
    build_reading_out(out);
    push(0.0);
    initialize();
    for (int64_t i = 0; i < 6; i++) {
        push(1.0); /* from tick 1 on: the input of "in" is 1 from t_1 on */
        step(i);
        TEST_ASSERT_EQUAL_DOUBLE(i >= 1 ? 1.0 : 0.0, output(in));  /* after one step */
        TEST_ASSERT_EQUAL_DOUBLE(i >= 2 ? 1.0 : 0.0, output(k1));  /* one component upstream */
        TEST_ASSERT_EQUAL_DOUBLE(i >= 3 ? 1.0 : 0.0, output(out)); /* two upstream */
        TEST_ASSERT_EQUAL_DOUBLE(output(k1), input(out));
    }
}

static void an_output_n_components_on_reacts_after_n_and_1_steps(void) {
    make_chain(false);
    assert_steps_through_chain(0, 1, 2);
}

static void the_order_of_the_components_does_not_matter(void) {
    make_chain(true);
    assert_steps_through_chain(2, 1, 0);
}

static void all_inputs_are_from_before_the_step(void) {
    (void)add("a", 1, false);
    (void)add("b", 1, false);
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    tl_test_plan_connect(&plan, "b.y0", "a.u0");
    tl_test_fmu_variable(&fmus[0], "start")->start.real = 1.0;
    tl_test_fmu_variable(&fmus[1], "start")->start.real = 2.0;
    build();
    push(0.0);
    initialize();
    for (int64_t i = 0; i < 4; i++) { /* two values change places and never merge */
        step(i);
        TEST_ASSERT_EQUAL_DOUBLE(i % 2 == 0 ? 2.0 : 1.0, output(0));
        TEST_ASSERT_EQUAL_DOUBLE(i % 2 == 0 ? 1.0 : 2.0, output(1));
    }
}

/* Its outputs are read after initialisation and not before, also after a reset. */
static void an_fmu_that_is_not_read_in_initialisation_mode(void) {
    make_chain(false);
    tl_test_fmu_fail(&fmus[0], TL_TEST_GET_REAL, TL_TEST_DISCARD, 1, 1);
    build();
    push(1.0);
    initialize();
    TEST_ASSERT_TRUE(graph.components[0].reads_late);
    TEST_ASSERT_FALSE(graph.components[1].reads_late);
    TEST_ASSERT_EQUAL_UINT64(2, tl_test_log_count(&call_log, &fmus[0], TL_TEST_GET_REAL)); /* refused, and after it */
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_reset(&graph.components[0], &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_enter_initialization(&graph.components[0], 0.0, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_component_get_outputs(&graph.components[0], &error));
    TEST_ASSERT_EQUAL_UINT64(2, tl_test_log_count(&call_log, &fmus[0], TL_TEST_GET_REAL));
}

static void each_step_executes_every_component_once(void) {
    make_chain(false);
    build();
    push(0.0);
    initialize();
    for (int64_t i = 0; i < 7; i++) {
        step(i);
    }
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_UINT64(7, graph.components[i].executions);
        TEST_ASSERT_EQUAL_UINT64(7, tl_test_log_count(&call_log, &fmus[i], TL_TEST_DO_STEP));
    }
    TEST_ASSERT_EQUAL_UINT64(7, exchange.plant.executions);
}

static void communication_points_come_from_the_integer(void) {
    make_chain(false);
    build();
    push(0.0);
    initialize();
    for (int64_t i = 0; i < 1000; i++) {
        if (i % 2 == 0) {
            step(i);
        } else {
            try(i, 0);
        }
    }
    for (size_t i = 0; i < 1000; i++) {
        const tl_test_entry *entry = tl_test_log_step(&call_log, &fmus[1], i);
        TEST_ASSERT_TRUE(entry->time == (double)i / 10.0); /* bit for bit */
        TEST_ASSERT_TRUE(entry->step == 0.1);
        TEST_ASSERT_EQUAL_INT(i % 2 == 0, entry->final);
    }
}

/* ---- values ---- */

static void units_are_converted_on_the_way(void) {
    (void)add("sensor", 1, false);
    (void)add("model", 1, false);
    tl_test_fmu_variable(&fmus[0], "y0")->unit = &celsius;
    tl_test_fmu_variable(&fmus[1], "u0")->unit = &kelvin;
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "sensor.u0");
    tl_test_plan_connect(&plan, "sensor.y0", "model.u0");
    build();
    push(20.0);
    initialize();
    step(0);
    TEST_ASSERT_EQUAL_DOUBLE(20.0, output(0));
    TEST_ASSERT_EQUAL_DOUBLE(293.15, input(1));
}

/* A model with u0 in K and a driving signal in degC. */
static void add_in_kelvin(void) {
    static const tl_unit known[] = {{"K", true, {0, 0, 0, 0, 1}, 1.0, 0.0},
                                    {"degC", true, {0, 0, 0, 0, 1}, 1.0, 273.15}};
    (void)add("model", 1, false);
    fmus[0].model.units = known;
    fmus[0].model.unit_count = 2;
    tl_test_fmu_variable(&fmus[0], "u0")->unit = &known[0];
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "degC");
    tl_test_plan_connect(&plan, "plant.cmd", "model.u0");
}

static void a_signals_unit_is_converted_too(void) {
    add_in_kelvin();
    build();
    push(-273.15);
    initialize();
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 0.0, input(0));
}

static void integers_booleans_and_enumerations_are_exchanged_exactly(void) {
    static const int32_t values[] = {0, 1, -1, 2147483647, -2147483647};
    (void)add("a", 1, true);
    (void)add("b", 2, true); /* odd numbers of each type, so that a wrong index shows */
    fmus[0].control.raw_true = true;
    tl_test_plan_signal(&plan, "cmd", TL_INTEGER, "");
    tl_test_plan_signal(&plan, "on", TL_BOOLEAN, "");
    tl_test_plan_connect(&plan, "plant.cmd", "a.count");
    tl_test_plan_connect(&plan, "plant.on", "a.flag");
    tl_test_plan_connect(&plan, "a.count_out", "a.mode");
    tl_test_plan_connect(&plan, "a.mode_out", "b.count");
    tl_test_plan_connect(&plan, "a.flag_out", "b.flag");
    tl_test_plan_connect(&plan, "b.y1", "a.u0");
    build();
    for (size_t i = 0; i < sizeof values / sizeof values[0]; i++) {
        sample.values[1] = i % 2 == 0 ? 1.0 : 0.0;
        push((double)values[i]);
        if (i == 0) {
            initialize();
        }
        step((int64_t)3 * (int64_t)i);
        step((int64_t)3 * (int64_t)i + 1);
        step((int64_t)3 * (int64_t)i + 2);
        TEST_ASSERT_EQUAL_INT32(values[i], graph.components[1].inputs.integers[0]);
        TEST_ASSERT_EQUAL_INT32(i % 2 == 0 ? fmi2True : fmi2False, graph.components[1].inputs.booleans[0]);
    }
}

static void one_output_may_drive_many_inputs(void) {
    (void)add("a", 1, false);
    (void)add("b", 3, false);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "a.u0");
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    tl_test_plan_connect(&plan, "a.y0", "b.u1");
    tl_test_plan_connect(&plan, "plant.cmd", "b.u2");
    build();
    push(4.0);
    initialize();
    step(0);
    TEST_ASSERT_EQUAL_DOUBLE_ARRAY(((double[]){4.0, 4.0, 4.0}), graph.components[1].inputs.reals, 3);
    /* one read for both connections */
    TEST_ASSERT_EQUAL_UINT64(1, graph.components[0].outputs.real_count);
}

/* ---- initialisation ---- */

static void a_chain_of_feed_through_settles_before_the_first_step(void) {
    make_chain(true); /* upstream components come last */
    for (size_t i = 0; i < 3; i++) {
        fmus[i].control.feed_through = true;
    }
    build_reading_out(0);
    push(5.0);
    initialize();
    TEST_ASSERT_EQUAL_DOUBLE(5.0, output(0));
    TEST_ASSERT_EQUAL_DOUBLE(5.0, input(0));
    TEST_ASSERT_EQUAL_UINT64(0, tl_test_log_count(&call_log, NULL, TL_TEST_DO_STEP));
    TEST_ASSERT_EQUAL_UINT64(0, exchange.plant.executions);
}

static void a_cycle_of_feed_through_ends_too(void) {
    (void)add("a", 1, false);
    (void)add("b", 1, false);
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    tl_test_plan_connect(&plan, "b.y0", "a.u0");
    fmus[0].control.feed_through = true;
    fmus[1].control.feed_through = true;
    /* each round adds 1, so the loop never settles */
    tl_test_fmu_variable(&fmus[1], "offset")->start.real = 1.0;
    build();
    push(0.0);
    initialize();
    step(0);
    TEST_ASSERT_TRUE(call_log.count < 60);
}

static void without_feed_through_outputs_begin_at_their_start(void) {
    make_chain(false);
    tl_test_fmu_variable(&fmus[1], "start")->start.real = 7.0;
    build();
    push(5.0);
    initialize();
    TEST_ASSERT_EQUAL_DOUBLE(7.0, output(1));
    TEST_ASSERT_EQUAL_DOUBLE(7.0, input(2));
    TEST_ASSERT_EQUAL_DOUBLE(5.0, input(0));
}

static void a_failure_while_initialising_stops_it(void) {
    static const tl_test_call calls[] = {TL_TEST_SETUP_EXPERIMENT, TL_TEST_ENTER_INITIALIZATION, TL_TEST_GET_REAL,
                                         TL_TEST_SET_REAL, TL_TEST_EXIT_INITIALIZATION};
    for (size_t i = 0; i < sizeof calls / sizeof calls[0]; i++) {
        setUp();
        make_chain(false);
        build();
        push(0.0);
        tl_test_fmu_fail(&fmus[1], calls[i], TL_TEST_FATAL, 1, 1);
        TEST_ASSERT_EQUAL_INT(
            TL_FMU_FATAL, tl_exchange_initialize(
                              &exchange, 0, tl_plant_sample(&exchange.plant, exchange.plant.newest)->values, &error));
        TL_EXPECT_PARTS("k1|fmi2Fatal", error.text);
        TEST_ASSERT_EQUAL_INT(calls[i], call_log.entries[call_log.count - 1].call);
        if (i + 1 < sizeof calls / sizeof calls[0]) {
            tearDown();
        }
    }
}

/* ---- cut connections ---- */

/* A model with u0 adjusted; returns the port of u0. */
static const tl_port *build_adjusted(void) {
    const tl_plan_adjust adjust = {.where = "", .variable = "model.u0", .step = 1.0};
    plan.plan.adjust_count = 1; /* reserves a port */
    tl_graph_build(&graph, &arena, &plan.plan, &plan.report);
    const tl_port *port = tl_graph_adjust(&graph, &adjust, &plan.report);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_init(&exchange, &arena, &graph, 8, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_component_instantiate(&graph.components[0], &fmus[0].callbacks, "file:///r", &error));
    return port;
}

static void a_cut_connection_delivers_to_the_nominal_only(void) {
    (void)add("model", 1, false);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "model.u0");
    const tl_port *port = build_adjusted();
    tl_exchange_place_adjusted(&exchange, 0, port, tl_graph_connection_to(&graph, port), 7.0);
    push(3.0);
    initialize();
    /* not 7: the connection delivers it */
    TEST_ASSERT_EQUAL_DOUBLE(3.0, tl_exchange_nominal(&exchange, 0));
    TEST_ASSERT_EQUAL_DOUBLE(3.0, tl_exchange_adjusted(&exchange, 0));
    TEST_ASSERT_EQUAL_DOUBLE(3.0, input(0)); /* while initialising, û is the input */
    push(4.0);
    tl_exchange_set_adjusted(&exchange, 0, 9.0);
    TEST_ASSERT_EQUAL_DOUBLE(9.0, tl_exchange_adjusted(&exchange, 0));
    step(0);
    TEST_ASSERT_EQUAL_DOUBLE(4.0, tl_exchange_nominal(&exchange, 0));
    TEST_ASSERT_EQUAL_DOUBLE(9.0, input(0));
    TEST_ASSERT_EQUAL_DOUBLE(9.0, tl_test_log_step(&call_log, &fmus[0], 0)->u[0]);
}

static void a_cut_connection_converts_units_as_any_other(void) {
    add_in_kelvin();
    const tl_port *port = build_adjusted();
    push(20.0);
    initialize();
    TEST_ASSERT_EQUAL_DOUBLE(293.15, *(const double *)tl_graph_connection_to(&graph, port)->nominal);
    TEST_ASSERT_EQUAL_DOUBLE(293.15, input(0));
}

/* ---- snapshots ---- */

static void chain_with_lag(void) {
    make_chain(false);
    for (size_t i = 0; i < 3; i++) {
        tl_test_fmu_variable(&fmus[i], "lag")->start.real = 0.3;
    }
    build_reading_out(2);
}

/* Three committed steps, the samples up to t_6. */
static void walk_to_the_fourth_step(void) {
    push(1.0);
    initialize();
    for (int64_t i = 0; i < 3; i++) {
        push(1.0 / 3.0 + (double)i);
        step(i);
    }
    for (int64_t i = 3; i < 7; i++) {
        push(1.0 / 7.0 + (double)i);
    }
}

static void assert_same_outputs(int round) {
    static double first[3];
    const double now[3] = {output(0), output(1), output(2)};
    if (round == 0) {
        memcpy(first, now, sizeof first);
    }
    TEST_ASSERT_EQUAL_MEMORY(first, now, sizeof first);
}

static void a_snapshot_brings_back_states_and_values_to_the_bit(void) {
    chain_with_lag();
    walk_to_the_fourth_step();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_save(&exchange, &error));
    for (int round = 0; round < 3; round++) {
        for (int64_t i = 3; i < 7; i++) {
            TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_step(&exchange, i, &error));
        }
        assert_same_outputs(round);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_restore(&exchange, &error));
    }
    TEST_ASSERT_EQUAL_UINT64(3, tl_test_log_count(&call_log, NULL, TL_TEST_GET_STATE));
    /* trial steps do not execute the plant */
    TEST_ASSERT_EQUAL_UINT64(3, exchange.plant.executions);
}

static void candidates_begin_where_was_committed(void) {
    chain_with_lag();
    walk_to_the_fourth_step();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_begin(&exchange, &error));
    for (int round = 0; round < 3; round++) {
        for (uint32_t depth = 0; depth < 4; depth++) {
            try(3 + (int64_t)depth, depth);
        }
        assert_same_outputs(round);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_rewind(&exchange, &error));
    }
    step(3);
    TEST_ASSERT_EQUAL_UINT64(3, tl_test_log_count(&call_log, NULL, TL_TEST_GET_STATE));
    TEST_ASSERT_EQUAL_UINT64(9, tl_test_log_count(&call_log, NULL, TL_TEST_SET_STATE));
    TEST_ASSERT_EQUAL_UINT64(3 + 12 + 1, exchange.plant.executions);
    for (size_t n = 0; n < 16; n++) { /* only committed steps are final */
        TEST_ASSERT_EQUAL_INT(n < 3 || n == 15, tl_test_log_step(&call_log, &fmus[1], n)->final);
    }
}

static void a_component_takes_part_as_far_as_it_reaches(void) {
    static uint32_t reach[4] = {1, 2, 3, 0}; /* Γ_k of in, k1, out, and of the plant */
    chain_with_lag();
    TEST_ASSERT_TRUE(tl_exchange_save_executions(&exchange, &arena, NULL, reach, NULL, 3));
    walk_to_the_fourth_step();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_begin(&exchange, &error));
    for (uint32_t depth = 0; depth < 3; depth++) {
        try(3 + (int64_t)depth, depth);
    }
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_UINT64(3 + reach[i], graph.components[i].executions);
    }
    TEST_ASSERT_EQUAL_UINT64(3, exchange.plant.executions);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_rewind(&exchange, &error));
    step(3); /* executes all components */
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_UINT64(4 + reach[i], graph.components[i].executions);
    }
    TEST_ASSERT_EQUAL_UINT64(4, exchange.plant.executions);
}

static void what_is_known_is_not_executed_again(void) {
    static const tl_keep keep[3] = {TL_KEEP_STATES, TL_KEEP_STATES, TL_KEEP_STATES};
    static const uint32_t capacity[3] = {32, 32, 32};
    chain_with_lag();
    TEST_ASSERT_TRUE(tl_exchange_save_executions(&exchange, &arena, keep, NULL, capacity, 4));
    push(1.0);
    initialize();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_start(&exchange, 0, NULL, &error));
    for (int64_t i = 1; i < 5; i++) {
        push(1.0 / 7.0 + (double)i);
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_begin(&exchange, &error));
    for (int round = 0; round < 3; round++) {
        for (uint32_t depth = 0; depth < 4; depth++) {
            try((int64_t)depth, depth);
        }
        assert_same_outputs(round);
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_rewind(&exchange, &error));
    }
    step(0);
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_UINT64(4, graph.components[i].executions);
        tl_exchange_end_component(&exchange, i);
        TEST_ASSERT_EQUAL_UINT64(0, fmus[i].states);
    }
    TEST_ASSERT_EQUAL_UINT64(4, exchange.plant.executions);
}

static void a_failed_step_ends_at_once_and_can_be_taken_back(void) {
    make_chain(false);
    build_reading_out(2);
    push(1.0);
    initialize();
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_begin(&exchange, &error));
    tl_test_fmu_fail(&fmus[1], TL_TEST_DO_STEP, TL_TEST_ERROR, 1, 1);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, tl_exchange_commit(&exchange, 0, &error));
    TL_EXPECT_PARTS("k1|fmi2DoStep|fmi2Error", error.text);
    TEST_ASSERT_EQUAL_UINT64(1, exchange.failed);
    TEST_ASSERT_EQUAL_UINT64(0, fmus[2].calls[TL_TEST_DO_STEP]);
    TEST_ASSERT_EQUAL_UINT64(0, exchange.plant.executions);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_exchange_rewind(&exchange, &error));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, output(0));
    step(0);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, output(0));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(an_output_n_components_on_reacts_after_n_and_1_steps);
    RUN_TEST(the_order_of_the_components_does_not_matter);
    RUN_TEST(all_inputs_are_from_before_the_step);
    RUN_TEST(an_fmu_that_is_not_read_in_initialisation_mode);
    RUN_TEST(each_step_executes_every_component_once);
    RUN_TEST(communication_points_come_from_the_integer);
    RUN_TEST(units_are_converted_on_the_way);
    RUN_TEST(a_signals_unit_is_converted_too);
    RUN_TEST(integers_booleans_and_enumerations_are_exchanged_exactly);
    RUN_TEST(one_output_may_drive_many_inputs);
    RUN_TEST(a_chain_of_feed_through_settles_before_the_first_step);
    RUN_TEST(a_cycle_of_feed_through_ends_too);
    RUN_TEST(without_feed_through_outputs_begin_at_their_start);
    RUN_TEST(a_failure_while_initialising_stops_it);
    RUN_TEST(a_cut_connection_delivers_to_the_nominal_only);
    RUN_TEST(a_cut_connection_converts_units_as_any_other);
    RUN_TEST(a_snapshot_brings_back_states_and_values_to_the_bit);
    RUN_TEST(candidates_begin_where_was_committed);
    RUN_TEST(a_component_takes_part_as_far_as_it_reaches);
    RUN_TEST(what_is_known_is_not_executed_again);
    RUN_TEST(a_failed_step_ends_at_once_and_can_be_taken_back);
    return UNITY_END();
}
