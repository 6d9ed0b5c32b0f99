/* `sources.NAME.modbus_tcp` and `plant.NAME.modbus` of devices that differ from the standard: the
 * values read from a configuration, and the problem for each wrong value. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "board/modbus/modbus.h"
#include "tests/support/config_text.h"

#define METER TL_SOURCE_DIR "/tests/support/configuration_modbus.json"

static char *text;
static tl_test_verdict verdict;

void setUp(void) {
    verdict = (tl_test_verdict){.count = 0};
    text = tl_test_read_text(METER);
    TEST_ASSERT_NOT_NULL(text);
}

void tearDown(void) {
    tl_config_free(&verdict.config);
    free(text);
}

static const tl_config *read_good(void) {
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].text);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    return &verdict.config;
}

static void test_types_and_parts(void) {
    static const struct {
        tl_modbus_type type;
        uint8_t bit;
    } EXPECTED[] = {
        {TL_MODBUS_UINT64, 0},        {TL_MODBUS_INT64, 0}, {TL_MODBUS_BCD16, 0}, {TL_MODBUS_BCD32, 0},
        {TL_MODBUS_REGISTER_BIT, 15}, {TL_MODBUS_UINT8, 8}, {TL_MODBUS_INT8, 0},
    };
    const tl_config *config = read_good();
    for (size_t i = 0; i < sizeof EXPECTED / sizeof EXPECTED[0]; i++) {
        const tl_modbus_channel *channel = config->signals[i].channel;
        TEST_ASSERT_EQUAL_INT(EXPECTED[i].type, channel->type);
        TEST_ASSERT_EQUAL_UINT8(EXPECTED[i].bit, channel->bit);
    }
}

static void expect_codes(size_t signal, const double *codes, size_t count) {
    const tl_modbus_channel *channel = verdict.config.signals[signal].channel;
    TEST_ASSERT_EQUAL_size_t(count, channel->code_count);
    TEST_ASSERT_EQUAL_MEMORY_ARRAY(codes, channel->codes, sizeof codes[0], count);
}

/* As numbers of the type: a signed one may be written as the content of its registers. */
static void test_values_that_are_not_available(void) {
    static const double WIDE[] = {-9223372036854775808.0, -1};
    static const double DIGITS[] = {9999};
    static const double BYTE[] = {-128};
    static const double WORD[] = {-32768, -1, 5, -6};
    static const double FLOAT[] = {-9999.900390625};
    (void)read_good();
    expect_codes(1, WIDE, 2);
    expect_codes(2, DIGITS, 1);
    expect_codes(6, BYTE, 1);
    expect_codes(7, WORD, 4);
    expect_codes(8, FLOAT, 1);
    const tl_modbus_channel *other = verdict.config.signals[0].channel;
    TEST_ASSERT_EQUAL_size_t(0, other->code_count);
}

static void test_problems_of_signals(void) {
    static const tl_test_change changes[] = {
        {"65532", "65533", "plant.energy.modbus.address", "65533|65532|4 registers", NULL},
        {", \"bit\": 15", "", "plant.alarm.modbus.bit", "0|15", NULL},
        {"\"bit\": 15", "\"bit\": 16", "plant.alarm.modbus.bit", "16|0|15", NULL},
        {"\"bit\": 15", "\"bit\": 1.5", "plant.alarm.modbus.bit", "1.5|whole number", NULL},
        {"\"bit\": 15", "\"bit\": 15, \"byte\": \"low\"", "plant.alarm.modbus.byte", "unknown|\"byte\"", NULL},
        {"\"byte\": \"high\"", "\"byte\": 1", "plant.phase.modbus.byte", "1|\"low\"|\"high\"", NULL},
        {"\"byte\": \"high\"", "\"bit\": 1", "plant.phase.modbus.bit", "unknown|\"bit\"", NULL},
        {"\"bcd16\"", "\"bcd16\", \"bit\": 1", "plant.tariff.modbus.bit", "unknown|\"bit\"", NULL},
        {"\"bcd32\"", "\"bcd64\"", "plant.number.modbus.type", "\"bcd64\"|\"bcd16\"|\"bcd32\"|\"uint8\"|\"bit\"", NULL},
        {"[32768, 65535, 5, -6]", "32768", "plant.power.modbus.not_available", "32768|array|4|-32768|65535", NULL},
        {"[32768, 65535, 5, -6]", "[]", "plant.power.modbus.not_available", "array|1|4", NULL},
        {"[32768, 65535, 5, -6]", "[1, 2, 3, 4, 5]", "plant.power.modbus.not_available", "array of 5|1|4", NULL},
        {"[32768, 65535, 5, -6]", "[1, 65536]", "plant.power.modbus.not_available", "-32768|65535", NULL},
        {"[32768, 65535, 5, -6]", "[-32769]", "plant.power.modbus.not_available", "-32768|65535", NULL},
        {"[32768, 65535, 5, -6]", "[1.5]", "plant.power.modbus.not_available", "whole numbers", NULL},
        {"[32768, 65535, 5, -6]", "[true]", "plant.power.modbus.not_available", "whole numbers", NULL},
        {"[9999]", "[10000]", "plant.tariff.modbus.not_available", "0|9999", NULL},
        {"[128]", "[256]", "plant.trim.modbus.not_available", "-128|255", NULL},
        {"[9223372036854775808, -1]", "[1e19]", "plant.balance.modbus.not_available", "9.22337203685478e+18", NULL},
        {"[-9999.9]", "[1e39]", "plant.flow.modbus.not_available", "3.40282346638529e+38", NULL},
        {"\"bit\": 15", "\"bit\": 15, \"not_available\": [1]", "plant.alarm.modbus.not_available",
         "unknown|\"not_available\"", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_types_and_parts);
    RUN_TEST(test_values_that_are_not_available);
    RUN_TEST(test_problems_of_signals);
    return UNITY_END();
}
