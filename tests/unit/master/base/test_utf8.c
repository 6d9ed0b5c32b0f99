/* UTF-8 characters: every short sequence, and which ones may be printed. */
#include <unity.h>

#include "master/base/text.h"

void setUp(void) {}
void tearDown(void) {}

/* Table 3-7 of the Unicode standard, as ranges of code points. */
static size_t expected_of(const unsigned char byte[3], uint32_t *point) {
    if (byte[0] < 0x80) {
        *point = byte[0];
        return 1;
    }
    if ((byte[0] & 0xE0) == 0xC0 && (byte[1] & 0xC0) == 0x80) {
        *point = (byte[0] & 0x1Fu) << 6 | (byte[1] & 0x3Fu);
        return *point >= 0x80 ? 2 : 0;
    }
    if ((byte[0] & 0xF0) == 0xE0 && (byte[1] & 0xC0) == 0x80 && (byte[2] & 0xC0) == 0x80) {
        *point = (byte[0] & 0x0Fu) << 12 | (byte[1] & 0x3Fu) << 6 | (byte[2] & 0x3Fu);
        return *point >= 0x800 && (*point < 0xD800 || *point > 0xDFFF) ? 3 : 0;
    }
    return 0;
}

/* Every sequence of one to three bytes. */
static void test_every_short_character(void) {
    for (unsigned number = 0; number < 0x1000000; number++) {
        const unsigned char byte[3] = {(unsigned char)(number >> 16), (unsigned char)(number >> 8 & 0xFF),
                                       (unsigned char)(number & 0xFF)};
        uint32_t wanted = 0;
        uint32_t code = 0;
        size_t expected = expected_of(byte, &wanted);
        size_t length = tl_utf8_read((const char *)byte, sizeof byte, &code);
        if (length != expected || (expected != 0 && code != wanted)) {
            TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFF, number);
        }
    }
}

static void expect(size_t length, uint32_t code, const char *bytes, size_t size) {
    uint32_t found = 0;
    TEST_ASSERT_EQUAL_size_t(length, tl_utf8_read(bytes, size, &found));
    if (length > 0) {
        TEST_ASSERT_EQUAL_HEX32(code, found);
    }
}

static void test_characters_of_four_bytes(void) {
    expect(4, 0x10000, "\xF0\x90\x80\x80", 4);
    expect(4, 0x10FFFF, "\xF4\x8F\xBF\xBF", 4);
    expect(0, 0, "\xF0\x8F\xBF\xBF", 4); /* overlong */
    expect(0, 0, "\xF4\x90\x80\x80", 4); /* beyond U+10FFFF */
    expect(0, 0, "\xF5\x80\x80\x80", 4);
    expect(0, 0, "\xF0\x90\x80\x80", 3); /* incomplete */
    expect(0, 0, "\xC3\xA9", 1);
}

static void test_what_can_be_shown(void) {
    static const uint32_t shown[] = {' ', '~', 0xA0, 0xE9, 0x200C, 0x200D, 0x20AC, 0x1F600};
    static const uint32_t hidden[] = {0,      0x1B,   0x7F,   0x9B,   0x61C,  0x200E, 0x2028,
                                      0x2029, 0x202E, 0x2066, 0x2069, 0xFEFF, 0xFFF9, 0xE0041};
    for (size_t i = 0; i < sizeof shown / sizeof shown[0]; i++) {
        TEST_ASSERT_TRUE(tl_utf8_can_be_shown(shown[i]));
    }
    for (size_t i = 0; i < sizeof hidden / sizeof hidden[0]; i++) {
        TEST_ASSERT_FALSE(tl_utf8_can_be_shown(hidden[i]));
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_every_short_character);
    RUN_TEST(test_characters_of_four_bytes);
    RUN_TEST(test_what_can_be_shown);
    return UNITY_END();
}
