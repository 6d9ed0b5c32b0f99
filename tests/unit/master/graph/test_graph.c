/* The graph of a co-simulation: valid plans, problems of wrong plans, and distances. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "master/graph/graph.h"
#include "tests/support/message.h"
#include "tests/support/test_plan.h"

static const tl_unit kelvin = {"K", true, {0, 0, 0, 0, 1}, 1.0, 0.0};
static const tl_unit celsius = {"degC", true, {0, 0, 0, 0, 1}, 1.0, 273.15};
static const tl_unit ampere = {"A", true, {0, 0, 0, 1}, 1.0, 0.0};
static const tl_unit named_only = {"turns", false, {0}, 0.0, 0.0};

static tl_test_log call_log;
static tl_test_fmu fmus[5];
static tl_test_plan plan;
static tl_twin *twin;

/* A valid plan: "motor" has two channels and the discrete variables; a signal drives each input. */
static void make_motor(void) {
    tl_test_fmu_init(&fmus[0], 2, true, &call_log);
    tl_test_plan_component(&plan, "motor", &fmus[0]);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_signal(&plan, "on", TL_BOOLEAN, "");
    tl_test_plan_signal(&plan, "n", TL_INTEGER, "");
    tl_test_plan_connect(&plan, "plant.cmd", "motor.u0");
    tl_test_plan_connect(&plan, "plant.cmd", "motor.u1");
    tl_test_plan_connect(&plan, "plant.on", "motor.flag");
    tl_test_plan_connect(&plan, "plant.n", "motor.count");
    tl_test_plan_connect(&plan, "plant.n", "motor.mode");
}

/* A component with `width` Real channels. */
static tl_test_fmu *add(size_t number, const char *name, size_t width) {
    tl_test_fmu_init(&fmus[number], width, false, &call_log);
    tl_test_plan_component(&plan, name, &fmus[number]);
    return &fmus[number];
}

void setUp(void) {
    tl_test_log_clear(&call_log);
    tl_test_plan_init(&plan, TL_SECOND / 10);
    twin = NULL;
}

void tearDown(void) {
    tl_twin_destroy(twin);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

static void assert_problem(const char *where, const char *parts) {
    char all[2000] = "";
    const tl_test_problem *problem = NULL;
    for (size_t i = 0; i < plan.report.count && i < TL_TEST_PROBLEMS; i++) {
        const tl_test_problem *one = &plan.problems[i];
        size_t length = strlen(all);
        (void)snprintf(all + length, sizeof all - length, "[%s] %s; ", one->where, one->text);
        problem = strcmp(one->where, where) == 0 && tl_test_has_parts(one->text, parts) ? one : problem;
    }
    TEST_ASSERT_NOT_NULL_MESSAGE(problem, all);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, problem->status);
}

/* Builds a plan that has exactly one problem. */
static void assert_refused(const char *where, const char *parts) {
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    assert_problem(where, parts);
    TEST_ASSERT_EQUAL_STRING("", plan.problems[1].text);
    TEST_ASSERT_EQUAL_UINT64(1, plan.report.count);
    TEST_ASSERT_EQUAL_UINT64(0, call_log.count); /* a wrong plan calls no FMU */
}

static void assert_accepted(void) {
    tl_twin_destroy(twin); /* of an earlier accepted plan, or NULL */
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_EQUAL_STRING("", plan.problems[0].text);
    TEST_ASSERT_NOT_NULL(twin);
}

/* ---- connections ---- */

static void a_plan_in_order_is_accepted(void) {
    make_motor();
    assert_accepted();
}

static void an_unknown_component_is_named_with_an_example(void) {
    make_motor();
    tl_test_plan_connect(&plan, "engine.y0", "motor.u0");
    assert_refused("connect[5]", "engine.y0|\"motor.");
}

static void a_name_without_a_component_is_unknown(void) {
    make_motor();
    tl_test_plan_connect(&plan, "motor", "motor.u0");
    assert_refused("connect[5]", "\"motor\"");
}

static void a_name_that_only_begins_like_a_component_is_unknown(void) {
    make_motor();
    tl_test_plan_connect(&plan, "motors.y0", "motor.u0");
    assert_refused("connect[5]", "motors.y0");
}

static void an_unknown_variable_is_named(void) {
    make_motor();
    tl_test_plan_connect(&plan, "motor.y7", "motor.u0");
    assert_refused("connect[5]", "motor|\"y7\"");
}

static void the_most_similar_variable_is_named(void) {
    make_motor();
    tl_test_plan_connect(&plan, "motor.Y0", "motor.u0");
    assert_refused("connect[5]", "motor|\"Y0\"|\"y0\"|twinlock check");
}

static void an_unknown_signal_is_named(void) {
    make_motor();
    tl_test_plan_connect(&plan, "plant.torque", "motor.u0");
    assert_refused("connect[5]", "plant.torque|signal");
}

static void a_second_connection_to_an_input_is_refused(void) {
    make_motor();
    tl_test_plan_connect(&plan, "motor.y0", "motor.u0");
    assert_refused("connect[5]", "motor.u0|twice");
}

static void types_must_fit(void) {
    make_motor();
    plan.connections[2].from = "plant.cmd";
    assert_refused("connect[2]", "plant.cmd|Real|motor.flag|Boolean");
}

static void an_integer_is_no_boolean(void) {
    make_motor();
    plan.connections[2].from = "motor.count_out";
    assert_refused("connect[2]", "motor.count_out|Integer|motor.flag|Boolean");
}

static void an_enumeration_fits_an_integer(void) {
    make_motor();
    plan.connections[3].from = "motor.mode_out";
    plan.connections[4].from = "motor.count_out";
    assert_accepted();
}

static void text_is_no_source(void) {
    make_motor();
    plan.connections[2].from = "motor.label_out";
    assert_refused("connect[2]", "motor.label_out|String");
}

static void an_input_is_no_source(void) {
    make_motor();
    plan.connections[0].from = "motor.u1";
    assert_refused("connect[0]", "motor.u1|input|output");
}

static void an_output_is_no_target(void) {
    make_motor();
    tl_test_plan_connect(&plan, "plant.cmd", "motor.y0");
    assert_refused("connect[5]", "motor.y0|continuous output|input");
}

static void a_parameter_is_no_target(void) {
    make_motor();
    tl_test_plan_connect(&plan, "plant.cmd", "motor.gain");
    assert_refused("connect[5]", "motor.gain|tunable parameter|input");
}

static void an_input_that_nothing_drives_is_reported(void) {
    make_motor();
    plan.plan.connection_count = 4; /* the last one, to mode, is left out */
    assert_refused("components.motor", "motor.mode|components.motor.set");
}

static void an_input_with_a_constant_is_driven(void) {
    make_motor();
    plan.plan.connection_count = 4;
    tl_test_plan_set(&plan, "mode", 3.0);
    assert_accepted();
}

static void an_adjusted_input_is_driven(void) {
    (void)add(0, "motor", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_adjust(&plan, "motor.u0", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_accepted();
}

/* ---- units ---- */

static void units_of_another_dimension_are_refused(void) {
    make_motor();
    tl_test_fmu_variable(&fmus[0], "y0")->unit = &ampere;
    tl_test_fmu_variable(&fmus[0], "u1")->unit = &kelvin;
    plan.connections[1].from = "motor.y0";
    assert_refused("connect[1]", "motor.y0|\"A\"|motor.u1|\"K\"");
}

static void a_unit_of_a_signal_is_looked_up_in_the_fmu(void) {
    static const tl_unit known[] = {{"K", true, {0, 0, 0, 0, 1}, 1.0, 0.0}, {"A", true, {0, 0, 0, 1}, 1.0, 0.0}};
    make_motor();
    fmus[0].model.units = known;
    fmus[0].model.unit_count = 2;
    tl_test_fmu_variable(&fmus[0], "u0")->unit = &known[0];
    plan.signals[0].unit = "A";
    assert_refused("connect[0]", "plant.cmd|\"A\"|motor.u0|\"K\"");
}

static void a_unit_that_the_fmu_does_not_know_must_have_the_same_name(void) {
    make_motor();
    tl_test_fmu_variable(&fmus[0], "u0")->unit = &kelvin;
    plan.signals[0].unit = "C";
    assert_refused("connect[0]", "plant.cmd|\"C\"|motor.u0|\"K\"");
    plan.signals[0].unit = "K";
    assert_accepted();
    fmus[0].model.units = &kelvin;
    fmus[0].model.unit_count = 1;
    plan.signals[0].unit = NULL; /* no unit */
    assert_accepted();
}

static void units_that_convert_are_accepted(void) {
    make_motor();
    tl_test_fmu_variable(&fmus[0], "y0")->unit = &celsius;
    tl_test_fmu_variable(&fmus[0], "u1")->unit = &kelvin;
    plan.connections[1].from = "motor.y0";
    assert_accepted();
}

static tl_twin_bounds bounds_of(size_t signal) {
    assert_accepted();
    return tl_twin_get_bounds(twin, signal);
}

static void limit(const char *name, double minimum, double maximum) {
    tl_variable *variable = tl_test_fmu_variable(&fmus[0], name);
    variable->minimum = minimum;
    variable->maximum = maximum;
}

static void a_signal_has_the_bounds_of_all_its_inputs(void) {
    make_motor();
    TEST_ASSERT_NULL(bounds_of(0).input);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, bounds_of(0).scale);
    limit("u1", -10.0, 30.0);
    TEST_ASSERT_EQUAL_STRING("u1", bounds_of(0).input);
    limit("u0", 0.0, 50.0);
    tl_test_fmu_variable(&fmus[0], "u1")->nominal = 4.0;
    tl_twin_bounds bounds = bounds_of(0);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, bounds.least);
    TEST_ASSERT_EQUAL_DOUBLE(30.0, bounds.most);
    TEST_ASSERT_EQUAL_DOUBLE(4.0, bounds.scale);
    TEST_ASSERT_EQUAL_STRING("motor", bounds.component);
    TEST_ASSERT_EQUAL_STRING("u0", bounds.input);
    limit("u0", 31.0, 50.0);
    bounds = bounds_of(0);
    TEST_ASSERT_TRUE(bounds.least > bounds.most);
    TEST_ASSERT_NULL(bounds_of(2).input); /* Boolean */
}

/* Rounding must not bring the converted value beyond a bound. */
static void bounds_are_in_the_unit_of_the_signal(void) {
    static const double factors[] = {100000.0, 1.0 / 3.0, -0.1, 9.80665e-3};
    make_motor();
    for (size_t i = 0; i < sizeof factors / sizeof factors[0]; i++) {
        const tl_unit units[] = {{"own", true, {0, 0, 0, 1}, factors[i], 0.7}, {"A", true, {0, 0, 0, 1}, 1.0, 0.0}};
        fmus[0].model.units = units;
        fmus[0].model.unit_count = 2;
        plan.signals[0].unit = "own";
        tl_test_fmu_variable(&fmus[0], "u0")->unit = &units[1];
        limit("u0", -0.3, 50.1);
        tl_twin_bounds bounds = bounds_of(0);
        double ends[2] = {factors[i] * bounds.least + 0.7, factors[i] * bounds.most + 0.7};
        for (size_t k = 0; k < 2; k++) {
            TEST_ASSERT_TRUE(ends[k] >= -0.3 && ends[k] <= 50.1);
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, 50.4, fabs(ends[1] - ends[0]));
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, 1.0, fabs(bounds.scale * factors[i]));
    }
}

static void items_of_enumerations_are_bounds(void) {
    make_motor();
    limit("mode", 1.0, 5.0);
    tl_test_fmu_variable(&fmus[0], "mode")->items = 0x15; /* 1, 3, 5 */
    tl_twin_bounds bounds = bounds_of(3);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, bounds.least);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, bounds.most);
    TEST_ASSERT_EQUAL_HEX64(0x15, bounds.items);
    limit("count", 2.0, 4.0); /* the other input of the signal */
    bounds = bounds_of(3);
    TEST_ASSERT_EQUAL_DOUBLE(2.0, bounds.least);
    TEST_ASSERT_EQUAL_DOUBLE(4.0, bounds.most);
    TEST_ASSERT_EQUAL_HEX64(0x0A, bounds.items); /* 3, 5 */
    limit("count", 70.0, 80.0);
    bounds = bounds_of(3);
    TEST_ASSERT_TRUE(bounds.least > bounds.most);
}

static void a_match_in_another_unit_is_refused(void) {
    make_motor();
    tl_test_fmu_variable(&fmus[0], "y0")->unit = &named_only;
    plan.signals[1].unit = "rad";
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("match.motor.y0", "plant.y|\"rad\"|motor.y0|\"turns\"");
}

/* ---- set ---- */

static void a_set_of_an_unknown_variable_is_refused(void) {
    make_motor();
    tl_test_plan_set(&plan, "inertia", 1.0);
    assert_refused("set.inertia", "motor|\"inertia\"");
}

static void a_set_of_an_output_is_refused(void) {
    make_motor();
    tl_test_plan_set(&plan, "y0", 1.0);
    assert_refused("set.y0", "motor.y0|continuous output|parameter");
}

static void a_set_of_a_constant_is_refused(void) {
    make_motor();
    tl_test_fmu_variable(&fmus[0], "lag")->variability = TL_CONSTANT;
    tl_test_plan_set(&plan, "lag", 1.0);
    assert_refused("set.lag", "motor.lag|constant parameter");
}

static void a_set_must_fit_the_type(void) {
    const tl_value text = {.type = TL_STRING, .text = "fast"};
    const tl_value yes = {.type = TL_BOOLEAN, .integer = 1};
    make_motor();
    plan.plan.connection_count = 2; /* flag, count and mode are set instead */
    tl_test_plan_set_value(&plan, "gain", text);
    tl_test_plan_set(&plan, "count", 2.5);
    tl_test_plan_set(&plan, "mode", 4e9);
    tl_test_plan_set(&plan, "flag", 1.0);
    tl_test_plan_set(&plan, "label", 1.0);
    tl_test_plan_set_value(&plan, "lag", yes);
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    TEST_ASSERT_EQUAL_UINT64(6, plan.report.count); /* all are reported */
    assert_problem("set.gain", "motor.gain|Real|number");
    assert_problem("set.count", "motor.count|Integer|whole number");
    assert_problem("set.mode", "motor.mode|Enumeration|whole number");
    assert_problem("set.flag", "motor.flag|Boolean|true|false");
    assert_problem("set.label", "motor.label|String|text");
    assert_problem("set.lag", "motor.lag|Real|number");
}

static void a_number_that_is_not_finite_cannot_be_set(void) {
    make_motor();
    plan.plan.connection_count = 3;
    tl_test_plan_set(&plan, "gain", HUGE_VAL);
    tl_test_plan_set(&plan, "count", (double)NAN);
    tl_test_plan_set(&plan, "mode", -HUGE_VAL);
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    TEST_ASSERT_EQUAL_UINT64(3, plan.report.count);
    assert_problem("set.gain", "motor.gain|Real|number");
    assert_problem("set.count", "motor.count|Integer|whole number");
    assert_problem("set.mode", "motor.mode|Enumeration|whole number");
}

static void a_set_may_have_the_variables_own_type(void) {
    const tl_value five = {.type = TL_INTEGER, .integer = 5};
    const tl_value two = {.type = TL_ENUMERATION, .integer = 2};
    tl_value fitted;
    const char *expected = "";
    tl_test_fmu_init(&fmus[0], 1, true, &call_log);
    TEST_ASSERT_TRUE(tl_graph_fit_value(tl_test_fmu_variable(&fmus[0], "count"), &five, &fitted, &expected));
    TEST_ASSERT_EQUAL_INT32(5, fitted.integer);
    TEST_ASSERT_TRUE(tl_graph_fit_value(tl_test_fmu_variable(&fmus[0], "mode"), &two, &fitted, &expected));
    TEST_ASSERT_EQUAL_INT32(2, fitted.integer);
    TEST_ASSERT_TRUE(tl_graph_fit_value(tl_test_fmu_variable(&fmus[0], "gain"), &five, &fitted, &expected));
    TEST_ASSERT_EQUAL_DOUBLE(5.0, fitted.real);
    TEST_ASSERT_EQUAL_INT(TL_REAL, fitted.type);
}

static void a_whole_number_of_json_becomes_an_integer_exactly(void) {
    const tl_value lowest = {.type = TL_REAL, .real = -2147483647.0};
    tl_value fitted;
    const char *expected = "";
    tl_test_fmu_init(&fmus[0], 1, true, &call_log);
    TEST_ASSERT_TRUE(tl_graph_fit_value(tl_test_fmu_variable(&fmus[0], "count"), &lowest, &fitted, &expected));
    TEST_ASSERT_EQUAL_INT32(-2147483647, fitted.integer);
    TEST_ASSERT_EQUAL_INT(TL_INTEGER, fitted.type);
}

static void an_fmu_for_one_instance_only_is_not_used_twice(void) {
    make_motor();
    tl_test_plan_component(&plan, "other", &fmus[0]);
    plan.components[1].set = plan.components[0].set;
    fmus[0].model.capabilities.can_be_instantiated_only_once = true;
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    assert_problem("components.other", "motor|other");
}

/* ---- adjusted and matched variables ---- */

static void a_fixed_parameter_cannot_be_adjusted(void) {
    make_motor();
    tl_test_plan_adjust(&plan, "motor.lag", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("adjust.motor.lag", "motor.lag|fixed parameter|tunable");
}

static void only_reals_and_booleans_are_adjusted(void) {
    make_motor();
    tl_test_plan_adjust(&plan, "motor.count", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("adjust.motor.count", "motor.count|Integer|Real|Boolean");
}

static void an_output_is_not_adjusted(void) {
    make_motor();
    tl_test_plan_adjust(&plan, "motor.y1", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("adjust.motor.y1", "motor.y1|continuous output|input");
}

static void an_unknown_variable_is_not_adjusted(void) {
    make_motor();
    tl_test_plan_adjust(&plan, "motor.d", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("adjust.motor.d", "motor|\"d\"");
}

static void a_connected_input_has_no_nominal_of_its_own(void) {
    make_motor();
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "motor.u0", 1.0);
    adjust->has_nominal = true;
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("adjust.motor.u0", "motor.u0|connection|\"nominal\"");
}

static void bounds_must_leave_something(void) {
    make_motor();
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "motor.gain", 1.0);
    adjust->lower = 2.0;
    tl_test_fmu_variable(&fmus[0], "gain")->maximum = 1.5;
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("adjust.motor.gain", "2|1.5");
}

static void a_parameter_without_a_start_value_needs_a_nominal(void) {
    make_motor();
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "motor.gain", 1.0);
    tl_test_fmu_variable(&fmus[0], "gain")->has_start = false;
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("adjust.motor.gain", "motor.gain|start value|\"nominal\"");
    adjust->has_nominal = true;
    assert_accepted();
}

static void a_match_is_an_output(void) {
    make_motor();
    tl_test_plan_match(&plan, "motor.gain", "plant.y", 1.0);
    assert_refused("match.motor.gain", "motor.gain|Real parameter|output");
}

static void a_match_is_not_text(void) {
    make_motor();
    tl_test_plan_match(&plan, "motor.label_out", "plant.y", 1.0);
    assert_refused("match.motor.label_out", "motor.label_out|String");
}

static void a_match_is_with_a_signal(void) {
    make_motor();
    tl_test_plan_match(&plan, "motor.y0", "motor.y1", 1.0);
    assert_refused("match.motor.y0", "motor.y1|plant.cmd");
}

static void a_match_has_the_signals_type(void) {
    make_motor();
    tl_test_plan_match(&plan, "motor.flag_out", "plant.y", 1.0);
    assert_refused("match.motor.flag_out", "motor.flag_out|Boolean|plant.y|Real");
}

static void no_path_is_reported_for_both_ends(void) {
    (void)add(0, "a", 1);
    (void)add(1, "b", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "b.y0", "a.u0"); /* in the other direction */
    tl_test_plan_connect(&plan, "plant.y", "b.u0");
    tl_test_plan_adjust(&plan, "a.gain", 1.0);
    tl_test_plan_match(&plan, "b.y0", "plant.y", 1.0);
    assert_refused("adjust.a.gain", "a.gain|path");
}

static void a_match_that_nothing_reaches_is_reported(void) {
    (void)add(0, "a", 1);
    (void)add(1, "b", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.y", "a.u0");
    tl_test_plan_connect(&plan, "plant.y", "b.u0");
    tl_test_plan_adjust(&plan, "a.gain", 1.0);
    tl_test_plan_match(&plan, "a.y0", "plant.y", 1.0);
    tl_plan_match *other = tl_test_plan_match(&plan, "b.y0", "plant.y", 1.0);
    assert_refused("match.b.y0", "b.y0|path|\"weight\"");
    other->weight = 0.0;
    assert_accepted();
}

static void an_adjusted_variable_needs_a_match_with_a_weight(void) {
    make_motor();
    tl_test_plan_adjust(&plan, "motor.gain", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0)->weight = 0.0;
    assert_refused("adjust.motor.gain", "motor.gain|path");
}

static void a_state_that_cannot_be_saved_matters_only_to_synchronising(void) {
    make_motor();
    fmi2SetFMUstateTYPE *set = fmus[0].functions.set_fmu_state;
    fmus[0].functions.set_fmu_state = NULL;
    assert_accepted();
    tl_twin_destroy(twin);
    tl_test_log_clear(&call_log);
    tl_test_plan_adjust(&plan, "motor.gain", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("components.motor", "canGetAndSetFMUstate");
    fmus[0].functions.set_fmu_state = set;
    fmus[0].functions.free_fmu_state = NULL;
    assert_refused("components.motor", "canGetAndSetFMUstate");
}

static void the_known_algorithms_are_listed_for_an_unknown_one(void) {
    make_motor();
    plan.plan.algorithm = "simulated-annealing";
    tl_test_plan_adjust(&plan, "motor.gain", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    assert_refused("synchronise.algorithm", "\"simulated-annealing\"|\"secant\"|\"nelder-mead\"|\"boolean\"");
}

static void every_problem_is_reported_at_once(void) {
    make_motor();
    tl_test_plan_connect(&plan, "engine.y0", "motor.u0");
    tl_test_plan_set(&plan, "inertia", 1.0);
    tl_test_plan_adjust(&plan, "motor.lag", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.nothing", 1.0);
    plan.plan.algorithm = "";
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    TEST_ASSERT_EQUAL_UINT64(5, plan.report.count);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, plan.report.first_status);
}

/* ---- numbers ---- */

static void numbers_out_of_their_range_are_refused(void) {
    make_motor();
    tl_plan_adjust *adjust = tl_test_plan_adjust(&plan, "motor.gain", 0.0);
    adjust->has_nominal = true;
    adjust->nominal = (double)NAN;
    tl_plan_match *match = tl_test_plan_match(&plan, "motor.y0", "plant.y", 0.0);
    match->weight = -1.0;
    tl_test_plan_match(&plan, "motor.y1", "plant.y", 1.0);
    tl_test_plan_adjust(&plan, "motor.offset", 1.0)->upper = (double)NAN;
    plan.signals[0].has_initial = true;
    plan.signals[0].initial = -HUGE_VAL;
    plan.signals[3].has_initial = true;
    plan.signals[3].initial = 2147483648.0; /* an integer signal */
    plan.plan.margin = 1.0;
    plan.plan.step = 0;
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    assert_problem("step_s", "0 s");
    assert_problem("synchronise.margin", "0|1");
    assert_problem("adjust.motor.gain", "\"step\"|0");
    assert_problem("adjust.motor.gain", "\"nominal\"|nan");
    assert_problem("match.motor.y0", "\"tolerance\"|0");
    assert_problem("match.motor.y0", "\"weight\"|-1");
    assert_problem("adjust.motor.offset", "bound");
    assert_problem("plant.cmd", "\"initial\"|-inf");
    assert_problem("plant.n", "\"initial\"|2147483647");
    TEST_ASSERT_EQUAL_UINT64(9, plan.report.count);
}

static void too_many_of_anything_is_refused(void) {
    static char names[TL_MAX_SIGNALS + 1][8];
    make_motor();
    for (size_t i = plan.plan.signal_count; i <= TL_MAX_SIGNALS; i++) {
        (void)snprintf(names[i], sizeof names[i], "s%u", (unsigned)i);
        tl_test_plan_signal(&plan, names[i], TL_REAL, "");
    }
    for (size_t i = 0; i <= TL_MAX_ADJUST; i++) {
        tl_test_plan_adjust(&plan, "motor.gain", 1.0);
    }
    for (size_t i = 0; i <= TL_MAX_MATCH; i++) {
        tl_test_plan_match(&plan, "motor.y0", "plant.y", 1.0);
    }
    twin = tl_test_plan_build(&plan);
    TEST_ASSERT_NULL(twin);
    assert_problem("plant", "65|64");
    assert_problem("synchronise.adjust", "9|8");
    assert_problem("synchronise.match", "65|64");
    TEST_ASSERT_EQUAL_UINT64(3, plan.report.count);
}

/* ---- distances ---- */

static tl_arena arena;
static tl_graph graph;

/* Builds the graph only, without instances. */
static void build_graph(void) {
    tl_arena_init(&arena);
    memset(&graph, 0, sizeof graph);
    tl_graph_build(&graph, &arena, &plan.plan, &plan.report);
    TEST_ASSERT_EQUAL_UINT64(0, plan.report.count);
}

static size_t distance(size_t from, size_t to) {
    size_t scratch[8];
    return tl_graph_distance(&graph, from, to, scratch);
}

static void a_chain_has_one_distance_per_edge(void) {
    (void)add(0, "in", 1);
    (void)add(1, "k1", 1);
    (void)add(2, "out", 1);
    tl_test_plan_signal(&plan, "cmd", TL_REAL, "");
    tl_test_plan_connect(&plan, "plant.cmd", "in.u0");
    tl_test_plan_connect(&plan, "in.y0", "k1.u0");
    tl_test_plan_connect(&plan, "k1.y0", "out.u0");
    build_graph();
    TEST_ASSERT_EQUAL_UINT64(0, distance(1, 1));
    TEST_ASSERT_EQUAL_UINT64(1, distance(0, 1));
    TEST_ASSERT_EQUAL_UINT64(2, distance(0, 2));
    TEST_ASSERT_EQUAL_UINT64(3, distance(3, 2)); /* from the plant */
    TEST_ASSERT_TRUE(distance(2, 0) == TL_UNREACHABLE);
    TEST_ASSERT_TRUE(distance(0, 3) == TL_UNREACHABLE);
    tl_arena_release(&arena);
}

static void of_parallel_paths_the_shortest_counts(void) {
    (void)add(0, "in", 1);
    (void)add(1, "k1", 1);
    (void)add(2, "k2", 1);
    (void)add(3, "out", 2);
    tl_test_plan_connect(&plan, "in.y0", "k1.u0");
    tl_test_plan_connect(&plan, "k1.y0", "k2.u0");
    tl_test_plan_connect(&plan, "k2.y0", "out.u0");
    tl_test_plan_connect(&plan, "k1.y0", "out.u1");
    build_graph();
    TEST_ASSERT_EQUAL_UINT64(2, distance(0, 3));
    TEST_ASSERT_EQUAL_UINT64(2, distance(0, 2));
    tl_arena_release(&arena);
}

static void a_cycle_is_walked_once(void) {
    (void)add(0, "a", 1);
    (void)add(1, "b", 1);
    (void)add(2, "c", 1);
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    tl_test_plan_connect(&plan, "b.y0", "c.u0");
    tl_test_plan_connect(&plan, "c.y0", "a.u0");
    build_graph();
    TEST_ASSERT_EQUAL_UINT64(2, distance(0, 2));
    TEST_ASSERT_EQUAL_UINT64(1, distance(2, 0));
    TEST_ASSERT_EQUAL_UINT64(0, distance(0, 0));
    tl_arena_release(&arena);
}

static void a_cut_connection_is_no_path(void) {
    (void)add(0, "a", 1);
    (void)add(1, "b", 1);
    const tl_plan_adjust adjust = {.where = "", .variable = "b.u0", .step = 1.0};
    tl_test_plan_connect(&plan, "a.y0", "b.u0");
    build_graph();
    TEST_ASSERT_EQUAL_UINT64(1, distance(0, 1));
    const tl_port *port = tl_graph_adjust(&graph, &adjust, &plan.report);
    TEST_ASSERT_NOT_NULL(port);
    TEST_ASSERT_TRUE(distance(0, 1) == TL_UNREACHABLE);
    TEST_ASSERT_TRUE(tl_graph_connection_to(&graph, port)->cut);
    tl_arena_release(&arena);
}

static void a_prediction_shorter_than_the_distance_is_refused(void) {
    (void)add(0, "in", 1);
    (void)add(1, "k1", 1);
    (void)add(2, "out", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "in.y0", "k1.u0");
    tl_test_plan_connect(&plan, "k1.y0", "out.u0");
    tl_test_plan_adjust(&plan, "in.u0", 1.0);
    tl_test_plan_match(&plan, "out.y0", "plant.y", 1.0);
    plan.plan.prediction = 2;
    assert_refused("synchronise.horizon.prediction", "2|3");
    plan.plan.prediction = 3;
    assert_accepted();
    TEST_ASSERT_EQUAL_UINT32(3, tl_twin_get_facts(twin).prediction);
}

static void every_adjusted_variable_must_matter_within_the_prediction(void) {
    (void)add(0, "in", 1);
    (void)add(1, "out", 1);
    tl_test_plan_signal(&plan, "y", TL_REAL, "");
    tl_test_plan_connect(&plan, "in.y0", "out.u0");
    tl_test_plan_adjust(&plan, "in.u0", 1.0);
    tl_test_plan_adjust(&plan, "out.offset", 1.0);
    tl_test_plan_match(&plan, "out.y0", "plant.y", 1.0);
    plan.plan.prediction = 1;
    assert_refused("synchronise.horizon.prediction", "1|2");
    plan.plan.prediction = 0;
    assert_accepted();
    TEST_ASSERT_EQUAL_UINT32(2, tl_twin_get_facts(twin).prediction);
    TEST_ASSERT_EQUAL_UINT32(1, tl_twin_get_facts(twin).distance);
}

static void run_connections(void) {
    RUN_TEST(a_plan_in_order_is_accepted);
    RUN_TEST(an_unknown_component_is_named_with_an_example);
    RUN_TEST(a_name_without_a_component_is_unknown);
    RUN_TEST(a_name_that_only_begins_like_a_component_is_unknown);
    RUN_TEST(an_unknown_variable_is_named);
    RUN_TEST(the_most_similar_variable_is_named);
    RUN_TEST(an_unknown_signal_is_named);
    RUN_TEST(a_second_connection_to_an_input_is_refused);
    RUN_TEST(types_must_fit);
    RUN_TEST(an_integer_is_no_boolean);
    RUN_TEST(an_enumeration_fits_an_integer);
    RUN_TEST(text_is_no_source);
    RUN_TEST(an_input_is_no_source);
    RUN_TEST(an_output_is_no_target);
    RUN_TEST(a_parameter_is_no_target);
    RUN_TEST(an_input_that_nothing_drives_is_reported);
    RUN_TEST(an_input_with_a_constant_is_driven);
    RUN_TEST(an_adjusted_input_is_driven);
    RUN_TEST(units_of_another_dimension_are_refused);
    RUN_TEST(a_unit_of_a_signal_is_looked_up_in_the_fmu);
    RUN_TEST(a_unit_that_the_fmu_does_not_know_must_have_the_same_name);
    RUN_TEST(units_that_convert_are_accepted);
    RUN_TEST(a_signal_has_the_bounds_of_all_its_inputs);
    RUN_TEST(bounds_are_in_the_unit_of_the_signal);
    RUN_TEST(items_of_enumerations_are_bounds);
    RUN_TEST(a_match_in_another_unit_is_refused);
}

static void run_values(void) {
    RUN_TEST(a_set_of_an_unknown_variable_is_refused);
    RUN_TEST(a_set_of_an_output_is_refused);
    RUN_TEST(a_set_of_a_constant_is_refused);
    RUN_TEST(a_set_must_fit_the_type);
    RUN_TEST(a_number_that_is_not_finite_cannot_be_set);
    RUN_TEST(a_set_may_have_the_variables_own_type);
    RUN_TEST(a_whole_number_of_json_becomes_an_integer_exactly);
    RUN_TEST(an_fmu_for_one_instance_only_is_not_used_twice);
    RUN_TEST(numbers_out_of_their_range_are_refused);
    RUN_TEST(too_many_of_anything_is_refused);
}

static void run_synchronisation(void) {
    RUN_TEST(a_fixed_parameter_cannot_be_adjusted);
    RUN_TEST(only_reals_and_booleans_are_adjusted);
    RUN_TEST(an_output_is_not_adjusted);
    RUN_TEST(an_unknown_variable_is_not_adjusted);
    RUN_TEST(a_connected_input_has_no_nominal_of_its_own);
    RUN_TEST(bounds_must_leave_something);
    RUN_TEST(a_parameter_without_a_start_value_needs_a_nominal);
    RUN_TEST(a_match_is_an_output);
    RUN_TEST(a_match_is_not_text);
    RUN_TEST(a_match_is_with_a_signal);
    RUN_TEST(a_match_has_the_signals_type);
    RUN_TEST(no_path_is_reported_for_both_ends);
    RUN_TEST(a_match_that_nothing_reaches_is_reported);
    RUN_TEST(an_adjusted_variable_needs_a_match_with_a_weight);
    RUN_TEST(a_state_that_cannot_be_saved_matters_only_to_synchronising);
    RUN_TEST(the_known_algorithms_are_listed_for_an_unknown_one);
    RUN_TEST(every_problem_is_reported_at_once);
}

static void run_distances(void) {
    RUN_TEST(a_chain_has_one_distance_per_edge);
    RUN_TEST(of_parallel_paths_the_shortest_counts);
    RUN_TEST(a_cycle_is_walked_once);
    RUN_TEST(a_cut_connection_is_no_path);
    RUN_TEST(a_prediction_shorter_than_the_distance_is_refused);
    RUN_TEST(every_adjusted_variable_must_matter_within_the_prediction);
}

int main(void) {
    UNITY_BEGIN();
    run_connections();
    run_values();
    run_synchronisation();
    run_distances();
    return UNITY_END();
}
