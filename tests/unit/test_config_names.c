/* Names in a configuration: which one was probably meant, and what a name may look like to its first and last letter. */
#include <stdio.h>
#include <string.h>

#include <unity.h>

#include "firmware/config_names.h"

static tl_report report;

void setUp(void) {
    report = (tl_report){.add = NULL};
}

void tearDown(void) {}

static void expect_distance(const char *text, const char *candidate, size_t distance) {
    tl_nearest nearest = {.text = text};
    tl_nearest_offer(&nearest, candidate);
    TEST_ASSERT_NOT_NULL_MESSAGE(nearest.best, text);
    TEST_ASSERT_EQUAL_STRING(candidate, nearest.best);
    TEST_ASSERT_EQUAL_size_t(distance, nearest.distance);
}

static void expect_far(const char *text, const char *candidate) {
    tl_nearest nearest = {.text = text};
    tl_nearest_offer(&nearest, candidate);
    TEST_ASSERT_NULL_MESSAGE(nearest.best, text);
}

static void test_one_edit(void) {
    expect_distance("name", "name", 0);
    expect_distance("NAME", "name", 0);
    expect_distance("Zone_az", "zONE_AZ", 0);
    expect_distance("nam", "name", 1);
    expect_distance("ame", "name", 1);
    expect_distance("names", "name", 1);
    expect_distance("xname", "name", 1);
    expect_distance("nome", "name", 1);
    expect_distance("anme", "name", 1);
    expect_distance("naem", "name", 1);
    expect_distance("nMae", "name", 1);
}

static void test_two_edits(void) {
    expect_distance("tolrnce", "tolerance", 2);
    expect_distance("xtolerancex", "tolerance", 2);
    expect_distance("otleranec", "tolerance", 2);
    expect_distance("toterance", "tolerance", 1);
}

static void test_too_far(void) {
    expect_far("toxxxance", "tolerance");
    expect_far("tolera", "tolerance");
    expect_far("tolerancexyz", "tolerance");
    expect_far("time", "file"); /* 2 of 4 */
    expect_far("mix", "me");
    expect_far("x", "to");
    expect_far("", "");
}

static void test_the_nearest_of_several(void) {
    static const char *const candidates[] = {"sources", "source_", "source", "sourse"};
    tl_nearest nearest = {.text = "sorce"};
    for (size_t i = 0; i < 4; i++) {
        tl_nearest_offer(&nearest, candidates[i]);
    }
    TEST_ASSERT_EQUAL_STRING("source", nearest.best);
    TEST_ASSERT_EQUAL_size_t(1, nearest.distance);
}

static void test_long_names(void) {
    char a[80];
    char b[80];
    memset(a, 'a', sizeof a);
    memset(b, 'a', sizeof b);
    a[63] = '\0';
    b[63] = '\0';
    b[62] = 'b';
    expect_distance(a, b, 1);
    a[63] = 'a';
    a[64] = '\0';
    expect_far(a, b);
    expect_far(b, a);
}

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
    char text[64];
    cJSON *section = cJSON_Parse(json);
    tl_config_list_names("a name", section, kind, text, size);
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
    RUN_TEST(test_one_edit);
    RUN_TEST(test_two_edits);
    RUN_TEST(test_too_far);
    RUN_TEST(test_the_nearest_of_several);
    RUN_TEST(test_long_names);
    RUN_TEST(test_names);
    RUN_TEST(test_references);
    RUN_TEST(test_lists_of_names);
    return UNITY_END();
}
