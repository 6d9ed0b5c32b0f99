/* Messages of FMUs: formatted as by printf, with unchecked pointers from the FMU. */
#include "firmware/fmu/fmu_logger.h"

#include <errno.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>
#include <wchar.h>

#include <unity.h>

#define NOWHERE ((const char *)8)

static char text[256];

void setUp(void) {
    memset(text, 'x', sizeof text);
}

void tearDown(void) {}

/* As an FMU calls the logger: no compiler checks the arguments. */
static const char *format(const char *message, ...) {
    va_list arguments;
    va_start(arguments, message);
    tl_fmu_message_format(message, &arguments, text, sizeof text);
    va_end(arguments);
    return text;
}

static const char *copy(const char *untrusted, size_t size) {
    tl_fmu_message_copy(untrusted, text, size);
    return text;
}

/* A pointer to any address. */
static const char *at(uintptr_t address) {
    const char *text_there = NULL;
    memcpy(&text_there, &address, sizeof text_there);
    return text_there;
}

static void texts_are_copied_as_far_as_they_fit(void) {
    TEST_ASSERT_EQUAL_STRING("omega", copy("omega", sizeof text));
    TEST_ASSERT_EQUAL_STRING("om", copy("omega", 3));
    TEST_ASSERT_EQUAL_STRING("", copy("omega", 1));
    TEST_ASSERT_EQUAL_STRING("", copy(NULL, sizeof text));
}

static void texts_that_are_nowhere_are_not_read(void) {
    TEST_ASSERT_EQUAL_STRING("(unreadable)", copy(NOWHERE, sizeof text));
    TEST_ASSERT_EQUAL_STRING("(unreadable)", copy(at(UINTPTR_MAX / 2 + 12345), sizeof text));
    TEST_ASSERT_EQUAL_STRING("(unreadable)", copy(at(UINTPTR_MAX), sizeof text));
    TEST_ASSERT_EQUAL_STRING("(unr", copy(NOWHERE, 5));
}

/* A text without a terminator, before memory that cannot be read. */
static void a_text_is_read_up_to_the_end_of_its_memory(void) {
    size_t page = (size_t)sysconf(_SC_PAGESIZE);
    char *memory = aligned_alloc(page, 2 * page);
    TEST_ASSERT_NOT_NULL(memory);
    TEST_ASSERT_EQUAL_INT(0, mprotect(memory + page, page, PROT_NONE));
    memset(memory, 'y', page);
    for (size_t length = 1; length < 20; length++) {
        (void)copy(memory + page - length, sizeof text);
        TEST_ASSERT_EQUAL_size_t(length, strlen(text));
    }
    TEST_ASSERT_EQUAL_STRING("<yyyyyyyyy>", format("<%s>", memory + page - 9));
    TEST_ASSERT_EQUAL_INT(0, mprotect(memory + page, page, PROT_READ | PROT_WRITE));
    free(memory);
}

static void conversions_are_those_of_printf(void) {
    char expected[256];
    TEST_ASSERT_EQUAL_STRING("plain", format("plain"));
    TEST_ASSERT_EQUAL_STRING("100 %", format("100 %%"));
    (void)snprintf(expected, sizeof expected, "%d|%5d|%-5d|%05d|%+d|%x|%#X|%o|%u|%c", -1, 2, 3, 4, 5, 255U, 255U, 8U,
                   9U, 'z');
    TEST_ASSERT_EQUAL_STRING(expected,
                             format("%d|%5d|%-5d|%05d|%+d|%x|%#X|%o|%u|%c", -1, 2, 3, 4, 5, 255U, 255U, 8U, 9U, 'z'));
    (void)snprintf(expected, sizeof expected, "%ld %lld %zu %jd %td %hd %hhd %llx", -1L, -2LL, (size_t)3, (intmax_t)4,
                   (ptrdiff_t)5, (short)6, (signed char)7, 0xFFFFFFFFFFULL);
    TEST_ASSERT_EQUAL_STRING(expected, format("%ld %lld %zu %jd %td %hd %hhd %llx", -1L, -2LL, (size_t)3, (intmax_t)4,
                                              (ptrdiff_t)5, 6, 7, 0xFFFFFFFFFFULL));
    (void)snprintf(expected, sizeof expected, "%g %.3f %10.2e %a %Lf %p", 0.1, 2.0 / 3.0, 12345.678, 1.5, 2.5L,
                   (void *)text);
    TEST_ASSERT_EQUAL_STRING(expected,
                             format("%g %.3f %10.2e %a %Lf %p", 0.1, 2.0 / 3.0, 12345.678, 1.5, 2.5L, (void *)text));
    TEST_ASSERT_EQUAL_STRING("[  ab|ab  |a|ab]", format("[%4s|%-4s|%.1s|%s]", "ab", "ab", "ab", "ab"));
    TEST_ASSERT_EQUAL_STRING("[  ab| 1.50|ab   |a]",
                             format("[%*s|%*.*f|%*s|%.*s]", 4, "ab", 5, 2, 1.5, -5, "ab", 1, "ab"));
    TEST_ASSERT_EQUAL_STRING("5 x 1.500000",
                             format("%.*d %s %.*f", -1, 5, "x", -3, 1.5)); /* a negative precision is ignored */
    TEST_ASSERT_EQUAL_STRING("1099511627776 1099511627776", format("%qd %Ld", 1LL << 40, 1LL << 40));
    errno = ENOENT;
    (void)snprintf(expected, sizeof expected, "open: %s", strerror(ENOENT));
    TEST_ASSERT_EQUAL_STRING(expected, format("open: %m"));
    TEST_ASSERT_EQUAL_INT(ENOENT, errno);
}

/* Missing arguments: the process must not crash. */
static void arguments_that_are_not_there_do_no_harm(void) {
    (void)format("%s");
    (void)format("%s %s %s %s %s %s %s %s %s %s %s %s %s %s %s %s");
    (void)format("%d %f %s %ld %s %Lf %s %s %c %p %s %s");
    (void)format("%1000000s %.1000000f %*.*s", 1 << 30, 1 << 30, "x");
    TEST_ASSERT_EQUAL_STRING("(null)", format("%s", (char *)NULL));
    TEST_ASSERT_EQUAL_STRING("a (unreadable) b", format("a %s b", NOWHERE));
    TEST_ASSERT_EQUAL_STRING("(unreadable)", format(NOWHERE));
    TEST_ASSERT_EQUAL_STRING("", format(NULL));
    TEST_ASSERT_EQUAL_STRING("? ?", format("%ls %S", NOWHERE, NOWHERE));
    TEST_ASSERT_EQUAL_STRING("a?b", format("a%lcb", (wint_t)0x10FFFF));
}

static void what_is_no_format_is_a_text(void) {
    static const char *const texts[] = {"100%", "5 %y 3 %s", "1 %hld %s", "%5$hhn", "a % b %ln", "100%next", "%"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        TEST_ASSERT_EQUAL_STRING(texts[i], format(texts[i]));
    }
}

static void long_messages_are_cut(void) {
    static char large[5000];
    char small[8];
    memset(large, 'x', sizeof large - 1);
    TEST_ASSERT_EQUAL_size_t(sizeof text - 1, strlen(format("%s", large)));
    TEST_ASSERT_EQUAL_size_t(sizeof text - 1, strlen(format(large)));
    TEST_ASSERT_EQUAL_size_t(sizeof text - 1, strlen(format("%900d%900d", 1, 2)));
    tl_fmu_message_copy(large, small, sizeof small);
    TEST_ASSERT_EQUAL_STRING("xxxxxxx", small);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(texts_are_copied_as_far_as_they_fit);
    RUN_TEST(texts_that_are_nowhere_are_not_read);
    RUN_TEST(a_text_is_read_up_to_the_end_of_its_memory);
    RUN_TEST(conversions_are_those_of_printf);
    RUN_TEST(arguments_that_are_not_there_do_no_harm);
    RUN_TEST(what_is_no_format_is_a_text);
    RUN_TEST(long_messages_are_cut);
    return UNITY_END();
}
