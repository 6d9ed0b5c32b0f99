/* The rollback methods of components and their cost; a twin that cannot be built.
 * replay_other_ways tests FMUs whose rollback is not exact. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/process/sanitizer.h"
#include "firmware/twin/twin_trial.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/read_assembly.h"
#include "tests/support/scratch.h"
#include "tests/support/stderr_capture.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"

static tl_scratch scratch;
static tl_assembly assembly;
static tl_component_methods ways;
static tl_error error;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    ways = (tl_component_methods){.rollback_inexact = 0};
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_assembly_free(&assembly);
    tl_scratch_empty(&scratch);
}

/* LOCK with a part replaced. */
static void read(const char *old, const char *new) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "config.json"));
    TEST_ASSERT_TRUE_MESSAGE(tl_test_write_replaced(LOCK, path, old, new), old);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(path, &assembly));
}

static void test_all_are_rolled_back(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(LOCK, &assembly));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_component_methods_try(&assembly, &ways, &error), error.text);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_STRING("", ways.component);
    TEST_ASSERT_EQUAL_UINT32(0, ways.rollback_inexact);
    for (size_t i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_UINT32(TL_HAS_SANITIZER ? TL_ROLLBACK_STATE : TL_ROLLBACK_MEMORY, ways.of[i].rollback);
        TEST_ASSERT_EQUAL_UINT32(0, ways.of[i].is_given_again);
        TEST_ASSERT_EQUAL_UINT32(1, ways.of[i].is_measured);
        TEST_ASSERT_GREATER_THAN_INT64(0, ways.of[i].save);
        TEST_ASSERT_GREATER_THAN_INT64(0, ways.of[i].restore);
        TEST_ASSERT_GREATER_THAN_UINT64(0, ways.of[i].bytes);
    }
    TEST_ASSERT_EQUAL_UINT32(TL_ROLLBACK_NONE, ways.of[2].rollback);
}

/* The cost of a replay depends on its length, so it is not measured. */
static void test_replay_is_not_measured(void) {
    read("\"fmu\": \"motor.fmu\"", "\"fmu\": \"motor.fmu\", \"rollback\": \"replay\"");
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_component_methods_try(&assembly, &ways, &error), error.text);
    TEST_ASSERT_EQUAL_UINT32(TL_ROLLBACK_REPLAY, ways.of[1].rollback);
    TEST_ASSERT_EQUAL_UINT32(0, ways.of[1].is_measured);
    TEST_ASSERT_EQUAL_UINT32(1, ways.of[0].is_measured);
}

/* The first problem is returned, and not logged. */
static void test_it_cannot_be_built(void) {
    read("\"motor.fmu\"", "\"nowhere.fmu\"");
    TEST_ASSERT_TRUE(tl_stderr_capture_begin());
    tl_status status = tl_component_methods_try(&assembly, &ways, &error);
    tl_stderr_expect("");
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    TEST_ASSERT_EQUAL_STRING("motor", ways.component);
    TL_EXPECT_PARTS("\"nowhere.fmu\"", error.text);
    TEST_ASSERT_EQUAL_UINT32(TL_ROLLBACK_NONE, ways.of[0].rollback);
}

/* A free-running twin rolls nothing back. */
static void test_nothing_is_rolled_back(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(TL_SOURCE_DIR "/config/motor/free.json", &assembly));
    tl_component_methods_note(&assembly, &ways);
    TEST_ASSERT_EQUAL_UINT32(0, ways.rollback_inexact);
    TEST_ASSERT_EQUAL_UINT32(TL_ROLLBACK_NONE, ways.of[0].rollback);
}

static void test_component_names_in_messages(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(LOCK, &assembly));
    char component[TL_ASSEMBLY_NAME] = "";
    tl_assembly_find_component(&assembly, "motor.omega differs", component);
    tl_assembly_find_component(&assembly, "moto", component);
    TEST_ASSERT_EQUAL_STRING("", component);
    tl_assembly_find_component(&assembly, "motor: fmi2DoStep failed", component);
    TEST_ASSERT_EQUAL_STRING("motor", component);
}

int main(void) {
    tl_scratch_make(&scratch, "/tmp", "twin_ways");
    UNITY_BEGIN();
    RUN_TEST(test_all_are_rolled_back);
    RUN_TEST(test_replay_is_not_measured);
    RUN_TEST(test_it_cannot_be_built);
    RUN_TEST(test_nothing_is_rolled_back);
    RUN_TEST(test_component_names_in_messages);
    int failures = UNITY_END();
    tl_scratch_remove(&scratch);
    return failures;
}
