/* The table of change rules has a rule for each key of the schema, and for no other key. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cjson/cJSON.h>
#include <unity.h>

#include "firmware/config/config_change.h"
#include "firmware/config/drivers.h"
#include "tests/support/config_text.h"

enum { MOST_PLACES = 400, PATTERN = 200, STEPS = 16 };

/* A part of the schema, and the pattern of the keys that it describes. */
typedef struct place {
    const cJSON *schema;
    char pattern[PATTERN];
} place;

static cJSON *schema;
static place places[MOST_PLACES];
static size_t count;
static const tl_change_rule *used[MOST_PLACES];
static size_t used_count;

void setUp(void) {
    char *text = tl_test_read_text(TL_SOURCE_DIR "/config/schema/twinlock-1.json");
    TEST_ASSERT_NOT_NULL(text);
    schema = cJSON_Parse(text);
    free(text);
    TEST_ASSERT_NOT_NULL(schema);
    count = 0;
}

void tearDown(void) {
    cJSON_Delete(schema);
}

static const cJSON *member(const cJSON *object, const char *key) {
    return cJSON_GetObjectItemCaseSensitive(object, key);
}

static void add(const cJSON *part, const char *pattern, const char *separator, const char *key) {
    if (cJSON_IsObject(part)) {
        TEST_ASSERT_LESS_THAN_size_t(MOST_PLACES, count);
        places[count].schema = part;
        TEST_ASSERT_LESS_THAN_INT(PATTERN, snprintf(places[count].pattern, PATTERN, "%s%s%s", pattern, separator, key));
        count++;
    }
}

static void add_all(const cJSON *parts, const char *pattern, const char *separator, const char *key) {
    const cJSON *part = NULL;
    cJSON_ArrayForEach(part, parts) {
        add(part, pattern, separator, key != NULL ? key : part->string);
    }
}

/* Adds the parts of this part, and the alternatives that the schema gives for it. */
static void add_parts(const cJSON *part, const char *pattern) {
    static const char *const same[] = {"if", "then", "else"};
    static const char *const several[] = {"anyOf", "allOf", "oneOf"};
    const char *dot = pattern[0] == '\0' ? "" : ".";
    const cJSON *reference = member(part, "$ref");
    if (reference != NULL) {
        TEST_ASSERT_EQUAL_INT(0, strncmp(reference->valuestring, "#/$defs/", 8));
        const cJSON *meant = member(member(schema, "$defs"), reference->valuestring + 8);
        TEST_ASSERT_NOT_NULL_MESSAGE(meant, reference->valuestring);
        add(meant, pattern, "", "");
    }
    add_all(member(part, "properties"), pattern, dot, NULL);
    add(member(part, "additionalProperties"), pattern, dot, "*");
    add(member(part, "items"), pattern, "", "[]");
    add_all(member(part, "prefixItems"), pattern, "", "[]");
    for (size_t i = 0; i < 3; i++) {
        add(member(part, same[i]), pattern, "", "");
        add_all(member(part, several[i]), pattern, "", "");
    }
}

/* Replaces a * by a name with a dot, a blank and brackets. */
static size_t way_of(char *pattern, tl_json_step way[STEPS]) {
    static const char *const name = "motor.any name[0]";
    size_t depth = 0;
    while (pattern[0] != '\0') {
        TEST_ASSERT_LESS_THAN_size_t(STEPS, depth);
        if (pattern[0] == '[') {
            way[depth++] = (tl_json_step){NULL, 7};
            pattern += 2;
        } else {
            size_t length = strcspn(pattern, ".[");
            bool is_end = pattern[length] == '\0';
            way[depth++] = (tl_json_step){length == 1 && pattern[0] == '*' ? name : pattern, 0};
            if (pattern[length] == '[') { /* room for the NUL before the bracket */
                memmove(pattern + length + 1, pattern + length, strlen(pattern + length) + 1);
            }
            pattern[length] = '\0';
            pattern += length + (is_end ? 0 : 1);
        }
    }
    return depth;
}

static const tl_change_rule *rule_of(const char *pattern) {
    char copy[2 * PATTERN];
    tl_json_step way[STEPS];
    (void)snprintf(copy, sizeof copy, "%s", pattern);
    return tl_change_rule_of(way, way_of(copy, way));
}

static bool ends_with_stars(const char *pattern) {
    size_t length = strlen(pattern);
    return length > 2 && strcmp(pattern + length - 2, "**") == 0;
}

/* Returns true if the rule of an enclosing part covers this place and everything below it. */
static bool check_place(const char *pattern) {
    const tl_change_rule *rule = rule_of(pattern);
    TEST_ASSERT_NOT_NULL_MESSAGE(rule, pattern);
    TEST_ASSERT_LESS_THAN_size_t(MOST_PLACES, used_count);
    used[used_count++] = rule;
    if (!ends_with_stars(rule->pattern)) {
        TEST_ASSERT_EQUAL_STRING(rule->pattern, pattern);
        return false;
    }
    return strlen(pattern) > strlen(rule->pattern) - strlen(".**");
}

static bool is_used(const tl_change_rule *rule) {
    for (size_t i = 0; i < used_count; i++) {
        if (used[i] == rule) {
            return true;
        }
    }
    return false;
}

static void expect_used(const tl_change_rule *rule) {
    for (; rule->pattern != NULL; rule++) {
        TEST_ASSERT_TRUE_MESSAGE(is_used(rule), rule->pattern);
    }
}

static void test_each_key_of_the_schema_has_a_rule(void) {
    used_count = 0;
    add(schema, "", "", "");
    for (size_t i = 0; i < count; i++) {
        if (places[i].pattern[0] == '\0' || !check_place(places[i].pattern)) {
            add_parts(places[i].schema, places[i].pattern);
        }
    }
    TEST_ASSERT_GREATER_THAN_size_t(200, count);
    expect_used(tl_change_rules);
    for (const tl_driver *const *row = tl_drivers; *row != NULL; row++) {
        expect_used((*row)->rules);
    }
}

static void test_unknown_keys_have_no_rule(void) {
    static const char *const unknown[] = {"new_key",
                                          "plant.*.new_key",
                                          "synchronise.margin.deeper",
                                          "step_s[]",
                                          "components[]",
                                          "sources.*.opcua",
                                          "twinloc",
                                          "twinlock_",
                                          "delays_",
                                          "synchronise.match[]",
                                          "plant.*.modbuss"};
    for (size_t i = 0; i < sizeof unknown / sizeof unknown[0]; i++) {
        TEST_ASSERT_NULL_MESSAGE(rule_of(unknown[i]), unknown[i]);
    }
    const cJSON object = {.type = cJSON_Object};
    const cJSON array = {.type = cJSON_Array};
    tl_json_difference root = {.before = &object, .after = &array};
    tl_change_needs needs = tl_change_needs_of(&root);
    TEST_ASSERT_EQUAL_INT(TL_CHANGE_RESTART, needs.kind);
    TEST_ASSERT_EQUAL_INT(TL_RIGHT_COMMISSION, needs.right);
}

/* No other key is changed in place. */
static void test_keys_changed_in_place(void) {
    static const char *const in_place[] = {"$schema",
                                           "fill_in",
                                           "fill_in.*",
                                           "synchronise.adjust.*.nominal",
                                           "synchronise.adjust.*.min",
                                           "synchronise.adjust.*.max",
                                           "synchronise.adjust.*.approved",
                                           "synchronise.adjust.*.penalty",
                                           "synchronise.adjust.*.penalty.deviation",
                                           "synchronise.adjust.*.penalty.rate",
                                           "synchronise.match.*.tolerance",
                                           "synchronise.match.*.weight",
                                           "synchronise.match.*.huber",
                                           "synchronise.noise_floor",
                                           "synchronise.margin",
                                           "synchronise.budget",
                                           "synchronise.budget.evaluations",
                                           "synchronise.budget.time_s"};
    size_t found = 0;
    for (const tl_change_rule *rule = tl_change_rules; rule->pattern != NULL; rule++) {
        found += rule->needs.kind == TL_CHANGE_IN_PLACE ? 1 : 0;
    }
    TEST_ASSERT_EQUAL_size_t(sizeof in_place / sizeof in_place[0], found);
    for (size_t i = 0; i < found; i++) {
        TEST_ASSERT_EQUAL_INT_MESSAGE(TL_CHANGE_IN_PLACE, rule_of(in_place[i])->needs.kind, in_place[i]);
    }
}

int main(void) {
    UNITY_BEGIN();
    RUN_TEST(test_each_key_of_the_schema_has_a_rule);
    RUN_TEST(test_unknown_keys_have_no_rule);
    RUN_TEST(test_keys_changed_in_place);
    return UNITY_END();
}
