/* Lines of a box, in pieces of any size, for people and as they are. */
#include "firmware/push/push_lines.h"

#include <stdlib.h>
#include <string.h>

#include <unity.h>

static tl_push_lines lines;
static char *told;
static size_t size;

void setUp(void) {
    told = NULL;
}

void tearDown(void) {
    free(told);
}

/* What is told of `text`, which comes in pieces of so many bytes. */
static const char *tell(const char *text, bool as_json, size_t piece) {
    free(told);
    told = NULL;
    FILE *file = open_memstream(&told, &size);
    TEST_ASSERT_NOT_NULL(file);
    tl_push_lines_begin(&lines, file, as_json, "motor.json");
    for (size_t i = 0; i < strlen(text); i += piece) {
        size_t left = strlen(text) - i;
        tl_push_lines_take(&lines, text + i, left < piece ? left : piece);
    }
    (void)fclose(file);
    return told;
}

static void each_kind_for_people(void) {
    static const char text[] =
        "{\"reply\":\"step\",\"step\":\"probation\",\"left_s\":60,\"text\":\"in lock\"}\n"
        "{\"reply\":\"change\",\"path\":\"a.b\",\"before\":\"\",\"after\":\"2\",\"kind\":\"in place\",\"right\":\"retune\",\"more\":3}\n"
        "{\"reply\":\"change\",\"path\":\"c\",\"before\":\"1\",\"after\":\"2\",\"kind\":\"new twin\",\"right\":\"commission\",\"more\":0}\n"
        "{\"reply\":\"change\",\"path\":\"d\",\"before\":\"1\",\"after\":\"\",\"kind\":\"restart\",\"right\":\"on the box\",\"more\":0}\n"
        "{\"reply\":\"problem\",\"line\":7,\"path\":\"\",\"text\":\"\\u001b[2J\",\"more\":0}\n"
        "{\"reply\":\"of tomorrow\"}\n"
        "{\"reply\":\"end\",\"result\":\"done\",\"version\":2,\"hash\":\"\",\"text\":\"\"}\n";
    static const char wanted[] = "probation, 60 s left: in lock\n"
                                 "  a.b: nothing → 2 (in place)\n"
                                 "  and 3 more\n"
                                 "  c: 1 → 2 (new twin, takes the right to commission)\n"
                                 "  d: 1 → nothing (restart, on the box only)\n"
                                 "motor.json:7: \\x1B[2J\n"
                                 "done (version 2 is active)\n";
    for (size_t piece = 1; piece < sizeof text; piece += 13) {
        TEST_ASSERT_EQUAL_STRING(wanted, tell(text, false, piece));
        TEST_ASSERT_EQUAL_STRING("done", lines.result);
        TEST_ASSERT_EQUAL_STRING(text, tell(text, true, piece));
    }
}

static void what_is_missing_is_harmless(void) {
    static const char *const replies[] = {"step", "change", "problem", "state", "version", "end"};
    for (size_t i = 0; i < sizeof replies / sizeof replies[0]; i++) {
        char text[64];
        (void)snprintf(text, sizeof text, "{\"reply\":\"%s\",\"version\":-1,\"step\":[]}\n", replies[i]);
        TEST_ASSERT_GREATER_THAN(0, strlen(tell(text, false, 1)));
        TEST_ASSERT_FALSE(lines.is_broken);
    }
}

static void what_is_no_object_ends_it(void) {
    static const char *const texts[] = {"hello\n{\"reply\":\"end\"}\n", "[]\n", "\n", "{\"a\":1} x\n",
                                        "{\"a\":\"\x1b\"}\n"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        TEST_ASSERT_EQUAL_STRING("", tell(texts[i], i % 2 == 0, 5));
        TEST_ASSERT_TRUE(lines.is_broken);
        TEST_ASSERT_EQUAL_STRING("", lines.result);
    }
}

static void a_line_without_an_end(void) {
    char *text = malloc(TL_PUSH_LINE + 2);
    TEST_ASSERT_NOT_NULL(text);
    memset(text, ' ', TL_PUSH_LINE + 1);
    text[TL_PUSH_LINE + 1] = '\0';
    TEST_ASSERT_EQUAL_STRING("", tell(text, false, 1000));
    TEST_ASSERT_TRUE(lines.is_broken);
    free(text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(each_kind_for_people);
    RUN_TEST(what_is_missing_is_harmless);
    RUN_TEST(what_is_no_object_ends_it);
    RUN_TEST(a_line_without_an_end);
    return UNITY_END();
}
