/* Units: same, convertible, or wrong. */
#include <unity.h>

#include "master/fmi/units.h"

static const tl_unit kelvin = {"K", true, {0, 0, 0, 0, 1}, 1.0, 0.0};
static const tl_unit celsius = {"degC", true, {0, 0, 0, 0, 1}, 1.0, 273.15};
static const tl_unit fahrenheit = {"degF", true, {0, 0, 0, 0, 1}, 5.0 / 9.0, 273.15 - 32.0 * 5.0 / 9.0};
static const tl_unit per_second = {"rad/s", true, {0, 0, -1, 0, 0, 0, 0, 1}, 1.0, 0.0};
static const tl_unit per_minute = {"rpm", true, {0, 0, -1, 0, 0, 0, 0, 1}, 0.10471975511965977, 0.0};
static const tl_unit named_only = {"turns", false, {0}, 0.0, 0.0};
static const tl_unit named_kelvin = {"K", false, {0}, 0.0, 0.0};
static const tl_unit empty = {"", false, {0}, 0.0, 0.0};

void setUp(void) {}

void tearDown(void) {}

static double converted(const tl_unit *from, const tl_unit *to, double value) {
    tl_conversion conversion;
    TEST_ASSERT_TRUE(tl_units_convert(from, to, &conversion));
    return conversion.factor * value + conversion.offset;
}

static void temperatures_convert_with_their_offsets(void) {
    TEST_ASSERT_EQUAL_DOUBLE(293.15, converted(&celsius, &kelvin, 20.0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-10, 20.0, converted(&kelvin, &celsius, 293.15));
    TEST_ASSERT_DOUBLE_WITHIN(1e-10, 100.0, converted(&fahrenheit, &celsius, 212.0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-10, -40.0, converted(&celsius, &fahrenheit, -40.0));
}

static void speeds_convert_by_a_factor(void) {
    TEST_ASSERT_DOUBLE_WITHIN(1e-10, 314.1592653589793, converted(&per_minute, &per_second, 3000.0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 3000.0, converted(&per_second, &per_minute, 314.1592653589793));
}

static void the_same_unit_is_the_identity_to_the_bit(void) {
    tl_conversion conversion;
    TEST_ASSERT_TRUE(tl_units_convert(&celsius, &celsius, &conversion));
    TEST_ASSERT_TRUE(tl_conversion_is_identity(&conversion));
    TEST_ASSERT_TRUE(tl_units_convert(&celsius, &kelvin, &conversion));
    TEST_ASSERT_FALSE(tl_conversion_is_identity(&conversion));
    conversion = (tl_conversion){1.0, -0.0};
    TEST_ASSERT_TRUE(tl_conversion_is_identity(&conversion));
}

static void other_dimensions_do_not_fit(void) {
    tl_conversion conversion;
    TEST_ASSERT_FALSE(tl_units_convert(&kelvin, &per_second, &conversion));
}

static void names_decide_where_no_base_is_known(void) {
    tl_conversion conversion;
    TEST_ASSERT_TRUE(tl_units_convert(&named_kelvin, &kelvin, &conversion));
    TEST_ASSERT_TRUE(tl_conversion_is_identity(&conversion));
    TEST_ASSERT_FALSE(tl_units_convert(&named_only, &kelvin, &conversion));
    TEST_ASSERT_FALSE(tl_units_convert(&kelvin, &named_only, &conversion));
    TEST_ASSERT_TRUE(tl_units_convert(&named_only, &named_only, &conversion));
}

static void no_unit_fits_everything(void) {
    tl_conversion conversion;
    TEST_ASSERT_TRUE(tl_units_convert(NULL, &kelvin, &conversion));
    TEST_ASSERT_TRUE(tl_conversion_is_identity(&conversion));
    TEST_ASSERT_TRUE(tl_units_convert(&celsius, NULL, &conversion));
    TEST_ASSERT_TRUE(tl_conversion_is_identity(&conversion));
    TEST_ASSERT_TRUE(tl_units_convert(&empty, &named_only, &conversion));
    TEST_ASSERT_TRUE(tl_units_convert(&celsius, &empty, &conversion));
    TEST_ASSERT_TRUE(tl_conversion_is_identity(&conversion));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(temperatures_convert_with_their_offsets);
    RUN_TEST(speeds_convert_by_a_factor);
    RUN_TEST(the_same_unit_is_the_identity_to_the_bit);
    RUN_TEST(other_dimensions_do_not_fit);
    RUN_TEST(names_decide_where_no_base_is_known);
    RUN_TEST(no_unit_fits_everything);
    return UNITY_END();
}
