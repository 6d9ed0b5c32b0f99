/* Escaping of untrusted text. */
#include <string.h>

#include <unity.h>

#include "firmware/base/text.h"

void setUp(void) {}

void tearDown(void) {}

static void expect(const char *clean, const char *text) {
    char made[256];
    TEST_ASSERT_EQUAL_size_t(strlen(clean), tl_clean_text(text, strlen(text), made, sizeof made));
    TEST_ASSERT_EQUAL_STRING(clean, made);
}

static void test_text_stays(void) {
    expect("", "");
    expect("fmi2DoStep:\t3 \xC2\xB5m", "fmi2DoStep:\t3 \xC2\xB5m");
    expect("\xE2\x82\xAC \xF0\x9F\x98\x80", "\xE2\x82\xAC \xF0\x9F\x98\x80");
}

static void test_commands_are_shown(void) {
    expect("\\x1B[2J\\x07\\x0A\\x7F", "\x1B[2J\x07\n\x7F");
    expect("\\u{9B}31m", "\xC2\x9B"
                         "31m");
    /* U+202E, U+FEFF, U+2028, U+E0041. As literals they would reverse or hide the source text. */
    static const char hidden[] = {'\xE2', '\x80', '\xAE', '\xEF', '\xBB', '\xBF', '\xE2',
                                  '\x80', '\xA8', '\xF3', '\xA0', '\x81', '\x81', '\0'};
    expect("\\u{202E}\\u{FEFF}\\u{2028}\\u{E0041}", hidden);
}

static void test_what_is_no_character_is_shown(void) {
    expect("\\x9B2J\\xFF", "\x9B"
                           "2J\xFF");
    expect("\\xE2\\x80", "\xE2\x80");          /* incomplete */
    expect("\\xC0\\xAF", "\xC0\xAF");          /* overlong */
    expect("\\xED\\xA0\\x80", "\xED\xA0\x80"); /* a surrogate */
}

/* Neither a character nor an escape is cut, whatever the size of the buffer. */
static void test_room(void) {
    static const char text[] = "a\xC2\xB5\x1B\xC2\x9B.";
    static const char whole[] = "a\xC2\xB5\\x1B\\u{9B}.";
    static const size_t ends[] = {0, 1, 3, 7, 13, 14};
    for (size_t room = 1; room < 32; room++) {
        char made[32];
        size_t length = 0;
        for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
            length = ends[i] < room ? ends[i] : length;
        }
        memset(made, 'x', sizeof made);
        TEST_ASSERT_EQUAL_size_t(length, tl_clean_text(text, sizeof text - 1, made, room));
        TEST_ASSERT_EQUAL_size_t(length, strlen(made));
        TEST_ASSERT_EQUAL_INT(0, memcmp(whole, made, length));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_text_stays);
    RUN_TEST(test_commands_are_shown);
    RUN_TEST(test_what_is_no_character_is_shown);
    RUN_TEST(test_room);
    return UNITY_END();
}
