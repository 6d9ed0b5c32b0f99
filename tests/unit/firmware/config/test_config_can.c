/* `sources.NAME.can` and `plant.NAME.can`: what a configuration says, and the words for each way to say it wrong. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "board/can/can.h"
#include "firmware/config/drivers.h"
#include "tests/support/config_text.h"

#define BUS TL_SOURCE_DIR "/tests/support/configuration_can.json"

static char *text;
static tl_test_verdict verdict;

void setUp(void) {
    verdict = (tl_test_verdict){.count = 0};
    text = tl_test_read_text(BUS);
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

static const char *interface_of(const tl_config_source *source) {
    const tl_can_settings *settings = source->settings;
    return settings->interface;
}

static void test_sources(void) {
    const tl_config *config = read_good();
    TEST_ASSERT_EQUAL_STRING("can", config->sources[0].driver->name);
    TEST_ASSERT_EQUAL_STRING("can0", interface_of(&config->sources[0]));
    TEST_ASSERT_EQUAL_STRING("vcan0", interface_of(&config->sources[1]));
    TEST_ASSERT_TRUE(config->sources[0].period_s > 0);
    TEST_ASSERT_EQUAL_size_t(0, config->signals[0].source);
    TEST_ASSERT_EQUAL_size_t(1, config->signals[2].source);
    TEST_ASSERT_EQUAL_size_t(2, config->signals[4].source);
}

static void test_channels(void) {
    const tl_config *config = read_good();
    const tl_can_channel *can = config->signals[0].channel;
    TEST_ASSERT_EQUAL_HEX32(0x18FEF100, can->id);
    TEST_ASSERT_TRUE(can->extended);
    TEST_ASSERT_FALSE(can->fd);
    TEST_ASSERT_EQUAL_UINT8(8, can->bytes);
    TEST_ASSERT_EQUAL_UINT16(7, can->field.start);
    TEST_ASSERT_EQUAL_UINT16(16, can->field.length);
    TEST_ASSERT_EQUAL_INT(TL_CAN_MOTOROLA, can->field.order);
    TEST_ASSERT_EQUAL_INT(TL_CAN_SIGNED, can->type);
    TEST_ASSERT_EQUAL_DOUBLE(0.125, can->scale);
    TEST_ASSERT_EQUAL_DOUBLE(-40, can->offset);
    TEST_ASSERT_EQUAL_size_t(0, can->condition_count);
    can = config->signals[1].channel;
    TEST_ASSERT_EQUAL_HEX32(291, can->id);
    TEST_ASSERT_TRUE(can->extended);
    TEST_ASSERT_EQUAL_INT(TL_CAN_FLOAT32, can->type);
    TEST_ASSERT_EQUAL_DOUBLE(1, can->scale);
    TEST_ASSERT_EQUAL_INT(TL_CAN_INTEL, can->field.order);
    can = config->signals[2].channel;
    TEST_ASSERT_EQUAL_HEX32(0x7FF, can->id);
    TEST_ASSERT_FALSE(can->extended);
    TEST_ASSERT_TRUE(can->fd);
    TEST_ASSERT_EQUAL_UINT8(64, can->bytes);
    TEST_ASSERT_EQUAL_UINT16(64, can->field.length); /* its type's */
}

static void test_multiplexors(void) {
    const tl_can_channel *can = read_good()->signals[3].channel;
    TEST_ASSERT_EQUAL_size_t(2, can->condition_count);
    TEST_ASSERT_EQUAL_UINT16(4, can->conditions[0].field.start);
    TEST_ASSERT_EQUAL_INT(TL_CAN_INTEL, can->conditions[0].field.order);
    TEST_ASSERT_EQUAL_size_t(3, can->conditions[0].value_count);
    TEST_ASSERT_EQUAL_UINT32(1, can->conditions[0].values[0]);
    TEST_ASSERT_EQUAL_UINT32(15, can->conditions[0].values[2]);
    TEST_ASSERT_EQUAL_INT(TL_CAN_MOTOROLA, can->conditions[1].field.order);
    TEST_ASSERT_EQUAL_size_t(1, can->conditions[1].value_count);
    TEST_ASSERT_EQUAL_UINT32(7, can->conditions[1].values[0]);
}

#define INTERFACE                                                                                                      \
    "expected the name of a network interface: at most 15 characters, no space, slash or colon, for example \"can0\""

static void test_wrong_sources(void) {
    static const tl_test_change changes[] = {
        {"{ \"interface\": \"can0\" }", "{}", "sources.bus.can.interface",
         "found nothing, expected a text, for example \"can0\"", NULL},
        {"\"can0\"", "0", "sources.bus.can.interface", "found 0 (number), expected a text, for example \"can0\"", NULL},
        {"\"can0\"", "\"\"", "sources.bus.can.interface",
         "found \"\" (text), expected a text that is not empty, for example \"can0\"", NULL},
        {"\"can0\"", "\"a/b\"", "sources.bus.can.interface", "found \"a/b\" (text), " INTERFACE, NULL},
        {"\"can0\"", "\"..\"", "sources.bus.can.interface", "found \"..\" (text), " INTERFACE, NULL},
        {"\"can0\"", "\"sixteen-are-more\"", "sources.bus.can.interface",
         "found \"sixteen-are-more\" (text), " INTERFACE, NULL},
        {"{ \"interface\": \"can0\" }", "{ \"interface\": \"can0\", \"bitrate\": 500000 }", "sources.bus.can.bitrate",
         "found the unknown key \"bitrate\", expected only interface", NULL},
        {"{ \"can\": { \"interface\": \"vcan0\" } }",
         "{ \"can\": { \"interface\": \"vcan0\" }, \"csv\": { \"file\": \"x\" } }", "sources.other",
         "found csv and can, expected exactly one of csv, modbus_tcp, modbus_rtu, can, gpio, for example {\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}",
         NULL},
        {"\"source\": \"other\"", "\"source\": \"stream\"", "plant.wide.can.source",
         "found \"stream\" (text), expected the name of a can source: one of bus, other", NULL},
        {"\"source\": \"other\", ", "", "plant.wide.can.source", "found nothing, expected a text, for example \"plc\"",
         "\"wide\""},
        {"\"csv\": { \"column\": \"omega\", \"source\": \"stream\" }",
         "\"csv\": { \"source\": \"stream\" }, \"can\": { \"source\": \"bus\", \"id\": 1, \"start\": 0, \"length\": 1 }",
         "plant.rows.can", "found can beside another live source, expected at most one live source", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

#define ID "expected an id from 0 to 0x1FFFFFFF, a whole number or a hexadecimal text, for example \"0x18FEF100\""
#define BYTES "expected a length of a frame: 1 to 8, 12, 16, 20, 24, 32, 48 or 64, for example 8"

static void test_wrong_frames(void) {
    static const tl_test_change changes[] = {
        {"\"id\": 291, ", "", "plant.torque.can.id", "found nothing, " ID, "\"torque\""},
        {"\"id\": 291", "\"id\": -1", "plant.torque.can.id", "found -1 (number), " ID, NULL},
        {"\"id\": 291", "\"id\": 1.5", "plant.torque.can.id", "found 1.5 (number), " ID, NULL},
        {"\"id\": 291", "\"id\": 536870912", "plant.torque.can.id", "found 536870912 (number), " ID, NULL},
        {"\"id\": 291", "\"id\": \"0x20000000\"", "plant.torque.can.id", "found \"0x20000000\" (text), " ID, NULL},
        {"\"id\": 291", "\"id\": \"123\"", "plant.torque.can.id", "found \"123\" (text), " ID, NULL},
        {"\"id\": 291", "\"id\": \"0x\"", "plant.torque.can.id", "found \"0x\" (text), " ID, NULL},
        {"\"id\": 291", "\"id\": \"0x12g\"", "plant.torque.can.id", "found \"0x12g\" (text), " ID, NULL},
        {"\"id\": 291", "\"id\": true", "plant.torque.can.id", "found true, " ID, NULL},
        {"\"id\": 512", "\"id\": 2048, \"extended\": false", "plant.page.can.extended",
         "found false, expected true, because the id has more than 11 bits", NULL},
        {"\"extended\": true", "\"extended\": 1", "plant.torque.can.extended",
         "found 1 (number), expected true or false, for example true", NULL},
        {"\"bytes\": 64", "\"bytes\": 63", "plant.wide.can.bytes", "found 63 (number), " BYTES, NULL},
        {"\"bytes\": 64", "\"bytes\": 65", "plant.wide.can.bytes", "found 65 (number), " BYTES, NULL},
        {"\"bytes\": 64", "\"bytes\": \"64\"", "plant.wide.can.bytes", "found \"64\" (text), " BYTES, NULL},
        {"\"fd\": true", "\"fd\": false", "plant.wide.can.fd",
         "found false, expected true, because a classic frame has at most 8 bytes", NULL},
        {"\"fd\": true", "\"fds\": true", "plant.wide.can.fds",
         "found the unknown key \"fds\", expected one of source, id, extended, bytes, fd, type, start, length, order, scale, offset, multiplex",
         NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

static void test_wrong_bits(void) {
    static const tl_test_change changes[] = {
        {"\"start\": 32, ", "", "plant.torque.can.start",
         "found nothing, expected a whole number from 0 to 511, for example 0", "\"torque\""},
        {"\"start\": 32", "\"start\": 512", "plant.torque.can.start",
         "found 512 (number), expected a whole number from 0 to 511, for example 0", NULL},
        {"\"start\": 32", "\"start\": 33", "plant.torque.can.start",
         "found 33 (number), expected a start from which all 32 bits (intel) are within the frame's 8 bytes, not reaching into byte 9",
         NULL},
        {"\"start\": 7, \"length\": 16", "\"start\": 62, \"length\": 16", "plant.speed.can.start",
         "found 62 (number), expected a start from which all 16 bits (motorola) are within the frame's 8 bytes, not reaching into byte 10",
         NULL},
        {"\"length\": 16", "\"length\": 0", "plant.speed.can.length",
         "found 0 (number), expected a whole number from 1 to 64, for example 16", NULL},
        {"\"length\": 16", "\"length\": 65", "plant.speed.can.length",
         "found 65 (number), expected a whole number from 1 to 64, for example 16", NULL},
        {"\"length\": 16, ", "", "plant.speed.can.length",
         "found nothing, expected a whole number from 1 to 64, for example 16", "\"id\": \"0x18FEF100\""},
        {"\"length\": 32", "\"length\": 16", "plant.torque.can.length",
         "found 16 (number), expected 32, because that is what a number of its type has", NULL},
        {"\"type\": \"float64\"", "\"type\": \"float64\", \"length\": 32", "plant.wide.can.length",
         "found 32 (number), expected 64, because that is what a number of its type has", NULL},
        {"\"order\": \"intel\"", "\"order\": \"big\"", "plant.page.can.order",
         "found \"big\" (text), expected \"intel\" or \"motorola\", for example \"intel\"", NULL},
        {"\"scale\": 0.125", "\"scale\": 0", "plant.speed.can.scale",
         "found 0 (number), expected a number other than 0, for example 0.1", NULL},
        {"\"offset\": -40", "\"offset\": \"-40\"", "plant.speed.can.offset",
         "found \"-40\" (text), expected a number, for example 0.1", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

/* A type that there is not: without it, nobody knows the length either. */
static void test_wrong_type(void) {
    char *changed = tl_test_replaced(text, "\"type\": \"float64\"", "\"type\": \"float16\", \"length\": 16");
    TEST_ASSERT_NOT_NULL(changed);
    tl_test_judge_text(changed, strlen(changed), &verdict);
    free(changed);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_STRING("plant.wide.can.type", verdict.problems[0].where);
    TEST_ASSERT_NOT_NULL(strstr(verdict.problems[0].text,
                                "found \"float16\" (text), expected \"unsigned\", \"signed\", "
                                "\"float32\" or \"float64\""));
}

#define VALUE "expected a whole number from 0 to 15, or an array of 1 to 16 of them, for example 3"

static void test_wrong_multiplexors(void) {
    static const tl_test_change changes[] = {
        {"\"value\": 7", "\"value\": 16", "plant.page.can.multiplex.multiplex.value", "found 16 (number), " VALUE,
         NULL},
        {"\"value\": 7", "\"value\": -1", "plant.page.can.multiplex.multiplex.value", "found -1 (number), " VALUE,
         NULL},
        {"\"value\": 7", "\"value\": []", "plant.page.can.multiplex.multiplex.value", "found an array of 0, " VALUE,
         NULL},
        {"\"value\": 7", "\"value\": [1, 16]", "plant.page.can.multiplex.multiplex.value",
         "found an array of 2, " VALUE, NULL},
        {"\"value\": 7", "\"value\": [1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]", "plant.page.can.multiplex.multiplex.value",
         "found an array of 17, " VALUE, NULL},
        {", \"value\": 7", "", "plant.page.can.multiplex.multiplex.value", "found nothing, " VALUE, NULL},
        {"\"multiplex\": { \"start\": 3, \"length\": 4,", "\"multiplex\": { \"start\": 3, \"length\": 33,",
         "plant.page.can.multiplex.multiplex.length",
         "found 33 (number), expected a whole number from 1 to 32, for example 16", NULL},
        {"\"multiplex\": { \"start\": 3, \"length\": 4, \"order\": \"motorola\", \"value\": 7 }", "\"multiplex\": 7",
         "plant.page.can.multiplex.multiplex",
         "found 7 (number), expected an object, for example {\"start\": 0, \"length\": 4, \"value\": 3}", NULL},
        {"\"start\": 3, \"length\": 4", "\"start\": 41, \"length\": 4", "plant.page.can.multiplex.multiplex.start",
         "found 41 (number), expected a start from which all 4 bits (motorola) are within the frame's 6 bytes, not reaching into byte 7",
         NULL},
        {"\"value\": 7", "\"value\": 7, \"values\": 7", "plant.page.can.multiplex.multiplex.values",
         "found the unknown key \"values\", expected \"value\"", NULL},
        {"\"value\": 7",
         "\"value\": 7, \"multiplex\": { \"start\": 0, \"length\": 1, \"value\": 1, \"multiplex\": { \"start\": 0, \"length\": 1, \"value\": 1, \"multiplex\": {} } }",
         "plant.page.can.multiplex.multiplex.multiplex.multiplex.multiplex",
         "found an object with 0 keys, expected at most 4 multiplexors above each other", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_sources);
    RUN_TEST(test_channels);
    RUN_TEST(test_multiplexors);
    RUN_TEST(test_wrong_sources);
    RUN_TEST(test_wrong_frames);
    RUN_TEST(test_wrong_bits);
    RUN_TEST(test_wrong_type);
    RUN_TEST(test_wrong_multiplexors);
    return UNITY_END();
}
