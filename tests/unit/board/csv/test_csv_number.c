/* Numbers of CSV cells: the same bits as strtod(), and the same texts are rejected. */
#include "board/csv/csv_number.h"

#include <fenv.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "tests/support/random_numbers.h"

enum { TEXT = 400, SHOWN = TEXT + 80 };

void setUp(void) {}

void tearDown(void) {
    (void)fesetround(FE_TONEAREST);
}

/* What a cell may hold: a finite decimal number. */
static bool read_by_strtod(const char *text, double *number) {
    char *end = NULL;
    *number = 0;
    if (text[0] == '\0' || text[strspn(text, "+-.0123456789eE")] != '\0') {
        return false;
    }
    const double value = strtod(text, &end);
    const bool is_number = *end == '\0' && isfinite(value);
    *number = is_number ? value : 0;
    return is_number;
}

/* Returns true if the text is a number. */
static bool expect_as_strtod(const char *text) {
    double found = (double)NAN;
    double wanted = 0;
    const bool is_number = read_by_strtod(text, &wanted);
    const bool is_found = tl_csv_number_read(text, &found);
    if (is_found != is_number || memcmp(&found, &wanted, sizeof found) != 0) {
        char message[SHOWN];
        (void)snprintf(message, sizeof message, "\"%s\": %d %a, wanted %d %a", text, (int)is_found, found,
                       (int)is_number, wanted);
        TEST_FAIL_MESSAGE(message);
    }
    return is_number;
}

static void test_numbers(void) {
    static const char *const TEXTS[] = {
        "0",
        "-0",
        "+0.0",
        "1",
        "-1.5",
        "+1.5",
        ".5",
        "5.",
        "5.e3",
        "1e5",
        "1E+05",
        "1e-05",
        "000123.4500",
        "0e999999999999",
        "1e22",
        "1e23",
        "1e-22",
        "1e-23",
        "9007199254740992",
        "9007199254740993",
        "-9007199254740993e22",
        "9007199254740993e-22",
        "4503599627370497.5",
        "4503599627370496.4",
        "0.10000000000000000555",
        "999999999999999999",
        "1000000000000000000",
        "1.00000000000000011",
        "0.99999999999999993",
        "0.99999999999999999",
        "0.50000000000000000001",
        "2.2250738585072011e-308",
        "1.7976931348623157e308",
        "4.9e-324",
        "1e-999",
        "62.981092539552883",
        "0.0091291041517769494",
    };
    for (size_t i = 0; i < sizeof TEXTS / sizeof TEXTS[0]; i++) {
        TEST_ASSERT_TRUE_MESSAGE(expect_as_strtod(TEXTS[i]), TEXTS[i]);
    }
}

static void test_texts_that_are_no_number(void) {
    static const char *const TEXTS[] = {"",    "+",    "-",       ".",     "-.",   "e5",  ".e5", "1e",  "1e+",  "1e5.",
                                        "--1", "+-1",  "1-",      "1..2",  "1.2.", " 1",  "1 ",  "0x1", "1e1e", "inf",
                                        "nan", "-inf", "1e99999", "1e309", "1,5",  "1_0", "1f",  "٣"};
    for (size_t i = 0; i < sizeof TEXTS / sizeof TEXTS[0]; i++) {
        TEST_ASSERT_FALSE_MESSAGE(expect_as_strtod(TEXTS[i]), TEXTS[i]);
    }
}

/* Each fourth number has random bits, the others have the size of what sensors measure. */
static double any_number(tl_test_random *random) {
    double number = tl_test_random_number(random, -1, 1) * pow(10, tl_test_random_number(random, -24, 24));
    if (tl_test_random_chance(random, 25)) {
        const uint64_t bits = tl_test_random_bits(random);
        memcpy(&number, &bits, sizeof number);
    }
    return isfinite(number) ? number : 0;
}

static void print_number(tl_test_random *random, char text[TEXT]) {
    static const char FORMS[] = {'f', 'g', 'e'};
    static const int DIGITS[] = {0, 3, 6, 9, 12, 15, 16, 17, 18};
    const int digits = DIGITS[tl_test_random_below(random, sizeof DIGITS / sizeof DIGITS[0])];
    const double number = any_number(random);
    switch (FORMS[tl_test_random_below(random, sizeof FORMS)]) {
    case 'f':
        (void)snprintf(text, TEXT, "%.*f", digits, number);
        break;
    case 'g':
        (void)snprintf(text, TEXT, "%.*g", digits, number);
        break;
    default:
        (void)snprintf(text, TEXT, "%.*e", digits, number);
        break;
    }
}

static void test_printed_numbers(void) {
    const size_t numbers = tl_test_campaign("TL_TEST_NUMBERS", 300000);
    tl_test_random random = {.state = 1};
    char text[TEXT];
    for (size_t i = 0; i < numbers; i++) {
        print_number(&random, text);
        TEST_ASSERT_TRUE_MESSAGE(expect_as_strtod(text), text);
    }
}

/* Random digits around the limits of the short ways: 2^53, 18 digits, and powers of ten up to 22. */
static void test_random_digits(void) {
    const size_t numbers = tl_test_campaign("TL_TEST_NUMBERS", 300000);
    tl_test_random random = {.state = 2};
    for (size_t i = 0; i < numbers; i++) {
        char text[64] = "";
        const size_t digits = tl_test_random_between(&random, 1, 20);
        const size_t point = tl_test_random_below(&random, 22);
        size_t length = 0;
        for (size_t k = 0; k < digits; k++) {
            text[length++] = (char)('0' + tl_test_random_below(&random, 10));
            if (k == point) {
                text[length++] = '.';
            }
        }
        (void)snprintf(text + length, sizeof text - length, "e%d", (int)tl_test_random_between(&random, 0, 60) - 30);
        TEST_ASSERT_TRUE_MESSAGE(expect_as_strtod(text), text);
    }
}

static void test_random_texts(void) {
    static const char LETTERS[] = "+-.eE0123456789 x,nai";
    const size_t texts = tl_test_campaign("TL_TEST_NUMBERS", 300000);
    tl_test_random random = {.state = 3};
    size_t accepted = 0;
    for (size_t i = 0; i < texts; i++) {
        char text[12] = "";
        const size_t length = tl_test_random_below(&random, sizeof text);
        const size_t letters = tl_test_random_chance(&random, 80) ? 15 : sizeof LETTERS - 1;
        for (size_t k = 0; k < length; k++) {
            text[k] = LETTERS[tl_test_random_below(&random, letters)];
        }
        accepted += expect_as_strtod(text) ? 1 : 0;
    }
    TEST_ASSERT_TRUE(accepted > texts / 20 && accepted < texts / 2);
}

/* strtod() rounds in the mode of its thread. */
static void test_each_rounding(void) {
    static const int MODES[] = {FE_UPWARD, FE_DOWNWARD, FE_TOWARDZERO};
    tl_test_random random = {.state = 4};
    char text[TEXT];
    for (size_t mode = 0; mode < sizeof MODES / sizeof MODES[0]; mode++) {
        TEST_ASSERT_EQUAL_INT(0, fesetround(MODES[mode]));
        for (int i = 0; i < 30000; i++) {
            print_number(&random, text);
            (void)expect_as_strtod(text);
        }
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_numbers);
    RUN_TEST(test_texts_that_are_no_number);
    RUN_TEST(test_printed_numbers);
    RUN_TEST(test_random_digits);
    RUN_TEST(test_random_texts);
    RUN_TEST(test_each_rounding);
    return UNITY_END();
}
