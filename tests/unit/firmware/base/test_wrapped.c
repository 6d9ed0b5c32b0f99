/* Paragraphs: broken between words at 79 columns, which are characters and not bytes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/base/text.h"

void setUp(void) {}
void tearDown(void) {}

static void expect_printed(const char *text, int first, int indent, const char *expected) {
    char *printed = NULL;
    size_t size = 0;
    FILE *file = open_memstream(&printed, &size);
    TEST_ASSERT_NOT_NULL(file);
    tl_wrapped_print(file, text, first, indent);
    (void)fclose(file);
    TEST_ASSERT_EQUAL_STRING(expected, printed);
    free(printed);
}

#define NINE "123456789 "

static void test_a_short_one(void) {
    expect_printed("a few words", 2, 4, "  a few words\n");
    expect_printed("", 0, 4, "\n");
}

static void test_a_long_one(void) {
    expect_printed(NINE NINE NINE NINE NINE NINE NINE "123456789", 0, 4,
                   NINE NINE NINE NINE NINE NINE NINE "123456789\n");
    expect_printed(NINE NINE NINE NINE NINE NINE NINE "1234567890", 0, 4,
                   NINE NINE NINE NINE NINE NINE "123456789\n    1234567890\n");
}

static void test_columns_are_characters(void) {
    expect_printed(NINE NINE NINE NINE NINE NINE NINE "\303\204\303\226\303\234456789", 0, 4,
                   NINE NINE NINE NINE NINE NINE NINE "\303\204\303\226\303\234456789\n");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_a_short_one);
    RUN_TEST(test_a_long_one);
    RUN_TEST(test_columns_are_characters);
    return UNITY_END();
}
