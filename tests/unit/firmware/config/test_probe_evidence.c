/* Evidence of a value for its mapping: signs and order, with both limits, one, and none. */
#include <math.h>
#include <stdint.h>

#include <unity.h>

#include "firmware/config/probe_evidence.h"

void setUp(void) {}

void tearDown(void) {}

static double evidence(double least, double most, double scale, uint16_t content) {
    const tl_config_signal signal = {.minimum = least, .maximum = most, .plan = {.has_initial = true, .initial = 20.0}};
    const tl_modbus_channel channel = {.type = TL_MODBUS_UINT16, .scale = scale};
    return tl_probe_evidence(&signal, &channel, &content, false);
}

static void test_a_value_within_both_limits_is_likelier_than_one_outside(void) {
    TEST_ASSERT_TRUE(evidence(0, 100, 1, 60) > 0.0);
    TEST_ASSERT_TRUE(evidence(0, 100, 1, 60) > evidence(0, 100, 10, 60));
    TEST_ASSERT_TRUE(evidence(0, 100, 10, 60) < 0.0);
    TEST_ASSERT_EQUAL_DOUBLE(TL_PROBE_ABSURD, evidence(0, 1, 1, 6000));
}

/* An open range holds any value, so a larger one proves nothing more. */
static void test_an_open_range_proves_nothing(void) {
    TEST_ASSERT_TRUE(evidence(-HUGE_VAL, HUGE_VAL, 1000, 60) < 0.1);
    TEST_ASSERT_TRUE(evidence(0, HUGE_VAL, 1000, 60) < 0.1);
    TEST_ASSERT_TRUE(evidence(-5, HUGE_VAL, 1, 20000) > TL_PROBE_ABSURD);
    TEST_ASSERT_TRUE(evidence(-5, HUGE_VAL, 1, 20000) < 0.1);
}

static void test_contents_without_a_value(void) {
    TEST_ASSERT_EQUAL_DOUBLE(TL_PROBE_NO_VALUE, evidence(0, 100, 1, UINT16_MAX));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, evidence(-HUGE_VAL, HUGE_VAL, 1, 0));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_value_within_both_limits_is_likelier_than_one_outside);
    RUN_TEST(test_an_open_range_proves_nothing);
    RUN_TEST(test_contents_without_a_value);
    return UNITY_END();
}
