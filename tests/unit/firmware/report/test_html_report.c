/* The report's page: all placeholders are filled, names are escaped, and its size is bounded.
 * tests/replay/test_report.py tests its layout and its scripts in a browser. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/report/html_report.h"

static const char hostile[] = "</script><script>alert(1)</script><!--\"'&{{data}}";

static tl_recorder_signal match[TL_MAX_MATCH];
static tl_recorder_signal adjust[TL_MAX_ADJUST];
static double tolerance[TL_MAX_MATCH];
static tl_html_settings settings;
static tl_run_figures figures;
static tl_lock_tally lock;
static const char *ended;
static tl_html_report *report;
static tl_error error;
static char *page;
static size_t size;

void setUp(void) {
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        match[i] = (tl_recorder_signal){"motor.omega", "rad/s", "plant.omega", TL_REAL};
        tolerance[i] = 0.0;
    }
    for (size_t i = 0; i < TL_MAX_ADJUST; i++) {
        adjust[i] = (tl_recorder_signal){"motor.d", "N.m", NULL, TL_REAL};
    }
    settings = (tl_html_settings){
        .name = "bench",
        .source = "recording.csv",
        .begun = "2026-11-21T10:02:03.456Z",
        .version = "1.2.3",
        .solver = "secant",
        .fallback = "",
        .measurements = "lag",
        .step = TL_SECOND / 100,
        .prediction = 3,
        .match = match,
        .adjust = adjust,
        .match_count = 1,
        .adjust_count = 1,
        .tolerance = tolerance,
    };
    figures = (tl_run_figures){.ledger = {{.name = "motor"}}, .ledger_count = 1};
    lock = (tl_lock_tally){.state = TL_LOCK_FREE};
    ended = "end of recording";
    report = NULL;
    page = NULL;
}

void tearDown(void) {
    tl_html_report_destroy(report);
    free(page);
}

static void create(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, tl_html_report_create(&settings, &report, &error));
}

static void write_page(void) {
    FILE *file = open_memstream(&page, &size);
    tl_html_report_write(report, &figures, &lock, ended, file);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
}

static void add(int64_t step, double value, tl_quality quality) {
    tl_record record = {.step = step, .executions = 3, .evaluations = 1};
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        record.y[i] = value;
        record.measured[i] = value + 0.5;
        record.measured_quality[i] = (uint8_t)quality;
    }
    for (size_t i = 0; i < TL_MAX_ADJUST; i++) {
        record.u[i] = value / 7.0;
        record.nominal[i] = value / 3.0;
    }
    tl_html_report_add_record(report, &record);
}

static size_t count(const char *text) {
    size_t found = 0;
    for (const char *at = page; (at = strstr(at, text)) != NULL; at++) {
        found++;
    }
    return found;
}

static void expect_once(const char *text) {
    TEST_ASSERT_EQUAL_size_t_MESSAGE(1, count(text), text);
}

static void test_all_placeholders_are_filled(void) {
    create();
    add(0, 1.0, TL_GOOD);
    write_page();
    /* the library has "{{", too, but no "{{name}}" */
    for (const char *open = page; (open = strstr(open, "{{")) != NULL; open++) {
        const char *close = open + 2 + strspn(open + 2, "abcdefghijklmnopqrstuvwxyz-");
        TEST_ASSERT_NOT_EQUAL_INT_MESSAGE(0, strncmp(close, "}}", 2), open);
    }
    expect_once("<!doctype html>");
    expect_once("<h1>bench</h1>");
    expect_once("2026-11-21 10:02:03 UTC");
    expect_once("T<sub>P</sub> = 3, lag");
    expect_once("<dd>1.2.3</dd>");
    TEST_ASSERT_EQUAL_size_t(2, count("'sha256-"));
    TEST_ASSERT_GREATER_THAN_size_t(0, count("Permission is hereby granted"));
    TEST_ASSERT_EQUAL_STRING("</html>\n", page + size - 8);
}

static void test_a_released_twin(void) {
    create();
    tl_record record = {.step = 0, .released = {1.25}, .release_age = 300};
    tl_html_report_add_record(report, &record);
    add(1, 2.0, TL_GOOD);
    write_page();
    expect_once("\"released\":[1.25,null]");
}

/* The verdict, and each finding with the time of its onset for the plots. */
static void test_changes(void) {
    const tl_run_detection detection = {.is_ready = true, .learnt = 60, .needed = 60, .watched = 600};
    tl_run_finding finding = {3,  "step",      "correction", "motor.<d>", "", "N.m", 12.5, 0.5,
                              14, (double)NAN, -2,           0.1,         -5, "",    "",   "open"};
    create();
    write_page();
    TEST_ASSERT_EQUAL_size_t(0, count("id=\"changes\""));
    free(page);
    tl_html_report_set_verdict(report, &detection, 1, 1);
    tl_html_report_add_finding(report, &finding, 0.0, 0, NULL);
    finding.number = 4;
    finding.gone = 70;
    finding.cause = "plant";
    finding.state = "gone";
    tl_html_report_add_finding(report, &finding, 0.0, 0, "pump < −10 %");
    write_page();
    expect_once("id=\"changes\"");
    expect_once("<tr class=\"open\" data-time=\"12.5\"><td class=\"n\">3</td><td class=\"text\">motor.&lt;d&gt;: ");
    expect_once("<tr class=\"gone\" data-time=\"12.5\"><td class=\"n\">4</td>");
    expect_once("plant, not one sensor<p>pump &lt; −10 %</td>");
}

/* The lock monitor's judgement, not that of the search. */
static void test_lock(void) {
    create();
    write_page();
    expect_once("In lock</p><p class=\"big\">–</p><p class=\"sub\">not known</p>");
    free(page);
    lock = (tl_lock_tally){.state = TL_LOCK_CORRECTED,
                           .steps = {[TL_LOCK_LOCKED] = 2000, [TL_LOCK_CORRECTED] = 998, [TL_LOCK_LOST] = 2}};
    figures.outcomes[TL_BEST_SO_FAR] = 3000;
    write_page();
    expect_once("99.9 <small>%</small>");
    expect_once(" steps, at the end corrected</p>");
}

static void test_the_curves(void) {
    tolerance[0] = 0.25;
    create();
    add(0, 1.0, TL_GOOD);
    add(1, 2.0, TL_STALE);
    add(2, 3.0, TL_GOOD);
    write_page();
    expect_once("{\"step\":0.010000000,\"first\":0,\"steps\":3,\"width\":1,\"origin\":null,");
    expect_once("\"tolerance\":0.25");
    expect_once("\"simulated\":[1,2,3]");
    expect_once("\"measured\":[1.5,null,3.5]");
    TEST_ASSERT_EQUAL_size_t(0, count("\"released\":"));
    expect_once("\"error\":[-0.5,null,-0.5]");
    expect_once("\"bad\":[[1,1,2]]");
    expect_once("\"applied\":[0.142857143,0.285714286,0.428571429]");
    expect_once("\"executions\":[3,3,3]");
    TEST_ASSERT_EQUAL_size_t(0, count("\"used\""));
    TEST_ASSERT_GREATER_THAN_size_t(0, count("no clock"));
}

static void test_a_compared_output_has_no_tolerance(void) {
    const tl_plan_match matched = {.tolerance = 2.0, .weight = 1.0};
    const tl_plan_match compared = {.tolerance = 1.0, .weight = 0.0};
    TEST_ASSERT_EQUAL_DOUBLE(2.0, tl_html_tolerance(&matched, true));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_html_tolerance(&compared, true));
    TEST_ASSERT_EQUAL_DOUBLE(0.0, tl_html_tolerance(&matched, false));
}

static void test_a_clock(void) {
    settings.clock = true;
    settings.live = true;
    settings.origin = 1000;
    settings.budget = 6 * TL_SECOND / 1000;
    figures.longest = 4 * TL_SECOND / 1000;
    create();
    add(0, 1.0, TL_GOOD);
    write_page();
    expect_once("\"budget\":6,");
    expect_once("\"used\":[0]");
    expect_once("\"origin\":1000");
    expect_once("all steps</p>");
    expect_once("4 ms of 10 ms");
    TEST_ASSERT_EQUAL_size_t(0, count("no clock"));
}

static void test_a_late_step(void) {
    settings.clock = true;
    figures.late = 1;
    create();
    write_page();
    expect_once("not all</p>");
}

static void test_names_are_text(void) {
    char unit[] = "<i>rad/s";
    settings.name = hostile;
    settings.source = hostile;
    settings.begun = hostile;
    settings.version = hostile;
    settings.solver = hostile;
    settings.fallback = hostile;
    ended = hostile;
    figures.ledger[0].name = hostile;
    match[0] = (tl_recorder_signal){hostile, unit, hostile, TL_REAL};
    adjust[0] = (tl_recorder_signal){hostile, unit, NULL, TL_REAL};
    create();
    add(0, 1.0, TL_GOOD);
    const tl_history_event event = {hostile, true, 0, "\"><i>", hostile, hostile};
    tl_html_report_add_event(report, &event);
    write_page();
    TEST_ASSERT_EQUAL_size_t(0, count("<script>alert"));
    TEST_ASSERT_EQUAL_size_t(0, count("<i>"));
    TEST_ASSERT_EQUAL_size_t(0, count("<!--\""));
    TEST_ASSERT_EQUAL_size_t(3, count("</script>")); /* data, library, own script */
    TEST_ASSERT_GREATER_THAN_size_t(10, count("&lt;/script&gt;&lt;script&gt;alert(1)"));
    TEST_ASSERT_EQUAL_size_t(3, count("\"\\u003c/script\\u003e")); /* match, to, adjust */
}

static void test_an_unknown_figure(void) {
    create();
    write_page();
    expect_once("<data data-key=\"match.0.mse\" value=\"\">–</data>");
    expect_once("<data data-key=\"match.0.max\" value=\"\">–</data>");
    expect_once("<data data-key=\"adjust.0.correction_mean\" value=\"\">–</data>");
}

static void test_a_run_without_a_ledger(void) {
    figures.ledger_count = 0;
    create();
    write_page();
    expect_once("not recorded");
}

static void test_a_twin_that_runs_free(void) {
    settings.adjust_count = 0;
    settings.solver = "";
    create();
    write_page();
    expect_once("free-running");
    expect_once("not synchronised");
    expect_once("\"adjust\":[]");
}

static void test_the_newest_events_are_listed(void) {
    create();
    for (int i = 0; i < TL_HTML_EVENTS + 5; i++) {
        char text[32];
        (void)snprintf(text, sizeof text, "event %d.", i);
        const tl_history_event event = {"", true, i, "info", "twin", text};
        tl_html_report_add_event(report, &event);
    }
    write_page();
    expect_once("1000 of 1\342\200\257005");
    TEST_ASSERT_EQUAL_size_t(0, count("event 4."));
    expect_once(">event 5.");
    expect_once(">event 1004.");
    expect_once("data-time=\"0.05\""); /* of tick 5 */
    TEST_ASSERT_TRUE(strstr(page, ">event 5.") < strstr(page, ">event 1004."));
}

static void test_an_event_without_a_tick(void) {
    settings.live = true;
    create();
    tl_html_report_add_event(report,
                             &(tl_history_event){"1970-01-01T00:00:02.500Z", false, -1, "error", "cycle", "late"});
    tl_html_report_add_event(report, &(tl_history_event){"rubbish", false, -1, "error", "cycle", "never"});
    write_page();
    expect_once("<tr class=\"error\" data-time=\"2500\">");
    expect_once("<tr class=\"error\">");
}

/* The largest possible configuration, and a long run. */
static void test_a_page_is_bounded(void) {
    settings.match_count = TL_MAX_MATCH;
    settings.adjust_count = TL_MAX_ADJUST;
    create();
    for (int64_t i = 0; i < 100000; i++) {
        add(i, 1e5 * sin((double)i * 0.7), TL_GOOD);
    }
    add(100000, 123456.75, TL_GOOD); /* an extreme at the end */
    write_page();
    TEST_ASSERT_LESS_THAN_size_t(8000000, size);
    expect_once("every <data");
    TEST_ASSERT_EQUAL_size_t(TL_MAX_MATCH, count("123456.75]"));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_placeholders_are_filled);
    RUN_TEST(test_lock);
    RUN_TEST(test_the_curves);
    RUN_TEST(test_a_released_twin);
    RUN_TEST(test_changes);
    RUN_TEST(test_a_compared_output_has_no_tolerance);
    RUN_TEST(test_a_clock);
    RUN_TEST(test_a_late_step);
    RUN_TEST(test_names_are_text);
    RUN_TEST(test_an_unknown_figure);
    RUN_TEST(test_a_run_without_a_ledger);
    RUN_TEST(test_a_twin_that_runs_free);
    RUN_TEST(test_the_newest_events_are_listed);
    RUN_TEST(test_an_event_without_a_tick);
    RUN_TEST(test_a_page_is_bounded);
    return UNITY_END();
}
