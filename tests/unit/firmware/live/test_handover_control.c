/* Handover control, with simulated status blocks of twin, shadow and recorder.
 * Tests which orders of the config manager it executes, and what it makes the supervisor do.
 * The test sets the clock. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/live/handover_control.h"
#include "tests/support/message.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"
#define DIED "signal 9" /* reasons that the supervisor passes on */
#define STOPPED "on order"
#define TEXT "{\"candidate\": \"not parsed by the supervisor\"}"

enum { RUN = 1001, SHADOW = 1002, NEXT = 1003 };

static tl_config config;
static tl_handover handover_block;
static tl_block blocks[TL_LIVE_BLOCKS];
static tl_twin_slot slots[TL_TWIN_SLOTS];
static tl_live_config_manager_status config_manager;
static tl_live_recorder_status recorder;
static tl_block candidate_block;
static tl_live_candidate *candidate;
static tl_handover_control change;
static tl_orders orders;
static tl_time now;
static char last_event[200];

static void on_event(void *context, const char *text) {
    (void)context;
    (void)snprintf(last_event, sizeof last_event, "%s", text);
}

static void play_ready(tl_twin_slot *slot_index, pid_t pid, tl_time start) {
    slot_index->pid = pid;
    memset(&slot_index->live_status->beats, 0, sizeof slot_index->live_status->beats);
    tl_heartbeats_set_ready(&slot_index->live_status->beats);
    slot_index->live_status->start = start;
    slot_index->live_status->started = 77;
}

void setUp(void) {
    tl_report report = {0};
    tl_error error = {TL_OK, ""};
    memset(&handover_block, 0, sizeof handover_block);
    memset(&config_manager, 0, sizeof config_manager);
    memset(&recorder, 0, sizeof recorder);
    last_event[0] = '\0';
    now = 1000 * TL_SECOND;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read(LOCK, &config, &report));
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
        tl_block *live_status = &blocks[TL_LIVE_TWIN_STATUS + i];
        TEST_ASSERT_EQUAL_INT(
            TL_OK, tl_block_make("twin", sizeof *slots->live_status, TL_BLOCK_THEY_WRITE, live_status, &error));
        slots[i] = (tl_twin_slot){.live_status = live_status->bytes, .queue = &blocks[TL_LIVE_QUEUE + i]};
    }
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_slot_load(&slots[0], &config, false, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_block_make("candidate", sizeof *candidate, TL_BLOCK_THEY_WRITE, &candidate_block, &error));
    candidate = candidate_block.bytes;
    change = (tl_handover_control){.handover_block = &handover_block,
                                   .slots = slots,
                                   .orders = &config_manager,
                                   .candidate = &candidate_block,
                                   .recorder = &recorder,
                                   .step = config.step,
                                   .unconfined = false,
                                   .report = on_event};
    play_ready(&slots[0], RUN, 900 * TL_SECOND);
}

void tearDown(void) {
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
        tl_twin_slot_unload(&slots[i]);
        tl_block_close(&blocks[TL_LIVE_TWIN_STATUS + i]);
    }
    tl_block_close(&candidate_block);
    tl_config_free(&config);
}

static void look(void) {
    orders = (tl_orders){.end = false};
    tl_handover_control_poll(&change, now, false, &orders);
}

static void look_after(tl_time time) {
    now += time;
    look();
}

static void order(tl_live_verb verb) {
    config_manager.order.verb = (uint32_t)verb;
    config_manager.order.number++;
    look();
}

static void write_candidate(void) {
    candidate->size = (uint32_t)strlen(TEXT);
    memcpy(candidate->text, TEXT, sizeof TEXT);
    tl_sha256(TEXT, strlen(TEXT), candidate->hash);
    config_manager.order.needs = (tl_live_needs){
        .match = 2, .adjust = 1, .components = 3, .unpacked_bytes = 1000, .signals = (uint32_t)config.signal_count};
}

static void expect_obeyed(bool is) {
    TEST_ASSERT_EQUAL_INT(is, handover_block.order == config_manager.order.number);
}

static void expect_refused(const char *why) {
    expect_obeyed(true);
    TL_EXPECT_PARTS(why, handover_block.why);
    TEST_ASSERT_FALSE(orders.swap);
}

/* Starts a shadow as the supervisor does: with a process in its slot. */
static void begin_shadow(pid_t pid) {
    write_candidate();
    order(TL_LIVE_SHADOW);
    TEST_ASSERT_TRUE(orders.shadow);
    expect_obeyed(true);
    tl_twin_slot *slot_index = &slots[1 - handover_block.slot_index];
    play_ready(slot_index, pid, slot_index->start);
    look();
}

static void end_twin(tl_twin_slot *slot_index) {
    slot_index->pid = 0;
    look();
}

/* ---- a shadow ---- */

static void test_a_candidate_is_loaded(void) {
    slots[1].live_status->number = 6;
    slots[1].live_status->handed_over = 3;
    begin_shadow(SHADOW);
    TEST_ASSERT_EQUAL_STRING(TEXT, slots[1].text);
    TEST_ASSERT_EQUAL_STRING(candidate->hash, slots[1].hash);
    TEST_ASSERT_EQUAL_size_t(config.signal_count, slots[1].queue_settings.shape.plant);
    TEST_ASSERT_EQUAL_size_t(2, slots[1].queue_settings.shape.match);
    TEST_ASSERT_EQUAL_size_t(4, slots[1].queue_settings.shape.components);
    TEST_ASSERT_EQUAL_size_t(tl_record_queue_bytes(&slots[1].queue_settings), slots[1].queue->size);
    TEST_ASSERT_EQUAL_INT64(900 * TL_SECOND, slots[1].start);
    TEST_ASSERT_EQUAL_INT64(77, slots[1].started);
    TEST_ASSERT_EQUAL_UINT32(6, slots[1].live_status->number);
    TEST_ASSERT_EQUAL_UINT32(7, slots[1].live_status->first);
    TEST_ASSERT_EQUAL_UINT32(0, slots[1].live_status->handed_over);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_RUNS, handover_block.shadow);
    TEST_ASSERT_EQUAL_UINT32(0, handover_block.slot_index);
}

/* Later changes of the shared block have no effect. */
static void test_a_candidate_is_copied(void) {
    begin_shadow(SHADOW);
    candidate->text[0] = 'x';
    TEST_ASSERT_EQUAL_STRING(TEXT, slots[1].text);
}

static void refuse_candidate(const char *why) {
    order(TL_LIVE_SHADOW);
    TEST_ASSERT_FALSE(orders.shadow);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_ENDED, handover_block.shadow);
    TEST_ASSERT_NULL(slots[1].text);
    TEST_ASSERT_EQUAL_size_t(0, slots[1].queue->size);
    expect_refused(why);
}

static void test_invalid_candidates_are_rejected(void) {
    write_candidate();
    candidate->text[3] = 'x';
    refuse_candidate("candidate|hash");
    write_candidate();
    candidate->text[3] = '\0';
    tl_sha256(candidate->text, candidate->size, candidate->hash);
    refuse_candidate("candidate|hash");
    write_candidate();
    candidate->size = TL_CONFIG_MAX_BYTES + 1;
    refuse_candidate("candidate|262145|1|262144");
    candidate->size = 0;
    refuse_candidate("candidate|0|1|262144");
    write_candidate();
    config_manager.order.needs.match = TL_MAX_MATCH + 1;
    refuse_candidate("candidate|65|1|3|2");
    write_candidate();
    config_manager.order.needs.components = TL_RECORDER_COMPONENTS;
    refuse_candidate("candidate|2|1|64");
}

static void test_a_shadow_is_as_confined_as_the_run(void) {
    write_candidate();
    config_manager.order.needs.unconfined = 1;
    order(TL_LIVE_SHADOW);
    TEST_ASSERT_FALSE(slots[1].unconfined);
}

static void test_a_shadow_waits_for_the_runs_twin(void) {
    slots[0].live_status->start = 0;
    write_candidate();
    order(TL_LIVE_SHADOW);
    expect_obeyed(false);
    TEST_ASSERT_FALSE(orders.shadow);
    look_after(TL_HANDOVER_CONTROL_PATIENCE);
    expect_obeyed(false);
    play_ready(&slots[0], RUN, 950 * TL_SECOND);
    look();
    expect_obeyed(true);
    TEST_ASSERT_TRUE(orders.shadow);
    TEST_ASSERT_EQUAL_INT64(950 * TL_SECOND, slots[1].start);
}

static void test_an_order_times_out(void) {
    play_ready(&slots[0], RUN, INT64_MAX); /* a false value */
    write_candidate();
    order(TL_LIVE_SHADOW);
    look_after(TL_HANDOVER_CONTROL_PATIENCE);
    expect_obeyed(false);
    look_after(1);
    expect_refused("twin");
}

static void test_a_shadow_that_ends(void) {
    begin_shadow(SHADOW);
    slots[1].pid = 0;
    tl_handover_control_note_end_of_shadow(&change, DIED);
    look();
    TEST_ASSERT_FALSE(orders.shadow);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_ENDED, handover_block.shadow);
    TEST_ASSERT_EQUAL_STRING(DIED, handover_block.why);
}

static void test_another_shadow_waits_for_the_end_of_the_one_before(void) {
    begin_shadow(SHADOW);
    write_candidate();
    order(TL_LIVE_SHADOW);
    expect_obeyed(false);
    TEST_ASSERT_FALSE(orders.shadow);
    slots[1].pid = 0;
    tl_handover_control_note_end_of_shadow(&change, STOPPED);
    look();
    expect_obeyed(true);
    TEST_ASSERT_TRUE(orders.shadow);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_RUNS, handover_block.shadow);
}

static void test_a_shadow_is_stopped_on_order(void) {
    begin_shadow(SHADOW);
    order(TL_LIVE_NO_SHADOW);
    expect_obeyed(true);
    TEST_ASSERT_FALSE(orders.shadow);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_NONE, handover_block.shadow);
    slots[1].pid = 0;
    tl_handover_control_note_end_of_shadow(&change, STOPPED);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_NONE, handover_block.shadow);
}

static void test_an_unknown_order_has_no_effect(void) {
    begin_shadow(SHADOW);
    order(TL_LIVE_VERBS);
    expect_obeyed(true);
    TEST_ASSERT_FALSE(orders.shadow);
}

static void test_safe_hold(void) {
    begin_shadow(SHADOW);
    change.holds = true;
    look();
    TEST_ASSERT_FALSE(orders.shadow);
    order(TL_LIVE_HAND_OVER);
    expect_refused("safe hold");
    slots[1].pid = 0;
    tl_handover_control_note_end_of_shadow(&change, STOPPED);
    TL_EXPECT_PARTS("safe hold", handover_block.why);
    write_candidate();
    order(TL_LIVE_SHADOW);
    expect_refused("safe hold");
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_ENDED, handover_block.shadow);
}

/* ---- a handover ---- */

static int64_t tick_at(tl_time time) {
    return (time - 900 * TL_SECOND) / config.step;
}

static void announce(void) {
    order(TL_LIVE_HAND_OVER);
    expect_obeyed(true);
}

static void expect_handover_event(int64_t tick, const char *hash) {
    char parts[64];
    (void)snprintf(parts, sizeof parts, "%lld|%.12s", (long long)tick, hash);
    TL_EXPECT_PARTS(parts, last_event);
}

static void test_a_handover(void) {
    begin_shadow(SHADOW);
    announce();
    TEST_ASSERT_EQUAL_UINT32(1, handover_block.handovers);
    TEST_ASSERT_EQUAL_UINT32(1, handover_block.to);
    TEST_ASSERT_EQUAL_INT64(tick_at(now + tl_handover_ahead(config.step)) + 1, handover_block.tick);
    expect_handover_event(handover_block.tick, slots[1].hash);
    look_after(TL_SECOND / 10);
    TEST_ASSERT_FALSE(orders.swap);
    TEST_ASSERT_TRUE(orders.soon);
    TEST_ASSERT_TRUE(orders.shadow);
    TEST_ASSERT_EQUAL_UINT32(0, handover_block.slot_index);
    slots[0].live_status->handed_over = 1;
    look();
    TEST_ASSERT_TRUE(orders.swap);
    TEST_ASSERT_TRUE(orders.shadow); /* the old one */
    TEST_ASSERT_EQUAL_UINT32(1, handover_block.slot_index);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_RUNS, handover_block.shadow);
    look();
    TEST_ASSERT_FALSE(orders.swap);
    TEST_ASSERT_FALSE(orders.soon);
}

static void handover(uint32_t number) {
    announce();
    slots[handover_block.slot_index].live_status->handed_over = number;
    look();
    TEST_ASSERT_TRUE(orders.swap);
}

/* The second handover does not wait for the recorder, which may be unable to write. */
static void test_a_handover_back(void) {
    begin_shadow(SHADOW);
    handover(1);
    handover(2);
    TEST_ASSERT_EQUAL_UINT32(0, handover_block.slot_index);
    TEST_ASSERT_EQUAL_UINT32(2, handover_block.handovers);
    TEST_ASSERT_EQUAL_UINT32(0, handover_block.to);
    TEST_ASSERT_EQUAL_STRING(config.text, slots[handover_block.slot_index].text);
}

static void test_a_twin_that_dies_before_its_tick(void) {
    begin_shadow(SHADOW);
    announce();
    end_twin(&slots[0]);
    TEST_ASSERT_TRUE(orders.swap);
    TEST_ASSERT_FALSE(orders.shadow);
    TEST_ASSERT_EQUAL_UINT32(1, handover_block.slot_index);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_ENDED, handover_block.shadow);
    TL_EXPECT_PARTS("twin", handover_block.why);
}

/* So a configuration whose twin dies can be rolled back. */
static void test_a_handover_does_not_wait_for_a_dead_twin(void) {
    begin_shadow(SHADOW);
    end_twin(&slots[0]);
    slots[0].live_status->start = 0;
    announce();
    look();
    TEST_ASSERT_TRUE(orders.swap);
    TEST_ASSERT_EQUAL_INT64(tick_at(now + tl_handover_ahead(config.step)) + 1, handover_block.tick);
}

static void test_a_twin_that_does_not_do_its_part(void) {
    begin_shadow(SHADOW);
    announce();
    look_after(2 * tl_handover_ahead(config.step));
    TEST_ASSERT_FALSE(orders.kill_twin);
    look_after(2 * config.step);
    TEST_ASSERT_TRUE(orders.kill_twin);
    TEST_ASSERT_FALSE(orders.swap);
    orders = (tl_orders){.end = false};
    tl_handover_control_poll(&change, now, true, &orders); /* all processes are ending */
    TEST_ASSERT_FALSE(orders.kill_twin);
}

/* The supervisor still swaps the slots, and restarts the twin there. */
static void test_a_shadow_that_dies_before_its_tick(void) {
    begin_shadow(SHADOW);
    announce();
    slots[1].pid = 0;
    tl_handover_control_note_end_of_shadow(&change, DIED);
    slots[0].live_status->handed_over = 1;
    look();
    TEST_ASSERT_TRUE(orders.swap);
    TEST_ASSERT_EQUAL_UINT32(1, handover_block.slot_index);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_RUNS, handover_block.shadow);
}

static void test_handovers_that_are_rejected(void) {
    order(TL_LIVE_HAND_OVER);
    expect_refused("no shadow");
    begin_shadow(SHADOW);
    memset(&slots[1].live_status->beats, 0, sizeof slots[1].live_status->beats);
    order(TL_LIVE_HAND_OVER);
    expect_refused("shadow|not");
    tl_heartbeats_set_ready(&slots[1].live_status->beats);
    slots[0].live_status->start++;
    order(TL_LIVE_HAND_OVER);
    expect_refused("shadow|ticks");
    TEST_ASSERT_EQUAL_UINT32(0, handover_block.handovers);
    TEST_ASSERT_EQUAL_UINT32(TL_LIVE_SHADOW_RUNS, handover_block.shadow); /* it still runs */
    TEST_ASSERT_EQUAL_STRING("", last_event);
}

static void publish_tick(int64_t tick) {
    static tl_run_status figures;
    figures.tick = tick;
    tl_latest_publish(&slots[0].live_status->figures, &figures, sizeof figures);
}

static void test_a_twin_that_is_ahead(void) {
    begin_shadow(SHADOW);
    publish_tick(tick_at(now + 10 * TL_SECOND));
    announce();
    TEST_ASSERT_EQUAL_INT64(tick_at(now + 10 * TL_SECOND) + 1, handover_block.tick);
}

static void test_a_twin_with_an_impossible_tick(void) {
    begin_shadow(SHADOW);
    publish_tick(INT64_MAX);
    order(TL_LIVE_HAND_OVER);
    expect_refused("ticks");
    TEST_ASSERT_FALSE(tl_test_has_parts(handover_block.why, "shadow"));
}

/* ---- signals ---- */

/* A signal that is read twice counts twice. */
static void test_a_candidate_with_more_look_ups(void) {
    const uint32_t more = (uint32_t)config.signal_count + 3;
    write_candidate();
    config_manager.order.needs.signals = more;
    order(TL_LIVE_SHADOW);
    expect_obeyed(true);
    TEST_ASSERT_EQUAL_size_t(more, slots[1].queue_settings.shape.plant);
}

static void test_invalid_numbers_of_signals(void) {
    static const uint32_t signals[] = {0, TL_MAX_SIGNALS + 1};
    for (size_t i = 0; i < sizeof signals / sizeof signals[0]; i++) {
        char why[96];
        (void)snprintf(why, sizeof why, "candidate|2|1|3|%u", (unsigned)signals[i]);
        write_candidate();
        config_manager.order.needs.signals = signals[i];
        refuse_candidate(why);
    }
}

/* ---- the recorder ---- */

static void test_the_recorder_follows(void) {
    begin_shadow(SHADOW);
    tl_handover_control_begin_recorder(&change);
    TEST_ASSERT_EQUAL_UINT32(0, change.recorder_slot);
    recorder.drained = 1; /* before any handover: a false value */
    look();
    TEST_ASSERT_FALSE(orders.recorder);
    recorder.drained = 0;
    handover(1);
    TEST_ASSERT_FALSE(orders.recorder);
    tl_handover_control_begin_recorder(&change); /* after the first recorder has died */
    TEST_ASSERT_EQUAL_UINT32(0, change.recorder_slot);
    recorder.drained = 1;
    look();
    TEST_ASSERT_TRUE(orders.recorder);
    tl_handover_control_begin_recorder(&change);
    TEST_ASSERT_EQUAL_UINT32(1, change.recorder_slot);
    TEST_ASSERT_EQUAL_UINT32(1, change.recorder_handovers);
    look();
    TEST_ASSERT_FALSE(orders.recorder);
}

static void test_a_recorder_two_handovers_behind(void) {
    begin_shadow(SHADOW);
    handover(1);
    handover(2);
    recorder.drained = 1;
    look();
    TEST_ASSERT_TRUE(orders.recorder);
    tl_handover_control_begin_recorder(&change);
    TEST_ASSERT_EQUAL_UINT32(1, change.recorder_slot);
    look();
    TEST_ASSERT_FALSE(orders.recorder);
    recorder.drained = 2;
    look();
    TEST_ASSERT_TRUE(orders.recorder);
    tl_handover_control_begin_recorder(&change);
    TEST_ASSERT_EQUAL_UINT32(0, change.recorder_slot);
    TEST_ASSERT_EQUAL_UINT32(2, change.recorder_handovers);
}

/* This also holds while all processes end. */
static void test_a_recorder_follows_when_all_end(void) {
    begin_shadow(SHADOW);
    announce();
    slots[0].live_status->handed_over = 1;
    recorder.drained = 1;
    orders = (tl_orders){.end = false};
    tl_handover_control_poll(&change, now, true, &orders);
    TEST_ASSERT_TRUE(orders.recorder);
    TEST_ASSERT_EQUAL_UINT32(1, handover_block.slot_index);
}

/* The live twin ended the run before the tick of the handover, so there is no handover. */
static void test_a_handover_that_the_end_overtakes(void) {
    begin_shadow(SHADOW);
    announce();
    slots[0].pid = 0;
    recorder.drained = 1;
    orders = (tl_orders){.end = false};
    tl_handover_control_poll(&change, now, true, &orders);
    TEST_ASSERT_EQUAL_UINT32(0, handover_block.slot_index);
    TEST_ASSERT_FALSE(orders.swap);
    TEST_ASSERT_FALSE(orders.recorder);
}

/* The slot is free only when its record queue is written. */
static void test_a_slot_waits_for_the_recorder(void) {
    begin_shadow(SHADOW);
    handover(1);
    slots[0].pid = 0;
    tl_handover_control_note_end_of_shadow(&change, DIED);
    write_candidate();
    order(TL_LIVE_SHADOW);
    expect_obeyed(false);
    TEST_ASSERT_EQUAL_STRING(config.text, slots[0].text);
    recorder.drained = 1;
    look();
    tl_handover_control_begin_recorder(&change);
    look();
    expect_obeyed(true);
    TEST_ASSERT_EQUAL_STRING(TEXT, slots[0].text);
    TEST_ASSERT_TRUE(orders.shadow);
}

static void test_without_a_recorder_no_slot_waits(void) {
    change.recorder = NULL;
    begin_shadow(SHADOW);
    handover(1);
    slots[0].pid = 0;
    tl_handover_control_note_end_of_shadow(&change, DIED);
    begin_shadow(NEXT);
    TEST_ASSERT_EQUAL_STRING(TEXT, slots[0].text);
    TEST_ASSERT_FALSE(orders.recorder);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_candidate_is_loaded);
    RUN_TEST(test_a_candidate_is_copied);
    RUN_TEST(test_invalid_candidates_are_rejected);
    RUN_TEST(test_a_shadow_is_as_confined_as_the_run);
    RUN_TEST(test_a_shadow_waits_for_the_runs_twin);
    RUN_TEST(test_an_order_times_out);
    RUN_TEST(test_a_shadow_that_ends);
    RUN_TEST(test_another_shadow_waits_for_the_end_of_the_one_before);
    RUN_TEST(test_a_shadow_is_stopped_on_order);
    RUN_TEST(test_an_unknown_order_has_no_effect);
    RUN_TEST(test_safe_hold);
    RUN_TEST(test_a_handover);
    RUN_TEST(test_a_handover_back);
    RUN_TEST(test_a_twin_that_dies_before_its_tick);
    RUN_TEST(test_a_handover_does_not_wait_for_a_dead_twin);
    RUN_TEST(test_a_twin_that_does_not_do_its_part);
    RUN_TEST(test_a_shadow_that_dies_before_its_tick);
    RUN_TEST(test_handovers_that_are_rejected);
    RUN_TEST(test_a_twin_that_is_ahead);
    RUN_TEST(test_a_twin_with_an_impossible_tick);
    RUN_TEST(test_a_candidate_with_more_look_ups);
    RUN_TEST(test_invalid_numbers_of_signals);
    RUN_TEST(test_the_recorder_follows);
    RUN_TEST(test_a_recorder_two_handovers_behind);
    RUN_TEST(test_a_recorder_follows_when_all_end);
    RUN_TEST(test_a_handover_that_the_end_overtakes);
    RUN_TEST(test_a_slot_waits_for_the_recorder);
    RUN_TEST(test_without_a_recorder_no_slot_waits);
    return UNITY_END();
}
