/* The warnings of `check`: the condition, the values and the layout of each. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/cli/advice.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/read_assembly.h"
#include "tests/support/scratch.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"
#define SLOW TL_SOURCE_DIR "/config/transport/slow.json"
#define ON_A_LINE TL_SOURCE_DIR "/config/motor/lock.json"
#define LIVE TL_SOURCE_DIR "/tests/support/motor_live.json"
#define BUS TL_SOURCE_DIR "/tests/support/motor_can.json"

static tl_scratch scratch;
static tl_assembly assembly;
static tl_prognosis prognosis;
static tl_late_verification look;
static tl_read_back_report states;
static tl_response responses[TL_MAX_ADJUST];
static char *printed;

enum { WARNINGS = 4, TEXT = 512, COLUMNS = 79 };
static char warnings[WARNINGS][TEXT];

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    assembly = (tl_assembly){0};
    prognosis = (tl_prognosis){.steps = 200, .step_time = 1000, .worst_time = 2000, .fitting = 60};
    look = (tl_late_verification){.times = 0};
    states = (tl_read_back_report){.is_tried = false};
    memset(responses, 0, sizeof responses);
    printed = NULL;
}

void tearDown(void) {
    tl_assembly_free(&assembly);
    free(printed);
    tl_scratch_empty(&scratch);
}

static void load(const char *file, const char *old, const char *new) {
    const char *path = tl_scratch_path(&scratch, "config.json");
    TEST_ASSERT_TRUE_MESSAGE(tl_test_write_replaced(file, path, old, new), old);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(path, &assembly));
}

/* Adds a key to "synchronise". */
static void load_with(const char *key) {
    char with[256];
    (void)snprintf(with, sizeof with, "\"synchronise\": { %.200s,", key);
    load(LOCK, "\"synchronise\": {", with);
}

static void add_word(char *line, const char *word) {
    size_t length = strlen(line);
    (void)snprintf(line + length, TEXT - length, "%s%s", length == 0 ? "" : " ", word);
}

/* Collects the printed warnings, each in one line. Checks the layout: a line "warnings", then per
 * warning a line that is indented by two columns, and further lines that are indented by four. */
static size_t read_warnings(void) {
    size_t count = 0;
    char *rest = NULL;
    TEST_ASSERT_NULL_MESSAGE(strstr(printed, "\n\n"), printed);
    char *line = strtok_r(printed, "\n", &rest);
    if (line != NULL) {
        TEST_ASSERT_EQUAL_STRING("warnings", line);
        line = strtok_r(NULL, "\n", &rest);
    }
    for (; line != NULL; line = strtok_r(NULL, "\n", &rest)) {
        size_t indent = strspn(line, " ");
        TEST_ASSERT_LESS_OR_EQUAL_size_t_MESSAGE(COLUMNS, strlen(line), line);
        TEST_ASSERT_TRUE_MESSAGE(indent == 2 || (indent == 4 && count > 0), line);
        if (indent == 2) {
            TEST_ASSERT_LESS_THAN_size_t_MESSAGE(WARNINGS, count, line);
            warnings[count++][0] = '\0';
        }
        add_word(warnings[count - 1], line + indent);
    }
    return count;
}

static void expect_count(size_t count) {
    size_t size = 0;
    free(printed);
    FILE *file = open_memstream(&printed, &size);
    size_t given = tl_advice_print(&assembly, &prognosis, responses, &look, &states, file, NULL);
    (void)fclose(file);
    TEST_ASSERT_EQUAL_size_t_MESSAGE(count, given, printed);
    TEST_ASSERT_EQUAL_size_t(count, read_warnings());
}

static void expect_none(void) {
    expect_count(0);
    TEST_ASSERT_EQUAL_STRING("", printed);
}

static void expect_one(const char *parts) {
    expect_count(1);
    TL_EXPECT_PARTS(parts, warnings[0]);
}

static void test_nothing_to_say(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LIVE, &assembly));
    expect_none();
}

static void test_states_that_another_process_cannot_read(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    states = (tl_read_back_report){
        .is_tried = true,
        .count = 2,
        .of = {{.finding = TL_READ_BACK_IS_EXACT}, {.finding = TL_READ_BACK_ENDS, .text = "signal 11"}}};
    expect_one("components.motor|signal 11|--state DIR|record.resume_s");
    states.of[1].finding = TL_READ_BACK_UNKNOWN;
    expect_one("components.motor|signal 11");
    TEST_ASSERT_FALSE(tl_test_has_parts(warnings[0], "record.resume_s"));
    states.of[1].finding = TL_READ_BACK_NOT_REPEATABLE;
    expect_none();
    states.of[1].finding = TL_READ_BACK_ENDS;
    states.is_tried = false;
    expect_none();
}

static void test_an_fmu_that_fails_after_one_step_of_a_variable(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    prognosis.error = (tl_error){TL_FMU_FAILED, "motor: it refused"};
    expect_one("synchronise.adjust|motor: it refused|would end the run");
    prognosis.error = (tl_error){TL_OK, ""};
    expect_none();
}

static void test_a_step_that_takes_too_long(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    prognosis.step_time = 12000000;
    expect_one("step_s|12 ms|10 ms");
}

static void test_an_fmu_that_does_not_come_back(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    look.outcome.found = true;
    (void)snprintf(look.outcome.component, sizeof look.outcome.component, "motor");
    (void)snprintf(look.outcome.text, sizeof look.outcome.text, "motor differs from its state at 0.5 s");
    expect_one("components.motor.rollback|motor differs|0.5 s");
}

static void test_an_fmu_that_fails_at_a_bound(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    (void)snprintf(look.bounds[0], sizeof look.bounds[0], "at 20 motor fails");
    expect_one("synchronise.adjust.motor.d|at 20|min|max");
}

static void test_a_budget_as_long_as_the_period(void) {
    load(LOCK, "\"time_s\": 0.006", "\"time_s\": 0.012");
    expect_one("synchronise.budget.time_s|0.012 s|step_s|0.01 s|0.6");
}

static void test_a_budget_that_cuts_searches_short(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    prognosis.worst_time = 12000000;
    prognosis.fitting = 29;
    expect_one("synchronise.budget|60|12 ms|6 ms|29");
}

static void test_too_few_evaluations(void) {
    load(LOCK, "\"evaluations\": 60", "\"evaluations\": 2");
    expect_one("synchronise.budget.evaluations|2|1");
    tl_assembly_free(&assembly);
    load(LOCK, "\"evaluations\": 60", "\"evaluations\": 3");
    expect_none();
}

/* A Boolean has two values. The guess and its negation include the nominal value. */
static void test_two_evaluations_for_a_boolean(void) {
    load(SLOW, "\"evaluations\": 2", "\"evaluations\": 2");
    expect_none();
    tl_assembly_free(&assembly);
    load(SLOW, "\"prediction\": 2, \"shape\": \"static\"", "\"prediction\": 4, \"shape\": \"dynamic\"");
    expect_none(); /* the budget follows the unknowns */
    TEST_ASSERT_EQUAL_UINT32(6, assembly.config.budget_evaluations);
}

static void test_saving_that_is_off(void) {
    load_with("\"saving\": { \"structure\": false, \"sequences\": false }");
    expect_count(2);
    TL_EXPECT_PARTS("synchronise.saving.structure|off", warnings[0]);
    TL_EXPECT_PARTS("synchronise.saving.sequences|off", warnings[1]);
}

static void test_outputs_that_are_kept_in_place_of_states(void) {
    load(LOCK, "0.0515 }, \"keep\": \"states\"", "0.0515 }, \"keep\": \"outputs\"");
    expect_one("components.motor|keep|\"outputs\"");
}

static void test_a_source_that_nothing_uses(void) {
    load(LIVE, "\"inverter\": {", "\"meter\": { \"csv\": { \"file\": \"meter.csv\" } }, \"inverter\": {");
    expect_one("sources.meter|signal");
}

static void test_a_signal_by_can_that_never_goes_stale(void) {
    load(BUS, "\"min\": -20, \"max\": 20, \"stale_s\": 0.2", "\"min\": -20, \"max\": 20");
    expect_one("plant.torque|stale_s");
}

static void test_a_median_of_polls(void) {
    load(LIVE, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"median\": 3 }");
    expect_one("plant.omega|median|every_s");
    assembly.config.signals[1].every = TL_SECOND / 25;
    expect_none();
}

static void test_readings_that_are_stale_before_the_next_one(void) {
    load(ON_A_LINE, "\"every_s\": 0.04", "\"every_s\": 0.3");
    expect_one("plant.omega|every_s|0.3 s|0.2 s");
    tl_assembly_free(&assembly);
    load(LIVE, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"median\": 5 }");
    assembly.config.signals[1].every = TL_SECOND / 10;
    expect_one("plant.omega|every_s|0.305 s|median|0.2 s");
}

/* Interpolation feeds the low-pass in each mode that waits for a later reading. */
static void test_a_line_in_mode_hold(void) {
    load(ON_A_LINE, "\"lag\"", "\"hold\"");
    expect_none();
    tl_assembly_free(&assembly);
    load(ON_A_LINE, "\"low_pass_s\": 0.02", "\"gate\": 8");
    assembly.config.measurements = TL_HOLD;
    expect_one("synchronise.match.motor.omega|hold|\"between\"");
}

/* In mode lag a step waits for the conditioned value, so there is no warning. */
static void test_a_conditioned_measurement_in_mode_ahead(void) {
    load(LOCK, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"median\": 5 }");
    expect_none();
    assembly.config.measurements = TL_AHEAD;
    expect_one("synchronise.match.motor.omega|condition|0.02 s|ahead");
}

static void test_a_nominal_outside_its_bounds(void) {
    load(LOCK, "\"min\": -100, \"max\": 100", "\"min\": 0.01, \"max\": 1");
    expect_one("synchronise.adjust.motor.d|nominal|0.0031|0.01|1");
}

/* What nothing bounds can be in lock although the wiring is wrong. */
static void test_a_variable_without_bounds(void) {
    static const char adjust[] = "\"motor.d\": { \"nominal\": 0.0031, \"step\": 0.12, \"min\": -100, \"max\": 100 }";
    static const char *const others[][2] = {
        {"\"motor.d\": { \"nominal\": 0.0031, \"step\": 0.12 }",
         "synchronise.adjust.motor.d|\"min\" or \"max\"|address|scale|-0.237 \342\200\246 0.243 (nominal \302\261 0.24)"},
        {"\"motor.d\": { \"nominal\": -2, \"step\": 0.12, \"max\": 1 }",
         "has \"min\"|-4 \342\200\246 1 (nominal \302\261 2)"},
        {"\"motor.d\": { \"step\": 0.12, \"min\": 0 }", "has \"max\"|0 \342\200\246 "},
        {"\"motor.M_w\": { \"step\": 1 }",
         "synchronise.adjust.motor.M_w|-20 \342\200\246 20 (the limits of plant.torque)"},
    };
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        load(LOCK, adjust, others[i][0]);
        expect_one(others[i][1]);
        tl_assembly_free(&assembly);
    }
    load(LOCK, adjust, "\"motor.I_in\": { \"step\": 3 }");
    expect_one("synchronise.adjust.motor.I_in|\"min\" or \"max\"");
    TEST_ASSERT_FALSE_MESSAGE(tl_test_has_parts(warnings[0], "example"), "the drive has no limits");
}

static void load_step(const char *step) {
    char with[64];
    (void)snprintf(with, sizeof with, "\"step\": %s", step);
    load(LOCK, "\"step\": 0.12", with);
}

static void test_a_horizon_that_is_too_short(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    responses[0] = (tl_response){.is_known = true, .most = 1.0, .tolerances = 0.049, .steps = 41};
    expect_one("synchronise.adjust.motor.d|prediction|ten times its step|motor.omega|0.049|41");
    responses[0].has_range = true;
    expect_one("synchronise.adjust.motor.d|prediction|whole range|motor.omega|0.049|41");
    responses[0].tolerances = 0.051;
    expect_none();
    responses[0] = (tl_response){.is_known = true, .most = 1.0, .tolerances = 0.0};
    expect_none();
}

static void test_a_first_move_that_is_too_small(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    responses[0] = (tl_response){.is_known = true, .soon = 0.009, .most = 1.0, .tolerances = 1.0, .steps = 1};
    expect_one("synchronise.adjust.motor.d|step|0.12|motor.omega|0.009|1.3");
    responses[0].soon = 0.11;
    expect_none();
}

static void test_more_variables_than_outputs(void) {
    load(LOCK, "\"adjust\": {", "\"adjust\": { \"motor.I_in\": { \"step\": 5, \"min\": -40, \"max\": 40 },");
    expect_none();
    responses[0] = responses[1] =
        (tl_response){.is_known = true, .soon = 1.0, .most = 1.0, .tolerances = 1.0, .steps = 1};
    expect_one("synchronise.adjust|2|motor.I_in|motor.d|1 matched output");
}

static void test_a_step_that_means_nothing(void) {
    load_step("1e-14");
    expect_none();
    tl_assembly_free(&assembly);
    load_step("1e-18");
    expect_one("synchronise.adjust.motor.d|step|1e-18");
    tl_assembly_free(&assembly);
    load(LOCK, "\"nominal\": 0.0031, \"step\": 0.12", "\"nominal\": 0, \"step\": 1e-200");
    expect_one("synchronise.adjust.motor.d|step|1e-200");
    tl_assembly_free(&assembly);
    load(LOCK, "\"step\": 0.12, \"min\": -100, \"max\": 100", "\"step\": 0.5, \"min\": 0, \"max\": 0.4");
    expect_one("synchronise.adjust.motor.d|step|0.5|0|0.4");
}

static void test_room_for_less_than_the_worst_case(void) {
    load_with("\"saving\": { \"nodes\": 20 }");
    tl_twin_ledger motor = tl_twin_get_ledger(assembly.twin, 1);
    char text[128];
    TEST_ASSERT_EQUAL_UINT32(20, motor.nodes);
    (void)snprintf(text, sizeof text, "synchronise.saving.nodes|20|motor|%llu", (unsigned long long)motor.nodes_worst);
    expect_one(text);
    tl_assembly_free(&assembly);
    (void)snprintf(text, sizeof text, "\"saving\": { \"nodes\": %llu }", (unsigned long long)motor.nodes_worst);
    load_with(text);
    expect_none();
}

static void test_stagnation_before_each_unknown_was_tried(void) {
    load_with("\"stagnation\": 2");
    expect_one("synchronise.stagnation|2|1");
    tl_assembly_free(&assembly);
    load_with("\"stagnation\": 3");
    expect_none();
}

static void test_a_low_pass_that_takes_long(void) {
    load(LOCK, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"low_pass_s\": 5 }");
    assembly.config.duration = 10 * TL_SECOND;
    expect_none();
    assembly.config.duration = 5 * TL_SECOND;
    expect_one("synchronise.match.motor.omega|5 s|5.02 s|duration_s");
    assembly.config.duration = 0;
    assembly.config.step = TL_SECOND;
    assembly.config.conditions[0].low_pass = 500 * TL_SECOND;
    expect_count(2);
    TEST_ASSERT_TRUE_MESSAGE(tl_test_has_parts(warnings[0], "step_s|1 s|stale_s|plant.torque|0.2 s"), printed);
    TEST_ASSERT_TRUE_MESSAGE(tl_test_has_parts(warnings[1], "synchronise.match.motor.omega|500 s|502 s"), printed);
    TEST_ASSERT_FALSE(tl_test_has_parts(warnings[1], "duration_s"));
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_advice");
    RUN_TEST(test_nothing_to_say);
    RUN_TEST(test_states_that_another_process_cannot_read);
    RUN_TEST(test_an_fmu_that_fails_after_one_step_of_a_variable);
    RUN_TEST(test_a_step_that_takes_too_long);
    RUN_TEST(test_an_fmu_that_does_not_come_back);
    RUN_TEST(test_an_fmu_that_fails_at_a_bound);
    RUN_TEST(test_a_budget_as_long_as_the_period);
    RUN_TEST(test_a_budget_that_cuts_searches_short);
    RUN_TEST(test_too_few_evaluations);
    RUN_TEST(test_two_evaluations_for_a_boolean);
    RUN_TEST(test_saving_that_is_off);
    RUN_TEST(test_outputs_that_are_kept_in_place_of_states);
    RUN_TEST(test_a_source_that_nothing_uses);
    RUN_TEST(test_a_signal_by_can_that_never_goes_stale);
    RUN_TEST(test_a_median_of_polls);
    RUN_TEST(test_readings_that_are_stale_before_the_next_one);
    RUN_TEST(test_a_line_in_mode_hold);
    RUN_TEST(test_a_conditioned_measurement_in_mode_ahead);
    RUN_TEST(test_a_nominal_outside_its_bounds);
    RUN_TEST(test_a_variable_without_bounds);
    RUN_TEST(test_a_horizon_that_is_too_short);
    RUN_TEST(test_a_first_move_that_is_too_small);
    RUN_TEST(test_more_variables_than_outputs);
    RUN_TEST(test_a_step_that_means_nothing);
    RUN_TEST(test_room_for_less_than_the_worst_case);
    RUN_TEST(test_stagnation_before_each_unknown_was_tried);
    RUN_TEST(test_a_low_pass_that_takes_long);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
