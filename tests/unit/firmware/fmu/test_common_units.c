/* Conversions of common units: values of known points, whatever the model defines. */
#include <stdbool.h>
#include <stddef.h>

#include <unity.h>

#include "firmware/fmu/common_units.h"

static const tl_unit UNITS[] = {
    {"bar", true, {1, -1, -2, 0, 0, 0, 0, 0}, 2, 0}, /* another one than the table's */
    {"Pa", true, {1, -1, -2, 0, 0, 0, 0, 0}, 1, 0},
    {.name = "rad/s"},
    {"1/s", true, {0, 0, -1, 0, 0, 0, 0, 0}, 1, 0},
};
static const tl_model MODEL = {.units = UNITS, .unit_count = sizeof UNITS / sizeof UNITS[0]};

void setUp(void) {}

void tearDown(void) {}

static void expect_value(double value, const char *from, const char *to, double expected) {
    const tl_unit named = {.name = to};
    const tl_unit source = {.name = from};
    const tl_unit *own = tl_model_unit(&MODEL, to);
    const tl_unit *known = tl_model_unit(&MODEL, from);
    tl_conversion conversion;
    TEST_ASSERT_TRUE_MESSAGE(
        tl_common_units_convert(known != NULL ? known : &source, own != NULL ? own : &named, &conversion), from);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, expected, conversion.factor * value + conversion.offset);
}

static void test_values(void) {
    expect_value(60, "rpm", "rad/s", 6.283185307179586);
    expect_value(60, "1/min", "rad/s", 6.283185307179586);
    expect_value(180, "deg", "rad", 3.141592653589793);
    expect_value(25, "degC", "K", 298.15);
    expect_value(298.15, "K",
                 "\302\260"
                 "C",
                 25);
    expect_value(212, "degF", "degC", 100);
    expect_value(1, "mbar", "hPa", 1);
    expect_value(60, "l/min", "m3/h", 3.6);
    expect_value(3600, "m\302\263/h", "m3/s", 1);
    expect_value(36, "km/h", "m/s", 10);
    expect_value(50, "%", "1", 0.5);
    expect_value(2.5, "kW", "W", 2500);
    expect_value(1, "kWh", "MJ", 3.6);
}

static void test_the_model_comes_first(void) {
    expect_value(3, "bar", "Pa", 6);
}

static void test_units_that_do_not_fit(void) {
    static const char *const pairs[][2] = {{"bar", "1/s"}, {"rpm", "Pa"}, {"rpm", "1/s"}, {"ell", "Pa"}};
    for (size_t i = 0; i < sizeof pairs / sizeof pairs[0]; i++) {
        const tl_unit source = {.name = pairs[i][0]};
        tl_conversion conversion;
        TEST_ASSERT_FALSE_MESSAGE(tl_common_units_convert(&source, tl_model_unit(&MODEL, pairs[i][1]), &conversion),
                                  pairs[i][0]);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_values);
    RUN_TEST(test_the_model_comes_first);
    RUN_TEST(test_units_that_do_not_fit);
    return UNITY_END();
}
