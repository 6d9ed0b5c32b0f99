/* The recorder's queues: nothing is lost, changed or mixed up between threads, and a full one refuses at once. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/record/recorder_entry.h"
#include "firmware/record/recorder_events.h"
#include "firmware/record/recorder_ring.h"
#include "tests/support/made_run.h"

enum { THREADS = 8, EACH = 20000 };

static const tl_recorder_shape shape = {
    .plant = TL_MADE_PLANT, .match = TL_MADE_MATCH, .adjust = TL_MADE_ADJUST, .components = TL_MADE_COMPONENTS};
static tl_recorder_ring ring;
static tl_recorder_events events;
static tl_recorder_entry entry;

void setUp(void) {
    memset(&ring, 0, sizeof ring);
    memset(&events, 0, sizeof events);
}

void tearDown(void) {
    tl_recorder_ring_close(&ring);
}

/* ---- Ring -------------------------------------------------------------------------------------------------------- */

static void test_capacity_is_rounded_up(void) {
    TEST_ASSERT_TRUE(tl_recorder_ring_open(&ring, 1));
    TEST_ASSERT_EQUAL_size_t(4096, ring.capacity);
    tl_recorder_ring_close(&ring);
    TEST_ASSERT_TRUE(tl_recorder_ring_open(&ring, 4097));
    TEST_ASSERT_EQUAL_size_t(8192, ring.capacity);
    TEST_ASSERT_TRUE(tl_recorder_ring_has_room(&ring, 8192));
    TEST_ASSERT_FALSE(tl_recorder_ring_has_room(&ring, 8193));
}

static void expect_sample(int64_t tick) {
    tl_sample sample;
    tl_made_sample(tick, &sample);
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_SAMPLE, entry.kind);
    TEST_ASSERT_EQUAL_INT64(tick, entry.sample.tick);
    TEST_ASSERT_EQUAL_MEMORY(sample.values, entry.sample.values, TL_MADE_PLANT * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(sample.stamps, entry.sample.stamps, TL_MADE_PLANT * sizeof(tl_time));
    TEST_ASSERT_EQUAL_MEMORY(sample.quality, entry.sample.quality, TL_MADE_PLANT);
}

static void expect_step(int64_t step) {
    tl_record record;
    tl_made_record(step, &record);
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_STEP, entry.kind);
    TEST_ASSERT_EQUAL_INT64(step, entry.record.step);
    TEST_ASSERT_EQUAL_INT(record.outcome, entry.record.outcome);
    TEST_ASSERT_EQUAL_INT(record.stop, entry.record.stop);
    TEST_ASSERT_EQUAL_MEMORY(&record.objective, &entry.record.objective, sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(&record.objective_nominal, &entry.record.objective_nominal, sizeof(double));
    TEST_ASSERT_EQUAL_UINT32(record.evaluations, entry.record.evaluations);
    TEST_ASSERT_EQUAL_UINT32(record.executions, entry.record.executions);
    TEST_ASSERT_EQUAL_UINT32(record.predicted, entry.record.predicted);
    TEST_ASSERT_EQUAL_HEX32(record.flags, entry.record.flags);
    TEST_ASSERT_EQUAL_HEX32(record.held, entry.record.held);
    TEST_ASSERT_EQUAL_INT64(record.used, entry.record.used);
    TEST_ASSERT_EQUAL_MEMORY(record.y, entry.record.y, TL_MADE_MATCH * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(record.y_hat, entry.record.y_hat, TL_MADE_MATCH * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(record.y_hat_quality, entry.record.y_hat_quality, TL_MADE_MATCH);
    TEST_ASSERT_EQUAL_MEMORY(record.u, entry.record.u, TL_MADE_ADJUST * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(record.u_hat, entry.record.u_hat, TL_MADE_ADJUST * sizeof(double));
    tl_recorder_component ledger[TL_MADE_COMPONENTS];
    tl_made_ledger(step, ledger);
    TEST_ASSERT_EQUAL_MEMORY(ledger, entry.ledger, sizeof ledger);
}

static bool put_both(int64_t i) {
    tl_sample sample;
    tl_record record;
    tl_recorder_component ledger[TL_MADE_COMPONENTS];
    tl_made_sample(i, &sample);
    tl_made_record(i, &record);
    tl_made_ledger(i, ledger);
    size_t size = tl_recorder_entry_size(&shape, TL_ENTRY_SAMPLE) + tl_recorder_entry_size(&shape, TL_ENTRY_STEP);
    return tl_recorder_ring_has_room(&ring, size) && tl_recorder_entry_put_sample(&ring, &shape, &sample, 0) &&
           tl_recorder_entry_put_step(&ring, &shape, &record, ledger);
}

static void test_a_full_ring_refuses_and_stays_whole(void) {
    TEST_ASSERT_TRUE(tl_recorder_ring_open(&ring, 4096));
    const tl_resumption beginning = {.started = 1234};
    int64_t put = 0;
    int64_t taken = 0;
    for (int round = 0; round < 100; round++) { /* wraps around at every offset */
        while (put_both(put)) {
            put++;
        }
        size_t filled = tl_recorder_ring_filled(&ring);
        tl_sample sample;
        tl_made_sample(0, &sample);
        while (tl_recorder_ring_has_room(&ring, tl_recorder_entry_size(&shape, TL_ENTRY_SAMPLE))) {
            TEST_ASSERT_TRUE(tl_recorder_entry_put_start(&ring, &shape, &beginning));
            filled += tl_recorder_entry_size_of_start(true);
        }
        TEST_ASSERT_FALSE(tl_recorder_entry_put_sample(&ring, &shape, &sample, 0));
        TEST_ASSERT_EQUAL_size_t(filled, tl_recorder_ring_filled(&ring));
        size_t cursor = tl_recorder_ring_begin(&ring);
        while (cursor != tl_recorder_ring_end(&ring)) {
            tl_recorder_entry_take(&ring, &shape, &cursor, &entry);
            if (entry.kind == TL_ENTRY_START) {
                TEST_ASSERT_EQUAL_INT64(1234, entry.beginning.started);
                continue;
            }
            expect_sample(taken);
            tl_recorder_entry_take(&ring, &shape, &cursor, &entry);
            expect_step(taken++);
        }
        tl_recorder_ring_release(&ring, cursor);
        TEST_ASSERT_EQUAL_size_t(0, tl_recorder_ring_filled(&ring));
    }
    TEST_ASSERT_EQUAL_INT64(put, taken);
    TEST_ASSERT_GREATER_THAN_INT64(500, put);
}

/* What is not released is read again. */
static void test_a_batch_that_failed_is_read_again(void) {
    TEST_ASSERT_TRUE(tl_recorder_ring_open(&ring, 4096));
    TEST_ASSERT_TRUE(put_both(7));
    for (int i = 0; i < 3; i++) {
        size_t cursor = tl_recorder_ring_begin(&ring);
        tl_recorder_entry_take(&ring, &shape, &cursor, &entry);
        expect_sample(7);
    }
}

static void test_the_largest_entry_fits_its_size(void) {
    const tl_recorder_shape large = {
        .plant = TL_MAX_SIGNALS, .match = TL_MAX_MATCH, .adjust = TL_MAX_ADJUST, .components = TL_RECORDER_COMPONENTS};
    static tl_sample sample;
    static tl_record record;
    static tl_recorder_component ledger[TL_RECORDER_COMPONENTS];
    TEST_ASSERT_TRUE(tl_recorder_ring_open(&ring, 8192));
    TEST_ASSERT_TRUE(tl_recorder_entry_put_sample(&ring, &large, &sample, 0));
    TEST_ASSERT_EQUAL_size_t(tl_recorder_entry_size(&large, TL_ENTRY_SAMPLE), tl_recorder_ring_filled(&ring));
    TEST_ASSERT_TRUE(tl_recorder_entry_put_step(&ring, &large, &record, ledger));
    TEST_ASSERT_EQUAL_size_t(tl_recorder_entry_size(&large, TL_ENTRY_SAMPLE) +
                                 tl_recorder_entry_size(&large, TL_ENTRY_STEP),
                             tl_recorder_ring_filled(&ring));
}

static void *produce(void *context) {
    (void)context;
    for (int64_t i = 0; i < EACH; i++) {
        while (!put_both(i)) {
            sched_yield();
        }
    }
    return NULL;
}

static void test_one_thread_puts_another_takes(void) {
    pthread_t producer;
    TEST_ASSERT_TRUE(tl_recorder_ring_open(&ring, 4096));
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&producer, NULL, produce, NULL));
    for (int64_t taken = 0; taken < EACH;) {
        size_t end = tl_recorder_ring_end(&ring);
        size_t cursor = tl_recorder_ring_begin(&ring);
        while (cursor != end) {
            tl_recorder_entry_take(&ring, &shape, &cursor, &entry);
            if (entry.kind == TL_ENTRY_SAMPLE) {
                expect_sample(taken);
            } else {
                expect_step(taken++);
            }
        }
        tl_recorder_ring_release(&ring, cursor);
        sched_yield();
    }
    TEST_ASSERT_EQUAL_INT(0, pthread_join(producer, NULL));
}

/* ---- Events ------------------------------------------------------------------------------------------------------ */

static void test_a_full_queue_refuses(void) {
    tl_recorder_event_entry event;
    for (int round = 0; round < 3; round++) {
        for (int i = 0; i < TL_RECORDER_EVENTS; i++) {
            tl_recorder_event_fill(&event, i, TL_EVENT_INFO, "test", "text");
            TEST_ASSERT_TRUE(tl_recorder_events_put(&events, &event));
        }
        TEST_ASSERT_FALSE(tl_recorder_events_put(&events, &event));
        TEST_ASSERT_FALSE(tl_recorder_events_put(&events, &event));
        TEST_ASSERT_NULL(tl_recorder_events_peek(&events, TL_RECORDER_EVENTS));
        for (uint32_t i = 0; i < TL_RECORDER_EVENTS; i++) {
            TEST_ASSERT_EQUAL_INT64(i, tl_recorder_events_peek(&events, i)->tick);
        }
        tl_recorder_events_release(&events, 500);
        TEST_ASSERT_EQUAL_INT64(500, tl_recorder_events_peek(&events, 0)->tick);
        TEST_ASSERT_NULL(tl_recorder_events_peek(&events, 12));
        tl_recorder_events_release(&events, 12);
        TEST_ASSERT_NULL(tl_recorder_events_peek(&events, 0));
    }
}

static int64_t refused[THREADS];

static void *tell(void *context) {
    int64_t thread = (int64_t *)context - refused;
    char text[TL_EVENT_TEXT];
    tl_recorder_event_entry event;
    memset(text, 'a' + (int)thread, sizeof text - 1);
    text[sizeof text - 1] = '\0';
    for (int64_t i = 0; i < EACH; i++) {
        tl_recorder_event_fill(&event, thread * EACH + i, TL_EVENT_INFO, "test", text);
        refused[thread] += tl_recorder_events_put(&events, &event) ? 0 : 1;
    }
    return NULL;
}

/* Takes what is there; each thread's events come whole and in the thread's order. */
static int64_t take_events(int64_t last[THREADS]) {
    uint32_t count = 0;
    const tl_recorder_event_entry *event = NULL;
    while ((event = tl_recorder_events_peek(&events, count)) != NULL) {
        int64_t thread = event->tick / EACH;
        TEST_ASSERT_TRUE(event->tick % EACH > last[thread]);
        last[thread] = event->tick % EACH;
        TEST_ASSERT_EQUAL_INT('a' + (int)thread, event->text[0]);
        TEST_ASSERT_EQUAL_INT('a' + (int)thread, event->text[TL_EVENT_TEXT - 2]);
        count++;
    }
    tl_recorder_events_release(&events, count);
    return count;
}

static void test_many_threads_tell(void) {
    pthread_t threads[THREADS];
    int64_t last[THREADS];
    int64_t taken = 0;
    int64_t lost = 0;
    memset(refused, 0, sizeof refused);
    for (int i = 0; i < THREADS; i++) {
        last[i] = -1;
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, tell, &refused[i]));
    }
    for (int i = 0; i < 2000; i++) {
        taken += take_events(last);
        sched_yield();
    }
    for (int i = 0; i < THREADS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_join(threads[i], NULL));
        lost += refused[i];
    }
    taken += take_events(last);
    TEST_ASSERT_EQUAL_INT64((int64_t)THREADS * EACH, taken + lost);
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(TL_RECORDER_EVENTS, taken);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_capacity_is_rounded_up);
    RUN_TEST(test_a_full_ring_refuses_and_stays_whole);
    RUN_TEST(test_a_batch_that_failed_is_read_again);
    RUN_TEST(test_the_largest_entry_fits_its_size);
    RUN_TEST(test_one_thread_puts_another_takes);
    RUN_TEST(test_a_full_queue_refuses);
    RUN_TEST(test_many_threads_tell);
    return UNITY_END();
}
