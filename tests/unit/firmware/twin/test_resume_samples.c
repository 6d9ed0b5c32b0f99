/* Recorded samples of the current run from a real database, for a twin that starts beside it.
 * Tests which samples of which run are found, and which images are rejected. */
#include <math.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/twin/handover.h"
#include "firmware/twin/resume.h"
#include "tests/support/course_record.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"

enum { HANDOVER = 100, OVERLAP = 5, NEWEST = 150 };

static tl_scratch scratch;
static tl_course_record run;
static unsigned char image[1 << 20];
static size_t size;
static tl_resume samples;
static tl_error error;

void setUp(void) {
    tl_course_record_open(&run, TL_SOURCE_DIR "/tests/support/motor_lock.json", tl_scratch_path(&scratch, "run.db"),
                          NEWEST);
}

void tearDown(void) {
    tl_course_record_close(&run);
    tl_scratch_empty(&scratch);
}

static void record_to(int64_t last) {
    tl_course_record_to(&run, last);
}

static void find_in(int64_t from, size_t room) {
    tl_status status = tl_resume_samples_find(run.path, run.boot, from, image, room, &size, &error);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
}

static void find(int64_t from) {
    find_in(from, sizeof image);
}

static tl_status read_image(void) {
    return tl_resume_read_samples(image, size, &run.course.assembly.config, run.course.start, &samples, &error);
}

/* The samples equal those of the plant, from the first to the last. */
static void expect_samples(int64_t first, int64_t last) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, read_image(), error.text);
    TEST_ASSERT_EQUAL_INT64(first, samples.first);
    TEST_ASSERT_EQUAL_INT64(last, samples.last);
    for (int64_t tick = first; tick <= last; tick++) {
        tl_sample wanted;
        tl_resume_tick recorded;
        tl_course_sample(&run.course, tick, &wanted);
        TEST_ASSERT_TRUE(tl_resume_tick_at(&samples, tick, &recorded));
        TEST_ASSERT_FALSE(recorded.has_u);
        const tl_sample found = recorded.sample;
        TEST_ASSERT_EQUAL_INT64(tick, found.tick);
        TEST_ASSERT_EQUAL_INT64(wanted.instant, found.instant);
        for (size_t i = 0; i < run.course.assembly.config.signal_count; i++) {
            TEST_ASSERT_EQUAL_MEMORY(&wanted.values[i], &found.values[i], sizeof wanted.values[i]);
            TEST_ASSERT_EQUAL_INT64(wanted.stamps[i], found.stamps[i]);
            TEST_ASSERT_EQUAL_UINT8(wanted.quality[i], found.quality[i]);
        }
    }
    tl_resume_tick none;
    TEST_ASSERT_FALSE(tl_resume_tick_at(&samples, first - 1, &none));
    TEST_ASSERT_FALSE(tl_resume_tick_at(&samples, last + 1, &none));
}

/* ---- which samples ---- */

static void test_from_a_tick_on(void) {
    record_to(NEWEST);
    find(40);
    expect_samples(40, NEWEST);
    find(NEWEST);
    expect_samples(NEWEST, NEWEST);
    find(NEWEST + 1);
    TEST_ASSERT_EQUAL_size_t(0, size);
    record_to(NEWEST + 20);
    find(NEWEST + 1);
    expect_samples(NEWEST + 1, NEWEST + 20);
}

/* All of them are in the last minute. */
static void test_the_newest(void) {
    record_to(NEWEST);
    find(-1);
    expect_samples(0, NEWEST);
}

static void test_as_many_as_fit(void) {
    record_to(NEWEST);
    find(40);
    size_t whole = size;
    find_in(40, whole / 2);
    TEST_ASSERT_TRUE(size <= whole / 2 && size > whole / 3);
    TEST_ASSERT_EQUAL_INT(TL_OK, read_image());
    int64_t next = samples.last + 1;
    expect_samples(40, next - 1);
    find(next);
    expect_samples(next, NEWEST);
    find_in(40, 16);
    TEST_ASSERT_EQUAL_size_t(0, size);
}

static void test_up_to_a_gap(void) {
    record_to(NEWEST);
    tl_test_queue_close(&run.box);
    tl_sql_execute(run.path,
                   "DELETE FROM main.samples WHERE tick = 60; UPDATE main.runs SET ended = NULL, ended_reason = NULL");
    find(40);
    expect_samples(40, 59);
    find(60); /* it is missing */
    TEST_ASSERT_EQUAL_size_t(0, size);
}

/* ---- of which run ---- */

/* Another configuration takes over; its run has some earlier ticks, too. */
static void handover(int64_t taken_over_at) {
    static tl_record_queue_start start;
    tl_course_search(&run.course, HANDOVER - 1, &run.box.queue);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&run.box.queue, TL_LIVE_HANDED_OVER));
    tl_account_take(run.course.assembly.twin, &start.account);
    start.resumption = (tl_resumption){
        .from = TL_RESUMED_CHECKPOINT, .run = -1, .tick = taken_over_at, .start = run.course.start, .started = 1000};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&run.box.queue, &start));
}

static void test_of_the_run_and_its_parent(void) {
    handover(HANDOVER);
    record_to(NEWEST);
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(run.path, "SELECT count(*) FROM runs"));
    find(40);
    expect_samples(40, HANDOVER - 1);
    find(HANDOVER);
    expect_samples(HANDOVER, NEWEST);
    find(-1);
    expect_samples(0, HANDOVER - 1);
}

/* Samples of the parent run are rejected, because its plant had other signals. */
static void test_a_parent_with_other_signals(void) {
    handover(HANDOVER);
    record_to(NEWEST);
    tl_sql_execute(run.path, "UPDATE signals SET name = 'plant.other' WHERE run = 1 AND kind = 'plant' AND signal = 0");
    find(40);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_image());
    find(HANDOVER);
    expect_samples(HANDOVER, NEWEST);
}

static void test_not_of_a_run_before_a_new_start(void) {
    static tl_record_queue_start start;
    tl_course_search(&run.course, HANDOVER - 1, &run.box.queue);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&run.box.queue, "SIGTERM"));
    tl_account_take(run.course.assembly.twin, &start.account);
    start.resumption = (tl_resumption){.start = run.course.start + 1, .started = 1000};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&run.box.queue, &start));
    record_to(NEWEST);
    find(40);
    run.course.start++;
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, read_image(), error.text);
    TEST_ASSERT_EQUAL_INT64(HANDOVER, samples.first);
}

static void test_not_of_a_run_that_has_ended(void) {
    record_to(NEWEST);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&run.box.queue, "end of duration"));
    tl_test_queue_write(&run.box);
    find(40);
    TEST_ASSERT_EQUAL_size_t(0, size);
}

static void test_not_of_another_boot(void) {
    record_to(NEWEST);
    run.boot[0] = run.boot[0] == 'x' ? 'y' : 'x';
    find(40);
    TEST_ASSERT_EQUAL_size_t(0, size);
}

static void test_nothing_was_recorded(void) {
    find(-1);
    TEST_ASSERT_EQUAL_size_t(0, size);
    tl_status status = tl_resume_samples_find("/nowhere/run.db", run.boot, 0, image, sizeof image, &size, &error);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status == TL_TRY_AGAIN ? TL_BAD_DATA : status);
    TEST_ASSERT_EQUAL_size_t(0, size);
}

/* ---- invalid images ---- */

/* `part`: the object that is wrong. Messages name no other object of the list. */
static void expect_refused(const char *part) {
    static const char *const objects[] = {"size", "head", "signals"};
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_image());
    TL_EXPECT_PARTS("damaged", error.text);
    TL_EXPECT_PARTS(part, error.text);
    for (size_t i = 0; i < sizeof objects / sizeof objects[0]; i++) {
        bool is_wanted = strcmp(objects[i], part) == 0;
        TEST_ASSERT_EQUAL_INT_MESSAGE(is_wanted, tl_test_has_parts(error.text, objects[i]), error.text);
    }
    TEST_ASSERT_NULL(samples.ticks);
}

static void test_of_other_signals(void) {
    record_to(NEWEST);
    find(40);
    const char *name = run.course.assembly.config.signals[1].plan.name;
    run.course.assembly.config.signals[1].plan.name = "other";
    expect_refused("signals");
    run.course.assembly.config.signals[1].plan.name = name;
    run.course.assembly.config.signal_count--;
    expect_refused("signals");
    run.course.assembly.config.signal_count++;
    run.course.assembly.config.step *= 2;
    expect_refused("signals");
    run.course.assembly.config.step /= 2;
    run.course.start++;
    expect_refused("damaged");
    run.course.start--;
    expect_samples(40, NEWEST);
}

static void test_an_image_that_is_damaged(void) {
    static const double none = (double)NAN;
    record_to(NEWEST);
    find(40);
    size_t whole = size;
    for (size = 0; size < whole; size += 13) {
        TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, read_image());
    }
    size = whole;
    image[0] ^= 1;
    expect_refused("head");
    image[0] ^= 1;
    expect_samples(40, NEWEST);
    tl_resume resume;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_resume_read(image, size, &run.course.assembly.config, tl_clock_now(NULL),
                                                      &resume, &error)); /* not a resume point */
    unsigned char *value = image + (samples.ticks - image) + 1;          /* after its flags */
    memcpy(value, &none, sizeof none);
    expect_refused("tick 40");
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_past_samples");
    UNITY_BEGIN();
    RUN_TEST(test_from_a_tick_on);
    RUN_TEST(test_the_newest);
    RUN_TEST(test_as_many_as_fit);
    RUN_TEST(test_up_to_a_gap);
    RUN_TEST(test_of_the_run_and_its_parent);
    RUN_TEST(test_a_parent_with_other_signals);
    RUN_TEST(test_not_of_a_run_before_a_new_start);
    RUN_TEST(test_not_of_a_run_that_has_ended);
    RUN_TEST(test_not_of_another_boot);
    RUN_TEST(test_nothing_was_recorded);
    RUN_TEST(test_of_other_signals);
    RUN_TEST(test_an_image_that_is_damaged);
    return tl_scratch_finish(&scratch, UNITY_END());
}
