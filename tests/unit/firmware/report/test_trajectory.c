/* A trajectory file: exact text, exact numbers, and a full disk. */
#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/report/show.h"
#include "tests/support/config_text.h"
#include "tests/support/message.h"
#include "tests/support/scratch.h"

static tl_scratch scratch;
static tl_plan_match match[2];
static tl_plan_adjust adjust[1];
static tl_config config;
static tl_record record;
static tl_error error;

void setUp(void) {
    match[0] = (tl_plan_match){.variable = "motor.omega", .to = "plant.omega"};
    match[1] = (tl_plan_match){.variable = "motor.i", .to = "plant.i"};
    adjust[0] = (tl_plan_adjust){.variable = "motor.d"};
    config = (tl_config){.step = TL_SECOND / 100, .match = match, .adjust = adjust};
    config.match_count = 1;
    config.adjust_count = 1;
    record = (tl_record){.step = 0, .outcome = TL_OPTIMISED, .objective = 0.25, .evaluations = 7};
    record.y[0] = 62.5;
    record.measured[0] = 63.0;
    record.u[0] = 0.5;
    record.nominal[0] = -1.0;
}

void tearDown(void) {
    tl_scratch_empty(&scratch);
}

/* Writes one record. Returns the text of the file; the caller calls free(). */
static char *written(void) {
    const char *path = tl_scratch_path(&scratch, "steps.csv");
    FILE *file = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_trajectory_open(path, stdout, &config, &file, &error));
    tl_trajectory_add(file, &config, &record);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_trajectory_close(file, stdout, path, &error));
    char *text = tl_test_read_text(path);
    TEST_ASSERT_NOT_NULL(text);
    return text;
}

static void expect_written(const char *expected) {
    char *text = written();
    TEST_ASSERT_EQUAL_STRING(expected, text);
    free(text);
}

static void test_columns_and_a_row(void) {
    expect_written(
        "time,step,outcome,evaluations,J,motor.omega simulated,plant.omega measured,plant.omega quality,motor.d applied,motor.d nominal\n"
        "0.010000000,0,optimised,7,0.25,62.5,63,good,0.5,-1\n");
}

static void test_a_free_step_has_no_objective(void) {
    config.adjust_count = 0;
    record.step = 1400;
    record.outcome = TL_FREE;
    record.evaluations = 0;
    record.objective = (double)NAN;
    record.measured_quality[0] = TL_STALE;
    expect_written("time,step,outcome,evaluations,J,motor.omega simulated,plant.omega measured,plant.omega quality\n"
                   "14.010000000,1400,free,0,,62.5,63,stale\n");
}

/* If all candidates fail, there are evaluations, but no objective. The file has no NaN. */
static void test_an_objective_of_nan_is_left_out(void) {
    record.outcome = TL_NOMINAL;
    record.objective = (double)NAN;
    char *text = written();
    TEST_ASSERT_NOT_NULL(strstr(text, "nominal,7,,62.5"));
    free(text);
}

/* Arrays of FMUs have commas in their names. */
static void test_names_with_commas_and_quotes(void) {
    match[0].variable = "motor.phi[1,2]";
    adjust[0].variable = "motor.\"d\"";
    char *text = written();
    static const char header[] =
        "time,step,outcome,evaluations,J,\"motor.phi[1,2] simulated\",plant.omega measured,plant.omega quality,"
        "\"motor.\"\"d\"\" applied\",\"motor.\"\"d\"\" nominal\"\n";
    TEST_ASSERT_EQUAL_STRING_LEN(header, text, sizeof header - 1);
    free(text);
}

static void test_numbers_read_back_to_the_same_bits(void) {
    static const double numbers[] = {0.1, -0.0, 1.0 / 3.0, 5e-324, 1.7976931348623157e308, 9007199254740993.0, 1e-310};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        record.y[0] = numbers[i];
        char *text = written();
        const char *cell = strstr(text, "optimised,7,0.25,");
        TEST_ASSERT_NOT_NULL(cell);
        double found = strtod(cell + strlen("optimised,7,0.25,"), NULL);
        TEST_ASSERT_EQUAL_MEMORY(&numbers[i], &found, sizeof found);
        free(text);
    }
}

static void test_several_matches(void) {
    config.match_count = 2;
    record.y[1] = 1.5;
    record.measured[1] = 2.5;
    record.measured_quality[1] = TL_NO_LINK;
    expect_written("time,step,outcome,evaluations,J,motor.omega simulated,plant.omega measured,plant.omega quality,"
                   "motor.i simulated,plant.i measured,plant.i quality,motor.d applied,motor.d nominal\n"
                   "0.010000000,0,optimised,7,0.25,62.5,63,good,1.5,2.5,no link,0.5,-1\n");
}

static void test_a_dash_is_the_output(void) {
    FILE *output = tmpfile();
    FILE *file = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_trajectory_open("-", output, &config, &file, &error));
    TEST_ASSERT_EQUAL_PTR(output, file);
    tl_trajectory_add(file, &config, &record);
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_trajectory_close(file, output, "-", &error));
    TEST_ASSERT_GREATER_THAN_INT(50, (int)ftell(output)); /* still open */
    (void)fclose(output);
}

static void test_a_missing_folder(void) {
    FILE *file = NULL;
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_trajectory_open("/nowhere/steps.csv", stdout, &config, &file, &error));
    TL_EXPECT_PARTS("/nowhere/steps.csv|No such file", error.text);
}

static void test_a_full_disk(void) {
    FILE *file = NULL;
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_trajectory_open("/dev/full", stdout, &config, &file, &error));
    tl_trajectory_add(file, &config, &record);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_trajectory_close(file, stdout, "/dev/full", &error));
    TL_EXPECT_PARTS("/dev/full|No space left", error.text);
}

static void test_a_closed_pipe(void) {
    int ends[2];
    FILE *file = NULL;
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    (void)signal(SIGPIPE, SIG_IGN);
    FILE *output = fdopen(ends[1], "w");
    TEST_ASSERT_EQUAL_INT(0, close(ends[0]));
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_trajectory_open("-", output, &config, &file, &error));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, tl_trajectory_close(file, output, "-", &error));
    TL_EXPECT_PARTS("-|Broken pipe", error.text);
    (void)fclose(output);
}

int main(void) {
    tl_scratch_make(&scratch, TL_BINARY_DIR, "test_trajectory");
    UNITY_BEGIN();
    RUN_TEST(test_columns_and_a_row);
    RUN_TEST(test_a_free_step_has_no_objective);
    RUN_TEST(test_an_objective_of_nan_is_left_out);
    RUN_TEST(test_names_with_commas_and_quotes);
    RUN_TEST(test_numbers_read_back_to_the_same_bits);
    RUN_TEST(test_several_matches);
    RUN_TEST(test_a_dash_is_the_output);
    RUN_TEST(test_a_missing_folder);
    RUN_TEST(test_a_full_disk);
    RUN_TEST(test_a_closed_pipe);
    tl_scratch_remove(&scratch);
    return UNITY_END();
}
