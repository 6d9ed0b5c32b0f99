/* UTC stamps. Parsed by hand: strptime() depends on the locale and accepts too much. The calendar is our own, because
 * that of a 32-bit time_t ends in 2038. */
#include "firmware/base/utc.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

enum { MS = 1000, DAY = 86400 };

static const int64_t EARLIEST = INT64_C(-62167219200000); /* 0000-01-01T00:00:00.000Z */
static const int64_t LATEST = INT64_C(253402300799999);   /* 9999-12-31T23:59:59.999Z */

typedef struct stamp {
    int year;
    int month; /* 1 … 12 */
    int day;   /* 1 … 31 */
    int hour;
    int minute;
    int second;
    int millisecond;
} stamp;

/* ---- Calendar ------------------------------------------------------------------------------------------- */

static bool is_leap(int year) {
    return (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
}

/* Days from 0000-01-01 to the first of a year; the year 0 is a leap year. */
static int64_t days_before_year(int year) {
    return INT64_C(365) * year + (year + 3) / 4 - (year + 99) / 100 + (year + 399) / 400;
}

/* Days of a year before a month, 1 … 13. */
static int days_before_month(int year, int month) {
    assert(month >= 1 && month <= 13);
    static const int before[] = {0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334, 365};
    return before[month - 1] + (month > 2 && is_leap(year) ? 1 : 0);
}

/* The date of a day from 0000-01-01 on. */
static void set_date(stamp *utc, int64_t day) {
    utc->year = (int)(day / 366); /* not later than it is */
    while (days_before_year(utc->year + 1) <= day) {
        utc->year++;
    }
    int within = (int)(day - days_before_year(utc->year));
    utc->month = 1;
    while (days_before_month(utc->year, utc->month + 1) <= within) {
        utc->month++;
    }
    utc->day = within - days_before_month(utc->year, utc->month) + 1;
}

/* ---- Texts ---------------------------------------------------------------------------------------------- */

int64_t tl_utc_now(void) {
    struct timespec now = {.tv_sec = 0}; /* what it stays where time_t has 4 bytes and 2038 is over */
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return (int64_t)now.tv_sec * MS + now.tv_nsec / 1000000;
}

void tl_utc_text(int64_t milliseconds, char text[TL_UTC_TEXT]) {
    int64_t within = milliseconds < EARLIEST ? EARLIEST : milliseconds > LATEST ? LATEST : milliseconds;
    int64_t seconds = (within - EARLIEST) / MS;
    int second = (int)(seconds % DAY);
    stamp utc;
    set_date(&utc, seconds / DAY);
    char wide[96]; /* what the compiler thinks the fields could need */
    (void)snprintf(wide, sizeof wide, "%04d-%02d-%02dT%02d:%02d:%02d.%03dZ", utc.year, utc.month, utc.day,
                   second / 3600, second / 60 % 60, second % 60, (int)((within - EARLIEST) % MS));
    memcpy(text, wide, TL_UTC_TEXT - 1);
    text[TL_UTC_TEXT - 1] = '\0';
}

/* Reads exactly `digits` digits into *value, at most `limit`. */
static bool take_number(const char **text, int digits, int limit, int *value) {
    *value = 0;
    for (int i = 0; i < digits; i++, (*text)++) {
        if (**text < '0' || **text > '9') {
            return false;
        }
        *value = *value * 10 + (**text - '0');
    }
    return *value <= limit;
}

static bool take(const char **text, char expected) {
    if (**text != expected) {
        return false;
    }
    (*text)++;
    return true;
}

/* ".4", ".45" or ".456" where there is one. */
static bool take_fraction(const char **text, int *milliseconds) {
    *milliseconds = 0;
    if (!take(text, '.')) {
        return true;
    }
    int weight = 100;
    const char *first = *text;
    for (; **text >= '0' && **text <= '9'; (*text)++, weight /= 10) {
        *milliseconds += (**text - '0') * weight;
    }
    return *text > first && *text - first <= 9;
}

static bool take_date(const char **text, stamp *utc) {
    if (!take_number(text, 4, 9999, &utc->year) || !take(text, '-') || !take_number(text, 2, 12, &utc->month) ||
        utc->month < 1 || !take(text, '-') || !take_number(text, 2, 31, &utc->day) || utc->day < 1) {
        return false;
    }
    return utc->day <= days_before_month(utc->year, utc->month + 1) - days_before_month(utc->year, utc->month);
}

static bool take_clock(const char **text, stamp *utc) {
    if (!take_number(text, 2, 23, &utc->hour) || !take(text, ':') || !take_number(text, 2, 59, &utc->minute)) {
        return false;
    }
    return !take(text, ':') || (take_number(text, 2, 59, &utc->second) && take_fraction(text, &utc->millisecond));
}

bool tl_utc_parse(const char *text, int64_t *milliseconds) {
    stamp utc = {.year = 0};
    if (!take_date(&text, &utc)) {
        return false;
    }
    if ((take(&text, 'T') || take(&text, ' ')) && !take_clock(&text, &utc)) {
        return false;
    }
    (void)take(&text, 'Z');
    if (*text != '\0') {
        return false;
    }
    int64_t day = days_before_year(utc.year) + days_before_month(utc.year, utc.month) + utc.day - 1;
    int second = (utc.hour * 60 + utc.minute) * 60 + utc.second;
    *milliseconds = EARLIEST + (day * DAY + second) * MS + utc.millisecond;
    return true;
}
