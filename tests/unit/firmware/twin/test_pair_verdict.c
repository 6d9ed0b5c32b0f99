/* Verdict on two twins of one configuration. They run in processes that execute this program
 * again. replay_two_instances tests FMUs that disturb each other. */
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/process/process_end.h"
#include "firmware/process/role.h"
#include "firmware/twin/check_trials.h"
#include "tests/support/scratch.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"

static tl_scratch scratch;
static tl_config config;
static tl_twin_job order;
static tl_pair_verdict verdict;
static tl_error error;

void setUp(void) {
    tl_report report = {0};
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", scratch.folder, 1));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read(LOCK, &config, &report));
    tl_config_use_lookups(&config);
    order = (tl_twin_job){.task = TL_TASK_CHECK, .path = LOCK, .text = config.text};
}

void tearDown(void) {
    TEST_ASSERT_EQUAL_INT(0, tl_scratch_count(&scratch));
    tl_config_free(&config);
}

static tl_status find(void) {
    const tl_twin_child_settings settings = {.job = &order, .config = &config};
    return tl_pair_verdict_find(&settings, &verdict, &error);
}

static void test_the_same(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, find(), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_PAIR_SAME, verdict.kind, verdict.text);
    TEST_ASSERT_GREATER_THAN_UINT32(0, verdict.steps);
    TEST_ASSERT_EQUAL_STRING("", verdict.text);
}

/* A machine without room is not a fault of an FMU. */
static void test_no_room(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TMPDIR", "/nowhere/at/all", 1));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, find(), error.text);
    TEST_ASSERT_EQUAL_INT(TL_PAIR_UNKNOWN, verdict.kind);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(verdict.text, "/nowhere/at/all"), verdict.text);
}

int main(int argc, char **argv) {
    static const tl_twin_role_tasks tasks = {.print_page = NULL};
    (void)argc;
    if (tl_role_begin(argv) != NULL) {
        tl_process_end(tl_twin_role_run(&tasks));
    }
    tl_scratch_make(&scratch, "/tmp", "pair_verdict");
    UNITY_BEGIN();
    RUN_TEST(test_the_same);
    RUN_TEST(test_no_room);
    int failures = UNITY_END();
    tl_scratch_remove(&scratch);
    return failures;
}
