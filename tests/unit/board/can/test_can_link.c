/* The parts of the CAN driver that need no bus: map from ids to channels, time stamps, error
 * frames. */
#include <linux/can.h>
#include <linux/can/error.h>
#include <string.h>

#include <unity.h>

#include "board/can/can_codec.h"
#include "board/can/can_link.h"
#include "tests/support/message.h"

#define MS (TL_SECOND / 1000)
#define WALL ((tl_time)1700000000 * TL_SECOND)

static tl_can_clock stamps;

void setUp(void) {
    memset(&stamps, 0, sizeof stamps);
}

void tearDown(void) {}

/* ---- map ---- */

static tl_can_channel channel_at(uint32_t id, bool extended, uint16_t start) {
    tl_can_channel channel = {
        .id = id, .extended = extended, .bytes = 8, .field = {.start = start, .length = 8}, .scale = 1};
    return channel;
}

static void test_ids(void) {
    const tl_can_channel channels[] = {channel_at(0x300, false, 0), channel_at(0x100, true, 8),
                                       channel_at(0x100, false, 16), channel_at(0x300, false, 24),
                                       channel_at(0x1FFFFFFF, true, 0)};
    static const size_t order[] = {2, 0, 3, 1, 4};
    tl_can_map map;
    memset(&map, 0xA5, sizeof map); /* tl_can_map_make() sets every field */
    TEST_ASSERT_TRUE(tl_can_map_make(&map, channels, 5));
    TEST_ASSERT_EQUAL_size_t(4, map.id_count);
    for (size_t i = 0; i < 5; i++) {
        TEST_ASSERT_EQUAL_size_t(order[i], map.entries[i].index);
        TEST_ASSERT_EQUAL_size_t(channels[order[i]].field.start / 8U + 1, map.entries[i].bytes);
    }
    const tl_can_id *two = tl_can_map_find(&map, NULL, 0x300, false);
    TEST_ASSERT_NOT_NULL(two);
    TEST_ASSERT_EQUAL_size_t(1, two->first);
    TEST_ASSERT_EQUAL_size_t(2, two->entries);
    TEST_ASSERT_EQUAL_size_t(3, tl_can_map_find(&map, NULL, 0x100, true)->first);
    TEST_ASSERT_EQUAL_size_t(0, tl_can_map_find(&map, NULL, 0x100, false)->first);
    TEST_ASSERT_NULL(tl_can_map_find(&map, NULL, 0x300, true));
    TEST_ASSERT_NULL(tl_can_map_find(&map, NULL, 0, false));
    TEST_ASSERT_NOT_NULL(tl_can_map_find(&map, NULL, 0x1FFFFFFF, true));
    tl_can_map_release(&map);
}

static tl_can_channel channel_of_pgn(uint32_t pgn, tl_can_match match, uint8_t source) {
    tl_can_channel channel = channel_at(tl_can_pgn_id(pgn, source), true, 0);
    channel.match = match;
    return channel;
}

/* Numbers of the channels that a frame reaches, as decimal digits. */
static unsigned reached(const tl_can_map *map, uint32_t id, bool extended) {
    unsigned digits = 0;
    const tl_can_id *at = NULL;
    while ((at = tl_can_map_find(map, at, id, extended)) != NULL) {
        for (size_t i = at->first; i < at->first + at->entries; i++) {
            digits = 10 * digits + (unsigned)map->entries[i].index + 1;
        }
    }
    return digits;
}

static void test_pgns(void) {
    const tl_can_channel channels[] = {channel_of_pgn(0xF004, TL_CAN_BY_PGN, 0),
                                       channel_of_pgn(0xF004, TL_CAN_BY_PGN_AND_SOURCE, 0x17),
                                       channel_of_pgn(0xEA00, TL_CAN_BY_PGN, 0), channel_at(0x18F00417, true, 0),
                                       channel_of_pgn(0x1F004, TL_CAN_BY_PGN, 0)};
    tl_can_map map;
    TEST_ASSERT_TRUE(tl_can_map_make(&map, channels, 5));
    TEST_ASSERT_EQUAL_UINT(1, reached(&map, 0x18F00400, true));
    TEST_ASSERT_EQUAL_UINT(1, reached(&map, 0x0CF004FE, true)); /* another priority and source */
    TEST_ASSERT_EQUAL_UINT(124, reached(&map, 0x18F00417, true));
    TEST_ASSERT_EQUAL_UINT(12, reached(&map, 0x0CF00417, true));
    TEST_ASSERT_EQUAL_UINT(5, reached(&map, 0x19F00417, true)); /* another data page */
    TEST_ASSERT_EQUAL_UINT(0, reached(&map, 0x18F00517, true));
    TEST_ASSERT_EQUAL_UINT(3, reached(&map, 0x18EAFF00, true));
    TEST_ASSERT_EQUAL_UINT(3, reached(&map, 0x18EA2133, true)); /* another destination */
    TEST_ASSERT_EQUAL_UINT(0, reached(&map, 0x18EB2133, true));
    TEST_ASSERT_EQUAL_UINT(0, reached(&map, 0x417, false));
    tl_can_map_release(&map);
}

static void test_no_ids(void) {
    tl_can_map map;
    memset(&map, 0xA5, sizeof map); /* tl_can_map_make() sets every field */
    TEST_ASSERT_TRUE(tl_can_map_make(&map, NULL, 0));
    TEST_ASSERT_NULL(tl_can_map_find(&map, NULL, 0, false));
    tl_can_map_release(&map);
}

/* ---- clock ---- */

static void test_a_frame_is_as_old_as_the_wall_clock_says(void) {
    tl_can_clock_empty(&stamps, 1000 * MS, WALL);
    TEST_ASSERT_EQUAL_INT64(1007 * MS, tl_can_clock_stamp(&stamps, WALL + 7 * MS, 1010 * MS, WALL + 10 * MS));
    TEST_ASSERT_EQUAL_INT64(1009 * MS, tl_can_clock_stamp(&stamps, WALL + 9 * MS, 1011 * MS, WALL + 11 * MS));
}

/* A frame is received at +7 ms; then the clock is set; the frame is read at +10 ms. */
static void expect_exact_although_set_by(tl_time step) {
    setUp();
    tl_can_clock_empty(&stamps, 1000 * MS, WALL);
    TEST_ASSERT_EQUAL_INT64(1007 * MS, tl_can_clock_stamp(&stamps, WALL + 7 * MS, 1010 * MS, WALL + 10 * MS + step));
    /* a frame that is received afterwards */
    TEST_ASSERT_EQUAL_INT64(1012 * MS,
                            tl_can_clock_stamp(&stamps, WALL + 12 * MS + step, 1013 * MS, WALL + 13 * MS + step));
}

static void test_the_clock_is_set(void) {
    expect_exact_although_set_by(3600 * TL_SECOND);
    expect_exact_although_set_by(-3600 * TL_SECOND);
    expect_exact_although_set_by(-WALL / 2);
    expect_exact_although_set_by(50 * MS);
    expect_exact_although_set_by(-50 * MS);
}

/* If the clock is set twice, or by little, a stamp still stays within the interval and never goes
 * back. */
static void test_a_stamp_stays_where_it_can_be(void) {
    tl_can_clock_empty(&stamps, 1000 * MS, WALL);
    TEST_ASSERT_EQUAL_INT64(1000 * MS, tl_can_clock_stamp(&stamps, WALL - TL_SECOND, 1010 * MS, WALL + TL_SECOND));
    TEST_ASSERT_EQUAL_INT64(1011 * MS, tl_can_clock_stamp(&stamps, WALL + 9 * TL_SECOND, 1011 * MS, WALL + TL_SECOND));
    tl_time floor = 1011 * MS;
    for (int i = 0; i < 2000; i++) {
        tl_time now = 1012 * MS + i * MS;
        tl_time stamp = tl_can_clock_stamp(&stamps, WALL + i * (i % 7 - 3) * MS, now, WALL + i * (i % 5 - 2) * MS);
        TEST_ASSERT_TRUE(stamp >= floor && stamp <= now);
        floor = stamp;
    }
}

static void test_a_frame_without_a_stamp_is_of_now(void) {
    TEST_ASSERT_EQUAL_INT64(5, tl_can_clock_stamp(&stamps, 0, 5, WALL));
}

/* ---- error frames ---- */

static tl_can_fault fault_of(uint32_t classes, uint8_t controller, uint8_t violation, uint8_t place,
                             uint8_t transceiver) {
    const uint8_t data[8] = {0, controller, violation, place, transceiver, 0, 0, 0};
    return tl_can_fault_of(classes, data);
}

static void test_health(void) {
    static const struct {
        uint32_t classes;
        uint8_t controller;
        tl_can_health health;
        bool overflow;
    } cases[] = {
        {CAN_ERR_BUSOFF, 0, TL_CAN_BUS_OFF, false},
        {CAN_ERR_FLAG | CAN_ERR_BUSOFF | CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE, TL_CAN_BUS_OFF, false},
        {CAN_ERR_RESTARTED, 0, TL_CAN_ACTIVE, false},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_RX_PASSIVE, TL_CAN_PASSIVE, false},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_TX_PASSIVE | CAN_ERR_CRTL_RX_WARNING, TL_CAN_PASSIVE, false},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING, TL_CAN_WARNING, false},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE, TL_CAN_ACTIVE, false},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW, TL_CAN_SAME, true},
        {CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW | CAN_ERR_CRTL_RX_WARNING, TL_CAN_WARNING, true},
        {CAN_ERR_PROT, CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_RX_OVERFLOW, TL_CAN_SAME, false},
        {0, 0xFF, TL_CAN_SAME, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        tl_can_fault fault = fault_of(cases[i].classes, cases[i].controller, 0, 0, 0);
        TEST_ASSERT_EQUAL_INT(cases[i].health, fault.health);
        TEST_ASSERT_EQUAL(cases[i].overflow, fault.overflow);
    }
}

static void expect_bus_error(const char *parts, uint32_t classes, uint8_t violation, uint8_t place,
                             uint8_t transceiver) {
    tl_can_fault fault = fault_of(classes, 0, violation, place, transceiver);
    if (parts == NULL) {
        TEST_ASSERT_NULL(fault.bus_error);
    } else {
        TEST_ASSERT_NOT_NULL(fault.bus_error);
        TL_EXPECT_PARTS(parts, fault.bus_error);
    }
}

static void test_bus_errors(void) {
    expect_bus_error(NULL, CAN_ERR_CRTL | CAN_ERR_BUSOFF, CAN_ERR_PROT_STUFF, 0, CAN_ERR_TRX_CANH_NO_WIRE);
    expect_bus_error("bit stuffing", CAN_ERR_PROT | CAN_ERR_BUSERROR, CAN_ERR_PROT_STUFF, 0, 0);
    expect_bus_error("form", CAN_ERR_PROT, CAN_ERR_PROT_FORM, 0, 0);
    expect_bus_error("checksums", CAN_ERR_PROT, CAN_ERR_PROT_BIT, CAN_ERR_PROT_LOC_CRC_SEQ, 0);
    expect_bus_error("overload", CAN_ERR_PROT, CAN_ERR_PROT_OVERLOAD, 0, 0);
    expect_bus_error("bit errors", CAN_ERR_BUSERROR, 0, 0, 0);
    expect_bus_error("wire|CAN high", CAN_ERR_TRX, 0, 0, CAN_ERR_TRX_CANH_NO_WIRE);
    expect_bus_error("wire|CAN low", CAN_ERR_TRX, 0, 0, CAN_ERR_TRX_CANL_NO_WIRE);
    expect_bus_error("CAN low|CAN high", CAN_ERR_TRX, 0, 0, CAN_ERR_TRX_CANL_SHORT_TO_CANH);
    expect_bus_error("transceiver", CAN_ERR_TRX, 0, 0, CAN_ERR_TRX_CANL_SHORT_TO_GND);
    expect_bus_error(NULL, CAN_ERR_TRX, 0, 0, CAN_ERR_TRX_UNSPEC);
}

static void test_only_understood_classes_are_requested(void) {
    TEST_ASSERT_EQUAL_HEX32(0, tl_can_fault_classes & (CAN_ERR_LOSTARB | CAN_ERR_ACK | CAN_ERR_TX_TIMEOUT));
    TEST_ASSERT_EQUAL_HEX32(CAN_ERR_BUSOFF | CAN_ERR_RESTARTED | CAN_ERR_CRTL,
                            tl_can_fault_classes & (CAN_ERR_BUSOFF | CAN_ERR_RESTARTED | CAN_ERR_CRTL));
    for (int health = TL_CAN_ACTIVE; health <= TL_CAN_BUS_OFF; health++) {
        TEST_ASSERT_TRUE(strlen(tl_can_health_text((tl_can_health)health)) > 20);
    }
    TEST_ASSERT_EQUAL_STRING("", tl_can_health_text(TL_CAN_SAME));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_ids);
    RUN_TEST(test_pgns);
    RUN_TEST(test_no_ids);
    RUN_TEST(test_a_frame_is_as_old_as_the_wall_clock_says);
    RUN_TEST(test_the_clock_is_set);
    RUN_TEST(test_a_stamp_stays_where_it_can_be);
    RUN_TEST(test_a_frame_without_a_stamp_is_of_now);
    RUN_TEST(test_health);
    RUN_TEST(test_bus_errors);
    RUN_TEST(test_only_understood_classes_are_requested);
    return UNITY_END();
}
