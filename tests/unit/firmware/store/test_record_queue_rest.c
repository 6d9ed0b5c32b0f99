/* Count of the unread entries of a record queue, also with invalid positions. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/store/record_queue.h"
#include "tests/support/made_run.h"

enum { TICKS = 10, EVENTS = 3, LINE = 64 };

static tl_record_queue_settings settings;
static void *memory;
static tl_record_queue_taken taken;
static tl_record_queue queue;

/* Puts an unread run with events. */
static void fill(size_t ring_bytes) {
    static tl_record_queue_start start; /* too large for the stack */
    settings.ring_bytes = ring_bytes;
    TEST_ASSERT_EQUAL_INT(0, posix_memalign(&memory, LINE, tl_record_queue_bytes(&settings)));
    memset(memory, 0, tl_record_queue_bytes(&settings));
    taken = (tl_record_queue_taken){0};
    tl_record_queue_open(&settings, memory, &taken, &queue);
    if (ring_bytes != 0) {
        tl_made_beginning(1, &start);
        TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
        TEST_ASSERT_TRUE(tl_made_put_out(&queue, 0, TICKS));
    }
    for (int i = 0; i < EVENTS; i++) {
        tl_record_queue_event(&queue, -1, TL_EVENT_INFO, "twin", "an event");
    }
}

void setUp(void) {
    settings = (tl_record_queue_settings){.shape = {.plant = TL_MADE_PLANT,
                                                    .match = TL_MADE_MATCH,
                                                    .adjust = TL_MADE_ADJUST,
                                                    .components = TL_MADE_COMPONENTS}};
    fill((size_t)1 << 18);
}

void tearDown(void) {
    free(memory);
}

static void test_all_of_it(void) {
    TEST_ASSERT_EQUAL_UINT64(2 * TICKS + EVENTS, tl_record_queue_count_remaining(&settings, memory, &taken));
}

/* The start of a run and read events do not count. */
static void test_partly_read(void) {
    taken.events = 1;
    taken.ring = queue.published - 2 * tl_recorder_entry_size(&settings.shape, TL_ENTRY_STEP) -
                 tl_recorder_entry_size(&settings.shape, TL_ENTRY_SAMPLE);
    TEST_ASSERT_EQUAL_UINT64(3 + EVENTS - 1, tl_record_queue_count_remaining(&settings, memory, &taken));
}

static void test_events_only(void) {
    free(memory);
    fill(0);
    TEST_ASSERT_EQUAL_UINT64(EVENTS, tl_record_queue_count_remaining(&settings, memory, &taken));
}

/* Invalid positions: the function returns, and reads no memory outside of the queue. */
static void test_invalid_positions(void) {
    const uint64_t positions[] = {1, 1U << 17, 1U << 20, UINT64_MAX / 2, UINT64_MAX};
    for (size_t i = 0; i < sizeof positions / sizeof positions[0]; i++) {
        taken = (tl_record_queue_taken){.ring = positions[i], .events = positions[i]};
        TEST_ASSERT_TRUE(tl_record_queue_count_remaining(&settings, memory, &taken) <= 2 * TICKS + EVENTS);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_of_it);
    RUN_TEST(test_partly_read);
    RUN_TEST(test_events_only);
    RUN_TEST(test_invalid_positions);
    return UNITY_END();
}
