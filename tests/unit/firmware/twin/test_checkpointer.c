/* The checkpointer: when it saves a twin, and what it reports if it does not.
 * The clock is real, the budgets are invented. */
#include <stdio.h>
#include <string.h>
#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/twin/checkpointer.h"
#include "firmware/twin/twin_recorder.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/test_plan.h"
#include "tests/support/test_record_queue.h"

enum { INTERVAL = 100 /* ticks: 10 s */, MUCH = 1 << 20 };

static const tl_time STEP = TL_SECOND / 10;

static tl_test_log call_log;
static tl_test_fmu fmu;
static tl_test_plan plan;
static tl_test_run run;
static tl_assembly assembly;
static tl_journal journal;
static tl_test_queue box;
static tl_checkpointer checkpointer;
static tl_scratch scratch;
static char path[PATH_MAX];
static size_t padding; /* bytes that the FMU adds to its state */
static tl_time delay;  /* time that the FMU takes to serialize it */
static fmi2SerializedFMUstateSizeTYPE *real_size;
static fmi2SerializeFMUstateTYPE *real_serialize;

static fmi2Status padded_size(fmi2Component component, fmi2FMUstate state, size_t *size) {
    fmi2Status status = real_size(component, state, size);
    *size += padding;
    return status;
}

static fmi2Status padded_serialize(fmi2Component component, fmi2FMUstate state, fmi2Byte *bytes, size_t size) {
    tl_clock_sleep_until(tl_clock_now(NULL) + delay);
    memset(bytes, 0, size);
    return real_serialize(component, state, bytes, size);
}

void setUp(void) {
    tl_test_log_clear(&call_log);
    memset(&run, 0, sizeof run);
    memset(&assembly, 0, sizeof assembly);
    padding = 0;
    delay = 0;
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    tl_test_fmu_init(&fmu, 1, false, &call_log);
    fmu.model.capabilities.can_serialize_state = true;
    real_size = fmu.functions.serialized_fmu_state_size;
    real_serialize = fmu.functions.serialize_fmu_state;
    fmu.functions.serialized_fmu_state_size = padded_size;
    fmu.functions.serialize_fmu_state = padded_serialize;
    tl_test_plan_init(&plan, STEP);
    tl_test_plan_component(&plan, "motor", &fmu);
    tl_test_plan_signal(&plan, "speed", TL_REAL, "");
    tl_test_plan_adjust(&plan, "motor.u0", 1.0);
    tl_test_plan_match(&plan, "motor.y0", "plant.speed", 0.5);
}

static void close_recorder(void) {
    tl_test_queue_close(&box);
}

void tearDown(void) {
    close_recorder();
    tl_twin_destroy(run.twin);
    tl_test_fmu_end(&fmu);
    tl_scratch_empty(&scratch);
    TEST_ASSERT_EQUAL_STRING("", call_log.first_violation);
}

static void put_event(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    tl_record_queue_event(context, tick, severity, source, text);
}

static void begin(size_t checkpoint_bytes) {
    static const tl_recorder_signal SPEED = {.name = "plant.speed", .unit = "", .type = TL_REAL};
    tl_test_run_init(&run, tl_test_plan_build(&plan));
    TEST_ASSERT_EQUAL_STRING("", plan.problems[0].text);
    const tl_recorder_settings settings = {
        .path = path,
        .commit = TL_SECOND / 100,
        .verb = "run",
        .name = "test",
        .configuration = "{}",
        .step = STEP,
        .plant = &SPEED,
        .plant_count = 1,
        .component_count = 2,
    };
    tl_test_queue_open(&box, &settings, checkpoint_bytes);
    tl_journal_init(&journal, NULL);
    tl_journal_listen(&journal, put_event, &box.queue);
    assembly.twin = run.twin;
    assembly.config.step = STEP;
    assembly.config.record_resume = TL_SECOND;
    tl_checkpointer_init(&checkpointer, &assembly, &box.queue, &journal, true);
    tl_twin_recorder_start(&box.queue, run.twin, 0);
}

/* Steps. After each of them, `used` of a budget of 50 ms is used. */
static void play(int64_t ticks, tl_time used) {
    for (int64_t i = 0; i < ticks; i++) {
        int64_t tick = run.sample.tick;
        tl_test_run_step(&run);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
        const tl_budget budget = {.time = TL_SECOND / 20, .started = tl_clock_now(NULL) - used, .now = tl_clock_now};
        tl_checkpointer_after(&checkpointer, tick, &budget);
        if (tick % 10 == 0) {
            tl_test_queue_write(&box);
        }
    }
}

static int64_t checkpoints(void) {
    return tl_sql_integer(path, "SELECT count(*) FROM checkpoints");
}

/* All events are of the checkpointer and contain `part`. */
static void expect_event(const char *part, int64_t times) {
    char sql[256];
    (void)snprintf(sql, sizeof sql, "SELECT count(*) FROM events WHERE source = 'checkpoint' AND text LIKE '%%%s%%'",
                   part);
    TEST_ASSERT_EQUAL_INT64_MESSAGE(times, tl_sql_integer(path, sql), part);
    TEST_ASSERT_EQUAL_INT64(times, tl_sql_integer(path, "SELECT count(*) FROM events"));
}

/* ---- when ---- */

static void test_after_the_first_tick_and_then_every_ten_seconds(void) {
    begin(MUCH);
    play(2 * INTERVAL + 20, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_STRING("0, 100, 200",
                             tl_sql_text(path, "SELECT group_concat(tick, ', ') FROM checkpoints ORDER BY tick"));
    expect_event("", 0);
}

static void test_never_after_a_tick_that_was_made_up(void) {
    begin(MUCH);
    for (int i = 0; i < 20; i++) {
        int64_t tick = run.sample.tick;
        tl_test_run_catch_up(&run);
        tl_checkpointer_after(&checkpointer, tick, NULL);
    }
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(0, checkpoints());
}

static void test_the_first_one_is_there_at_once(void) {
    begin(MUCH);
    play(1, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(1, checkpoints());
}

/* After a reset of the FMUs, a checkpoint follows as soon as a tick has time.
 * The next one follows an interval later. */
static void test_soon_after_a_reset_of_the_fmus(void) {
    begin(MUCH);
    play(31, 0);
    tl_checkpointer_request(&checkpointer, 30);
    play(4, TL_SECOND / 20);
    TEST_ASSERT_EQUAL_INT64(1, checkpoints());
    play(INTERVAL + 5, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_STRING("0, 35, 135",
                             tl_sql_text(path, "SELECT group_concat(tick, ', ') FROM checkpoints ORDER BY tick"));
    expect_event("", 0);
}

/* Searches use the whole budget of each tick. One event reports it; later ticks save again. */
static void test_no_step_has_time_left(void) {
    begin(MUCH);
    play(1, 0);
    play(5 * INTERVAL, TL_SECOND / 20);
    TEST_ASSERT_EQUAL_INT64(1, checkpoints());
    play(20, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(2, checkpoints());
    expect_event("ms", 1);
}

/* One checkpoint that takes longer than the budget does not end the checkpoints. */
static void test_one_takes_long(void) {
    begin(MUCH);
    play(INTERVAL, 0);
    delay = TL_SECOND / 15;
    play(1, 0);
    delay = 0;
    play(5 * INTERVAL, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_STRING("0, 100, 501",
                             tl_sql_text(path, "SELECT group_concat(tick, ', ') FROM checkpoints ORDER BY tick"));
    expect_event("", 0);
}

/* ---- no more checkpoints ---- */

static void test_it_takes_too_long(void) {
    delay = TL_SECOND / 15;
    begin(MUCH);
    play(3 * INTERVAL, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(1, checkpoints()); /* the first one, which measured the time */
    expect_event("budget", 1);
}

static void test_it_is_too_large(void) {
    padding = 200000;
    begin(100000);
    play(INTERVAL, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(0, checkpoints());
    expect_event("large", 1);
}

static void test_it_grows(void) {
    begin(MUCH);
    play(1, 0);
    padding = 200000;
    play(2 * INTERVAL, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(1, checkpoints());
    expect_event("grown", 1);
}

static void test_an_fmu_that_cannot(void) {
    fmu.model.capabilities.can_serialize_state = false;
    begin(MUCH);
    play(INTERVAL, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(0, checkpoints());
    expect_event("canSerializeFMUstate", 1);
}

static void test_an_fmu_that_refuses(void) {
    begin(MUCH);
    play(1, 0);
    uint64_t next = fmu.calls[TL_TEST_SERIALIZE] + 1;
    tl_test_fmu_fail(&fmu, TL_TEST_SERIALIZE, TL_TEST_ERROR, next, next);
    play(2 * INTERVAL, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(1, checkpoints());
    expect_event("fmi2SerializeFMUstate", 1);
}

static void test_it_is_switched_off(void) {
    begin(MUCH);
    assembly.config.record_resume = 0;
    tl_checkpointer_init(&checkpointer, &assembly, &box.queue, &journal, true);
    play(INTERVAL, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(0, checkpoints());
    expect_event("", 0);
}

/* ---- a shadow ---- */

static void step_and_rehearse(bool caught_up) {
    const tl_budget budget = {.time = TL_SECOND / 20, .started = tl_clock_now(NULL), .now = tl_clock_now};
    tl_test_run_step(&run);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, run.status, run.error.text);
    tl_checkpointer_rehearse(&checkpointer, caught_up ? NULL : &budget);
}

/* A shadow records no checkpoint before its run begins. Then it records one at once. */
static void test_rehearsed_and_saved_once(void) {
    size_t size = 0;
    begin(MUCH);
    step_and_rehearse(true);
    TEST_ASSERT_FALSE(tl_checkpointer_save(&checkpointer, TL_SECOND, &size));
    step_and_rehearse(false);
    uint64_t calls = fmu.calls[TL_TEST_SERIALIZE];
    step_and_rehearse(false); /* one rehearsal is enough */
    TEST_ASSERT_EQUAL_UINT64(calls, fmu.calls[TL_TEST_SERIALIZE]);
    tl_test_queue_write(&box);
    TEST_ASSERT_EQUAL_INT64(0, checkpoints());
    TEST_ASSERT_TRUE(tl_checkpointer_save(&checkpointer, TL_SECOND, &size));
    TEST_ASSERT_NOT_EQUAL_size_t(0, size);
    tl_checkpointer_put(&checkpointer, run.sample.tick - 1, size);
    tl_test_queue_write(&box);
    TEST_ASSERT_EQUAL_INT64(1, checkpoints());
    play(INTERVAL + 2, 0);
    close_recorder();
    TEST_ASSERT_EQUAL_INT64(2, checkpoints());
    expect_event("", 0);
}

/* It is not started if the known duration exceeds the remaining time. */
static void test_not_saved_without_time(void) {
    size_t size = 1;
    delay = TL_SECOND / 100;
    begin(MUCH);
    step_and_rehearse(false);
    TEST_ASSERT_FALSE(tl_checkpointer_save(&checkpointer, TL_SECOND / 200, &size));
    TEST_ASSERT_EQUAL_size_t(0, size);
    delay = 0;
    TEST_ASSERT_TRUE(tl_checkpointer_save(&checkpointer, TL_SECOND, &size));
}

/* It is saved although the run is not resumed, because a replay starts from it. */
static void test_a_shadow_that_is_not_resumed(void) {
    size_t size = 0;
    begin(MUCH);
    assembly.config.record_resume = 0;
    tl_checkpointer_init(&checkpointer, &assembly, &box.queue, &journal, true);
    step_and_rehearse(false);
    TEST_ASSERT_TRUE(tl_checkpointer_save(&checkpointer, TL_SECOND, &size));
}

static void test_a_shadow_that_cannot_be_saved(void) {
    size_t size = 0;
    fmu.model.capabilities.can_serialize_state = false;
    begin(MUCH);
    assembly.config.record_resume = 0;
    tl_checkpointer_init(&checkpointer, &assembly, &box.queue, &journal, true);
    step_and_rehearse(false);
    TEST_ASSERT_FALSE(tl_checkpointer_save(&checkpointer, TL_SECOND, &size));
    TEST_ASSERT_EQUAL_UINT64(0, fmu.calls[TL_TEST_SERIALIZE]);
}

/* Loading a state of these FMUs has ended a process before. */
static void test_fmus_with_states_that_cannot_be_loaded(void) {
    size_t size = 0;
    begin(MUCH);
    tl_checkpointer_init(&checkpointer, &assembly, &box.queue, &journal, false);
    step_and_rehearse(false);
    TEST_ASSERT_FALSE(tl_checkpointer_save(&checkpointer, TL_SECOND, &size));
    TEST_ASSERT_EQUAL_UINT64(0, fmu.calls[TL_TEST_SERIALIZE]);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_checkpointer");
    UNITY_BEGIN();
    RUN_TEST(test_after_the_first_tick_and_then_every_ten_seconds);
    RUN_TEST(test_never_after_a_tick_that_was_made_up);
    RUN_TEST(test_the_first_one_is_there_at_once);
    RUN_TEST(test_soon_after_a_reset_of_the_fmus);
    RUN_TEST(test_no_step_has_time_left);
    RUN_TEST(test_one_takes_long);
    RUN_TEST(test_it_takes_too_long);
    RUN_TEST(test_it_is_too_large);
    RUN_TEST(test_it_grows);
    RUN_TEST(test_an_fmu_that_cannot);
    RUN_TEST(test_an_fmu_that_refuses);
    RUN_TEST(test_it_is_switched_off);
    RUN_TEST(test_fmus_with_states_that_cannot_be_loaded);
    RUN_TEST(test_rehearsed_and_saved_once);
    RUN_TEST(test_not_saved_without_time);
    RUN_TEST(test_a_shadow_that_is_not_resumed);
    RUN_TEST(test_a_shadow_that_cannot_be_saved);
    return tl_scratch_finish(&scratch, UNITY_END());
}
