/* UTC stamps. Parsed by hand: strptime() depends on the locale and accepts too much. */
#include "firmware/utc.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

enum { MS = 1000 };

static const int64_t EARLIEST = INT64_C(-62167219200000); /* 0000-01-01T00:00:00.000Z */
static const int64_t LATEST = INT64_C(253402300799999);   /* 9999-12-31T23:59:59.999Z */

int64_t tl_utc_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_REALTIME, &now);
    return (int64_t)now.tv_sec * MS + now.tv_nsec / 1000000;
}

void tl_utc_text(int64_t milliseconds, char text[TL_UTC_TEXT]) {
    int64_t within = milliseconds < EARLIEST ? EARLIEST : milliseconds > LATEST ? LATEST : milliseconds;
    int64_t rest = ((within % MS) + MS) % MS;
    time_t seconds = (time_t)((within - rest) / MS);
    struct tm utc;
    (void)gmtime_r(&seconds, &utc);
    char wide[96]; /* what the compiler thinks the fields could need */
    (void)snprintf(wide, sizeof wide, "%04d-%02d-%02dT%02d:%02d:%02d.%03dZ", utc.tm_year + 1900, utc.tm_mon + 1,
                   utc.tm_mday, utc.tm_hour, utc.tm_min, utc.tm_sec, (int)rest);
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

static bool take_date(const char **text, struct tm *utc) {
    static const int days[] = {31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31};
    int year = 0;
    int month = 0;
    if (!take_number(text, 4, 9999, &year) || !take(text, '-') || !take_number(text, 2, 12, &month) || month < 1 ||
        !take(text, '-') || !take_number(text, 2, days[month - 1], &utc->tm_mday) || utc->tm_mday < 1) {
        return false;
    }
    bool leap = (year % 4 == 0 && year % 100 != 0) || year % 400 == 0;
    utc->tm_year = year - 1900;
    utc->tm_mon = month - 1;
    return month != 2 || leap || utc->tm_mday < 29;
}

static bool take_clock(const char **text, struct tm *utc, int *milliseconds) {
    if (!take_number(text, 2, 23, &utc->tm_hour) || !take(text, ':') || !take_number(text, 2, 59, &utc->tm_min)) {
        return false;
    }
    return !take(text, ':') || (take_number(text, 2, 59, &utc->tm_sec) && take_fraction(text, milliseconds));
}

bool tl_utc_parse(const char *text, int64_t *milliseconds) {
    struct tm utc;
    memset(&utc, 0, sizeof utc);
    int fraction = 0;
    if (!take_date(&text, &utc)) {
        return false;
    }
    if ((take(&text, 'T') || take(&text, ' ')) && !take_clock(&text, &utc, &fraction)) {
        return false;
    }
    (void)take(&text, 'Z');
    if (*text != '\0') {
        return false;
    }
    *milliseconds = (int64_t)timegm(&utc) * MS + fraction;
    return true;
}
