/* Arrivals: which signals are reported, how often, and the counts of the summary. */
#include "firmware/twin/arrivals.h"

#include <string.h>

#include <unity.h>

#include "firmware/config/drivers.h"
#include "tests/support/message.h"

enum { SIGNALS = 4, DEPTH = 4 };

static const tl_driver polled = {.is_polled = true};
static const tl_driver streamed = {.is_polled = false};
static tl_config_source sources[2];
static tl_config_signal signals[SIGNALS];
static tl_config config;
static tl_sample_buffer_slot slots[SIGNALS][DEPTH];
static uint64_t posts[SIGNALS];
static tl_plant_input input;
static tl_journal journal;
static tl_arrivals arrivals;
static tl_summary summary;
static tl_time now;
static size_t events;
static char last[TL_JOURNAL_TEXT];

static void on_event(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    TEST_ASSERT_EQUAL_PTR(&events, context);
    TEST_ASSERT_EQUAL_INT64(-1, tick);
    TEST_ASSERT_EQUAL_INT(TL_EVENT_WARNING, severity);
    TEST_ASSERT_EQUAL_STRING("plant", source);
    events++;
    memcpy(last, text, sizeof last);
}

/* Signal 0 is polled every 50 ms, signal 1 is a further look-up of it, signal 2 is a stream of
 * every_s 0.5, signal 3 a stream without a rate. */
void setUp(void) {
    sources[0] = (tl_config_source){.driver = &polled, .period_s = 0.05};
    sources[1] = (tl_config_source){.driver = &streamed, .period_s = 0.05};
    memset(signals, 0, sizeof signals);
    for (size_t i = 0; i < SIGNALS; i++) {
        signals[i].of = i == 1 ? 0 : i;
        signals[i].source = i / 2;
        signals[i].plan.name = "flow";
        input.buffers[i] = (tl_sample_buffer){.slots = slots[i], .count = &posts[i], .depth = DEPTH};
        posts[i] = 1000 * i;
    }
    signals[2].every = TL_SECOND / 2;
    input.count = SIGNALS;
    config = (tl_config){.sources = sources, .source_count = 2, .signals = signals, .signal_count = SIGNALS};
    tl_journal_init(&journal, NULL);
    tl_journal_listen(&journal, on_event, &events);
    arrivals = (tl_arrivals){.begun = 0};
    summary = (tl_summary){.samples = 0};
    now = 100 * TL_SECOND;
    events = 0;
}

void tearDown(void) {}

/* Ticks every 10 ms for so many seconds. Signals 0 and 2 get a reading each `every` ticks. */
static void run(int seconds, int every, int other) {
    for (int i = 0; i < 100 * seconds; i++, now += TL_SECOND / 100) {
        posts[0] += i % every == 0 ? 1 : 0;
        posts[2] += i % other == 0 ? 1 : 0;
        tl_arrivals_check(&arrivals, &input, &config, &journal, now);
    }
}

static void expect_sum(size_t signal, uint64_t readings, uint64_t expected) {
    tl_arrivals_sum_up(&arrivals, &input, &config, now, &summary);
    TEST_ASSERT_EQUAL_UINT64(expected, summary.expected[signal]);
    TEST_ASSERT_EQUAL_UINT64(readings, summary.readings[signal]);
}

static void readings_as_often_as_expected_are_not_reported(void) {
    run(60, 6, 60); /* a little late */
    TEST_ASSERT_EQUAL_size_t(0, events);
    expect_sum(0, 999, 1200);
    expect_sum(2, 99, 120);
    expect_sum(1, 0, 0);
    expect_sum(3, 0, 0);
}

static void a_slow_device_is_reported_once(void) {
    run(10, 30, 50);
    TEST_ASSERT_EQUAL_size_t(1, events);
    TL_EXPECT_PARTS("plant.flow|readings|40|0.05 s|period_s", last);
    run(10, 5, 50);
    run(10, 30, 50);
    TEST_ASSERT_EQUAL_size_t(1, events);
}

static void a_slow_sender_is_reported_once(void) {
    run(60, 5, 200);
    TEST_ASSERT_EQUAL_size_t(1, events);
    TL_EXPECT_PARTS("plant.flow|readings|20|0.5 s|every_s", last);
}

static void nothing_is_counted_before_the_first_tick(void) {
    expect_sum(0, 0, 0);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(readings_as_often_as_expected_are_not_reported);
    RUN_TEST(a_slow_device_is_reported_once);
    RUN_TEST(a_slow_sender_is_reported_once);
    RUN_TEST(nothing_is_counted_before_the_first_tick);
    return UNITY_END();
}
