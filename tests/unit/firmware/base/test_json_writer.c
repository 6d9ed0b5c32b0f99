/* JSON output: exact bytes, or none if memory runs out. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>
#include <unity.h>

#include "firmware/base/json.h"
#include "tests/support/message.h"

static char printed[4096];
static tl_error error;

/* ---- memory that runs out ---- */

static long left; /* successful allocations before the one that fails; below 0: none fails */
static long held; /* allocations that are not freed yet */

static void *take(size_t size) {
    if (left == 0) {
        return NULL;
    }
    left -= left > 0 ? 1 : 0;
    held++;
    return malloc(size);
}

static void give_back(void *memory) {
    held -= memory == NULL ? 0 : 1;
    free(memory);
}

void setUp(void) {
    cJSON_Hooks hooks = {.malloc_fn = take, .free_fn = give_back};
    cJSON_InitHooks(&hooks);
    left = -1;
    held = 0;
    error = (tl_error){TL_OK, ""};
}

void tearDown(void) {
    cJSON_InitHooks(NULL);
    TEST_ASSERT_EQUAL_INT(0, held);
}

/* ---- what is written ---- */

static void fill_all_kinds(tl_json_writer *json) {
    tl_json_add_text(json, "nothing", NULL);
    tl_json_add_truth(json, "truth", true);
    tl_json_open_object(json, "numbers");
    tl_json_add_number(json, "tenth", 0.1);
    tl_json_add_number(json, "whole", -3.0);
    tl_json_add_count(json, "count", 4000000000000U);
    tl_json_close(json);
    tl_json_open_array(json, "list");
    tl_json_add_number(json, NULL, 1.5);
    tl_json_open_object(json, NULL);
    tl_json_add_text(json, "text", "a \"quote\", \n, ü");
    tl_json_close(json);
    tl_json_open_array(json, NULL);
    tl_json_close(json);
    tl_json_close(json);
    tl_json_add_members(json, "{\"first\": 1, \"second\": [true]}");
    tl_json_add_text(json, "after", NULL);
}

static tl_status print(void (*fill)(tl_json_writer *json)) {
    tl_json_writer json;
    FILE *file = tmpfile();
    TEST_ASSERT_NOT_NULL(file);
    tl_json_writer_begin(&json);
    fill(&json);
    tl_status status = tl_json_writer_print(&json, file, &error);
    tl_json_writer_free(&json);
    rewind(file);
    printed[fread(printed, 1, sizeof printed - 1, file)] = '\0';
    (void)fclose(file);
    return status;
}

static void test_all_kinds(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, print(fill_all_kinds));
    TEST_ASSERT_EQUAL_STRING("{\n"
                             "\t\"nothing\":\tnull,\n"
                             "\t\"truth\":\ttrue,\n"
                             "\t\"numbers\":\t{\n"
                             "\t\t\"tenth\":\t0.1,\n"
                             "\t\t\"whole\":\t-3,\n"
                             "\t\t\"count\":\t4000000000000\n"
                             "\t},\n"
                             "\t\"list\":\t[1.5, {\n"
                             "\t\t\t\"text\":\t\"a \\\"quote\\\", \\n, ü\"\n"
                             "\t\t}, []],\n"
                             "\t\"first\":\t1,\n"
                             "\t\"second\":\t[true],\n"
                             "\t\"after\":\tnull\n"
                             "}\n",
                             printed);
}

static void fill_extremes(tl_json_writer *json) {
    tl_json_add_number(json, "nan", (double)NAN);
    tl_json_add_number(json, "inf", (double)-INFINITY);
    tl_json_add_number(json, "third", 1.0 / 3.0);
    tl_json_add_number(json, "huge", 1e300);
    tl_json_add_number(json, "tiny", 4.9406564584124654e-324);
}

static void test_numbers(void) {
    TEST_ASSERT_EQUAL_INT(TL_OK, print(fill_extremes));
    TEST_ASSERT_EQUAL_STRING("{\n"
                             "\t\"nan\":\tnull,\n"
                             "\t\"inf\":\tnull,\n"
                             "\t\"third\":\t0.33333333333333331,\n"
                             "\t\"huge\":\t1e+300,\n"
                             "\t\"tiny\":\t4.94065645841247e-324\n"
                             "}\n",
                             printed);
}

static void fill_no_object(tl_json_writer *json) {
    tl_json_add_members(json, "[1]");
}

static void fill_half_an_object(tl_json_writer *json) {
    tl_json_add_members(json, "{\"a\": 1");
}

static void test_members_of_no_object(void) {
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, print(fill_no_object));
    TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, print(fill_half_an_object));
    TEST_ASSERT_EQUAL_STRING("", printed);
}

/* Whichever allocation fails: no output, and no object with a missing member. */
static void test_no_memory(void) {
    tl_status status = TL_TRY_AGAIN;
    long refused = 0;
    for (; status != TL_OK; refused++) {
        left = refused;
        status = print(fill_all_kinds);
        TEST_ASSERT_EQUAL_INT(0, held);
        if (status != TL_OK) {
            TEST_ASSERT_EQUAL_INT(TL_TRY_AGAIN, status);
            TL_EXPECT_PARTS("memory", error.text);
            TEST_ASSERT_EQUAL_STRING("", printed);
        }
    }
    TEST_ASSERT_GREATER_THAN_INT(20, refused);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_all_kinds);
    RUN_TEST(test_numbers);
    RUN_TEST(test_members_of_no_object);
    RUN_TEST(test_no_memory);
    return UNITY_END();
}
