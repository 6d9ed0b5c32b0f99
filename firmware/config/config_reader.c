/* Configuration reader: reads values and reports problems: see config_reader.h. */
#include "firmware/config/config_reader.h"

#include <assert.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include "firmware/base/json.h"
#include "master/base/signal.h"
#include "master/base/text.h"

/* ---- config names ---- */

enum { NAME_CHARS = 63, FOUND = 128, EXPECTED = 160 };

/* ---- names ---- */

static bool is_name(const char *text, size_t size) {
    for (size_t i = 0; i < size; i++) {
        char c = text[i];
        bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
        if (!letter && (i == 0 || c < '0' || c > '9')) {
            return false;
        }
    }
    return size > 0 && size <= NAME_CHARS;
}

void tl_config_check_name(const tl_config_object *map, const cJSON *entry, const char *example) {
    if (!is_name(entry->string, strlen(entry->string))) {
        char shown[TL_JSON_SHOWN];
        char found[FOUND];
        tl_text_for_people(entry->string, shown, sizeof shown);
        (void)snprintf(found, sizeof found, "the name \"%s\"", shown);
        tl_config_wrong(map, entry->string, found, "at most 63 letters, digits and _, no digit first", example);
    }
}

bool tl_config_is_of_kind(const cJSON *entry, const char *const *kinds) {
    while (*kinds != NULL && cJSON_GetObjectItemCaseSensitive(entry, *kinds) == NULL) {
        kinds++;
    }
    return *kinds != NULL;
}

void tl_config_list_names(const char *what, const cJSON *section, const char *const *kinds, char *text, size_t size) {
    char name[TL_JSON_SHOWN];
    const char *before = ": one of ";
    const cJSON *entry = NULL;
    size_t used = (size_t)snprintf(text, size, "%s", what);
    cJSON_ArrayForEach(entry, section) {
        if (used < size && entry->string != NULL && (kinds == NULL || tl_config_is_of_kind(entry, kinds))) {
            tl_text_for_people(entry->string, name, sizeof name);
            used += (size_t)snprintf(text + used, size - used, "%s%s", before, name);
            before = ", ";
        }
    }
}

/* ---- references ---- */

static void report_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                             const char *expected, const char *example) {
    char shown[TL_JSON_SHOWN];
    char found[FOUND];
    tl_text_for_people(text, shown, sizeof shown);
    (void)snprintf(found, sizeof found, "\"%s\"", shown);
    tl_config_problem(reader, path, line, found, expected, example);
}

/* Checks that the section has the name before or after the dot. Otherwise the problem proposes the
 * nearest name, or all names. */
static void check_known(const tl_config_reader *reader, const char *path, size_t line, const char *text, bool signal) {
    char name[NAME_CHARS + 1];
    char variable[TL_JSON_SHOWN];
    char expected[EXPECTED];
    char example[EXPECTED];
    const char *what = signal ? "a signal of \"plant\"" : "a variable of one of \"components\"";
    const char *dot = strchr(text, '.');
    const cJSON *section = cJSON_GetObjectItemCaseSensitive(reader->root, signal ? "plant" : "components");
    (void)snprintf(name, sizeof name, "%.*s", signal ? NAME_CHARS : (int)(dot - text), signal ? dot + 1 : text);
    if (!cJSON_IsObject(section) || cJSON_GetObjectItemCaseSensitive(section, name) != NULL) {
        return;
    }
    /* Compares with no more keys than a valid section has, to limit the time for a hostile file. */
    tl_nearest nearest = {.text = name};
    size_t left = TL_MAX_SIGNALS;
    for (const cJSON *entry = section->child; entry != NULL && left > 0; entry = entry->next, left--) {
        tl_nearest_offer(&nearest, entry->string);
    }
    if (nearest.best == NULL) {
        tl_config_list_names(what, section, NULL, expected, sizeof expected);
        report_reference(reader, path, line, text, expected, NULL);
        return;
    }
    tl_text_for_people(dot + 1, variable, sizeof variable);
    (void)snprintf(example, sizeof example, "\"%s.%s\"", signal ? "plant" : nearest.best,
                   signal ? nearest.best : variable);
    report_reference(reader, path, line, text, what, example);
}

/* Form: NAME.anything, or plant.NAME. */
static bool has_shape(const char *text, bool signal) {
    const char *dot = strchr(text, '.');
    return dot != NULL && is_name(text, (size_t)(dot - text)) && dot[1] != '\0' && tl_text_is_plain(dot) &&
           (!signal || is_name(dot + 1, strlen(dot + 1)));
}

void tl_config_check_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                               tl_config_target target) {
    static const char *const shapes[] = {[TL_CONFIG_VARIABLE] = "component.variable",
                                         [TL_CONFIG_SIGNAL] = "a signal of the plant",
                                         [TL_CONFIG_EITHER] = "component.variable or plant.signal"};
    bool signal = strncmp(text, "plant.", strlen("plant.")) == 0;
    if (!has_shape(text, signal) || (target == TL_CONFIG_SIGNAL && !signal)) {
        report_reference(reader, path, line, text, shapes[target],
                         target == TL_CONFIG_SIGNAL ? "\"plant.omega\"" : "\"motor.omega\"");
    } else if (target == TL_CONFIG_VARIABLE && signal) {
        report_reference(reader, path, line, text,
                         "component.variable (a pair is [from, to], and twinlock cannot write to the plant)",
                         "\"motor.omega\"");
    } else {
        check_known(reader, path, line, text, signal);
    }
}

void tl_config_check_reference_of(const tl_config_object *object, const char *key, const char *text,
                                  tl_config_target target) {
    char path[TL_JSON_PATH];
    tl_json_member_path(path, object->path, key);
    tl_config_check_reference(object->reader, path, tl_json_line(cJSON_GetObjectItemCaseSensitive(object->json, key)),
                              text, target);
}

/* ---- Typed access to cJSON items; tl_config_problem() reports every problem. */

enum { EXPECTED_READER = 320 };

/* ---- problems ---- */

void tl_config_problem(const tl_config_reader *reader, const char *path, size_t line, const char *found,
                       const char *expected, const char *example) {
    tl_report_add(reader->report, TL_BAD_DATA, path, "line %zu: found %s, expected %s%s%s", line, found, expected,
                  example != NULL ? ", for example " : "", example != NULL ? example : "");
}

static void describe(const cJSON *item, char *found, size_t size) {
    char shown[TL_JSON_SHOWN];
    if (cJSON_IsString(item)) {
        tl_text_for_people(item->valuestring, shown, sizeof shown);
        (void)snprintf(found, size, "\"%s\" (text)", shown);
    } else if (cJSON_IsNumber(item)) {
        (void)snprintf(found, size, "%.15g (number)", item->valuedouble);
    } else if (cJSON_IsBool(item)) {
        (void)snprintf(found, size, "%s", cJSON_IsTrue(item) ? "true" : "false");
    } else if (cJSON_IsObject(item)) {
        int count = cJSON_GetArraySize(item);
        (void)snprintf(found, size, "an object with %d key%s", count, count == 1 ? "" : "s");
    } else if (cJSON_IsArray(item)) {
        (void)snprintf(found, size, "an array of %d", cJSON_GetArraySize(item));
    } else {
        (void)snprintf(found, size, "null");
    }
}

void tl_config_wrong_item(const tl_config_reader *reader, const cJSON *item, const char *path, const char *found,
                          const char *expected, const char *example) {
    char described[FOUND];
    describe(item, described, sizeof described);
    tl_config_problem(reader, path, tl_json_line(item), found != NULL ? found : described, expected, example);
}

void tl_config_wrong(const tl_config_object *object, const char *key, const char *found, const char *expected,
                     const char *example) {
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object->json, key);
    char path[TL_JSON_PATH];
    tl_json_member_path(path, object->path, key);
    tl_config_wrong_item(object->reader, item != NULL ? item : object->json, path,
                         found == NULL && item == NULL ? "nothing" : found, expected, example);
}

/* ---- memory ---- */

void *tl_config_allocate(tl_config_reader *reader, size_t count, size_t size) {
    void *memory = tl_arena_take(reader->arena, count, size);
    reader->out_of_memory = reader->out_of_memory || memory == NULL;
    return memory;
}

const char *tl_config_copy_path(tl_config_reader *reader, const char *path) {
    const char *kept = tl_arena_text(reader->arena, path);
    reader->out_of_memory = reader->out_of_memory || kept == NULL;
    return kept != NULL ? kept : "";
}

/* ---- objects ---- */

static void begin(tl_config_object *object, tl_config_reader *reader) {
    object->reader = reader;
    object->json = NULL;
    object->path[0] = '\0';
    object->known_count = 0;
}

void tl_config_root(tl_config_reader *reader, tl_config_object *root) {
    begin(root, reader);
    if (cJSON_IsObject(reader->root)) {
        root->json = reader->root;
    } else {
        tl_config_wrong_item(reader, reader->root, "", NULL, "an object",
                             "{\"twinlock\": 1, \"name\": \"motor bench\", …}");
    }
}

static bool is_known(const tl_config_object *object, const char *key) {
    for (size_t i = 0; i < object->known_count; i++) {
        if (strcmp(object->known[i], key) == 0) {
            return true;
        }
    }
    return false;
}

const cJSON *tl_config_get(tl_config_object *object, const char *key, tl_config_need need, const char *expected,
                           const char *example) {
    if (!is_known(object, key)) {
        assert(object->known_count < TL_CONFIG_KEYS);
        object->known[object->known_count++] = key;
    }
    if (object->json == NULL) {
        return NULL;
    }
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(object->json, key);
    if (item == NULL && need == TL_CONFIG_REQUIRED) {
        tl_config_wrong(object, key, NULL, expected, example);
    }
    return item;
}

const cJSON *tl_config_get_array(tl_config_object *object, const char *key, const char *expected, const char *example) {
    const cJSON *item = tl_config_get(object, key, TL_CONFIG_OPTIONAL, expected, example);
    if (item != NULL && !cJSON_IsArray(item)) {
        tl_config_wrong(object, key, NULL, expected, example);
        return NULL;
    }
    return item;
}

bool tl_config_member(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                      tl_config_object *member) {
    begin(member, object->reader);
    tl_json_member_path(member->path, object->path, key);
    const cJSON *item = tl_config_get(object, key, need, "an object", example);
    return item != NULL && tl_config_entry(object, item, example, member);
}

bool tl_config_entry(const tl_config_object *map, const cJSON *item, const char *example, tl_config_object *entry) {
    begin(entry, map->reader);
    tl_json_member_path(entry->path, map->path, item->string);
    if (cJSON_IsObject(item)) {
        entry->json = item;
        return true;
    }
    tl_config_wrong(map, item->string, NULL, "an object", example);
    return false;
}

size_t tl_config_entries(tl_config_object *object, const char *key, const tl_config_map *rule, tl_config_object *map) {
    char expected[EXPECTED_READER];
    if (rule->most == SIZE_MAX) {
        (void)snprintf(expected, sizeof expected, "an object");
    } else {
        (void)snprintf(expected, sizeof expected, "an object with %zu to %zu entries", rule->least, rule->most);
    }
    begin(map, object->reader);
    tl_json_member_path(map->path, object->path, key);
    const cJSON *item = tl_config_get(object, key, rule->need, expected, rule->example);
    if (item == NULL) {
        return 0;
    }
    size_t count = (size_t)cJSON_GetArraySize(item);
    if (!cJSON_IsObject(item) || count < rule->least || count > rule->most) {
        tl_config_wrong(object, key, NULL, expected, rule->example);
    }
    if (!cJSON_IsObject(item)) {
        return 0;
    }
    map->json = item;
    return count;
}

void *tl_config_take_entries(tl_config_object *object, const char *key, const tl_config_map *rule, size_t size,
                             tl_config_object *map, size_t *count) {
    *count = tl_config_entries(object, key, rule, map);
    void *entries = tl_config_allocate(object->reader, *count, size);
    if (entries == NULL) {
        map->json = NULL;
        *count = 0;
    }
    return entries;
}

void tl_config_each(const tl_config_object *map,
                    void (*read)(const tl_config_object *map, const cJSON *item, size_t index, void *context),
                    void *context) {
    size_t index = 0;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map->json) {
        read(map, item, index, context);
        index++;
    }
}

/* ---- unknown keys ---- */

/* Keys that are often one level too high. */
static const char *find_right_object(const char *key) {
    static const char *const places[][2] = {
        {"tolerance", "synchronise.match.OUTPUT"}, {"weight", "synchronise.match.OUTPUT"},
        {"step", "synchronise.adjust.VARIABLE"},   {"nominal", "synchronise.adjust.VARIABLE"},
        {"prediction", "synchronise.horizon"},     {"measurements", "synchronise.horizon"},
        {"evaluations", "synchronise.budget"},     {"time_s", "synchronise.budget"},
        {"address", "plant.SIGNAL.modbus"},        {"scale", "the signal's modbus, can or csv"},
        {"host", "sources.NAME.modbus_tcp"},       {"port", "sources.NAME.modbus_tcp"},
    };
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        if (strcmp(key, places[i][0]) == 0) {
            return places[i][1];
        }
    }
    return NULL;
}

static void report_unknown_key(const tl_config_object *object, const cJSON *item) {
    char path[TL_JSON_PATH];
    char key[TL_JSON_SHOWN];
    char found[FOUND];
    char expected[EXPECTED_READER];
    tl_nearest nearest = {.text = item->string};
    for (size_t i = 0; i < object->known_count; i++) {
        tl_nearest_offer(&nearest, object->known[i]);
    }
    tl_json_member_path(path, object->path, item->string);
    tl_text_for_people(item->string, key, sizeof key);
    (void)snprintf(found, sizeof found, "the unknown key \"%s\"", key);
    const char *right = find_right_object(item->string);
    if (nearest.best != NULL) {
        (void)snprintf(expected, sizeof expected, "\"%s\"", nearest.best);
    } else {
        size_t used = (size_t)snprintf(expected, sizeof expected, "%s%s%s%s", right != NULL ? "it in " : "",
                                       right != NULL ? right : "", right != NULL ? "; here " : "",
                                       object->known_count == 1 ? "only" : "one of");
        for (size_t i = 0; i < object->known_count && used < sizeof expected; i++) {
            used +=
                (size_t)snprintf(expected + used, sizeof expected - used, "%s %s", i == 0 ? "" : ",", object->known[i]);
        }
    }
    tl_config_problem(object->reader, path, tl_json_line(item), found, expected, NULL);
}

void tl_config_done(const tl_config_object *object) {
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, object->json) {
        if (!is_known(object, item->string)) {
            report_unknown_key(object, item);
        }
    }
}

/* ---- values ---- */

/* Writes "a whole number from 1 to 65535", "a number > 0, at most 1e+09", "a number". */
static void describe_range(const tl_config_number *rule, char *expected, size_t size) {
    char low[64] = "";
    char high[64] = "";
    if (rule->minimum > -HUGE_VAL) {
        (void)snprintf(low, sizeof low, "%s%.15g", rule->above ? " > " : " from ", rule->minimum);
    }
    if (rule->maximum < HUGE_VAL) {
        const char *word = rule->below ? " to below " : rule->above ? ", at most " : " to ";
        (void)snprintf(high, sizeof high, "%s%.15g", word, rule->maximum);
    } else if (rule->minimum > -HUGE_VAL && !rule->above) {
        (void)snprintf(high, sizeof high, " up");
    }
    (void)snprintf(expected, size, "a %snumber%s%s", rule->whole ? "whole " : "", low, high);
}

bool tl_config_get_number(tl_config_object *object, const char *key, const tl_config_number *rule, double *value) {
    char expected[EXPECTED_READER];
    if (rule->expected != NULL) {
        (void)snprintf(expected, sizeof expected, "%s", rule->expected);
    } else {
        describe_range(rule, expected, sizeof expected);
    }
    const cJSON *item = tl_config_get(object, key, rule->need, expected, rule->example);
    if (item == NULL) {
        return false;
    }
    double number = item->valuedouble;
    bool low = rule->above ? number > rule->minimum : number >= rule->minimum;
    bool high = rule->below ? number < rule->maximum : number <= rule->maximum;
    if (!cJSON_IsNumber(item) || !low || !high || (rule->whole && number != floor(number))) {
        tl_config_wrong(object, key, NULL, expected, rule->example);
        return false;
    }
    *value = number;
    return true;
}

bool tl_config_get_count(tl_config_object *object, const char *key, const tl_config_number *rule, uint32_t *value) {
    double number = 0;
    bool right = tl_config_get_number(object, key, rule, &number);
    *value = right ? (uint32_t)number : *value;
    return right;
}

bool tl_config_get_duration(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                            tl_time *value) {
    const tl_config_number rule = {.need = need,
                                   .above = true,
                                   .maximum = TL_CONFIG_LONGEST_S,
                                   .expected = TL_CONFIG_DURATION,
                                   .example = example};
    double seconds = 0;
    bool right = tl_config_get_number(object, key, &rule, &seconds);
    *value = right ? tl_config_duration(seconds) : *value;
    return right;
}

void tl_config_get_scale(tl_config_object *object, double *scale, double *offset) {
    static const tl_config_number any = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0.1"};
    *scale = 1;
    if (tl_config_get_number(object, "scale", &any, scale) && *scale == 0) {
        tl_config_wrong(object, "scale", NULL, "a number other than 0", "0.1");
    }
    (void)tl_config_get_number(object, "offset", &any, offset);
}

bool tl_config_get_boolean(tl_config_object *object, const char *key, bool *value) {
    const cJSON *item = tl_config_get(object, key, TL_CONFIG_OPTIONAL, "true or false", NULL);
    if (item == NULL) {
        return false;
    }
    if (!cJSON_IsBool(item)) {
        tl_config_wrong(object, key, NULL, "true or false", "true");
        return false;
    }
    *value = cJSON_IsTrue(item);
    return true;
}

bool tl_config_get_text(tl_config_object *object, const char *key, tl_config_need need, const char *example,
                        const char **value) {
    const cJSON *item = tl_config_get(object, key, need, "a text", example);
    if (item == NULL) {
        return false;
    }
    bool text = cJSON_IsString(item);
    if (text && item->valuestring[0] == '\0' && need != TL_CONFIG_MAY_BE_EMPTY) {
        tl_config_wrong(object, key, NULL, "a text that is not empty", example);
        return false;
    }
    if (!text || !tl_text_is_plain(item->valuestring)) {
        tl_config_wrong(object, key, NULL, text ? "a text without control characters" : "a text", example);
        return false;
    }
    *value = item->valuestring;
    return true;
}

bool tl_config_get_choice(tl_config_object *object, const char *key, tl_config_need need, const char *const *choices,
                          size_t *index) {
    char expected[EXPECTED_READER] = "";
    char quoted[TL_JSON_SHOWN];
    size_t used = 0;
    for (size_t i = 0; choices[i] != NULL && used < sizeof expected; i++) {
        const char *before = i == 0 ? "" : choices[i + 1] == NULL ? " or " : ", ";
        used += (size_t)snprintf(expected + used, sizeof expected - used, "%s\"%s\"", before, choices[i]);
    }
    (void)snprintf(quoted, sizeof quoted, "\"%s\"", choices[0]);
    const char *example = choices[1] != NULL ? quoted : NULL; /* a single choice needs no example */
    const cJSON *item = tl_config_get(object, key, need, expected, example);
    if (item == NULL) {
        return false;
    }
    for (size_t i = 0; cJSON_IsString(item) && choices[i] != NULL; i++) {
        if (strcmp(item->valuestring, choices[i]) == 0) {
            *index = i;
            return true;
        }
    }
    tl_config_wrong(object, key, NULL, expected, example);
    return false;
}
