/* The CAN driver without a bus: wrong settings, a missing interface, interrupts.
 * tests/hil/box/test_live_can.py tests it with a bus.
 */
#include <math.h>

#include <unity.h>

#include "board/can/can.h"
#include "master/base/simtime.h"
#include "tests/support/driver_probe.h"
#include "tests/support/message.h"
#include "tests/support/real_time.h"

#define NOWHERE "tl-none0" /* no interface has that name */

static tl_can_channel channels[2];
static tl_driver_probe probe;

void setUp(void) {
    for (size_t i = 0; i < 2; i++) {
        channels[i] = (tl_can_channel){.id = 0x100, .bytes = 8, .field = {.start = 0, .length = 8}, .scale = 1};
    }
    tl_probe_begin(&probe, &tl_can_driver);
}

void tearDown(void) {
    tl_probe_end(&probe);
}

static tl_status open_at(const char *interface) {
    const tl_can_settings settings = {.interface = interface, .channels = channels, .channel_count = 2};
    return tl_can_open(&settings, &probe.io, &probe.error);
}

static void expect_refused(const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_at(NOWHERE));
    TL_EXPECT_PARTS(parts, probe.error.text);
    setUp();
}

static void test_wrong_channels(void) {
    channels[1].id = 0x800;
    expect_refused("channel 1|0x800|11");
    channels[1].id = 0x20000000;
    channels[1].extended = true;
    expect_refused("channel 1|0x20000000|29");
    channels[1].bytes = 9;
    expect_refused("channel 1|bytes|9");
    channels[1].field.start = 57;
    expect_refused("channel 1|8 bits|57");
    channels[1].field.length = 0;
    expect_refused("channel 1|0 bits");
    channels[1].bytes = 64;
    channels[1].field.length = 65;
    expect_refused("channel 1|65 bits|0");
    channels[1].type = TL_CAN_FLOAT32;
    expect_refused("channel 1|8 bits|0");
    channels[1].field.length = 32;
    channels[1].type = TL_CAN_FLOAT64;
    expect_refused("channel 1|32 bits|0");
    channels[1].scale = 0;
    expect_refused("channel 1|scale|0|offset");
    channels[1].offset = (double)NAN;
    expect_refused("channel 1|scale|1|offset|nan");
}

static void test_wrong_multiplexors(void) {
    channels[0].condition_count = TL_CAN_CONDITIONS + 1;
    expect_refused("channel 0|multiplexor");
    channels[0].condition_count = 1;
    channels[0].conditions[0] = (tl_can_condition){.field = {0, 8, TL_CAN_INTEL}, .value_count = 0};
    expect_refused("channel 0|multiplexor");
    channels[0].condition_count = 1;
    channels[0].conditions[0] = (tl_can_condition){.field = {0, 33, TL_CAN_INTEL}, .value_count = 1};
    expect_refused("channel 0|multiplexor");
    channels[0].condition_count = 1;
    channels[0].conditions[0] = (tl_can_condition){.field = {60, 8, TL_CAN_INTEL}, .value_count = 1};
    expect_refused("channel 0|multiplexor");
}

static void test_wrong_interfaces(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_at(""));
    TL_EXPECT_PARTS("CAN|1|15", probe.error.text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_at("a-name-of-16-chr"));
    TL_EXPECT_PARTS("a-name-of-16-chr|1|15", probe.error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, open_at("a-name-of-15-ch"));
}

/* The driver reports it once, with the remedy, posts no values, and does not spin. */
static void test_no_interface(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, open_at(NOWHERE));
    tl_time begun = tl_test_now();
    for (size_t i = 1; i <= 10; i++) {
        tl_probe_poll(&probe);
        TEST_ASSERT_EQUAL_size_t(i, probe.posts[0]);
        TEST_ASSERT_EQUAL_size_t(i, probe.posts[1]);
        TEST_ASSERT_EQUAL_INT(TL_NO_LINK, probe.newest[1].quality);
    }
    TEST_ASSERT_TRUE(tl_test_now() - begun >= TL_SECOND / 4);
    TEST_ASSERT_EQUAL_size_t(1, probe.links);
    tl_probe_expect_link(&probe, false, NOWHERE);
    TEST_ASSERT_TRUE_MESSAGE(tl_test_has_parts(probe.link_text, "ip link") ||
                                 tl_test_has_parts(probe.link_text, "modprobe can-raw"),
                             probe.link_text);
}

static void test_interrupt_is_not_lost(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, open_at(NOWHERE));
    tl_time shortest = TL_SECOND;
    for (int i = 0; i < 20; i++) { /* on a busy machine at least one of them is quick */
        tl_can_driver.interrupt(probe.io);
        tl_time begun = tl_test_now();
        tl_probe_poll(&probe);
        shortest = tl_test_now() - begun < shortest ? tl_test_now() - begun : shortest;
    }
    TEST_ASSERT_TRUE(shortest < TL_SECOND / 50);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_wrong_channels);
    RUN_TEST(test_wrong_multiplexors);
    RUN_TEST(test_wrong_interfaces);
    RUN_TEST(test_no_interface);
    RUN_TEST(test_interrupt_is_not_lost);
    return UNITY_END();
}
