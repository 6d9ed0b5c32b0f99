/* A shadow requests recorded samples, and the recorder answers. */
#include <string.h>

#include <unity.h>

#include "firmware/live/live_blocks.h"
#include "firmware/twin/resume.h"
#include "tests/support/course_record.h"
#include "tests/support/scratch.h"

enum { NEWEST = 150, ROOM = 1 << 20 };

static tl_scratch scratch;
static tl_course_record run;
static tl_live_twin_status live_status;
static tl_live_resume_answer answer;
static tl_block resume;
static tl_live_samples wishes;
static tl_resume samples;
static tl_error error;

void setUp(void) {
    tl_course_record_open(&run, TL_SOURCE_DIR "/tests/support/motor_lock.json", tl_scratch_path(&scratch, "run.db"),
                          NEWEST);
    tl_course_record_to(&run, NEWEST);
    memset(&live_status, 0, sizeof live_status);
    memset(&answer, 0, sizeof answer);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make("past", ROOM, TL_BLOCK_THEY_WRITE, &resume, &error));
    wishes = (tl_live_samples){.live_status = &live_status, .answer = &answer, .resume = &resume, .boot = run.boot};
}

void tearDown(void) {
    tl_block_close(&resume);
    tl_course_record_close(&run);
    tl_scratch_empty(&scratch);
}

static void request_samples(uint32_t number, int64_t from) {
    live_status.resumed_from = from;
    live_status.resume = tl_live_request_of(7, number);
}

static tl_status read_past(void) {
    return tl_resume_read_samples(resume.bytes, (size_t)answer.size, &run.course.assembly.config, run.course.start,
                                  &samples, &error);
}

static void test_one_wish_after_the_other(void) {
    tl_live_samples_answer(&wishes, run.path);
    TEST_ASSERT_EQUAL_UINT64(0, answer.live_request);
    request_samples(1, 40);
    tl_live_samples_answer(&wishes, run.path);
    TEST_ASSERT_EQUAL_UINT64(live_status.resume, answer.live_request);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, read_past(), error.text);
    TEST_ASSERT_EQUAL_INT64(40, samples.first);
    TEST_ASSERT_EQUAL_INT64(NEWEST, samples.last);
    request_samples(2, NEWEST);
    tl_live_samples_answer(&wishes, run.path);
    TEST_ASSERT_EQUAL_UINT64(live_status.resume, answer.live_request);
    TEST_ASSERT_EQUAL_INT(TL_OK, read_past());
    TEST_ASSERT_EQUAL_INT64(NEWEST, samples.first);
    request_samples(3, NEWEST + 1);
    tl_live_samples_answer(&wishes, run.path);
    TEST_ASSERT_EQUAL_UINT64(live_status.resume, answer.live_request);
    TEST_ASSERT_EQUAL_UINT64(0, answer.size);
    TEST_ASSERT_EQUAL_STRING("", answer.words[0].text);
}

/* Each request is answered once. */
static void test_a_wish_that_was_answered(void) {
    request_samples(1, 40);
    tl_live_samples_answer(&wishes, run.path);
    answer.size = 1;
    tl_live_samples_answer(&wishes, run.path);
    TEST_ASSERT_EQUAL_UINT64(1, answer.size);
}

/* After the shadow has begun, the memory is freed and further requests are ignored. */
static void test_nobody_wants_any_more(void) {
    request_samples(1, 40);
    tl_live_samples_answer(&wishes, run.path);
    live_status.begun = 1;
    tl_live_samples_answer(&wishes, run.path);
    const unsigned char *bytes = resume.bytes;
    for (size_t i = 0; i < ROOM; i++) {
        TEST_ASSERT_EQUAL_UINT8(0, bytes[i]);
    }
    request_samples(2, 40);
    tl_live_samples_answer(&wishes, run.path);
    TEST_ASSERT_EQUAL_UINT64(tl_live_request_of(7, 1), answer.live_request);
}

static void test_a_database_that_is_none(void) {
    request_samples(1, 40);
    tl_live_samples_answer(&wishes, "/nowhere/run.db");
    TEST_ASSERT_EQUAL_UINT64(live_status.resume, answer.live_request);
    TEST_ASSERT_EQUAL_UINT64(0, answer.size);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(answer.words[0].text, "/nowhere/run.db"), answer.words[0].text);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_live_samples");
    UNITY_BEGIN();
    RUN_TEST(test_one_wish_after_the_other);
    RUN_TEST(test_a_wish_that_was_answered);
    RUN_TEST(test_nobody_wants_any_more);
    RUN_TEST(test_a_database_that_is_none);
    return tl_scratch_finish(&scratch, UNITY_END());
}
