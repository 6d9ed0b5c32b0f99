/* The present FMU call: names, functions, and a block with invalid bytes from another process. */
#include "firmware/process/fmu_call.h"

#include <stdio.h>
#include <string.h>
#include <unity.h>

static tl_fmu_calls block;

void setUp(void) {
    memset(&block, 0, sizeof block);
    tl_fmu_calls_use(&block);
}

void tearDown(void) {
    tl_fmu_calls_use(NULL);
}

static void nobody_is_called_at_first(void) {
    tl_fmu_call call;
    TEST_ASSERT_FALSE(tl_fmu_calls_poll(&block, &call));
    TEST_ASSERT_EQUAL_PTR(&block, tl_fmu_calls_in_use());
}

static void a_call_is_seen_until_it_ends(void) {
    tl_fmu_call call;
    uint32_t drive = tl_fmu_calls_name("drive");
    uint32_t motor = tl_fmu_calls_name("motor");
    TEST_ASSERT_NOT_EQUAL_UINT32(drive, motor);
    tl_fmu_call_begin(motor, TL_FMU_DO_STEP);
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &call));
    TEST_ASSERT_EQUAL_STRING("motor", call.fmu);
    TEST_ASSERT_EQUAL_STRING("fmi2DoStep", call.function);
    tl_fmu_call_end();
    TEST_ASSERT_FALSE(tl_fmu_calls_poll(&block, &call));
}

static void two_calls_have_two_numbers(void) {
    tl_fmu_call first;
    tl_fmu_call second;
    uint32_t motor = tl_fmu_calls_name("motor");
    tl_fmu_call_begin(motor, TL_FMU_DO_STEP);
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &first));
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &second));
    TEST_ASSERT_EQUAL_UINT32(first.begun, second.begun);
    tl_fmu_call_end();
    tl_fmu_call_begin(motor, TL_FMU_DO_STEP);
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &second));
    TEST_ASSERT_NOT_EQUAL_UINT32(first.begun, second.begun);
}

static void a_name_has_one_number(void) {
    uint32_t motor = tl_fmu_calls_name("motor");
    (void)tl_fmu_calls_name("drive");
    TEST_ASSERT_EQUAL_UINT32(motor, tl_fmu_calls_name("motor"));
}

static void too_many_names_share_the_last(void) {
    tl_fmu_call call;
    for (int i = 0; i < TL_FMU_CALL_FMUS + 20; i++) {
        char name[16];
        (void)snprintf(name, sizeof name, "c%d", i);
        TEST_ASSERT_LESS_THAN_UINT32(TL_FMU_CALL_FMUS << TL_FMU_CALL_FUNCTION_BITS, tl_fmu_calls_name(name));
    }
    tl_fmu_call_begin(tl_fmu_calls_name("one too many"), TL_FMU_GET_REAL);
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &call));
    TEST_ASSERT_EQUAL_STRING("c127", call.fmu);
}

static void a_long_name_is_cut(void) {
    char name[2 * TL_FMU_CALL_NAME];
    tl_fmu_call call;
    memset(name, 'n', sizeof name - 1);
    name[sizeof name - 1] = '\0';
    tl_fmu_call_begin(tl_fmu_calls_name(name), TL_FMU_GET_REAL);
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &call));
    TEST_ASSERT_EQUAL_size_t(TL_FMU_CALL_NAME - 1, strlen(call.fmu));
    TEST_ASSERT_EQUAL_UINT32(tl_fmu_calls_name(name), tl_fmu_calls_name(name));
}

static void every_function_has_a_name(void) {
    tl_fmu_call call;
    for (int function = TL_FMU_LOADING; function < TL_FMU_FUNCTIONS; function++) {
        tl_fmu_call_begin(0, (tl_fmu_function)function);
        TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &call));
        TEST_ASSERT_NOT_NULL(call.function);
    }
}

static void nonsense_in_the_block_is_not_believed(void) {
    tl_fmu_call call;
    memset(&block, 0xFF, sizeof block);
    TEST_ASSERT_FALSE(tl_fmu_calls_poll(&block, &call));
    block.now = 0xFFFFFF00U | TL_FMU_DO_STEP;
    TEST_ASSERT_TRUE(tl_fmu_calls_poll(&block, &call));
    TEST_ASSERT_EQUAL_size_t((TL_FMU_CALL_NAME - 1) / 4 * 4, strlen(call.fmu));
    TEST_ASSERT_EQUAL_STRING_LEN("\\xFF\\xFF", call.fmu, 8);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(nobody_is_called_at_first);
    RUN_TEST(a_call_is_seen_until_it_ends);
    RUN_TEST(two_calls_have_two_numbers);
    RUN_TEST(a_name_has_one_number);
    RUN_TEST(too_many_names_share_the_last);
    RUN_TEST(a_long_name_is_cut);
    RUN_TEST(every_function_has_a_name);
    RUN_TEST(nonsense_in_the_block_is_not_believed);
    return UNITY_END();
}
