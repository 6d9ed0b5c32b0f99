/* Warm-up of a shadow with recorded samples: which ticks it takes, how many it leaves to the cycle.
 * Also tests that it fails if the box is too slow. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/live/shadow_warm_up.h"
#include "firmware/twin/resume.h"
#include "firmware/twin/twin_recorder.h"
#include "tests/support/follower.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/test_record_queue.h"

static const tl_time STEP = TL_SECOND / 100;

static tl_scratch scratch;
static char path[PATH_MAX];
static char boot[TL_IDENTITY_TEXT];
static tl_follower twin;
static fmi2DoStepTYPE *quick_step;
static tl_time slow_time;
static tl_test_queue box;
static tl_journal journal;
static tl_heartbeats beats;
static tl_fmu_thread *thread;
static tl_time start;    /* of the run */
static int64_t recorded; /* ticks */
static size_t room;      /* for an image */
static int fetched;
static void (*at_fetch)(void);
static unsigned char image[1 << 20];
static tl_run_status figures; /* as last shown */
static tl_metrics match[TL_MAX_MATCH];
static tl_error error;

static fmi2Status slow_step(fmi2Component component, fmi2Real point, fmi2Real size, fmi2Boolean final) {
    if (slow_time != 0) {
        tl_clock_sleep_until(tl_clock_now(NULL) + slow_time);
    }
    return quick_step(component, point, size, final);
}

static void make_twin(void) {
    tl_follower_begin(&twin, STEP);
    quick_step = twin.fmu.functions.do_step;
    twin.fmu.functions.do_step = slow_step;
    tl_follower_build(&twin, 0.5);
}

static void make_recorder(void) {
    tl_recorder_settings settings = tl_follower_recording(&twin, path);
    settings.boot = boot;
    tl_test_queue_open(&box, &settings, 0);
}

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    tl_identity_boot(boot);
    slow_time = 0;
    recorded = 0;
    room = sizeof image;
    fetched = 0;
    at_fetch = NULL;
    memset(&figures, 0, sizeof figures);
    memset(match, 0, sizeof match);
    memset(&beats, 0, sizeof beats);
    tl_journal_init(&journal, NULL);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_fmu_thread_start(TL_FMU_WATCHED_HERE, &thread, &error));
    make_twin();
    make_recorder();
}

void tearDown(void) {
    tl_test_queue_close(&box);
    tl_fmu_thread_end(thread);
    tl_follower_end(&twin);
    tl_scratch_empty(&scratch);
}

static void put_tick(int64_t tick) {
    tl_sample sample = {.tick = tick, .instant = start + tick * STEP};
    sample.values[0] = 5.0 + (double)(tick % 7);
    sample.stamps[0] = sample.instant;
    TEST_ASSERT_TRUE(tl_record_queue_put_sample(&box.queue, &sample));
}

/* Records samples up to this tick, which was `ago` ago, and one more. Sets t_start. */
static void record_to(int64_t last, tl_time ago) {
    if (recorded == 0) {
        start = tl_clock_now(NULL) - ago - last * STEP;
        tl_twin_recorder_start(&box.queue, twin.assembly.twin, start);
    }
    for (; recorded <= last + 1; recorded++) {
        put_tick(recorded);
    }
    tl_test_queue_write(&box);
}

static size_t fetch(void *context, int64_t from, const void **samples) {
    size_t size = 0;
    TEST_ASSERT_EQUAL_PTR(&scratch, context);
    TEST_ASSERT_TRUE((from < 0) == (fetched == 0));
    fetched++;
    if (at_fetch != NULL) {
        at_fetch();
    }
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_resume_samples_find(path, boot, from, image, room, &size, &error),
                                  error.text);
    *samples = image;
    return size;
}

static void show(void *context, const tl_run_status *shown, const tl_metrics *shown_match) {
    TEST_ASSERT_EQUAL_PTR(&scratch, context);
    TEST_ASSERT_TRUE(shown->tick >= figures.tick);
    figures = *shown;
    memcpy(match, shown_match, sizeof match);
}

static tl_status take(int64_t *next) {
    tl_thread_heartbeat *heartbeat = tl_thread_heartbeat_start(&beats, "main", 60 * TL_SECOND);
    const tl_shadow_warm_up course = {
        .assembly = &twin.assembly,
        .thread = thread,
        .journal = &journal,
        .heartbeat = heartbeat,
        .start = start,
        .run = &twin.assembly.config,
        .fetch = fetch,
        .show = show,
        .context = &scratch,
    };
    return tl_shadow_warm_up_run(&course, next, &error);
}

/* The twin is ready for this tick. */
static void expect_ready_for(int64_t tick) {
    tl_sample sample = {.tick = tick, .instant = start + tick * STEP};
    tl_record record;
    bool ready = false;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_twin_catch_up(twin.assembly.twin, &sample, &record, &ready, &error),
                                  error.text);
}

/* ---- how far it gets ---- */

static void test_over_all_that_is_recorded(void) {
    int64_t next = 0;
    twin.assembly.config.budget_time = TL_SECOND; /* so that a busy machine does not cut searches */
    record_to(600, TL_SECOND);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(&next), error.text);
    TEST_ASSERT_TRUE(next >= 600 && next <= 601);
    TEST_ASSERT_EQUAL_INT64(next, figures.tick);
    TEST_ASSERT_EQUAL_UINT64((uint64_t)next - 1, figures.steps); /* mode lag: one less */
    TEST_ASSERT_TRUE(figures.evaluations >= figures.steps);
    TEST_ASSERT_TRUE(figures.executions >= figures.evaluations);
    TEST_ASSERT_EQUAL_UINT64(figures.steps, match[0].pairs);
    TEST_ASSERT_TRUE(match[0].sum_of_squares / (double)figures.steps < 0.25); /* it is locked */
    TEST_ASSERT_TRUE(fetched >= 1);                                           /* a slow machine fetches again */
    expect_ready_for(next);
}

/* The speed of the machine decides how many ticks are left to the cycle. */
static void need_real_time(void) {
    if (getenv("TL_EMULATOR") != NULL) {
        TEST_IGNORE_MESSAGE("an emulator has no real time");
    }
}

/* It fetches consecutive parts, and leaves the rest to the cycle. */
static void test_part_by_part(void) {
    int64_t next = 0;
    need_real_time();
    record_to(600, TL_SECOND);
    room = 2000;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(&next), error.text);
    TEST_ASSERT_TRUE(fetched > 3);
    int64_t left = (tl_clock_now(NULL) - start) / STEP - next;
    TEST_ASSERT_TRUE(left <= 2 * TL_SECOND / STEP && left > TL_SECOND / STEP);
    expect_ready_for(next);
}

static void record_more(void) {
    if (fetched == 2) {
        record_to(900, 0);
    }
}

/* It also takes samples that were recorded in the meantime. */
static void test_until_it_is_near(void) {
    int64_t next = 0;
    need_real_time();
    record_to(600, 4 * TL_SECOND);
    at_fetch = record_more;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(&next), error.text);
    TEST_ASSERT_TRUE(next >= 900 && next <= 901);
    TEST_ASSERT_EQUAL_INT(2, fetched);
    expect_ready_for(next);
}

/* If no more samples come, it leaves the rest to the cycle. */
static void test_what_is_recorded_ends_too_soon(void) {
    int64_t next = 0;
    record_to(600, 10 * TL_SECOND);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(&next), error.text);
    TEST_ASSERT_TRUE(next >= 600 && next <= 601);
    TEST_ASSERT_EQUAL_INT(2, fetched);
}

/* The shadow starts live. */
static void test_what_is_recorded_is_old(void) {
    int64_t next = 0;
    record_to(600, 80 * TL_SECOND);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(&next), error.text);
    TEST_ASSERT_TRUE(next > 600 + 80 * TL_SECOND / STEP);
    TEST_ASSERT_EQUAL_INT64(0, figures.tick);
    expect_ready_for(next);
}

static void test_nothing_is_recorded(void) {
    int64_t next = 0;
    start = tl_clock_now(NULL) - 100 * STEP;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(&next), error.text);
    TEST_ASSERT_TRUE(next >= 102 && next < 1000);
    expect_ready_for(next);
}

/* The shadow starts live. */
static void test_samples_of_another_signal(void) {
    int64_t next = 0;
    record_to(600, TL_SECOND);
    twin.signal.plan.name = "other";
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(&next), error.text);
    TEST_ASSERT_TRUE(next > 600);
    TEST_ASSERT_EQUAL_INT64(0, figures.tick);
}

/* ---- failures ---- */

static void test_an_fmu_that_fails(void) {
    int64_t next = 0;
    record_to(600, TL_SECOND);
    tl_test_fmu_fail(&twin.fmu, TL_TEST_DO_STEP, TL_TEST_ERROR, 30, UINT64_MAX);
    TEST_ASSERT_EQUAL_INT(TL_FMU_FAILED, take(&next));
    TL_EXPECT_PARTS("motor", error.text);
}

/* One execution takes longer than a step may take on half a processor. */
static void test_a_box_that_is_too_slow(void) {
    int64_t next = 0;
    record_to(600, TL_SECOND);
    slow_time = STEP / 2;
    tl_time begun = tl_clock_now(NULL);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, take(&next));
    TL_EXPECT_PARTS("two twins|1.2", error.text);
    TEST_ASSERT_TRUE(tl_clock_now(NULL) - begun >= 5 * TL_SECOND);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_recorded_course");
    UNITY_BEGIN();
    RUN_TEST(test_over_all_that_is_recorded);
    RUN_TEST(test_part_by_part);
    RUN_TEST(test_until_it_is_near);
    RUN_TEST(test_what_is_recorded_ends_too_soon);
    RUN_TEST(test_what_is_recorded_is_old);
    RUN_TEST(test_nothing_is_recorded);
    RUN_TEST(test_samples_of_another_signal);
    RUN_TEST(test_an_fmu_that_fails);
    RUN_TEST(test_a_box_that_is_too_slow);
    return tl_scratch_finish(&scratch, UNITY_END());
}
