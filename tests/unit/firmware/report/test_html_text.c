/* Text on an HTML page: foreign text is escaped. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/report/html_report.h"

static char *written;
static size_t size;
static FILE *file;

void setUp(void) {
    file = open_memstream(&written, &size);
}

void tearDown(void) {
    free(written);
}

static void expect(const char *expected) {
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_EQUAL_STRING(expected, written);
}

static void test_markup_is_text(void) {
    tl_html_put_text(file, "</title><script>alert(1)</script><img src=x onerror='f()'>\"&amp;");
    expect("&lt;/title&gt;&lt;script&gt;alert(1)&lt;/script&gt;&lt;img src=x onerror=&#39;f()&#39;&gt;&quot;&amp;amp;");
}

static void test_letters_of_all_countries_stay(void) {
    tl_html_put_text(file, "Förderhöhe ŷ 速度");
    expect("Förderhöhe ŷ 速度");
}

static void test_what_cannot_be_shown(void) {
    tl_html_put_text(file, "a\nb\tc\x1b[31m\x7f.\uFEFF\xC2\x9B\u2028\xFF");
    expect("a b c\\x1B[31m\\x7F.\\u{FEFF}\\u{9B}\\u{2028}\\xFF");
}

static void test_a_string_in_a_script(void) {
    tl_html_put_string(file, "</script><!--\"\\&'\n\x7f\uFEFFü");
    expect("\"\\u003c/script\\u003e\\u003c!--\\u0022\\u005c\\u0026\\u0027\\u000a\\u005cx7F\\u005cu{FEFF}ü\"");
}

static void test_every_byte_of_a_string(void) {
    char text[256];
    for (int i = 1; i < 256; i++) {
        text[i - 1] = (char)i;
    }
    text[255] = '\0';
    tl_html_put_string(file, text);
    TEST_ASSERT_EQUAL_INT(0, fclose(file));
    TEST_ASSERT_NULL(strpbrk(written, "<>&'\n\r\t"));
    TEST_ASSERT_EQUAL_PTR(written + size - 1, strchr(written + 1, '"')); /* no other quote */
}

static void test_numbers(void) {
    tl_html_put_number(file, 0.1);
    (void)fputc(' ', file);
    tl_html_put_number(file, -123456789.25);
    (void)fputc(' ', file);
    tl_html_put_number(file, (double)NAN);
    (void)fputc(' ', file);
    tl_html_put_number(file, -(double)INFINITY);
    expect("0.1 -123456789 null null");
}

#define THIN "\342\200\257"

static void test_counts(void) {
    static const uint64_t counts[] = {0, 999, 1000, 1234567, UINT64_MAX};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        tl_html_put_count(file, counts[i]);
        (void)fputc(' ', file);
    }
    expect("0 999 1" THIN "000 1" THIN "234" THIN "567 18" THIN "446" THIN "744" THIN "073" THIN "709" THIN "551" THIN
           "615 ");
}

/* Expected values: `openssl dgst -sha256 -binary | base64`. */
static void test_digests(void) {
    char text[TL_HTML_DIGEST];
    (void)fclose(file);
    tl_html_digest("", 0, text);
    TEST_ASSERT_EQUAL_STRING("sha256-47DEQpj8HBSa+/TImW+5JCeuQeRkm5NMpJWZG3hSuFU=", text);
    tl_html_digest("abc", 3, text);
    TEST_ASSERT_EQUAL_STRING("sha256-ungWv48Bz+pBQUDeXa4iI7ADYaOWF3qctBD/YfIAFa0=", text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_markup_is_text);
    RUN_TEST(test_letters_of_all_countries_stay);
    RUN_TEST(test_what_cannot_be_shown);
    RUN_TEST(test_a_string_in_a_script);
    RUN_TEST(test_every_byte_of_a_string);
    RUN_TEST(test_numbers);
    RUN_TEST(test_counts);
    RUN_TEST(test_digests);
    return UNITY_END();
}
