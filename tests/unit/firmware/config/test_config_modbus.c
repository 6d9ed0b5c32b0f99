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
        {"\"bcd16\"", "\"bcd64\"", "plant.tariff.modbus.type", "\"bcd64\"|\"bcd16\"|\"bcd32\"|\"uint8\"|\"bit\"", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_types_and_parts);
    RUN_TEST(test_problems_of_signals);
    return UNITY_END();
}
