/* The summary: its sums, and that the JSON object and the table have the values of the twin. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/report/summary.h"
#include "firmware/twin/assembly.h"
#include "tests/support/message.h"
#include "tests/support/read_assembly.h"

static tl_assembly assembly;
static tl_summary summary;
static tl_account account;
static char *printed;
static size_t printed_size;
static cJSON *root;

void setUp(void) {
    TEST_ASSERT_EQUAL_INT(0, setenv("TWINLOCK_FMU_PATH", TL_BINARY_DIR "/fmus", 1));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(TL_SOURCE_DIR "/tests/support/motor_lock.json", &assembly));
    assembly.config.algorithm = "nelder-mead"; /* independent of the default */
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_build(&assembly));
    memset(&summary, 0, sizeof summary);
}

void tearDown(void) {
    tl_assembly_free(&assembly);
    cJSON_Delete(root);
    root = NULL;
    free(printed);
    printed = NULL;
}

/* Adds a record like those of the twin. */
static void add(tl_outcome outcome, uint32_t evaluations, double u, double nominal) {
    tl_record record = {.outcome = outcome, .evaluations = evaluations};
    record.u[0] = u;
    record.nominal[0] = nominal;
    tl_summary_add(&summary, &assembly.config, &record);
}

/* Steps the twin while the plant's motor turns with `omega`, and adds the records. */
static void run(int ticks, double omega, tl_quality quality) {
    const tl_budget budget = {.evaluations = 40};
    static tl_sample sample;
    for (int i = 0; i < ticks; i++) {
        tl_record record;
        tl_error error;
        bool ready = false;
        sample.tick = i;
        sample.values[1] = omega;
        sample.quality[1] = (uint8_t)quality;
        TEST_ASSERT_EQUAL_INT(TL_OK, tl_twin_step(assembly.twin, &sample, &budget, &record, &ready, &error));
        if (ready) {
            tl_summary_add(&summary, &assembly.config, &record);
        }
    }
}

static void print_table(void) {
    FILE *file = open_memstream(&printed, &printed_size);
    tl_account_take(assembly.twin, &account);
    tl_summary_print_table(&summary, &assembly.config, &account, NULL, true, file);
    (void)fclose(file);
}

static tl_status try_json(tl_error *error) {
    FILE *file = open_memstream(&printed, &printed_size);
    tl_account_take(assembly.twin, &account);
    tl_status status = tl_summary_print_json(&summary, &assembly.config, &account, NULL, file, error);
    (void)fclose(file);
    return status;
}

static void print_json(void) {
    tl_error error = {TL_OK, ""};
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, try_json(&error), error.text);
    root = cJSON_Parse(printed);
    TEST_ASSERT_NOT_NULL(root);
    TEST_ASSERT_EQUAL_CHAR('\n', printed[printed_size - 1]);
}

/* Returns the JSON value at "a/b/c". */
static const cJSON *find(const char *path) {
    char copy[128];
    char *rest = NULL;
    const cJSON *item = root;
    (void)snprintf(copy, sizeof copy, "%s", path);
    for (const char *key = strtok_r(copy, "/", &rest); key != NULL; key = strtok_r(NULL, "/", &rest)) {
        item = cJSON_GetObjectItemCaseSensitive(item, key);
    }
    return item;
}

static double number(const char *path) {
    const cJSON *item = find(path);
    TEST_ASSERT_TRUE_MESSAGE(cJSON_IsNumber(item), path);
    return item->valuedouble;
}

static void expect_number(double expected, const char *path) {
    TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(expected, number(path), path);
}

static void expect_line(const char *parts) {
    TEST_ASSERT_TRUE_MESSAGE(tl_test_has_line(printed, parts), printed);
}

static void test_sums(void) {
    add(TL_FIRST_GUESS, 1, 1.0, 1.0);
    add(TL_OPTIMISED, 7, 4.0, 2.0);
    add(TL_BEST_SO_FAR, 40, -2.0, 3.0);
    add(TL_NOMINAL, 2, 5.0, 5.0);
    add(TL_FREE_RUN, 0, 2.0, 2.0);
    print_json();
    expect_number(5, "steps");
    expect_number(50, "evaluations");
    expect_number(3, "optimised_steps");
    expect_number(1, "adjust/motor.d/first");
    expect_number(2, "adjust/motor.d/last");
    expect_number(2, "adjust/motor.d/mean");
    expect_number(-0.6, "adjust/motor.d/correction_mean");
    expect_number(1, "outcomes/first guess");
    expect_number(1, "outcomes/free run");
    expect_number(0, "outcomes/caught up");
}

/* The ticks are the computed and the skipped steps. Means include both. */
static void test_skipped_steps(void) {
    add(TL_CAUGHT_UP, 0, 9.0, 1.0);
    add(TL_FIRST_GUESS, 1, 3.0, 1.0);
    summary.ticks = 2;
    summary.figures.skipped = 1;
    print_json();
    expect_number(1, "steps");
    expect_number(1, "skipped");
    expect_number(2, "ticks");
    expect_number(1, "outcomes/caught up");
    expect_number(9, "adjust/motor.d/first");
    expect_number(6, "adjust/motor.d/mean");
    expect_number(5, "adjust/motor.d/correction_mean");
}

static void test_time_limits_and_the_longest_step(void) {
    tl_record record = {.outcome = TL_BEST_SO_FAR, .stop = TL_STOP_TIME, .used = 3000000};
    tl_summary_add(&summary, &assembly.config, &record);
    record.stop = TL_STOP_SOLVER;
    record.used = 1000000;
    tl_summary_add(&summary, &assembly.config, &record);
    TEST_ASSERT_EQUAL_UINT64(1, summary.figures.time_limited);
    TEST_ASSERT_EQUAL_INT64(3000000, summary.figures.longest);
    summary.ticks = 2;
    summary.deadline_misses = 1;
    print_table();
    expect_line("2 ticks|0 missed");
    expect_line("1 deadlines|3.000 ms");
}

/* Ages are shown for a live run only, because a recording has none. */
static void test_ages(void) {
    tl_config_source source = {0};
    tl_sample sample = {.instant = TL_SECOND};
    assembly.config.sources = &source;
    assembly.config.source_count = 1;
    for (size_t i = 0; i < assembly.config.signal_count; i++) {
        assembly.config.signals[i].source = 0;
        sample.stamps[i] = TL_SECOND - 3000000;
    }
    tl_summary_sample(&summary, &assembly.config, &sample);
    print_json();
    TEST_ASSERT_NULL(find("age"));
    cJSON_Delete(root);
    root = NULL;
    free(printed);
    summary.ticks = 1;
    print_json();
    expect_number((double)assembly.config.signal_count - 1, "age/values"); /* omega and omega@reading are one */
    expect_number(0.003014656, "age/p50_s");
    expect_number(0.003014656, "age/p99_s");
    free(printed);
    print_table();
    expect_line("3.015 ms|p50|3.015 ms|p99");
    assembly.config.source_count = 0;
    assembly.config.sources = NULL;
}

static void test_nothing_happened(void) {
    print_json();
    expect_number(0, "steps");
    expect_number(0, "executions/total");
    TEST_ASSERT_TRUE(cJSON_IsNull(find("match/motor.omega/mse")));
    TEST_ASSERT_TRUE(cJSON_IsNull(find("match/motor.omega/max")));
    expect_number(0, "adjust/motor.d/mean");
    free(printed);
    print_table();
    expect_line("in lock|no steps");
    expect_line("motor.omega|two good");
    TEST_ASSERT_NULL(strstr(printed, "nan"));
}

static void test_json_has_the_values_of_the_twin(void) {
    run(11, 70.0, TL_GOOD);
    print_json();
    const tl_metrics *metrics = tl_twin_metrics(assembly.twin, 0);
    expect_number(10, "steps");
    expect_number(3.0 * (10 + number("evaluations")), "ledger/total/plain");
    expect_number(number("executions/total"), "ledger/total/executions");
    expect_number(number("executions/total"), "ledger/total/predicted");
    expect_number((double)tl_twin_executions(assembly.twin, 1), "executions/motor");
    expect_number((double)tl_twin_executions(assembly.twin, 1), "ledger/components/motor/executions");
    expect_number(10 + number("evaluations"), "ledger/components/motor/plain");
    expect_number(0, "ledger/total/repeated");
    expect_number(0, "ledger/total/uncached");
    TEST_ASSERT_TRUE(cJSON_IsTrue(find("ledger/complete")));
    expect_number(10, "executions/plant");
    expect_number(tl_metrics_mse(metrics), "match/motor.omega/mse");
    expect_number(metrics->maximum, "match/motor.omega/max");
    expect_number(10, "match/motor.omega/pairs");
    TEST_ASSERT_TRUE(metrics->maximum > 0.0);
    TEST_ASSERT_NOT_NULL(strstr(printed, "\"unit\":\t\"N.m.s/rad\""));
    expect_number(0, "ledger/components/motor/difference");
    expect_number(0, "ledger/total/difference");
    expect_number(number("ledger/total/plain") - number("executions/total"), "ledger/total/saved");
    expect_number(number("ledger/total/saved"), "cache/saved");
    TEST_ASSERT_TRUE(number("cache/saved") > 0);
    TEST_ASSERT_TRUE(number("cache/nodes_peak") > 0);
    expect_number(0, "cache/full");
    expect_number(0, "deadline_misses");
}

static void test_the_table(void) {
    run(11, 62.85, TL_GOOD);
    print_table();
    expect_line("motor bench, locked by the motor's friction");
    expect_line("steps|10 first guess");
    expect_line("executions|30|1.000|10 evaluations");
    expect_line("ledger|predicted 30|60|saved 30");
    expect_line("motor.d|corrected|+0 N.m.s/rad|nominal 0.0031");
    expect_line("motor.d|mean 0.0031|last 0.0031");
    expect_line("motor.omega|0.00238 rad/s rms|0.00226 rad/s");
    expect_line("MSE|(rad/s)\302\262");
    TEST_ASSERT_NULL(strstr(printed, "real time"));
    TEST_ASSERT_NULL(strstr(printed, "left out"));
}

static void test_a_measure_beyond_all_numbers(void) {
    run(11, 1e200, TL_GOOD);
    print_json();
    TEST_ASSERT_TRUE(cJSON_IsNull(find("match/motor.omega/mse")));
    free(printed);
    print_table();
    expect_line("motor.omega|MSE - (rad/s)\302\262");
    expect_line("motor.omega|- rad/s rms|1e+200 rad/s");
}

static void load(const char *path) {
    tl_assembly_free(&assembly);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_test_read_assembly(path, &assembly));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_assembly_build(&assembly));
}

/* For a Boolean, the table has the share of steps in which it was on. The unit of the MSE has no
 * brackets if it is one word. */
static void test_a_boolean(void) {
    load(TL_SOURCE_DIR "/config/transport/slow.json");
    run(11, 0.0, TL_GOOD);
    memset(&summary, 0, sizeof summary);
    add(TL_OPTIMISED, 2, 0.0, 1.0);
    add(TL_FIRST_GUESS, 1, 1.0, 1.0);
    add(TL_FIRST_GUESS, 1, 0.0, 0.0);
    add(TL_FIRST_GUESS, 1, 0.0, 1.0);
    print_table();
    expect_line("belt2.enabled|25.0 %|last off|75.0 %");
    expect_line("MSE|mm\302\262");
    add(TL_FIRST_GUESS, 1, 1.0, 0.0);
    free(printed);
    print_table();
    expect_line("belt2.enabled|40.0 %|last on|60.0 %");
}

static void test_measurements_left_out(void) {
    run(11, 62.85, TL_STALE);
    print_table();
    expect_line("steps|10 free run");
    expect_line("10 of 10|measurements|left out");
}

static void *refuse(size_t size) {
    (void)size;
    return NULL;
}

/* If memory runs out, the function fails and prints nothing. */
static void test_no_memory(void) {
    cJSON_Hooks hooks = {.malloc_fn = refuse, .free_fn = free};
    tl_error error = {TL_OK, ""};
    cJSON_InitHooks(&hooks);
    tl_status status = try_json(&error);
    cJSON_InitHooks(NULL);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
    TL_EXPECT_PARTS("memory", error.text);
    TEST_ASSERT_EQUAL_size_t(0, printed_size);
}

static bool table_has(const char *parts) {
    print_table();
    bool found = tl_test_has_line(printed, parts);
    free(printed);
    printed = NULL;
    return found;
}

/* The table has a line of tunings only if the run had some. */
static void test_tunings(void) {
    add(TL_FIRST_GUESS, 1, 1.0, 1.0);
    TEST_ASSERT_FALSE(table_has("tunings"));
    summary.tunings = 3;
    TEST_ASSERT_TRUE(table_has("tunings|3"));
    TEST_ASSERT_FALSE(table_has("tunings|not applied"));
    summary.tunings_left_out = 3;
    TEST_ASSERT_TRUE(table_has("tunings|3|not applied|configuration"));
    print_json();
    expect_number(3, "tunings/recorded");
    expect_number(0, "tunings/applied");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_sums);
    RUN_TEST(test_skipped_steps);
    RUN_TEST(test_time_limits_and_the_longest_step);
    RUN_TEST(test_ages);
    RUN_TEST(test_nothing_happened);
    RUN_TEST(test_json_has_the_values_of_the_twin);
    RUN_TEST(test_the_table);
    RUN_TEST(test_a_measure_beyond_all_numbers);
    RUN_TEST(test_a_boolean);
    RUN_TEST(test_measurements_left_out);
    RUN_TEST(test_no_memory);
    RUN_TEST(test_tunings);
    return UNITY_END();
}
