/* Names in a configuration: allowed characters, references, and lists of names in messages. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/config/config_reader.h"
#include "tests/support/message.h"

static tl_report report;

void setUp(void) {
    report = (tl_report){.add = NULL};
}

void tearDown(void) {}

/* Returns the number of problems of a configuration with one entry of that name. */
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

/* Returns the number of problems of a reference. The configuration has the component motor and the
 * signal omega. */
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

/* Lists the entries of `json`, or those of one kind, in a buffer of `size` bytes. */
static const char *listed(const char *json, const char *kind, size_t size) {
    static char text[64];
    const char *const kinds[] = {"none", kind, NULL};
    cJSON *section = cJSON_Parse(json);
    tl_config_list_names("signal", section, kind != NULL ? kinds : NULL, text, size);
    cJSON_Delete(section);
    TEST_ASSERT_LESS_THAN_size_t(size, strlen(text));
    return text;
}

static void test_lists_of_names(void) {
    TEST_ASSERT_EQUAL_STRING("signal", listed("{}", NULL, 64));
    TL_EXPECT_PARTS("signal|i", listed("{\"i\": 1}", NULL, 64));
    TL_EXPECT_PARTS("signal|i|u", listed("{\"i\": 1, \"u\": 2}", NULL, 64));
}

static void test_lists_are_cut(void) {
    static const char json[] = "{\"i\": 1, \"u\": 2, \"t\": 3}";
    char whole[64];
    (void)snprintf(whole, sizeof whole, "%s", listed(json, NULL, sizeof whole));
    for (size_t size = 1; size <= strlen(whole); size++) {
        const char *text = listed(json, NULL, size);
        TEST_ASSERT_EQUAL_size_t(size - 1, strlen(text));
        TEST_ASSERT_EQUAL_STRING_LEN(whole, text, size - 1);
    }
}

static void test_lists_of_one_kind(void) {
    const char *text = listed("{\"i\": {\"x\": 1}, \"u\": {\"y\": 1}, \"t\": {\"x\": 1}}", "x", 64);
    TL_EXPECT_PARTS("signal|i|t", text);
    TEST_ASSERT_FALSE_MESSAGE(tl_test_has_parts(text, "u"), text);
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_names);
    RUN_TEST(test_references);
    RUN_TEST(test_lists_of_names);
    RUN_TEST(test_lists_are_cut);
    RUN_TEST(test_lists_of_one_kind);
    return UNITY_END();
}
