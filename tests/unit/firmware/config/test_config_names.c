/* Names in a configuration: what they may look like to their first and last letter, and what references lead to. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/config/config_reader.h"

static tl_report report;

void setUp(void) {
    report = (tl_report){.add = NULL};
}

void tearDown(void) {}

/* The number of problems of a file with one entry of that name. */
static size_t problems_of_name(const char *name) {
    cJSON *root = cJSON_CreateObject();
    TEST_ASSERT_NOT_NULL(cJSON_AddNumberToObject(root, name, 1));
    tl_config_reader reader = {.root = root, .report = &report};
    tl_config_object map = {.reader = &reader, .json = root};
    report.count = 0;
    tl_config_check_name(&map, root->child, NULL);
    cJSON_Delete(root);
    return report.count;
}

static void test_names(void) {
    static const char *const names[] = {"a", "z", "A", "Z", "_", "_0", "a0", "a9", "aZz_A"};
    static const char *const others[] = {"",   "0",  "9a",  "@",   "[",   "`", "{",
                                         "a/", "a:", "a b", "a.b", "a-b", "é", "a\n"};
    char name[65];
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++) {
        TEST_ASSERT_EQUAL_size_t_MESSAGE(0, problems_of_name(names[i]), names[i]);
    }
    for (size_t i = 0; i < sizeof others / sizeof others[0]; i++) {
        TEST_ASSERT_EQUAL_size_t_MESSAGE(1, problems_of_name(others[i]), others[i]);
    }
    memset(name, 'n', sizeof name);
    name[64] = '\0';
    TEST_ASSERT_EQUAL_size_t(1, problems_of_name(name));
    name[63] = '\0';
    TEST_ASSERT_EQUAL_size_t(0, problems_of_name(name));
}

/* The number of problems of a reference into a file with the component `motor` and the signal `omega`. */
static size_t problems_of_reference(const char *text, tl_config_target target) {
    cJSON *root = cJSON_Parse("{\"components\": {\"motor\": {}}, \"plant\": {\"omega\": {}}}");
    TEST_ASSERT_NOT_NULL(root);
    tl_config_reader reader = {.root = root, .report = &report};
    report.count = 0;
    tl_config_check_reference(&reader, "connect[0]", 1, text, target);
    cJSON_Delete(root);
    return report.count;
}

static void test_references(void) {
    TEST_ASSERT_EQUAL_size_t(0, problems_of_reference("motor.x", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(0, problems_of_reference("motor.x", TL_CONFIG_EITHER));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("motor.x", TL_CONFIG_SIGNAL));
    TEST_ASSERT_EQUAL_size_t(0, problems_of_reference("motor.a.b[1] = é", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("motor.a\n", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("Motor.x", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("motor.", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("motor", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference(".x", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("", TL_CONFIG_EITHER));
    TEST_ASSERT_EQUAL_size_t(0, problems_of_reference("plant.omega", TL_CONFIG_SIGNAL));
    TEST_ASSERT_EQUAL_size_t(0, problems_of_reference("plant.omega", TL_CONFIG_EITHER));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("plant.omega", TL_CONFIG_VARIABLE));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("plant.Omega", TL_CONFIG_SIGNAL));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("plant.omega.x", TL_CONFIG_SIGNAL));
    TEST_ASSERT_EQUAL_size_t(1, problems_of_reference("plant", TL_CONFIG_SIGNAL));
}

static void expect_list(const char *json, const char *kind, size_t size, const char *expected) {
    const char *const kinds[] = {"none", kind, NULL};
    char text[64];
    cJSON *section = cJSON_Parse(json);
    tl_config_list_names("a name", section, kind != NULL ? kinds : NULL, text, size);
    cJSON_Delete(section);
    TEST_ASSERT_EQUAL_STRING(expected, text);
}

static void test_lists_of_names(void) {
    expect_list("{}", NULL, 64, "a name");
    expect_list("{\"a\": 1}", NULL, 64, "a name: one of a");
    expect_list("{\"a\": 1, \"b\": 2}", NULL, 64, "a name: one of a, b");
    expect_list("{\"a\": {\"x\": 1}, \"b\": {\"y\": 1}, \"c\": {\"x\": 1}}", "x", 64, "a name: one of a, c");
    expect_list("{\"a\": 1, \"b\": 2, \"c\": 3}", NULL, 20, "a name: one of a, b");
    expect_list("{\"a\": 1, \"b\": 2}", NULL, 5, "a na");
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_names);
    RUN_TEST(test_references);
    RUN_TEST(test_lists_of_names);
    return UNITY_END();
}
