/* The CAN driver without a bus: settings that are wrong, an interface that is not there, interruption. With one it is
 * tested in tests/hil/box/test_live_can.py.
 */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "board/can/can.h"
#include "master/base/simtime.h"
#include "tests/support/driver_probe.h"
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

static void expect_refused(const char *words) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_at(NOWHERE));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(probe.error.text, words), probe.error.text);
    setUp();
}

static void test_wrong_channels(void) {
    channels[1].id = 0x800;
    expect_refused("channel 1: id 0x800 has more than 11 bits");
    channels[1].id = 0x20000000;
    channels[1].extended = true;
    expect_refused("has more than 29 bits");
    channels[1].bytes = 9;
    expect_refused("no frame has 9 bytes");
    channels[1].field.start = 57;
    expect_refused("8 bits from 57 on do not fit");
    channels[1].field.length = 0;
    expect_refused("0 bits from 0 on do not fit");
    channels[1].bytes = 64;
    channels[1].field.length = 65;
    expect_refused("65 bits from 0 on do not fit");
    channels[1].type = TL_CAN_FLOAT32;
    expect_refused("8 bits from 0 on do not fit");
    channels[1].field.length = 32;
    channels[1].type = TL_CAN_FLOAT64;
    expect_refused("32 bits from 0 on do not fit");
    channels[1].scale = 0;
    expect_refused("scale 0, offset 0 must be finite");
    channels[1].offset = (double)NAN;
    expect_refused("must be finite");
}

static void test_wrong_multiplexors(void) {
    channels[0].condition_count = TL_CAN_CONDITIONS + 1;
    expect_refused("channel 0: a multiplexor does not fit");
    channels[0].condition_count = 1;
    channels[0].conditions[0] = (tl_can_condition){.field = {0, 8, TL_CAN_INTEL}, .value_count = 0};
    expect_refused("a multiplexor does not fit");
    channels[0].condition_count = 1;
    channels[0].conditions[0] = (tl_can_condition){.field = {0, 33, TL_CAN_INTEL}, .value_count = 1};
    expect_refused("a multiplexor does not fit");
    channels[0].condition_count = 1;
    channels[0].conditions[0] = (tl_can_condition){.field = {60, 8, TL_CAN_INTEL}, .value_count = 1};
    expect_refused("a multiplexor does not fit");
}

static void test_wrong_interfaces(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_at(""));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, open_at("a-name-of-16-chr"));
    TEST_ASSERT_NOT_NULL(strstr(probe.error.text, "a name has 1 to 15 characters"));
    TEST_ASSERT_EQUAL_INT(TL_OK, open_at("a-name-of-15-ch"));
}

/* It says so once, what to do too, has no value for anybody, and does not spin. */
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
    tl_probe_expect_link(&probe, false, "CAN interface " NOWHERE ": ");
    TEST_ASSERT_TRUE(strstr(probe.link_text, "there is none of that name") != NULL ||
                     strstr(probe.link_text, "this kernel has no CAN") != NULL);
}

static void test_interrupt_is_not_lost(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, open_at(NOWHERE));
    tl_time shortest = TL_SECOND;
    for (int i = 0; i < 20; i++) { /* on a busy machine one of them is quick */
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
