/* Queries: see http_query.h. */
#include "firmware/serve/http_query.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/json_text.h"

enum { LONGEST_NAME = 16, LONGEST_VALUE = TL_CONTROL_WHY, LONGEST_PROBATION = 604800, LONGEST_SHADOW = 3600 };

static const uint64_t MOST_VERSION = UINT64_C(1) << 53;
static const double MOST_PERCENT = 100;

/* One "name=value", decoded. */
typedef struct query_pair {
    char name[LONGEST_NAME];
    char value[LONGEST_VALUE];
} query_pair;

/* ---- values ---- */

static bool set_flag(const char *value, uint32_t flag, tl_control_request *control) {
    if (strcmp(value, "1") == 0) {
        control->flags |= flag;
    }
    return strcmp(value, "1") == 0 || strcmp(value, "0") == 0;
}

static bool set_check(const char *value, tl_control_request *control) {
    return set_flag(value, TL_CONTROL_ONLY_CHECK, control);
}

static bool set_restart(const char *value, tl_control_request *control) {
    return set_flag(value, TL_CONTROL_MAY_RESTART, control);
}

static bool set_confirm(const char *value, tl_control_request *control) {
    return set_flag(value, TL_CONTROL_BY_PERSON, control);
}

static bool set_wait(const char *value, tl_control_request *control) {
    return set_flag(value, TL_CONTROL_WAIT, control);
}

static bool set_accept(const char *value, tl_control_request *control) {
    return set_flag(value, TL_CONTROL_EVEN_WORSE, control);
}

static bool read_number(const char *value, uint64_t most, uint64_t *number) {
    size_t digits = strspn(value, "0123456789");
    errno = 0;
    *number = strtoull(value, NULL, 10);
    return digits > 0 && value[digits] == '\0' && errno == 0 && *number >= 1 && *number <= most;
}

static bool set_probation(const char *value, tl_control_request *control) {
    uint64_t number = 0;
    bool is_good = read_number(value, LONGEST_PROBATION, &number);
    control->probation_s = (uint32_t)number;
    return is_good;
}

static bool set_shadow(const char *value, tl_control_request *control) {
    uint64_t number = 0;
    bool is_good = read_number(value, LONGEST_SHADOW, &number);
    control->shadow_s = (uint32_t)number;
    return is_good;
}

static bool set_version(const char *value, tl_control_request *control) {
    return read_number(value, MOST_VERSION, &control->version);
}

static bool set_lock(const char *value, tl_control_request *control) {
    char *end = NULL;
    control->require_lock = strtod(value, &end);
    bool is_plain = value[0] != '\0' && value[strspn(value, "0123456789.")] == '\0' && *end == '\0';
    return is_plain && control->require_lock <= MOST_PERCENT;
}

static bool set_why(const char *value, tl_control_request *control) {
    (void)snprintf(control->why, sizeof control->why, "%s", value);
    return tl_text_is_plain(value);
}

static const struct {
    const char *name;
    bool (*set)(const char *value, tl_control_request *control);
    const char *expected;
} KEYS[] = {
    {"check", set_check, "0 or 1"},
    {"restart", set_restart, "0 or 1"},
    {"confirm", set_confirm, "0 or 1"},
    {"wait", set_wait, "0 or 1"},
    {"accept_worse", set_accept, "0 or 1"},
    {"probation", set_probation, "whole seconds from 1 to 604800"},
    {"shadow", set_shadow, "whole seconds from 1 to 3600"},
    {"require_lock", set_lock, "a percentage from 0 to 100"},
    {"why", set_why, "plain text of at most 255 bytes"},
    {"version", set_version, "a whole number from 1 on"},
};

/* ---- decoding ---- */

static int digit_of(char letter) {
    const char *digits = "0123456789abcdef";
    const char *found = letter == '\0' ? NULL : strchr(digits, tolower((unsigned char)letter));
    return found == NULL ? -1 : (int)(found - digits);
}

/* "%C3%A9+x" up to `end`. False: it is not well formed, holds a NUL, or does not fit. */
static bool decode(const char *from, const char *end, char *to, size_t room) {
    size_t used = 0;
    while (from < end && used + 1 < room) {
        char letter = *from == '+' ? ' ' : *from;
        if (letter == '%') {
            int high = end - from > 2 ? digit_of(from[1]) : -1;
            int low = high < 0 ? -1 : digit_of(from[2]);
            if (low < 0 || (high == 0 && low == 0)) {
                return false;
            }
            letter = (char)(high * 16 + low);
            from += 2;
        }
        to[used] = letter;
        used++;
        from++;
    }
    to[used] = '\0';
    return from == end;
}

static bool read_pair(const char *from, const char *end, query_pair *read) {
    const char *middle = memchr(from, '=', (size_t)(end - from));
    return middle != NULL && decode(from, middle, read->name, sizeof read->name) &&
           decode(middle + 1, end, read->value, sizeof read->value);
}

/* ---- the whole ---- */

/* Whether a word is one of a list with blanks between them. */
static bool is_among(const char *word, const char *list) {
    size_t length = strlen(word);
    for (const char *found = strstr(list, word); found != NULL && length > 0; found = strstr(found + 1, word)) {
        bool begins = found == list || found[-1] == ' ';
        if (begins && (found[length] == ' ' || found[length] == '\0')) {
            return true;
        }
    }
    return false;
}

static bool take_pair(const query_pair *read, const char *allowed, tl_control_request *control, char *fault) {
    for (size_t i = 0; i < sizeof KEYS / sizeof KEYS[0] && is_among(read->name, allowed); i++) {
        if (strcmp(read->name, KEYS[i].name) != 0) {
            continue;
        }
        bool is_set = KEYS[i].set(read->value, control);
        if (!is_set) {
            (void)snprintf(fault, TL_HTTP_QUERY_FAULT, "%s: expected %s", KEYS[i].name, KEYS[i].expected);
        }
        return is_set;
    }
    (void)snprintf(fault, TL_HTTP_QUERY_FAULT, "the query has a key that is not known here: expected one of %s",
                   allowed[0] != '\0' ? allowed : "none");
    return false;
}

bool tl_http_query_read(const char *query, const char *allowed, tl_control_request *control,
                        char fault[TL_HTTP_QUERY_FAULT]) {
    query_pair read;
    for (const char *from = query; *from != '\0';) {
        const char *end = from + strcspn(from, "&");
        if (!read_pair(from, end, &read)) {
            (void)snprintf(fault, TL_HTTP_QUERY_FAULT, "the query is no list of name=value, or a value is too long");
            return false;
        }
        if (!take_pair(&read, allowed, control, fault)) {
            return false;
        }
        from = *end == '&' ? end + 1 : end;
    }
    return true;
}
