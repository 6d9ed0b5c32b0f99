/* Modbus registers to values and back: every type, both orders, limits.
 *
 * The expected registers are written by hand from the definition of each format, not computed by
 * our code. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "board/modbus/modbus.h"

void setUp(void) {}

void tearDown(void) {}

static tl_modbus_channel channel_of(tl_modbus_type type) {
    tl_modbus_channel channel = {.table = TL_MODBUS_HOLDING, .type = type, .scale = 1, .offset = 0};
    return channel;
}

typedef struct example {
    tl_modbus_type type;
    double value;
    uint16_t big[4]; /* both orders big */
} example;

static const example EXAMPLES[] = {
    {TL_MODBUS_INT16, 258, {0x0102}},
    {TL_MODBUS_INT16, -2, {0xFFFE}},
    {TL_MODBUS_INT16, -32768, {0x8000}},
    {TL_MODBUS_INT16, 32767, {0x7FFF}},
    {TL_MODBUS_UINT16, 65534, {0xFFFE}},
    {TL_MODBUS_UINT16, 0, {0x0000}},
    {TL_MODBUS_INT32, 0x01020304, {0x0102, 0x0304}},
    {TL_MODBUS_INT32, -2, {0xFFFF, 0xFFFE}},
    {TL_MODBUS_INT32, -2147483648.0, {0x8000, 0x0000}},
    {TL_MODBUS_UINT32, 4294967294.0, {0xFFFF, 0xFFFE}},
    {TL_MODBUS_UINT32, 0x01020304, {0x0102, 0x0304}},
    {TL_MODBUS_FLOAT32, 1, {0x3F80, 0x0000}},
    {TL_MODBUS_FLOAT32, -0.15625, {0xBE20, 0x0000}},
    {TL_MODBUS_FLOAT32, 12345.6787109375, {0x4640, 0xE6B7}},
    {TL_MODBUS_FLOAT64, 1, {0x3FF0, 0x0000, 0x0000, 0x0000}},
    {TL_MODBUS_FLOAT64, 0.1, {0x3FB9, 0x9999, 0x9999, 0x999A}},
    {TL_MODBUS_FLOAT64, -DBL_MAX, {0xFFEF, 0xFFFF, 0xFFFF, 0xFFFF}},
    {TL_MODBUS_INT64, 72623859790382848.0, {0x0102, 0x0304, 0x0506, 0x0700}},
    {TL_MODBUS_INT64, -2, {0xFFFF, 0xFFFF, 0xFFFF, 0xFFFE}},
    {TL_MODBUS_INT64, -9223372036854775808.0, {0x8000, 0x0000, 0x0000, 0x0000}},
    {TL_MODBUS_INT64, 9007199254740991.0, {0x001F, 0xFFFF, 0xFFFF, 0xFFFF}},
    {TL_MODBUS_UINT64, 9223372036854775808.0, {0x8000, 0x0000, 0x0000, 0x0000}},
    {TL_MODBUS_UINT64, 18446744073709549568.0, {0xFFFF, 0xFFFF, 0xFFFF, 0xF800}},
    {TL_MODBUS_BCD16, 1234, {0x1234}},
    {TL_MODBUS_BCD16, 9999, {0x9999}},
    {TL_MODBUS_BCD16, 0, {0x0000}},
    {TL_MODBUS_BCD32, 12345678, {0x1234, 0x5678}},
    {TL_MODBUS_BCD32, 90, {0x0000, 0x0090}},
};

enum { EXAMPLE_COUNT = sizeof EXAMPLES / sizeof EXAMPLES[0] };

/* The registers of an example in another order. */
static void reorder(const example *from, bool words_little, bool bytes_little, uint16_t *to) {
    size_t count = tl_modbus_registers(from->type);
    for (size_t i = 0; i < count; i++) {
        uint16_t word = from->big[words_little ? count - 1 - i : i];
        to[i] = bytes_little ? (uint16_t)(word % 256 * 256 + word / 256) : word;
    }
}

static void test_every_type_in_every_order(void) {
    for (int order = 0; order < 4; order++) {
        for (size_t i = 0; i < EXAMPLE_COUNT; i++) {
            tl_modbus_channel channel = channel_of(EXAMPLES[i].type);
            channel.words_little = order % 2 != 0;
            channel.bytes_little = order / 2 != 0;
            uint16_t expected[4] = {0};
            uint16_t encoded[4] = {0};
            double value = -1;
            reorder(&EXAMPLES[i], channel.words_little, channel.bytes_little, expected);
            TEST_ASSERT_TRUE(tl_modbus_decode(&channel, expected, &value));
            TEST_ASSERT_EQUAL_MEMORY(&EXAMPLES[i].value, &value, sizeof value);
            tl_modbus_encode(&channel, EXAMPLES[i].value, encoded);
            TEST_ASSERT_EQUAL_HEX16_ARRAY(expected, encoded, 4);
        }
    }
}

/* Otherwise the test above could not distinguish the orders. */
static void test_the_four_orders_differ(void) {
    tl_modbus_channel channel = channel_of(TL_MODBUS_UINT32);
    const uint16_t registers[2] = {0x0102, 0x0304};
    const double expected[4] = {0x01020304, 0x03040102, 0x02010403, 0x04030201};
    for (int order = 0; order < 4; order++) {
        double value = 0;
        channel.words_little = order % 2 != 0;
        channel.bytes_little = order / 2 != 0;
        TEST_ASSERT_TRUE(tl_modbus_decode(&channel, registers, &value));
        TEST_ASSERT_EQUAL_DOUBLE(expected[order], value);
    }
}

static void test_registers(void) {
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_registers(TL_MODBUS_BIT));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_registers(TL_MODBUS_INT16));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_registers(TL_MODBUS_UINT16));
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_registers(TL_MODBUS_INT32));
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_registers(TL_MODBUS_UINT32));
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_registers(TL_MODBUS_FLOAT32));
    TEST_ASSERT_EQUAL_size_t(4, tl_modbus_registers(TL_MODBUS_FLOAT64));
    TEST_ASSERT_EQUAL_size_t(4, tl_modbus_registers(TL_MODBUS_INT64));
    TEST_ASSERT_EQUAL_size_t(4, tl_modbus_registers(TL_MODBUS_UINT64));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_registers(TL_MODBUS_BCD16));
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_registers(TL_MODBUS_BCD32));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_registers(TL_MODBUS_REGISTER_BIT));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_registers(TL_MODBUS_INT8));
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_registers(TL_MODBUS_UINT8));
}

/* The nearest double, as IEEE 754 rounds: 2^53 + 1 is a tie, to even. */
static void test_integers_beyond_2_53_are_rounded(void) {
    static const uint16_t TIE[4] = {0x0020, 0, 0, 1};
    static const uint16_t ALL[4] = {0xFFFF, 0xFFFF, 0xFFFF, 0xFFFF};
    tl_modbus_channel channel = channel_of(TL_MODBUS_UINT64);
    double value = 0;
    TEST_ASSERT_TRUE(tl_modbus_decode(&channel, TIE, &value));
    TEST_ASSERT_EQUAL_DOUBLE(9007199254740992.0, value);
    TEST_ASSERT_TRUE(tl_modbus_decode(&channel, ALL, &value));
    TEST_ASSERT_EQUAL_DOUBLE(18446744073709551616.0, value);
    channel.type = TL_MODBUS_INT64;
    TEST_ASSERT_TRUE(tl_modbus_decode(&channel, ALL, &value));
    TEST_ASSERT_EQUAL_DOUBLE(-1, value);
}

static void expect_wide(tl_modbus_type type, double value, uint64_t expected) {
    tl_modbus_channel channel = channel_of(type);
    uint16_t registers[4] = {0};
    tl_modbus_encode(&channel, value, registers);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL_HEX16(expected >> (48 - 16 * i) & 0xFFFF, registers[i]);
    }
}

static void test_wide_integers_saturate(void) {
    expect_wide(TL_MODBUS_INT64, 1e300, INT64_MAX);
    expect_wide(TL_MODBUS_INT64, -HUGE_VAL, (uint64_t)INT64_MIN);
    expect_wide(TL_MODBUS_INT64, (double)NAN, 0);
    expect_wide(TL_MODBUS_INT64, -2.5, UINT64_MAX - 2);
    expect_wide(TL_MODBUS_UINT64, 18446744073709551616.0, UINT64_MAX);
    expect_wide(TL_MODBUS_UINT64, -1, 0);
}

static void test_a_digit_above_9_is_no_number(void) {
    for (unsigned shift = 0; shift < 16; shift += 4) {
        for (unsigned digit = 10; digit < 16; digit++) {
            const uint16_t one = (uint16_t)(digit << shift);
            const uint16_t pair[2] = {0x1234, one};
            tl_modbus_channel channel = channel_of(TL_MODBUS_BCD16);
            double value = -1;
            TEST_ASSERT_FALSE(tl_modbus_decode(&channel, &one, &value));
            TEST_ASSERT_EQUAL_DOUBLE(0, value);
            channel.type = TL_MODBUS_BCD32;
            TEST_ASSERT_FALSE(tl_modbus_decode(&channel, pair, &value));
            channel.words_little = true;
            TEST_ASSERT_FALSE(tl_modbus_decode(&channel, pair, &value));
        }
    }
}

/* Reads a part of `raw`, then writes `value` to it. */
static void expect_part(tl_modbus_channel channel, uint16_t raw, double read, double value, uint16_t written) {
    double got = -1;
    TEST_ASSERT_TRUE(tl_modbus_decode(&channel, &raw, &got));
    TEST_ASSERT_EQUAL_DOUBLE(read, got);
    tl_modbus_encode(&channel, value, &raw);
    TEST_ASSERT_EQUAL_HEX16(written, raw);
}

static void test_parts_of_a_register(void) {
    tl_modbus_channel channel = channel_of(TL_MODBUS_REGISTER_BIT);
    for (uint8_t bit = 0; bit < 16; bit++) {
        const uint16_t mask = (uint16_t)(1U << bit);
        channel.bit = bit;
        expect_part(channel, mask, 1, 0, 0);
        expect_part(channel, (uint16_t)~mask, 0, 7, 0xFFFF);
        channel.bytes_little = true; /* then the bits are counted in the swapped register */
        expect_part(channel, (uint16_t)(mask << 8 | mask >> 8), 1, 0, 0);
        channel.bytes_little = false;
    }
    channel = channel_of(TL_MODBUS_UINT8);
    expect_part(channel, 0x12FE, 254, 300, 0x12FF);
    channel.type = TL_MODBUS_INT8;
    expect_part(channel, 0x12FE, -2, -300, 0x1280);
    channel.bit = 8;
    expect_part(channel, 0x80FE, -128, 18, 0x12FE);
    channel.type = TL_MODBUS_UINT8;
    expect_part(channel, 0x80FE, 128, -1, 0x00FE);
    channel.bytes_little = true;
    expect_part(channel, 0x80FE, 254, 1, 0x8001);
}

static void test_bits(void) {
    tl_modbus_channel channel = channel_of(TL_MODBUS_BIT);
    const double values[] = {0, 1, 7, -1, 0.4, 0.6};
    const uint16_t expected[] = {0, 1, 1, 0, 0, 1};
    for (size_t i = 0; i < 6; i++) {
        uint16_t bit = 99;
        tl_modbus_encode(&channel, values[i], &bit);
        TEST_ASSERT_EQUAL_UINT16(expected[i], bit);
    }
    const uint16_t anything = 0x0100;
    double value = -1;
    TEST_ASSERT_TRUE(tl_modbus_decode(&channel, &anything, &value));
    TEST_ASSERT_EQUAL_DOUBLE(1, value);
    channel.scale = -1; /* a contact that is closed at rest */
    channel.offset = 1;
    TEST_ASSERT_TRUE(tl_modbus_decode(&channel, &anything, &value));
    TEST_ASSERT_EQUAL_DOUBLE(0, value);
    uint16_t bit = 99;
    tl_modbus_encode(&channel, 1, &bit);
    TEST_ASSERT_EQUAL_UINT16(0, bit);
}

static void test_scale_and_offset(void) {
    tl_modbus_channel channel = channel_of(TL_MODBUS_INT16);
    const uint16_t raw = 0xFF38; /* -200 */
    double value = 0;
    uint16_t back = 0;
    channel.scale = 0.25;
    channel.offset = 10;
    TEST_ASSERT_TRUE(tl_modbus_decode(&channel, &raw, &value));
    TEST_ASSERT_EQUAL_DOUBLE(-40, value);
    tl_modbus_encode(&channel, -40, &back);
    TEST_ASSERT_EQUAL_HEX16(raw, back);
}

/* Encodes into one register or two; returns them as a number. */
static uint32_t encoded(tl_modbus_type type, double value) {
    tl_modbus_channel channel = channel_of(type);
    uint16_t registers[4] = {0};
    tl_modbus_encode(&channel, value, registers);
    return tl_modbus_registers(type) == 1 ? registers[0] : (uint32_t)registers[0] << 16 | registers[1];
}

static void test_integers_round_and_saturate(void) {
    TEST_ASSERT_EQUAL_HEX32(3, encoded(TL_MODBUS_INT16, 2.5));
    TEST_ASSERT_EQUAL_HEX32(0xFFFD, encoded(TL_MODBUS_INT16, -2.5));
    TEST_ASSERT_EQUAL_HEX32(2, encoded(TL_MODBUS_INT16, 2.4));
    TEST_ASSERT_EQUAL_HEX32(0x7FFF, encoded(TL_MODBUS_INT16, 1e300));
    TEST_ASSERT_EQUAL_HEX32(0x8000, encoded(TL_MODBUS_INT16, -1e300));
    TEST_ASSERT_EQUAL_HEX32(0xFFFF, encoded(TL_MODBUS_UINT16, 65536));
    TEST_ASSERT_EQUAL_HEX32(0, encoded(TL_MODBUS_UINT16, -1));
    TEST_ASSERT_EQUAL_HEX32(0x7FFFFFFF, encoded(TL_MODBUS_INT32, HUGE_VAL));
    TEST_ASSERT_EQUAL_HEX32(0x80000000, encoded(TL_MODBUS_INT32, -HUGE_VAL));
    TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFF, encoded(TL_MODBUS_UINT32, 1e10));
    TEST_ASSERT_EQUAL_HEX32(0, encoded(TL_MODBUS_INT32, (double)NAN));
    TEST_ASSERT_EQUAL_HEX32(0x9999, encoded(TL_MODBUS_BCD16, 10000));
    TEST_ASSERT_EQUAL_HEX32(0x99999999, encoded(TL_MODBUS_BCD32, HUGE_VAL));
    TEST_ASSERT_EQUAL_HEX32(0, encoded(TL_MODBUS_BCD32, -1));
}

static void test_floats_saturate(void) {
    TEST_ASSERT_EQUAL_HEX32(0x7F7FFFFF, encoded(TL_MODBUS_FLOAT32, 1e300));
    TEST_ASSERT_EQUAL_HEX32(0xFF7FFFFF, encoded(TL_MODBUS_FLOAT32, -1e300));
    TEST_ASSERT_EQUAL_HEX32(0x7F800000, encoded(TL_MODBUS_FLOAT32, HUGE_VAL));
    TEST_ASSERT_EQUAL_HEX32(0xFF800000, encoded(TL_MODBUS_FLOAT32, -HUGE_VAL));
}

/* false, and 0. */
static void expect_not_finite(tl_modbus_type type, uint16_t first, uint16_t second, double scale) {
    tl_modbus_channel channel = channel_of(type);
    const uint16_t registers[4] = {first, second, 0, 0};
    double value = -1;
    channel.scale = scale;
    TEST_ASSERT_FALSE(tl_modbus_decode(&channel, registers, &value));
    TEST_ASSERT_EQUAL_DOUBLE(0, value);
}

static void test_what_is_not_finite(void) {
    expect_not_finite(TL_MODBUS_FLOAT32, 0x7FC0, 0x0000, 1); /* quiet NaN */
    expect_not_finite(TL_MODBUS_FLOAT32, 0x7F80, 0x0001, 1); /* signalling NaN */
    expect_not_finite(TL_MODBUS_FLOAT32, 0x7F80, 0x0000, 1); /* infinity */
    expect_not_finite(TL_MODBUS_FLOAT32, 0xFF80, 0x0000, 1);
    expect_not_finite(TL_MODBUS_FLOAT64, 0x7FF8, 0x0000, 1);
    expect_not_finite(TL_MODBUS_FLOAT64, 0x7FF0, 0x0000, 1);
    expect_not_finite(TL_MODBUS_FLOAT64, 0x7FE0, 0x0000, 10); /* finite, but not after scaling */
}

/* The codes apply before the scale. */
static void test_codes_that_mean_not_available(void) {
    static const uint16_t RAW[] = {0x8000, 0xFFFF, 0x7FFF, 5};
    static const bool EXPECTED[] = {false, false, true, true};
    tl_modbus_channel channel = channel_of(TL_MODBUS_INT16);
    channel.scale = 5;
    channel.codes[0] = -32768;
    channel.codes[1] = -1;
    channel.codes[2] = 25; /* is not used */
    channel.code_count = 2;
    for (size_t i = 0; i < 4; i++) {
        double value = -1;
        TEST_ASSERT_EQUAL(EXPECTED[i], tl_modbus_decode(&channel, &RAW[i], &value));
        TEST_ASSERT_EQUAL_DOUBLE(EXPECTED[i] ? 5.0 * (int16_t)RAW[i] : 0, value);
    }
}

static void test_nan_goes_through_floats(void) {
    tl_modbus_channel channel = channel_of(TL_MODBUS_FLOAT64);
    uint16_t registers[4] = {0};
    double value = -1;
    tl_modbus_encode(&channel, (double)NAN, registers);
    TEST_ASSERT_FALSE(tl_modbus_decode(&channel, registers, &value));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_every_type_in_every_order);
    RUN_TEST(test_the_four_orders_differ);
    RUN_TEST(test_registers);
    RUN_TEST(test_integers_beyond_2_53_are_rounded);
    RUN_TEST(test_wide_integers_saturate);
    RUN_TEST(test_a_digit_above_9_is_no_number);
    RUN_TEST(test_parts_of_a_register);
    RUN_TEST(test_bits);
    RUN_TEST(test_scale_and_offset);
    RUN_TEST(test_integers_round_and_saturate);
    RUN_TEST(test_floats_saturate);
    RUN_TEST(test_what_is_not_finite);
    RUN_TEST(test_codes_that_mean_not_available);
    RUN_TEST(test_nan_goes_through_floats);
    return UNITY_END();
}
