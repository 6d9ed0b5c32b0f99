/* Handovers between two cycles, the run's and its shadow, that read the same sample buffers.
 * Each tick belongs to one run. A replay of a run from its first checkpoint is bit-identical. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/plant/recording.h"
#include "firmware/store/history.h"
#include "firmware/twin/cycle.h"
#include "firmware/twin/twin_step.h"
#include "tests/support/follower.h"
#include "tests/support/random_numbers.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/test_record_queue.h"

#define MILLISECOND (TL_SECOND / 1000)
#define PATIENCE (60 * TL_SECOND)

#define CONFIGURATION "{}"
#define OTHER "{ \"other\": 1 }"

enum { PLACES = TL_TWIN_SLOTS };

/* Everything of one slot. */
typedef struct slot_index {
    tl_follower twin;
    tl_journal journal;
    tl_test_queue box;
    tl_live_tuning tuning;
    tl_live_tuning_answer answer;
    tl_fmu_thread *thread;
    tl_cycle *cycle;
    tl_cycle_status shown;
    tl_summary summary;
    bool has_run;
    uint32_t handed_over;
    tl_recorder_known known; /* another configuration */
    char hash[TL_SHA256_TEXT];
    char database[PATH_MAX];
} slot_index;

static slot_index places[PLACES];
static tl_handover handover_block;
static tl_sample_buffer_slot slots[1024];
static uint64_t posts;
static tl_plant_input input;
static tl_pairing measurements;
static bool can_save;
static tl_time run_start; /* instant of tick 0 */
static tl_scratch scratch;
static tl_error error;

void setUp(void) {
    memset(&handover_block, 0, sizeof handover_block);
    memset(slots, 0, sizeof slots);
    posts = 0;
    input = (tl_plant_input){.buffers = {{.slots = slots, .count = &posts, .depth = 1024}}, .count = 1};
    input.limits[0] = (tl_plant_limits){.minimum = -1e9, .maximum = 1e9, .type = TL_REAL};
    measurements = TL_LAG;
    can_save = true;
}

/* Ends the cycle of a slot, without assertions. */
static void close_place(slot_index *self) {
    if (self->cycle != NULL) {
        (void)tl_cycle_stop(self->cycle, &self->summary, &self->has_run, &error);
        self->cycle = NULL;
    }
    if (self->thread != NULL) {
        (void)tl_test_queue_try_close(&self->box, &error);
        tl_fmu_thread_end(self->thread);
        self->thread = NULL;
    }
}

void tearDown(void) {
    for (size_t i = 0; i < PLACES; i++) {
        close_place(&places[i]);
    }
    tl_scratch_empty(&scratch);
    for (size_t i = 0; i < PLACES; i++) {
        tl_follower_end(&places[i].twin);
    }
}

/* ---- slots ---- */

/* The two twins differ in their tolerance. */
static void make_twin(slot_index *self, tl_time step) {
    tl_follower_begin(&self->twin, step);
    self->twin.fmu.model.capabilities.can_serialize_state = can_save;
    self->twin.plan.plan.measurements = measurements;
    self->twin.plan.plan.algorithm = "secant";
    tl_follower_build(&self->twin, self == &places[0] ? 0.5 : 0.01);
    self->twin.assembly.config.record_resume = TL_SECOND;
}

static void make_recorder(slot_index *self) {
    tl_recorder_settings settings = tl_follower_recording(&self->twin, self->database);
    tl_sha256(OTHER, strlen(OTHER), self->hash);
    self->known = (tl_recorder_known){
        .number = 2, .hash = self->hash, .text = OTHER, .who = "ann", .origin = "test", .why = "it was wrong"};
    settings.commit = 20 * MILLISECOND;
    settings.known = &self->known;
    settings.known_count = 1;
    tl_test_queue_open(&self->box, &settings, (size_t)1 << 20);
}

static void put_event(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    tl_record_queue_event(context, tick, severity, source, text);
}

/* Starts the cycle of a slot; a shadow starts at `tick` of the run. */
static void start(slot_index *self, tl_time step, bool is_shadow, int64_t tick) {
    char name[32];
    uint32_t index = (uint32_t)(self - places);
    memset(self, 0, sizeof *self);
    make_twin(self, step);
    (void)snprintf(name, sizeof name, "place%u.db", index);
    (void)snprintf(self->database, sizeof self->database, "%s", tl_scratch_path(&scratch, name));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_thread_start(TL_FMU_WATCHED_HERE, &self->thread, &error));
    make_recorder(self);
    tl_journal_init(&self->journal, NULL);
    tl_journal_listen(&self->journal, put_event, &self->box.queue);
    tl_journal_set_apart(&self->journal, is_shadow);
    if (is_shadow) {
        tl_twin_begin_at(self->twin.assembly.twin, tick);
    }
    const tl_cycle_settings settings = {.assembly = &self->twin.assembly,
                                        .thread = self->thread,
                                        .input = &input,
                                        .queue = &self->box.queue,
                                        .journal = &self->journal,
                                        .tuning = &self->tuning,
                                        .answer = &self->answer,
                                        .slot_index = {.handover_block = &handover_block,
                                                       .slot_index = index,
                                                       .handovers = handover_block.handovers,
                                                       .handed_over = &self->handed_over,
                                                       .is_shadow = is_shadow,
                                                       .tick = tick,
                                                       .start = run_start,
                                                       .started = 1000}};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_cycle_start(&settings, &self->cycle, &error), error.text);
}

/* The measurement changes all the time, so that every step is searched. */
static void live_on(tl_time for_how_long) {
    static uint64_t count;
    tl_time until = tl_clock_now(NULL) + for_how_long;
    while (tl_clock_now(NULL) < until) {
        count++;
        const tl_reading reading = {
            .value = 5.0 + 3.0 * (double)(count * 37 % 101) / 101.0, .stamp = tl_clock_now(NULL), .quality = TL_GOOD};
        tl_sample_buffer_post(&input.buffers[0], &reading);
        for (size_t i = 0; i < PLACES; i++) {
            if (places[i].cycle != NULL) {
                (void)tl_cycle_status_now(places[i].cycle, &places[i].shown);
                tl_test_queue_write(&places[i].box);
            }
        }
        tl_clock_sleep_until(tl_clock_now(NULL) + MILLISECOND);
    }
}

static void live_until_tick(const slot_index *self, int64_t tick) {
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (self->shown.tick < tick) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "the cycle does not continue");
        TEST_ASSERT_FALSE_MESSAGE(self->shown.ended, "the cycle has ended");
        live_on(MILLISECOND);
    }
}

static void live_until_handed_over(const slot_index *self, uint32_t number) {
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (__atomic_load_n(&self->handed_over, __ATOMIC_ACQUIRE) != number) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "a slot has not done its part");
        live_on(MILLISECOND);
    }
}

/* Waits until the slot has published whether it is the shadow. */
static void live_until_shadow(const slot_index *self, bool is_shadow) {
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (self->shown.is_shadow != is_shadow) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "a slot has not changed its role");
        live_on(MILLISECOND);
    }
}

/* Waits until a shadow has caught up. */
static void live_until_live(const slot_index *self) {
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (!self->shown.has_caught_up) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "the shadow is not live");
        live_on(MILLISECOND);
    }
}

/* Announces a handover to this slot, as the supervisor does and `more` ticks earlier.
 * Waits until both slots have reported it. Returns its first tick. */
static int64_t handover_to(uint32_t to, int64_t more) {
    uint32_t number = handover_block.handovers + 1;
    tl_time step = places[to].twin.assembly.config.step;
    handover_block.to = to;
    handover_block.tick = (tl_clock_now(NULL) + tl_handover_ahead(step) - run_start) / step + 1 + more;
    __atomic_store_n(&handover_block.handovers, number, __ATOMIC_RELEASE);
    TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < tl_time_of_step(run_start, step, handover_block.tick),
                             "the test announced the handover too late");
    live_until_handed_over(&places[0], number);
    live_until_handed_over(&places[1], number);
    handover_block.slot_index = to;
    return handover_block.tick;
}

static void end(slot_index *self) {
    tl_status status = tl_cycle_stop(self->cycle, &self->summary, &self->has_run, &error);
    self->cycle = NULL;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
    if (self->has_run) {
        (void)tl_record_queue_put_end(&self->box.queue, "end");
    }
    tl_test_queue_close(&self->box);
    tl_fmu_thread_end(self->thread);
    self->thread = NULL;
}

/* ---- what was recorded ---- */

static int64_t number(const slot_index *self, const char *what, int64_t run) {
    char sql[256];
    (void)snprintf(sql, sizeof sql, "SELECT %s WHERE run = %lld", what, (long long)run);
    return tl_sql_integer(self->database, sql);
}

/* The samples and steps of a run have no gap; its own ticks are first … last. */
static void expect_whole(const slot_index *self, int64_t run, int64_t first, int64_t last) {
    int64_t lead = measurements == TL_AHEAD ? 0 : 1;
    int64_t least = number(self, "min(tick) FROM samples", run);
    int64_t most = number(self, "max(tick) FROM samples", run);
    TEST_ASSERT_TRUE(least <= first);
    TEST_ASSERT_EQUAL_INT64(last + (measurements == TL_AHEAD ? 1 : 0), most); /* for the last step */
    TEST_ASSERT_EQUAL_INT64(most - least + 1, number(self, "count(DISTINCT tick) FROM samples", run));
    TEST_ASSERT_EQUAL_INT64(last - lead, number(self, "max(step) FROM steps", run));
    int64_t first_step = number(self, "min(step) FROM steps", run);
    TEST_ASSERT_TRUE(first_step <= (first - lead > 0 ? first - lead : 0));
    TEST_ASSERT_EQUAL_INT64(last - lead - first_step + 1, number(self, "count(*) FROM steps", run));
}

/* ---- a replay of a run, from its checkpoint ---- */

enum { STEPS = 8192 };

static tl_history_tick steps[STEPS]; /* of a run, as recorded */

static void read_steps(const slot_index *self, int64_t number_of_run) {
    tl_history *history = NULL;
    const tl_history_run *run = NULL;
    tl_history_ticks *ticks = NULL;
    tl_history_tick read;
    bool over = false;
    memset(steps, 0, sizeof steps);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_open(self->database, &history, &error), error.text);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_history_find(history, number_of_run, &run, &error), error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_history_ticks_begin(history, run, 0, &ticks, &error));
    while (tl_history_ticks_next(ticks, &read, &over, &error) == TL_OK && !over) {
        if (read.has_step) {
            TEST_ASSERT_TRUE(read.step.step >= 0 && read.step.step < STEPS);
            steps[read.step.step] = read;
        }
    }
    tl_history_ticks_end(ticks);
    tl_history_close(history);
}

/* Makes a new twin, and loads the first checkpoint as a replay does. */
static void begin_again(slot_index *self, const tl_recording_beginning *beginning, tl_recovery *recovery) {
    tl_account account;
    tl_twin_destroy(self->twin.assembly.twin);
    self->twin.assembly.twin = tl_test_plan_build(&self->twin.plan);
    TEST_ASSERT_NOT_NULL(beginning);
    TEST_ASSERT_TRUE(beginning->follows);
    TEST_ASSERT_NOT_NULL_MESSAGE(beginning->checkpoint, "no first checkpoint");
    TEST_ASSERT_EQUAL_INT64(beginning->tick - 1, beginning->checkpoint->tick);
    tl_status status = tl_twin_load(self->twin.assembly.twin, beginning->checkpoint->tick, beginning->checkpoint->bytes,
                                    beginning->checkpoint->size, &error);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
    tl_account_take(self->twin.assembly.twin, &account);
    tl_recovery_init(recovery, &self->twin.assembly.config, &account);
}

static size_t expect_same_step(const tl_twin_result *result) {
    const tl_history_tick *wanted = &steps[result->record.step];
    if (result->ready == 0 || !wanted->has_step) {
        return 0;
    }
    TEST_ASSERT_EQUAL_MEMORY(&wanted->u[0], &result->record.u[0], sizeof wanted->u[0]);
    TEST_ASSERT_EQUAL_INT(wanted->step.outcome, result->record.outcome);
    TEST_ASSERT_EQUAL_UINT64(wanted->step.executions, result->record.executions);
    return 1;
}

/* Each u and the number of executions are as recorded. */
static void expect_repeated(slot_index *self, int64_t number_of_run) {
    static tl_twin_result result;
    tl_recording *recording = NULL;
    tl_recording_tick tick;
    tl_recovery recovery;
    bool over = false;
    size_t compared = 0;
    tl_config config = self->twin.assembly.config;
    tl_sha256(CONFIGURATION, strlen(CONFIGURATION), config.hash);
    config.recording_run = number_of_run;
    read_steps(self, number_of_run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_recording_open(self->database, &config, &recording, &error), error.text);
    begin_again(self, tl_recording_get_beginning(recording), &recovery);
    while (tl_recording_next(recording, &tick, &over, &error) == TL_OK && !over) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(
            TL_OK, tl_twin_execute(&self->twin.assembly, &tick, TL_ATTACHED_NONE, &recovery, &result, &error),
            error.text);
        compared += expect_same_step(&result);
    }
    tl_recording_close(recording);
    TEST_ASSERT_GREATER_THAN_size_t(10, compared);
}

/* ---- handovers ---- */

static void begin_both(tl_time step) {
    live_on(MILLISECOND);
    start(&places[0], step, false, 0);
    live_until_tick(&places[0], 10);
    run_start = tl_record_queue_beginning(&places[0].box.queue)->start;
    start(&places[1], step, true, places[0].shown.tick + 2);
    live_until_tick(&places[1], places[0].shown.tick + 10);
    live_until_live(&places[1]);
    TEST_ASSERT_TRUE(places[1].shown.is_shadow);
}

static void expect_events(const slot_index *self, int64_t count, const char *like) {
    char sql[256];
    (void)snprintf(sql, sizeof sql, "SELECT count(*) FROM events WHERE text LIKE '%s'", like);
    TEST_ASSERT_EQUAL_INT64(count, tl_sql_integer(self->database, sql));
}

/* The event of a handover, with its first tick and a further part. */
static void expect_handover_event(const slot_index *self, int64_t tick, const char *more) {
    char like[64];
    (void)snprintf(like, sizeof like, "%%tick %lld%%%s%%", (long long)tick, more);
    expect_events(self, 1, like);
}

/* There and back. */
static void handover_in_mode(tl_pairing mode) {
    static tl_test_random random = {20261123};
    measurements = mode;
    begin_both(4 * MILLISECOND);
    int64_t there = handover_to(1, (int64_t)tl_test_random_below(&random, 40));
    live_until_tick(&places[1], there + 20 + (int64_t)tl_test_random_below(&random, 20));
    live_until_shadow(&places[0], true);
    live_until_shadow(&places[1], false);
    uint64_t due = places[1].shown.ticks;
    TEST_ASSERT_EQUAL_UINT64((uint64_t)(places[1].shown.tick - there + 1), due);
    TEST_ASSERT_TRUE(due - places[1].shown.steps - places[1].shown.skipped <= (mode == TL_AHEAD ? 1 : 0));
    int64_t back = handover_to(0, (int64_t)tl_test_random_below(&random, 40));
    live_until_tick(&places[0], back + 30);
    end(&places[1]);
    end(&places[0]);
    TEST_ASSERT_TRUE(places[0].has_run);
    TEST_ASSERT_FALSE(places[1].has_run);
    int64_t last = number(&places[0], "max(tick) FROM samples", 2) - (mode == TL_AHEAD ? 1 : 0);
    expect_whole(&places[0], 1, 0, there - 1);
    expect_whole(&places[1], 1, there, back - 1);
    expect_whole(&places[0], 2, back, last);
    TEST_ASSERT_EQUAL_INT64(there, number(&places[1], "resumed_tick FROM beginnings", 1));
    TEST_ASSERT_EQUAL_INT64(back, number(&places[0], "resumed_tick FROM beginnings", 2));
    TEST_ASSERT_EQUAL_STRING(TL_LIVE_HANDED_OVER, tl_sql_text(places[1].database, "SELECT ended_reason FROM runs"));
    expect_handover_event(&places[1], there, "");
    expect_handover_event(&places[0], back, "");
    expect_events(&places[0], 0, "%too late%");
    expect_events(&places[1], 0, "%too late%");
    TEST_ASSERT_EQUAL_UINT64(places[0].summary.ticks,
                             places[0].summary.figures.steps + places[0].summary.figures.skipped);
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_CHECKPOINT, places[0].summary.resumption.from);
    expect_repeated(&places[1], 1);
    expect_repeated(&places[0], 2);
}

static void test_there_and_back_in_mode_lag(void) {
    handover_in_mode(TL_LAG);
}

static void test_there_and_back_in_mode_hold(void) {
    handover_in_mode(TL_HOLD);
}

static void test_there_and_back_in_mode_ahead(void) {
    handover_in_mode(TL_AHEAD);
}

/* An event reports it, and the run has no checkpoint. */
static void test_a_twin_that_cannot_be_saved(void) {
    can_save = false;
    begin_both(4 * MILLISECOND);
    int64_t there = handover_to(1, 0);
    live_until_tick(&places[1], there + 20);
    end(&places[0]);
    end(&places[1]);
    int64_t last = number(&places[1], "max(tick) FROM samples", 1);
    expect_whole(&places[0], 1, 0, there - 1);
    expect_whole(&places[1], 1, there, last);
    TEST_ASSERT_EQUAL_STRING("inputs", tl_sql_text(places[1].database, "SELECT resumed_from FROM beginnings"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(places[1].database, "SELECT count(*) FROM checkpoints"));
    expect_handover_event(&places[1], there, "replay");
}

/* If the live twin is dead, the shadow takes over at the announced tick. */
static void test_the_live_twin_is_dead(void) {
    begin_both(4 * MILLISECOND);
    end(&places[0]);
    (void)tl_cycle_status_now(places[1].cycle, &places[1].shown);
    handover_block.to = 1;
    handover_block.tick = places[1].shown.tick + 30;
    __atomic_store_n(&handover_block.handovers, 1, __ATOMIC_RELEASE);
    live_until_tick(&places[1], handover_block.tick + 10);
    TEST_ASSERT_EQUAL_UINT32(1, places[1].handed_over);
    TEST_ASSERT_FALSE(places[1].shown.is_shadow);
    end(&places[1]);
    TEST_ASSERT_TRUE(places[1].has_run);
    expect_repeated(&places[1], 1);
}

/* A handover that is announced too late begins with the next tick. Both runs report it. */
static void test_a_handover_in_the_past(void) {
    begin_both(4 * MILLISECOND);
    handover_block.to = 1;
    handover_block.tick = 3;
    __atomic_store_n(&handover_block.handovers, 1, __ATOMIC_RELEASE);
    live_until_handed_over(&places[0], 1);
    live_until_handed_over(&places[1], 1); /* may have to catch up first */
    live_until_tick(&places[1], places[1].shown.tick + 20);
    TEST_ASSERT_FALSE(places[1].shown.is_shadow);
    end(&places[0]);
    end(&places[1]);
    expect_handover_event(&places[0], 3, "too late");
    expect_handover_event(&places[1], 3, "too late");
    TEST_ASSERT_EQUAL_INT64(number(&places[1], "min(tick) FROM samples", 1),
                            number(&places[1], "resumed_tick FROM beginnings", 1));
    expect_repeated(&places[1], 1);
}

/* A cycle ignores handovers from before its start, and handovers to its own slot. */
static void test_handovers_that_are_ignored(void) {
    handover_block.handovers = 4;
    handover_block.to = 1;
    handover_block.tick = 12;
    live_on(MILLISECOND);
    start(&places[0], 4 * MILLISECOND, false, 0);
    live_until_tick(&places[0], 30);
    TEST_ASSERT_FALSE(places[0].shown.is_shadow);
    TEST_ASSERT_EQUAL_UINT32(0, places[0].handed_over);
    handover_block.to = 0;
    __atomic_store_n(&handover_block.handovers, 5, __ATOMIC_RELEASE);
    live_until_tick(&places[0], 50);
    TEST_ASSERT_FALSE(places[0].shown.is_shadow);
    TEST_ASSERT_EQUAL_UINT32(5, places[0].handed_over);
    end(&places[0]);
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(places[0].database, "SELECT count(*) FROM runs"));
}

static void apply_tuning(slot_index *self, double tolerance) {
    tl_live_tuning_head head = {.size = (uint32_t)strlen(OTHER)};
    tl_live_tuning_answer received;
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    memcpy(head.hash, self->hash, sizeof head.hash);
    tl_config_tuning(&self->twin.assembly.config, &head.tuning);
    head.tuning.match[0].tolerance = tolerance;
    uint32_t number = tl_live_tuning_write(&self->tuning, &head, OTHER);
    while (!tl_live_tuning_answered(&self->answer, number, &received)) {
        TEST_ASSERT_TRUE(tl_clock_now(NULL) < until);
        live_on(MILLISECOND);
    }
    TEST_ASSERT_EQUAL_UINT32(0, received.refused);
}

/* A tuning that the shadow has taken applies from the first tick of its run on. */
static void test_a_tuning_of_the_shadow(void) {
    begin_both(4 * MILLISECOND);
    apply_tuning(&places[1], 0.25);
    live_until_tick(&places[1], places[1].shown.tick + 10);
    int64_t there = handover_to(1, 0);
    live_until_tick(&places[1], there + 10);
    end(&places[0]);
    end(&places[1]);
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(places[0].database, "SELECT count(*) FROM tunings"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(places[1].database, "SELECT count(*) FROM tunings"));
    TEST_ASSERT_EQUAL_INT64(number(&places[1], "min(tick) FROM samples", 1),
                            tl_sql_integer(places[1].database, "SELECT tick FROM tunings"));
}

/* The first twin keeps its tuning, and its second run records it. */
static void test_a_tuning_of_the_run_before(void) {
    begin_both(4 * MILLISECOND);
    apply_tuning(&places[0], 0.25);
    (void)handover_to(1, 0);
    int64_t back = handover_to(0, 0);
    live_until_tick(&places[0], back + 10);
    end(&places[1]);
    end(&places[0]);
    TEST_ASSERT_EQUAL_INT64(1, number(&places[0], "count(*) FROM tunings", 1));
    TEST_ASSERT_EQUAL_INT64(1, number(&places[0], "count(*) FROM tunings", 2));
    TEST_ASSERT_EQUAL_INT64(number(&places[0], "min(tick) FROM samples", 2),
                            number(&places[0], "tick FROM tunings", 2));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(places[1].database, "SELECT count(*) FROM tunings"));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_flip");
    UNITY_BEGIN();
    RUN_TEST(test_there_and_back_in_mode_lag);
    RUN_TEST(test_there_and_back_in_mode_hold);
    RUN_TEST(test_there_and_back_in_mode_ahead);
    RUN_TEST(test_a_twin_that_cannot_be_saved);
    RUN_TEST(test_the_live_twin_is_dead);
    RUN_TEST(test_a_handover_in_the_past);
    RUN_TEST(test_handovers_that_are_ignored);
    RUN_TEST(test_a_tuning_of_the_shadow);
    RUN_TEST(test_a_tuning_of_the_run_before);
    return tl_scratch_finish(&scratch, UNITY_END());
}
