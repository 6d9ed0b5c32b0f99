/* Our threads use a decimal point, although the process has a locale with a decimal comma. */
#include <limits.h>
#include <locale.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cjson/cJSON.h>
#include <unity.h>

#include "board/csv/csv.h"
#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "firmware/plant/plant_input.h"
#include "firmware/plant/plant_reader.h"
#include "tests/support/comma_locale.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static bool has_comma;

void setUp(void) {
    TEST_ASSERT_TRUE_MESSAGE(has_comma, "no locale with a decimal comma: run script/bootstrap");
}

void tearDown(void) {
    tl_locale_use();
    tl_scratch_empty(&scratch);
}

static void expect_numbers(const char *text) {
    char written[16];
    char *end = NULL;
    (void)snprintf(written, sizeof written, "%.1f", 1.5);
    TEST_ASSERT_EQUAL_STRING(text, written);
    TEST_ASSERT_EQUAL_DOUBLE(1.5, strtod(text, &end));
    TEST_ASSERT_EQUAL_STRING("", end);
}

/* An FMU may change the locale of its thread: tl_locale_use() restores ours. */
static void test_a_thread_that_was_led_astray(void) {
    (void)uselocale(LC_GLOBAL_LOCALE);
    expect_numbers("1,5");
    tl_locale_use();
    expect_numbers("1.5");
    tl_locale_use();
    expect_numbers("1.5");
}

static void *write_number(void *context) {
    (void)snprintf(context, 16, "%.1f", 1.5);
    return NULL;
}

/* tl_locale_use() affects only the calling thread, so each of our threads calls it. */
static void test_another_thread(void) {
    char written[16] = "";
    pthread_t thread;
    tl_locale_use();
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&thread, NULL, write_number, written));
    TEST_ASSERT_EQUAL_INT(0, pthread_join(thread, NULL));
    TEST_ASSERT_EQUAL_STRING("1,5", written);
}

/* cJSON takes the decimal point from the locale. */
static void test_json(void) {
    tl_locale_use();
    cJSON *number = cJSON_Parse("[-2.5e-3]");
    TEST_ASSERT_NOT_NULL(number);
    TEST_ASSERT_EQUAL_DOUBLE(-2.5e-3, number->child->valuedouble);
    char *text = cJSON_PrintUnformatted(number);
    TEST_ASSERT_EQUAL_STRING("[-0.0025]", text);
    cJSON_free(text);
    cJSON_Delete(number);
}

static void on_link(void *context, const char *source, bool up, const char *text) {
    (void)context;
    (void)source;
    (void)up;
    (void)text;
}

/* With a decimal comma, the thread of a source could read no number of its CSV file. */
static void test_a_live_source(void) {
    static const tl_csv_column columns[] = {{"u", 1, 0}};
    static tl_sample_buffer_slot slots[1];
    static uint64_t posts;
    static tl_plant_input input = {.count = 1, .buffers = {{.slots = slots, .count = &posts, .depth = 1}}};
    const char *path = tl_scratch_path(&scratch, "live.csv");
    const tl_csv_settings settings = {.path = path, .time_column = "time", .columns = columns, .column_count = 1};
    tl_plant_source source = {.name = "csv", .driver = &tl_csv_driver, .period = TL_SECOND / 1000};
    tl_plant_readers *readers = NULL;
    tl_sample sample;
    tl_error error = {TL_OK, ""};
    FILE *file = fopen(path, "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("time,u\n0.25,1.5\n", file);
    (void)fclose(file);
    source.signal_count = 1;
    input.limits[0] = (tl_plant_limits){.minimum = -10, .maximum = 10};
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_csv_open_live(&settings, &source.io, &error));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_plant_readers_start(&source, 1, input.buffers, on_link, NULL, &readers, &error));
    while (__atomic_load_n(&posts, __ATOMIC_ACQUIRE) == 0) {
        const struct timespec pause = {.tv_nsec = 1000000};
        (void)nanosleep(&pause, NULL);
    }
    tl_plant_readers_stop(readers);
    tl_plant_input_take(&input, 0, tl_clock_now(NULL), &sample);
    TEST_ASSERT_EQUAL_INT(TL_GOOD, sample.quality[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1.5, sample.values[0]);
}

int main(void) {
    UNITY_BEGIN();
    has_comma = tl_comma_locale_set();
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_c_locale");
    RUN_TEST(test_a_thread_that_was_led_astray);
    RUN_TEST(test_another_thread);
    RUN_TEST(test_json);
    RUN_TEST(test_a_live_source);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
