/* The planned CAN frames of the emulated plant, and a missing interface.
 * tests/hil/box/test_live_can.py tests a real bus. */
#include <string.h>

#include <unity.h>

#include "firmware/cli/plant_bus.h"
#include "tests/support/message.h"

static tl_can_channel channels[8];
static tl_plant_bus_frame frames[8];

void setUp(void) {
    memset(channels, 0, sizeof channels);
    memset(frames, 0, sizeof frames);
    for (size_t i = 0; i < 8; i++) {
        channels[i] = (tl_can_channel){.id = 0x100, .bytes = 8, .field = {.start = 32, .length = 8}, .scale = 1};
    }
}

void tearDown(void) {}

static void multiplex(size_t channel, uint16_t start, uint32_t value) {
    tl_can_channel *one = &channels[channel];
    one->conditions[one->condition_count++] =
        (tl_can_condition){.field = {start, 4, TL_CAN_INTEL}, .values = {value, 15}, .value_count = 2};
}

static void expect_members(const char *wanted, const tl_plant_bus_frame *frame) {
    for (size_t i = 0; wanted[i] != '\0'; i++) {
        TEST_ASSERT_EQUAL_MESSAGE(wanted[i] == '1', frame->members[i], wanted);
    }
}

static void test_one_frame_per_id(void) {
    channels[1].id = 0x200;
    channels[2].extended = true;
    channels[3].bytes = 4;
    channels[4].bytes = 16;
    channels[4].fd = true;
    channels[4].id = 0x200;
    TEST_ASSERT_EQUAL_size_t(3, tl_plant_bus_plan(channels, 5, frames));
    expect_members("10010", &frames[0]);
    expect_members("01001", &frames[1]);
    expect_members("00100", &frames[2]);
    TEST_ASSERT_EQUAL_HEX32(0x100, frames[0].id);
    TEST_ASSERT_EQUAL_UINT8(8, frames[0].bytes);
    TEST_ASSERT_FALSE(frames[0].extended || frames[0].fd);
    TEST_ASSERT_EQUAL_UINT8(16, frames[1].bytes);
    TEST_ASSERT_TRUE(frames[1].fd);
    TEST_ASSERT_TRUE(frames[2].extended);
}

/* An unconditional signal is in each frame of its id, and gets no frame of its own. */
static void test_a_frame_per_state_of_the_multiplexor(void) {
    multiplex(1, 0, 1);
    multiplex(2, 0, 2);
    multiplex(3, 0, 2);
    TEST_ASSERT_EQUAL_size_t(2, tl_plant_bus_plan(channels, 4, frames));
    expect_members("1100", &frames[0]);
    expect_members("1011", &frames[1]);
    TEST_ASSERT_EQUAL_HEX8(1, frames[0].data[0]);
    TEST_ASSERT_EQUAL_HEX8(2, frames[1].data[0]);
}

static void test_multiplexors_above_each_other(void) {
    multiplex(1, 0, 1);
    multiplex(2, 4, 7);
    multiplex(2, 0, 1);
    multiplex(3, 0, 2);
    TEST_ASSERT_EQUAL_size_t(2, tl_plant_bus_plan(channels, 4, frames));
    expect_members("1110", &frames[0]);
    expect_members("1001", &frames[1]);
    TEST_ASSERT_EQUAL_HEX8(0x71, frames[0].data[0]);
}

static void test_no_channels(void) {
    TEST_ASSERT_EQUAL_size_t(0, tl_plant_bus_plan(channels, 0, frames));
}

static void test_no_such_interface(void) {
    const tl_plant_bus_settings settings = {.interface = "tl-none0", .channels = channels, .channel_count = 1};
    tl_plant_bus *bus = NULL;
    tl_error error;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_plant_bus_open(&settings, &bus, &error));
    TL_EXPECT_PARTS("CAN|tl-none0|ip link add tl-none0 type vcan", error.text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_one_frame_per_id);
    RUN_TEST(test_a_frame_per_state_of_the_multiplexor);
    RUN_TEST(test_multiplexors_above_each_other);
    RUN_TEST(test_no_channels);
    RUN_TEST(test_no_such_interface);
    return UNITY_END();
}
