/* The live plant: which signal gets which reading, and sources that are dead, unused or missing. */
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/os.h"
#include "firmware/cli/plant_server.h"
#include "firmware/plant/live_plant.h"
#include "firmware/plant/sample_buffer.h"
#include "tests/support/config_text.h"
#include "tests/support/device_value.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

#define PATIENCE (60 * TL_SECOND)

/* The signals alternate between two sources; `idle` feeds none of them. */
static const char CONFIG[] =
    "{ \"twinlock\": 1, \"name\": \"test\", \"step_s\": 0.01, \"components\": { \"motor\": { \"fmu\": \"motor.fmu\" } },"
    "  \"sources\": {"
    "    \"idle\": { \"modbus_tcp\": { \"host\": \"127.0.0.1\", \"port\": 1 } },"
    "    \"device\": { \"modbus_tcp\": { \"host\": \"127.0.0.1\", \"port\": %u, \"timeout_s\": 0.2 } },"
    "    \"rows\": { \"csv\": { \"file\": \"%s\" } } },"
    "  \"plant\": {"
    "    \"a\": { \"modbus\": { \"source\": \"device\", \"table\": \"input\", \"address\": 0, \"type\": \"float32\" },"
    "             \"min\": -10, \"max\": 10, \"stale_s\": 0.5 },"
    "    \"b\": { \"csv\": { \"source\": \"rows\", \"column\": \"second\" } },"
    "    \"c\": { \"modbus\": { \"source\": \"device\", \"table\": \"coil\", \"address\": 3 }, \"type\": \"boolean\" },"
    "    \"d\": { \"csv\": { \"source\": \"rows\", \"column\": \"first\" } } },"
    "  \"compare\": { \"motor.omega\": { \"to\": \"plant.b\" } } }";

static const tl_modbus_channel CHANNELS[] = {
    {.unit_id = 1, .table = TL_MODBUS_INPUT, .address = 0, .type = TL_MODBUS_FLOAT32, .scale = 1.0},
    {.unit_id = 1, .table = TL_MODBUS_COIL, .address = 3, .type = TL_MODBUS_BIT, .scale = 1.0},
};

static tl_scratch scratch;
static tl_test_verdict verdict;
static tl_plant_server *server;
static tl_live_plant *plant;
static void *sample_memory;
static tl_plant_input input;
static tl_error error;

/* Calls of on_link, from the threads of all sources. */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static char links[1024];
static unsigned wrong_contexts;

static void on_link(void *context, const char *source, bool good, const char *text) {
    (void)pthread_mutex_lock(&lock);
    wrong_contexts += context == links ? 0 : 1; /* no assertion: Unity is for one thread */
    size_t length = strlen(links);
    (void)snprintf(links + length, sizeof links - length, "%s %s: %s\n", source, good ? "good" : "bad", text);
    (void)pthread_mutex_unlock(&lock);
}

static unsigned phased; /* calls of run_start; atomic */

static tl_time run_start(void *context) {
    (void)context;
    (void)__atomic_add_fetch(&phased, 1, __ATOMIC_RELAXED);
    return 0;
}

static bool was_reported(const char *words) {
    (void)pthread_mutex_lock(&lock);
    bool found = strstr(links, words) != NULL;
    (void)pthread_mutex_unlock(&lock);
    return found;
}

static void wait_until_reported(const char *words) {
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (!was_reported(words)) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, words);
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 1000);
    }
}

void setUp(void) {
    verdict = (tl_test_verdict){.count = 0};
    links[0] = '\0';
    phased = 0;
    server = NULL;
    plant = NULL;
    sample_memory = NULL;
}

void tearDown(void) {
    tl_live_plant_close(plant);
    TEST_ASSERT_EQUAL_UINT(0, wrong_contexts);
    free(sample_memory);
    if (server != NULL) {
        tl_plant_server_stop(server);
    }
    tl_config_free(&verdict.config);
    tl_scratch_empty(&scratch);
}

static void start_server(uint16_t port) {
    const tl_plant_server_settings settings = {
        .host = "127.0.0.1", .port = port, .channels = CHANNELS, .channel_count = 2};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, tl_plant_server_start(&settings, &server, &error), error.text);
    tl_test_set_value(server, 0, 1.5);
    tl_test_set_value(server, 1, 1.0);
}

static void write_rows(void) {
    FILE *file = fopen(tl_scratch_path(&scratch, "rows.csv"), "w");
    TEST_ASSERT_NOT_NULL(file);
    (void)fputs("time,first,second\n0,10,20\n1000,11,21\n", file);
    (void)fclose(file);
}

static void read_config(unsigned port) {
    char text[sizeof CONFIG + PATH_MAX + 16];
    (void)snprintf(text, sizeof text, CONFIG, port, tl_scratch_path(&scratch, "rows.csv"));
    tl_test_judge_text(text, strlen(text), &verdict);
    TEST_ASSERT_EQUAL_STRING("", verdict.problems[0].text);
}

/* The sample buffers are made once per test, because they outlive a plant. */
static tl_status try_to_open(void) {
    const tl_config *config = &verdict.config;
    tl_sample_buffers_shape shape;
    if (sample_memory == NULL) {
        tl_live_plant_set_limits(&input, config);
        tl_sample_buffers_shape_of(config, &shape);
        sample_memory = calloc(1, tl_sample_buffers_bytes(&shape));
        TEST_ASSERT_NOT_NULL(sample_memory);
        tl_sample_buffers_open(&shape, sample_memory, input.buffers);
    }
    tl_sample_buffer buffers[TL_MAX_SIGNALS]; /* the plant copies them */
    memcpy(buffers, input.buffers, sizeof buffers);
    const tl_live_plant_settings settings = {.config = config,
                                             .kinds = TL_LIVE_PLANT_ALL,
                                             .buffers = buffers,
                                             .on_link = on_link,
                                             .run_start = run_start,
                                             .context = links};
    tl_status status = tl_live_plant_open(&settings, &plant, &error);
    memset(buffers, 0xff, sizeof buffers);
    return status;
}

static void open_plant(void) {
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, try_to_open(), error.text);
}

static void wait_until_complete(void) {
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (!tl_plant_input_is_complete(&input)) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "signals without a good reading");
        tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 1000);
    }
}

static tl_sample take(void) {
    tl_sample sample;
    tl_plant_input_take(&input, 0, tl_clock_now(NULL), &sample);
    return sample;
}

static void test_each_reading_reaches_its_signal(void) {
    start_server(0);
    write_rows();
    read_config(tl_plant_server_port(server));
    open_plant();
    wait_until_complete();
    tl_sample sample = take();
    TEST_ASSERT_EQUAL_DOUBLE(1.5, sample.values[0]);
    TEST_ASSERT_EQUAL_DOUBLE(20.0, sample.values[1]);
    TEST_ASSERT_EQUAL_DOUBLE(1.0, sample.values[2]);
    TEST_ASSERT_EQUAL_DOUBLE(10.0, sample.values[3]);
    TEST_ASSERT_TRUE(was_reported("device good: "));
    TEST_ASSERT_TRUE(was_reported("rows good: "));
    TEST_ASSERT_FALSE(was_reported("idle"));
}

static void test_values_are_judged_as_configured(void) {
    start_server(0);
    write_rows();
    read_config(tl_plant_server_port(server));
    open_plant();
    wait_until_complete();
    tl_test_set_value(server, 0, 10.5);
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (take().quality[0] != TL_OUT_OF_RANGE) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "never out of range");
    }
    TEST_ASSERT_EQUAL_UINT(4, input.count);
    TEST_ASSERT_EQUAL_INT64(TL_SECOND / 2, input.limits[0].stale);
    TEST_ASSERT_TRUE(isinf(input.limits[1].minimum) && isinf(input.limits[1].maximum));
    TEST_ASSERT_EQUAL_INT64(0, input.limits[1].stale);
    TEST_ASSERT_EQUAL_INT(TL_BOOLEAN, input.limits[2].type);
}

/* A port on which no server listens any more. */
static uint16_t dead_port(void) {
    start_server(0);
    uint16_t port = tl_plant_server_port(server);
    tl_plant_server_stop(server);
    server = NULL;
    return port;
}

static void test_a_dead_device_does_not_stop_the_others(void) {
    uint16_t port = dead_port();
    write_rows();
    read_config(port);
    open_plant();
    wait_until_reported("device bad: ");
    wait_until_reported("rows good: ");
    TEST_ASSERT_FALSE(tl_plant_input_is_complete(&input));
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (take().quality[1] != TL_GOOD) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "the other source is not read");
    }
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, take().quality[0]);
    start_server(port); /* it starts later */
    wait_until_reported("device good: ");
    wait_until_complete();
}

static void test_a_missing_file_is_waited_for(void) {
    start_server(0);
    read_config(tl_plant_server_port(server));
    open_plant();
    wait_until_reported("rows bad: ");
    TEST_ASSERT_FALSE(tl_plant_input_is_complete(&input));
    write_rows();
    wait_until_complete();
}

/* A new process opens the same memory. Earlier readings stay; an interrupted post is repaired. */
static void test_a_successor_uses_the_same_buffers(void) {
    start_server(0);
    write_rows();
    read_config(tl_plant_server_port(server));
    open_plant();
    wait_until_complete();
    tl_live_plant_close(plant);
    plant = NULL;
    tl_time before = tl_clock_now(NULL);
    tl_sample old = take();
    const tl_sample_buffer *buffer = &input.buffers[0];
    uint64_t posts = *buffer->count;
    buffer->slots[posts % buffer->depth].sequence = 2 * posts + 1;
    tl_test_set_value(server, 0, 2.5);
    open_plant();
    tl_time until = tl_clock_now(NULL) + PATIENCE;
    while (take().values[0] != 2.5) {
        TEST_ASSERT_TRUE_MESSAGE(tl_clock_now(NULL) < until, "nothing new");
    }
    TEST_ASSERT_TRUE(*buffer->count > posts);
    tl_sample again;
    tl_plant_input_take(&input, 0, before, &again);
    TEST_ASSERT_EQUAL_DOUBLE(1.5, again.values[0]);
    TEST_ASSERT_EQUAL_INT64(old.stamps[0], again.stamps[0]);
    TEST_ASSERT_EQUAL_DOUBLE(old.values[3], again.values[3]);
}

static void test_a_signal_without_a_source(void) {
    static const char TEXT[] =
        "{ \"twinlock\": 1, \"name\": \"test\", \"step_s\": 0.01, \"components\": { \"motor\": { \"fmu\": \"motor.fmu\" } },"
        "  \"plant\": { \"omega\": {} }, \"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } } }";
    tl_test_judge_text(TEXT, strlen(TEXT), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, try_to_open());
    TL_EXPECT_PARTS("plant.omega|source|replay", error.text);
    TEST_ASSERT_NULL(plant);
}

static void test_a_bus_that_is_not_there(void) {
    static const char TEXT[] =
        "{ \"twinlock\": 1, \"name\": \"test\", \"step_s\": 0.01, \"components\": { \"motor\": { \"fmu\": \"motor.fmu\" } },"
        "  \"sources\": { \"bus\": { \"can\": { \"interface\": \"tl-none0\" } } },"
        "  \"plant\": { \"omega\": { \"can\": { \"source\": \"bus\", \"id\": 1, \"start\": 0, \"length\": 8 } } },"
        "  \"compare\": { \"motor.omega\": { \"to\": \"plant.omega\" } } }";
    tl_test_judge_text(TEXT, strlen(TEXT), &verdict);
    TEST_ASSERT_EQUAL_INT(TL_OK, verdict.status);
    TEST_ASSERT_EQUAL_INT(TL_OK, try_to_open());
    wait_until_reported("bus bad: ");
    TEST_ASSERT_TRUE(was_reported("tl-none0"));
    TEST_ASSERT_FALSE(tl_plant_input_is_complete(&input));
}

static void test_closing_is_quick(void) {
    read_config(dead_port());
    for (int i = 0; i < 10; i++) {
        open_plant();
        tl_clock_sleep_until(tl_clock_now(NULL) + i * TL_SECOND / 1000);
        tl_live_plant_close(plant);
        plant = NULL;
    }
    tl_live_plant_close(NULL);
}

/* Only those of Modbus, and only if the period divides the step or is a multiple of it. */
static void test_which_polls_are_phased(void) {
    static const struct {
        double period_s;
        bool is_phased;
    } cases[] = {{0.01, true}, {0.03, true}, {0.005, true}, {0.004, false}, {0.015, false}};
    start_server(0);
    write_rows();
    read_config(tl_plant_server_port(server));
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        verdict.config.sources[1].period_s = cases[i].period_s;
        open_plant();
        uint64_t polls = __atomic_load_n(input.buffers[0].count, __ATOMIC_ACQUIRE) + 3;
        for (tl_time until = tl_clock_now(NULL) + PATIENCE;
             __atomic_load_n(input.buffers[0].count, __ATOMIC_ACQUIRE) < polls;) {
            TEST_ASSERT_TRUE(tl_clock_now(NULL) < until);
            tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND / 1000);
        }
        tl_live_plant_close(plant);
        plant = NULL;
        TEST_ASSERT_EQUAL_INT(cases[i].is_phased, phased > 0);
        phased = 0;
    }
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_live_plant");
    UNITY_BEGIN();
    RUN_TEST(test_each_reading_reaches_its_signal);
    RUN_TEST(test_values_are_judged_as_configured);
    RUN_TEST(test_a_dead_device_does_not_stop_the_others);
    RUN_TEST(test_a_missing_file_is_waited_for);
    RUN_TEST(test_a_successor_uses_the_same_buffers);
    RUN_TEST(test_a_signal_without_a_source);
    RUN_TEST(test_a_bus_that_is_not_there);
    RUN_TEST(test_closing_is_quick);
    RUN_TEST(test_which_polls_are_phased);
    return tl_scratch_finish(&scratch, UNITY_END());
}
