/* Assemblies: building a twin from a configuration, reporting errors, and freeing it. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/identity.h"
#include "firmware/twin/assembly.h"
#include "tests/support/assembly_recorder.h"
#include "tests/support/config_text.h"
#include "tests/support/fmu_maker.h"
#include "tests/support/message.h"
#include "tests/support/read_assembly.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/stderr_capture.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_assembly assembly;
static char *said;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "config.json"));
    memset(&assembly, 0xA5, sizeof assembly); /* load() must not depend on old content */
}

void tearDown(void) {
    tl_assembly_free(&assembly);
    free(said);
    said = NULL;
    tl_scratch_empty(&scratch);
}

/* Replaces a part of the text, and frees the original text. */
static char *replaced(char *text, const char *old, const char *new) {
    char *changed = tl_test_replaced(text, old, new);
    TEST_ASSERT_NOT_NULL_MESSAGE(changed, old);
    free(text);
    return changed;
}

/* Loads a configuration, frees its text, and keeps the log. */
static tl_status load_text(char *text) {
    FILE *file = fopen(path, "w");
    (void)fputs(text, file);
    (void)fclose(file);
    free(text);
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_status status = tl_test_load_assembly(path, &assembly);
    said = tl_stderr_capture_end();
    return status;
}

/* The same for motor_lock.json with a part of its text replaced. */
static tl_status load(const char *old, const char *new) {
    return load_text(replaced(tl_test_read_text(LOCK), old, new));
}

/* One line of the log has all parts. */
static void expect_said(const char *parts) {
    TEST_ASSERT_TRUE_MESSAGE(tl_test_has_line(said, parts), said);
}

static void test_a_good_one(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    TEST_ASSERT_NOT_NULL(assembly.twin);
    TEST_ASSERT_EQUAL_size_t(2, assembly.fmu_count);
    TEST_ASSERT_EQUAL_size_t(3, tl_twin_get_facts(assembly.twin).components);
    TEST_ASSERT_EQUAL_UINT32(1, tl_twin_get_facts(assembly.twin).distance);
    TEST_ASSERT_EQUAL_UINT32(1, tl_twin_get_facts(assembly.twin).prediction);
    TEST_ASSERT_EQUAL_STRING("motor", tl_twin_component_name(assembly.twin, 1));
    TEST_ASSERT_EQUAL_STRING("rad/s", tl_twin_match_unit(assembly.twin, 0));
}

/* The plan has the search settings of the configuration. */
static void test_the_plan(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, load("\"synchronise\": {",
                                      "\"synchronise\": { \"fallback\": 1000, \"stagnation\": 7, \"noise_floor\": 0.5,"
                                      " \"saving\": { \"structure\": false, \"nodes\": 9 },"));
    TEST_ASSERT_EQUAL_STRING("", said);
    TEST_ASSERT_EQUAL_STRING(assembly.config.algorithm, assembly.plan.algorithm);
    TEST_ASSERT_EQUAL_STRING("bobyqa", assembly.plan.fallback);
    TEST_ASSERT_EQUAL_UINT32(7, assembly.plan.stagnation);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, assembly.plan.noise_floor);
    TEST_ASSERT_EQUAL_INT(TL_STATIC, assembly.plan.shape);
    TEST_ASSERT_FALSE(assembly.plan.saving.structure);
    TEST_ASSERT_TRUE(assembly.plan.saving.sequences);
    TEST_ASSERT_EQUAL_UINT32(9, assembly.plan.saving.nodes);
    TEST_ASSERT_EQUAL_UINT32(assembly.config.budget_evaluations, assembly.plan.evaluations);
    TEST_ASSERT_EQUAL_INT(TL_KEEP_STATES, assembly.plan.components[0].keep);
}

static void test_modes_reach_the_plan(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, load("{ \"prediction\": 1, \"measurements\": \"lag\" }",
                                      "{ \"shape\": \"dynamic\", \"measurements\": \"hold\" }"));
    TEST_ASSERT_EQUAL_INT(TL_DYNAMIC, assembly.plan.shape);
    TEST_ASSERT_EQUAL_INT(TL_HOLD, assembly.plan.measurements);
    tl_assembly_free(&assembly);
    free(said);
    TEST_ASSERT_EQUAL_INT(TL_OK, load("10 }, \"keep\": \"states\"", "10 }, \"keep\": \"outputs\""));
    TEST_ASSERT_EQUAL_INT(TL_KEEP_OUTPUTS, assembly.plan.components[0].keep);
    TEST_ASSERT_EQUAL_INT(TL_KEEP_STATES, assembly.plan.components[1].keep);
}

/* A command may change the configuration between reading and building. */
static void test_in_two_parts(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(LOCK, &assembly));
    TEST_ASSERT_NULL(assembly.twin);
    TEST_ASSERT_EQUAL_size_t(0, assembly.fmu_count);
    assembly.config.saving.sequences = false;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_build(&assembly));
    TEST_ASSERT_NOT_NULL(assembly.twin);
    TEST_ASSERT_FALSE(assembly.plan.saving.sequences);
}

/* Each component has its own FMU instance, also if components use the same file. */
static void test_components_of_one_file(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, load("\"drive\": { \"fmu\"", "\"other\": { \"fmu\": \"motor.fmu\", \"set\": "
                                                              "{ \"I_in\": 0.3, \"M_w\": 0 } },\n"
                                                              "    \"drive\": { \"fmu\""));
    TEST_ASSERT_EQUAL_STRING("", said);
    TEST_ASSERT_EQUAL_size_t(3, assembly.fmu_count);
    TEST_ASSERT_EQUAL_size_t(4, tl_twin_get_facts(assembly.twin).components);
    for (size_t i = 0; i < 3; i++) {
        for (size_t k = 0; k < i; k++) {
            TEST_ASSERT_TRUE(assembly.components[i].model != assembly.components[k].model);
            TEST_ASSERT_TRUE(assembly.components[i].functions != assembly.components[k].functions);
            TEST_ASSERT_TRUE(strcmp(assembly.components[i].resources, assembly.components[k].resources) != 0);
        }
    }
}

/* The SHA-256 identifies the FMU file. */
static void test_an_fmu_by_its_hash(void) {
    char hash[TL_SHA256_TEXT];
    char text[256];
    FILE *file = fopen(TL_BINARY_DIR "/fmus/motor.fmu", "rb");
    TEST_ASSERT_NOT_NULL(file);
    TEST_ASSERT_TRUE(tl_identity_open_file(fileno(file), hash));
    (void)fclose(file);
    (void)snprintf(text, sizeof text, "\"motor.fmu\", \"sha256\": \"%s\"", hash);
    TEST_ASSERT_EQUAL_INT(TL_OK, load("\"motor.fmu\"", text));
    TEST_ASSERT_EQUAL_STRING("", said);
    tearDown();
    setUp();
    (void)snprintf(text, sizeof text, "\"drive.fmu\", \"sha256\": \"%s\"", hash);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, load("\"drive.fmu\"", text));
    (void)snprintf(text, sizeof text, "components.drive|drive.fmu|%s|\"sha256\"", hash);
    expect_said(text);
    TEST_ASSERT_NULL(assembly.twin);
}

static void test_all_missing_fmus_are_reported(void) {
    TEST_ASSERT_EQUAL_INT(
        TL_BAD_DATA,
        load(
            "\"drive.fmu\", \"set\": { \"ref\": 10 }, \"keep\": \"states\" },\n    \"motor\": { \"fmu\": \"motor.fmu\"",
            "\"absent1.fmu\" },\n    \"motor\": { \"fmu\": \"absent2.fmu\""));
    TEST_ASSERT_EQUAL_size_t(2, assembly.problems.report.count);
    expect_said("components.drive|\"absent1.fmu\"");
    expect_said("components.motor|\"absent2.fmu\"");
    TEST_ASSERT_NULL(assembly.twin);
}

static void test_a_configuration_that_is_wrong(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, load("\"step_s\": 0.01", "\"step_s\": 0"));
    expect_said("step_s");
    TEST_ASSERT_NULL(assembly.twin);
    TEST_ASSERT_EQUAL_size_t(0, assembly.fmu_count);
}

/* Problems of the twin are reported with the line in the file. */
static void test_a_twin_that_cannot_be_built(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, load("\"motor.d\"", "\"motor.J\""));
    char slot_index[128];
    char *text = tl_test_read_text(path);
    (void)snprintf(slot_index, sizeof slot_index, "line %zu|synchronise.adjust.motor.J|fixed",
                   tl_test_line_of(text, "\"motor.J\""));
    free(text);
    expect_said(slot_index);
    TEST_ASSERT_EQUAL_size_t(1, assembly.problems.report.count);
    TEST_ASSERT_NULL(assembly.twin);
    TEST_ASSERT_EQUAL_size_t(2, assembly.fmu_count); /* they must be unloaded, too */
}

static void test_no_file(void) {
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_status status = tl_test_load_assembly(tl_scratch_path(&scratch, "absent.json"), &assembly);
    said = tl_stderr_capture_end();
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    expect_said("absent.json");
}

static void test_freeing_twice(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    tl_assembly_free(&assembly);
    TEST_ASSERT_NULL(assembly.twin);
    tl_assembly_free(&assembly);
}

/* The outputs of the plan are what `emulate` reads from FMUs, not what it reads from the plant. */
static void test_outputs_of_an_emulated_plant(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(TL_SOURCE_DIR "/config/motor/plant.json", &assembly));
    TEST_ASSERT_EQUAL_size_t(2, assembly.config.emulated_count);
    TEST_ASSERT_EQUAL_size_t(1, assembly.plan.output_count);
    TEST_ASSERT_EQUAL_STRING("motor.omega", assembly.outputs[0].variable);
}

static void test_recording_names_and_units(void) {
    tl_recorder *recorder = NULL;
    tl_error error;
    const char *database = tl_scratch_path(&scratch, "run.db");
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_record(&assembly, "replay", database, &recorder, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "test", NULL, &error));
    TEST_ASSERT_EQUAL_INT64(5, tl_sql_integer(database, "SELECT count(*) FROM signals")); /* with omega@reading */
    TEST_ASSERT_EQUAL_INT64(
        1, tl_sql_integer(database, "SELECT count(*) FROM signals WHERE kind = 'match' AND name = 'motor.omega' AND "
                                    "unit = 'rad/s' AND compared_with = 'plant.omega'"));
    TEST_ASSERT_EQUAL_INT64(
        1, tl_sql_integer(database, "SELECT count(*) FROM signals WHERE kind = 'adjust' AND name = 'motor.d' AND "
                                    "unit = 'N.m.s/rad'"));
    TEST_ASSERT_EQUAL_STRING("N.m",
                             tl_sql_text(database, "SELECT unit FROM signals WHERE kind = 'plant' AND signal = 0"));
    TEST_ASSERT_EQUAL_STRING("replay", tl_sql_text(database, "SELECT verb FROM runs"));
    TEST_ASSERT_EQUAL_INT64(10000000, tl_sql_integer(database, "SELECT step_ns FROM runs"));
    TEST_ASSERT_EQUAL_STRING(assembly.config.hash, tl_sql_text(database, "SELECT configuration FROM main.runs"));
    TEST_ASSERT_EQUAL_STRING(assembly.config.text, tl_sql_text(database, "SELECT text FROM main.configurations"));
}

/* A copy of motor.fmu with the torque as an output of another type. It is not stepped. */
static const char *typed_motor(const char *type) {
    static char written[PATH_MAX];
    static const char entry[] = "modelDescription.xml";
    char output[64];
    (void)snprintf(output, sizeof output, "<%s/>", type);
    (void)snprintf(written, sizeof written, "%s", tl_scratch_path(&scratch, "typed.fmu"));
    tl_fmu_maker *maker = tl_fmu_maker_new(TL_BINARY_DIR "/fmus/motor.fmu");
    TEST_ASSERT_NOT_NULL(maker);
    TEST_ASSERT_TRUE(tl_fmu_maker_replace(maker, entry,
                                          "valueReference=\"15\" causality=\"local\" variability=\"continuous\"",
                                          "valueReference=\"1\" causality=\"local\" variability=\"discrete\""));
    TEST_ASSERT_TRUE(tl_fmu_maker_replace(maker, entry, "<Real unit=\"N.m\"/>", output));
    TEST_ASSERT_TRUE(tl_fmu_maker_write(maker, written));
    tl_fmu_maker_free(maker);
    return written;
}

/* motor_lock.json with that torque matched, too. */
static char *matched_torque(const char *type, const char *plant_type) {
    char fmu[PATH_MAX + 16];
    char signal[128];
    (void)snprintf(fmu, sizeof fmu, "\"fmu\": \"%s\"", typed_motor(type));
    (void)snprintf(signal, sizeof signal,
                   "\"plant\": { \"raw\": { \"type\": \"%s\", \"csv\": { \"column\": \"raw\" } },", plant_type);
    char *text = replaced(tl_test_read_text(LOCK), "\"fmu\": \"motor.fmu\"", fmu);
    text = replaced(text, "\"plant\": {", signal);
    return replaced(text, "\"match\": {",
                    "\"match\": { \"motor.M_m\": { \"to\": \"plant.raw\", \"tolerance\": 1, \"weight\": 0 },");
}

/* A matched variable is recorded with its own type. */
static void test_recording_types(void) {
    static const char *const types[][2] = {{"Boolean", "boolean"}, {"Integer", "integer"}};
    for (size_t i = 0; i < 2; i++) {
        tl_recorder *recorder = NULL;
        tl_error error;
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, load_text(matched_torque(types[i][0], types[i][1])), said);
        const char *database = tl_scratch_path(&scratch, "types.db");
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_record(&assembly, "replay", database, &recorder, &error));
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "test", NULL, &error));
        TEST_ASSERT_EQUAL_STRING(types[i][0], tl_sql_text(database, "SELECT type FROM signals WHERE kind = 'match' AND "
                                                                    "name = 'motor.M_m'"));
        TEST_ASSERT_EQUAL_STRING("Real", tl_sql_text(database, "SELECT type FROM signals WHERE kind = 'match' AND "
                                                               "name = 'motor.omega'"));
        tearDown();
    }
}

/* ---- another tuning ---- */

enum { RETUNED_TICKS = 500 };

static void expect_same_tuning(const tl_assembly *a, const tl_assembly *b) {
    tl_tuning of_a;
    tl_tuning of_b;
    tl_config_tuning(&a->config, &of_a);
    tl_config_tuning(&b->config, &of_b);
    TEST_ASSERT_EQUAL_MEMORY(&of_a, &of_b, sizeof of_a);
}

/* The plant differs from the model, so that each step is searched. */
static void step_both(const tl_assembly *built, const tl_assembly *retuned, int64_t tick) {
    const tl_assembly *const both[] = {built, retuned};
    const tl_budget budget = {.evaluations = built->config.budget_evaluations};
    tl_record records[2] = {{.step = -1}, {.step = -1}};
    tl_sample sample = {.tick = tick, .instant = tick * built->config.step};
    tl_error error;
    sample.values[0] = 0.3 + 0.2 * sin(0.01 * (double)tick);
    sample.values[1] = 10.0 * (1.0 - exp(-0.02 * (double)tick)) + 2.0 * sin(0.05 * (double)tick);
    for (int i = 0; i < 2; i++) {
        bool ready = false;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_step(both[i]->twin, &sample, &budget, &records[i], &ready, &error));
        TEST_ASSERT_EQUAL_INT(tick > 0, ready);
    }
    TEST_ASSERT_EQUAL_INT64(records[0].step, records[1].step);
    TEST_ASSERT_EQUAL_INT(records[0].outcome, records[1].outcome);
    TEST_ASSERT_EQUAL_UINT32(records[0].evaluations, records[1].evaluations);
    TEST_ASSERT_EQUAL_UINT32(records[0].executions, records[1].executions);
    TEST_ASSERT_EQUAL_MEMORY(&records[0].objective, &records[1].objective, sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(records[0].u, records[1].u, sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(records[0].nominal, records[1].nominal, sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(records[0].y, records[1].y, sizeof(double));
}

/* Retuned before its first tick, the twin equals one that was built with the other values. */
static void test_retuned_before_the_first_tick(void) {
    static const char *const others[][2] = {
        {"\"nominal\": 0.0031, \"step\": 0.12, \"min\": -100, \"max\": 100",
         "\"nominal\": 0.01, \"min\": 0.002, \"max\": 0.5, \"penalty\": {\"deviation\": 0.01, \"rate\": 0.002}, \"step\": 0.12"},
        {"\"tolerance\": 1.0", "\"tolerance\": 0.25, \"weight\": 2, \"huber\": 4"},
        {"\"evaluations\": 60, \"time_s\": 0.006", "\"evaluations\": 12, \"time_s\": 0.004"},
        {"\"algorithm\"", "\"margin\": 0.03, \"noise_floor\": 0.01, \"algorithm\""},
    };
    static tl_assembly built;
    tl_tuning tuning;
    tl_error error;
    char *text = tl_test_read_text(LOCK);
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        text = replaced(text, others[i][0], others[i][1]);
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, load_text(text), said);
    built = assembly;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    tl_config_tuning(&built.config, &tuning);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_assembly_retune(&assembly, &tuning, &error), error.text);
    expect_same_tuning(&built, &assembly);
    for (int64_t tick = 0; tick < RETUNED_TICKS; tick++) {
        step_both(&built, &assembly, tick);
    }
    TEST_ASSERT_EQUAL_UINT64(tl_twin_executions(built.twin, 1), tl_twin_executions(assembly.twin, 1));
    tl_assembly_free(&built);
}

/* After a rebuild the twin has its original tuning. A rejected tuning changes nothing. */
static void test_rebuilt_after_another_tuning(void) {
    static tl_assembly other;
    tl_tuning tuning;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &other));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &assembly));
    tl_config_tuning(&assembly.config, &tuning);
    tuning.evaluations = 61;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_assembly_retune(&assembly, &tuning, &error));
    expect_same_tuning(&other, &assembly);
    tuning.evaluations = 12;
    tuning.match[0].tolerance = 0.25;
    tuning.adjust[0].nominal = 0.1;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_retune(&assembly, &tuning, &error));
    TEST_ASSERT_EQUAL_UINT32(12, assembly.config.budget_evaluations);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_rebuild(&assembly));
    expect_same_tuning(&other, &assembly);
    for (int64_t tick = 0; tick < RETUNED_TICKS; tick++) {
        step_both(&other, &assembly, tick);
    }
    tl_assembly_free(&other);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_assembly");
    UNITY_BEGIN();
    RUN_TEST(test_a_good_one);
    RUN_TEST(test_the_plan);
    RUN_TEST(test_modes_reach_the_plan);
    RUN_TEST(test_in_two_parts);
    RUN_TEST(test_components_of_one_file);
    RUN_TEST(test_an_fmu_by_its_hash);
    RUN_TEST(test_all_missing_fmus_are_reported);
    RUN_TEST(test_a_configuration_that_is_wrong);
    RUN_TEST(test_a_twin_that_cannot_be_built);
    RUN_TEST(test_no_file);
    RUN_TEST(test_freeing_twice);
    RUN_TEST(test_outputs_of_an_emulated_plant);
    RUN_TEST(test_recording_names_and_units);
    RUN_TEST(test_recording_types);
    RUN_TEST(test_retuned_before_the_first_tick);
    RUN_TEST(test_rebuilt_after_another_tuning);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
