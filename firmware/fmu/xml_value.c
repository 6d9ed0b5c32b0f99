/* Attribute texts to values: the form is checked by hand, then strtod() reads the number. */
#include "firmware/fmu/xml_value.h"

#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

typedef struct span {
    const char *start;
    size_t length;
} span;

static bool is_space(char c) {
    return c == ' ' || c == '\t' || c == '\n' || c == '\r';
}

static bool is_digit(char c) {
    return c >= '0' && c <= '9';
}

static span trimmed(const char *text) {
    while (is_space(*text)) {
        text++;
    }
    size_t length = strlen(text);
    while (length > 0 && is_space(text[length - 1])) {
        length--;
    }
    return (span){text, length};
}

static bool equals(span text, const char *word) {
    return strlen(word) == text.length && memcmp(text.start, word, text.length) == 0;
}

static size_t skip_sign(span text, size_t at) {
    return at < text.length && (text.start[at] == '+' || text.start[at] == '-') ? at + 1 : at;
}

static size_t skip_digits(span text, size_t at) {
    while (at < text.length && is_digit(text.start[at])) {
        at++;
    }
    return at;
}

/* [sign] digits with at most one point among or beside them [e [sign] digits] */
static bool is_decimal(span text) {
    size_t first = skip_sign(text, 0);
    size_t at = skip_digits(text, first);
    size_t digits = at - first;
    if (at < text.length && text.start[at] == '.') {
        size_t fraction = at + 1;
        at = skip_digits(text, fraction);
        digits += at - fraction;
    }
    if (digits == 0) {
        return false;
    }
    if (at < text.length && (text.start[at] == 'e' || text.start[at] == 'E')) {
        size_t exponent = skip_sign(text, at + 1);
        at = skip_digits(text, exponent);
        if (at == exponent) {
            return false;
        }
    }
    return at == text.length;
}

bool tl_xml_double(const char *text, double *value) {
    static const struct {
        const char *word;
        double value;
    } words[] = {
        {"INF", (double)INFINITY}, {"+INF", (double)INFINITY}, {"-INF", -(double)INFINITY}, {"NaN", (double)NAN}};
    span number = trimmed(text);
    for (size_t i = 0; i < sizeof words / sizeof words[0]; i++) {
        if (equals(number, words[i].word)) {
            *value = words[i].value;
            return true;
        }
    }
    if (!is_decimal(number)) {
        return false;
    }
    char *end = NULL;
    double result = strtod(number.start, &end);
    if (end != number.start + number.length) {
        return false; /* this thread has a locale without a decimal point: see c_locale.h */
    }
    *value = result;
    return true;
}

/* [sign] digits, in lowest..highest. */
static bool read_integer(const char *text, int64_t lowest, int64_t highest, int64_t *value) {
    span number = trimmed(text);
    size_t first = skip_sign(number, 0);
    if (first == number.length || skip_digits(number, first) != number.length) {
        return false;
    }
    bool negative = number.start[0] == '-';
    int64_t result = 0;
    for (size_t i = first; i < number.length; i++) {
        int digit = number.start[i] - '0';
        result = result * 10 + (negative ? -digit : digit);
        if (result < lowest || result > highest) {
            return false;
        }
    }
    *value = result;
    return true;
}

bool tl_xml_int(const char *text, int32_t *value) {
    int64_t result;
    if (!read_integer(text, INT32_MIN, INT32_MAX, &result)) {
        return false;
    }
    *value = (int32_t)result;
    return true;
}

bool tl_xml_unsigned(const char *text, uint32_t *value) {
    int64_t result;
    if (!read_integer(text, 0, UINT32_MAX, &result)) {
        return false;
    }
    *value = (uint32_t)result;
    return true;
}

bool tl_xml_boolean(const char *text, bool *value) {
    span word = trimmed(text);
    if (equals(word, "true") || equals(word, "1")) {
        *value = true;
        return true;
    }
    if (equals(word, "false") || equals(word, "0")) {
        *value = false;
        return true;
    }
    return false;
}
