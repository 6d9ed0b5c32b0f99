/* The blocks that a twin takes over at its start, above all the sample buffers. The test plays the
 * supervisor: it puts the blocks where a process expects them. */
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/live/live_blocks.h"
#include "firmware/process/role.h"
#include "tests/support/config_text.h"

static const char *const base =
    "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": 0.01,\n"
    " \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},\n"
    " \"sources\": {\"plc\": {\"modbus_tcp\": {\"host\": \"10.0.0.5\"}}, \"bus\": {\"modbus_tcp\": {\"host\": \"10.0.0.9\"}}},\n"
    " \"plant\": {\"u\": {\"modbus\": {\"source\": \"plc\", \"table\": \"coil\", \"address\": 1}},\n"
    "  \"w\": {\"modbus\": {\"source\": \"bus\", \"table\": \"coil\", \"address\": 2}}},\n"
    " \"compare\": {\"motor.omega\": {\"to\": \"plant.w\"}}}\n";

enum { U, W };

static tl_test_verdict run, own;
static tl_block blocks[TL_LIVE_BLOCKS];
static tl_plant_input input;
static tl_live_job job;
static tl_block sample_memory;
static tl_error error;

/* So that a new block does not get one of their descriptor numbers. */
static void occupy_numbers(void) {
    while (open("/dev/null", O_RDONLY | O_CLOEXEC) < TL_ROLE_DESCRIPTORS) {
    }
}

void setUp(void) {
    occupy_numbers();
    memset(&run, 0, sizeof run);
    memset(&own, 0, sizeof own);
    memset(&job, 0, sizeof job);
    memset(blocks, 0, sizeof blocks);
    memset(&input, 0, sizeof input);
    error.text[0] = '\0';
}

/* The blocks live as long as a process. Here they are closed after each test. */
void tearDown(void) {
    for (size_t i = 0; i < TL_LIVE_BLOCKS; i++) {
        tl_block_close(&blocks[i]);
    }
    tl_block_close(&sample_memory);
    tl_config_free(&run.config);
    tl_config_free(&own.config);
    tl_plant_input_close(&input);
}

static void read_config(const char *text, tl_test_verdict *verdict) {
    tl_test_judge_text(text, strlen(text), verdict);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, verdict->status, verdict->problems[0].text);
}

/* The run has the base configuration, the shadow an edited one. */
static void edit(const char *old, const char *new) {
    char *text = tl_test_replaced(base, old, new);
    TEST_ASSERT_NOT_NULL(text);
    read_config(base, &run);
    read_config(text, &own);
    free(text);
}

static void put(int number, const tl_block *block) {
    TEST_ASSERT_EQUAL_INT(number, dup2(block->descriptor, number));
}

static void give(int number, size_t size) {
    tl_block block;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_block_make("given", size, TL_BLOCK_THEY_WRITE, &block, &error));
    put(number, &block);
    tl_block_close(&block);
}

static void give_mail(int number, const tl_config *config, tl_block *block) {
    tl_sample_buffers_shape shape;
    tl_sample_buffers_shape_of(config, &shape);
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          tl_block_make("mail", tl_sample_buffers_bytes(&shape), TL_BLOCK_THEY_WRITE, block, &error));
    put(number, block);
}

static void give_rest(void) {
    size_t sizes[TL_LIVE_BLOCKS];
    const int wanted[] = {TL_LIVE_IO_BEATS, TL_LIVE_TWIN_STATUS, TL_LIVE_QUEUE, TL_LIVE_TUNING, TL_HANDOVER};
    tl_live_block_sizes(&own.config, sizes);
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0]; i++) {
        give(wanted[i], sizes[wanted[i]]);
    }
}

static tl_status take(void) {
    tl_live_job_apply(&job, &own.config);
    tl_status status = tl_live_blocks_take(TL_LIVE_IS_TWIN, &job, &own.config, blocks, &error);
    return status == TL_OK ? tl_live_input_open(&own.config, &blocks[TL_LIVE_SAMPLES], &input, &error) : status;
}

/* As the I/O process does. */
static void post(tl_block *block, const tl_config *config, size_t signal, double value) {
    tl_sample_buffer buffers[TL_MAX_SIGNALS];
    tl_sample_buffers_shape shape;
    const tl_reading reading = {.value = value, .stamp = 1000, .quality = TL_GOOD};
    tl_sample_buffers_shape_of(config, &shape);
    tl_sample_buffers_open(&shape, block->bytes, buffers);
    tl_sample_buffer_post(&buffers[signal], &reading);
}

static void expect(size_t signal, double value, tl_quality quality) {
    tl_sample sample;
    tl_plant_input_take(&input, 0, 2000, &sample);
    TEST_ASSERT_EQUAL_DOUBLE(value, sample.values[signal]);
    TEST_ASSERT_EQUAL_INT(quality, sample.quality[signal]);
}

static void test_the_plant_of_the_run(void) {
    edit("\"name\": \"motor\"", "\"name\": \"motor\", \"$schema\": \"x\"");
    give_mail(TL_LIVE_SAMPLES, &run.config, &sample_memory);
    give_rest();
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(), error.text);
    post(&sample_memory, &run.config, W, 1.0);
    expect(W, 1.0, TL_GOOD);
}

/* The shadow has a second lookup of a signal, which reads the same sample buffer. */
static void test_other_look_ups_than_the_run(void) {
    edit("\"compare\": {\"motor.omega\": {\"to\": \"plant.w\"}}",
         "\"connect\": [[\"plant.w\", \"motor.u\"]], \"synchronise\": {\"adjust\": {\"motor.k\": {\"step\": 1}},"
         " \"match\": {\"motor.omega\": {\"to\": \"plant.w\", \"tolerance\": 1,"
         " \"condition\": {\"low_pass_s\": 1}}}}");
    give_mail(TL_LIVE_SAMPLES, &run.config, &sample_memory);
    give_rest();
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, take(), error.text);
    TEST_ASSERT_TRUE(own.config.signal_count > run.config.signal_count);
    post(&sample_memory, &run.config, W, 1.0);
    expect(W, 1.0, TL_GOOD);
}

static void test_a_mail_of_another_size(void) {
    edit("10.0.0.9\"", "10.0.0.8\", \"period_s\": 0.001");
    give_mail(TL_LIVE_SAMPLES, &run.config, &sample_memory);
    give_rest();
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, take());
}

static void test_jobs_that_are_none(void) {
    const char *path = NULL;
    const char *text = NULL;
    size_t size = 0;
    unsigned char *bytes = tl_live_job_pack(&job, "x", "y", &size);
    TEST_ASSERT_NOT_NULL(bytes);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_live_job_unpack(bytes, size, &job, &path, &text, &error));
    TEST_ASSERT_EQUAL_STRING("x", path);
    TEST_ASSERT_EQUAL_STRING("y", text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_live_job_unpack(bytes, sizeof job, &job, &path, &text, &error));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_live_job_unpack(bytes, size - 1, &job, &path, &text, &error));
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_live_job_unpack(bytes, size - 2, &job, &path, &text, &error));
    free(bytes);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, tl_live_job_read(&job, "x.json", "{ no configuration", &own.config, &error));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_the_plant_of_the_run);
    RUN_TEST(test_other_look_ups_than_the_run);
    RUN_TEST(test_a_mail_of_another_size);
    RUN_TEST(test_jobs_that_are_none);
    return UNITY_END();
}
