/* Parsed JSON documents: duplicate keys, line numbers, and conversion between items and paths. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <unity.h>

#include "firmware/config/json_document.h"
#include "tests/support/message.h"

enum { MAX_PROBLEMS = 8 };

typedef struct problem {
    char where[TL_JSON_PATH];
    char text[TL_ERROR_TEXT];
} problem;

static tl_arena arena;
static tl_report report;
static cJSON *root;
static problem problems[MAX_PROBLEMS];
static size_t problem_count;

static void add_problem(void *context, tl_status status, const char *where, const char *text) {
    (void)context;
    (void)status;
    TEST_ASSERT_LESS_THAN_size_t(MAX_PROBLEMS, problem_count);
    problem *new = &problems[problem_count++];
    (void)snprintf(new->where, sizeof new->where, "%s", where);
    (void)snprintf(new->text, sizeof new->text, "%s", text);
}

void setUp(void) {
    tl_arena_init(&arena);
    report = (tl_report){.add = add_problem};
    problem_count = 0;
    root = NULL;
}

void tearDown(void) {
    cJSON_Delete(root);
    tl_arena_release(&arena);
}

static tl_status parse(const char *text) {
    return tl_json_parse(text, strlen(text), &arena, &report, &root);
}

/* These problems concern the document, so their path is empty. */
static void expect_problem(size_t index, const char *parts) {
    TEST_ASSERT_LESS_THAN_size_t(problem_count, index);
    TEST_ASSERT_EQUAL_STRING("", problems[index].where);
    TL_EXPECT_PARTS(parts, problems[index].text);
}

static void test_syntax_error(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, parse("{\n\"a\": 01}"));
    TEST_ASSERT_NULL(root);
    TEST_ASSERT_EQUAL_size_t(1, problem_count);
    expect_problem(0, "line 2|column 6|01|number|JSON");
}

static void test_no_memory(void) {
    tl_arena_seal(&arena);
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, parse("{}"));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, report.first_status);
    TEST_ASSERT_NULL(root);
}

static void test_all_duplicates_with_their_lines(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA,
                          parse("{\"a\": 1,\n\"b\": {\"x\": 1,\n\"y\": 2, \"x\": 3},\n\"a\": 2,\n\"a\": 3}"));
    TEST_ASSERT_EQUAL_size_t(3, problem_count);
    expect_problem(0, "line 4|\"a\"|line 1");
    expect_problem(1, "line 5|\"a\"|line 1");
    expect_problem(2, "line 3|\"x\"|line 2");
    TEST_ASSERT_NOT_NULL(root);
}

static void test_duplicates_that_differ_by_escapes(void) {
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, parse("[0, {\"a\": 1, \"\\u0061\": 2}]"));
    TEST_ASSERT_EQUAL_size_t(1, problem_count);
    expect_problem(0, "line 1|\"a\"");
}

static void test_other_case_or_object_is_no_duplicate(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, parse("{\"a\": {\"a\": 1}, \"A\": {\"a\": 1}, \"\": [{\"a\": 1}, {\"a\": 1}]}"));
    TEST_ASSERT_EQUAL_size_t(0, problem_count);
    TEST_ASSERT_EQUAL_size_t(0, report.count);
}

/* The worst case for the search: all keys are duplicates. */
static void test_many_duplicates(void) {
    enum { COUNT = 40000, KEY = 6 };
    char *text = malloc((COUNT + 1) * KEY + 1);
    TEST_ASSERT_NOT_NULL(text);
    text[0] = '{';
    for (size_t i = 0; i < COUNT; i++) {
        memcpy(text + 1 + KEY * i, "\"k\":1,", KEY);
    }
    text[KEY * COUNT] = '}';
    text[KEY * COUNT + 1] = '\0';
    report.add = NULL;
    TEST_ASSERT_EQUAL_INT(TL_BAD_DATA, parse(text));
    TEST_ASSERT_EQUAL_size_t(COUNT - 1, report.count);
    free(text);
}

static size_t line_at(const char *path) {
    const cJSON *item = tl_json_nearest(root, path);
    return item != NULL ? tl_json_line(item) : 0;
}

static void test_lines_of_paths(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK,
                          parse("\n{\"plant\": {\n\"omega\": {\n\"min\": 1.5}},\n\"connect\": [\n[\"a\",\n\"b\"]],\n"
                                "\"adjust\": {\n\"motor.d\": {\n\"step\": 1},\n\"motor.d.x[1]\": {\n\"step\": "
                                "2},\n\"x[1]\": 3},\n\"end\": 4}"));
    TEST_ASSERT_EQUAL_size_t(2, line_at(""));
    TEST_ASSERT_EQUAL_size_t(2, line_at("plant"));
    TEST_ASSERT_EQUAL_size_t(3, line_at("plant.omega"));
    TEST_ASSERT_EQUAL_size_t(4, line_at("plant.omega.min"));
    TEST_ASSERT_EQUAL_size_t(5, line_at("connect"));
    TEST_ASSERT_EQUAL_size_t(6, line_at("connect[0]"));
    TEST_ASSERT_EQUAL_size_t(7, line_at("connect[0][1]"));
    TEST_ASSERT_EQUAL_size_t(9, line_at("adjust.motor.d"));
    TEST_ASSERT_EQUAL_size_t(10, line_at("adjust.motor.d.step"));
    TEST_ASSERT_EQUAL_size_t(11, line_at("adjust.motor.d.x[1]"));
    TEST_ASSERT_EQUAL_size_t(12, line_at("adjust.motor.d.x[1].step"));
    TEST_ASSERT_EQUAL_size_t(13, line_at("adjust.x[1]"));
    TEST_ASSERT_EQUAL_size_t(14, line_at("end"));
}

static void test_lines_of_missing_paths(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, parse("{\"plant\":\n {\"omega\":\n {}},\n \"connect\":\n [[\"a\"]]}"));
    TEST_ASSERT_EQUAL_size_t(3, line_at("plant.omega.unit"));
    TEST_ASSERT_EQUAL_size_t(2, line_at("plant.ome"));
    TEST_ASSERT_EQUAL_size_t(5, line_at("connect[1]"));
    TEST_ASSERT_EQUAL_size_t(5, line_at("connect[0][0].x"));
    TEST_ASSERT_EQUAL_size_t(5, line_at("connect[-1]"));
    TEST_ASSERT_EQUAL_size_t(5, line_at("connect[99999999999999999999]"));
    TEST_ASSERT_EQUAL_size_t(5, line_at("connect[0"));
    TEST_ASSERT_EQUAL_size_t(5, line_at("connect[]"));
    TEST_ASSERT_EQUAL_size_t(0, line_at("plan"));
    TEST_ASSERT_EQUAL_size_t(0, line_at("plants"));
    TEST_ASSERT_EQUAL_size_t(0, line_at("[0]"));
    TEST_ASSERT_EQUAL_size_t(0, line_at("."));
}

static void test_making_paths(void) {
    char path[TL_JSON_PATH] = "";
    tl_json_member_path(path, path, "plant");
    TEST_ASSERT_EQUAL_STRING("plant", path);
    tl_json_member_path(path, path, "a\x1B");
    TEST_ASSERT_EQUAL_STRING("plant.a\\x1B", path);
    tl_json_element_path(path, path, 12);
    TEST_ASSERT_EQUAL_STRING("plant.a\\x1B[12]", path);
}

static void test_paths_are_cut(void) {
    char path[TL_JSON_PATH];
    char key[2 * TL_JSON_PATH];
    memset(key, 'k', sizeof key);
    key[TL_JSON_PATH - 1] = '\0';
    tl_json_member_path(path, "", key);
    TEST_ASSERT_EQUAL_STRING(key, path);
    tl_json_member_path(path, "a", key);
    TEST_ASSERT_EQUAL_size_t(TL_JSON_PATH - 1, strlen(path));
    TEST_ASSERT_EQUAL_STRING("kk…", path + TL_JSON_PATH - 1 - 5);
    tl_json_element_path(path, path, 1);
    TEST_ASSERT_EQUAL_STRING("kk…", path + TL_JSON_PATH - 1 - 5);
}

/* ---- merge patch ---- */

static void expect_merged(const char *target, const char *patch, const char *wanted) {
    cJSON *object = cJSON_Parse(target);
    cJSON *change = cJSON_Parse(patch);
    TEST_ASSERT_TRUE(tl_json_merge(object, change));
    char *text = cJSON_PrintUnformatted(object);
    TEST_ASSERT_EQUAL_STRING(wanted, text);
    cJSON_free(text);
    cJSON_Delete(object);
    cJSON_Delete(change);
}

/* Cases as in the examples of RFC 7396. */
static void test_merge_patch(void) {
    expect_merged("{\"a\":1}", "{\"a\":2}", "{\"a\":2}");
    expect_merged("{\"a\":1}", "{\"b\":2.5}", "{\"a\":1,\"b\":2.5}");
    expect_merged("{\"a\":1,\"b\":2}", "{\"a\":null}", "{\"b\":2}");
    expect_merged("{}", "{\"a\":null}", "{}");
    expect_merged("{\"a\":[1]}", "{\"a\":[2,null]}", "{\"a\":[2,null]}");
    expect_merged("{\"a\":{\"b\":1,\"c\":2}}", "{\"a\":{\"b\":3,\"c\":null,\"d\":4}}", "{\"a\":{\"b\":3,\"d\":4}}");
    expect_merged("{\"a\":\"text\"}", "{\"a\":{\"b\":{\"c\":null}}}", "{\"a\":{\"b\":{}}}");
    expect_merged("{\"A\":1}", "{\"a\":2}", "{\"A\":1,\"a\":2}");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_syntax_error);
    RUN_TEST(test_no_memory);
    RUN_TEST(test_all_duplicates_with_their_lines);
    RUN_TEST(test_duplicates_that_differ_by_escapes);
    RUN_TEST(test_other_case_or_object_is_no_duplicate);
    RUN_TEST(test_many_duplicates);
    RUN_TEST(test_lines_of_paths);
    RUN_TEST(test_lines_of_missing_paths);
    RUN_TEST(test_making_paths);
    RUN_TEST(test_paths_are_cut);
    RUN_TEST(test_merge_patch);
    return UNITY_END();
}
