/* Differences between two JSON documents: values, whole parts, arrays, order; and documents that
 * are equal. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/config/json_difference.h"
#include "tests/support/message.h"

enum { MAX_LISTED = 8192 };

/* "path: before > after\n" for each difference, with two blanks in front if it is inside another
 * one. */
static char listed[MAX_LISTED];
static size_t count;
static tl_error error;

void setUp(void) {
    listed[0] = '\0';
    count = 0;
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {}

static void list_difference(const tl_json_difference *difference, void *context) {
    char path[TL_JSON_PATH];
    char before[TL_JSON_SHOWN];
    char after[TL_JSON_SHOWN];
    (void)context;
    tl_json_steps_path(path, difference->way, difference->depth);
    if (difference->is_order) {
        size_t end = strlen(listed);
        (void)snprintf(listed + end, sizeof listed - end, "%s: order\n", path);
        return;
    }
    tl_json_show(difference->before, before, sizeof before);
    tl_json_show(difference->after, after, sizeof after);
    size_t used = strlen(listed);
    (void)snprintf(listed + used, sizeof listed - used, "%s%s: %s > %s\n", difference->within ? "  " : "", path, before,
                   after);
    count++;
}

static tl_status compare(const char *before, const char *after) {
    tl_json_source a = {before, strlen(before), "first.json"};
    tl_json_source b = {after, strlen(after), "second.json"};
    return tl_json_compare(&a, &b, list_difference, NULL, &error);
}

static void expect(const char *before, const char *after, const char *expected) {
    setUp();
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, compare(before, after), error.text);
    TEST_ASSERT_EQUAL_STRING(expected, listed);
}

static void test_equal_documents(void) {
    expect("{}", "{}", "");
    expect("{\"a\": 1, \"b\": [1, {\"c\": null}]}", " {\"a\":1,\n\"b\":[1,{\"c\":null}] } ", "");
    expect("[5, 1e3, 0.5, \"\\u0041\"]", "[5.0, 1000, 5e-1, \"A\"]", "");
}

static void test_order(void) {
    expect("{\"x\": {\"z\": true, \"y\": false}}", "{\"x\": {\"y\": false, \"z\": true}}", "x: order\n");
    expect("{\"a\": 1, \"b\": [1, {\"c\": null}]}", " { \"b\":[1,{\"c\":null}],\n\"a\":1 } ", ": order\n");
    expect("{\"b\": 1, \"d\": 2, \"c\": 3}", "{\"a\": 0, \"b\": 1, \"c\": 3}", "a:  > 0\nd: 2 > \n");
    expect("{\"b\": 1, \"d\": 2, \"c\": 3}", "{\"c\": 4, \"a\": 0, \"b\": 1}", ": order\na:  > 0\nc: 3 > 4\nd: 2 > \n");
    expect("[{\"a\": 1, \"b\": 2}, 7]", "[{\"b\": 2, \"a\": 1}, 8]", "[1]: 7 > 8\n");
}

static void test_values(void) {
    expect("{\"a\": 1}", "{\"a\": 2}", "a: 1 > 2\n");
    expect("{\"a\": true}", "{\"a\": 1}", "a: true > 1\n");
    expect("{\"a\": null}", "{\"a\": false}", "a: null > false\n");
    expect("{\"a\": \"1\"}", "{\"a\": 1}", "a: \"1\" > 1\n");
    expect("{\"a\": \"x\"}", "{\"a\": \"y\"}", "a: \"x\" > \"y\"\n");
    expect("{\"a\": 0.1}", "{\"a\": 0.10000000000000002}", "a: 0.1 > 0.10000000000000002\n");
    expect("1", "2", ": 1 > 2\n");
}

static void test_zero_has_a_sign(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, compare("{\"a\": 0}", "{\"a\": -0.0}"));
    TEST_ASSERT_EQUAL_size_t(1, count);
}

static void test_added_and_removed_keys(void) {
    expect("{\"a\": 1}", "{\"b\": 1}", "a: 1 > \nb:  > 1\n");
    expect("{}", "{\"a\": null}", "a:  > null\n");
    expect("{\"a\": {\"x\": 1, \"z\": 3}}", "{\"a\": {\"x\": 1, \"y\": 2, \"z\": 3}}", "a.y:  > 2\n");
}

static void test_names_with_dots(void) {
    expect("{\"match\": {\"motor.omega\": {\"weight\": 1}}}", "{\"match\": {\"motor.omega\": {\"weight\": 2}}}",
           "match.motor.omega.weight: 1 > 2\n");
    expect("{\"a.b\": {\"c\": 1}, \"a\": {\"b.c\": 1}}", "{\"a.b\": {\"c\": 2}, \"a\": {\"b.c\": 1}}",
           "a.b.c: 1 > 2\n");
}

static void test_whole_parts(void) {
    expect("{}", "{\"a\": {\"b\": [1], \"c\": 2}}",
           "a:  > {\"b\":[1],\"c\":2}\n  a.b:  > [1]\n  a.b[0]:  > 1\n  a.c:  > 2\n");
    expect("{\"a\": {\"b\": 1}}", "{\"a\": 5}", "a: {\"b\":1} > 5\n  a.b: 1 > \n");
    expect("{\"a\": {\"b\": 1}, \"z\": 1}", "{\"a\": [7], \"z\": 2}",
           "a: {\"b\":1} > [7]\n  a.b: 1 > \n  a[0]:  > 7\nz: 1 > 2\n");
    expect("{\"a\": {}}", "{}", "a: {} > \n");
    expect("{\"a\": {}}", "{\"a\": []}", "a: {} > []\n");
}

static void test_arrays(void) {
    expect("[1, 2, 3]", "[1, 2, 3, 4]", "[3]:  > 4\n");
    expect("[1, 2, 3]", "[0, 1, 2, 3]", "[0]:  > 0\n");
    expect("[1, 2, 3]", "[1, 3]", "[1]: 2 > \n");
    expect("[1, 2, 3]", "[1, 3, 2]", "[1]: 2 > 3\n[2]: 3 > 2\n");
    expect("[1, 2, 3]", "[]", "[0]: 1 > \n[1]: 2 > \n[2]: 3 > \n");
    expect("[1, 1]", "[1, 1, 1]", "[2]:  > 1\n");
    expect("[1, 2, 3, 4]", "[1, 9, 4]", "[1]: 2 > 9\n[2]: 3 > \n");
}

static void test_arrays_in_arrays(void) {
    expect("{\"connect\": [[\"a\", \"b\"], [\"c\", \"d\"]]}",
           "{\"connect\": [[\"x\", \"y\"], [\"a\", \"b\"], [\"c\", \"e\"]]}",
           "connect[0][0]: \"a\" > \"x\"\nconnect[0][1]: \"b\" > \"y\"\nconnect[1][0]: \"c\" > \"a\"\n"
           "connect[1][1]: \"d\" > \"b\"\nconnect[2]:  > [\"c\",\"e\"]\n"
           "  connect[2][0]:  > \"c\"\n  connect[2][1]:  > \"e\"\n");
    expect("[[1, 2], [3]]", "[[0], [1, 2], [3]]", "[0]:  > [0]\n  [0][0]:  > 0\n");
    expect("[[1, 2], {\"a\": [3]}]", "[[1, 2], {\"a\": [3, 4]}]", "[1].a[1]:  > 4\n");
    expect("[[[1]], 2]", "[[[1], []], 2]", "[0][1]:  > []\n");
    expect("[[1], 2]", "[[], 2]", "[0][0]: 1 > \n");
}

/* The maximum depth of a document. */
static void test_depth(void) {
    char before[256];
    char after[256];
    int at = 0;
    for (int i = 0; i < 31; i++) {
        at += snprintf(before + at, sizeof before - (size_t)at, "{\"a\":");
    }
    (void)snprintf(before + at, sizeof before - (size_t)at, "{}");
    for (int i = 0; i < 31; i++) {
        (void)strncat(before, "}", sizeof before - strlen(before) - 1);
    }
    (void)snprintf(after, sizeof after, "%s", before);
    *strchr(strrchr(after, ':'), '{') = '[';
    *(strchr(after, '}')) = ']';
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, compare(before, after), error.text);
    TEST_ASSERT_EQUAL_size_t(1, count);
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, compare("{}", after), error.text);
    TEST_ASSERT_EQUAL_size_t(1 + 31, count);
}

/* The time for many keys and elements is not quadratic. Quadratic time would be a minute. */
static void test_size(void) {
    enum { KEYS = 40000, ROOM = KEYS * 20 };
    char *before = calloc(ROOM, 1);
    char *after = calloc(ROOM, 1);
    TEST_ASSERT_TRUE(before != NULL && after != NULL);
    char *a = before;
    char *b = after;
    for (int i = 0; i < KEYS; i++) {
        a += snprintf(a, 20, "%c\"k%d\":[%d]", i == 0 ? '{' : ',', i, i);
        b += snprintf(b, 20, "%c\"k%d\":[%d]", i == 0 ? '{' : ',', KEYS - 1 - i, KEYS - 1 - i);
    }
    (void)snprintf(a, 20, "}");
    (void)snprintf(b, 20, "}");
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, compare(before, after), error.text);
    TEST_ASSERT_EQUAL_STRING(": order\n", listed);
    setUp();
    memset(before, ' ', ROOM - 1);
    memset(after, ' ', ROOM - 1);
    for (int i = 0; i < KEYS; i++) {
        memcpy(before + 3 * (size_t)i, i == 0 ? "[1 " : ",1 ", 3);
        memcpy(after + 3 * (size_t)i, i == 0 ? "[1 " : i == KEYS / 2 ? ",2 " : ",1 ", 3);
    }
    before[3 * KEYS] = after[3 * KEYS] = ']';
    TEST_ASSERT_EQUAL_INT_MESSAGE(TL_OK, compare(before, after), error.text);
    TEST_ASSERT_EQUAL_STRING("[20000]: 1 > 2\n", listed);
    free(before);
    free(after);
}

static void test_invalid_json(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, compare("{", "{}"));
    TL_EXPECT_PARTS("first.json|JSON", error.text);
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, compare("{}", "{\"a\": 1,\n\"a\": 2, \"b\": 1, \"b\": 2}"));
    TL_EXPECT_PARTS("second.json|JSON", error.text);
    TEST_ASSERT_EQUAL_size_t(0, count);
}

static void test_displayed_values(void) {
    expect("{\"a\": 1}", "{\"a\": \"\\u202e\\n\"}", "a: 1 > \"\\u{202E}\\n\"\n");
    setUp();
    TEST_ASSERT_EQUAL_INT(
        TL_OK, compare("{}", "{\"a\": \"0123456789012345678901234567890123456789012345678901234567890123456789\"}"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(listed, "\xe2\x80\xa6\n"), listed);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_equal_documents);
    RUN_TEST(test_order);
    RUN_TEST(test_values);
    RUN_TEST(test_zero_has_a_sign);
    RUN_TEST(test_added_and_removed_keys);
    RUN_TEST(test_names_with_dots);
    RUN_TEST(test_whole_parts);
    RUN_TEST(test_arrays);
    RUN_TEST(test_arrays_in_arrays);
    RUN_TEST(test_depth);
    RUN_TEST(test_size);
    RUN_TEST(test_invalid_json);
    RUN_TEST(test_displayed_values);
    return UNITY_END();
}
