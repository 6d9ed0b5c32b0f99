/* Sample buffers: their depth for each signal, and that no two of them overlap. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/plant/sample_buffer.h"
#include "tests/support/config_text.h"

enum { COUNTS = 4096, SLOT = 32 };

static tl_test_verdict verdict;
static tl_sample_buffers_shape shape;
static tl_sample_buffer buffers[TL_MAX_SIGNALS];
static void *memory;

void setUp(void) {
    verdict = (tl_test_verdict){.count = 0};
    memset(&shape, 0xA5, sizeof shape);
    memory = NULL;
}

void tearDown(void) {
    tl_config_free(&verdict.config);
    free(memory);
}

/* Signals of a polled device, of a CAN bus, and without a source. */
static void read_config(const char *step_s, const char *period_s, const char *hang_s) {
    static const char CONFIG[] =
        "{ \"twinlock\": 1, \"name\": \"test\", \"step_s\": %s, \"components\": { \"motor\": { \"fmu\": \"motor.fmu\" } },"
        "  \"sources\": {"
        "    \"device\": { \"modbus_tcp\": { \"host\": \"127.0.0.1\", \"port\": 1502, \"period_s\": %s } },"
        "    \"bus\": { \"can\": { \"interface\": \"can0\" } } },"
        "  \"plant\": {"
        "    \"a\": { \"modbus\": { \"source\": \"device\", \"table\": \"coil\", \"address\": 0 }, \"type\": \"boolean\" },"
        "    \"b\": { \"can\": { \"source\": \"bus\", \"id\": 1, \"start\": 0, \"length\": 8 } },"
        "    \"c\": {} },"
        "  \"compare\": { \"motor.omega\": { \"to\": \"plant.b\" } },"
        "  \"realtime\": { \"hang_s\": %s } }";
    char text[sizeof CONFIG + 64];
    (void)snprintf(text, sizeof text, CONFIG, step_s, period_s, hang_s);
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].text);
    tl_sample_buffers_shape_of(&verdict.config, &shape);
    TEST_ASSERT_EQUAL_size_t(3, shape.signals);
}

static void expect(const char *step_s, const char *period_s, const char *hang_s, const uint32_t depth[3]) {
    read_config(step_s, period_s, hang_s);
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_UINT32_MESSAGE(depth[i], shape.depth[i], period_s);
    }
    tl_config_free(&verdict.config);
    verdict = (tl_test_verdict){.count = 0};
}

static void test_what_is_polled_while_a_twin_is_started_again_is_kept(void) {
    expect("0.01", "0.01", "2", (const uint32_t[]){2048, 16384, 2048});   /* 12 s of 10 ms: 1201 readings */
    expect("0.01", "0.001", "2", (const uint32_t[]){16384, 16384, 2048}); /* 12 s of 1 ms: 12001 readings */
    expect("0.01", "0.01", "60", (const uint32_t[]){8192, 65536, 8192});  /* 70 s: 7001 readings */
}

static void test_neither_finer_than_a_millisecond_nor_coarser_than_a_step(void) {
    expect("0.01", "0.00001", "2", (const uint32_t[]){16384, 16384, 2048});
    expect("0.01", "5", "2", (const uint32_t[]){2048, 16384, 2048});
    expect("0.0001", "0.0001", "2", (const uint32_t[]){16384, 16384, 16384});
}

static void test_at_least_256_and_at_most_65536(void) {
    expect("1", "1", "2", (const uint32_t[]){256, 16384, 256});
    expect("0.01", "0.001", "3600", (const uint32_t[]){65536, 65536, 65536});
    expect("0.047", "1", "2", (const uint32_t[]){256, 16384, 256}); /* 12 s: 255.3 readings, and one */
    expect("0.046", "1", "2", (const uint32_t[]){512, 16384, 512});
}

static void make_mail(void) {
    memory = calloc(1, tl_sample_buffers_bytes(&shape));
    TEST_ASSERT_NOT_NULL(memory);
    tl_sample_buffers_open(&shape, memory, buffers);
}

static void test_buffers_lie_one_behind_the_other(void) {
    read_config("0.01", "0.001", "2");
    size_t bytes = tl_sample_buffers_bytes(&shape);
    TEST_ASSERT_EQUAL_size_t(COUNTS + (size_t)SLOT * (16384 + 16384 + 2048), bytes);
    make_mail();
    const unsigned char *end = (const unsigned char *)memory + COUNTS;
    for (size_t i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_PTR((unsigned char *)memory + 64 * i, buffers[i].count);
        TEST_ASSERT_EQUAL_PTR(end, buffers[i].slots);
        end += buffers[i].depth * sizeof *buffers[i].slots;
    }
    TEST_ASSERT_EQUAL_PTR((unsigned char *)memory + bytes, end);
}

static void test_what_is_posted_to_one_is_in_none_of_the_others(void) {
    read_config("0.01", "0.001", "2");
    make_mail();
    for (int post = 0; post < 40000; post++) {
        for (size_t i = 0; i < 3; i++) {
            const tl_reading reading = {.value = 10.0 * post + (double)i, .stamp = post, .quality = TL_GOOD};
            tl_sample_buffer_post(&buffers[i], &reading);
        }
    }
    for (size_t i = 0; i < 3; i++) {
        tl_reading reading = {.value = -1};
        TEST_ASSERT_TRUE(tl_sample_buffer_at(&buffers[i], 39999, &reading));
        TEST_ASSERT_EQUAL_DOUBLE(399990.0 + (double)i, reading.value);
        TEST_ASSERT_TRUE(tl_sample_buffer_at(&buffers[i], 0, &reading));
        TEST_ASSERT_EQUAL_INT64(40000 - (tl_time)shape.depth[i], reading.stamp); /* the oldest kept reading */
        TEST_ASSERT_EQUAL_DOUBLE(10.0 * (double)reading.stamp + (double)i, reading.value);
    }
}

/* Second lookups change neither the size nor the places of the buffers. */
static void test_a_second_look_up_has_no_buffer_of_its_own(void) {
    read_config("0.01", "0.001", "2");
    size_t bytes = tl_sample_buffers_bytes(&shape);
    shape.signals = 5;
    shape.of[3] = 2;
    shape.of[4] = 0;
    TEST_ASSERT_EQUAL_size_t(bytes, tl_sample_buffers_bytes(&shape));
    make_mail();
    TEST_ASSERT_EQUAL_MEMORY(&buffers[2], &buffers[3], sizeof buffers[3]);
    TEST_ASSERT_EQUAL_MEMORY(&buffers[0], &buffers[4], sizeof buffers[4]);
}

static void test_a_plant_without_signals_has_a_mail_too(void) {
    shape.signals = 0;
    TEST_ASSERT_EQUAL_size_t(COUNTS, tl_sample_buffers_bytes(&shape)); /* a block cannot be empty */
}

static void test_the_least(void) {
    memory = tl_sample_buffers_make_least(TL_MAX_SIGNALS, buffers);
    TEST_ASSERT_NOT_NULL(memory);
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        TEST_ASSERT_EQUAL_UINT32(256, buffers[i].depth);
        TEST_ASSERT_EQUAL_PTR((unsigned char *)memory + COUNTS + i * 256 * SLOT, buffers[i].slots);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_is_polled_while_a_twin_is_started_again_is_kept);
    RUN_TEST(test_neither_finer_than_a_millisecond_nor_coarser_than_a_step);
    RUN_TEST(test_at_least_256_and_at_most_65536);
    RUN_TEST(test_buffers_lie_one_behind_the_other);
    RUN_TEST(test_what_is_posted_to_one_is_in_none_of_the_others);
    RUN_TEST(test_a_second_look_up_has_no_buffer_of_its_own);
    RUN_TEST(test_a_plant_without_signals_has_a_mail_too);
    RUN_TEST(test_the_least);
    return UNITY_END();
}
