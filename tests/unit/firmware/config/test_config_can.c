/* `sources.NAME.can` and `plant.NAME.can`: the values read from a configuration, and the problem
 * for each wrong value. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "board/can/can.h"
#include "firmware/config/drivers.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"

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
    TEST_ASSERT_EQUAL_UINT16(64, can->field.length); /* from the type */
}

static void test_pgns(void) {
    const tl_config *read = read_good();
    const tl_can_channel *can = read->signals[5].channel;
    TEST_ASSERT_EQUAL_INT(TL_CAN_BY_PGN_AND_SOURCE, can->match);
    TEST_ASSERT_EQUAL_HEX32(0x18F00417, can->id);
    TEST_ASSERT_TRUE(can->extended && can->not_available);
    can = read->signals[6].channel;
    TEST_ASSERT_EQUAL_INT(TL_CAN_BY_PGN, can->match);
    TEST_ASSERT_EQUAL_HEX32(0x18EAFF00, can->id);
    TEST_ASSERT_TRUE(can->extended);
    TEST_ASSERT_FALSE(can->not_available);
    can = read->signals[0].channel;
    TEST_ASSERT_EQUAL_INT(TL_CAN_BY_ID, can->match);
}

static void test_wrong_pgns(void) {
    static const tl_test_change changes[] = {
        {"\"pgn\": 61444", "\"pgn\": 262144", "plant.engine.can.pgn", "262144|0|262143", NULL},
        {"\"pgn\": 61444", "\"pgn\": \"0xF004\"", "plant.engine.can.pgn", "0xF004|whole", NULL},
        {"\"pgn\": 59904", "\"pgn\": 59905", "plant.to_all.can.pgn", "59905|256|0xF000", NULL},
        {"\"pgn\": 61444", "\"pgn\": 61444, \"id\": 1", "plant.engine.can.id", "1|id or pgn", NULL},
        {"\"pgn\": 61444", "\"pgn\": 61444, \"extended\": false", "plant.engine.can.extended", "false|true|29", NULL},
        {"\"source_address\": 23", "\"source_address\": 256", "plant.engine.can.source_address", "256|255", NULL},
        {"\"pgn\": 61444", "\"id\": 1", "plant.engine.can.source_address", "unknown|source_address", NULL},
        {"\"not_available\": true", "\"not_available\": 1", "plant.engine.can.not_available", "1|true|false", NULL},
        {"\"start\": 24, \"length\": 12", "\"start\": 24, \"length\": 1", "plant.engine.can.not_available",
         "true|false|2 bits", NULL},
        {"\"not_available\": true", "\"not_available\": true, \"type\": \"signed\"", "plant.engine.can.not_available",
         "true|false|unsigned", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

static void test_multiplexors(void) {
    const tl_can_channel *can = read_good()->signals[3].channel;
    TEST_ASSERT_EQUAL_size_t(2, can->condition_count);
    TEST_ASSERT_EQUAL_UINT16(4, can->conditions[0].field.start);
    TEST_ASSERT_EQUAL_INT(TL_CAN_INTEL, can->conditions[0].field.order);
    TEST_ASSERT_EQUAL_size_t(3, can->conditions[0].value_count);
    TEST_ASSERT_EQUAL_UINT32(1, can->conditions[0].values[0]);
    TEST_ASSERT_EQUAL_UINT32(0, can->conditions[0].further[1]);
    TEST_ASSERT_EQUAL_UINT32(12, can->conditions[0].values[2]);
    TEST_ASSERT_EQUAL_UINT32(3, can->conditions[0].further[2]);
    TEST_ASSERT_EQUAL_INT(TL_CAN_MOTOROLA, can->conditions[1].field.order);
    TEST_ASSERT_EQUAL_size_t(1, can->conditions[1].value_count);
    TEST_ASSERT_EQUAL_UINT32(7, can->conditions[1].values[0]);
}

#define INTERFACE "|15|interface|\"can0\""

static void test_wrong_sources(void) {
    static const tl_test_change changes[] = {
        {"{ \"interface\": \"can0\" }", "{}", "sources.bus.can.interface", "\"can0\"", NULL},
        {"\"can0\"", "0", "sources.bus.can.interface", "0|\"can0\"", NULL},
        {"\"can0\"", "\"\"", "sources.bus.can.interface", "\"\"|empty", NULL},
        {"\"can0\"", "\"a/b\"", "sources.bus.can.interface", "\"a/b\"" INTERFACE, NULL},
        {"\"can0\"", "\"..\"", "sources.bus.can.interface", "\"..\"" INTERFACE, NULL},
        {"\"can0\"", "\"sixteen-are-more\"", "sources.bus.can.interface", "\"sixteen-are-more\"" INTERFACE, NULL},
        {"{ \"interface\": \"can0\" }", "{ \"interface\": \"can0\", \"bitrate\": 500000 }", "sources.bus.can.bitrate",
         "unknown|\"bitrate\"|interface", NULL},
        {"{ \"can\": { \"interface\": \"vcan0\" } }",
         "{ \"can\": { \"interface\": \"vcan0\" }, \"csv\": { \"file\": \"x\" } }", "sources.other",
         "csv and can|csv|modbus_tcp|modbus_rtu|can|gpio", NULL},
        {"\"source\": \"other\"", "\"source\": \"stream\"", "plant.wide.can.source", "\"stream\"|can|bus|other", NULL},
        {"\"source\": \"other\", ", "", "plant.wide.can.source", "\"plc\"", "\"wide\""},
        {"\"csv\": { \"column\": \"omega\", \"source\": \"stream\" }",
         "\"csv\": { \"source\": \"stream\" }, \"can\": { \"source\": \"bus\", \"id\": 1, \"start\": 0, \"length\": 1 }",
         "plant.rows.can", "can|live source", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

#define ID "0|0x1FFFFFFF|hexadecimal"
#define BYTES "|1|8|12|16|20|24|32|48|64"

static void test_wrong_frames(void) {
    static const tl_test_change changes[] = {
        {"\"id\": 291, ", "", "plant.torque.can.id", ID, "\"torque\""},
        {"\"id\": 291", "\"id\": -1", "plant.torque.can.id", "-1|" ID, NULL},
        {"\"id\": 291", "\"id\": 1.5", "plant.torque.can.id", "1.5|" ID, NULL},
        {"\"id\": 291", "\"id\": 536870912", "plant.torque.can.id", "536870912|" ID, NULL},
        {"\"id\": 291", "\"id\": \"0x20000000\"", "plant.torque.can.id", "\"0x20000000\"|" ID, NULL},
        {"\"id\": 291", "\"id\": \"123\"", "plant.torque.can.id", "\"123\"|" ID, NULL},
        {"\"id\": 291", "\"id\": \"0x\"", "plant.torque.can.id", "\"0x\"|" ID, NULL},
        {"\"id\": 291", "\"id\": \"0x12g\"", "plant.torque.can.id", "\"0x12g\"|" ID, NULL},
        {"\"id\": 291", "\"id\": true", "plant.torque.can.id", "true|" ID, NULL},
        {"\"id\": 512", "\"id\": 2048, \"extended\": false", "plant.page.can.extended", "false|true|11 bits", NULL},
        {"\"extended\": true", "\"extended\": 1", "plant.torque.can.extended", "1|true|false", NULL},
        {"\"bytes\": 64", "\"bytes\": 63", "plant.wide.can.bytes", "63" BYTES, NULL},
        {"\"bytes\": 64", "\"bytes\": 65", "plant.wide.can.bytes", "65" BYTES, NULL},
        {"\"bytes\": 64", "\"bytes\": \"64\"", "plant.wide.can.bytes", "\"64\"" BYTES, NULL},
        {"\"fd\": true", "\"fd\": false", "plant.wide.can.fd", "false|true|8 bytes", NULL},
        {"\"fd\": true", "\"fds\": true", "plant.wide.can.fds",
         "unknown|\"fds\"|source|id|extended|bytes|fd|type|start|length|order|scale|offset|multiplex", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

static void test_wrong_bits(void) {
    static const tl_test_change changes[] = {
        {"\"start\": 32, ", "", "plant.torque.can.start", "0|511", "\"torque\""},
        {"\"start\": 32", "\"start\": 512", "plant.torque.can.start", "512|0|511", NULL},
        {"\"start\": 32", "\"start\": 33", "plant.torque.can.start", "33|32 bits|intel|8 bytes|9", NULL},
        {"\"start\": 7, \"length\": 16", "\"start\": 62, \"length\": 16", "plant.speed.can.start",
         "62|16 bits|motorola|8 bytes|10", NULL},
        {"\"length\": 16", "\"length\": 0", "plant.speed.can.length", "0|1|64", NULL},
        {"\"length\": 16", "\"length\": 65", "plant.speed.can.length", "65|1|64", NULL},
        {"\"length\": 16, ", "", "plant.speed.can.length", "1|64", "\"id\": \"0x18FEF100\""},
        {"\"length\": 32", "\"length\": 16", "plant.torque.can.length", "16|32|type", NULL},
        {"\"type\": \"float64\"", "\"type\": \"float64\", \"length\": 32", "plant.wide.can.length", "32|64|type", NULL},
        {"\"order\": \"intel\"", "\"order\": \"big\"", "plant.page.can.order", "\"big\"|\"intel\"|\"motorola\"", NULL},
        {"\"scale\": 0.125", "\"scale\": 0", "plant.speed.can.scale", "0|other than 0", NULL},
        {"\"offset\": -40", "\"offset\": \"-40\"", "plant.speed.can.offset", "\"-40\"|number", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

/* An unknown type. The length depends on the type, so the length is not reported. */
static void test_wrong_type(void) {
    char *changed = tl_test_replaced(text, "\"type\": \"float64\"", "\"type\": \"float16\", \"length\": 16");
    TEST_ASSERT_NOT_NULL(changed);
    tl_test_judge_text(changed, strlen(changed), &verdict);
    free(changed);
    TEST_ASSERT_EQUAL_size_t(1, verdict.count);
    TEST_ASSERT_EQUAL_STRING("plant.wide.can.type", verdict.problems[0].where);
    TL_EXPECT_PARTS("\"float16\"|\"unsigned\"|\"signed\"|\"float32\"|\"float64\"", verdict.problems[0].text);
}

#define VALUE "0|15|1|16|array"

static void test_wrong_multiplexors(void) {
    static const tl_test_change changes[] = {
        {"\"value\": 7", "\"value\": 16", "plant.page.can.multiplex.multiplex.value", "16|" VALUE, NULL},
        {"\"value\": 7", "\"value\": -1", "plant.page.can.multiplex.multiplex.value", "-1|" VALUE, NULL},
        {"\"12-15\"", "\"12-16\"", "plant.page.can.multiplex.value", "array|3|" VALUE, NULL},
        {"\"12-15\"", "\"15-12\"", "plant.page.can.multiplex.value", "array|3|" VALUE, NULL},
        {"\"12-15\"", "\"12-\"", "plant.page.can.multiplex.value", "array|3|" VALUE, NULL},
        {"\"12-15\"", "\"12-15x\"", "plant.page.can.multiplex.value", "array|3|" VALUE, NULL},
        {"\"value\": 7", "\"value\": \"7\"", "plant.page.can.multiplex.multiplex.value", "\"7\"|" VALUE, NULL},
        {"\"value\": 7", "\"value\": []", "plant.page.can.multiplex.multiplex.value", "array|0|" VALUE, NULL},
        {"\"value\": 7", "\"value\": [1, 16]", "plant.page.can.multiplex.multiplex.value", "array|2|" VALUE, NULL},
        {"\"value\": 7", "\"value\": [1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]", "plant.page.can.multiplex.multiplex.value",
         "array|17|" VALUE, NULL},
        {", \"value\": 7", "", "plant.page.can.multiplex.multiplex.value", VALUE, NULL},
        {"\"multiplex\": { \"start\": 3, \"length\": 4,", "\"multiplex\": { \"start\": 3, \"length\": 33,",
         "plant.page.can.multiplex.multiplex.length", "33|1|32", NULL},
        {"\"multiplex\": { \"start\": 3, \"length\": 4, \"order\": \"motorola\", \"value\": 7 }", "\"multiplex\": 7",
         "plant.page.can.multiplex.multiplex", "7|object", NULL},
        {"\"start\": 3, \"length\": 4", "\"start\": 41, \"length\": 4", "plant.page.can.multiplex.multiplex.start",
         "41|4 bits|motorola|6 bytes|7", NULL},
        {"\"value\": 7", "\"value\": 7, \"values\": 7", "plant.page.can.multiplex.multiplex.values",
         "unknown|\"values\"|\"value\"", NULL},
        {"\"value\": 7",
         "\"value\": 7, \"multiplex\": { \"start\": 0, \"length\": 1, \"value\": 1, \"multiplex\": { \"start\": 0, \"length\": 1, \"value\": 1, \"multiplex\": {} } }",
         "plant.page.can.multiplex.multiplex.multiplex.multiplex.multiplex", "object|0|4", NULL},
    };
    tl_test_expect_problems(text, changes, sizeof changes / sizeof changes[0]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_sources);
    RUN_TEST(test_channels);
    RUN_TEST(test_pgns);
    RUN_TEST(test_wrong_pgns);
    RUN_TEST(test_multiplexors);
    RUN_TEST(test_wrong_sources);
    RUN_TEST(test_wrong_frames);
    RUN_TEST(test_wrong_bits);
    RUN_TEST(test_wrong_type);
    RUN_TEST(test_wrong_multiplexors);
    return UNITY_END();
}
