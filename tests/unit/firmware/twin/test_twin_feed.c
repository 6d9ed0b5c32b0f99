/* The feed of a twin: which ticks come, in which order, and the end. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/twin/twin_child.h"
#include "tests/support/config_text.h"
#include "tests/support/scratch.h"
#include "tests/support/start_twin.h"

#define LOCK TL_SOURCE_DIR "/tests/support/motor_lock.json"

enum { ROWS = 700, SOME = 20, ROW = 12 /* bytes */ };

static tl_scratch scratch;
static char config_path[PATH_MAX];
static char recording_path[PATH_MAX];
static tl_config config;
static tl_twin_child *child;
static tl_account account;
static tl_recording *recording;
static tl_twin_feed *feed;
static tl_twin_fed fed;
static tl_error error;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    (void)snprintf(config_path, sizeof config_path, "%s", tl_scratch_path(&scratch, "config.json"));
    (void)snprintf(recording_path, sizeof recording_path, "%s", tl_scratch_path(&scratch, "recording.csv"));
    error = (tl_error){TL_OK, ""};
}

static void close_all(void) {
    tl_twin_feed_close(feed);
    tl_recording_close(recording);
    tl_twin_child_close(child);
    tl_config_free(&config);
    feed = NULL;
    recording = NULL;
    child = NULL;
}

void tearDown(void) {
    close_all();
    tl_scratch_empty(&scratch);
}

/* Each row has ROW bytes. One more row lets the last instant be reached. */
static void write_recording(int ticks) {
    FILE *file = fopen(recording_path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("t,o,M_brake\n", file);
    for (int i = 0; i < ticks; i++) {
        (void)fprintf(file, "%06.2f,63,0\n", i * 0.01);
    }
    (void)fclose(file);
}

static char *replace(char *text, const char *old, const char *new) {
    char *changed = tl_test_replaced(text, old, new);
    TEST_ASSERT_NOT_NULL_MESSAGE(changed, old);
    free(text);
    return changed;
}

/* horizon: members of that object. duration: that member with a comma, or empty. */
static void write_config(const char *horizon, const char *duration) {
    char *text = tl_test_read_text(LOCK);
    text = replace(text, "\"prediction\": 1, \"measurements\": \"lag\"", horizon);
    text = replace(text, "\"duration_s\": 14,", duration);
    text = replace(text, "\"column\": \"omega\"", "\"column\": \"o\"");
    FILE *file = fopen(config_path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs(text, file);
    (void)fclose(file);
    free(text);
}

static void open_feed(bool plant, bool paced) {
    tl_report report = {0};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_read(config_path, &config, &report));
    tl_config_use_lookups(&config);
    child = tl_test_start_twin(&config, TL_ATTACHED_NONE, &account);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_recording_open(recording_path, &config, &recording, &error), error.text);
    const tl_twin_feed_settings settings = {
        .config = &config, .account = &account, .recording = recording, .child = child, .plant = plant, .paced = paced};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_feed_open(&settings, &feed, &error));
}

static void open_with(const char *horizon, const char *duration, int ticks) {
    write_recording(ticks);
    write_config(horizon, duration);
    open_feed(false, false);
}

/* Ticks and records up to the end. Both are consecutive. */
typedef struct tally {
    int64_t steps;
    int64_t records;
    int64_t lasts; /* ticks that only complete a record */
    tl_status status;
} tally;

static tally take_all(void) {
    tally sum = {0};
    bool end = false;
    for (;;) {
        sum.status = tl_twin_feed_next(feed, &fed, &end, &error);
        if (end || sum.status != TL_OK) {
            return sum;
        }
        TEST_ASSERT_EQUAL_INT64(0, sum.lasts); /* none after the last one */
        TEST_ASSERT_EQUAL_INT64(sum.steps, fed.tick->sample.tick);
        TEST_ASSERT_EQUAL_INT64(sum.steps, fed.result->tick);
        if (fed.result->ready != 0) {
            TEST_ASSERT_EQUAL_INT64(sum.records, fed.result->record.step);
            sum.records++;
        }
        sum.lasts += fed.last ? 1 : 0;
        sum.steps += fed.last ? 0 : 1;
    }
}

static void expect_tally(tally found, int64_t steps, int64_t records, int64_t lasts) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, found.status, error.text);
    TEST_ASSERT_EQUAL_INT64(steps, found.steps);
    TEST_ASSERT_EQUAL_INT64(records, found.records);
    TEST_ASSERT_EQUAL_INT64(lasts, found.lasts);
    bool end = false;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_feed_next(feed, &fed, &end, &error)); /* still at the end */
    TEST_ASSERT_TRUE(end);
    TEST_ASSERT_NULL(tl_twin_feed_poll(feed));
}

/* ---- modes ---- */

/* Each tick computes a step. Its record, with y at t_(i+1), is complete in the same tick. */
static void test_lag(void) {
    open_with("\"prediction\": 1, \"measurements\": \"lag\"", "", ROWS);
    expect_tally(take_all(), ROWS, ROWS - account.lead, 0);
    TEST_ASSERT_EQUAL_UINT32(1, account.lead);
}

static void test_lag_further_ahead(void) {
    open_with("\"prediction\": 3, \"measurements\": \"lag\"", "", ROWS);
    TEST_ASSERT_EQUAL_UINT32(3, account.lead);
    expect_tally(take_all(), ROWS, ROWS - 3, 0);
}

static void test_hold(void) {
    open_with("\"prediction\": 1, \"measurements\": \"hold\"", "", ROWS);
    tally found = take_all();
    expect_tally(found, ROWS, ROWS - account.lead, 0);
}

/* The last tick computes no step, because its measurement would not come. It completes the last
 * record. */
static void test_ahead(void) {
    open_with("\"prediction\": 1, \"measurements\": \"ahead\"", "", ROWS);
    TEST_ASSERT_EQUAL_UINT32(0, account.lead);
    expect_tally(take_all(), ROWS - 1, ROWS - 1, 1);
}

static void test_a_plant_steps_at_each_tick(void) {
    write_recording(ROWS);
    write_config("\"prediction\": 1, \"measurements\": \"ahead\"", "\"duration_s\": 1,");
    open_feed(true, false);
    tally found = take_all();
    TEST_ASSERT_EQUAL_INT64(ROWS, found.steps);
    TEST_ASSERT_EQUAL_INT64(0, found.lasts);
}

/* ---- duration ---- */

/* The duration limits the records. Their number is the same in all modes. */
static void test_the_duration_ends_it(void) {
    static const char *const modes[] = {
        "\"prediction\": 1, \"measurements\": \"lag\"", "\"prediction\": 2, \"measurements\": \"lag\"",
        "\"prediction\": 1, \"measurements\": \"hold\"", "\"prediction\": 1, \"measurements\": \"ahead\""};
    for (size_t i = 0; i < sizeof modes / sizeof modes[0]; i++) {
        open_with(modes[i], "\"duration_s\": 2,", ROWS);
        int64_t last = tl_twin_feed_last_tick(&config, &account);
        TEST_ASSERT_EQUAL_INT64(200 + account.lead, last);
        tally found = take_all();
        TEST_ASSERT_EQUAL_INT64(last + 1, found.steps);
        TEST_ASSERT_EQUAL_INT64(201, found.records);
        close_all();
    }
}

static void test_a_duration_beyond_the_recording(void) {
    open_with("\"prediction\": 1, \"measurements\": \"lag\"", "\"duration_s\": 1000,", ROWS);
    expect_tally(take_all(), ROWS, ROWS - 1, 0);
}

static void test_without_a_duration(void) {
    open_with("\"prediction\": 1, \"measurements\": \"lag\"", "", SOME);
    TEST_ASSERT_EQUAL_INT64(INT64_MAX, tl_twin_feed_last_tick(&config, &account));
}

/* ---- short recordings ---- */

static void test_a_single_tick(void) {
    open_with("\"prediction\": 1, \"measurements\": \"lag\"", "", 1);
    expect_tally(take_all(), 1, 0, 0);
    close_all();
    open_with("\"prediction\": 1, \"measurements\": \"ahead\"", "", 1);
    expect_tally(take_all(), 0, 0, 1);
}

/* ---- an error in the middle ---- */

/* The file is overwritten during the read: earlier rows are used, then an error ends the feed. */
static void test_a_recording_that_breaks(void) {
    bool end = false;
    open_with("\"prediction\": 1, \"measurements\": \"lag\"", "", 100 * ROWS);
    int file = open(recording_path, O_WRONLY | O_CLOEXEC);
    TEST_ASSERT_EQUAL_INT(ROW, pwrite(file, "not a number", ROW, (off_t)ROW * 80 * ROWS));
    (void)close(file);
    tally found = take_all();
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, found.status);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(error.text, "recording.csv"), error.text);
    TEST_ASSERT_INT64_WITHIN(10, 80 * ROWS, found.steps);
    tl_error again = {TL_OK, ""};
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_twin_feed_next(feed, &fed, &end, &again));
    TEST_ASSERT_TRUE(end);
    TEST_ASSERT_EQUAL_STRING(error.text, again.text);
}

/* ---- looking and stopping ---- */

static void test_looking_takes_nothing(void) {
    bool end = false;
    write_recording(SOME);
    write_config("\"prediction\": 1, \"measurements\": \"lag\"", "");
    open_feed(false, true);
    for (int64_t tick = 0; tick < SOME; tick++) {
        for (int i = 0; i < 3; i++) {
            const tl_recording_tick *next = tl_twin_feed_poll(feed);
            TEST_ASSERT_NOT_NULL(next);
            TEST_ASSERT_EQUAL_INT64(tick, next->sample.tick);
        }
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_feed_next(feed, &fed, &end, &error));
        TEST_ASSERT_FALSE(end);
        TEST_ASSERT_EQUAL_INT64(tick, fed.tick->sample.tick);
    }
    TEST_ASSERT_NULL(tl_twin_feed_poll(feed));
}

static void test_stopped_it_gives_no_more(void) {
    bool end = false;
    write_recording(ROWS);
    write_config("\"prediction\": 1, \"measurements\": \"lag\"", "");
    open_feed(false, true);
    for (int i = 0; i < SOME; i++) {
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_feed_next(feed, &fed, &end, &error));
    }
    TEST_ASSERT_NOT_NULL(tl_twin_feed_poll(feed)); /* available, but not returned before the stop */
    tl_twin_feed_stop(feed);
    tl_twin_feed_stop(feed);
    TEST_ASSERT_NULL(tl_twin_feed_poll(feed));
    expect_tally((tally){.steps = SOME}, SOME, 0, 0);
}

static void test_stopped_before_it_begins(void) {
    open_with("\"prediction\": 1, \"measurements\": \"lag\"", "", ROWS);
    tl_twin_feed_stop(feed);
    expect_tally(take_all(), 0, 0, 0);
}

int main(int argc, char **argv) {
    (void)argc;
    tl_test_be_twin(argv);
    tl_scratch_make(&scratch, TL_BINARY_DIR, "feed");
    UNITY_BEGIN();
    RUN_TEST(test_lag);
    RUN_TEST(test_lag_further_ahead);
    RUN_TEST(test_hold);
    RUN_TEST(test_ahead);
    RUN_TEST(test_a_plant_steps_at_each_tick);
    RUN_TEST(test_the_duration_ends_it);
    RUN_TEST(test_a_duration_beyond_the_recording);
    RUN_TEST(test_without_a_duration);
    RUN_TEST(test_a_single_tick);
    RUN_TEST(test_a_recording_that_breaks);
    RUN_TEST(test_looking_takes_nothing);
    RUN_TEST(test_stopped_it_gives_no_more);
    RUN_TEST(test_stopped_before_it_begins);
    return tl_scratch_finish(&scratch, UNITY_END());
}
