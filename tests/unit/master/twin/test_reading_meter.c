/* Comparison of a twin with readings between its steps. */
#include <math.h>
#include <unity.h>

#include "master/twin/reading_meter.h"

enum { STEP = 10, ROOM = 4 };

static tl_arena arena;
static tl_reading_meter *meter;
static tl_metrics metrics;

void setUp(void) {
    tl_arena_init(&arena);
    metrics = (tl_metrics){0};
    meter = tl_reading_meter_create(&arena, STEP, ROOM);
    TEST_ASSERT_NOT_NULL(meter);
}

void tearDown(void) {
    tl_arena_release(&arena);
}

static void see(tl_time time, double value) {
    tl_reading_meter_add_reading(meter, time, value, TL_GOOD, &metrics);
}

static void step(tl_time end, double y) {
    tl_reading_meter_step(meter, end, y, true, &metrics);
}

static void expect(uint64_t pairs, double sum) {
    TEST_ASSERT_EQUAL_UINT64(pairs, metrics.pairs);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, sum, metrics.sum_of_squares);
}

static void a_twin_is_on_the_line_between_its_steps(void) {
    step(10, 100);
    see(13, 104);
    step(20, 110); /* 103 at the reading */
    expect(1, 1);
    see(30, 108); /* exactly at the end of a step */
    see(31, 1000);
    step(30, 111);
    expect(2, 10);
}

static void a_reading_waits_for_its_step(void) {
    see(5, 50); /* before the first known step */
    see(15, 2);
    see(25, 5);
    step(10, 0);
    expect(0, 0);
    step(20, 2);
    expect(1, 1);
    step(30, 2);
    expect(2, 10);
    see(29, 7); /* too late */
    step(40, 2);
    expect(2, 10);
}

static void the_same_reading_counts_once(void) {
    step(10, 0);
    for (int i = 0; i < 3; i++) {
        see(15, 1);
        tl_reading_meter_add_reading(meter, 16, 1000, TL_OUTLIER, &metrics);
    }
    tl_reading_meter_add_reading(meter, 17, 1000, TL_STALE, &metrics);
    tl_reading_meter_add_reading(meter, 18, (double)NAN, TL_GOOD, &metrics);
    step(20, 0);
    expect(1, 1);
    TEST_ASSERT_EQUAL_UINT64(1, metrics.left_out);
}

/* After a restart or a missing step there is no line. */
static void no_line_no_comparison(void) {
    step(10, 0);
    see(15, 1);
    tl_reading_meter_step(meter, 20, 5, false, &metrics);
    see(35, 1);
    step(40, 5);
    expect(0, 0);
}

static void the_oldest_gives_way(void) {
    step(10, 0);
    for (int i = 0; i < ROOM + 1; i++) {
        see(11 + i, i == 0 ? 1000 : 1);
    }
    step(20, 0);
    expect(ROOM, ROOM);
}

static void it_goes_on_from_bytes(void) {
    static unsigned char bytes[256];
    step(10, 0);
    see(15, 3);
    tl_archive saved = tl_archive_saving(bytes, sizeof bytes);
    tl_reading_meter_archive(meter, &saved);
    TEST_ASSERT_TRUE(tl_archive_is_whole(&saved));
    meter = tl_reading_meter_create(&arena, STEP, ROOM);
    tl_archive loaded = tl_archive_loading(bytes, saved.at);
    tl_reading_meter_archive(meter, &loaded);
    TEST_ASSERT_TRUE(tl_archive_is_whole(&loaded));
    step(20, 4);
    expect(1, 1);
    bytes[0] = ROOM + 1; /* more than fit */
    loaded = tl_archive_loading(bytes, saved.at);
    tl_reading_meter_archive(meter, &loaded);
    TEST_ASSERT_FALSE(tl_archive_is_whole(&loaded));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_twin_is_on_the_line_between_its_steps);
    RUN_TEST(a_reading_waits_for_its_step);
    RUN_TEST(the_same_reading_counts_once);
    RUN_TEST(no_line_no_comparison);
    RUN_TEST(the_oldest_gives_way);
    RUN_TEST(it_goes_on_from_bytes);
    return UNITY_END();
}
