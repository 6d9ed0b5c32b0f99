/* The warnings of `check`: what each needs, what it says, and how it is broken into lines. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/cli/advice.h"
#include "tests/support/config_text.h"
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
static tl_far_look look;
static tl_read_back_report states;
static char *printed;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    assembly = (tl_assembly){0};
    prognosis = (tl_prognosis){.steps = 200, .step_time = 1000, .worst_time = 2000, .fitting = 60};
    look = (tl_far_look){.times = 0};
    states = (tl_read_back_report){.is_tried = false};
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

/* Another key of "synchronise". */
static void load_with(const char *key) {
    char with[256];
    (void)snprintf(with, sizeof with, "\"synchronise\": { %.200s,", key);
    load(LOCK, "\"synchronise\": {", with);
}

static void expect_advice(size_t count, const char *text) {
    size_t size = 0;
    free(printed);
    FILE *file = open_memstream(&printed, &size);
    size_t given = tl_advice_print(&assembly, &prognosis, &look, &states, file);
    (void)fclose(file);
    TEST_ASSERT_EQUAL_STRING(text, printed);
    TEST_ASSERT_EQUAL_size_t(count, given);
}

static void test_nothing_to_say(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LIVE, &assembly));
    expect_advice(0, "");
}

static void test_states_that_another_process_cannot_read(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    states =
        (tl_read_back_report){.is_tried = true,
                              .count = 2,
                              .of = {{.finding = TL_READ_BACK_IS_EXACT}, {.finding = TL_READ_BACK_ENDS, .text = "so"}}};
    expect_advice(1, "warnings\n"
                     "  components.motor: a saved state of it ends the process that loads it (so):\n"
                     "    `run --supervise --state DIR` finds that out, too, and saves none; any\n"
                     "    other saves it, and loads it unless \"record.resume_s\" is 0\n");
    states.of[1].finding = TL_READ_BACK_UNKNOWN;
    expect_advice(1, "warnings\n"
                     "  components.motor: a saved state of it could not be tried in another process\n"
                     "    (so)\n");
    states.of[1].finding = TL_READ_BACK_NOR_HERE;
    expect_advice(0, "");
    states.of[1].finding = TL_READ_BACK_ENDS;
    states.is_tried = false;
    expect_advice(0, "");
}

static void test_a_step_that_takes_too_long(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    prognosis.step_time = 10000000;
    expect_advice(1, "warnings\n"
                     "  step_s: a free step takes 10 ms here, and the period is 10 ms: `run` cannot\n"
                     "    keep up on this machine\n");
}

static void test_an_fmu_that_does_not_come_back(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    look.news.found = true;
    (void)snprintf(look.news.text, sizeof look.news.text, "motor does not come back to where it was: so");
    expect_advice(1, "warnings\n"
                     "  components.motor.rollback: motor does not come back to where it was: so\n");
}

static void test_initial_values_that_fail(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    prognosis = (tl_prognosis){0};
    expect_advice(1, "warnings\n"
                     "  plant: the FMUs cannot step with its initial values, and until there is a\n"
                     "    good measurement there is nothing else: give its signals an \"initial\"\n");
}

static void test_a_budget_as_long_as_the_period(void) {
    load(LOCK, "\"time_s\": 0.006", "\"time_s\": 0.01");
    expect_advice(1, "warnings\n"
                     "  synchronise.budget.time_s: 0.01 s is not less than step_s, 0.01 s: a search\n"
                     "    that uses it up makes the next tick late; the default is 0.6 of step_s\n");
}

static void test_a_budget_that_cuts_searches_short(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    prognosis.worst_time = 12000000;
    prognosis.fitting = 29;
    expect_advice(1, "warnings\n"
                     "  synchronise.budget: 60 evaluations can take 12 ms here, and the time is 6 ms:\n"
                     "    it cuts such a search short, after about 29 of them; shorten the horizon,\n"
                     "    or give more time\n");
}

static void test_too_few_evaluations(void) {
    load(LOCK, "\"evaluations\": 60", "\"evaluations\": 2");
    expect_advice(1, "warnings\n"
                     "  synchronise.budget.evaluations: 2 are not enough to try each of 1 unknowns\n"
                     "    once, beside the guess and nominal: give more, or make the horizon shorter\n"
                     "    or static\n");
    tl_assembly_free(&assembly);
    load(LOCK, "\"evaluations\": 60", "\"evaluations\": 3");
    expect_advice(0, "");
}

/* The guess and its negation are all there is: nominal is one of them. */
static void test_two_evaluations_for_a_boolean(void) {
    load(SLOW, "\"evaluations\": 2", "\"evaluations\": 2");
    expect_advice(0, "");
    tl_assembly_free(&assembly);
    load(SLOW, "\"prediction\": 2, \"shape\": \"static\"", "\"prediction\": 3, \"shape\": \"dynamic\"");
    expect_advice(1, "warnings\n"
                     "  synchronise.budget.evaluations: 2 are not enough to try each of 2 unknowns\n"
                     "    once, beside the guess and nominal: give more, or make the horizon shorter\n"
                     "    or static\n");
}

static void test_saving_that_is_off(void) {
    load_with("\"saving\": { \"structure\": false, \"sequences\": false }");
    expect_advice(2, "warnings\n"
                     "  synchronise.saving.structure: off: executions that can reach no matched\n"
                     "    output any more are done all the same; it changes no result\n"
                     "  synchronise.saving.sequences: off: what is known from an earlier execution is\n"
                     "    executed again; it changes no result\n");
}

static void test_outputs_that_are_kept_in_place_of_states(void) {
    load(LOCK, "\"fmu\": \"motor.fmu\"", "\"fmu\": \"motor.fmu\", \"keep\": \"outputs\"");
    expect_advice(1, "warnings\n"
                     "  components.motor: keep \"outputs\": executions are repeated to get back to a\n"
                     "    state, beyond those predicted; worth it only where saving a state takes\n"
                     "    longer than a step\n");
}

static void test_a_source_that_nothing_uses(void) {
    load(LIVE, "\"inverter\": {", "\"meter\": { \"csv\": { \"file\": \"meter.csv\" } }, \"inverter\": {");
    expect_advice(1, "warnings\n"
                     "  sources.meter: no signal of the plant comes from it\n");
}

static void test_a_signal_by_can_that_never_goes_stale(void) {
    load(BUS, "\"min\": -20, \"max\": 20, \"stale_s\": 0.2", "\"min\": -20, \"max\": 20");
    expect_advice(1, "warnings\n"
                     "  plant.torque: a sender that falls silent is noticed only by the age of its\n"
                     "    values, and the signal has no stale_s: its last value would be used for\n"
                     "    ever\n");
}

static void test_a_median_of_polls(void) {
    load(LIVE, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"median\": 3 }");
    expect_advice(1, "warnings\n"
                     "  plant.omega: its median counts polls, so a bad value that is read several\n"
                     "    times is not in the minority: say in every_s how often its device writes\n"
                     "    it, and each value counts once\n");
    assembly.config.signals[1].every = TL_SECOND / 25;
    expect_advice(0, "");
}

static void test_readings_that_are_stale_before_the_next_one(void) {
    load(ON_A_LINE, "\"every_s\": 0.04", "\"every_s\": 0.3");
    expect_advice(1, "warnings\n"
                     "  plant.omega: by every_s a value may be 0.3 s old before the next one is\n"
                     "    there, and it is stale after 0.2 s\n");
    tl_assembly_free(&assembly);
    load(LIVE, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"median\": 5 }");
    assembly.config.signals[1].every = TL_SECOND / 10;
    expect_advice(1, "warnings\n"
                     "  plant.omega: by every_s a value may be 0.305 s old before the next one is\n"
                     "    there and through the median, and it is stale after 0.2 s\n");
}

/* A low-pass is looked up on the line in any mode that waits for it. */
static void test_a_line_in_mode_hold(void) {
    load(ON_A_LINE, "\"lag\"", "\"hold\"");
    expect_advice(0, "");
    tl_assembly_free(&assembly);
    load(ON_A_LINE, "\"low_pass_s\": 0.02", "\"gate\": 8");
    assembly.config.measurements = TL_HOLD;
    expect_advice(1, "warnings\n"
                     "  synchronise.match.motor.omega: in mode hold no step waits for the next\n"
                     "    reading, and the last one stands: \"between\" does nothing\n");
}

/* In mode lag the step waits for it. */
static void test_a_conditioned_measurement_in_mode_ahead(void) {
    load(LOCK, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"median\": 5 }");
    expect_advice(0, "");
    assembly.config.measurements = TL_AHEAD;
    expect_advice(1, "warnings\n"
                     "  synchronise.match.motor.omega: its condition makes a measurement come up to\n"
                     "    0.02 s late, and in mode ahead no step waits for it: the newest there is\n"
                     "    stands for it\n");
}

static void test_a_nominal_outside_its_bounds(void) {
    load(LOCK, "\"nominal\": 0.0031", "\"nominal\": 0.0031, \"min\": 0.01, \"max\": 1");
    expect_advice(1, "warnings\n"
                     "  synchronise.adjust.motor.d: its nominal, 0.0031, is outside its bounds, 0.01\n"
                     "    to 1; it is used all the same where no correction is better\n");
}

static void expect_step(const char *step, size_t count, const char *text) {
    char with[64];
    (void)snprintf(with, sizeof with, "\"step\": %s", step);
    load(LOCK, "\"step\": 0.12", with);
    expect_advice(count, text);
    tl_assembly_free(&assembly);
}

static void test_a_step_that_means_nothing(void) {
    expect_step("1e-14", 0, "");
    expect_step("1e-18", 1,
                "warnings\n"
                "  synchronise.adjust.motor.d: its step, 1e-18, is so small that a first move by\n"
                "    it is lost in rounding\n");
    load(LOCK, "\"nominal\": 0.0031, \"step\": 0.12", "\"nominal\": 0, \"step\": 1e-200");
    expect_advice(1, "warnings\n"
                     "  synchronise.adjust.motor.d: its step, 1e-200, is so small that a first move\n"
                     "    by it is lost in rounding\n");
    tl_assembly_free(&assembly);
    load(LOCK, "\"step\": 0.12", "\"step\": 0.5, \"min\": 0, \"max\": 0.4");
    expect_advice(1, "warnings\n"
                     "  synchronise.adjust.motor.d: its step, 0.5, is larger than all there is to\n"
                     "    search, 0 to 0.4\n");
}

static void test_room_for_less_than_the_worst_case(void) {
    load_with("\"saving\": { \"nodes\": 20 }");
    tl_twin_ledger motor = tl_twin_get_ledger(assembly.twin, 1);
    char text[512];
    TEST_ASSERT_EQUAL_UINT32(20, motor.nodes);
    (void)snprintf(text, sizeof text,
                   "warnings\n"
                   "  synchronise.saving.nodes: there is room for 20 executions of motor, and the\n"
                   "    worst case needs %llu: what finds no room may be executed again; give more,\n"
                   "    or fewer evaluations, or a shorter horizon\n",
                   (unsigned long long)motor.nodes_worst);
    expect_advice(1, text);
    tl_assembly_free(&assembly);
    (void)snprintf(text, sizeof text, "\"saving\": { \"nodes\": %llu }", (unsigned long long)motor.nodes_worst);
    load_with(text);
    expect_advice(0, "");
}

static void test_stagnation_before_each_unknown_was_tried(void) {
    load_with("\"stagnation\": 2");
    expect_advice(1, "warnings\n"
                     "  synchronise.stagnation: 2 evaluations without progress end a solver before it\n"
                     "    has tried each of 1 unknowns once: give more\n");
    tl_assembly_free(&assembly);
    load_with("\"stagnation\": 3");
    expect_advice(0, "");
}

static void test_a_low_pass_that_takes_long(void) {
    load(LOCK, "\"tolerance\": 1.0", "\"tolerance\": 1.0, \"condition\": { \"low_pass_s\": 5 }");
    assembly.config.duration = 10 * TL_SECOND;
    expect_advice(0, "");
    assembly.config.duration = 5 * TL_SECOND;
    expect_advice(1, "warnings\n"
                     "  synchronise.match.motor.omega: its low-pass makes the measurement 5 s late,\n"
                     "    and a step is computed 5.02 s after its instant, which is longer than\n"
                     "    duration_s\n");
    assembly.config.duration = 0;
    assembly.config.step = TL_SECOND;
    assembly.config.conditions[0].low_pass = 500 * TL_SECOND;
    expect_advice(1, "warnings\n"
                     "  synchronise.match.motor.omega: its low-pass makes the measurement 500 s late,\n"
                     "    and a step is computed 502 s after its instant\n");
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_advice");
    RUN_TEST(test_nothing_to_say);
    RUN_TEST(test_states_that_another_process_cannot_read);
    RUN_TEST(test_a_step_that_takes_too_long);
    RUN_TEST(test_an_fmu_that_does_not_come_back);
    RUN_TEST(test_initial_values_that_fail);
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
    RUN_TEST(test_a_step_that_means_nothing);
    RUN_TEST(test_room_for_less_than_the_worst_case);
    RUN_TEST(test_stagnation_before_each_unknown_was_tried);
    RUN_TEST(test_a_low_pass_that_takes_long);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
