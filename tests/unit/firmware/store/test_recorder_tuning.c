/* Tunings in the database: changes during a run, their texts and authors, and unknown texts. */
#include <limits.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/store/history.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"
#include "tests/support/test_record_queue.h"

static const char *const FIRST = "{ \"twinlock\": 1, \"first\": 1 }";
static const char *const SECOND = "{ \"twinlock\": 1, \"second\": 2 }";

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_test_queue box;
static tl_history *history;
static const tl_history_run *run;
static const tl_history_tuning *tunings;
static size_t count;
static tl_error error;
static char hashes[2][TL_SHA256_TEXT];
static char own[TL_SHA256_TEXT]; /* hash of the settings' configuration */
static tl_recorder_known known;
static tl_run_tuning tuning;

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "run.db"));
    tl_sha256(FIRST, strlen(FIRST), hashes[0]);
    tl_sha256(SECOND, strlen(SECOND), hashes[1]);
    known = (tl_recorder_known){
        .number = 2, .hash = hashes[0], .text = FIRST, .who = "ann", .origin = "push", .why = "a first try"};
    memset(&tuning, 0, sizeof tuning);
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
    tl_sha256(settings.configuration, strlen(settings.configuration), own);
    settings.verb = "run";
    settings.max_bytes = max_bytes;
    settings.known = &known;
    settings.known_count = 1;
    tl_test_queue_open(&box, &settings, 0);
}

static void begin_run(const char *configured) {
    static tl_record_queue_start start;
    (void)snprintf(tuning.hash, sizeof tuning.hash, "%s", configured);
    tuning.number = 0;
    tl_record_queue_name_configuration(&box.queue, &tuning);
    tl_made_beginning(1234, &start);
    TEST_ASSERT_TRUE(tl_record_queue_put_start(&box.queue, &start));
}

static void put(int64_t first, int64_t ticks) {
    TEST_ASSERT_TRUE(tl_made_put_out(&box.queue, first, ticks));
}

static void take(int64_t tick, uint32_t number, const char *hash) {
    tuning.tick = tick;
    tuning.number = number;
    (void)snprintf(tuning.hash, sizeof tuning.hash, "%s", hash);
    TEST_ASSERT_TRUE(tl_record_queue_put_tuning(&box.queue, &tuning));
}

static void write_out(void) {
    tl_test_queue_write(&box);
}

static void close_writer(void) {
    TEST_ASSERT_TRUE(tl_record_queue_put_end(&box.queue, "SIGTERM"));
    tl_test_queue_close(&box);
}

static tl_status read_tunings(int64_t id) {
    tl_history_close(history);
    history = NULL;
    expect_ok(tl_history_open(path, &history, &error));
    expect_ok(tl_history_find(history, id, &run, &error));
    return tl_history_tunings(history, run, &tunings, &count, &error);
}

static void expect_tuning(size_t index, int64_t tick, const char *hash, const char *who_origin_why) {
    char found[300];
    TEST_ASSERT_TRUE(index < count);
    const tl_history_tuning *one = &tunings[index];
    TEST_ASSERT_EQUAL_INT64(tick, one->tick);
    TEST_ASSERT_EQUAL_STRING(hash, one->hash);
    (void)snprintf(found, sizeof found, "%s|%s|%s", one->who, one->origin, one->why);
    TEST_ASSERT_EQUAL_STRING(who_origin_why, found);
}

static void expect_text(const char *hash, const char *wanted) {
    const char *text = NULL;
    expect_ok(tl_history_configuration_text(history, hash, &text, &error));
    TEST_ASSERT_EQUAL_STRING(wanted, text);
}

static uint32_t stored(void) {
    return tl_recorder_state_get(box.state).tuning;
}

/* ---- content ---- */

static void a_tuning_is_recorded_with_its_text(void) {
    open_writer(0);
    begin_run("");
    put(0, 5);
    write_out();
    TEST_ASSERT_EQUAL_UINT32(0, stored());
    take(5, 2, hashes[0]);
    put(5, 5);
    write_out();
    TEST_ASSERT_EQUAL_UINT32(2, stored());
    known = (tl_recorder_known){
        .number = 4, .hash = hashes[1], .text = SECOND, .who = "bo", .origin = "reload", .why = "another"};
    take(10, 4, hashes[1]);
    put(10, 5);
    close_writer();
    expect_ok(read_tunings(1));
    TEST_ASSERT_EQUAL_size_t(2, count);
    expect_tuning(0, 5, hashes[0], "ann|push|a first try");
    expect_tuning(1, 10, hashes[1], "bo|reload|another");
    expect_text(hashes[0], FIRST);
    expect_text(hashes[1], SECOND);
    TEST_ASSERT_EQUAL_STRING(own, run->configuration_hash);
    TEST_ASSERT_EQUAL_UINT64(0, run->lost);
    TEST_ASSERT_EQUAL_STRING("5|0.05|ann", tl_sql_text(path, "SELECT tick || '|' || time_s || '|' || who FROM v_tunings"
                                                             " ORDER BY tick ASC LIMIT 1"));
}

/* A successor records a tuning again that it repeats. Author and reason come from the first
 * record. */
static void a_resumed_run_records_its_tuning_again(void) {
    open_writer(0);
    begin_run("");
    put(0, 5);
    take(5, 2, hashes[0]);
    put(5, 5);
    write_out();
    known = (tl_recorder_known){.number = 4, .hash = hashes[1], .text = SECOND, .who = "", .origin = "", .why = ""};
    begin_run("");
    put(3, 2);
    take(5, 2, hashes[0]);
    put(5, 5);
    close_writer();
    expect_ok(read_tunings(2));
    TEST_ASSERT_EQUAL_size_t(1, count);
    expect_tuning(0, 5, hashes[0], "ann|push|a first try");
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(path, "SELECT count(DISTINCT at) FROM tunings"));
}

/* A return to the run's first configuration: its text exists, and it has no author or reason. */
static void the_runs_own_configuration_may_come_back(void) {
    open_writer(0);
    begin_run("");
    put(0, 5);
    take(5, 6, own);
    put(5, 5);
    close_writer();
    expect_ok(read_tunings(1));
    TEST_ASSERT_EQUAL_size_t(1, count);
    expect_tuning(0, 5, own, "||");
}

/* A replay cannot use a tuning without a text, and a twin could fill the file with them. */
static void a_tuning_with_an_unknown_text_is_lost(void) {
    open_writer(0);
    begin_run("");
    put(0, 5);
    take(5, 8, hashes[1]);
    take(6, 8, "");
    put(5, 5);
    close_writer();
    expect_ok(read_tunings(1));
    TEST_ASSERT_EQUAL_size_t(0, count);
    TEST_ASSERT_EQUAL_UINT64(2, run->lost);
    TEST_ASSERT_EQUAL_INT64(10, tl_sql_integer(path, "SELECT count(DISTINCT tick) FROM samples"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(path, "SELECT count(*) FROM configurations"));
}

static void a_tuning_with_an_invalid_tick_is_lost(void) {
    open_writer(0);
    begin_run("");
    put(0, 5);
    take(-1, 2, hashes[0]);
    take(INT64_MAX, 2, hashes[0]);
    put(5, 5);
    close_writer();
    expect_ok(read_tunings(1));
    TEST_ASSERT_EQUAL_size_t(0, count);
    TEST_ASSERT_EQUAL_UINT64(2, run->lost);
}

/* A restarted twin may have another configuration than the recorder had at its start. */
static void a_run_may_start_with_another_configuration(void) {
    const char *text = NULL;
    open_writer(0);
    begin_run(hashes[0]);
    put(0, 5);
    write_out();
    begin_run(hashes[1]);
    put(0, 5);
    write_out();
    TEST_ASSERT_EQUAL_STRING("",
                             tl_sql_text(path, "SELECT c.text FROM configurations c JOIN runs ON configuration = hash"
                                               " WHERE run = 2"));
    known = (tl_recorder_known){.hash = hashes[1], .text = SECOND, .who = "", .origin = "", .why = ""};
    take(5, 0, hashes[1]);
    put(5, 5);
    close_writer();
    expect_ok(read_tunings(1));
    TEST_ASSERT_EQUAL_STRING(hashes[0], run->configuration_hash);
    expect_ok(tl_history_configuration_text(history, run->configuration_hash, &text, &error));
    TEST_ASSERT_EQUAL_STRING(FIRST, text);
    expect_ok(read_tunings(2));
    TEST_ASSERT_EQUAL_STRING(hashes[1], run->configuration_hash);
    expect_ok(tl_history_configuration_text(history, run->configuration_hash, &text, &error));
    TEST_ASSERT_EQUAL_STRING(SECOND, text);
}

/* ---- the bound ---- */

/* Removed ticks leave only the tuning that is active in the first kept tick, or the last one. */
static void tunings_of_removed_ticks(void) {
    enum { AT_ONCE = 500, ALL = 40000 };
    open_writer(1000000);
    begin_run("");
    put(0, AT_ONCE);
    take(AT_ONCE, 2, hashes[0]);
    write_out();
    begin_run("");
    for (int64_t tick = 0; tick < ALL; tick += AT_ONCE) {
        take(tick, 2, tick % (2 * AT_ONCE) == 0 ? hashes[0] : own);
        put(tick, AT_ONCE);
        write_out();
    }
    close_writer();
    TEST_ASSERT_EQUAL_INT64(0, tl_sql_integer(path, "SELECT count(*) FROM samples WHERE run = 1"));
    TEST_ASSERT_EQUAL_INT64(1, tl_sql_integer(path, "SELECT count(*) FROM tunings WHERE tunings.run = 1"));
    int64_t first = tl_sql_integer(path, "SELECT removed_before FROM runs WHERE runs.run = 2");
    TEST_ASSERT_TRUE(first > 2 * AT_ONCE);
    expect_ok(read_tunings(2));
    TEST_ASSERT_GREATER_THAN_size_t(1, count);
    TEST_ASSERT_GREATER_OR_EQUAL_INT64(tunings[0].tick, first);
    TEST_ASSERT_GREATER_THAN_INT64(first, tunings[1].tick);
    expect_text(hashes[0], FIRST);
}

/* ---- damaged files ---- */

static void record_one(void) {
    open_writer(0);
    begin_run("");
    put(0, 5);
    take(5, 2, hashes[0]);
    put(5, 5);
    close_writer();
}

static void damage_is_detected(void) {
    static const char *const damages[] = {
        "UPDATE tunings SET configuration = replace(configuration, substr(configuration, 1, 1), char(27))",
        "UPDATE tunings SET tick = -1",
        "UPDATE tunings SET tick = 9223372036854775807",
        "UPDATE tunings SET tick = 'five'",
        "UPDATE tunings SET configuration = 'short'",
        "UPDATE tunings SET at = 'yesterday'",
        "UPDATE tunings SET who = x'00ff'",
        "UPDATE tunings SET why = zeroblob(9000)",
        "UPDATE tunings SET origin = x'41'",
    };
    for (size_t i = 0; i < sizeof damages / sizeof damages[0]; i++) {
        record_one();
        tl_sql_execute(path, damages[i]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_BAD_DATA, read_tunings(1), damages[i]);
        TL_EXPECT_PARTS("/run.db|damaged|tunings|run 1", error.text);
        tearDown();
        setUp();
    }
    record_one();
    tl_sql_execute(path, "DELETE FROM configurations");
    expect_ok(read_tunings(1));
    const char *text = NULL;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_history_configuration_text(history, hashes[0], &text, &error));
    TEST_ASSERT_NULL(text);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_recorder_tuning");
    UNITY_BEGIN();
    RUN_TEST(a_tuning_is_recorded_with_its_text);
    RUN_TEST(a_resumed_run_records_its_tuning_again);
    RUN_TEST(the_runs_own_configuration_may_come_back);
    RUN_TEST(a_tuning_with_an_unknown_text_is_lost);
    RUN_TEST(a_tuning_with_an_invalid_tick_is_lost);
    RUN_TEST(a_run_may_start_with_another_configuration);
    RUN_TEST(tunings_of_removed_ticks);
    RUN_TEST(damage_is_detected);
    return tl_scratch_finish(&scratch, UNITY_END());
}
