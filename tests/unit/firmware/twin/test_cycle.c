/* The real-time cycle: its ticks, missed ticks, tunings, its end, and its published status. */
#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/twin/cycle.h"
#include "master/sync/proof.h"
#include "tests/support/follower.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/test_record_queue.h"

#define MILLISECOND (TL_SECOND / 1000)
#define PATIENCE (60 * TL_SECOND)

static tl_follower twin;
static tl_sample_buffer_slot slots[256];
static uint64_t posts;
static tl_plant_input input;
static tl_journal journal;
static tl_test_queue box;
static size_t checkpoint_bytes; /* room in it */
static tl_fmu_thread *thread;
static tl_cycle *cycle;
static tl_cycle_status shown;
static bool has_run;
static tl_summary summary;
static tl_error error;
static tl_scratch scratch;
static char database[PATH_MAX];

/* ---- another tuning ---- */

#define OTHER "{ \"other\": 1 }"

static tl_realtime_missing missing;
static tl_live_tuning tuning;
static tl_live_tuning_answer answer;
static tl_live_tuning_head written;
static tl_recorder_known known;

/* ---- a slow FMU ---- */

static fmi2DoStepTYPE *quick_step;
/* Steps of the rollback proof: 5 excursions of one adjusted variable (see proof.h). */
enum { PROOF_STEPS = (3 + 3 * 5) * TL_PROOF_STEPS - TL_PROOF_MIDST };

static unsigned long slow_call; /* counted from 1; 0: none */
static tl_time slow_time;
static unsigned long reset_call; /* during this call the FMUs are marked for a reset; 0: none */

static fmi2Status slow_step(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean final) {
    static unsigned long calls; /* used only by the thread of the cycle */
    calls = twin.fmu.calls[TL_TEST_DO_STEP] == 0 ? 1 : calls + 1;
    if (calls == slow_call) {
        tl_clock_sleep_until(tl_clock_now(NULL) + slow_time);
    }
    if (calls == reset_call) {
        tl_twin_reset(twin.assembly.twin);
    }
    return quick_step(component, point, size, final);
}

/* ---- one twin: motor.y0 follows plant.speed, which is 5, by adjusting motor.u0 from 0 ---- */

void setUp(void) {
    memset(slots, 0, sizeof slots);
    posts = 0;
    input = (tl_plant_input){.buffers = {{.slots = slots, .count = &posts, .depth = 256}}};
    memset(&shown, 0, sizeof shown);
    memset(&missing, 0, sizeof missing);
    memset(&tuning, 0, sizeof tuning);
    memset(&answer, 0, sizeof answer);
    memset(&written, 0, sizeof written);
    tl_sha256(OTHER, strlen(OTHER), written.hash);
    written.size = (uint32_t)strlen(OTHER);
    known = (tl_recorder_known){
        .number = 2, .hash = written.hash, .text = OTHER, .who = "ann", .origin = "test", .why = "it was wrong"};
    slow_call = 0;
    reset_call = 0;
    checkpoint_bytes = 0;
    cycle = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_thread_start(TL_FMU_WATCHED_HERE, &thread, &error));
    (void)snprintf(database, sizeof database, "%s", tl_scratch_path(&scratch, "twin.db"));
}

void tearDown(void) {
    if (cycle != NULL) {
        (void)tl_cycle_stop(cycle, &summary, &has_run, &error);
    }
    tl_test_queue_close(&box);
    tl_fmu_thread_end(thread);
    tl_follower_end(&twin);
    tl_scratch_empty(&scratch);
}

static void make_twin(tl_time step, tl_time duration, tl_pairing measurements) {
    tl_follower_begin(&twin, step);
    quick_step = twin.fmu.functions.do_step;
    twin.fmu.functions.do_step = slow_step;
    twin.plan.plan.measurements = measurements;
    tl_follower_build(&twin, 0.5);
    twin.assembly.config.duration = duration;
}

static void make_recorder(void) {
    tl_recorder_settings settings = tl_follower_recording(&twin, database);
    settings.commit = 20 * MILLISECOND;
    settings.known = &known;
    settings.known_count = 1;
    tl_test_queue_open(&box, &settings, checkpoint_bytes);
}

static void post(double speed) {
    const tl_reading reading = {.value = speed, .stamp = tl_clock_now(NULL), .quality = TL_GOOD};
    tl_sample_buffer_post(&input.buffers[0], &reading);
}

static void put_event(void *context, int64_t tick, tl_severity severity, const char *source, const char *text) {
    tl_record_queue_event(context, tick, severity, source, text);
}

static void start(void) {
    input.count = 1;
    input.limits[0] = (tl_plant_limits){.minimum = -1e9, .maximum = 1e9, .type = TL_REAL};
    if (box.memory == NULL) {
        make_recorder();
    }
    tl_journal_init(&journal, NULL);
    tl_journal_listen(&journal, put_event, &box.queue);
    post(5.0);
    const tl_cycle_settings settings = {.assembly = &twin.assembly,
                                        .thread = thread,
                                        .input = &input,
                                        .queue = &box.queue,
                                        .journal = &journal,
                                        .tuning = &tuning,
                                        .answer = &answer,
                                        .missing = missing};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_cycle_start(&settings, &cycle, &error), error.text);
}

/* Waits until `ticks` have passed or the cycle has ended. */
static void watch(uint64_t ticks) {
    uint64_t steps = 0;
    uint64_t pending = twin.assembly.config.measurements == TL_AHEAD ? 1 : 0; /* completed a tick later */
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (!shown.ended && shown.ticks < ticks) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "the cycle does not continue");
        if (tl_cycle_status_now(cycle, &shown)) {
            TEST_ASSERT_TRUE(shown.ended || shown.ticks - shown.steps - shown.skipped <= pending);
            TEST_ASSERT_TRUE(shown.steps >= steps);
            TEST_ASSERT_TRUE(shown.steps == 0 || shown.record.nominal[0] == 0.0);
            steps = shown.steps;
        }
        tl_clock_sleep_until(tl_clock_now(NULL) + MILLISECOND / 5);
    }
}

static tl_status end(void) {
    tl_status status = tl_cycle_stop(cycle, &summary, &has_run, &error);
    cycle = NULL;
    (void)tl_record_queue_put_end(&box.queue, "end");
    tl_test_queue_close(&box);
    return status;
}

static void expect_rows(int64_t rows) {
    TEST_ASSERT_EQUAL_INT64(rows, tl_sql_integer(database, "SELECT count(*) FROM steps"));
    TEST_ASSERT_EQUAL_INT64(rows - 1, tl_sql_integer(database, "SELECT max(step) FROM steps"));
    TEST_ASSERT_EQUAL_INT64((int64_t)summary.figures.skipped,
                            tl_sql_integer(database, "SELECT count(*) FROM steps WHERE outcome = 6"));
}

/* The executions per component add up to those of the steps. */
static void expect_ledger(void) {
    TEST_ASSERT_EQUAL_INT64(tl_sql_integer(database, "SELECT sum(executions) FROM steps"),
                            tl_sql_integer(database, "SELECT sum(executions) FROM components"));
    TEST_ASSERT_EQUAL_INT64(tl_sql_integer(database, "SELECT sum(predicted) FROM steps"),
                            tl_sql_integer(database, "SELECT sum(predicted) FROM components"));
    for (size_t i = 0; i < 2; i++) {
        char sql[96];
        tl_twin_ledger entry = tl_twin_get_ledger(twin.assembly.twin, i);
        (void)snprintf(sql, sizeof sql, "SELECT executions FROM components WHERE name = '%s'", entry.name);
        TEST_ASSERT_EQUAL_INT64((int64_t)entry.executions, tl_sql_integer(database, sql));
    }
}

/* ---- ticks ---- */

static void run_for_a_duration(tl_pairing measurements) {
    make_twin(2 * MILLISECOND, 100 * MILLISECOND, measurements);
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_TRUE(shown.ended);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, end(), error.text);
    TEST_ASSERT_EQUAL_UINT64(51, summary.ticks);
    TEST_ASSERT_EQUAL_UINT64(51, summary.figures.steps + summary.figures.skipped);
    TEST_ASSERT_EQUAL_UINT64(51, shown.ticks);
    TEST_ASSERT_EQUAL_UINT64(summary.figures.skipped, summary.figures.outcomes[TL_CAUGHT_UP]);
    expect_rows(51);
    expect_ledger();
    TEST_ASSERT_EQUAL_INT64(52, tl_sql_integer(database, "SELECT count(*) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(51, tl_sql_integer(database, "SELECT max(tick) FROM samples"));
}

static void test_a_duration_in_mode_lag(void) {
    run_for_a_duration(TL_LAG);
    TEST_ASSERT_TRUE(summary.figures.evaluations > 0 ||
                     summary.figures.steps == 0); /* on a machine that missed all ticks */
}

static void test_a_duration_in_mode_hold(void) {
    run_for_a_duration(TL_HOLD);
    TEST_ASSERT_TRUE(summary.figures.evaluations > 0 ||
                     summary.figures.steps == 0); /* on a machine that missed all ticks */
}

static void test_a_duration_in_mode_ahead(void) {
    run_for_a_duration(TL_AHEAD);
    TEST_ASSERT_EQUAL_DOUBLE(5.0, tl_sql_number(database, "SELECT measured FROM outputs WHERE step = 50"));
}

static void test_stamps_are_recorded_relative_to_the_first_tick(void) {
    make_twin(10 * MILLISECOND, 20 * MILLISECOND, TL_LAG);
    start(); /* its only reading is less than a minute older than tick 0 */
    watch(UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    int64_t stamp = tl_sql_integer(database, "SELECT stamp_ns FROM samples WHERE tick = 0");
    TEST_ASSERT_TRUE(stamp < 0 && stamp > -PATIENCE);
}

/* The number of gaps equals the number of sequences of missed steps in the database. */
static void expect_gaps(void) {
    TEST_ASSERT_EQUAL_INT64(tl_sql_integer(database, "SELECT count(*) FROM steps s LEFT JOIN steps b ON b.run = s.run "
                                                     "AND b.step = s.step - 1 "
                                                     "WHERE s.outcome = 6 AND coalesce(b.outcome, 0) <> 6"),
                            (int64_t)summary.gaps);
}

static void test_missed_ticks_are_made_up(void) {
    make_twin(2 * MILLISECOND, 200 * MILLISECOND, TL_LAG);
    slow_call = PROOF_STEPS + 20;
    slow_time = 50 * MILLISECOND; /* 25 periods: 24 of them have passed when it returns */
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    TEST_ASSERT_TRUE(summary.figures.skipped >= 24);
    /* Not if the machine itself was late, so that the slow step was one without a search. */
    TEST_ASSERT_TRUE(summary.deadline_misses >= 1 || summary.figures.longest < slow_time);
    TEST_ASSERT_EQUAL_UINT64(101, summary.ticks);
    TEST_ASSERT_EQUAL_UINT64(101, summary.figures.steps + summary.figures.skipped);
    expect_rows(101);
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(database,
                                              "SELECT count(*) FROM main.steps s JOIN adjustments a USING (run, step) "
                                              "JOIN adjustments b ON b.run = a.run AND b.step = a.step - 1 "
                                              "WHERE s.outcome = 6 AND a.applied <> b.applied"));
    TEST_ASSERT_TRUE(
        tl_sql_integer(database, "SELECT count(*) FROM events WHERE source = 'cycle' AND text LIKE '% ticks %'") >= 1);
    expect_gaps();
}

/* Denied rights are reported once, with the first miss. */
static void test_what_may_have_caused_a_miss(void) {
    missing = (tl_realtime_missing){.lock_error = ENOMEM, .priority = true};
    make_twin(20 * MILLISECOND, 600 * MILLISECOND, TL_LAG);
    slow_call = PROOF_STEPS + 60;
    slow_time = 100 * MILLISECOND;
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(database, "SELECT count(*) FROM events WHERE source = 'cycle' AND "
                                                        "severity = 1 AND text LIKE '%LimitMEMLOCK%'"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(database, "SELECT count(*) FROM events WHERE source = 'cycle' AND "
                                                        "severity = 1 AND text LIKE '%LimitRTPRIO%'"));
}

/* With a budget that ends at once, all missed ticks are still computed, one at a time. */
static void test_missed_ticks_without_time(void) {
    make_twin(2 * MILLISECOND, 100 * MILLISECOND, TL_LAG);
    twin.assembly.config.budget_time = 1;
    slow_call = PROOF_STEPS + 5;
    slow_time = 30 * MILLISECOND;
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    TEST_ASSERT_TRUE(summary.figures.skipped >= 14);
    TEST_ASSERT_EQUAL_UINT64(51, summary.figures.steps + summary.figures.skipped);
    TEST_ASSERT_EQUAL_UINT64(0, summary.figures.evaluations);
    expect_rows(51);
    expect_gaps();
}

/* A reset is recorded. A checkpoint follows, although the next one is due only after 500 ticks. */
static void test_a_reset_of_the_fmus(void) {
    make_twin(20 * MILLISECOND, 800 * MILLISECOND, TL_LAG);
    twin.fmu.model.capabilities.can_serialize_state = true;
    twin.assembly.config.record_resume = TL_SECOND;
    twin.assembly.config.budget_time = TL_SECOND; /* time for checkpoints */
    checkpoint_bytes = (size_t)1 << 20;
    reset_call = 30;
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    expect_rows(41);
    expect_ledger();
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(database, "SELECT count(*) FROM steps WHERE flags & 32"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(database, "SELECT count(*) FROM v_steps WHERE flags LIKE '%reset%'"));
    TEST_ASSERT_EQUAL_UINT64(1, twin.fmu.calls[TL_TEST_RESET]);
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(database, "SELECT count(*) FROM checkpoints WHERE tick >= "
                                                        "(SELECT step + 1 FROM steps WHERE flags & 32)"));
    for (size_t i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_INT64(0, tl_twin_get_ledger(twin.assembly.twin, i).difference);
    }
}

/* The tolerance is so wide that no step is searched, until another tuning comes. */
static void begin_wide(tl_time step, tl_pairing measurements) {
    make_twin(step, 0, measurements);
    tl_config_tuning(&twin.assembly.config, &written.tuning);
    written.tuning.match[0].tolerance = 100.0;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_assembly_retune(&twin.assembly, &written.tuning, &error), error.text);
    start();
    watch(20);
    written.tuning.match[0].tolerance = 0.5;
    written.tuning.time = step / 2;
}

static void request_tuning(uint32_t number) {
    TEST_ASSERT_EQUAL_UINT32(number, tl_live_tuning_write(&tuning, &written, OTHER));
}

static void wait_for_answer(uint32_t number, tl_live_tuning_answer *received) {
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (!tl_live_tuning_answered(&answer, number, received)) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "the cycle does not answer");
        tl_clock_sleep_until(tl_clock_now(NULL) + MILLISECOND / 5);
    }
}

/* An SQL expression `what` with a condition on a tick or step. */
static double recorded(const char *what, const char *compared, int64_t number) {
    char sql[256];
    (void)snprintf(sql, sizeof sql, "SELECT %s %s %lld", what, compared, (long long)number);
    return tl_sql_number(database, sql);
}

/* From one tick on, twin, lock monitor and budget have the new tuning. */
static void retune_in_mode(tl_pairing measurements) {
    tl_live_tuning_answer received;
    begin_wide(2 * MILLISECOND, measurements);
    request_tuning(2);
    wait_for_answer(2, &received);
    watch(shown.ticks + 20);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, end(), error.text);
    int64_t lead = measurements == TL_AHEAD ? 0 : 1;
    TEST_ASSERT_EQUAL_UINT32(0, received.refused);
    TEST_ASSERT_TRUE(received.tick >= 20);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, twin.assembly.config.match[0].tolerance);
    TEST_ASSERT_EQUAL_INT64(MILLISECOND, twin.assembly.config.budget_time);
    TEST_ASSERT_EQUAL_INT64(received.tick, tl_sql_integer(database, "SELECT tick FROM tunings"));
    TEST_ASSERT_EQUAL_STRING("ann|test|it was wrong",
                             tl_sql_text(database, "SELECT who || '|' || origin || '|' || why FROM tunings"));
    TEST_ASSERT_EQUAL_STRING(OTHER, tl_sql_text(database, "SELECT text FROM tunings JOIN configurations ON hash = "
                                                          "configuration"));
    char sql[128];
    (void)snprintf(sql, sizeof sql, "SELECT tick FROM events WHERE source = 'retune' AND text LIKE '%%%.12s%%'",
                   written.hash);
    TEST_ASSERT_EQUAL_INT64(received.tick, tl_sql_integer(database, sql));
    TEST_ASSERT_EQUAL_DOUBLE(1.0, recorded("count(*) FROM samples WHERE tick", "=", received.tick));
    /* An error of 5 is 0.05 of the wide tolerance, and ten of the other one.
     * So u is nominal before the tick, also if ticks were missed, and searched after it. */
    TEST_ASSERT_EQUAL_DOUBLE(0.0, recorded("max(abs(applied)) FROM adjustments WHERE step", "<", received.tick - lead));
    TEST_ASSERT_TRUE(recorded("max(abs(applied)) FROM adjustments WHERE step", ">=", received.tick - lead) > 0.5);
}

static void test_another_tuning_in_mode_lag(void) {
    retune_in_mode(TL_LAG);
}

static void test_another_tuning_in_mode_ahead(void) {
    retune_in_mode(TL_AHEAD);
}

/* An invalid or unsuitable tuning changes nothing, and is reported. */
static void test_a_tuning_that_is_rejected(void) {
    tl_live_tuning_answer received;
    begin_wide(2 * MILLISECOND, TL_LAG);
    written.tuning.evaluations = 61;
    request_tuning(2);
    wait_for_answer(2, &received);
    TEST_ASSERT_EQUAL_UINT32(1, received.refused);
    TL_EXPECT_PARTS("61|60", received.why);
    written.tuning.evaluations = 60;
    written.hash[0] = 'x';
    request_tuning(4);
    wait_for_answer(4, &received);
    TL_EXPECT_PARTS("hash", received.why);
    watch(shown.ticks + 5);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, end(), error.text);
    TEST_ASSERT_EQUAL_DOUBLE(100.0, twin.assembly.config.match[0].tolerance);
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(database, "SELECT count(*) FROM tunings"));
    TEST_ASSERT_EQUAL_INT64(2,
                            tl_sql_integer(database, "SELECT count(*) FROM events WHERE source = 'retune' AND "
                                                     "severity = 1 AND (text LIKE '%61%60%' OR text LIKE '%hash%')"));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_sql_number(database, "SELECT max(abs(applied)) FROM adjustments"));
}

/* After an interrupted write nothing happens until the next complete one. */
static void test_a_tuning_that_is_half_written(void) {
    tl_live_tuning_answer received;
    begin_wide(2 * MILLISECOND, TL_LAG);
    tuning.head.tuning = written.tuning;
    __atomic_store_n(&tuning.head.number, 1, __ATOMIC_RELEASE);
    watch(shown.ticks + 10);
    TEST_ASSERT_EQUAL_UINT32(0, answer.number);
    request_tuning(2);
    wait_for_answer(2, &received);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, end(), error.text);
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(database, "SELECT count(*) FROM tunings"));
}

/* The twin does not take a tuning again that it already has. */
static void test_a_tuning_that_the_twin_already_has(void) {
    begin_wide(2 * MILLISECOND, TL_LAG);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    tearDown();
    setUp();
    make_twin(2 * MILLISECOND, 20 * MILLISECOND, TL_LAG);
    tl_config_tuning(&twin.assembly.config, &written.tuning);
    request_tuning(2);
    make_recorder();
    tl_run_tuning configured = {.number = 2, .values = written.tuning};
    tl_record_queue_name_configuration(&box.queue, &configured);
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, end(), error.text);
    TEST_ASSERT_EQUAL_UINT32(0, answer.number);
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(database, "SELECT count(*) FROM tunings"));
}

/* A resume has failed, so the twin is a new one without the tuning of that run. */
static void test_a_tuning_after_a_failed_resume(void) {
    static tl_record_queue_start before;
    make_twin(2 * MILLISECOND, 20 * MILLISECOND, TL_LAG);
    tl_config_tuning(&twin.assembly.config, &written.tuning);
    written.tuning.margin = 0.25;
    request_tuning(2);
    make_recorder();
    tl_run_tuning taken = {.tick = 5, .number = 2, .values = written.tuning};
    memcpy(taken.hash, written.hash, sizeof taken.hash);
    tl_account_take(twin.assembly.twin, &before.account);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&box.queue, &before) && tl_record_queue_put_tuning(&box.queue, &taken));
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&box.queue, "failed resume"));
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, end(), error.text);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, twin.assembly.config.margin);
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(database, "SELECT tick FROM main.tunings WHERE run = 2"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(database, "SELECT count(*) FROM main.tunings WHERE run = 2"));
}

/* ---- ends ---- */

static void test_stops_though_the_next_tick_is_far_away(void) {
    make_twin(3600 * TL_SECOND, 0, TL_LAG);
    for (int i = 0; i < 20; i++) { /* at different moments before it sleeps */
        start();
        tl_clock_sleep_until(tl_clock_now(NULL) + i * MILLISECOND / 20);
        tl_time before = tl_clock_now(NULL);
        TEST_ASSERT_EQUAL_INT(TL_OK, end());
        TEST_ASSERT_TRUE(tl_clock_now(NULL) - before < PATIENCE);
        TEST_ASSERT_EQUAL_UINT64(0, summary.ticks);
        TEST_ASSERT_EQUAL_UINT64(0, summary.figures.steps);
    }
}

static void test_stops_when_asked(void) {
    make_twin(MILLISECOND, 0, TL_LAG);
    start();
    watch(30);
    TEST_ASSERT_FALSE(shown.ended);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    TEST_ASSERT_TRUE(summary.ticks >= 30);
    TEST_ASSERT_EQUAL_UINT64(summary.ticks, summary.figures.steps + summary.figures.skipped);
    expect_rows((int64_t)summary.ticks);
}

/* In mode ahead the last measurement comes one period later; the end does not wait for it. */
static void test_stops_without_the_last_measurement(void) {
    const tl_time step = TL_SECOND / 2;
    make_twin(step, 0, TL_AHEAD);
    tl_time before = tl_clock_now(NULL);
    start();
    watch(1);
    TEST_ASSERT_EQUAL_INT(TL_OK, end());
    bool in_time = tl_clock_now(NULL) < before + 2 * step; /* tick 1 cannot have been due yet */
    expect_rows((int64_t)summary.ticks);
    TEST_ASSERT_EQUAL_INT64((int64_t)summary.ticks + 1, tl_sql_integer(database, "SELECT count(*) FROM samples"));
    if (in_time) {
        TEST_ASSERT_EQUAL_INT64(TL_STALE, tl_sql_integer(database, "SELECT quality FROM outputs WHERE step = "
                                                                   "(SELECT max(step) FROM outputs)"));
    }
}

static void test_a_twin_that_fails_ends_it(void) {
    make_twin(MILLISECOND, 0, TL_LAG);
    tl_test_fmu_fail(&twin.fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, PROOF_STEPS + 100, UINT64_MAX);
    start();
    watch(UINT64_MAX);
    TEST_ASSERT_TRUE(shown.ended);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, end());
    TL_EXPECT_PARTS("motor", error.text);
    uint64_t steps = summary.figures.steps + summary.figures.outcomes[TL_CAUGHT_UP]; /* if busy, all */
    TEST_ASSERT_TRUE(steps >= 1);
    TEST_ASSERT_EQUAL_INT64((int64_t)steps, tl_sql_integer(database, "SELECT count(*) FROM steps"));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_cycle");
    UNITY_BEGIN();
    RUN_TEST(test_a_duration_in_mode_lag);
    RUN_TEST(test_a_duration_in_mode_hold);
    RUN_TEST(test_a_duration_in_mode_ahead);
    RUN_TEST(test_stamps_are_recorded_relative_to_the_first_tick);
    RUN_TEST(test_missed_ticks_are_made_up);
    RUN_TEST(test_what_may_have_caused_a_miss);
    RUN_TEST(test_missed_ticks_without_time);
    RUN_TEST(test_a_reset_of_the_fmus);
    RUN_TEST(test_another_tuning_in_mode_lag);
    RUN_TEST(test_another_tuning_in_mode_ahead);
    RUN_TEST(test_a_tuning_that_is_rejected);
    RUN_TEST(test_a_tuning_that_is_half_written);
    RUN_TEST(test_a_tuning_that_the_twin_already_has);
    RUN_TEST(test_a_tuning_after_a_failed_resume);
    RUN_TEST(test_stops_though_the_next_tick_is_far_away);
    RUN_TEST(test_stops_when_asked);
    RUN_TEST(test_stops_without_the_last_measurement);
    RUN_TEST(test_a_twin_that_fails_ends_it);
    return tl_scratch_finish(&scratch, UNITY_END());
}
