/* See message.h. */
#include "tests/support/message.h"

#include <ctype.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

static bool is_inside_word(char c) {
    return isalnum((unsigned char)c) || c == '_';
}

/* A dot inside a number or a path belongs to it; one at the end of a sentence does not. */
static bool continues(const char *end) {
    return is_inside_word(end[0]) || (end[0] == '.' && is_inside_word(end[1]));
}

static bool follows(const char *message, const char *at) {
    return at > message &&
           (is_inside_word(at[-1]) || (at[-1] == '.' && at - message > 1 && is_inside_word(at[-2])) ||
            (at[-1] == '-' && isdigit((unsigned char)at[0]) && (at - message < 2 || !is_inside_word(at[-2]))));
}

static bool has_part(const char *message, const char *part, size_t length) {
    for (const char *at = message; (at = strchr(at, part[0])) != NULL; at++) {
        bool begins = !is_inside_word(part[0]) || !follows(message, at);
        if (begins && strncmp(at, part, length) == 0 &&
            (!is_inside_word(part[length - 1]) || !continues(at + length))) {
            return true;
        }
    }
    return false;
}

bool tl_test_has_parts(const char *message, const char *parts) {
    if (message == NULL || message[0] == '\0' || parts[0] == '\0') {
        return false;
    }
    while (parts[0] != '\0') {
        size_t length = strcspn(parts, "|");
        if (length == 0 || !has_part(message, parts, length)) {
            return false;
        }
        parts += length + (parts[length] == '|' ? 1 : 0);
    }
    return true;
}

bool tl_test_has_line(const char *text, const char *parts) {
    static char line[4096];
    bool found = false;
    for (const char *at = text; *at != '\0' && !found; at += strcspn(at, "\n"), at += *at == '\n' ? 1 : 0) {
        (void)snprintf(line, sizeof line, "%.*s", (int)strcspn(at, "\n"), at);
        found = tl_test_has_parts(line, parts);
    }
    return found;
}

void tl_test_expect_parts(const char *parts, const char *message, int line) {
    static char text[2048];
    if (!tl_test_has_parts(message, parts)) {
        (void)snprintf(text, sizeof text, "\"%s\" lacks a part of \"%s\"", message == NULL ? "" : message, parts);
        UNITY_TEST_FAIL((UNITY_LINE_TYPE)line, text);
    }
}

void tl_test_expect_seconds(int whole, const char *text) {
    bool found = false;
    for (int tenth = 0; tenth < 10; tenth++) {
        char time[16];
        (void)snprintf(time, sizeof time, "%d.%d s", whole, tenth);
        found = found || tl_test_has_parts(text, time);
    }
    TEST_ASSERT_TRUE_MESSAGE(found, text);
}
