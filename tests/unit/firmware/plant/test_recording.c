/* Recordings: from CSV the newest row up to each tick, from a database the ticks of the run. */
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/plant/recording.h"
#include "firmware/store/recorder.h"
#include "tests/support/made_run.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"
#include "tests/support/sql.h"

#define CONFIGURATION                                                                                                  \
    "{ \"twinlock\": 1, \"name\": \"motor bench\", \"step_s\": 0.01,\n"                                                \
    "  \"components\": { \"motor\": { \"fmu\": \"motor.fmu\" } },\n"                                                   \
    "  \"plant\": { \"torque\": { \"min\": -10, \"max\": 10, \"stale_s\": 0.03 },\n"                                   \
    "             \"omega\": { \"csv\": { \"column\": \"speed\" } },\n"                                                \
    "             \"door\": { \"type\": \"boolean\" } } }\n"

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_config config;
static tl_recording *recording;
static tl_recording_tick tick;
static tl_error error;
static size_t problems;

static void count_problem(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    (void)printf("%s: %s\n", where, text);
    problems++;
}

static void configure(const char *text) {
    tl_report report = {.add = count_problem};
    tl_config_free(&config);
    problems = 0;
    (void)tl_config_read_text("config.json", text, strlen(text), &config, &report);
    TEST_ASSERT_EQUAL_size_t(0, problems);
}

void setUp(void) {
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "plant.csv"));
    recording = NULL;
    error = (tl_error){TL_OK, ""};
    configure(CONFIGURATION);
}

void tearDown(void) {
    tl_recording_close(recording);
    tl_config_free(&config);
    tl_scratch_empty(&scratch);
}

/* ---- CSV ---- */

static void write_csv(const char *text) {
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs(text, file);
    (void)fclose(file);
}

static void open_recording(void) {
    tl_status status = tl_recording_open(path, &config, &recording, &error);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

static bool next(void) {
    bool end = false;
    tl_status status = tl_recording_next(recording, &tick, &end, &error);
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
    return !end;
}

static void expect_signal(size_t signal, double value, tl_quality quality) {
    char what[64];
    (void)snprintf(what, sizeof what, "signal %zu at tick %d", signal, (int)tick.sample.tick);
    TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(value, tick.sample.values[signal], what);
    TEST_ASSERT_EQUAL_INT_MESSAGE(quality, tick.sample.quality[signal], what);
}

static void expect_refused(const char *parts) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_recording_open(path, &config, &recording, &error));
    TL_EXPECT_PARTS(parts, error.text);
    TL_EXPECT_PARTS(path, error.text);
    TEST_ASSERT_NULL(recording);
    error = (tl_error){TL_OK, ""};
}

/* The recording has its own time; tick 0 is at the first row. */
static void test_each_tick_is_the_newest_row(void) {
    static const double speeds[] = {1, 1, 2, 4, 4};
    write_csv("time,speed,torque,door\n100,1,0,0\n100.015,2,0,0\n100.021,3,0,1\n100.03,4,0,1\n100.0499,5,0,1\n");
    open_recording();
    TEST_ASSERT_EQUAL_INT64(5, tl_recording_ticks(recording));
    for (int i = 0; i < 5; i++) {
        TEST_ASSERT_TRUE(next());
        TEST_ASSERT_EQUAL_INT64(i, tick.sample.tick);
        TEST_ASSERT_FALSE(tick.caught_up || tick.cut_short || tick.without_nominal);
        expect_signal(1, speeds[i], TL_GOOD);
    }
    TEST_ASSERT_FALSE(next());
    TEST_ASSERT_FALSE(next());
}

static void test_a_row_exactly_at_a_tick_counts(void) {
    write_csv("time,speed,torque,door\n0,1,0,0\n0.01,2,0,0\n0.02,3,0,0\n");
    open_recording();
    TEST_ASSERT_EQUAL_INT64(3, tl_recording_ticks(recording));
    for (int i = 1; i <= 3; i++) {
        TEST_ASSERT_TRUE(next());
        expect_signal(1, i, TL_GOOD);
        TEST_ASSERT_EQUAL_INT64((i - 1) * (TL_SECOND / 100), tick.sample.stamps[1]);
    }
}

/* Recorded values get the same qualities as live ones: range, type, age, not a number. */
static void test_qualities(void) {
    write_csv("time,speed,torque,door\n0,1,11,0.5\n0.01,n/a,2,1\n0.05,3,2,1\n");
    open_recording();
    TEST_ASSERT_TRUE(next());
    expect_signal(0, 11, TL_OUT_OF_RANGE);
    expect_signal(2, 0.5, TL_OUT_OF_RANGE);
    TEST_ASSERT_TRUE(next());
    expect_signal(0, 2, TL_GOOD);
    expect_signal(1, 0, TL_NOT_A_NUMBER);
    expect_signal(2, 1, TL_GOOD);
    TEST_ASSERT_TRUE(next() && next() && next()); /* 0.04: the torque is 0.03 s old */
    expect_signal(0, 2, TL_GOOD);
}

static void test_stale_values(void) {
    write_csv("time,speed,torque,door\n0,1,1,0\n0.06,3,2,1\n");
    open_recording();
    for (int i = 0; i < 7; i++) {
        TEST_ASSERT_TRUE(next());
        expect_signal(0, i < 6 ? 1 : 2, i > 3 && i < 6 ? TL_STALE : TL_GOOD);
        expect_signal(1, i < 6 ? 1 : 3, TL_GOOD); /* never stale */
    }
}

/* For an empty cell the previous value stays valid. */
static void test_empty_cells(void) {
    write_csv("time,speed,torque,door\n0,1,,1\n0.01,,5,\n0.02,3,,\n");
    open_recording();
    TEST_ASSERT_TRUE(next());
    expect_signal(0, 0, TL_NO_LINK);
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, tick.sample.stamps[0]);
    TEST_ASSERT_TRUE(next());
    expect_signal(0, 5, TL_GOOD);
    expect_signal(1, 1, TL_GOOD);
    TEST_ASSERT_TRUE(next());
    expect_signal(1, 3, TL_GOOD);
    expect_signal(2, 1, TL_GOOD);
}

static void test_many_rows_between_two_ticks(void) {
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("time,speed,torque,door\n", file);
    for (int i = 0; i <= 3000; i++) {
        (void)fprintf(file, "%.5f,%d,0,0\n", i * 0.00001, i);
    }
    (void)fclose(file);
    open_recording();
    for (int i = 0; i <= 3; i++) {
        TEST_ASSERT_TRUE(next());
        expect_signal(1, 1000 * i, TL_GOOD);
    }
    TEST_ASSERT_FALSE(next());
}

/* All rows are checked before the first is used. */
static void test_errors_are_reported_at_once(void) {
    write_csv("time,speed,torque,door\n0,1,1,0\n1,1,1,0\n2,1,1,0\n1.5,1,1,0\n");
    expect_refused("line 5");
    write_csv("time,speed,torque,door\n");
    expect_refused("header");
    write_csv("time,speed,torque\n0,1,1\n");
    expect_refused("\"door\"");
    (void)remove(path);
    expect_refused(strerror(ENOENT));
}

/* A gap, for example from a changed clock, would be replayed for days. */
static void test_a_gap_that_is_too_wide(void) {
    write_csv("time,speed,torque,door\n0,1,1,0\n1000000,1,1,0\n");
    open_recording();
    TEST_ASSERT_EQUAL_INT64(TL_RECORDING_GAP + 1, tl_recording_ticks(recording));
    tl_recording_close(recording);
    recording = NULL;
    write_csv("time,speed,torque,door\n0,1,1,0\n5,1,1,0\n1000005.01,1,1,0\n1000006,1,1,0\n");
    expect_refused("5.000000000 s|1000005.010000000 s|100000001|0.01 s|100000000");
    write_csv("time,speed,torque,door\n0.5,1,1,0\n900000000,1,1,0\n");
    expect_refused("89999999950|0.01 s");
}

/* Rows as far apart as possible: the time between them does not overflow, and is reported. */
static void test_rows_at_the_ends_of_time(void) {
    write_csv("time,speed,torque,door\n-4.6e9,1,1,0\n4.6e9,1,1,0\n");
    expect_refused("-4600000000.000000000 s|4600000000.000000000 s|920000000000");
    write_csv("time,speed,torque,door\n-4.600001e9,1,1,0\n");
    expect_refused("line 2|\"-4.600001e9\"|-4.6e9|4.6e9");
    write_csv("time,speed,torque,door\n4.6e9,1,1,0\n4600000000.02,3,1,0\n");
    expect_refused("line 3");
    write_csv("time,speed,torque,door\n4599999999,1,1,0\n4600000000,3,1,0\n");
    open_recording();
    for (int i = 0; i <= 100; i++) {
        TEST_ASSERT_TRUE(next());
    }
    expect_signal(1, 3, TL_GOOD);
    TEST_ASSERT_FALSE(next());
}

static void test_a_recording_that_is_too_long(void) {
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("time,speed,torque,door\n", file);
    for (int i = 0; i <= 100; i++) {
        (void)fprintf(file, "%d,1,1,0\n", i * 1000000);
    }
    (void)fclose(file);
    expect_refused("100000000.000000000 s|10000000000|0.01 s|step_s");
}

/* ---- the unit of the time ---- */

#define COMPARED(omega)                                                                                                \
    "{ \"twinlock\": 1, \"name\": \"motor bench\", \"step_s\": 0.01,\n"                                                \
    "  \"components\": { \"motor\": { \"fmu\": \"motor.fmu\" } },\n"                                                   \
    "  \"plant\": { \"omega\": { " omega " } },\n"                                                                     \
    "  \"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } } }\n"

/* Writes rows whose distances alternate. */
static void write_rows(int rows, double gap, double other) {
    FILE *file = fopen(path, "w");
    double time = 3;
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("time,omega\n", file);
    for (int i = 0; i < rows; i++) {
        (void)fprintf(file, "%.9f,1\n", time);
        time += i % 2 == 0 ? gap : other;
    }
    (void)fclose(file);
}

static void expect_rows_are_used(int rows, double gap, double other) {
    write_rows(rows, gap, other);
    open_recording();
    tl_recording_close(recording);
    recording = NULL;
}

static void expect_unit(double gap, const char *parts) {
    write_rows(20, gap, gap);
    expect_refused(parts);
}

static void test_a_wrong_unit_is_refused(void) {
    configure(COMPARED(""));
    expect_unit(10, "10 s|0.01 s|milliseconds|1000|every_s");
    expect_unit(5, "milliseconds");
    expect_unit(60 * 60 + 60, "microseconds"); /* no usual distance of a logger */
    expect_unit(10000, "microseconds|1000000");
    expect_unit(0.01 / 60, "minutes|60");
    expect_unit(0.01 / 3600, "hours|3600");
    expect_unit(0.01 / 86400, "days|86400");
    write_rows(20, 8, 12); /* a jitter */
    expect_refused("milliseconds");
}

static void test_honest_distances_of_rows(void) {
    configure(COMPARED(""));
    expect_rows_are_used(20, 1, 1);
    expect_rows_are_used(20, 60, 60);
    expect_rows_are_used(20, 900, 900);
    expect_rows_are_used(20, 86400, 86400);
    expect_rows_are_used(4, 10, 10);                    /* too few rows */
    expect_rows_are_used(20, 1, 20);                    /* events */
    expect_rows_are_used(5000, 1.0 / 6000, 1.0 / 6000); /* a fast logger */
    expect_rows_are_used(20, 0.0001, 0.0001);
    configure(COMPARED("\"every_s\": 10"));
    expect_rows_are_used(20, 10, 10);
}

/* ---- a database ---- */

/* Records a made-up run of CONFIGURATION, with the names of the signals as in assembly.c. */
static void record_run(int64_t ticks) {
    tl_recorder *recorder = NULL;
    const tl_recorder_signal plant[] = {
        {"plant.torque", "", NULL, TL_REAL}, {"plant.omega", "", NULL, TL_REAL}, {"plant.door", "", NULL, TL_BOOLEAN}};
    tl_recorder_settings settings = tl_made_settings(path);
    settings.configuration = CONFIGURATION;
    settings.plant = plant;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, &error));
    tl_made_put(recorder, 0, ticks);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "end of recording", NULL, &error));
}

static void test_a_run_is_read(void) {
    record_run(100);
    open_recording();
    TEST_ASSERT_EQUAL_INT64(100, tl_recording_ticks(recording));
    for (int64_t i = 0; i < 100; i++) {
        tl_sample expected;
        tl_made_sample(i, &expected);
        TEST_ASSERT_TRUE(next());
        TEST_ASSERT_EQUAL_INT64(i, tick.sample.tick);
        TEST_ASSERT_EQUAL_MEMORY(expected.values, tick.sample.values, TL_MADE_PLANT * sizeof expected.values[0]);
        TEST_ASSERT_EQUAL_MEMORY(expected.quality, tick.sample.quality, TL_MADE_PLANT);
        TEST_ASSERT_EQUAL_MEMORY(expected.stamps, tick.sample.stamps, TL_MADE_PLANT * sizeof expected.stamps[0]);
    }
    TEST_ASSERT_FALSE(next());
}

/* With the configuration of the run, the replay skips and cuts the same searches. */
static void test_limits_of_the_run_are_repeated(void) {
    int caught_up = 0;
    int limited = 0;
    int without = 0;
    record_run(300);
    open_recording();
    for (int64_t i = 0; i < 300; i++) {
        tl_record expected;
        TEST_ASSERT_TRUE(next());
        if (i < TL_MADE_PREDICTION) {
            TEST_ASSERT_FALSE(tick.caught_up);
            continue;
        }
        tl_made_record(i - TL_MADE_PREDICTION, &expected);
        bool without_nominal = (expected.flags & TL_FLAG_WITHOUT_NOMINAL) != 0;
        bool by_time = expected.stop == TL_STOP_TIME || without_nominal;
        TEST_ASSERT_EQUAL_INT(expected.outcome == TL_CAUGHT_UP, tick.caught_up);
        TEST_ASSERT_EQUAL_INT(by_time, tick.cut_short);
        TEST_ASSERT_EQUAL_UINT32(by_time ? expected.evaluations : 0, tick.evaluations);
        TEST_ASSERT_EQUAL_INT(without_nominal || (by_time && expected.evaluations == 0), tick.without_nominal);
        caught_up += tick.caught_up ? 1 : 0;
        limited += by_time ? 1 : 0;
        without += without_nominal && expected.stop != TL_STOP_TIME ? 1 : 0;
    }
    TEST_ASSERT_GREATER_THAN_INT(5, without);
    TEST_ASSERT_GREATER_THAN_INT(5, caught_up);
    TEST_ASSERT_GREATER_THAN_INT(5, limited);
}

static void test_another_configuration_has_no_limits_of_the_run(void) {
    record_run(300);
    configure(CONFIGURATION " ");
    open_recording();
    for (int i = 0; i < 300; i++) {
        TEST_ASSERT_TRUE(next());
        TEST_ASSERT_FALSE(tick.caught_up || tick.cut_short || tick.without_nominal);
    }
}

/* If the run had no time for the first evaluation, the replay makes none. */
static void test_no_evaluation_at_all(void) {
    record_run(10);
    tl_sql_execute(path, "UPDATE steps SET outcome = 4, stop = 4, flags = 0, evaluations = 0");
    open_recording();
    for (int i = 0; i < 10; i++) {
        TEST_ASSERT_TRUE(next());
        TEST_ASSERT_EQUAL_INT(i >= TL_MADE_PREDICTION, tick.cut_short);
        TEST_ASSERT_EQUAL_INT(i >= TL_MADE_PREDICTION, tick.without_nominal);
        TEST_ASSERT_EQUAL_UINT32(0, tick.evaluations);
    }
}

/* With the configuration of the run, FMUs are reset at the same steps; else never. */
static void test_resets_of_the_fmus(void) {
    record_run(60);
    tl_sql_execute(path, "UPDATE steps SET flags = 32 + flags % 8 WHERE step % 7 = 3");
    for (int again = 0; again < 2; again++) {
        open_recording();
        for (int64_t i = 0; i < 60; i++) {
            TEST_ASSERT_TRUE(next());
            int64_t step = i - TL_MADE_PREDICTION;
            TEST_ASSERT_EQUAL_INT(again == 0 && step >= 0 && step % 7 == 3, tick.resets);
        }
        tl_recording_close(recording);
        recording = NULL;
        configure(CONFIGURATION " ");
    }
}

static void test_the_last_run_counts(void) {
    record_run(50);
    record_run(20);
    open_recording();
    TEST_ASSERT_EQUAL_INT64(20, tl_recording_ticks(recording));
}

static void test_runs_that_do_not_fit(void) {
    record_run(10);
    tl_sql_execute(path, "UPDATE signals SET name = 'plant.brake' WHERE kind = 'plant' AND signal = 0");
    expect_refused("plant.brake|1|plant.torque");
    tl_sql_execute(path, "DELETE FROM signals WHERE kind = 'plant' AND signal = 2");
    tl_sql_execute(path, "UPDATE signals SET name = 'plant.torque' WHERE kind = 'plant' AND signal = 0");
    expect_refused("signal 3|plant.door");
    tl_sql_execute(path, "INSERT INTO signals VALUES (1, 'plant', 2, 'plant.door', '', 'Boolean', NULL)");
    tl_sql_execute(path, "UPDATE runs SET step_ns = 20000000");
    expect_refused("3|0.02 s|0.01 s");
}

static void test_a_run_whose_beginning_is_gone(void) {
    record_run(10);
    tl_sql_execute(path, "DELETE FROM main.samples WHERE tick < 3");
    expect_refused("run 1|start");
}

/* The path in the message is a copy that the recording owns. */
static void test_a_tick_that_was_lost(void) {
    char name[PATH_MAX];
    bool end = false;
    record_run(10);
    tl_sql_execute(path, "DELETE FROM main.samples WHERE tick = 4");
    (void)snprintf(name, sizeof name, "%s", path);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recording_open(name, &config, &recording, &error));
    memset(name, 'x', sizeof name - 1);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_TRUE(next());
    }
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_recording_next(recording, &tick, &end, &error));
    TL_EXPECT_PARTS("tick 4", error.text);
    TEST_ASSERT_EQUAL_STRING_LEN(path, error.text, strlen(path));
}

/* ---- single readings ---- */

static struct {
    size_t count;
    size_t signal[16];
    tl_reading reading[16];
} received;

static void on_event(void *context, size_t signal, const tl_reading *reading) {
    TEST_ASSERT_EQUAL_PTR(&received, context);
    if (received.count < sizeof received.signal / sizeof received.signal[0]) {
        received.signal[received.count] = signal;
        received.reading[received.count] = *reading;
    }
    received.count++;
}

static size_t hear_all(void) {
    memset(&received, 0, sizeof received);
    open_recording();
    tl_recording_listen(recording, on_event, &received);
    while (next()) {
    }
    return received.count;
}

/* All rows, also several between two ticks. Not-a-number is reported; ranges are not checked. */
static void test_each_row_is_heard_once(void) {
    static const double speeds[] = {1, 2, 3, 0, 5};
    static const double times[] = {0, 0.002, 0.004, 0.006, 0.02};
    write_csv("time,speed,torque,door\n0,1,,\n0.002,2,,\n0.004,3,,\n0.006,n/a,,\n0.02,5,,\n");
    TEST_ASSERT_EQUAL_size_t(5, hear_all());
    for (size_t i = 0; i < 5; i++) {
        TEST_ASSERT_EQUAL_size_t(1, received.signal[i]);
        TEST_ASSERT_EQUAL_INT(i == 3 ? TL_NOT_A_NUMBER : TL_GOOD, received.reading[i].quality);
        TEST_ASSERT_TRUE(i == 3 || received.reading[i].value == speeds[i]);
        TEST_ASSERT_EQUAL_INT64(tl_time_of_seconds(times[i]), received.reading[i].stamp);
    }
}

/* A run reports the reading of each tick if it was new. */
static void test_a_run_is_heard(void) {
    tl_recorder_settings settings = tl_made_settings(path);
    tl_recorder *recorder = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_open(&settings, &recorder, &error));
    tl_made_put(recorder, 0, 4);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recorder_close(recorder, "end", NULL, &error));
    (void)hear_all();
    size_t good = 0;
    for (size_t i = 0; i < received.count && i < 16; i++) {
        tl_sample sample;
        int64_t seen = 0;
        for (; seen < 4; seen++) {
            tl_made_sample(seen, &sample);
            if (sample.stamps[received.signal[i]] == received.reading[i].stamp) {
                break;
            }
        }
        TEST_ASSERT_TRUE(seen < 4);
        TEST_ASSERT_EQUAL_INT(sample.quality[received.signal[i]], received.reading[i].quality);
        good += received.reading[i].quality == TL_GOOD ? 1 : 0;
    }
    TEST_ASSERT_TRUE(good > 3 && received.count <= 12);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_recording");
    UNITY_BEGIN();
    RUN_TEST(test_each_tick_is_the_newest_row);
    RUN_TEST(test_a_row_exactly_at_a_tick_counts);
    RUN_TEST(test_qualities);
    RUN_TEST(test_stale_values);
    RUN_TEST(test_empty_cells);
    RUN_TEST(test_many_rows_between_two_ticks);
    RUN_TEST(test_a_gap_that_is_too_wide);
    RUN_TEST(test_rows_at_the_ends_of_time);
    RUN_TEST(test_a_recording_that_is_too_long);
    RUN_TEST(test_errors_are_reported_at_once);
    RUN_TEST(test_a_wrong_unit_is_refused);
    RUN_TEST(test_honest_distances_of_rows);
    RUN_TEST(test_a_run_is_read);
    RUN_TEST(test_limits_of_the_run_are_repeated);
    RUN_TEST(test_another_configuration_has_no_limits_of_the_run);
    RUN_TEST(test_no_evaluation_at_all);
    RUN_TEST(test_resets_of_the_fmus);
    RUN_TEST(test_the_last_run_counts);
    RUN_TEST(test_runs_that_do_not_fit);
    RUN_TEST(test_a_run_whose_beginning_is_gone);
    RUN_TEST(test_a_tick_that_was_lost);
    RUN_TEST(test_each_row_is_heard_once);
    RUN_TEST(test_a_run_is_heard);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
