/* Record queue: entries are read as they were put, lost ones are counted, and a successor
 * continues. */
#include <pthread.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/process/block.h"
#include "firmware/store/record_queue.h"
#include "tests/support/made_run.h"

enum { RING = 128 * 1024, CHECKPOINT = 10000, STORY = 20000, TELLERS = 4, TOLD = 5000 };

static const tl_record_queue_settings settings = {.shape = {.plant = TL_MADE_PLANT,
                                                            .match = TL_MADE_MATCH,
                                                            .adjust = TL_MADE_ADJUST,
                                                            .components = TL_MADE_COMPONENTS},
                                                  .ring_bytes = RING,
                                                  .checkpoint_bytes = CHECKPOINT};
static unsigned char *memory;
static tl_record_queue_taken taken;
static tl_record_queue queue;
static tl_record_queue_reader reader;
static tl_record_queue_start start;
static tl_recorder_entry entry;

static unsigned char *new_memory(const tl_record_queue_settings *of) {
    void *made = NULL;
    size_t size = tl_record_queue_bytes(of);
    TEST_ASSERT_EQUAL_INT(0, posix_memalign(&made, TL_RECORD_QUEUE_LINE, size));
    memset(made, 0, size);
    return made;
}

void setUp(void) {
    memory = new_memory(&settings);
    taken = (tl_record_queue_taken){0};
    memset(&start, 0, sizeof start);
    start.holds = true;
    start.resumption = (tl_resumption){.start = 1000, .started = 1700000000000};
    tl_record_queue_open(&settings, memory, &taken, &queue);
    tl_record_queue_reader_open(&settings, memory, &reader);
}

void tearDown(void) {
    free(memory);
}

/* ---- entries ---- */

static bool put_sample(int64_t tick) {
    tl_sample sample;
    tl_made_sample(tick, &sample);
    return tl_record_queue_put_sample(&queue, &sample);
}

static bool put_step(int64_t step) {
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    tl_made_record(step, &record);
    tl_made_ledger(step, ledger);
    return tl_record_queue_put_step(&queue, &record, ledger);
}

static bool put_both(int64_t tick) {
    return put_sample(tick) && put_step(tick);
}

/* Reads the next entry; false: there is none. */
static bool take(tl_recorder_kind kind) {
    uint64_t position = taken.ring;
    uint64_t end = tl_record_queue_reader_end(&reader, position);
    bool there = position != end && tl_record_queue_reader_entry(&reader, &position, end, &entry);
    TEST_ASSERT_EQUAL_STRING("", reader.fault);
    if (there) {
        TEST_ASSERT_EQUAL_INT(kind, entry.kind);
        __atomic_store_n(&taken.ring, position, __ATOMIC_RELEASE);
    }
    return there;
}

static void expect_nothing(void) {
    TEST_ASSERT_EQUAL_UINT64(taken.ring, tl_record_queue_reader_end(&reader, taken.ring));
    TEST_ASSERT_EQUAL_STRING("", reader.fault);
}

static void check_sample(int64_t tick, tl_time run_start) {
    tl_sample sample;
    tl_made_sample(tick, &sample);
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_SAMPLE, entry.kind);
    TEST_ASSERT_EQUAL_INT64(tick, entry.sample.tick);
    TEST_ASSERT_EQUAL_MEMORY(sample.values, entry.sample.values, TL_MADE_PLANT * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(sample.quality, entry.sample.quality, TL_MADE_PLANT);
    for (size_t i = 0; i < TL_MADE_PLANT; i++) {
        tl_time stamp = sample.stamps[i] == TL_TIME_NEVER ? TL_TIME_NEVER : sample.stamps[i] - run_start;
        TEST_ASSERT_EQUAL_INT64(stamp, entry.sample.stamps[i]);
    }
}

static void check_step(int64_t step) {
    tl_record record;
    tl_execution_counts ledger[TL_MADE_COMPONENTS];
    tl_made_record(step, &record);
    tl_made_ledger(step, ledger);
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
    TEST_ASSERT_EQUAL_MEMORY(record.measured, entry.record.measured, TL_MADE_MATCH * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(record.measured_quality, entry.record.measured_quality, TL_MADE_MATCH);
    TEST_ASSERT_EQUAL_MEMORY(record.readings, entry.record.readings, TL_MADE_MATCH * sizeof record.readings[0]);
    TEST_ASSERT_EQUAL_UINT32(record.release_age, entry.record.release_age);
    TEST_ASSERT_EQUAL_MEMORY(record.released, entry.record.released, TL_MADE_MATCH * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(record.u, entry.record.u, TL_MADE_ADJUST * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(record.nominal, entry.record.nominal, TL_MADE_ADJUST * sizeof(double));
    TEST_ASSERT_EQUAL_MEMORY(ledger, entry.ledger, sizeof ledger);
}

static void take_both(int64_t tick) {
    TEST_ASSERT_TRUE(take(TL_ENTRY_SAMPLE));
    check_sample(tick, start.resumption.start);
    TEST_ASSERT_TRUE(take(TL_ENTRY_STEP));
    check_step(tick);
}

static void expect_beginning(const tl_resumption *right, const tl_resumption *found) {
    TEST_ASSERT_EQUAL_INT(right->from, found->from);
    TEST_ASSERT_EQUAL_INT64(right->run, found->run);
    TEST_ASSERT_EQUAL_INT64(right->tick, found->tick);
    TEST_ASSERT_EQUAL_INT64(right->start, found->start);
    TEST_ASSERT_EQUAL_INT64(right->started, found->started);
}

static void a_run_is_read_as_it_was_put(void) {
    char fmus[TL_SHA256_TEXT] = "";
    start.holds = false;
    start.resumption = (tl_resumption){TL_RESUMED_CHECKPOINT, -1, 17, 12345, 1700000000000, 64800.0};
    start.account.components = 2;
    (void)strcpy(start.account.component[1].name, "plant");
    start.account.lead = 7;
    expect_nothing();
    memset(fmus, 'a', sizeof fmus - 1);
    tl_record_queue_name_fmus(&queue, fmus);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    for (int64_t tick = 0; tick < 10; tick++) {
        TEST_ASSERT_TRUE(put_both(tick));
    }
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "SIGTERM"));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    TEST_ASSERT_FALSE(entry.start.holds);
    expect_beginning(&start.resumption, &entry.start.resumption);
    TEST_ASSERT_EQUAL_MEMORY(&start.account, &entry.start.account, sizeof start.account);
    TEST_ASSERT_EQUAL_STRING(fmus, entry.start.fmus);
    for (int64_t tick = 0; tick < 10; tick++) {
        take_both(tick);
    }
    TEST_ASSERT_TRUE(take(TL_ENTRY_END));
    TEST_ASSERT_EQUAL_STRING("SIGTERM", entry.reason);
    expect_nothing();
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_lost(&queue));
}

static tl_run_tuning tuning_of(int64_t tick) {
    tl_run_tuning tuning;
    memset(&tuning, 0, sizeof tuning);
    tuning.tick = tick;
    tuning.number = (uint32_t)tick * 2;
    memset(tuning.hash, 'a' + (int)(tick % 6), sizeof tuning.hash - 1);
    tuning.values.match[0].tolerance = (double)tick;
    tuning.values.time = tick;
    return tuning;
}

static void expect_tuning(int64_t tick) {
    tl_run_tuning wanted = tuning_of(tick);
    TEST_ASSERT_EQUAL_MEMORY(&wanted, &entry.tuning, sizeof wanted);
}

/* The configuration of a run is part of its start. A tuning comes before the sample of its tick. */
static void tunings_keep_their_order(void) {
    tl_run_tuning configured = tuning_of(1);
    tl_run_tuning taken_one = tuning_of(5);
    start.holds = false;
    TEST_ASSERT_EQUAL_STRING("", tl_record_queue_tuning(&queue)->hash);
    tl_record_queue_name_configuration(&queue, &configured);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_EQUAL_MEMORY(&configured, tl_record_queue_tuning(&queue), sizeof configured);
    TEST_ASSERT_TRUE(put_both(4));
    TEST_ASSERT_TRUE(tl_record_queue_has_room_for_tuning(&queue));
    TEST_ASSERT_TRUE(tl_record_queue_put_tuning(&queue, &taken_one));
    TEST_ASSERT_TRUE(put_both(5));
    TEST_ASSERT_EQUAL_MEMORY(&taken_one, tl_record_queue_tuning(&queue), sizeof taken_one);
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    TEST_ASSERT_EQUAL_MEMORY(&configured, &entry.start.configured, sizeof configured);
    take_both(4);
    TEST_ASSERT_TRUE(take(TL_ENTRY_TUNING));
    expect_tuning(5);
    take_both(5);
    expect_nothing();
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start)); /* starts as configured */
    TEST_ASSERT_EQUAL_MEMORY(&configured, tl_record_queue_tuning(&queue), sizeof configured);
}

/* A caller that checks the room first does not lose a tuning. */
static void a_full_ring_has_no_room_for_a_tuning(void) {
    tl_run_tuning tuning = tuning_of(3);
    int64_t tick = 0;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    while (tl_record_queue_has_room_for_tuning(&queue)) {
        TEST_ASSERT_TRUE(tl_record_queue_put_tuning(&queue, &tuning));
        TEST_ASSERT_TRUE(put_both(tick++));
    }
    TEST_ASSERT_TRUE(tick > 10);
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_lost(&queue));
    while (tl_record_queue_put_tuning(&queue, &tuning)) {
        tick++;
    }
    TEST_ASSERT_EQUAL_UINT64(1, tl_record_queue_lost(&queue));
}

static void a_run_that_holds_has_no_account(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    TEST_ASSERT_TRUE(entry.start.holds);
    TEST_ASSERT_EQUAL_UINT64(tl_recorder_entry_size_of_start(true), taken.ring);
}

static void a_long_reason_is_cut(void) {
    char reason[2 * TL_RECORDER_REASON];
    memset(reason, 'x', sizeof reason - 1);
    reason[0] = '\n';
    reason[sizeof reason - 1] = '\0';
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, reason));
    TEST_ASSERT_TRUE(take(TL_ENTRY_END));
    TEST_ASSERT_EQUAL_size_t(TL_RECORDER_REASON - 1, strlen(entry.reason));
    TEST_ASSERT_EQUAL_INT('?', entry.reason[0]);
    TEST_ASSERT_EQUAL_INT('x', entry.reason[TL_RECORDER_REASON - 2]);
}

static void a_ring_wraps_many_times(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    for (int64_t tick = 0; tick < STORY; tick++) {
        TEST_ASSERT_TRUE(put_both(tick));
        take_both(tick);
    }
    TEST_ASSERT_GREATER_THAN_UINT64(20 * RING, taken.ring);
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_lost(&queue));
}

/* Positions exceed 2^32 also on a 32-bit machine. */
static void positions_do_not_wrap(void) {
    taken.ring = queue.control->head = UINT64_C(0xFFFFFFFF) - RING / 2;
    tl_record_queue_open(&settings, memory, &taken, &queue);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    for (int64_t tick = 0; tick < 1000; tick++) {
        TEST_ASSERT_TRUE(put_both(tick));
        take_both(tick);
    }
    TEST_ASSERT_GREATER_THAN_UINT64(UINT32_MAX, taken.ring);
}

static void stamps_that_are_too_far_away_do_not_wrap(void) {
    tl_sample sample;
    tl_made_sample(5, &sample);
    sample.stamps[0] = TL_TIME_NEVER;
    sample.stamps[1] = TL_TIME_NEVER + 1;
    sample.stamps[2] = INT64_MAX;
    start.resumption.start = 1000;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && tl_record_queue_put_sample(&queue, &sample));
    start.resumption.start = -1000;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && tl_record_queue_put_sample(&queue, &sample));
    TEST_ASSERT_TRUE(put_step(5));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START) && take(TL_ENTRY_SAMPLE));
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, entry.sample.stamps[0]);
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER + 1, entry.sample.stamps[1]);
    TEST_ASSERT_EQUAL_INT64(INT64_MAX - 1000, entry.sample.stamps[2]);
    TEST_ASSERT_TRUE(take(TL_ENTRY_START) && take(TL_ENTRY_SAMPLE));
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER + 1001, entry.sample.stamps[1]);
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, entry.sample.stamps[2]);
}

/* ---- room ---- */

static void a_ring_is_large_enough_and_bounded(void) {
    const tl_recorder_shape full = {
        .plant = TL_MAX_SIGNALS, .match = TL_MAX_MATCH, .adjust = TL_MAX_ADJUST, .components = TL_RECORDER_COMPONENTS};
    size_t each = tl_recorder_entry_size(&settings.shape, TL_ENTRY_SAMPLE) +
                  tl_recorder_entry_size(&settings.shape, TL_ENTRY_STEP);
    TEST_ASSERT_EQUAL_size_t(256 * 1024, tl_record_queue_ring_bytes(&settings.shape, TL_SECOND));
    TEST_ASSERT_EQUAL_size_t(16 * 1024 * 1024, tl_record_queue_ring_bytes(&full, 1));
    TEST_ASSERT_EQUAL_size_t(16 * 1024 * 1024, tl_record_queue_ring_bytes(&full, TL_SECOND / 1000));
    for (tl_time step = TL_SECOND / 1000; step <= TL_SECOND; step += TL_SECOND / 1000) {
        size_t ring = tl_record_queue_ring_bytes(&settings.shape, step);
        uint64_t ticks = (uint64_t)(30 * TL_SECOND / step);
        ticks += step >= TL_SECOND / 200 ? (uint64_t)(20 * TL_SECOND / step) : 4000;
        TEST_ASSERT_EQUAL_size_t(0, ring & (ring - 1));
        TEST_ASSERT_TRUE(ring >= ticks * each);
    }
}

static void a_full_ring_refuses_and_counts(void) {
    int64_t put = 0;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    while (put_both(put)) {
        put++;
    }
    uint64_t lost = tl_record_queue_lost(&queue);
    TEST_ASSERT_EQUAL_UINT64(1, lost);
    TEST_ASSERT_EQUAL_UINT64(1, tl_record_queue_reader_lost(&reader));
    for (int i = 0; i < 5; i++) {
        TEST_ASSERT_FALSE(put_step(put) && put_step(put));
    }
    TEST_ASSERT_FALSE(tl_record_queue_put_end(&queue, "full"));
    TEST_ASSERT_GREATER_THAN_UINT64(lost + 5, tl_record_queue_lost(&queue));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(0);
    take_both(1);
    TEST_ASSERT_TRUE(put_both(put));
}

/* Read entries that a successor could use are overwritten by new ones. */
static void kept_entries_make_room_for_new_ones(void) {
    int64_t put = 0;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    tl_record_queue_put_checkpoint(&queue, -1, 0);
    while (put_both(put)) {
        put++;
    }
    TEST_ASSERT_GREATER_THAN_INT64(RING / 411 - 13, put);
}

static void a_start_without_room_is_put_first_later(void) {
    int64_t put = 0;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    while (put_both(put)) {
        put++;
    }
    start.resumption.start = 77;
    start.holds = false;
    uint64_t lost = tl_record_queue_lost(&queue);
    TEST_ASSERT_FALSE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_EQUAL_UINT64(lost, tl_record_queue_lost(&queue));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    start.resumption.start = 1000;
    take_both(0);
    take_both(1);
    TEST_ASSERT_FALSE(put_sample(1)); /* refused, because the start does not fit */
    TEST_ASSERT_FALSE(put_step(1));
    TEST_ASSERT_EQUAL_UINT64(lost + 2, tl_record_queue_lost(&queue));
    for (int64_t tick = 2; tick < put; tick++) {
        take_both(tick);
    }
    while (tl_record_queue_reader_end(&reader, taken.ring) != taken.ring) {
        (void)take(TL_ENTRY_SAMPLE);
    }
    TEST_ASSERT_TRUE(put_both(2));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    TEST_ASSERT_EQUAL_INT64(77, entry.start.resumption.start);
    TEST_ASSERT_TRUE(take(TL_ENTRY_SAMPLE));
    check_sample(2, 77);
    TEST_ASSERT_TRUE(take(TL_ENTRY_STEP));
    expect_nothing();
}

/* A position slightly after the end is valid, because the reader skips damaged entries. */
static void a_reader_with_an_invalid_position(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    taken.ring = queue.written + 1;
    TEST_ASSERT_TRUE(put_sample(0));
    taken.ring = UINT64_MAX / 2;
    TEST_ASSERT_FALSE(put_sample(0));
    taken.events = 1;
    tl_record_queue_event(&queue, 1, TL_EVENT_INFO, "test", "text");
    TEST_ASSERT_EQUAL_UINT64(2, tl_record_queue_lost(&queue));
}

static void *take_a_bit_later(void *context) {
    tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 50);
    __atomic_store_n(&taken.ring, *(uint64_t *)context, __ATOMIC_RELEASE);
    return NULL;
}

static void waiting_for_room(void) {
    pthread_t thread;
    int64_t put = 0;
    tl_time now = tl_clock_now(NULL);
    TEST_ASSERT_TRUE(tl_record_queue_wait_for_room(&queue, 0));
    while (put_both(put)) {
        put++;
    }
    uint64_t written = queue.written;
    start.holds = false; /* does not fit */
    TEST_ASSERT_FALSE(tl_record_queue_wait_for_room(&queue, now));
    TEST_ASSERT_FALSE(tl_record_queue_wait_for_room(&queue, tl_clock_now(NULL) + TL_SECOND / 100));
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(now + TL_SECOND / 100, tl_clock_now(NULL));
    TEST_ASSERT_FALSE(tl_record_queue_put_start(&queue, &start));
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, take_a_bit_later, &written));
    TEST_ASSERT_TRUE(tl_record_queue_wait_for_room(&queue, tl_clock_now(NULL) + 20 * TL_SECOND));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_TRUE(put_both(put) && tl_record_queue_put_end(&queue, "over"));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
}

/* ---- events ---- */

static bool take_event(tl_recorder_event_entry *event) {
    bool skip = false;
    bool there = tl_record_queue_reader_event(&reader, taken.events, event, &skip);
    TEST_ASSERT_EQUAL_STRING("", reader.fault);
    TEST_ASSERT_FALSE(there && skip);
    __atomic_store_n(&taken.events, taken.events + (there ? 1 : 0), __ATOMIC_RELEASE);
    return there;
}

static void events_come_in_order_and_a_full_queue_counts(void) {
    tl_recorder_event_entry event;
    TEST_ASSERT_FALSE(take_event(&event));
    for (int round = 0; round < 3; round++) {
        for (int i = 0; i < TL_RECORDER_EVENTS + 2; i++) {
            tl_record_queue_event(&queue, i, TL_EVENT_WARNING, "source", "te\nxt");
        }
        TEST_ASSERT_EQUAL_UINT64(2 * (uint64_t)(round + 1), tl_record_queue_lost(&queue));
        for (int i = 0; i < TL_RECORDER_EVENTS; i++) {
            TEST_ASSERT_TRUE(take_event(&event));
            TEST_ASSERT_EQUAL_INT64(i, event.tick);
            TEST_ASSERT_EQUAL_INT(TL_EVENT_WARNING, event.severity);
            TEST_ASSERT_EQUAL_STRING("source", event.source);
            TEST_ASSERT_EQUAL_STRING("te?xt", event.text);
        }
        TEST_ASSERT_FALSE(take_event(&event));
    }
}

/* Each event has the position of the entry before it. */
static void events_have_a_position_among_entries(void) {
    tl_recorder_event_entry event;
    for (int64_t tick = 0; tick < 4; tick++) {
        tl_record_queue_event(&queue, tick, TL_EVENT_INFO, "test", "text");
        TEST_ASSERT_TRUE(tick > 2 || put_both(tick));
    }
    uint64_t pair = queue.written / 3;
    queue.ring[2 * pair] = 0; /* damages the third pair, so that it is dropped */
    tl_record_queue_open(&settings, memory, &taken, &queue);
    for (uint64_t tick = 0; tick < 4; tick++) {
        TEST_ASSERT_TRUE(take_event(&event));
        TEST_ASSERT_EQUAL_INT64(tick, event.tick);
        TEST_ASSERT_EQUAL_UINT64(tick < 2 ? tick * pair : 2 * pair, event.position);
    }
}

/* A queue of events only. */
static void a_queue_without_a_ring(void) {
    const tl_record_queue_settings bare = {.ring_bytes = 0};
    tl_recorder_event_entry event;
    free(memory);
    memory = new_memory(&bare);
    tl_record_queue_open(&bare, memory, &taken, &queue);
    tl_record_queue_reader_open(&bare, memory, &reader);
    tl_record_queue_event(&queue, -1, TL_EVENT_ERROR, "supervisor", "text");
    TEST_ASSERT_TRUE(take_event(&event));
    TEST_ASSERT_FALSE(tl_record_queue_put_end(&queue, "no room"));
    TEST_ASSERT_EQUAL_UINT64(1, tl_record_queue_lost(&queue));
    TEST_ASSERT_FALSE(tl_record_queue_reserve_checkpoint(&queue, 1));
    size_t capacity = 1;
    TEST_ASSERT_NULL(tl_record_queue_checkpoint_room(&queue, &capacity));
    expect_nothing();
}

/* The writer died after it took the event's number and before it wrote the event. */
static void a_half_written_event_waits_for_a_successor(void) {
    tl_recorder_event_entry event;
    bool skip = false;
    tl_record_queue_event(&queue, 0, TL_EVENT_INFO, "test", "before");
    queue.control->next++;
    tl_record_queue_event(&queue, 2, TL_EVENT_INFO, "test", "behind");
    TEST_ASSERT_TRUE(take_event(&event));
    TEST_ASSERT_FALSE(take_event(&event));
    tl_record_queue_open(&settings, memory, &taken, &queue);
    TEST_ASSERT_TRUE(tl_record_queue_reader_event(&reader, 1, &event, &skip) && skip);
    taken.events = 2;
    TEST_ASSERT_TRUE(take_event(&event));
    TEST_ASSERT_EQUAL_STRING("behind", event.text);
    tl_record_queue_open(&settings, memory, &taken, &queue);
    tl_record_queue_event(&queue, 3, TL_EVENT_INFO, "test", "later");
    TEST_ASSERT_TRUE(take_event(&event));
    TEST_ASSERT_EQUAL_STRING("later", event.text);
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_lost(&queue));
}

/* ---- checkpoints ---- */

static void fill(unsigned char *bytes, size_t size, int64_t tick) {
    for (size_t i = 0; i < size; i++) {
        bytes[i] = (unsigned char)((uint64_t)tick * 7 + i * 31 + (i >> 8));
    }
}

static bool is_filled(const unsigned char *bytes, size_t size, int64_t tick) {
    unsigned char right[CHECKPOINT];
    fill(right, size, tick);
    return memcmp(bytes, right, size) == 0;
}

static void put_checkpoint(int64_t tick, size_t size) {
    size_t capacity = 0;
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT));
    unsigned char *room = tl_record_queue_checkpoint_room(&queue, &capacity);
    TEST_ASSERT_NOT_NULL(room);
    TEST_ASSERT_EQUAL_size_t(CHECKPOINT, capacity);
    fill(room, size, tick);
    tl_record_queue_put_checkpoint(&queue, tick, size);
}

/* Returns the checkpoint's tick, or INT64_MIN if there is none. */
static int64_t take_checkpoint(uint64_t position) {
    unsigned char bytes[CHECKPOINT];
    size_t size = 0;
    int64_t tick = 0;
    uint64_t number = 0;
    bool there = tl_record_queue_reader_checkpoint(&reader, taken.checkpoint, position, bytes, &size, &tick, &number);
    TEST_ASSERT_EQUAL_STRING("", reader.fault);
    if (!there) {
        return INT64_MIN;
    }
    TEST_ASSERT_TRUE(is_filled(bytes, size, tick));
    TEST_ASSERT_GREATER_THAN_UINT64(taken.checkpoint, number);
    __atomic_store_n(&taken.checkpoint, number, __ATOMIC_RELEASE);
    return tick;
}

static void checkpoints_are_read_after_their_entries(void) {
    size_t capacity = 1;
    TEST_ASSERT_NULL(tl_record_queue_checkpoint_room(&queue, &capacity));
    TEST_ASSERT_FALSE(tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT + 1));
    TEST_ASSERT_EQUAL_INT64(INT64_MIN, take_checkpoint(0));
    put_checkpoint(1, 9999);
    uint64_t first = queue.written;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    put_checkpoint(2, 1);
    uint64_t second = queue.written;
    TEST_ASSERT_EQUAL_INT64(1, take_checkpoint(first));
    TEST_ASSERT_EQUAL_INT64(INT64_MIN, take_checkpoint(second - 1));
    TEST_ASSERT_EQUAL_INT64(2, take_checkpoint(second));
    TEST_ASSERT_EQUAL_INT64(INT64_MIN, take_checkpoint(second));
    put_checkpoint(3, CHECKPOINT);
    put_checkpoint(4, 8);
    TEST_ASSERT_EQUAL_INT64(3, take_checkpoint(second)); /* a run may start with it */
    TEST_ASSERT_EQUAL_INT64(4, take_checkpoint(second));
    tl_record_queue_put_checkpoint(&queue, 5, 0); /* the twin cannot be saved */
    TEST_ASSERT_EQUAL_INT64(INT64_MIN, take_checkpoint(second));
}

/* Otherwise it would belong to the run before. */
static void a_checkpoint_comes_after_a_waiting_start(void) {
    int64_t put = 0;
    while (put_both(put)) {
        put++;
    }
    uint64_t full = queue.written;
    start.holds = false;
    TEST_ASSERT_FALSE(tl_record_queue_put_start(&queue, &start));
    put_checkpoint(7, 100);
    taken.ring = full;
    TEST_ASSERT_EQUAL_INT64(INT64_MIN, take_checkpoint(full));
    TEST_ASSERT_TRUE(put_sample(8));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    TEST_ASSERT_EQUAL_INT64(7, take_checkpoint(taken.ring));
}

/* The writer does not wait for a reader that reads no checkpoints. */
static void the_two_newest_checkpoints_are_kept(void) {
    tl_record_queue_saved left;
    for (int64_t tick = 1; tick < 20; tick++) {
        put_checkpoint(tick, 100 + (size_t)tick);
        TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
        TEST_ASSERT_EQUAL_INT64(tick, left.tick);
        TEST_ASSERT_EQUAL_size_t(100 + (size_t)tick, left.size);
        TEST_ASSERT_TRUE(is_filled(left.bytes, left.size, left.tick));
        TEST_ASSERT_EQUAL_INT(tick > 1, tl_record_queue_saved_checkpoint(&queue, 1, &left));
        TEST_ASSERT_TRUE(tick == 1 || left.tick == tick - 1);
        TEST_ASSERT_FALSE(tl_record_queue_saved_checkpoint(&queue, 2, &left));
    }
}

static unsigned char *bytes_of(int64_t tick) {
    tl_record_queue_saved left;
    unsigned which = tl_record_queue_saved_checkpoint(&queue, 0, &left) && left.tick == tick ? 0 : 1;
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, which, &left));
    TEST_ASSERT_EQUAL_INT64(tick, left.tick);
    return memory + (left.bytes - memory);
}

static void a_damaged_checkpoint_is_ignored(void) {
    tl_record_queue_saved left;
    put_checkpoint(1, 5000);
    put_checkpoint(2, 5000);
    bytes_of(2)[4999] ^= 1;
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
    TEST_ASSERT_EQUAL_INT64(1, left.tick);
    TEST_ASSERT_FALSE(tl_record_queue_saved_checkpoint(&queue, 1, &left));
    TEST_ASSERT_EQUAL_INT64(1, take_checkpoint(0));
    TEST_ASSERT_EQUAL_INT64(INT64_MIN, take_checkpoint(0));
    tl_record_queue_open(&settings, memory, &taken, &queue); /* keeps the undamaged one */
    put_checkpoint(3, 5000);
    TEST_ASSERT_EQUAL_INT64(3, take_checkpoint(0));
    bytes_of(1)[0] ^= 0x80;
    TEST_ASSERT_FALSE(tl_record_queue_saved_checkpoint(&queue, 1, &left));
    queue.control->places[1].mark[0] ^= 4; /* its tick */
    queue.control->places[0].mark[0] ^= 4;
    TEST_ASSERT_FALSE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
}

/* A checkpoint is damaged after the reader has read it: its number is not used again. */
static void the_number_of_a_read_checkpoint_is_not_reused(void) {
    tl_record_queue_saved left;
    put_checkpoint(1, 100);
    put_checkpoint(2, 100);
    TEST_ASSERT_EQUAL_INT64(1, take_checkpoint(0));
    TEST_ASSERT_EQUAL_INT64(2, take_checkpoint(0));
    bytes_of(2)[0] ^= 1;
    tl_record_queue_open(&settings, memory, &taken, &queue);
    put_checkpoint(3, 100);
    TEST_ASSERT_EQUAL_INT64(3, take_checkpoint(0));
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 1, &left));
    TEST_ASSERT_EQUAL_INT64(1, left.tick);
}

/* ---- a successor ---- */

static void succeed(void) {
    memset(&queue, 0xA5, sizeof queue);
    tl_record_queue_open(&settings, memory, &taken, &queue);
}

static void expect_left(uint64_t *position, int64_t tick) {
    TEST_ASSERT_TRUE(tl_record_queue_saved_entry(&queue, position, &entry));
    check_sample(tick, start.resumption.start);
    TEST_ASSERT_TRUE(tl_record_queue_saved_entry(&queue, position, &entry));
    check_step(tick);
}

static void a_successor_finds_checkpoints_and_entries(void) {
    tl_record_queue_saved left;
    start.resumption = (tl_resumption){TL_RESUMED_START, 12, 34, 5600, 1700000000001, 0.0};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    for (int64_t tick = 0; tick < 30; tick++) {
        TEST_ASSERT_TRUE(put_both(tick));
        if (tick % 10 == 9) {
            put_checkpoint(tick, 1000);
        }
    }
    TEST_ASSERT_TRUE(put_sample(30));
    taken.ring = queue.published; /* all entries are read */
    queue.ring[queue.written % RING] = 0xB5;
    succeed();
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
    TEST_ASSERT_EQUAL_INT64(29, left.tick);
    expect_beginning(&start.resumption, &left.beginning);
    TEST_ASSERT_TRUE(tl_record_queue_saved_entry(&queue, &left.position, &entry));
    check_sample(30, 5600);
    TEST_ASSERT_FALSE(tl_record_queue_saved_entry(&queue, &left.position, &entry));
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 1, &left));
    TEST_ASSERT_TRUE(is_filled(left.bytes, left.size, 19));
    for (int64_t tick = 20; tick < 30; tick++) {
        expect_left(&left.position, tick);
    }
    TEST_ASSERT_TRUE(tl_record_queue_saved_entry(&queue, &left.position, &entry));
    TEST_ASSERT_FALSE(tl_record_queue_saved_entry(&queue, &left.position, &entry));
    expect_nothing();
}

/* A checkpoint has the tuning that was active when it was made. */
static void a_checkpoint_has_the_active_tuning(void) {
    tl_record_queue_saved left;
    tl_run_tuning configured = tuning_of(1);
    tl_run_tuning wanted = tuning_of(7);
    start.holds = false;
    tl_record_queue_name_configuration(&queue, &configured);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(0));
    put_checkpoint(0, 1000);
    TEST_ASSERT_TRUE(tl_record_queue_put_tuning(&queue, &wanted) && put_both(1));
    put_checkpoint(1, 1000);
    succeed();
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
    TEST_ASSERT_EQUAL_MEMORY(&wanted, &left.tuning, sizeof wanted);
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 1, &left));
    TEST_ASSERT_EQUAL_MEMORY(&configured, &left.tuning, sizeof configured);
    TEST_ASSERT_TRUE(tl_record_queue_saved_entry(&queue, &left.position, &entry));
    TEST_ASSERT_EQUAL_INT(TL_ENTRY_TUNING, entry.kind);
    expect_tuning(7);
}

static void a_twin_that_cannot_be_saved_leaves_its_entries(void) {
    tl_record_queue_saved left;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(0));
    tl_record_queue_put_checkpoint(&queue, 0, 0);
    TEST_ASSERT_TRUE(put_both(1));
    succeed();
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
    TEST_ASSERT_EQUAL_size_t(0, left.size);
    expect_left(&left.position, 1);
}

static void overwritten_entries_are_not_found(void) {
    tl_record_queue_saved left;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    put_checkpoint(-1, 10);
    int64_t tick = 0;
    while (tl_record_queue_saved_checkpoint(&queue, 0, &left)) {
        uint64_t position = left.position;
        /* a dead writer may have half-written one more entry of the largest size */
        TEST_ASSERT_TRUE(queue.written - position <= RING - tl_recorder_entry_largest(&settings.shape));
        TEST_ASSERT_TRUE(put_both(tick++));
        taken.ring = queue.written;
        TEST_ASSERT_TRUE(!tl_record_queue_saved_checkpoint(&queue, 0, &left) ||
                         tl_record_queue_saved_entry(&queue, &position, &entry));
    }
    TEST_ASSERT_GREATER_THAN_UINT64(RING / 2, queue.written - left.position);
    TEST_ASSERT_FALSE(tl_record_queue_saved_entry(&queue, &left.position, &entry));
    uint64_t beyond = queue.written + 1;
    TEST_ASSERT_FALSE(tl_record_queue_saved_entry(&queue, &beyond, &entry));
}

/* An unread entry is damaged: the successor keeps the entries before it. */
static void a_successor_drops_damaged_entries(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(0));
    uint64_t damaged = queue.written;
    TEST_ASSERT_TRUE(put_both(1) && put_both(2));
    queue.ring[damaged] = 0;
    succeed();
    TEST_ASSERT_EQUAL_UINT64(damaged, queue.written);
    TEST_ASSERT_EQUAL_UINT64(1, tl_record_queue_lost(&queue));
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(3));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(0);
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(3);
    queue.control->head += 2 * RING;
    queue.control->next += 2 * TL_RECORDER_EVENTS;
    succeed();
    TEST_ASSERT_EQUAL_UINT64(3, tl_record_queue_lost(&queue));
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(4));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(4);
}

/* The end position is damaged. */
static void an_end_before_the_read_entries(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(0) && take(TL_ENTRY_START));
    take_both(0);
    queue.control->head -= 10;
    succeed();
    expect_nothing();
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(1));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(1);
}

/* The damaged end is inside an entry. */
static void an_end_within_an_entry(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(0));
    queue.control->head -= 10;
    succeed();
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(0);
    expect_nothing();
}

/* Entries before a dropped one that may be overwritten are not found. */
static void an_earlier_end_finds_no_older_entries(void) {
    tl_record_queue_saved left;
    put_checkpoint(-1, 10);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    int64_t tick = 0;
    while (tl_record_queue_saved_checkpoint(&queue, 0, &left)) {
        taken.ring = queue.written;
        TEST_ASSERT_TRUE(put_both(tick++));
    }
    queue.ring[taken.ring % RING] = 0;
    succeed();
    TEST_ASSERT_EQUAL_UINT64(taken.ring, queue.written);
    TEST_ASSERT_FALSE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
}

/* ---- complete ticks ---- */

static void a_sample_waits_for_its_step(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && take(TL_ENTRY_START));
    TEST_ASSERT_TRUE(put_sample(0));
    expect_nothing();
    TEST_ASSERT_TRUE(put_step(0));
    take_both(0);
    TEST_ASSERT_TRUE(put_sample(1)); /* without a step */
    expect_nothing();
    TEST_ASSERT_TRUE(put_sample(2));
    TEST_ASSERT_TRUE(take(TL_ENTRY_SAMPLE));
    check_sample(1, start.resumption.start);
    expect_nothing();
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&queue, "SIGTERM"));
    TEST_ASSERT_TRUE(take(TL_ENTRY_SAMPLE) && take(TL_ENTRY_END));
}

/* Either the sample and its step fit, or neither. */
static void a_tick_fits_completely_or_not_at_all(void) {
    int64_t put = 0;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
    while (put_sample(put)) {
        TEST_ASSERT_TRUE(put_step(put));
        put++;
    }
    TEST_ASSERT_EQUAL_UINT64(1, tl_record_queue_lost(&queue));
}

/* The writer of a run dies in the step of tick 5. The entries before are read. */
static void die_in_a_step(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && take(TL_ENTRY_START));
    for (int64_t tick = 0; tick < 5; tick++) {
        TEST_ASSERT_TRUE(put_both(tick));
        take_both(tick);
    }
    TEST_ASSERT_TRUE(put_sample(5));
    memset(&queue, 0xA5, sizeof queue);
    tl_record_queue_open(&settings, memory, &taken, &queue);
    expect_nothing();
}

/* The successor starts another run, with `tick` as its first tick. */
static void begin_another(tl_resumed_from from, int64_t tick) {
    start.resumption.from = from;
    start.resumption.tick = tick;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
}

static void a_successor_that_resumes_puts_the_sample_again(void) {
    die_in_a_step();
    begin_another(TL_RESUMED_CHECKPOINT, 5);
    TEST_ASSERT_TRUE(put_both(5));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(5);
    expect_nothing();
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_lost(&queue));
}

/* A successor that dies before it starts a run changes nothing. */
static void the_second_successor_puts_the_sample_again(void) {
    die_in_a_step();
    tl_record_queue_open(&settings, memory, &taken, &queue);
    begin_another(TL_RESUMED_START, 5);
    TEST_ASSERT_TRUE(put_both(5) && take(TL_ENTRY_START));
    take_both(5);
}

static void a_new_run_leaves_the_sample_to_the_run_before(void) {
    die_in_a_step();
    begin_another(TL_RESUMED_NOT, 0);
    TEST_ASSERT_TRUE(take(TL_ENTRY_SAMPLE));
    check_sample(5, start.resumption.start);
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    expect_nothing();
}

/* In mode ahead, the checkpoint was made after the twin got the sample. */
static void a_run_that_resumes_after_the_sample_leaves_it(void) {
    tl_record_queue_saved left;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(4) && put_sample(5));
    put_checkpoint(5, 100);
    tl_record_queue_open(&settings, memory, &taken, &queue);
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
    TEST_ASSERT_EQUAL_INT64(5, left.tick);
    TEST_ASSERT_FALSE(tl_record_queue_saved_entry(&queue, &left.position, &entry));
    begin_another(TL_RESUMED_CHECKPOINT, 6);
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(4);
    TEST_ASSERT_TRUE(take(TL_ENTRY_SAMPLE) && take(TL_ENTRY_START));
}

/* A checkpoint after a dropped sample is dropped, too. */
static void a_checkpoint_is_dropped_with_its_sample(void) {
    tl_record_queue_saved left;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start) && put_both(4) && put_sample(5));
    put_checkpoint(5, 100);
    tl_record_queue_open(&settings, memory, &taken, &queue);
    begin_another(TL_RESUMED_START, 5);
    TEST_ASSERT_TRUE(put_both(5) && put_both(6));
    TEST_ASSERT_FALSE(tl_record_queue_saved_checkpoint(&queue, 0, &left));
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(4);
    TEST_ASSERT_TRUE(take(TL_ENTRY_START));
    take_both(5);
    take_both(6);
}

/* ---- no reader ---- */

static void without_a_reader_a_successor_finds_all(void) {
    tl_record_queue_saved left;
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start)); /* the first writer has a reader */
    for (int life = 0; life < 3; life++) {
        memset(&queue, 0xA5, sizeof queue);
        tl_record_queue_open(&settings, memory, NULL, &queue);
        TEST_ASSERT_TRUE(life == 0 || tl_record_queue_saved_checkpoint(&queue, 0, &left));
        TEST_ASSERT_TRUE(life == 0 || left.tick == 995);
        for (int64_t tick = 996; life > 0 && tick < 1000; tick++) {
            expect_left(&left.position, tick);
        }
        TEST_ASSERT_TRUE(tl_record_queue_put_start(&queue, &start));
        for (int64_t tick = 0; tick < 1000; tick++) {
            TEST_ASSERT_TRUE(tl_record_queue_wait_for_room(&queue, 0) && put_both(tick));
            tl_record_queue_event(&queue, tick, TL_EVENT_INFO, "test", "text");
            if (tick % 5 == 0) {
                put_checkpoint(tick, 100);
            }
        }
    }
    TEST_ASSERT_GREATER_THAN_UINT64(9 * RING, queue.written);
    TEST_ASSERT_EQUAL_UINT64(0, tl_record_queue_lost(&queue));
    TEST_ASSERT_EQUAL_UINT64(0, queue.control->next);
}

/* ---- unused memory ---- */

static tl_block block;

static void use_block(const tl_record_queue_settings *large) {
    free(memory);
    memory = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_block_make("outbox", tl_record_queue_bytes(large), TL_BLOCK_WE_WRITE, &block, NULL));
    tl_record_queue_open(large, block.bytes, &taken, &queue);
}

/* Lets the kernel read the byte, so that a fault is no crash. */
static bool can_be_read(const unsigned char *byte) {
    int ends[2];
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    bool can = write(ends[1], byte, 1) == 1;
    (void)close(ends[0]);
    (void)close(ends[1]);
    return can;
}

static unsigned char *byte_of(unsigned place, size_t offset) {
    return (unsigned char *)block.bytes + tl_record_queue_checkpoint_at(&queue.settings, place) + offset;
}

static void unused_memory_cannot_be_accessed(void) {
    tl_record_queue_settings large = settings;
    tl_record_queue_saved left;
    large.checkpoint_bytes = 100000;
    use_block(&large);
    put_checkpoint(1, 5000);
    put_checkpoint(2, 5000);
    byte_of(1, 10)[0] ^= 1; /* in tick 1 */
    tl_record_queue_open(&large, block.bytes, &taken, &queue);
    tl_record_queue_hide_unused(&queue);
    TEST_ASSERT_TRUE(can_be_read(byte_of(0, 8191)));
    TEST_ASSERT_FALSE(can_be_read(byte_of(0, 8192)));
    TEST_ASSERT_FALSE(can_be_read(byte_of(1, 0)));
    TEST_ASSERT_FALSE(can_be_read(byte_of(2, 0)));
    TEST_ASSERT_FALSE(can_be_read(byte_of(2, 99999)));
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left) && is_filled(left.bytes, left.size, 2));
    TEST_ASSERT_FALSE(tl_record_queue_saved_checkpoint(&queue, 1, &left)); /* inaccessible */
    put_checkpoint(3, CHECKPOINT);
    TEST_ASSERT_TRUE(can_be_read(byte_of(0, 12287)) && can_be_read(byte_of(1, 12287)));
    TEST_ASSERT_FALSE(can_be_read(byte_of(1, 12288)));
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&queue, 100000));
    TEST_ASSERT_TRUE(can_be_read(byte_of(1, 99999)));
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 0, &left) && is_filled(left.bytes, left.size, 3));
    TEST_ASSERT_TRUE(tl_record_queue_saved_checkpoint(&queue, 1, &left) && is_filled(left.bytes, left.size, 2));
    tl_block_close(&block);
}

/* ---- threads ---- */

static int64_t newest[TELLERS];

static void *put_events(void *context) {
    int64_t teller = (int64_t *)context - newest;
    char text[TL_EVENT_TEXT];
    memset(text, 'a' + (int)teller, sizeof text - 1);
    text[sizeof text - 1] = '\0';
    for (int64_t i = 0; i < TOLD; i++) {
        tl_record_queue_event(&queue, teller * TOLD + i, TL_EVENT_INFO, "test", text);
        if (i % 64 == 0) {
            (void)sched_yield();
        }
    }
    return NULL;
}

static void *put_story(void *context) {
    (void)context;
    if (!tl_record_queue_put_start(&queue, &start) || !tl_record_queue_reserve_checkpoint(&queue, CHECKPOINT)) {
        return NULL;
    }
    for (int64_t tick = 0; tick < STORY; tick++) {
        (void)tl_record_queue_wait_for_room(&queue, INT64_MAX);
        (void)put_both(tick);
        if (tick % 20 == 0) {
            size_t capacity = 0;
            size_t size = (size_t)tick % CHECKPOINT + 1;
            fill(tl_record_queue_checkpoint_room(&queue, &capacity), size, tick);
            tl_record_queue_put_checkpoint(&queue, tick, size);
        }
    }
    return NULL;
}

/* Reads events. Those of each thread must be complete and in order. Returns their number. */
static uint64_t take_told(int64_t last[TELLERS]) {
    tl_recorder_event_entry event;
    uint64_t count = 0;
    while (take_event(&event)) {
        int64_t teller = event.tick / TOLD;
        TEST_ASSERT_TRUE(event.tick % TOLD > last[teller]);
        TEST_ASSERT_EQUAL_INT('a' + (int)teller, event.text[0]);
        TEST_ASSERT_EQUAL_INT('a' + (int)teller, event.text[TL_EVENT_TEXT - 2]);
        last[teller] = event.tick % TOLD;
        count++;
    }
    return count;
}

/* Reads ticks and checkpoints. */
static void take_story(int64_t *next, int64_t *checkpoint) {
    for (int64_t found = take_checkpoint(taken.ring); found != INT64_MIN; found = take_checkpoint(taken.ring)) {
        TEST_ASSERT_TRUE(found > *checkpoint && found < *next);
        *checkpoint = found;
    }
    uint64_t position = taken.ring;
    uint64_t end = tl_record_queue_reader_end(&reader, position);
    while (position != end) {
        TEST_ASSERT_TRUE_MESSAGE(tl_record_queue_reader_entry(&reader, &position, end, &entry), reader.fault);
        if (entry.kind == TL_ENTRY_SAMPLE) {
            check_sample(*next, start.resumption.start);
        } else if (entry.kind == TL_ENTRY_STEP) {
            check_step((*next)++);
        }
    }
    __atomic_store_n(&taken.ring, position, __ATOMIC_RELEASE);
}

static void threads_put_and_one_reads(void) {
    pthread_t threads[TELLERS + 1];
    int64_t last[TELLERS];
    int64_t next = 0;
    int64_t checkpoint = -1;
    uint64_t events = 0;
    for (int i = 0; i < TELLERS; i++) {
        last[i] = -1;
        TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[i], NULL, put_events, &newest[i]));
    }
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&threads[TELLERS], NULL, put_story, NULL));
    while (next < STORY) {
        take_story(&next, &checkpoint);
        events += take_told(last);
        (void)sched_yield();
    }
    for (int i = 0; i <= TELLERS; i++) {
        TEST_ASSERT_EQUAL_INT(0, pthread_join(threads[i], NULL));
    }
    events += take_told(last);
    take_story(&next, &checkpoint);
    TEST_ASSERT_EQUAL_INT64(STORY - 20, checkpoint);
    TEST_ASSERT_EQUAL_UINT64((uint64_t)TELLERS * TOLD, events + tl_record_queue_lost(&queue));
    TEST_ASSERT_GREATER_OR_EQUAL_UINT64(TL_RECORDER_EVENTS, events);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(a_run_is_read_as_it_was_put);
    RUN_TEST(tunings_keep_their_order);
    RUN_TEST(a_checkpoint_has_the_active_tuning);
    RUN_TEST(a_full_ring_has_no_room_for_a_tuning);
    RUN_TEST(a_run_that_holds_has_no_account);
    RUN_TEST(a_long_reason_is_cut);
    RUN_TEST(a_ring_wraps_many_times);
    RUN_TEST(positions_do_not_wrap);
    RUN_TEST(stamps_that_are_too_far_away_do_not_wrap);
    RUN_TEST(a_ring_is_large_enough_and_bounded);
    RUN_TEST(a_full_ring_refuses_and_counts);
    RUN_TEST(kept_entries_make_room_for_new_ones);
    RUN_TEST(a_start_without_room_is_put_first_later);
    RUN_TEST(a_reader_with_an_invalid_position);
    RUN_TEST(waiting_for_room);
    RUN_TEST(events_come_in_order_and_a_full_queue_counts);
    RUN_TEST(events_have_a_position_among_entries);
    RUN_TEST(a_queue_without_a_ring);
    RUN_TEST(a_half_written_event_waits_for_a_successor);
    RUN_TEST(checkpoints_are_read_after_their_entries);
    RUN_TEST(a_checkpoint_comes_after_a_waiting_start);
    RUN_TEST(the_two_newest_checkpoints_are_kept);
    RUN_TEST(a_damaged_checkpoint_is_ignored);
    RUN_TEST(the_number_of_a_read_checkpoint_is_not_reused);
    RUN_TEST(a_successor_finds_checkpoints_and_entries);
    RUN_TEST(a_twin_that_cannot_be_saved_leaves_its_entries);
    RUN_TEST(overwritten_entries_are_not_found);
    RUN_TEST(a_successor_drops_damaged_entries);
    RUN_TEST(an_end_before_the_read_entries);
    RUN_TEST(an_end_within_an_entry);
    RUN_TEST(an_earlier_end_finds_no_older_entries);
    RUN_TEST(a_sample_waits_for_its_step);
    RUN_TEST(a_tick_fits_completely_or_not_at_all);
    RUN_TEST(a_successor_that_resumes_puts_the_sample_again);
    RUN_TEST(the_second_successor_puts_the_sample_again);
    RUN_TEST(a_new_run_leaves_the_sample_to_the_run_before);
    RUN_TEST(a_run_that_resumes_after_the_sample_leaves_it);
    RUN_TEST(a_checkpoint_is_dropped_with_its_sample);
    RUN_TEST(without_a_reader_a_successor_finds_all);
    RUN_TEST(unused_memory_cannot_be_accessed);
    RUN_TEST(threads_put_and_one_reads);
    return UNITY_END();
}
