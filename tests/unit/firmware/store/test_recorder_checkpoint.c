/* Checkpoints and starts of runs in the database: which are kept and read, and the size of the
 * file. */
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"
#include "firmware/store/history.h"
#include "tests/support/made_run.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/test_record_queue.h"

enum { SIZE = 5000, LARGE = 60000, TOO_LARGE = 200000 };

static tl_scratch scratch;
static char path[PATH_MAX];
static char wal[PATH_MAX + 8];
static tl_test_queue box;
static tl_history *history;
static const tl_history_run *run;
static tl_error error;

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    (void)snprintf(wal, sizeof wal, "%s-wal", path);
    history = NULL;
}

void tearDown(void) {
    tl_history_close(history);
    tl_test_queue_close(&box);
    tl_scratch_empty(&scratch);
}

static void expect_ok(tl_status status) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, status, error.text);
}

static void open_writer(int64_t max_bytes) {
    tl_recorder_settings settings = tl_made_settings(path);
    settings.verb = "run";
    settings.max_bytes = max_bytes;
    settings.fmus = "digest";
    settings.boot = "boot";
    settings.format = "this one";
    tl_test_queue_open(&box, &settings, TOO_LARGE);
}

static void begin_run(int64_t max_bytes) {
    static tl_record_queue_start start;
    open_writer(max_bytes);
    tl_made_beginning(1234, &start);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&box.queue, &start));
}

static void close_writer(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&box.queue, "SIGTERM"));
    tl_test_queue_close(&box);
}

static void put(int64_t first, int64_t ticks) {
    enum { AT_ONCE = 500 };
    for (int64_t done = 0; done < ticks; done += AT_ONCE) {
        TEST_ASSERT_TRUE(tl_made_put_out(&box.queue, first + done, ticks - done < AT_ONCE ? ticks - done : AT_ONCE));
        tl_test_queue_write(&box);
    }
}

static unsigned char byte_of(int64_t tick, size_t i) {
    return (unsigned char)((uint64_t)tick * 7 + i * 13 + i / 251);
}

static void put_checkpoint(int64_t tick, size_t size) {
    size_t capacity = 0;
    TEST_ASSERT_TRUE(tl_record_queue_reserve_checkpoint(&box.queue, size));
    unsigned char *room = tl_record_queue_checkpoint_room(&box.queue, &capacity);
    TEST_ASSERT_NOT_NULL(room);
    TEST_ASSERT_GREATER_OR_EQUAL_size_t(size, capacity);
    for (size_t i = 0; i < size; i++) {
        room[i] = byte_of(tick, i);
    }
    tl_record_queue_put_checkpoint(&box.queue, tick, size);
    tl_test_queue_write(&box);
}

static void open_history(int64_t id) {
    tl_history_close(history);
    history = NULL;
    expect_ok(tl_history_open(path, &history, &error));
    expect_ok(tl_history_find(history, id, &run, &error));
}

static const tl_history_checkpoint *checkpoint_before(int64_t tick) {
    const tl_history_checkpoint *checkpoint = NULL;
    expect_ok(tl_history_checkpoint_before(history, run, tick, &checkpoint, &error));
    return checkpoint;
}

static void expect_checkpoint(const tl_history_checkpoint *checkpoint, int64_t tick, size_t size) {
    TEST_ASSERT_NOT_NULL(checkpoint);
    TEST_ASSERT_EQUAL_INT64(tick, checkpoint->tick);
    TEST_ASSERT_TRUE(checkpoint->whole);
    TEST_ASSERT_EQUAL_STRING("this one", checkpoint->format);
    TEST_ASSERT_EQUAL_size_t(size, checkpoint->size);
    for (size_t i = 0; i < size; i++) {
        TEST_ASSERT_EQUAL_HEX8(byte_of(tick, i), checkpoint->bytes[i]);
    }
}

/* ---- kept checkpoints ---- */

static void test_the_two_newest_and_the_first_are_kept(void) {
    static tl_record_queue_start start;
    open_writer(0);
    tl_made_beginning(0, &start);
    start.resumption =
        (tl_resumption){.from = TL_RESUMED_CHECKPOINT, .run = 7, .tick = 20, .start = -5, .started = 1000};
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&box.queue, &start));
    for (int64_t tick = 10; tick < 60; tick += 10) {
        put_checkpoint(tick, SIZE - (size_t)tick);
        put(tick, 10);
    }
    close_writer();
    open_history(1);
    expect_checkpoint(checkpoint_before(INT64_MAX), 50, SIZE - 50);
    expect_checkpoint(checkpoint_before(50), 40, SIZE - 40);
    expect_checkpoint(checkpoint_before(40), 10, SIZE - 10); /* the first one */
    TEST_ASSERT_NULL(checkpoint_before(10));
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_CHECKPOINT, run->resumption.from);
    TEST_ASSERT_EQUAL_INT64(7, run->resumption.run);
    TEST_ASSERT_EQUAL_INT64(20, run->resumption.tick);
    TEST_ASSERT_TRUE(run->has_start);
    TEST_ASSERT_EQUAL_INT64(-5, run->start);
    TEST_ASSERT_EQUAL_STRING("digest", run->fmus);
    TEST_ASSERT_EQUAL_STRING("boot", run->boot);
    int64_t started = 0;
    TEST_ASSERT_TRUE(tl_utc_parse(run->started, &started)); /* not 1970, as the start says: its clock was wrong */
    TEST_ASSERT_INT64_WITHIN(5000, tl_utc_now() - tl_clock_now(NULL) / 1000000, started);
}

static void test_a_run_that_resumes_nothing(void) {
    begin_run(0);
    put(0, 10);
    close_writer();
    open_history(1);
    TEST_ASSERT_EQUAL_INT(TL_RESUMED_NOT, run->resumption.from);
    TEST_ASSERT_EQUAL_INT64(1234, run->start);
    TEST_ASSERT_NULL(checkpoint_before(INT64_MAX));
}

static void test_damage_is_detected(void) {
    begin_run(0);
    put_checkpoint(3, SIZE);
    close_writer();
    tl_sql_execute(path, "UPDATE checkpoints SET bytes = zeroblob(5000)");
    open_history(1);
    TEST_ASSERT_FALSE(checkpoint_before(INT64_MAX)->whole);
    tl_sql_execute(path, "UPDATE checkpoints SET bytes = x''");
    open_history(1);
    TEST_ASSERT_FALSE(checkpoint_before(INT64_MAX)->whole);
}

/* ---- within the bound ---- */

static int64_t size_of(const char *name) {
    struct stat status;
    return stat(name, &status) == 0 ? (int64_t)status.st_size : 0;
}

static void test_the_bound_holds(void) {
    const int64_t bound = 1000000;
    begin_run(bound);
    put_checkpoint(-1, SIZE);
    put_checkpoint(0, TOO_LARGE); /* is not stored */
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(path, "SELECT count(*) FROM checkpoints"));
    for (int64_t tick = 0; tick < 20000; tick += 500) {
        put(tick, 500);
        put_checkpoint(tick + 499, LARGE);
        TEST_ASSERT_LESS_OR_EQUAL_INT64(bound, size_of(path) + size_of(wal));
    }
    close_writer();
    int64_t first = tl_sql_integer(path, "SELECT removed_before FROM runs");
    TEST_ASSERT_GREATER_THAN_INT64(0, first);
    TEST_ASSERT_EQUAL_INT64(2, tl_sql_integer(path, "SELECT count(*) FROM checkpoints"));
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(first - 1, tl_sql_integer(path, "SELECT min(tick) FROM checkpoints"));
    TEST_ASSERT_EQUAL_STRING("ok", tl_sql_text(path, "PRAGMA integrity_check"));
}

/* A run whose ticks are removed leaves no checkpoint. */
static void test_removed_with_the_run(void) {
    begin_run(0);
    put_checkpoint(0, LARGE);
    put(0, 2000);
    close_writer();
    begin_run(1000000);
    put(0, 20000);
    close_writer();
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(path, "SELECT count(*) FROM samples WHERE run = 1"));
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(path, "SELECT count(*) FROM checkpoints"));
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_recorder_checkpoint");
    UNITY_BEGIN();
    RUN_TEST(test_the_two_newest_and_the_first_are_kept);
    RUN_TEST(test_a_run_that_resumes_nothing);
    RUN_TEST(test_damage_is_detected);
    RUN_TEST(test_the_bound_holds);
    RUN_TEST(test_removed_with_the_run);
    return tl_scratch_finish(&scratch, UNITY_END());
}
