/* Survey of a recording: times, noise, outliers, polls, quantisation, and readings left out. */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/cli/emulation.h"
#include "firmware/monitor/survey.h"
#include "tests/support/scratch.h"

#define CONFIGURATION                                                                                                  \
    "{ \"twinlock\": 1, \"name\": \"bench\", \"step_s\": 0.01,\n"                                                      \
    "  \"components\": { \"motor\": { \"fmu\": \"motor.fmu\" } },\n"                                                   \
    "  \"plant\": { \"omega\": { \"min\": -100, \"max\": 100 }, \"door\": { \"type\": \"boolean\" } } }\n"

enum { OMEGA, DOOR };

static tl_scratch scratch;
static char path[PATH_MAX];
static tl_config config;
static tl_survey survey;
static tl_error error;
static FILE *file;
static double now;

static void note_problem(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    TEST_FAIL_MESSAGE(where[0] != '\0' ? where : text);
}

void setUp(void) {
    tl_report report = {.add = note_problem};
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "plant.csv"));
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_config_read_text("config.json", CONFIGURATION, strlen(CONFIGURATION), &config, &report));
    memset(&survey, 0, sizeof survey);
    file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("time,omega,door\n", file);
    now = 50.0;
}

void tearDown(void) {
    tl_survey_free(&survey);
    tl_config_free(&config);
    tl_scratch_empty(&scratch);
}

static void put(double later, double omega, int door) {
    now += later;
    (void)fprintf(file, "%.9f,%.17g,%d\n", now, omega, door);
}

static const tl_survey_signal *look(void) {
    tl_recording *recording = NULL;
    (void)fclose(file);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_recording_open(path, &config, &recording, &error));
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_survey_take(recording, &config, &survey, &error), error.text);
    tl_recording_close(recording);
    TEST_ASSERT_EQUAL_size_t(2, survey.count);
    return &survey.signals[OMEGA];
}

static void test_times_and_noise(void) {
    tl_random noise = {.state = 1};
    for (int i = 0; i < 2000; i++) {
        put(i % 10 == 9 ? 0.04 : 0.02, 5.0 * sin(now) + 0.1 * tl_random_normal(&noise), i % 2);
    }
    const tl_survey_signal *omega = look();
    TEST_ASSERT_EQUAL_UINT64(2000, omega->good);
    TEST_ASSERT_EQUAL_UINT64(0, omega->bad + omega->outliers + omega->repeats);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 50, omega->median);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 25, omega->most);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 25, omega->worst);
    TEST_ASSERT_DOUBLE_WITHIN(0.015, 0.1, omega->sigma);
    TEST_ASSERT_FALSE(omega->is_polled || omega->is_switched || omega->is_cut || omega->is_at_rest);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, omega->quantum);
    TEST_ASSERT_TRUE(omega->jump > 0.2 && omega->jump < 0.8);
    TEST_ASSERT_TRUE(survey.signals[DOOR].is_switched);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, now - 50.02, tl_seconds(survey.length));
}

/* Also among the first and the last readings. */
static void test_outliers(void) {
    tl_random noise = {.state = 2};
    for (int i = 0; i < 2000; i++) {
        put(0.02, 0.1 * tl_random_normal(&noise) + (i % 100 == 3 ? 20.0 : 0.0), 0);
    }
    const tl_survey_signal *omega = look();
    TEST_ASSERT_EQUAL_UINT64(20, omega->outliers);
    TEST_ASSERT_EQUAL_size_t(1980, omega->kept_count);
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 20.0, omega->nearest);
    TEST_ASSERT_DOUBLE_WITHIN(0.015, 0.1, omega->sigma);
    TEST_ASSERT_TRUE(omega->is_at_rest && omega->jump < 1.0);
}

/* A value that is not a number or out of range is no good reading. */
static void test_bad_readings(void) {
    for (int i = 0; i < 10; i++) {
        put(0.02, i == 4 ? (double)NAN : i == 5 ? 1000.0 : i, 0);
    }
    const tl_survey_signal *omega = look();
    TEST_ASSERT_EQUAL_UINT64(8, omega->good);
    TEST_ASSERT_EQUAL_UINT64(2, omega->bad);
    TEST_ASSERT_FALSE(omega->noise.is_enough);
    TEST_ASSERT_EQUAL_INT64(3 * TL_SECOND / 50, omega->worst);
}

/* The noise is estimated from changed values only. */
static void test_polls(void) {
    tl_random noise = {.state = 3};
    double value = 0.0;
    for (int i = 0; i < 4000; i++) {
        value = i % 4 == 0 ? 0.1 * tl_random_normal(&noise) : value;
        put(0.01, value, 0);
    }
    const tl_survey_signal *omega = look();
    TEST_ASSERT_TRUE(omega->is_polled);
    TEST_ASSERT_EQUAL_UINT64(3000, omega->repeats);
    TEST_ASSERT_EQUAL_UINT64(4000, omega->good);
    TEST_ASSERT_EQUAL_size_t(1000, omega->kept_count);
    TEST_ASSERT_DOUBLE_WITHIN(0.015, 0.1, omega->sigma);
}

/* Values quantised more coarsely than their noise repeat too, but do not count as polled. */
static void test_steps_of_counting(void) {
    tl_random noise = {.state = 4};
    for (int i = 0; i < 3000; i++) {
        put(0.02, 0.5 * nearbyint(2.0 * (3.0 * sin(0.2 * now) + 0.05 * tl_random_normal(&noise))), 0);
    }
    const tl_survey_signal *omega = look();
    TEST_ASSERT_EQUAL_DOUBLE(0.5, omega->quantum);
    TEST_ASSERT_FALSE(omega->is_polled);
    TEST_ASSERT_TRUE(omega->repeats > 1000);
    TEST_ASSERT_TRUE(omega->sigma >= 0.5 / sqrt(12.0) - 1e-6);
}

static void test_one_value(void) {
    for (int i = 0; i < 500; i++) {
        put(0.02, 7.0, 0);
    }
    const tl_survey_signal *omega = look();
    TEST_ASSERT_TRUE(omega->is_switched && !omega->is_polled && omega->is_at_rest);
    TEST_ASSERT_EQUAL_DOUBLE(0.0, omega->sigma);
}

static void test_nothing_good_at_all(void) {
    put(0.02, 1000.0, 0);
    const tl_survey_signal *omega = look();
    TEST_ASSERT_EQUAL_UINT64(0, omega->good);
    TEST_ASSERT_EQUAL_INT64(0, omega->median);
}

/* The first readings are kept. A signal without room for more is not read on. */
static void test_very_many(void) {
    for (int i = 0; i < TL_SURVEY_MOST + 10; i++) {
        put(0.001, i % 7, 0);
    }
    const tl_survey_signal *omega = look();
    TEST_ASSERT_TRUE(omega->is_cut);
    TEST_ASSERT_EQUAL_UINT64(TL_SURVEY_MOST, omega->good);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_survey");
    UNITY_BEGIN();
    RUN_TEST(test_times_and_noise);
    RUN_TEST(test_outliers);
    RUN_TEST(test_bad_readings);
    RUN_TEST(test_polls);
    RUN_TEST(test_steps_of_counting);
    RUN_TEST(test_one_value);
    RUN_TEST(test_nothing_good_at_all);
    RUN_TEST(test_very_many);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
