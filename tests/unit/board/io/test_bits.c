/* Conversion between bits and numbers, at the limits of each length. */
#include <float.h>
#include <math.h>

#include <unity.h>

#include "board/io/bits.h"

void setUp(void) {}

void tearDown(void) {}

static void test_signed(void) {
    TEST_ASSERT_EQUAL_DOUBLE(0, tl_bits_to_signed(0, 1));
    TEST_ASSERT_EQUAL_DOUBLE(-1, tl_bits_to_signed(1, 1));
    TEST_ASSERT_EQUAL_DOUBLE(32767, tl_bits_to_signed(0x7FFF, 16));
    TEST_ASSERT_EQUAL_DOUBLE(-32768, tl_bits_to_signed(0x8000, 16));
    TEST_ASSERT_EQUAL_DOUBLE(-1, tl_bits_to_signed(0xFFFFFFFF, 32));
    TEST_ASSERT_EQUAL_DOUBLE(0x1p63, tl_bits_to_signed(INT64_MAX, 64)); /* the nearest double */
    TEST_ASSERT_EQUAL_DOUBLE(-0x1p63, tl_bits_to_signed((uint64_t)1 << 63, 64));
    TEST_ASSERT_EQUAL_DOUBLE(-1, tl_bits_to_signed(UINT64_MAX, 64));
}

static void test_bits_above_are_not_looked_at(void) {
    TEST_ASSERT_EQUAL_DOUBLE(-1, tl_bits_to_signed(0xFFFF, 8));
    TEST_ASSERT_EQUAL_DOUBLE(1, tl_bits_to_signed(0xFF01, 8));
    TEST_ASSERT_EQUAL_DOUBLE(1, tl_bits_to_float32(0xFFFFFFFF3F800000));
}

static void test_floats(void) {
    TEST_ASSERT_EQUAL_DOUBLE(1, tl_bits_to_float32(0x3F800000));
    TEST_ASSERT_EQUAL_DOUBLE(-2, tl_bits_to_float64(0xC000000000000000));
    TEST_ASSERT_TRUE(isnan(tl_bits_to_float32(0x7FC00000)));
    TEST_ASSERT_EQUAL_HEX64(0x3F800000, tl_bits_of_float32(1));
    TEST_ASSERT_EQUAL_HEX64(0xC000000000000000, tl_bits_of_float64(-2));
    TEST_ASSERT_EQUAL_DOUBLE(0.1, tl_bits_to_float64(tl_bits_of_float64(0.1)));
}

static void test_a_float_of_32_bits_saturates(void) {
    TEST_ASSERT_EQUAL_DOUBLE(FLT_MAX, tl_bits_to_float32(tl_bits_of_float32(1e300)));
    TEST_ASSERT_EQUAL_DOUBLE(-FLT_MAX, tl_bits_to_float32(tl_bits_of_float32(-DBL_MAX)));
    TEST_ASSERT_EQUAL_HEX64(0x7F800000, tl_bits_of_float32((double)INFINITY));
    TEST_ASSERT_EQUAL_HEX64(0xFF800000, tl_bits_of_float32(-(double)INFINITY));
    TEST_ASSERT_TRUE(isnan(tl_bits_to_float32(tl_bits_of_float32((double)NAN))));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_signed);
    RUN_TEST(test_bits_above_are_not_looked_at);
    RUN_TEST(test_floats);
    RUN_TEST(test_a_float_of_32_bits_saturates);
    return UNITY_END();
}
