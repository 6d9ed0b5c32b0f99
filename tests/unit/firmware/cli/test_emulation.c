/* An emulated plant: rows of a recording unchanged; rows of FMUs with the configured noise and
 * times. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/cli/emulation.h"
#include "tests/support/config_text.h"
#include "tests/support/scratch.h"
#include "tests/support/start_twin.h"

#define MOTOR TL_SOURCE_DIR "/config/motor"

enum { ROWS = 1600 };

static tl_scratch scratch;
static tl_config model_config;
static tl_twin_child *child;
static tl_config config;
static tl_emulation *emulation;
static tl_emulation_row rows[ROWS];
static size_t count;
static tl_error error;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    emulation = NULL;
    error = (tl_error){TL_OK, ""};
}

static void close_model(void) {
    tl_emulation_close(emulation);
    tl_twin_child_close(child);
    tl_config_free(&model_config);
    emulation = NULL;
    child = NULL;
}

void tearDown(void) {
    close_model();
    tl_config_free(&config);
    tl_scratch_empty(&scratch);
}

static void expect_ok(tl_status status) {
    TEST_ASSERT_EQUAL_STRING("", error.text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

static void take_rows(void) {
    bool end = false;
    for (count = 0; count < ROWS; count++) {
        expect_ok(tl_emulation_next(emulation, &rows[count], &end, &error));
        if (end) {
            return;
        }
    }
    TEST_FAIL_MESSAGE("more rows than expected");
}

/* ---- from a recording ---- */

static void open_text(const char *text) {
    static const char configuration[] =
        "{ \"twinlock\": 1, \"name\": \"x\", \"step_s\": 0.01, \"components\": { \"m\": { \"fmu\": \"m.fmu\" } },\n"
        "  \"plant\": { \"a\": {}, \"b\": { \"csv\": { \"column\": \"B\" } },"
        "  \"c\": { \"csv\": { \"column\": \"B\", \"scale\": 2, \"offset\": -1 } } } }";
    tl_report report = {0};
    expect_ok(tl_config_read_text("config.json", configuration, strlen(configuration), &config, &report));
    const char *path = tl_scratch_path(&scratch, "rows.csv");
    FILE *file = fopen(path, "w");
    (void)fputs(text, file);
    (void)fclose(file);
    expect_ok(tl_emulation_open_recording(path, &config, &emulation, &error));
}

static void test_rows_of_a_recording(void) {
    open_text("time,B,a\n50.5,1,2\n50.6,3,\n52.5,n/a,6\n");
    TEST_ASSERT_EQUAL_size_t(3, tl_emulation_column_count(emulation));
    TEST_ASSERT_EQUAL_STRING("a", tl_emulation_column(emulation, 0));
    TEST_ASSERT_EQUAL_STRING("B", tl_emulation_column(emulation, 1));
    take_rows();
    TEST_ASSERT_EQUAL_size_t(3, count);
    TEST_ASSERT_EQUAL_INT64(0, rows[0].time);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 10, rows[1].time);
    TEST_ASSERT_EQUAL_INT64(2 * TL_SECOND, rows[2].time);
    TEST_ASSERT_EQUAL_DOUBLE(2, rows[0].values[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1, rows[0].values[1]);
    TEST_ASSERT_EQUAL_DOUBLE(1, rows[0].values[2]);
    TEST_ASSERT_EQUAL_DOUBLE(5, rows[1].values[2]);
    TEST_ASSERT_TRUE(rows[0].present[0] && rows[0].present[1] && rows[1].present[1] && rows[2].present[0]);
    TEST_ASSERT_FALSE(rows[1].present[0]); /* an empty cell */
    TEST_ASSERT_FALSE(rows[2].present[1]); /* not a number */
}

static void test_a_recording_that_goes_wrong_later(void) {
    tl_emulation_row row;
    bool end = false;
    open_text("time,B,a\n1,1,2\n0,3,4\n");
    expect_ok(tl_emulation_next(emulation, &row, &end, &error));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_emulation_next(emulation, &row, &end, &error));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "line 3"));
}

static void test_no_recording(void) {
    tl_report report = {0};
    expect_ok(tl_config_read(MOTOR "/free.json", &config, &report));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_emulation_open_recording("/nowhere/x.csv", &config, &emulation, &error));
    TEST_ASSERT_NULL(emulation);
    tl_emulation_close(NULL);
}

/* ---- from FMUs ---- */

/* Opens config/motor/plant.json with a part of its text replaced. */
static tl_status emulate(const char *path, const char *driving, uint64_t seed) {
    static tl_account account;
    tl_report report = {0};
    expect_ok(tl_config_read(path, &model_config, &report));
    tl_config_forget_delays(&model_config);
    tl_config_use_lookups(&model_config);
    child = tl_test_start_twin(&model_config, TL_ATTACHED_OUTPUTS, &account);
    const tl_twin_feed_settings model = {.config = &model_config, .account = &account, .child = child};
    return tl_emulation_open_model(&model, driving, seed, &emulation, &error);
}

static void open_model(const char *old, const char *new, uint64_t seed) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s", tl_scratch_path(&scratch, "plant.json"));
    char *text = tl_test_read_text(MOTOR "/plant.json");
    char *changed = old == NULL ? text : tl_test_replaced(text, old, new);
    TEST_ASSERT_NOT_NULL(changed);
    FILE *file = fopen(path, "w");
    (void)fputs(changed, file);
    (void)fclose(file);
    if (changed != text) {
        free(changed);
    }
    free(text);
    close_model();
    expect_ok(emulate(path, MOTOR "/brake.csv", seed));
}

static void test_message_times(void) {
    open_model(NULL, NULL, 1);
    TEST_ASSERT_EQUAL_size_t(2, tl_emulation_column_count(emulation));
    TEST_ASSERT_EQUAL_STRING("omega", tl_emulation_column(emulation, 0));
    TEST_ASSERT_EQUAL_STRING("M_brake", tl_emulation_column(emulation, 1));
    take_rows();
    tl_time shortest = TL_SECOND;
    tl_time longest = 0;
    TEST_ASSERT_EQUAL_INT64(0, rows[0].time);
    for (size_t i = 1; i < count; i++) {
        tl_time interval = rows[i].time - rows[i - 1].time;
        TEST_ASSERT_EQUAL_INT64(0, rows[i].time % 1000); /* whole microseconds */
        TEST_ASSERT_TRUE(rows[i].present[0] && rows[i].present[1]);
        shortest = interval < shortest ? interval : shortest;
        longest = interval > longest ? interval : longest;
    }
    TEST_ASSERT_TRUE(shortest >= TL_SECOND / 40 && shortest < TL_SECOND / 40 + TL_SECOND / 1000);
    TEST_ASSERT_TRUE(longest <= TL_SECOND / 25 && longest > TL_SECOND / 25 - TL_SECOND / 1000);
    TEST_ASSERT_TRUE(rows[count - 1].time <= 142 * (TL_SECOND / 10)); /* duration_s */
    TEST_ASSERT_TRUE(rows[count - 1].time > 141 * (TL_SECOND / 10));
}

static void test_without_message_times_each_step_is_a_row(void) {
    open_model(",\n    \"message_s\": [0.025, 0.04]", "", 1);
    take_rows();
    TEST_ASSERT_EQUAL_size_t(1421, count);
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_INT64((tl_time)i * (TL_SECOND / 100), rows[i].time);
    }
}

static void test_the_duration(void) {
    open_model("\"duration_s\": 14.2", "\"duration_s\": 0.5", 1);
    take_rows();
    TEST_ASSERT_GREATER_THAN_size_t(12, count);
    TEST_ASSERT_TRUE(rows[count - 1].time <= TL_SECOND / 2);
    TEST_ASSERT_TRUE(rows[count - 1].time > TL_SECOND / 2 - TL_SECOND / 25);
}

static void test_a_seed_is_a_plant(void) {
    static tl_emulation_row first[ROWS];
    open_model(NULL, NULL, 5);
    take_rows();
    size_t first_count = count;
    memcpy(first, rows, sizeof rows);
    open_model(NULL, NULL, 5);
    take_rows();
    TEST_ASSERT_EQUAL_size_t(first_count, count);
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_INT64(first[i].time, rows[i].time);
        TEST_ASSERT_EQUAL_MEMORY(first[i].values, rows[i].values, 2 * sizeof rows[i].values[0]);
    }
    open_model(NULL, NULL, 6);
    take_rows();
    TEST_ASSERT_TRUE(rows[1].time != first[1].time);
    TEST_ASSERT_TRUE(rows[0].values[0] != first[0].values[0]);
}

/* The same plant with and without noise: the difference has the configured deviation. */
static void test_noise(void) {
    static double still[ROWS];
    double sum = 0.0;
    double squares = 0.0;
    open_model("\"noise\": 0.3", "\"noise\": 0", 1);
    take_rows();
    TEST_ASSERT_EQUAL_DOUBLE(62.852256877937684, rows[0].values[0]); /* at rest, as initialised */
    open_model(",\n    \"message_s\": [0.025, 0.04]", "", 1);
    take_rows();
    size_t all = count;
    for (size_t i = 0; i < all; i++) {
        still[i] = rows[i].values[0];
    }
    open_model(",\n    \"message_s\": [0.025, 0.04]", "", 2);
    take_rows();
    for (size_t i = 0; i < all; i++) {
        double difference = rows[i].values[0] - still[i]; /* of two noises: √2 times the deviation */
        sum += difference;
        squares += difference * difference;
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.04, 0.0, sum / (double)all);
    TEST_ASSERT_DOUBLE_WITHIN(0.03, 0.3 * sqrt(2.0), sqrt(squares / (double)all));
}

/* A column from the plant's own signal has the value of the driving recording at that time. */
static void test_signals_that_are_passed_on(void) {
    open_model("\"noise\": 0.02", "\"noise\": 0", 1);
    take_rows();
    double largest = 0.0;
    for (size_t i = 0; i < count; i++) {
        largest = fmax(largest, fabs(rows[i].values[1]));
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, round(rows[i].values[1] * 1e4) / 1e4, rows[i].values[1]);
    }
    TEST_ASSERT_TRUE(largest > 0.5);
}

static void test_a_plant_without_what_drives_it(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, emulate(MOTOR "/plant.json", "/nowhere/x.csv", 1));
    TEST_ASSERT_NOT_NULL(strstr(error.text, "/nowhere/x.csv"));
    TEST_ASSERT_NULL(emulation);
}

int main(int argc, char **argv) {
    (void)argc;
    tl_test_be_twin(argv);
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_emulation");
    UNITY_BEGIN();
    RUN_TEST(test_rows_of_a_recording);
    RUN_TEST(test_a_recording_that_goes_wrong_later);
    RUN_TEST(test_no_recording);
    RUN_TEST(test_message_times);
    RUN_TEST(test_without_message_times_each_step_is_a_row);
    RUN_TEST(test_the_duration);
    RUN_TEST(test_a_seed_is_a_plant);
    RUN_TEST(test_noise);
    RUN_TEST(test_signals_that_are_passed_on);
    RUN_TEST(test_a_plant_without_what_drives_it);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
