/* The search for another rollback method of a component, and its report.
 * The trials run in processes that execute this program again. Here each method works for each FMU.
 * replay_other_ways tests FMUs for which it does not. */
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/process/process_end.h"
#include "firmware/process/role.h"
#include "firmware/process/sanitizer.h"
#include "firmware/twin/check_trials.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"

static tl_scratch scratch;
static tl_config config;
static tl_twin_job order;
static tl_component_methods checked;
static tl_other_method found[TL_RECORDER_COMPONENTS];
static tl_error error;
static char text[TL_OTHER_METHOD_TEXT];

void setUp(void) {
    tl_report report = {0};
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", scratch.folder, 1));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read(LOCK, &config, &report));
    tl_config_use_lookups(&config);
    order = (tl_twin_job){.task = TL_TASK_CHECK, .path = LOCK, .text = config.text, .folder = ""};
    checked = (tl_component_methods){.rollback_inexact = 0};
    for (size_t i = 0; i < config.component_count; i++) {
        checked.of[i].rollback = TL_ROLLBACK_STATE;
    }
}

void tearDown(void) {
    TEST_ASSERT_EQUAL_INT(0, tl_scratch_count(&scratch));
    tl_config_free(&config);
}

static void find(void) {
    const tl_twin_child_settings settings = {.job = &order, .config = &config};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_other_method_find(&settings, &checked, found, &error), error.text);
}

static void expect_kinds(tl_other_method_kind drive, tl_other_method_kind motor) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(drive, found[0].kind, found[0].text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(motor, found[1].kind, found[1].text);
}

static void test_nothing_to_try(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", "/nowhere/at/all", 1)); /* no process can be started */
    find();
    expect_kinds(TL_OTHER_METHOD_NOT_SOUGHT, TL_OTHER_METHOD_NOT_SOUGHT);
}

/* The check reports that the configured method of the motor is not exact. */
static void test_a_component_that_is_not_rolled_back(void) {
    config.components[1].rollback = TL_ROLLBACK_MEMORY;
    checked.rollback_inexact = 1;
    (void)snprintf(checked.component, sizeof checked.component, "motor");
    find();
    expect_kinds(TL_OTHER_METHOD_NOT_SOUGHT, TL_OTHER_METHOD_FOUND);
    TEST_ASSERT_EQUAL_UINT32(TL_HAS_SANITIZER ? TL_ROLLBACK_STATE : TL_ROLLBACK_MEMORY, found[1].way.rollback);
    TEST_ASSERT_EQUAL_UINT32(1, found[1].way.is_measured);
}

/* Without the name of a component, nothing is tried. */
static void test_no_component_is_named(void) {
    checked.rollback_inexact = 1;
    find();
    expect_kinds(TL_OTHER_METHOD_NOT_SOUGHT, TL_OTHER_METHOD_NOT_SOUGHT);
}

/* If no process can be started, the result is unknown. */
static void test_no_process(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", "/nowhere/at/all", 1));
    config.components[1].rollback = TL_ROLLBACK_STATE;
    checked.rollback_inexact = 1;
    (void)snprintf(checked.component, sizeof checked.component, "motor");
    find();
    expect_kinds(TL_OTHER_METHOD_NOT_SOUGHT, TL_OTHER_METHOD_UNKNOWN);
}

/* ---- report ---- */

static void expect_told(const tl_other_method *other, const char *parts) {
    tl_other_method_describe(other, text);
    TL_EXPECT_PARTS(parts, text);
}

static void test_report_of_each_result(void) {
    tl_other_method other = {.kind = TL_OTHER_METHOD_FOUND, .replay_steps = 60};
    other.way = (tl_component_method){
        .rollback = TL_ROLLBACK_MEMORY, .is_measured = 1, .save = 1000, .restore = 1500, .bytes = 20 << 20};
    expect_told(&other, "2.5 \302\265s|20.0 MiB|\"rollback\": \"memory\"");
    other.way = (tl_component_method){.rollback = TL_ROLLBACK_STATE, .is_given_again = 1};
    expect_told(&other, "state|\"rollback\": \"auto\"");
    other.way = (tl_component_method){.rollback = TL_ROLLBACK_REPLAY};
    expect_told(&other, "60 steps|\"rollback\": \"replay\"");
    other = (tl_other_method){.kind = TL_OTHER_METHOD_NONE};
    expect_told(&other, "cannot");
    TEST_ASSERT_NULL(strstr(text, "\"rollback\""));
    other = (tl_other_method){.kind = TL_OTHER_METHOD_UNKNOWN, .text = "cause 17"};
    expect_told(&other, "not|cause 17");
    TEST_ASSERT_NULL(strstr(text, "\"rollback\""));
}

/* The longest report fits. */
static void test_reports_are_not_cut(void) {
    tl_other_method other = {.kind = TL_OTHER_METHOD_FOUND, .replay_steps = UINT32_MAX};
    other.way = (tl_component_method){.rollback = TL_ROLLBACK_MEMORY,
                                      .is_measured = 1,
                                      .save = INT64_MAX / 2,
                                      .restore = INT64_MAX / 2,
                                      .bytes = UINT64_MAX};
    tl_other_method_describe(&other, text);
    TL_EXPECT_PARTS("17592186044416.0 MiB|\"rollback\": \"memory\"", text);
    TEST_ASSERT_LESS_THAN_size_t(sizeof text - 1, strlen(text));
}

int main(int argc, char **argv) {
    static const tl_twin_role_tasks tasks = {.print_page = NULL};
    (void)argc;
    if (tl_role_begin(argv) != NULL) {
        tl_process_end(tl_twin_role_run(&tasks));
    }
    tl_scratch_make(&scratch, "/tmp", "other_way");
    UNITY_BEGIN();
    RUN_TEST(test_nothing_to_try);
    RUN_TEST(test_a_component_that_is_not_rolled_back);
    RUN_TEST(test_no_component_is_named);
    RUN_TEST(test_no_process);
    RUN_TEST(test_report_of_each_result);
    RUN_TEST(test_reports_are_not_cut);
    int failures = UNITY_END();
    tl_scratch_remove(&scratch);
    return failures;
}
