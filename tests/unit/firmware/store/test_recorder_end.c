/* End of a run that its twin has not recorded: the last writer records it, other writers do not. */
#include <unity.h>

#include "tests/support/made_run.h"
#include "tests/support/sql.h"
#include "tests/support/writer_bench.h"

static tl_writer_bench bench;

void setUp(void) {
    tl_writer_bench_begin(&bench);
}

void tearDown(void) {
    tl_writer_bench_end(&bench);
}

static void close_well(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_writer_bench_close(&bench), bench.error.text);
}

static const char *end_of(void) {
    return tl_sql_text(bench.path, "SELECT coalesce(ended_reason, 'open') FROM runs");
}

/* Records ten ticks of a run with one writer. */
static void record(bool is_last) {
    bench.is_last = is_last;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    tl_writer_bench_put(&bench, 0, 10);
    close_well();
}

static void test_another_writer_may_follow(void) {
    record(false);
    TEST_ASSERT_EQUAL_STRING("open", end_of());
}

static void test_the_last_one_ends_the_run(void) {
    record(true);
    TEST_ASSERT_EQUAL_STRING("not ended cleanly", end_of());
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(bench.path, "SELECT ended = committed FROM runs"));
    tl_writer_bench_expect_whole(bench.path);
}

static void test_a_recorded_end_is_kept(void) {
    bench.is_last = true;
    tl_writer_bench_open(&bench);
    tl_writer_bench_start(&bench, 1);
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&bench.twin, "SIGTERM"));
    close_well();
    TEST_ASSERT_EQUAL_STRING("SIGTERM", end_of());
}

/* A writer was wrongly ended as the last one, and another one follows. */
static void test_it_was_not_the_last_one(void) {
    record(true);
    tl_writer_bench_put(&bench, 10, 10);
    bench.is_last = false;
    tl_writer_bench_open(&bench);
    close_well();
    TEST_ASSERT_EQUAL_STRING("open", end_of());
    TEST_ASSERT_EQUAL_INT64(20, tl_sql_integer(bench.path, "SELECT samples_written FROM runs"));
    tl_writer_bench_expect_whole(bench.path);
}

/* The twin has died in the step of its last sample. */
static void test_the_last_sample_has_no_step(void) {
    tl_sample sample;
    record(false);
    tl_made_sample(10, &sample);
    TEST_ASSERT_TRUE(tl_record_queue_put_sample(&bench.twin, &sample));
    tl_writer_bench_open(&bench);
    close_well();
    /* the step may still come */
    TEST_ASSERT_EQUAL_INT64(10, tl_sql_integer(bench.path, "SELECT samples_written FROM runs"));
    bench.is_last = true;
    tl_writer_bench_open(&bench);
    close_well();
    TEST_ASSERT_EQUAL_STRING("11 10 not ended cleanly", tl_sql_text(bench.path, "SELECT samples_written || ' ' ||"
                                                                                " steps_written || ' ' || ended_reason"
                                                                                " FROM runs"));
    tl_writer_bench_expect_whole(bench.path);
}

static void test_without_a_run_there_is_no_end(void) {
    bench.is_last = true;
    tl_writer_bench_open(&bench);
    close_well();
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(bench.path, "SELECT count(*) FROM runs"));
}

int main(void) {
    UNITY_BEGIN();
    tl_scratch_make(&bench.scratch, TL_BINARY_DIR, "test_recorder_end");
    RUN_TEST(test_another_writer_may_follow);
    RUN_TEST(test_the_last_one_ends_the_run);
    RUN_TEST(test_a_recorded_end_is_kept);
    RUN_TEST(test_it_was_not_the_last_one);
    RUN_TEST(test_the_last_sample_has_no_step);
    RUN_TEST(test_without_a_run_there_is_no_end);
    tl_scratch_remove(&bench.scratch);
    return UNITY_END();
}
