/* Text on an HTML page: see html_text.h. */
#include "firmware/report/html_text.h"

#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "firmware/base/clean_text.h"
#include "firmware/base/sha256.h"
#include "master/base/utf8.h"

enum { SHOWN = 16, LONGEST = 4 };

/* The next character as it may be shown (clean_text.h), white space as it is. Returns the text behind it. */
static const char *take(const char *text, char shown[SHOWN]) {
    uint32_t code = 0;
    size_t length = tl_utf8_read(text, strnlen(text, LONGEST), &code);
    length = length == 0 ? 1 : length;
    if (*text == '\n' || *text == '\r') {
        (void)snprintf(shown, SHOWN, "%c", *text);
    } else {
        (void)tl_clean_text(text, length, shown, SHOWN);
    }
    return text + length;
}

void tl_html_put_text(FILE *file, const char *text) {
    static const char marks[] = "&<>\"'";
    static const char *const entities[] = {"&amp;", "&lt;", "&gt;", "&quot;", "&#39;"};
    while (*text != '\0') {
        char shown[SHOWN];
        text = take(text, shown);
        const char *mark = strchr(marks, shown[0]);
        if (mark != NULL) {
            (void)fputs(entities[mark - marks], file);
        } else {
            (void)fputs((unsigned char)shown[0] < ' ' ? " " : shown, file);
        }
    }
}

static void put_string_character(FILE *file, char character) {
    if ((unsigned char)character < ' ' || strchr("\"\\<>&'", character) != NULL) {
        (void)fprintf(file, "\\u%04x", (unsigned)(unsigned char)character);
    } else {
        (void)fputc(character, file);
    }
}

void tl_html_put_string(FILE *file, const char *text) {
    (void)fputc('"', file);
    while (*text != '\0') {
        char shown[SHOWN];
        text = take(text, shown);
        for (const char *c = shown; *c != '\0'; c++) {
            put_string_character(file, *c);
        }
    }
    (void)fputc('"', file);
}

void tl_html_put_number(FILE *file, double value) {
    if (isfinite(value)) {
        (void)fprintf(file, "%.9g", value);
    } else {
        (void)fputs("null", file);
    }
}

void tl_html_put_count(FILE *file, uint64_t count) {
    char digits[24];
    int length = snprintf(digits, sizeof digits, "%" PRIu64, count);
    for (int i = 0; i < length; i++) {
        if (i > 0 && (length - i) % 3 == 0) {
            (void)fputs("\342\200\257", file); /* U+202F, narrow no-break space */
        }
        (void)fputc(digits[i], file);
    }
}

static uint32_t hexadecimal(char digit) {
    return (uint32_t)(digit <= '9' ? digit - '0' : digit - 'a' + 10);
}

void tl_html_digest(const void *data, size_t size, char text[TL_HTML_DIGEST]) {
    static const char letters[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char digits[TL_SHA256_TEXT + 2];
    tl_sha256(data, size, digits);
    digits[64] = '0'; /* 32 bytes are 43 letters, the last of them with two bits to spare */
    digits[65] = '0';
    char *end = text + sprintf(text, "sha256-");
    for (size_t i = 0; i < 66; i += 3) { /* three hexadecimal digits are two letters */
        uint32_t bits = hexadecimal(digits[i]) << 8 | hexadecimal(digits[i + 1]) << 4 | hexadecimal(digits[i + 2]);
        *end++ = letters[bits >> 6];
        *end++ = letters[bits & 63];
    }
    end[-1] = '='; /* the 44th letter stands for no bits at all */
    *end = '\0';
}
