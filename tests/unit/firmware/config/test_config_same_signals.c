/* Which signals of an edited configuration a run reads as well. */
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/config/config_same_signals.h"
#include "tests/support/config_text.h"

enum { U, OMEGA, DOOR };
enum { NONE = -1 };

static const char *const base =
    "{\"twinlock\": 1, \"name\": \"motor\", \"step_s\": 0.01,\n"
    " \"components\": {\"motor\": {\"fmu\": \"motor.fmu\"}},\n"
    " \"sources\": {\"inverter\": {\"modbus_tcp\": {\"host\": \"10.0.0.5\"}},\n"
    "  \"unit\": {\"modbus_tcp\": {\"host\": \"10.0.0.9\"}}},\n"
    " \"plant\": {\"u\": {\"max\": 5, \"modbus\": {\"source\": \"inverter\", \"unit_id\": 1, \"table\": \"input\", \"address\": 3, \"type\": \"int16\"}},\n"
    "  \"omega\": {\"stale_s\": 0.5, \"modbus\": {\"source\": \"inverter\", \"unit_id\": 1, \"table\": \"input\", \"address\": 4, \"type\": \"int16\"}},\n"
    "  \"door\": {\"modbus\": {\"source\": \"unit\", \"unit_id\": 1, \"table\": \"coil\", \"address\": 7}}},\n"
    " \"connect\": [[\"plant.u\", \"motor.u\"]],\n"
    " \"synchronise\": {\"adjust\": {\"motor.load\": {\"step\": 0.1}},\n"
    "  \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 0.5}}}}\n";

static tl_test_verdict run, candidate;
static tl_same_signals same;

void setUp(void) {
    memset(&run, 0, sizeof run);
    memset(&candidate, 0, sizeof candidate);
}

void tearDown(void) {
    tl_config_free(&run.config);
    tl_config_free(&candidate.config);
}

static void read(const char *text, tl_test_verdict *verdict) {
    tl_config_free(&verdict->config);
    tl_test_judge_text(text, strlen(text), verdict);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, verdict->status, verdict->problems[0].text);
    tl_config_use_lookups(&verdict->config);
}

static void compare(const char *text) {
    tl_error error;
    read(base, &run);
    read(text, &candidate);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_config_same_signals(&run.config, &candidate.config, &same, &error));
}

static void edit(const char *old, const char *new) {
    char *text = tl_test_replaced(base, old, new);
    TEST_ASSERT_NOT_NULL(text);
    compare(text);
    free(text);
}

/* Of each of the candidate's signals, the run's index. */
static void expect(size_t count, const int of[], bool is_each) {
    size_t unseen = 0;
    TEST_ASSERT_EQUAL_size_t(count, same.count);
    for (size_t i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL_size_t(of[i] == NONE ? TL_NO_SUCH_SIGNAL : (size_t)of[i], same.of[i]);
        unseen += of[i] == NONE ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_size_t(unseen, same.unseen);
    TEST_ASSERT_EQUAL_INT(is_each, same.is_each);
}

static void test_each(void) {
    static const int all[] = {U, OMEGA, DOOR};
    compare(base);
    expect(3, all, true);
    edit("\"stale_s\": 0.5", "\"stale_s\": 1, \"min\": 0, \"unit\": \"rad/s\"");
    expect(3, all, true);
    edit("\"tolerance\": 0.5", "\"tolerance\": 1");
    expect(3, all, true);
    edit("\"sources\": {", "\"sources\": {\"spare\": {\"modbus_tcp\": {\"host\": \"10.0.0.7\"}}, ");
    expect(3, all, true);
    TEST_ASSERT_FALSE(tl_same_signals_lack_input(&same, &candidate.config));
}

/* Its driver is to take other polls for readings: until 0.04 s, or half of the 0.06 s after which it is stale, less the 0.01 s to the next poll. */
static void test_another_time_between_readings(void) {
    static const int all[] = {U, OMEGA, DOOR};
    edit("\"stale_s\": 0.5", "\"stale_s\": 0.5, \"every_s\": 0.04");
    expect(3, all, false);
    TEST_ASSERT_EQUAL_INT64(0, tl_config_repeats(&run.config, &run.config.signals[OMEGA]));
    TEST_ASSERT_EQUAL_INT64(30 * TL_SECOND / 1000,
                            tl_config_repeats(&candidate.config, &candidate.config.signals[OMEGA]));
    edit("\"stale_s\": 0.5", "\"stale_s\": 0.06, \"every_s\": 0.04");
    TEST_ASSERT_EQUAL_INT64(20 * TL_SECOND / 1000,
                            tl_config_repeats(&candidate.config, &candidate.config.signals[OMEGA]));
    edit("\"stale_s\": 0.5", "\"every_s\": 0.01");
    TEST_ASSERT_EQUAL_INT64(0, tl_config_repeats(&candidate.config, &candidate.config.signals[OMEGA]));
    expect(3, all, true);
}

static void test_another_source(void) {
    static const int door[] = {NONE, NONE, DOOR};
    static const int both[] = {U, OMEGA, NONE};
    edit("10.0.0.5", "10.0.0.6");
    expect(3, door, false);
    TEST_ASSERT_TRUE(tl_same_signals_lack_input(&same, &candidate.config));
    edit("10.0.0.9\"", "10.0.0.9\", \"timeout_s\": 0.1");
    expect(3, both, false);
    TEST_ASSERT_FALSE(tl_same_signals_lack_input(&same, &candidate.config));
}

static void test_another_place(void) {
    static const int of[] = {U, NONE, DOOR};
    edit("\"address\": 4", "\"address\": 5");
    expect(3, of, false);
    edit("\"stale_s\": 0.5", "\"type\": \"integer\"");
    expect(3, of, false);
    edit("\"source\": \"inverter\", \"unit_id\": 1, \"table\": \"input\", \"address\": 4",
         "\"source\": \"unit\", \"unit_id\": 1, \"table\": \"input\", \"address\": 4");
    expect(3, of, false);
}

static void test_more_and_fewer(void) {
    static const int more[] = {NONE, U, OMEGA, DOOR};
    static const int fewer[] = {U, OMEGA};
    static const int other[] = {U, OMEGA, NONE};
    edit("\"plant\": {",
         "\"plant\": {\"new\": {\"modbus\": {\"source\": \"unit\", \"unit_id\": 1, \"table\": \"coil\", "
         "\"address\": 8}}, ");
    expect(4, more, false);
    edit(",\n  \"door\": {\"modbus\": {\"source\": \"unit\", \"unit_id\": 1, \"table\": \"coil\", \"address\": 7}}",
         "");
    expect(2, fewer, false);
    edit("\"door\"", "\"gate\"");
    expect(3, other, false);
}

static void test_another_order(void) {
    static const int of[] = {U, DOOR, OMEGA};
    char *moved = tl_test_replaced(
        base, "  \"door\": {\"modbus\": {\"source\": \"unit\", \"unit_id\": 1, \"table\": \"coil\", \"address\": 7}}},",
        "  \"omega\": {\"stale_s\": 0.5, \"modbus\": {\"source\": \"inverter\", \"unit_id\": 1, \"table\": \"input\", \"address\": 4, \"type\": \"int16\"}}},");
    TEST_ASSERT_NOT_NULL(moved);
    char *text = tl_test_replaced(
        moved,
        "  \"omega\": {\"stale_s\": 0.5, \"modbus\": {\"source\": \"inverter\", \"unit_id\": 1, \"table\": \"input\", \"address\": 4, \"type\": \"int16\"}},\n",
        "  \"door\": {\"modbus\": {\"source\": \"unit\", \"unit_id\": 1, \"table\": \"coil\", \"address\": 7}},\n");
    TEST_ASSERT_NOT_NULL(text);
    compare(text);
    expect(3, of, false);
    free(moved);
    free(text);
}

/* What feeds an input and is matched is looked up twice if there are delays: two looks at one signal. */
static void test_second_lookups(void) {
    static const int of[] = {U, OMEGA, DOOR, OMEGA};
    char *delayed = tl_test_replaced(
        base, "\"connect\": [",
        "\"delays\": {\"measure\": {\"range_s\": 0.1}}, \"connect\": [[\"plant.omega\", \"motor.w\"], ");
    TEST_ASSERT_NOT_NULL(delayed);
    compare(delayed);
    expect(4, of, false);
    free(delayed);
}

static void test_a_sample(void) {
    tl_sample of_run = {
        .tick = 7, .instant = 70, .values = {1, 2, 3}, .stamps = {60, 61, 62}, .quality = {0, TL_STALE, 0}};
    tl_sample sample;
    edit("\"plant\": {",
         "\"plant\": {\"new\": {\"modbus\": {\"source\": \"unit\", \"unit_id\": 1, \"table\": \"coil\", "
         "\"address\": 8}}, ");
    memset(&sample, 0xA5, sizeof sample);
    tl_same_signals_sample(&same, &of_run, &sample);
    TEST_ASSERT_EQUAL_INT64(7, sample.tick);
    TEST_ASSERT_EQUAL_INT64(70, sample.instant);
    TEST_ASSERT_EQUAL_INT(TL_NO_LINK, sample.quality[0]);
    TEST_ASSERT_EQUAL_INT64(TL_TIME_NEVER, sample.stamps[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, sample.values[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1, sample.values[1]);
    TEST_ASSERT_EQUAL_DOUBLE(2, sample.values[2]);
    TEST_ASSERT_EQUAL_INT(TL_STALE, sample.quality[2]);
    TEST_ASSERT_EQUAL_INT64(62, sample.stamps[3]);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_each);
    RUN_TEST(test_another_time_between_readings);
    RUN_TEST(test_another_source);
    RUN_TEST(test_another_place);
    RUN_TEST(test_more_and_fewer);
    RUN_TEST(test_another_order);
    RUN_TEST(test_second_lookups);
    RUN_TEST(test_a_sample);
    return UNITY_END();
}
