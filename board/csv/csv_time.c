/* Times of CSV rows: see csv_time.h. */
#include "board/csv/csv_time.h"

#include <math.h>
#include <string.h>

#include "board/csv/csv_number.h"

#define LAST_SECOND INT64_C(4600000000)

/* ---- numbers ---- */

/* Unix times of the years 2015 to 2039. */
static const double EPOCH_BEGIN = 1420070400;
static const double EPOCH_END = 2208988800;

static int64_t find_unit(double first) {
    for (int64_t unit = 1000; unit <= 1000000000; unit *= 1000) {
        if (first >= EPOCH_BEGIN * (double)unit && first < EPOCH_END * (double)unit) {
            return unit;
        }
    }
    return 1;
}

static bool read_number(tl_csv_clock *clock, double number, tl_time *time) {
    const int64_t unit = clock->form == TL_CSV_TIME_NUMBER ? clock->per_second : find_unit(number);
    if (fabs(number) > (double)LAST_SECOND * (double)unit) {
        return false;
    }
    if (unit == 1) {
        *time = tl_time_of_seconds(number);
    } else { /* whole seconds apart, because the quotient of a Unix time is exact to some 200 ns only */
        const double whole = floor(number / (double)unit);
        const double rest = number - whole * (double)unit;
        *time = (tl_time)whole * TL_SECOND + tl_time_of_seconds(rest / (double)unit);
    }
    if (clock->form == TL_CSV_TIME_UNKNOWN) {
        *clock = (tl_csv_clock){.form = TL_CSV_TIME_NUMBER, .per_second = unit, .is_guessed = unit != 1};
    }
    return true;
}

bool tl_csv_time_read_unit(tl_csv_clock *clock, const char *text) {
    static const struct {
        const char *name;
        int64_t per_second;
    } units[] = {{"s", 1},        {"sec", 1},           {"seconds", 1},       {"ms", 1000},
                 {"us", 1000000}, {"\u00b5s", 1000000}, {"\u03bcs", 1000000}, {"ns", 1000000000}};
    const size_t length = strlen(text);
    const bool has_brackets = length > 2 && strchr("[(", text[0]) != NULL && strchr("])", text[length - 1]) != NULL;
    const char *begin = has_brackets ? text + 1 : text;
    const size_t size = has_brackets ? length - 2 : length;
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++) {
        if (strlen(units[i].name) == size && memcmp(begin, units[i].name, size) == 0) {
            *clock = (tl_csv_clock){.form = TL_CSV_TIME_NUMBER, .per_second = units[i].per_second};
            return true;
        }
    }
    return false;
}

/* ---- dates ---- */

/* Takes exactly `count` digits. */
static bool take_digits(const char **at, int count, int *value) {
    *value = 0;
    for (int i = 0; i < count; i++, (*at)++) {
        if (**at < '0' || **at > '9') {
            return false;
        }
        *value = 10 * *value + (**at - '0');
    }
    return true;
}

/* Takes one of the characters. */
static bool take_any(const char **at, const char *set) {
    const bool found = **at != '\0' && strchr(set, **at) != NULL;
    *at += found ? 1 : 0;
    return found;
}

/* Day number of the Gregorian calendar, from 1970-01-01. */
static int64_t day_number(int year, int month, int day) {
    const int64_t march = (month + 9) % 12; /* months since March */
    const int64_t years = year - (month < 3 ? 1 : 0);
    const int64_t leap_days = years / 4 - years / 100 + years / 400;
    return 365 * years + leap_days + (153 * march + 2) / 5 + day - 1 - 719468;
}

static bool take_day(const char **at, int64_t *days) {
    int year = 0;
    int month = 0;
    int day = 0;
    const char *text = *at;
    bool right = take_digits(&text, 4, &year) && take_any(&text, "-/") && take_digits(&text, 2, &month) &&
                 take_any(&text, "-/") && take_digits(&text, 2, &day);
    if (!right) {
        text = *at;
        right = take_digits(&text, 2, &day) && take_any(&text, ".") && take_digits(&text, 2, &month) &&
                take_any(&text, ".") && take_digits(&text, 4, &year);
    }
    if (!right || year == 0 || month < 1 || month > 12 || day < 1) {
        return false;
    }
    *at = text;
    *days = day_number(year, month, day);
    return *days < day_number(year + month / 12, month % 12 + 1, 1);
}

/* Takes hours and minutes, perhaps with seconds and a fraction. */
static bool take_clock(const char **at, int64_t *seconds, tl_time *fraction) {
    int hours = 0;
    int minutes = 0;
    int rest = 0;
    if (!take_digits(at, 2, &hours) || !take_any(at, ":") || !take_digits(at, 2, &minutes)) {
        return false;
    }
    const bool has_seconds = take_any(at, ":");
    if (has_seconds && !take_digits(at, 2, &rest)) {
        return false;
    }
    if (has_seconds && take_any(at, ".,")) {
        const char *begin = *at;
        for (tl_time digit = TL_SECOND / 10; **at >= '0' && **at <= '9'; digit /= 10, (*at)++) {
            *fraction += digit * (**at - '0');
        }
        if (*at == begin) {
            return false;
        }
    }
    *seconds = INT64_C(60) * (60 * hours + minutes) + rest;
    return hours < 24 && minutes < 60 && rest <= 60; /* 60: a leap second */
}

/* Takes Z, UTC, or a distance from UTC, as +01:00, +0100 or +01; true if there is none. */
static bool take_zone(const char **at, bool *is_named, int64_t *ahead) {
    int hours = 0;
    int minutes = 0;
    (void)take_any(at, " ");
    const bool is_behind = **at == '-';
    *is_named = true;
    if (take_any(at, "+-")) {
        bool right = take_digits(at, 2, &hours);
        if (right && (take_any(at, ":") || **at != '\0')) {
            right = take_digits(at, 2, &minutes);
        }
        *ahead = INT64_C(60) * (60 * hours + minutes) * (is_behind ? -1 : 1);
        return right && hours < 24 && minutes < 60;
    }
    if (strncmp(*at, "UTC", 3) == 0) {
        *at += 3;
    } else {
        *is_named = take_any(at, "Zz");
    }
    return true;
}

static bool read_date(tl_csv_clock *clock, const char *text, tl_time *time) {
    int64_t days = 0;
    int64_t seconds = 0;
    int64_t ahead = 0;
    tl_time fraction = 0;
    bool is_named = false;
    if (!take_day(&text, &days) || !take_any(&text, "T ") || !take_clock(&text, &seconds, &fraction) ||
        !take_zone(&text, &is_named, &ahead) || *text != '\0') {
        return false;
    }
    const tl_csv_time_form form = is_named ? TL_CSV_TIME_DATE : TL_CSV_TIME_ZONELESS;
    const int64_t whole = days * 86400 + seconds - ahead;
    if ((clock->form != TL_CSV_TIME_UNKNOWN && clock->form != form) || whole < -LAST_SECOND || whole >= LAST_SECOND) {
        return false;
    }
    clock->form = form;
    *time = whole * TL_SECOND + fraction;
    return true;
}

bool tl_csv_time_read(tl_csv_clock *clock, const char *text, tl_time *time) {
    double number = 0;
    if (!tl_csv_number_read(text, &number)) {
        return read_date(clock, text, time);
    }
    return (clock->form == TL_CSV_TIME_UNKNOWN || clock->form == TL_CSV_TIME_NUMBER) &&
           read_number(clock, number, time);
}
