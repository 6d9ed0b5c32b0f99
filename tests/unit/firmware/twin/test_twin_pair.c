/* Two twins in one process: with one configuration they are bit-identical, else the difference is
 * reported. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/twin/twin_trial.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/read_assembly.h"
#include "tests/support/scratch.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"

static tl_scratch scratch;
static tl_assembly first;
static tl_assembly second;
static tl_twin_pair_account account;
static tl_error error;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_load_assembly(LOCK, &first));
    account = (tl_twin_pair_account){.steps = 0};
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_assembly_free(&first);
    tl_assembly_free(&second);
    tl_scratch_empty(&scratch);
}

/* The second twin's configuration is LOCK with a part replaced. */
static tl_status compare_with(const char *old, const char *new) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "config.json"));
    TEST_ASSERT_TRUE_MESSAGE(tl_test_write_replaced(LOCK, path, old, new), old);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(path, &second));
    return tl_twin_pair_compare(&first, &second, false, &account, &error);
}

static void test_the_same(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(LOCK, &second));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_pair_compare(&first, &second, false, &account, &error));
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_UINT32(1, account.has_second);
    TEST_ASSERT_GREATER_THAN_UINT32(0, account.steps);
    TEST_ASSERT_EQUAL_STRING("", account.component);
}

/* The adjusted variables change, so that the outputs do, too. */
static void test_they_move(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_pair_compare(&first, &second, true, &account, &error));
    TEST_ASSERT_GREATER_THAN_UINT32(9, account.steps);
    for (uint32_t i = 1; i < account.steps; i++) {
        TEST_ASSERT_NOT_EQUAL_UINT64(account.marks[0], account.marks[i]);
    }
    TEST_ASSERT_EQUAL_UINT32(0, account.has_second);
    TEST_ASSERT_NULL(second.twin);
}

static void test_other_values(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, compare_with("0.0515", "0.0516"));
    TEST_ASSERT_EQUAL_STRING("motor", account.component);
    TL_EXPECT_PARTS("step|omega|instance", error.text);
}

/* It is not logged. */
static void test_a_second_twin_that_cannot_be_built(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, compare_with("motor.fmu", "nowhere.fmu"));
    TEST_ASSERT_EQUAL_STRING("motor", account.component);
    TL_EXPECT_PARTS("\"nowhere.fmu\"", error.text);
    TEST_ASSERT_EQUAL_UINT32(1, account.has_second);
}

int main(void) {
    tl_scratch_make(&scratch, "/tmp", "twin_pair");
    UNITY_BEGIN();
    RUN_TEST(test_the_same);
    RUN_TEST(test_they_move);
    RUN_TEST(test_other_values);
    RUN_TEST(test_a_second_twin_that_cannot_be_built);
    int failures = UNITY_END();
    tl_scratch_remove(&scratch);
    return failures;
}
