/* Reading a small object that may be damaged. */
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>
#include <unity.h>

#include "firmware/base/json.h"

static tl_json_reader reader;

void setUp(void) {}

void tearDown(void) {
    cJSON_InitHooks(NULL);
    tl_json_reader_free(&reader);
}

static void read_text(const char *text) {
    tl_json_reader_free(&reader);
    reader = tl_json_reader_of(text, strlen(text));
}

static void test_members(void) {
    read_text(
        "{\"n\": 7, \"zero\": 0, \"most\": 8999999999999999, \"x\": -0.5, \"yes\": true, \"no\": false, \"t\": \"a\\u00e9\"}");
    TEST_ASSERT_EQUAL_UINT64(7, tl_json_count(&reader, "n"));
    TEST_ASSERT_EQUAL_UINT64(0, tl_json_count(&reader, "zero"));
    TEST_ASSERT_EQUAL_UINT64(8999999999999999, tl_json_count(&reader, "most"));
    TEST_ASSERT_EQUAL_DOUBLE(-0.5, tl_json_number(&reader, "x"));
    TEST_ASSERT_TRUE(tl_json_truth(&reader, "yes"));
    TEST_ASSERT_FALSE(tl_json_truth(&reader, "no"));
    TEST_ASSERT_EQUAL_STRING("aé", tl_json_text(&reader, "t"));
    TEST_ASSERT_TRUE(reader.right);
}

/* The text needs no terminator. Bytes after it are not read. */
static void test_bytes_behind_the_text(void) {
    static const char text[] = "{\"n\": 7}8]";
    reader = tl_json_reader_of(text, sizeof text - 3);
    TEST_ASSERT_EQUAL_UINT64(7, tl_json_count(&reader, "n"));
    TEST_ASSERT_TRUE(reader.right);
}

static void test_numbers_that_are_wrong(void) {
    static const char *const texts[] = {"{}", "{\"n\": null}", "{\"n\": \"1\"}", "{\"n\": true}", "[1]"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        read_text(texts[i]);
        TEST_ASSERT_EQUAL_DOUBLE_MESSAGE(0.0, tl_json_number(&reader, "n"), texts[i]);
        TEST_ASSERT_FALSE_MESSAGE(reader.right, texts[i]);
    }
}

/* A member that is missing or invalid is read as a default. */
static void test_members_that_are_wrong(void) {
    static const char *const texts[] = {"{}",          "{\"N\": 1}",  "{\"n\": null}",
                                        "{\"n\": {}}", "{\"n\": -1}", "{\"n\": 9e15}"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        read_text(texts[i]);
        TEST_ASSERT_TRUE_MESSAGE(reader.right, texts[i]);
        TEST_ASSERT_EQUAL_UINT64_MESSAGE(0, tl_json_count(&reader, "n"), texts[i]);
        TEST_ASSERT_FALSE_MESSAGE(reader.right, texts[i]);
        read_text(texts[i]);
        TEST_ASSERT_FALSE_MESSAGE(tl_json_truth(&reader, "n"), texts[i]);
        TEST_ASSERT_FALSE_MESSAGE(reader.right, texts[i]);
        read_text(texts[i]);
        TEST_ASSERT_EQUAL_STRING_MESSAGE("", tl_json_text(&reader, "n"), texts[i]);
        TEST_ASSERT_FALSE_MESSAGE(reader.right, texts[i]);
    }
}

static void test_texts_that_are_no_object(void) {
    static const char *const texts[] = {"",
                                        "{\"n\": 1",
                                        "[1]",
                                        "1",
                                        "null",
                                        "{\"n\": 1} 2",
                                        "\xEF\xBB\xBF{\"n\": 1}",
                                        "{\"n\": 01}",
                                        "{\"n\": \"\xFF\"}"};
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        read_text(texts[i]);
        TEST_ASSERT_FALSE_MESSAGE(reader.right, texts[i]);
        (void)tl_json_count(&reader, "n");
        (void)tl_json_truth(&reader, "n");
        (void)tl_json_text(&reader, "n");
        TEST_ASSERT_FALSE_MESSAGE(reader.right, texts[i]);
    }
}

static void *refuse(size_t size) {
    (void)size;
    return NULL;
}

static void test_no_memory(void) {
    cJSON_Hooks hooks = {.malloc_fn = refuse, .free_fn = free};
    cJSON_InitHooks(&hooks);
    read_text("{\"n\": 1}");
    TEST_ASSERT_FALSE(reader.right);
    TEST_ASSERT_EQUAL_UINT64(0, tl_json_count(&reader, "n"));
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_members);
    RUN_TEST(test_bytes_behind_the_text);
    RUN_TEST(test_numbers_that_are_wrong);
    RUN_TEST(test_members_that_are_wrong);
    RUN_TEST(test_texts_that_are_no_object);
    RUN_TEST(test_no_memory);
    return UNITY_END();
}
