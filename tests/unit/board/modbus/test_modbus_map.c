/* Modbus requests: few, within the limits of the protocol, and smaller ones for servers that need
 * them. */
#include <string.h>

#include <unity.h>

#include "board/modbus/modbus_map.h"

static tl_modbus_map map;
static tl_modbus_channel channels[512];
static size_t channel_count;
static size_t most_registers;

void setUp(void) {
    memset(&map, 0, sizeof map);
    memset(channels, 0, sizeof channels);
    channel_count = 0;
    most_registers = TL_MODBUS_MAX_REGISTERS;
}

void tearDown(void) {
    tl_modbus_map_release(&map);
}

static void add_of(uint8_t unit_id, tl_modbus_table table, unsigned address, tl_modbus_type type) {
    channels[channel_count] =
        (tl_modbus_channel){.unit_id = unit_id, .table = table, .address = (uint16_t)address, .type = type, .scale = 1};
    channel_count++;
}

static void add(unsigned address, tl_modbus_type type) {
    add_of(1, TL_MODBUS_HOLDING, address, type);
}

static void make(void) {
    TEST_ASSERT_TRUE(tl_modbus_map_make(&map, channels, channel_count, most_registers));
}

static void expect_read(size_t index, unsigned address, unsigned count, size_t entries) {
    TEST_ASSERT_TRUE(index < map.read_count);
    TEST_ASSERT_EQUAL_UINT16(address, map.reads[index].address);
    TEST_ASSERT_EQUAL_UINT16(count, map.reads[index].count);
    TEST_ASSERT_EQUAL_size_t(entries, map.reads[index].entries);
}

/* Each channel is in exactly one request, as a whole. Requests are within the limits. */
static void expect_sound(void) {
    size_t seen[512] = {0};
    size_t entry = 0;
    for (size_t i = 0; i < map.read_count; i++) {
        const tl_modbus_read *read = &map.reads[i];
        bool bits = read->table == TL_MODBUS_COIL || read->table == TL_MODBUS_DISCRETE;
        TEST_ASSERT_TRUE(read->count <= (bits ? 2000 : 125));
        TEST_ASSERT_EQUAL_size_t(entry, read->first);
        for (size_t k = 0; k < read->entries; k++, entry++) {
            const tl_modbus_channel *channel = &map.entries[entry].channel;
            TEST_ASSERT_EQUAL_UINT16(channels[map.entries[entry].index].address, channel->address);
            TEST_ASSERT_EQUAL_INT(channels[map.entries[entry].index].type, channel->type);
            TEST_ASSERT_EQUAL_UINT8(read->unit_id, channel->unit_id);
            TEST_ASSERT_EQUAL_INT(read->table, channel->table);
            TEST_ASSERT_TRUE(channel->address >= read->address);
            TEST_ASSERT_TRUE(channel->address + tl_modbus_registers(channel->type) <=
                             (size_t)read->address + read->count);
            seen[map.entries[entry].index]++;
        }
    }
    for (size_t i = 0; i < channel_count; i++) {
        TEST_ASSERT_EQUAL_size_t(1, seen[i]);
    }
}

static void test_no_channels(void) {
    make();
    TEST_ASSERT_EQUAL_size_t(0, map.read_count);
}

static void test_neighbours_in_any_order_share_a_request(void) {
    add(102, TL_MODBUS_FLOAT64);
    add(100, TL_MODBUS_FLOAT32);
    add(106, TL_MODBUS_INT16);
    make();
    TEST_ASSERT_EQUAL_size_t(1, map.read_count);
    expect_read(0, 100, 7, 3);
    expect_sound();
}

static void test_gap_of_registers(void) {
    add(0, TL_MODBUS_INT32);
    add(2 + TL_MODBUS_GAP_REGISTERS, TL_MODBUS_INT16);
    add(2 + TL_MODBUS_GAP_REGISTERS + 1 + TL_MODBUS_GAP_REGISTERS + 1, TL_MODBUS_INT16); /* one register too many */
    make();
    TEST_ASSERT_EQUAL_size_t(2, map.read_count);
    expect_read(0, 0, 3 + TL_MODBUS_GAP_REGISTERS, 2);
    expect_sound();
}

static void test_gap_of_bits(void) {
    add_of(1, TL_MODBUS_COIL, 5, TL_MODBUS_BIT);
    add_of(1, TL_MODBUS_COIL, 6 + TL_MODBUS_GAP_BITS, TL_MODBUS_BIT);
    add_of(1, TL_MODBUS_COIL, 6 + 2 * TL_MODBUS_GAP_BITS + 2, TL_MODBUS_BIT);
    make();
    TEST_ASSERT_EQUAL_size_t(2, map.read_count);
    expect_read(0, 5, TL_MODBUS_GAP_BITS + 2, 2);
    expect_sound();
}

static void test_units_and_tables_are_apart(void) {
    add_of(2, TL_MODBUS_HOLDING, 0, TL_MODBUS_INT16);
    add_of(1, TL_MODBUS_INPUT, 1, TL_MODBUS_INT16);
    add_of(1, TL_MODBUS_HOLDING, 0, TL_MODBUS_INT16);
    add_of(1, TL_MODBUS_COIL, 0, TL_MODBUS_BIT);
    add_of(1, TL_MODBUS_DISCRETE, 1, TL_MODBUS_BIT);
    make();
    TEST_ASSERT_EQUAL_size_t(5, map.read_count);
    expect_sound();
}

static void test_registers_are_limited(void) {
    for (unsigned i = 0; i < 125; i++) {
        add(i, TL_MODBUS_INT16);
    }
    make();
    TEST_ASSERT_EQUAL_size_t(1, map.read_count);
    tl_modbus_map_release(&map);
    add(125, TL_MODBUS_INT16);
    make();
    TEST_ASSERT_EQUAL_size_t(2, map.read_count);
    expect_read(0, 0, 125, 125);
    expect_read(1, 125, 1, 1);
    expect_sound();
}

static void test_requests_of_few_registers(void) {
    add(0, TL_MODBUS_INT16);
    add(1, TL_MODBUS_INT32);
    add(3, TL_MODBUS_FLOAT64); /* larger than a request may be, but not split */
    add(7, TL_MODBUS_INT16);
    add(10, TL_MODBUS_INT16); /* with the gap it would be too large */
    for (unsigned i = 0; i < 40; i++) {
        add_of(1, TL_MODBUS_COIL, i, TL_MODBUS_BIT); /* the limit is for registers */
    }
    most_registers = 3;
    make();
    TEST_ASSERT_EQUAL_size_t(5, map.read_count);
    expect_read(0, 0, 40, 40);
    expect_read(1, 0, 3, 2);
    expect_read(2, 3, 4, 1);
    expect_read(3, 7, 1, 1);
    expect_read(4, 10, 1, 1);
    expect_sound();
    tl_modbus_map_reset(&map, TL_MODBUS_SINGLE);
    TEST_ASSERT_EQUAL_size_t(45, map.read_count);
    expect_sound();
    tl_modbus_map_reset(&map, TL_MODBUS_GAPS);
    TEST_ASSERT_EQUAL_size_t(5, map.read_count);
}

static void test_a_value_is_never_spread(void) {
    for (unsigned i = 0; i < 40; i++) {
        add(4 * i, TL_MODBUS_FLOAT64); /* 31 values fill 124 registers: the next one would be cut */
    }
    make();
    TEST_ASSERT_EQUAL_size_t(2, map.read_count);
    expect_read(0, 0, 124, 31);
    expect_read(1, 124, 36, 9);
    expect_sound();
}

static void test_bits_are_limited(void) {
    for (unsigned i = 0; i < 20; i++) {
        add_of(1, TL_MODBUS_DISCRETE, 111 * i, TL_MODBUS_BIT);
    }
    make();
    TEST_ASSERT_EQUAL_size_t(2, map.read_count);
    expect_read(0, 0, 18 * 111 + 1, 19);
    expect_sound();
}

static void test_overlap_and_twice_the_same(void) {
    add(10, TL_MODBUS_FLOAT64);
    add(11, TL_MODBUS_INT16);
    add(11, TL_MODBUS_INT16);
    add(14, TL_MODBUS_INT16);
    make();
    TEST_ASSERT_EQUAL_size_t(1, map.read_count);
    expect_read(0, 10, 5, 4);
    expect_sound();
}

static void test_the_last_register(void) {
    add(65532, TL_MODBUS_FLOAT64);
    add(65520, TL_MODBUS_INT16);
    make();
    TEST_ASSERT_EQUAL_size_t(1, map.read_count);
    expect_read(0, 65520, 16, 2);
}

static void test_split_leaves_out_gaps_then_is_single(void) {
    add_of(0, TL_MODBUS_HOLDING, 0, TL_MODBUS_INT16); /* requests before and after the split one do not change */
    add(0, TL_MODBUS_INT16);
    add(1, TL_MODBUS_INT32);
    add(5, TL_MODBUS_INT16);
    add_of(2, TL_MODBUS_HOLDING, 0, TL_MODBUS_INT16);
    make();
    TEST_ASSERT_EQUAL_size_t(3, map.read_count);
    expect_read(1, 0, 6, 3);
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_map_split(&map, 1));
    TEST_ASSERT_EQUAL_size_t(4, map.read_count);
    expect_read(1, 0, 3, 2);
    expect_read(2, 5, 1, 1);
    expect_sound();
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_map_split(&map, 1));
    expect_read(1, 0, 1, 1);
    expect_read(2, 1, 2, 1);
    expect_read(3, 5, 1, 1);
    expect_sound();
    for (size_t i = 0; i < map.read_count; i++) {
        TEST_ASSERT_EQUAL_size_t(1, tl_modbus_map_split(&map, i)); /* cannot be split further */
    }
    TEST_ASSERT_EQUAL_size_t(5, map.read_count);
    tl_modbus_map_reset(&map, TL_MODBUS_GAPS);
    TEST_ASSERT_EQUAL_size_t(3, map.read_count);
    expect_sound();
}

static void add_part(unsigned address, tl_modbus_type type, uint8_t bit) {
    add(address, type);
    channels[channel_count - 1].bit = bit;
}

static void test_parts_of_a_register_stay_together(void) {
    add_part(5, TL_MODBUS_REGISTER_BIT, 3);
    add_part(6, TL_MODBUS_UINT8, 8);
    add_part(5, TL_MODBUS_REGISTER_BIT, 0);
    add_part(5, TL_MODBUS_INT8, 8);
    add(7, TL_MODBUS_INT32);
    add(7, TL_MODBUS_INT32);
    make();
    TEST_ASSERT_EQUAL_size_t(1, map.read_count);
    expect_read(0, 5, 4, 6);
    TEST_ASSERT_EQUAL_size_t(4, tl_modbus_map_split(&map, 0));
    expect_read(0, 5, 1, 3);
    expect_read(1, 6, 1, 1);
    expect_read(2, 7, 2, 1);
    expect_read(3, 7, 2, 1);
    expect_sound();
    TEST_ASSERT_EQUAL_size_t(1, tl_modbus_map_split(&map, 0));
}

static void test_split_without_gaps_is_single_at_once(void) {
    add(0, TL_MODBUS_INT16);
    add(1, TL_MODBUS_INT16);
    make();
    TEST_ASSERT_EQUAL_size_t(2, tl_modbus_map_split(&map, 0));
    expect_sound();
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_no_channels);
    RUN_TEST(test_neighbours_in_any_order_share_a_request);
    RUN_TEST(test_gap_of_registers);
    RUN_TEST(test_gap_of_bits);
    RUN_TEST(test_units_and_tables_are_apart);
    RUN_TEST(test_registers_are_limited);
    RUN_TEST(test_requests_of_few_registers);
    RUN_TEST(test_a_value_is_never_spread);
    RUN_TEST(test_bits_are_limited);
    RUN_TEST(test_overlap_and_twice_the_same);
    RUN_TEST(test_the_last_register);
    RUN_TEST(test_split_leaves_out_gaps_then_is_single);
    RUN_TEST(test_parts_of_a_register_stay_together);
    RUN_TEST(test_split_without_gaps_is_single_at_once);
    return UNITY_END();
}
