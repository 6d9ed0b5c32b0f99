/* Times of CSV rows. The expected times are those of `date -u -d DATE +%s`. */
#include <string.h>

#include <unity.h>

#include "board/csv/csv_time.h"

static tl_csv_clock written;

void setUp(void) {
    memset(&written, 0, sizeof written);
}

void tearDown(void) {}

static void expect_time(const char *text, tl_time expected) {
    tl_time time = 0;
    TEST_ASSERT_TRUE_MESSAGE(tl_csv_time_read(&written, text, &time), text);
    TEST_ASSERT_EQUAL_INT64_MESSAGE(expected, time, text);
}

/* As the first time of a file. */
static void expect_first(const char *text, tl_time expected) {
    setUp();
    expect_time(text, expected);
}

static void expect_none(const char *text) {
    tl_time time = 0;
    TEST_ASSERT_FALSE_MESSAGE(tl_csv_time_read(&written, text, &time), text);
}

static void test_seconds(void) {
    expect_first("0", 0);
    expect_first("-0.25", -TL_SECOND / 4);
    expect_first("4.6e9", 4600000000 * TL_SECOND);
    expect_first("1796021074.5", 1796021074 * TL_SECOND + TL_SECOND / 2);
}

static void test_unix_times_in_other_units(void) {
    expect_first("1796021074567", 1796021074 * TL_SECOND + 567000000);
    TEST_ASSERT_EQUAL_INT64(1000, written.per_second);
    TEST_ASSERT_TRUE(written.is_guessed);
    expect_time("1796021074568.25", 1796021074 * TL_SECOND + 568250000);
    expect_first("1796021074567890", 1796021074 * TL_SECOND + 567890000);
    expect_first("1796021074000000000", 1796021074 * TL_SECOND);
    TEST_ASSERT_EQUAL_INT64(1000000000, written.per_second);
}

/* Such a number may be the time since a start in any unit. */
static void test_numbers_that_are_no_unix_time(void) {
    static const char *const TEXTS[] = {"4.7e9", "-1e10", "1.4e12", "2.3e12", "1.4e15", "2.3e15", "1.4e18", "2.3e18"};
    for (size_t i = 0; i < sizeof TEXTS / sizeof TEXTS[0]; i++) {
        setUp();
        expect_none(TEXTS[i]);
        TEST_ASSERT_EQUAL_INT(TL_CSV_TIME_UNKNOWN, written.form);
    }
}

static void test_dates(void) {
    static const char *const TEXTS[] = {
        "2026-11-30T06:44:34Z",   "2026-11-30 06:44:34 UTC",   "2026-11-30T07:44:34+01:00",
        "2026-11-30T07:44:34+01", "2026-11-30T01:14:34 -0530", "2026/11/30 06:44:34.000z",
        "30.11.2026 06:44:34Z",   "2026-11-30T06:44:34",       "30.11.2026 06:44:34",
    };
    for (size_t i = 0; i < sizeof TEXTS / sizeof TEXTS[0]; i++) {
        expect_first(TEXTS[i], 1796021074 * TL_SECOND);
        TEST_ASSERT_EQUAL_INT(i < 7 ? TL_CSV_TIME_DATE : TL_CSV_TIME_ZONELESS, written.form);
    }
    expect_first("2026-11-30T06:44Z", 1796021040 * TL_SECOND);
    expect_first("2026-11-30T06:44:34,123456789987Z", 1796021074 * TL_SECOND + 123456789);
    expect_first("2000-02-29T00:00:00Z", 951782400 * TL_SECOND);
    expect_first("2024-12-31T23:59:60Z", 1735689600 * TL_SECOND);
    expect_first("1970-01-01T00:00:00Z", 0);
    expect_first("1969-12-31T23:59:59.5Z", -TL_SECOND / 2);
    expect_first("1900-03-01T00:00:00Z", -2203891200 * TL_SECOND);
}

static void test_dates_that_are_none(void) {
    static const char *const TEXTS[] = {
        "",
        "2026-11-30",
        "2026-11-31T00:00:00Z",
        "2026-02-29T00:00:00Z",
        "1900-02-29T00:00:00Z",
        "2026-13-01T00:00:00Z",
        "2026-00-01T00:00:00Z",
        "2026-01-00T00:00:00Z",
        "0000-01-01T00:00:00Z",
        "2026-11-30T24:00:00Z",
        "2026-11-30T06:60:00Z",
        "2026-11-30T06:44:61Z",
        "2026-11-30T06:44:34.Z",
        "2026-11-30T06:44.5Z",
        "2026-11-30T06:44:34+1",
        "2026-11-30T06:44:34+24:00",
        "2026-11-30T06:44:34 CET",
        "2026-11-30T6:44:34Z",
        "11/30/2026 06:44:34",
        "2200-01-01T00:00:00Z",
        "06:44:34",
    };
    for (size_t i = 0; i < sizeof TEXTS / sizeof TEXTS[0]; i++) {
        setUp();
        expect_none(TEXTS[i]);
        TEST_ASSERT_EQUAL_INT(TL_CSV_TIME_UNKNOWN, written.form);
    }
}

static void test_all_times_have_the_form_of_the_first(void) {
    expect_time("5", 5 * TL_SECOND);
    expect_none("1796021074567");
    expect_none("2026-11-30T06:44:34Z");
    expect_first("2026-11-30T06:44:34Z", 1796021074 * TL_SECOND);
    expect_none("2026-11-30T06:44:35");
    expect_none("5");
    expect_time("2026-11-30T07:44:35+01:00", 1796021075 * TL_SECOND);
}

static void test_units(void) {
    static const struct {
        const char *text;
        int64_t per_second;
    } UNITS[] = {{"s", 1},        {"[s]", 1},           {"seconds", 1},      {"(ms)", 1000},
                 {"us", 1000000}, {"\u00b5s", 1000000}, {"[ns]", 1000000000}};
    for (size_t i = 0; i < sizeof UNITS / sizeof UNITS[0]; i++) {
        setUp();
        TEST_ASSERT_TRUE(tl_csv_time_read_unit(&written, UNITS[i].text));
        TEST_ASSERT_EQUAL_INT64(UNITS[i].per_second, written.per_second);
    }
    static const char *const OTHERS[] = {"", "[]", "h", "min", "[s", "rpm", "sss", "5"};
    for (size_t i = 0; i < sizeof OTHERS / sizeof OTHERS[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(tl_csv_time_read_unit(&written, OTHERS[i]), OTHERS[i]);
    }
    setUp();
    TEST_ASSERT_TRUE(tl_csv_time_read_unit(&written, "ms"));
    expect_time("1500", TL_SECOND * 3 / 2);
    expect_time("-1", -TL_SECOND / 1000);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_seconds);
    RUN_TEST(test_unix_times_in_other_units);
    RUN_TEST(test_numbers_that_are_no_unix_time);
    RUN_TEST(test_dates);
    RUN_TEST(test_dates_that_are_none);
    RUN_TEST(test_all_times_have_the_form_of_the_first);
    RUN_TEST(test_units);
    return UNITY_END();
}
