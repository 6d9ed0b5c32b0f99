/* Strict JSON: accepted and rejected texts, the line and column of an error, and the line of
 * each value. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/json.h"
#include "tests/support/message.h"

static tl_arena arena;
static tl_json_lines lines;
static tl_error error;

void setUp(void) {
    tl_arena_init(&arena);
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    tl_arena_release(&arena);
}

/* Checks an allocated copy of the text, so that a sanitizer detects a read beyond its end. */
static tl_status check(const char *text, size_t size) {
    char *copy = malloc(size > 0 ? size : 1);
    TEST_ASSERT_NOT_NULL(copy);
    memcpy(copy, text, size);
    tl_status status = tl_json_text_check(copy, size, &arena, &lines, &error);
    free(copy);
    return status;
}

static void takes(const char *text) {
    tl_status status = check(text, strlen(text));
    TEST_ASSERT_EQUAL_STRING_MESSAGE("", error.text, text);
    TEST_ASSERT_EQUAL_INT(TL_OK, status);
}

static void refuses_bytes(const char *text, size_t size, const char *expected) {
    error.text[0] = '\0';
    tl_status status = check(text, size);
    TL_EXPECT_PARTS(expected, error.text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, status);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, error.status);
    error.text[0] = '\0';
}

static void refuses(const char *text, const char *expected) {
    refuses_bytes(text, strlen(text), expected);
}

/* Parts of the message: what is expected instead. */
#define A_VALUE "object|array|null"
#define A_NUMBER "number|leading zeros"
#define A_KEY "key"
#define AN_ENDING "\"|\\n|\\t"

static void test_values(void) {
    static const char *const texts[] = {
        "{}",
        "[]",
        "\"\"",
        "0",
        "-0",
        "true",
        "false",
        "null",
        " \t\r\n[ 1 , [ ] , { } ]\n",
        "{\"a\":{\"b\":[1,2,{\"c\":null}]},\"d\":0}",
        "[0.5,-1.25,10,1e5,1E+5,1e-5,-0.0e0,1.7976931348623157e308,5e-324,1e-999]",
        "\"\\\"\\\\\\/\\b\\f\\n\\r\\t\\u00e9\\uD83D\\ude00\\uFFFF\\uaFfA\\u0909\"",
        "\"\x7F é € \U0001F600 \xF4\x8F\xBF\xBF\"",
    };
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        takes(texts[i]);
    }
}

static void test_structure_refused(void) {
    refuses("", "line 1|column 1|end|" A_VALUE);
    refuses(" \n\n ", "line 3|column 2|end|" A_VALUE);
    refuses("{", "line 1|column 2|end|" A_KEY);
    refuses("[", "line 1|column 2|end|" A_VALUE);
    refuses("[1", "line 1|column 3|end|]");
    refuses("{\"a\":1", "line 1|column 7|end|}");
    refuses("[1,]", "line 1|column 3|comma|]");
    refuses("{\"a\":1,}", "line 1|column 7|comma|}");
    refuses("{\"a\":[1,\n]}", "line 1|column 8|comma|]");
    refuses("{\"a\" 47}", "line 1|column 6|47|key");
    refuses("{\"a\":}", "line 1|column 6|}|" A_VALUE);
    refuses("{alpha:1}", "line 1|column 2|alpha|" A_KEY);
    refuses("{'a':1}", "line 1|column 2|'|" A_KEY);
    refuses("{47:1}", "line 1|column 2|47|" A_KEY);
    refuses("[1 47]", "line 1|column 4|47|]");
    refuses("[1}", "line 1|column 3|}|]");
    refuses("{\"a\":1]", "line 1|column 7|]|}");
    refuses("[\n  1,\n  é\n]", "line 3|column 3|é|" A_VALUE);
    refuses("[1, // one\n2]", "line 1|column 5|/|" A_VALUE);
    refuses("[\v1]", "line 1|column 2|U+000B|" A_VALUE);
}

static void test_text_after_the_end(void) {
    refuses("{} {}", "line 1|column 4|{|end");
    refuses("1 47", "line 1|column 3|47|end");
    refuses("{}\n}", "line 2|column 1|}|end");
    refuses_bytes("{}", 3, "line 1|column 3|U+0000|end");
    refuses_bytes("{\0}", 3, "line 1|column 2|U+0000|" A_KEY);
}

static void test_words_refused(void) {
    refuses("True", "line 1|column 1|True|" A_VALUE);
    refuses("tru", "line 1|column 1|tru|" A_VALUE);
    refuses("nulls", "line 1|column 1|nulls|" A_VALUE);
    refuses("NaN", "line 1|column 1|NaN|" A_VALUE);
    refuses("Infinity", "line 1|column 1|Infinity|" A_VALUE);
    refuses("+1", "line 1|column 1|+1|" A_VALUE);
    refuses(".5", "line 1|column 1|.5|" A_VALUE);
    refuses("abcdefghijklmnopqrstuvwxyz", "line 1|column 1|abcdefghijklmnopqrstuvwx…|" A_VALUE);
}

static void test_numbers_refused(void) {
    refuses("{\"a\":0,02}", "line 1|column 6|0,02|0.02");
    refuses("{\"a\":[-12.5],\"b\":-1,5}", "line 1|column 18|-1,5|-1.5");
    refuses("01", "line 1|column 1|01|" A_NUMBER);
    refuses("-01", "line 1|column 1|-01|" A_NUMBER);
    refuses("-", "line 1|column 1|-|" A_NUMBER);
    refuses("-Infinity", "line 1|column 1|-Infinity|" A_NUMBER);
    refuses("1.", "line 1|column 1|1.|" A_NUMBER);
    refuses("1.e5", "line 1|column 1|1.e5|" A_NUMBER);
    refuses("1e", "line 1|column 1|1e|" A_NUMBER);
    refuses("1e+", "line 1|column 1|1e+|" A_NUMBER);
    refuses("1e+-5", "line 1|column 1|1e+-5|" A_NUMBER);
    refuses("0x10", "line 1|column 1|0x10|" A_NUMBER);
    refuses("1.2.3", "line 1|column 1|1.2.3|" A_NUMBER);
    refuses("[0.1,\n 1e999]", "line 2|column 2|1e999|1.7e308");
    refuses("-1e309", "line 1|column 1|-1e309|1.7e308");
}

static void test_the_longest_number(void) {
    char number[TL_JSON_NUMBER_CHARS + 2];
    memset(number, '1', sizeof number);
    number[TL_JSON_NUMBER_CHARS] = '\0';
    takes(number);
    number[TL_JSON_NUMBER_CHARS] = '1';
    number[TL_JSON_NUMBER_CHARS + 1] = '\0';
    refuses(number, "line 1|column 1|111111111111111111111111…|63");
}

static void test_strings_refused(void) {
    refuses("\"", "line 1|column 2|end|\"");
    refuses("\"ab\nc\"", "line 1|column 4|line break|" AN_ENDING);
    refuses("\"\t\"", "line 1|column 2|tab|" AN_ENDING);
    refuses("\"é\x01\"", "line 1|column 3|U+0001|" AN_ENDING);
    refuses_bytes("\"a\0b\"", 5, "line 1|column 3|U+0000|" AN_ENDING);
    refuses("\"\\x\"", "line 1|column 2|\\x|\\b|\\f|\\n|\\r|\\t|\\u");
    refuses("\"\\", "line 1|column 3|end|escape");
    refuses("\"\\u12g4\"", "line 1|column 2|\\u|hexadecimal");
    refuses("\"\\u12", "line 1|column 2|\\u|hexadecimal");
    refuses("\"a\\u0000\"", "line 1|column 3|\\u0000|NUL");
}

static void test_lone_surrogates(void) {
    static const char *const texts[] = {"\"\\ud800\"",        "\"\\udc00\"",        "\"\\ud800\\n\"",
                                        "\"\\ud800\\u0041\"", "\"\\ud800\\ud800\"", "\"\\ud800\\u\"",
                                        "\"\\udfff\\ud800\"", "\"\\ud83d",          "\"\\ud83d\\ude0",
                                        "\"\\udbffxx\"",      "\"\\ud83d \\ude00\""};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        refuses(texts[i], "line 1|column 2|surrogate");
    }
}

static void test_depth(void) {
    char text[2 * (TL_JSON_MAX_DEPTH + 1) + 1] = "";
    for (size_t depth = TL_JSON_MAX_DEPTH; depth <= TL_JSON_MAX_DEPTH + 1; depth++) {
        memset(text, '[', depth);
        memset(text + depth, ']', depth);
        text[2 * depth] = '\0';
        if (depth == TL_JSON_MAX_DEPTH) {
            takes(text);
        }
    }
    refuses(text, "line 1|column 33|32");
}

static void test_very_deep_and_unclosed(void) {
    enum { SIZE = 200000 };
    char *text = malloc(SIZE + 1);
    TEST_ASSERT_NOT_NULL(text);
    memset(text, '[', SIZE);
    text[SIZE] = '\0';
    refuses(text, "line 1|column 33|32");
    free(text);
}

static void test_encoding(void) {
    static const char *const overlong[] = {"\"\xC0\xAF\"", "\"\xC1\xBF\"", "\"\xE0\x80\xAF\"", "\"\xF0\x80\x80\x80\""};
    static const char *const malformed[] = {"\"\x80\"",
                                            "\"\xBF\"",
                                            "\"\xC3\"",
                                            "\"\xE2\x82\"",
                                            "\"\xED\xA0\x80\"",
                                            "\"\xFE\"",
                                            "\"\xF0\x9F\x98\"",
                                            "\"\xC3(\"",
                                            "\"\xF4\x90\x80\x80\"",
                                            "\"\xE2\x28\xA1\"",
                                            "\"\xF5\x80\x80\x80\""};
    char expected[64];
    for (size_t i = 0; i < 4 + sizeof malformed / sizeof malformed[0]; i++) {
        const char *text = i < 4 ? overlong[i] : malformed[i - 4];
        (void)snprintf(expected, sizeof expected, "line 1|column 2|0x%02X|UTF-8", (unsigned)(unsigned char)text[1]);
        refuses(text, expected);
    }
    refuses("[\n\"é\xFF\"]", "line 2|column 3|0xFF|UTF-8");
    refuses("\xEF\xBB\xBF{}", "line 1|column 1|BOM|UTF-8");
    refuses("\xEF\xBB\xBF", "line 1|column 1|BOM|UTF-8");
    refuses_bytes("\xFF\xFE{\0}\0", 6, "line 1|column 1|0xFF|UTF-8");
}

static void test_lines_in_document_order(void) {
    static const uint32_t expected[] = {1, 2, 2, 3, 4, 6, 7, 7};
    takes("{\"a\":\n [1,\n  \"[,:\",\n  {\"b\"\n:\n   null}],\n \"c\": {\"d\": false}\r\n}");
    TEST_ASSERT_EQUAL_size_t(sizeof expected / sizeof expected[0], lines.count);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(expected, lines.line, lines.count);
}

/* The highest density of values: one in two bytes. */
static void test_very_many_values(void) {
    enum { COUNT = 130000 };
    static const char *const openings[] = {"[0", "[[]"};
    for (size_t k = 0; k < 2; k++) {
        size_t unit = strlen(openings[k]);
        char *text = malloc(COUNT * unit + 2);
        TEST_ASSERT_NOT_NULL(text);
        for (size_t i = 0; i < COUNT; i++) {
            memcpy(text + i * unit, openings[k], unit);
            text[i * unit] = i == 0 ? '[' : ',';
        }
        text[COUNT * unit] = ']';
        text[COUNT * unit + 1] = '\0';
        takes(text);
        TEST_ASSERT_EQUAL_size_t(COUNT + 1, lines.count);
        TEST_ASSERT_EACH_EQUAL_UINT32(1, lines.line, lines.count);
        free(text);
    }
}

static void test_no_memory(void) {
    tl_arena_seal(&arena);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, check("{}", 2));
    TL_EXPECT_PARTS("memory|2 bytes|JSON", error.text);
}

static void test_plain(void) {
    TEST_ASSERT_TRUE(tl_text_is_plain(""));
    TEST_ASSERT_TRUE(tl_text_is_plain("motor 1 é \xC2\xA0 €"));
    TEST_ASSERT_FALSE(tl_text_is_plain("a\n"));
    TEST_ASSERT_FALSE(tl_text_is_plain("\x1B[31m"));
    TEST_ASSERT_FALSE(tl_text_is_plain("\x7F"));
    TEST_ASSERT_FALSE(tl_text_is_plain("\xC2\x80"));
    TEST_ASSERT_FALSE(tl_text_is_plain("\xC2\x9F"));
    TEST_ASSERT_FALSE(tl_text_is_plain("motor \uFEFF1"));
    TEST_ASSERT_FALSE(tl_text_is_plain("motor\u2028"));
    TEST_ASSERT_TRUE(tl_text_is_plain("\u200D\u200C")); /* languages need them */
}

static void expect_shown(const char *text, size_t size, const char *expected) {
    char copy[64];
    memset(copy, '#', sizeof copy);
    tl_text_for_people(text, copy, size);
    TEST_ASSERT_EQUAL_STRING(expected, copy);
    TEST_ASSERT_EQUAL_CHAR('#', copy[size]);
}

static void test_texts_for_people(void) {
    expect_shown("", 8, "");
    expect_shown("1234567", 8, "1234567");
    expect_shown("12345678", 8, "1234…");
    expect_shown("a\x1B[b\n\x7F", 20, "a\\x1B[b\\x0A\\x7F");
    expect_shown("a\tb", 8, "a\\tb");
    expect_shown("\xC2\x9B", 8, "\\u{9B}");
    expect_shown("a\uFEFFb\u2028", 32, "a\\u{FEFF}b\\u{2028}");
    expect_shown("a\x1B[b\n\x7F", 12, "a\\x1B[b…"); /* an escape is never cut */
    expect_shown("\U000E0041", 8, "…");
    expect_shown("ééé", 8, "ééé");
    expect_shown("éééé", 8, "éé…");
    expect_shown("aéééé", 8, "aé…");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_values);
    RUN_TEST(test_structure_refused);
    RUN_TEST(test_text_after_the_end);
    RUN_TEST(test_words_refused);
    RUN_TEST(test_numbers_refused);
    RUN_TEST(test_the_longest_number);
    RUN_TEST(test_strings_refused);
    RUN_TEST(test_lone_surrogates);
    RUN_TEST(test_depth);
    RUN_TEST(test_very_deep_and_unclosed);
    RUN_TEST(test_encoding);
    RUN_TEST(test_lines_in_document_order);
    RUN_TEST(test_very_many_values);
    RUN_TEST(test_no_memory);
    RUN_TEST(test_plain);
    RUN_TEST(test_texts_for_people);
    return UNITY_END();
}
