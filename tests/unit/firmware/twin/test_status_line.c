/* The line that a terminal and `reload --state` show of a run. */
#include <string.h>

#include <unity.h>

#include "firmware/twin/cycle.h"

static tl_plan_adjust adjust[2];
static tl_plan_match match[2];
static tl_config config;
static tl_cycle_status status;
static uint32_t open_findings;
static char line[TL_STATUS_LINE];

void setUp(void) {
    open_findings = 0;
    config =
        (tl_config){.step = TL_SECOND / 100, .adjust_count = 1, .match_count = 1, .adjust = adjust, .match = match};
    adjust[0].variable = "motor.d";
    match[0].variable = "motor.omega";
    status = (tl_cycle_status){.skipped = 3, .lock = {.state = TL_LOCK_LOCKED}};
    status.record =
        (tl_record){.step = 99, .outcome = TL_OPTIMISED, .used = 12000, .u = {1.5}, .nominal = {1.0}, .y = {2.0}};
    status.record.measured[0] = 2.5;
    status.record.measured_quality[0] = TL_GOOD;
}

void tearDown(void) {}

static void expect_words(const char *words) {
    tl_status_line_write(&config, &status, open_findings, line);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(line, words), line);
    TEST_ASSERT_LESS_THAN_size_t(80, strlen(line));
}

static void test_what_it_says(void) {
    status.skipped = 0;
    expect_words("    1.00 s  locked  \316\224motor.d +0.5  motor.omega 2 (plant 2.5)  0.01 ms");
    status.skipped = 3;
    expect_words("    1.00 s  locked  3 ticks missed  \316\224motor.d +0.5  motor.omega 2 (plant 2.5)");
}

static void test_open_findings(void) {
    open_findings = 1;
    expect_words("  locked  1 change  3 ticks missed");
    open_findings = 12;
    expect_words("  locked  12 changes  ");
}

static void test_that_u_rests(void) {
    status.record.flags = TL_FLAG_RESTS;
    expect_words("  motor.d at nominal  ");
}

static void test_a_standing_correction(void) {
    status.skipped = 0;
    status.lock.state = TL_LOCK_CORRECTED;
    status.lock.standing = (tl_lock_standing){
        .reason = TL_LOCK_REASON_CORRECTION, .variable = "motor.d", .unit = "W", .value = 5, .since_s = 18006};
    expect_words("    1.00 s  locked, corrected: motor.d +5 W since t = 18006 s");
    status.lock.standing.started = 1;
    status.lock.standing.now_s = 18006;
    expect_words("    1.00 s  locked, corrected: motor.d +5 W since 05:00:06 UTC");
    memset(status.lock.standing.variable, 'a', TL_LOCK_VARIABLE - 1);
    expect_words("    1.00 s  locked, corrected since 05:00:06 UTC");
}

static void test_a_measurement_that_is_not_good(void) {
    status.record.measured_quality[0] = TL_NO_LINK;
    status.skipped = 0;
    expect_words("(plant: no link)");
}

static void test_a_twin_that_runs_free(void) {
    config.adjust_count = 0;
    expect_words("  free-running  3 ticks missed  motor.omega 2 (plant 2.5)  0.01 ms");
}

/* A part that does not fit into a line of a terminal is left out. */
static void test_names_that_are_longer_than_a_line(void) {
    static char name[4096];
    memset(name, 'a', sizeof name - 1);
    adjust[0].variable = match[0].variable = name;
    config.adjust_count = config.match_count = 2;
    adjust[1].variable = match[1].variable = name;
    expect_words("    1.00 s  locked  3 ticks missed  0.01 ms");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_what_it_says);
    RUN_TEST(test_open_findings);
    RUN_TEST(test_that_u_rests);
    RUN_TEST(test_a_standing_correction);
    RUN_TEST(test_a_measurement_that_is_not_good);
    RUN_TEST(test_a_twin_that_runs_free);
    RUN_TEST(test_names_that_are_longer_than_a_line);
    return UNITY_END();
}
