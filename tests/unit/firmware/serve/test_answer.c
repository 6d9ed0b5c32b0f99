/* Replies as lines of JSON: each kind, with any texts; and the HTTP status of each result. */
#include "firmware/serve/dialogue.h"

#include <string.h>

#include <cjson/cJSON.h>
#include <unity.h>

#include "firmware/retune/control.h"

static char line[TL_ANSWER_LINE];

void setUp(void) {}

void tearDown(void) {}

/* Parses a reply's line, which has one newline at its end. */
static cJSON *object_of(const tl_control_reply *reply) {
    size_t length = tl_answer_line(reply, line);
    TEST_ASSERT_GREATER_THAN(0, length);
    TEST_ASSERT_EQUAL_size_t(length, strlen(line));
    TEST_ASSERT_EQUAL_CHAR('\n', line[length - 1]);
    TEST_ASSERT_EQUAL_PTR(&line[length - 1], strchr(line, '\n'));
    cJSON *object = cJSON_Parse(line);
    TEST_ASSERT_NOT_NULL(object);
    return object;
}

static void expect_text(const tl_control_reply *reply, const char *key, const char *wanted) {
    cJSON *object = object_of(reply);
    TEST_ASSERT_EQUAL_STRING(wanted, cJSON_GetStringValue(cJSON_GetObjectItem(object, key)));
    cJSON_Delete(object);
}

static void each_kind_says_what_it_is(void) {
    static const char *const names[TL_CONTROL_KINDS] = {"state",   "version", "version", "change",
                                                        "problem", "step",    "end"};
    for (uint32_t kind = 0; kind < TL_CONTROL_KINDS; kind++) {
        tl_control_reply reply = {.kind = kind};
        expect_text(&reply, "reply", names[kind]);
    }
}

static void results_are_words(void) {
    for (uint32_t result = 0; result < TL_CONTROL_RESULTS; result++) {
        tl_control_reply reply = {.kind = TL_CONTROL_END, .as.end.result = result};
        expect_text(&reply, "result", tl_control_result_name((tl_control_result)result));
        TEST_ASSERT_TRUE(tl_answer_status(result) >= TL_HTTP_OK);
    }
    TEST_ASSERT_EQUAL_INT(TL_HTTP_INVALID, tl_answer_status(TL_CONTROL_INVALID));
    TEST_ASSERT_EQUAL_INT(TL_HTTP_CHANGED, tl_answer_status(TL_CONTROL_CHANGED));
}

/* The longest texts, of characters with the longest escapes. */
static void the_longest_reply_fits(void) {
    static const char worst[] = {'\x01', '\\', '"', '\xff'};
    for (size_t i = 0; i < sizeof worst; i++) {
        tl_control_reply reply = {.kind = TL_CONTROL_PROBLEM};
        memset(reply.as.problem.path, worst[i], sizeof reply.as.problem.path - 1);
        memset(reply.as.problem.text, worst[i], sizeof reply.as.problem.text - 1);
        cJSON_Delete(object_of(&reply));
        reply = (tl_control_reply){.kind = TL_CONTROL_VERSION};
        memset(reply.as.version.who, worst[i], sizeof reply.as.version.who - 1);
        memset(reply.as.version.why, worst[i], sizeof reply.as.version.why - 1);
        memset(reply.as.version.result, worst[i], sizeof reply.as.version.result - 1);
        cJSON_Delete(object_of(&reply));
    }
}

static void texts_are_cleaned(void) {
    static const char dirty[] = {'a', '\x1b', '[', '2', 'J', '\xff', '\n', '\xe2', '\x80', '\xae', '\0'};
    tl_control_reply reply = {.kind = TL_CONTROL_STEP};
    memcpy(reply.as.progress.text, dirty, sizeof dirty);
    expect_text(&reply, "text", "a\\x1B[2J\\xFF\\x0A\\u{202E}");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(each_kind_says_what_it_is);
    RUN_TEST(results_are_words);
    RUN_TEST(the_longest_reply_fits);
    RUN_TEST(texts_are_cleaned);
    return UNITY_END();
}
