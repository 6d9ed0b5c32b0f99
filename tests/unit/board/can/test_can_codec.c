/* CAN signals to values and back: bit positions, types, limits, multiplexors.
 *
 * The expected bytes are written by hand from the definition of each byte order, not computed by
 * our code. tests/replay/test_can_oracle.py compares random layouts with cantools. */
#include <float.h>
#include <math.h>
#include <stdint.h>
#include <string.h>

#include <unity.h>

#include "board/can/can_codec.h"

static uint8_t data[TL_CAN_BYTES];

void setUp(void) {
    memset(data, 0, sizeof data);
}

void tearDown(void) {}

static tl_can_channel channel_of(tl_can_order order, uint16_t start, uint16_t length, tl_can_type type) {
    tl_can_channel channel = {
        .bytes = 8, .field = {.start = start, .length = length, .order = order}, .type = type, .scale = 1};
    return channel;
}

typedef struct example {
    tl_can_field field;
    uint64_t bits;
    uint8_t bytes[8];
} example;

static const example EXAMPLES[] = {
    {{0, 8, TL_CAN_INTEL}, 0xA5, {0xA5}},
    {{0, 16, TL_CAN_INTEL}, 0x1234, {0x34, 0x12}},
    {{4, 12, TL_CAN_INTEL}, 0xABC, {0xC0, 0xAB}},
    {{12, 3, TL_CAN_INTEL}, 5, {0, 0x50}},
    {{7, 1, TL_CAN_INTEL}, 1, {0x80}},
    {{6, 4, TL_CAN_INTEL}, 0xF, {0xC0, 0x03}},
    {{0, 64, TL_CAN_INTEL}, 0x0102030405060708, {8, 7, 6, 5, 4, 3, 2, 1}},
    {{7, 8, TL_CAN_MOTOROLA}, 0xA5, {0xA5}},
    {{7, 16, TL_CAN_MOTOROLA}, 0x1234, {0x12, 0x34}},
    {{3, 12, TL_CAN_MOTOROLA}, 0xABC, {0x0A, 0xBC}},
    {{14, 3, TL_CAN_MOTOROLA}, 5, {0, 0x50}},
    {{0, 1, TL_CAN_MOTOROLA}, 1, {0x01}},
    {{1, 4, TL_CAN_MOTOROLA}, 0xF, {0x03, 0xC0}},
    {{7, 64, TL_CAN_MOTOROLA}, 0x0102030405060708, {1, 2, 3, 4, 5, 6, 7, 8}},
};

enum { EXAMPLE_COUNT = sizeof EXAMPLES / sizeof EXAMPLES[0] };

static void test_places(void) {
    for (size_t i = 0; i < EXAMPLE_COUNT; i++) {
        uint8_t all[TL_CAN_BYTES];
        memset(all, 0xFF, sizeof all);
        setUp();
        TEST_ASSERT_EQUAL_HEX64(EXAMPLES[i].bits, tl_can_read_bits(&EXAMPLES[i].field, EXAMPLES[i].bytes));
        tl_can_write_bits(&EXAMPLES[i].field, EXAMPLES[i].bits, data);
        TEST_ASSERT_EQUAL_HEX8_ARRAY(EXAMPLES[i].bytes, data, 8);
        tl_can_write_bits(&EXAMPLES[i].field, 0, all); /* nothing but its own bits */
        tl_can_write_bits(&EXAMPLES[i].field, UINT64_MAX, all);
        for (size_t k = 0; k < sizeof all; k++) {
            TEST_ASSERT_EQUAL_HEX8(0xFF, all[k]);
        }
    }
}

static void test_bytes_needed(void) {
    static const struct {
        tl_can_field field;
        size_t bytes;
    } cases[] = {
        {{0, 1, TL_CAN_INTEL}, 1},       {{7, 2, TL_CAN_INTEL}, 2},       {{0, 64, TL_CAN_INTEL}, 8},
        {{1, 64, TL_CAN_INTEL}, 9},      {{511, 1, TL_CAN_INTEL}, 64},    {{511, 2, TL_CAN_INTEL}, 65},
        {{7, 8, TL_CAN_MOTOROLA}, 1},    {{7, 9, TL_CAN_MOTOROLA}, 2},    {{0, 2, TL_CAN_MOTOROLA}, 2},
        {{63, 8, TL_CAN_MOTOROLA}, 8},   {{56, 2, TL_CAN_MOTOROLA}, 9},   {{511, 8, TL_CAN_MOTOROLA}, 64},
        {{504, 1, TL_CAN_MOTOROLA}, 64}, {{504, 2, TL_CAN_MOTOROLA}, 65},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        TEST_ASSERT_EQUAL_size_t(cases[i].bytes, tl_can_field_bytes(&cases[i].field));
    }
}

static void test_bytes_needed_with_multiplexors(void) {
    tl_can_channel channel = channel_of(TL_CAN_INTEL, 0, 8, TL_CAN_UNSIGNED);
    channel.conditions[0] = (tl_can_condition){.field = {40, 4, TL_CAN_INTEL}, .values = {1}, .value_count = 1};
    channel.condition_count = 1;
    TEST_ASSERT_EQUAL_size_t(6, tl_can_channel_bytes(&channel));
    channel.field.start = 48;
    TEST_ASSERT_EQUAL_size_t(7, tl_can_channel_bytes(&channel));
}

static void expect_available(uint16_t length, uint64_t bits, bool is_available) {
    tl_can_channel channel = channel_of(TL_CAN_INTEL, 0, length, TL_CAN_UNSIGNED);
    double value = 77;
    channel.offset = 1;
    channel.not_available = true;
    setUp();
    tl_can_write_bits(&channel.field, bits, data);
    TEST_ASSERT_EQUAL(is_available, tl_can_decode(&channel, data, &value));
    TEST_ASSERT_EQUAL_DOUBLE(is_available ? (double)bits + 1 : 0, value);
    channel.not_available = false;
    TEST_ASSERT_TRUE(tl_can_decode(&channel, data, &value));
    TEST_ASSERT_EQUAL_DOUBLE((double)bits + 1, value);
}

static void test_ranges_of_multiplexors(void) {
    tl_can_channel channel = channel_of(TL_CAN_INTEL, 8, 8, TL_CAN_UNSIGNED);
    channel.conditions[0] =
        (tl_can_condition){.field = {0, 8, TL_CAN_INTEL}, .values = {3, 200}, .further = {4, 55}, .value_count = 2};
    channel.condition_count = 1;
    for (unsigned value = 0; value < 256; value++) {
        data[0] = (uint8_t)value;
        TEST_ASSERT_EQUAL((value >= 3 && value <= 7) || value >= 200, tl_can_is_present(&channel, data));
    }
}

/* SAE J1939-71, table 1, and the discrete values of table 2. */
static void test_values_that_are_not_available(void) {
    expect_available(2, 1, true);
    expect_available(2, 2, false);
    expect_available(2, 3, false);
    expect_available(4, 13, true);
    expect_available(4, 15, false);
    expect_available(8, 0xFD, true);
    expect_available(8, 0xFE, false);
    expect_available(8, 0xFF, false);
    expect_available(16, 0xFDFF, true);
    expect_available(16, 0xFE00, false);
    expect_available(16, 0xFFFF, false);
    expect_available(32, 0xFDFFFFFF, true);
    expect_available(32, 0xFE000000, false);
    expect_available(64, UINT64_MAX, false);
}

static void test_lengths(void) {
    static const unsigned right[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    size_t count = 0;
    for (unsigned bytes = 0; bytes < 300; bytes++) {
        bool wanted = count < sizeof right / sizeof right[0] && right[count] == bytes;
        TEST_ASSERT_EQUAL(wanted, tl_can_is_length(bytes));
        count += wanted ? 1 : 0;
    }
}

/* Decodes to the value, and encodes to the same bits. */
static void expect_value(const tl_can_channel *channel, uint64_t bits, double value) {
    double decoded = 0;
    setUp();
    tl_can_write_bits(&channel->field, bits, data);
    TEST_ASSERT_TRUE(tl_can_decode(channel, data, &decoded));
    TEST_ASSERT_EQUAL_MEMORY(&value, &decoded, sizeof value);
    setUp();
    tl_can_encode(channel, value, data);
    TEST_ASSERT_EQUAL_HEX64(bits, tl_can_read_bits(&channel->field, data));
}

static void test_types(void) {
    for (int order = TL_CAN_INTEL; order <= TL_CAN_MOTOROLA; order++) {
        uint16_t start = order == TL_CAN_INTEL ? 0 : 7;
        tl_can_channel channel = channel_of((tl_can_order)order, start, 12, TL_CAN_UNSIGNED);
        expect_value(&channel, 0xFFF, 4095);
        channel.type = TL_CAN_SIGNED;
        expect_value(&channel, 0xFFF, -1);
        expect_value(&channel, 0x800, -2048);
        expect_value(&channel, 0x7FF, 2047);
        channel = channel_of((tl_can_order)order, start, 1, TL_CAN_SIGNED);
        expect_value(&channel, 1, -1);
        channel = channel_of((tl_can_order)order, start, 64, TL_CAN_SIGNED);
        expect_value(&channel, (uint64_t)1 << 63, -9223372036854775808.0);
        channel = channel_of((tl_can_order)order, start, 32, TL_CAN_FLOAT32);
        expect_value(&channel, 0xBE200000, -0.15625);
        channel = channel_of((tl_can_order)order, start, 64, TL_CAN_FLOAT64);
        expect_value(&channel, 0x3FB999999999999A, 0.1);
    }
}

static void test_scale_and_offset(void) {
    tl_can_channel channel = channel_of(TL_CAN_INTEL, 0, 8, TL_CAN_UNSIGNED);
    channel.scale = -0.5;
    channel.offset = 40;
    expect_value(&channel, 0, 40);
    expect_value(&channel, 255, -87.5);
}

static void test_what_is_not_finite(void) {
    tl_can_channel channel = channel_of(TL_CAN_INTEL, 0, 32, TL_CAN_FLOAT32);
    double value = 1;
    tl_can_write_bits(&channel.field, 0x7FC00000, data);
    TEST_ASSERT_FALSE(tl_can_decode(&channel, data, &value));
    TEST_ASSERT_EQUAL_DOUBLE(0, value);
    tl_can_write_bits(&channel.field, 0xFF800000, data);
    TEST_ASSERT_FALSE(tl_can_decode(&channel, data, &value));
    tl_can_write_bits(&channel.field, 0x7F7FFFFF, data);
    TEST_ASSERT_TRUE(tl_can_decode(&channel, data, &value));
    channel.scale = DBL_MAX;
    TEST_ASSERT_FALSE(tl_can_decode(&channel, data, &value));
}

static uint64_t encoded(const tl_can_channel *channel, double value) {
    memset(data, 0, sizeof data);
    tl_can_encode(channel, value, data);
    return tl_can_read_bits(&channel->field, data);
}

static void test_saturation(void) {
    tl_can_channel channel = channel_of(TL_CAN_INTEL, 0, 12, TL_CAN_UNSIGNED);
    TEST_ASSERT_EQUAL_HEX64(0xFFF, encoded(&channel, 4095.4));
    TEST_ASSERT_EQUAL_HEX64(0xFFF, encoded(&channel, 4095.5));
    TEST_ASSERT_EQUAL_HEX64(0xFFF, encoded(&channel, HUGE_VAL));
    TEST_ASSERT_EQUAL_HEX64(0, encoded(&channel, -3));
    TEST_ASSERT_EQUAL_HEX64(0, encoded(&channel, (double)NAN));
    channel.type = TL_CAN_SIGNED;
    TEST_ASSERT_EQUAL_HEX64(0x7FF, encoded(&channel, 2048));
    TEST_ASSERT_EQUAL_HEX64(0x800, encoded(&channel, -1e300));
    TEST_ASSERT_EQUAL_HEX64(0, encoded(&channel, (double)NAN));
    channel = channel_of(TL_CAN_INTEL, 0, 64, TL_CAN_UNSIGNED);
    TEST_ASSERT_EQUAL_HEX64(UINT64_MAX, encoded(&channel, 18446744073709551616.0));
    TEST_ASSERT_EQUAL_HEX64(0xFFFFFFFFFFFFF800, encoded(&channel, 18446744073709549568.0));
    channel.type = TL_CAN_SIGNED;
    TEST_ASSERT_EQUAL_HEX64(INT64_MAX, encoded(&channel, 9223372036854775808.0));
    TEST_ASSERT_EQUAL_HEX64((uint64_t)1 << 63, encoded(&channel, -HUGE_VAL));
    channel = channel_of(TL_CAN_INTEL, 0, 32, TL_CAN_FLOAT32);
    TEST_ASSERT_EQUAL_HEX64(0x7F7FFFFF, encoded(&channel, 1e300));
    TEST_ASSERT_EQUAL_HEX64(0x7F800000, encoded(&channel, HUGE_VAL));
}

static void test_multiplexors(void) {
    tl_can_channel channel = channel_of(TL_CAN_INTEL, 16, 8, TL_CAN_UNSIGNED);
    TEST_ASSERT_TRUE(tl_can_is_present(&channel, data));
    channel.conditions[0] = (tl_can_condition){.field = {4, 4, TL_CAN_INTEL}, .values = {7, 9, 0}, .value_count = 2};
    channel.conditions[1] = (tl_can_condition){.field = {15, 8, TL_CAN_MOTOROLA}, .values = {200}, .value_count = 1};
    channel.condition_count = 2;
    TEST_ASSERT_FALSE(tl_can_is_present(&channel, data)); /* the 0 is not among the first `value_count` values */
    data[0] = 0x93;
    TEST_ASSERT_FALSE(tl_can_is_present(&channel, data));
    data[1] = 200;
    TEST_ASSERT_TRUE(tl_can_is_present(&channel, data));
    data[0] = 0x73;
    TEST_ASSERT_TRUE(tl_can_is_present(&channel, data));
    data[0] = 0x37;
    TEST_ASSERT_FALSE(tl_can_is_present(&channel, data));
    tl_can_encode(&channel, 5, data);
    const uint8_t wanted[] = {0x77, 200, 5, 0};
    TEST_ASSERT_EQUAL_HEX8_ARRAY(wanted, data, 4);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_places);
    RUN_TEST(test_bytes_needed);
    RUN_TEST(test_bytes_needed_with_multiplexors);
    RUN_TEST(test_ranges_of_multiplexors);
    RUN_TEST(test_values_that_are_not_available);
    RUN_TEST(test_lengths);
    RUN_TEST(test_types);
    RUN_TEST(test_scale_and_offset);
    RUN_TEST(test_what_is_not_finite);
    RUN_TEST(test_saturation);
    RUN_TEST(test_multiplexors);
    return UNITY_END();
}
