/* The relay: untrusted output is escaped before it reaches a terminal. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <unity.h>

#include "firmware/base/relay.h"

enum { LINES = TL_RELAY_DRAIN };

static tl_relay relay;
static int input;
static char passed[1000000]; /* all lines, each with a newline */
static size_t passed_size;
static size_t lines;

static void keep(void *context, const char *line) {
    TEST_ASSERT_EQUAL_PTR(&relay, context);
    size_t size = strlen(line);
    TEST_ASSERT_LESS_THAN_size_t(sizeof passed - 2, passed_size + size);
    memcpy(passed + passed_size, line, size);
    passed_size += size;
    passed[passed_size++] = '\n';
    passed[passed_size] = '\0';
    lines++;
}

void setUp(void) {
    int ends[2];
    TEST_ASSERT_EQUAL_INT(0, pipe(ends));
    input = ends[1];
    passed_size = 0;
    lines = 0;
    passed[0] = '\0';
    tl_relay_open(&relay, ends[0], keep, &relay);
}

void tearDown(void) {
    if (input >= 0) {
        (void)close(input);
        tl_relay_close(&relay);
    }
}

static void print_bytes(const char *bytes, size_t size) {
    TEST_ASSERT_EQUAL_INT((int)size, (int)write(input, bytes, size));
}

static void print(const char *text) {
    print_bytes(text, strlen(text));
}

static void end(void) {
    (void)close(input);
    input = -1;
    while (tl_relay_drain(&relay)) {
    }
    tl_relay_close(&relay);
}

static void test_text_stays_as_it_is(void) {
    print("Grüße, \t„20 °C“ 😀 日本 C:\\temp\n\nthird\n");
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    TEST_ASSERT_EQUAL_STRING("Grüße, \t„20 °C“ 😀 日本 C:\\temp\n\nthird\n", passed);
    TEST_ASSERT_EQUAL_size_t(3, lines);
}

static void test_nasty_sequences(void) {
    const struct {
        const char *bytes;
        const char *shown;
    } cases[] = {
        {"\x1B[2J\x1B]0;owned\x07", "\\x1B[2J\\x1B]0;owned\\x07"}, /* clears the screen, sets the window title */
        {"\x1B[5n", "\\x1B[5n"},                                   /* the terminal would answer as the keyboard */
        {"ok\rtwinlock: all is well", "ok\\x0Dtwinlock: all is well"},
        {"\x08\x7F\x0B\x0C\x1F", "\\x08\\x7F\\x0B\\x0C\\x1F"},
        {"\xC2\x9B"
         "2J\xC2\x85",
         "\\u{9B}2J\\u{85}"},
        {"\x9B"
         "2J",
         "\\x9B2J"}, /* a C1 control in one byte */
        {(const char[]){'\xE2', '\x80', '\xAA', '\xE2', '\x80', '\xAB', '\xE2', '\x80', '\xAC', '\xE2', '\x80', '\xAD',
                        '\xE2', '\x80', '\xAE', '\0'},
         "\\u{202A}\\u{202B}\\u{202C}\\u{202D}\\u{202E}"},
        {(const char[]){'\xE2', '\x81', '\xA6', '\xE2', '\x81', '\xA7', '\xE2', '\x81', '\xA8', '\xE2', '\x81', '\xA9',
                        '\0'},
         "\\u{2066}\\u{2067}\\u{2068}\\u{2069}"},
        {"\xE2\x80\xA8\xE2\x80\xA9", "\\u{2028}\\u{2029}"},
        {"\xE2\x80\x8E\xE2\x80\x8F\xD8\x9C\xEF\xBB\xBF", "\\u{200E}\\u{200F}\\u{61C}\\u{FEFF}"},
        {"\xF3\xA0\x81\x81", "\\u{E0041}"},           /* an invisible tag */
        {"\xC0\x9B\xC1\xBF", "\\xC0\\x9B\\xC1\\xBF"}, /* overlong: */
        {"\xE0\x80\x9B", "\\xE0\\x80\\x9B"},
        {"\xF0\x80\x80\x9B", "\\xF0\\x80\\x80\\x9B"},
        {"\xED\xA0\x80", "\\xED\\xA0\\x80"}, /* a surrogate */
        {"\xF4\x90\x80\x80\xF5\xFF", "\\xF4\\x90\\x80\\x80\\xF5\\xFF"},
        {"\xE2\x82", "\\xE2\\x82"}, /* incomplete */
        {"\xE2\x1B[m", "\\xE2\\x1B[m"},
        {"\xF0\x9F\x98"
         "A",
         "\\xF0\\x9F\\x98"
         "A"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char expected[200];
        passed_size = 0;
        print(cases[i].bytes);
        print("\n");
        TEST_ASSERT_TRUE(tl_relay_drain(&relay));
        (void)snprintf(expected, sizeof expected, "%s\n", cases[i].shown);
        TEST_ASSERT_EQUAL_STRING(expected, passed);
    }
}

static void test_a_nul_is_shown(void) {
    print_bytes("a\0b\n", 4);
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    TEST_ASSERT_EQUAL_STRING("a\\x00b\n", passed);
}

/* The output may end inside a character. */
static void test_a_line_waits_for_its_end(void) {
    print("one\ntw\xC3");
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    TEST_ASSERT_EQUAL_STRING("one\n", passed);
    print("\xB6\nthree");
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    TEST_ASSERT_EQUAL_STRING("one\ntwö\n", passed);
    end();
    TEST_ASSERT_EQUAL_STRING("one\ntwö\nthree\n", passed);
}

/* The limit falls between two characters, or within one of 2, 3 or 4 bytes: no character is cut. */
static void test_a_long_line_comes_in_pieces(void) {
    static const struct {
        const char *begin, *repeated;
        size_t first; /* bytes of the first piece */
    } cases[] = {{"", "ä", 4096},   {"x", "ä", 4095}, {"", "€", 4095},
                 {"xx", "€", 4094}, {"x", "😀", 4093}, {"xxx", "😀", 4095}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        size_t count = 6000 / strlen(cases[i].repeated);
        size_t all = strlen(cases[i].begin) + count * strlen(cases[i].repeated);
        lines = 0;
        passed_size = 0;
        print(cases[i].begin);
        for (size_t k = 0; k < count; k++) {
            print(cases[i].repeated);
            TEST_ASSERT_TRUE(tl_relay_drain(&relay));
        }
        print("\n");
        TEST_ASSERT_TRUE(tl_relay_drain(&relay));
        TEST_ASSERT_EQUAL_size_t(2, lines);
        TEST_ASSERT_EQUAL_size_t(all + 2, passed_size);
        TEST_ASSERT_EQUAL_CHAR('\n', passed[cases[i].first]);
        TEST_ASSERT_NULL(strchr(passed, '\\'));
    }
}

static void test_a_full_line_is_one(void) {
    char full[TL_RELAY_LINE + 1];
    memset(full, 'x', TL_RELAY_LINE);
    full[TL_RELAY_LINE] = '\n';
    print_bytes(full, sizeof full);
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    TEST_ASSERT_EQUAL_size_t(1, lines);
    memset(full, 1, TL_RELAY_LINE); /* the longest possible line */
    print_bytes(full, sizeof full);
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    TEST_ASSERT_EQUAL_size_t(2, lines);
    TEST_ASSERT_EQUAL_size_t(TL_RELAY_LINE + 1 + 4 * TL_RELAY_LINE + 1, passed_size);
}

static void test_the_end_is_told(void) {
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    (void)close(input);
    TEST_ASSERT_FALSE(tl_relay_drain(&relay));
    TEST_ASSERT_FALSE(tl_relay_drain(&relay));
    tl_relay_close(&relay);
    input = -1;
    TEST_ASSERT_EQUAL_size_t(0, lines);
}

static void print_again(void *context, const char *line) {
    (void)context;
    (void)line;
    lines++;
    (void)!write(input, "more and more\n", 14);
}

/* Each forwarded line causes another one: drain() returns all the same. */
static void test_who_never_stops_keeps_nobody(void) {
    relay.pass = print_again;
    print("more and more\n");
    TEST_ASSERT_TRUE(tl_relay_drain(&relay));
    TEST_ASSERT_GREATER_THAN_size_t(10, lines);
    TEST_ASSERT_LESS_THAN_size_t(LINES, lines);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_text_stays_as_it_is);
    RUN_TEST(test_nasty_sequences);
    RUN_TEST(test_a_nul_is_shown);
    RUN_TEST(test_a_line_waits_for_its_end);
    RUN_TEST(test_a_long_line_comes_in_pieces);
    RUN_TEST(test_a_full_line_is_one);
    RUN_TEST(test_the_end_is_told);
    RUN_TEST(test_who_never_stops_keeps_nobody);
    return UNITY_END();
}
