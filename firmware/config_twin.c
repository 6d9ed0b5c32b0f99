/* `components`, `connect`, `compare` and `synchronise`: what the twin is built from and how it is corrected. */
#include "firmware/config_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/config_names.h"
#include "firmware/json_text.h"

enum { MOST_COMPONENTS = 62 };

/* ---- components ---- */

/* JSON knows one kind of number: TL_REAL. The twin makes an Integer of it where the variable is one. */
static void fill_value(const cJSON *item, tl_value *value) {
    if (cJSON_IsString(item)) {
        value->type = TL_STRING;
        value->text = item->valuestring;
    } else if (cJSON_IsBool(item)) {
        value->type = TL_BOOLEAN;
        value->integer = cJSON_IsTrue(item) ? 1 : 0;
    } else {
        value->type = TL_REAL;
        value->real = item->valuedouble;
    }
}

static void read_set(tl_config_object *entry, tl_config_component *component) {
    static const tl_config_map rule = {.most = SIZE_MAX, .example = "{\"J\": 0.0515}"};
    tl_config_object map;
    component->set_count = tl_config_entries(entry, "set", &rule, &map);
    component->set = tl_config_take(entry->reader, component->set_count, sizeof *component->set);
    if (component->set == NULL) {
        return;
    }
    tl_plan_set *set = component->set;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        char path[TL_JSON_PATH];
        tl_json_member_path(path, map.path, item->string);
        set->where = tl_config_keep(entry->reader, path);
        set->variable = item->string;
        if (cJSON_IsString(item) || cJSON_IsBool(item) || cJSON_IsNumber(item)) {
            fill_value(item, &set->value);
        } else {
            tl_config_wrong(&map, item->string, NULL, "a number, true, false or a text", "0.0515");
        }
        if (item->string[0] == '\0' || !tl_text_is_plain(item->string)) {
            tl_config_wrong(&map, item->string, "an unusable name", "the name of a variable of the FMU", "\"J\"");
        }
        set++;
    }
}

void tl_config_read_components(tl_config_object *root, tl_config *config) {
    static const tl_config_map rule = {.need = TL_CONFIG_REQUIRED,
                                       .least = 1,
                                       .most = MOST_COMPONENTS,
                                       .example = "{\"motor\": {\"fmu\": \"motor.fmu\"}}"};
    tl_config_object map;
    config->component_count = tl_config_entries(root, "components", &rule, &map);
    config->components = tl_config_take(root->reader, config->component_count, sizeof *config->components);
    if (config->components == NULL) {
        return;
    }
    tl_config_component *component = config->components;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        tl_config_object entry;
        tl_config_check_name(&map, item, "\"motor\"");
        if (strcmp(item->string, "plant") == 0) {
            tl_config_wrong(&map, item->string, "the name \"plant\"", "another: that name means the plant itself",
                            "\"motor\"");
        }
        component->name = item->string;
        if (tl_config_entry(&map, item, "{\"fmu\": \"motor.fmu\"}", &entry)) {
            (void)tl_config_get_text(&entry, "fmu", TL_CONFIG_REQUIRED, "\"motor.fmu\"", &component->fmu);
            read_set(&entry, component);
            tl_config_done(&entry);
        }
        component->where = tl_config_keep(root->reader, entry.path);
        component++;
    }
}

/* ---- connect ---- */

/* One end of a connection; NULL where it is wrong. */
static const char *read_end(const tl_config_reader *reader, const cJSON *item, const char *path,
                            tl_config_target target) {
    if (!cJSON_IsString(item)) {
        char found[128];
        tl_config_describe(item, found, sizeof found);
        tl_config_problem(reader, path, tl_json_line(item), found, "a text", "\"motor.omega\"");
        return NULL;
    }
    tl_config_check_reference(reader, path, tl_json_line(item), item->valuestring, target);
    return item->valuestring;
}

static void read_connection(tl_config_reader *reader, const cJSON *item, const char *path,
                            tl_plan_connection *connection) {
    char end_path[TL_JSON_PATH];
    connection->where = tl_config_keep(reader, path);
    if (!cJSON_IsArray(item) || cJSON_GetArraySize(item) != 2) {
        char found[128];
        tl_config_describe(item, found, sizeof found);
        tl_config_problem(reader, path, tl_json_line(item), found, "an array of two texts, from and to",
                          "[\"plant.torque\", \"motor.M_w\"]");
        return;
    }
    tl_json_element_path(end_path, path, 0);
    connection->from = read_end(reader, item->child, end_path, TL_CONFIG_EITHER);
    tl_json_element_path(end_path, path, 1);
    connection->to = read_end(reader, item->child->next, end_path, TL_CONFIG_VARIABLE);
}

/* Connections by their target, then by their order in the file. */
static int by_target(const void *left, const void *right) {
    const tl_plan_connection *a = *(tl_plan_connection *const *)left;
    const tl_plan_connection *b = *(tl_plan_connection *const *)right;
    int order = strcmp(a->to, b->to);
    return order != 0 ? order : (a > b) - (a < b);
}

/* Each input may be connected once. */
static void check_targets(tl_config_reader *reader, const tl_config *config) {
    const tl_plan_connection **sorted = tl_config_take(reader, config->connection_count, sizeof *sorted);
    size_t count = 0;
    if (sorted == NULL) {
        return;
    }
    for (size_t i = 0; i < config->connection_count; i++) {
        if (config->connections[i].to != NULL) {
            sorted[count++] = &config->connections[i];
        }
    }
    qsort(sorted, count, sizeof *sorted, by_target);
    for (size_t i = 1; i < count; i++) {
        if (strcmp(sorted[i - 1]->to, sorted[i]->to) == 0) {
            char path[TL_JSON_PATH];
            char shown[TL_JSON_SHOWN];
            char found[128];
            tl_json_element_path(path, sorted[i]->where, 1);
            tl_text_for_people(sorted[i]->to, shown, sizeof shown);
            (void)snprintf(found, sizeof found, "\"%s\", which %s leads to already", shown, sorted[i - 1]->where);
            tl_config_problem(reader, path, tl_json_line(tl_json_nearest(reader->root, path)), found,
                              "each input to be connected at most once", NULL);
        }
    }
}

void tl_config_read_connections(tl_config_object *root, tl_config *config) {
    static const char *const expected = "an array of connections [from, to]";
    static const char *const example = "[[\"plant.torque\", \"motor.M_w\"]]";
    const cJSON *array = tl_config_get(root, "connect", TL_CONFIG_OPTIONAL, expected, example);
    if (array != NULL && !cJSON_IsArray(array)) {
        tl_config_wrong(root, "connect", NULL, expected, example);
        array = NULL;
    }
    config->connection_count = (size_t)cJSON_GetArraySize(array);
    config->connections = tl_config_take(root->reader, config->connection_count, sizeof *config->connections);
    if (config->connections == NULL) {
        return;
    }
    size_t i = 0;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, array) {
        char path[TL_JSON_PATH];
        tl_json_element_path(path, "connect", i);
        read_connection(root->reader, item, path, &config->connections[i]);
        i++;
    }
    check_targets(root->reader, config);
}

/* ---- match and compare ---- */

/* An entry whose key is a variable. */
static void begin_variable(const tl_config_object *map, const cJSON *item, const char *example,
                           tl_config_object *entry) {
    (void)tl_config_entry(map, item, example, entry);
    tl_config_check_reference(map->reader, entry->path, tl_json_line(item), item->string, TL_CONFIG_VARIABLE);
}

static void read_target(tl_config_object *entry, tl_plan_match *match) {
    if (tl_config_get_text(entry, "to", TL_CONFIG_REQUIRED, "\"plant.omega\"", &match->to)) {
        char path[TL_JSON_PATH];
        const cJSON *item = cJSON_GetObjectItemCaseSensitive(entry->json, "to");
        tl_json_member_path(path, entry->path, "to");
        tl_config_check_reference(entry->reader, path, tl_json_line(item), match->to, TL_CONFIG_SIGNAL);
    }
}

static void read_weight(tl_config_object *entry, tl_plan_match *match) {
    static const tl_config_number weight = {.maximum = HUGE_VAL, .example = "1"};
    tl_config_number tolerance = {.above = true, .maximum = HUGE_VAL, .example = "0.5"};
    match->weight = 1;
    match->tolerance = 1;
    (void)tl_config_get_number(entry, "weight", &weight, &match->weight);
    tolerance.need = match->weight > 0 ? TL_CONFIG_REQUIRED : TL_CONFIG_OPTIONAL;
    (void)tl_config_get_number(entry, "tolerance", &tolerance, &match->tolerance);
}

/* `synchronise.match`, or `compare`, where every weight is 0. */
static void read_match(tl_config_object *parent, const char *key, tl_config *config, bool weighted) {
    static const char *const weighted_example = "{\"to\": \"plant.omega\", \"tolerance\": 1.0}";
    static const char *const compared_example = "{\"to\": \"plant.omega\"}";
    const char *example = weighted ? weighted_example : compared_example;
    const tl_config_map rule = {
        .need = weighted ? TL_CONFIG_REQUIRED : TL_CONFIG_OPTIONAL,
        .least = 1,
        .most = TL_MAX_MATCH,
        .example = weighted ? "{\"motor.omega\": {\"to\": \"plant.omega\", \"tolerance\": 1.0}}"
                            : "{\"motor.omega\": {\"to\": \"plant.omega\"}}",
    };
    tl_config_object map;
    config->match_count = tl_config_entries(parent, key, &rule, &map);
    config->match = tl_config_take(parent->reader, config->match_count, sizeof *config->match);
    if (config->match == NULL) {
        return;
    }
    tl_plan_match *match = config->match;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        tl_config_object entry;
        begin_variable(&map, item, example, &entry);
        match->where = tl_config_keep(parent->reader, entry.path);
        match->variable = item->string;
        match->tolerance = 1;
        read_target(&entry, match);
        if (weighted) {
            read_weight(&entry, match);
        }
        tl_config_done(&entry);
        match++;
    }
}

void tl_config_read_compare(tl_config_object *root, tl_config *config) {
    bool both = cJSON_GetObjectItemCaseSensitive(root->json, "compare") != NULL &&
                cJSON_GetObjectItemCaseSensitive(root->json, "synchronise") != NULL;
    if (both) {
        tl_config_wrong(root, "compare", "compare beside synchronise",
                        "one of them: in synchronise.match, weight 0 means compared only", NULL);
    }
    read_match(root, "compare", config, false);
}

/* ---- synchronise ---- */

static void read_adjusted(tl_config_object *entry, tl_plan_adjust *adjust) {
    static const tl_config_number any = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0"};
    static const tl_config_number step = {
        .need = TL_CONFIG_REQUIRED, .above = true, .maximum = HUGE_VAL, .example = "0.05"};
    adjust->lower = -HUGE_VAL;
    adjust->upper = HUGE_VAL;
    (void)tl_config_get_number(entry, "step", &step, &adjust->step);
    adjust->has_nominal = tl_config_get_number(entry, "nominal", &any, &adjust->nominal);
    bool low = tl_config_get_number(entry, "min", &any, &adjust->lower);
    bool high = tl_config_get_number(entry, "max", &any, &adjust->upper);
    if (low && high && adjust->lower >= adjust->upper) {
        char expected[64];
        (void)snprintf(expected, sizeof expected, "more than min, which is %.15g", adjust->lower);
        tl_config_wrong(entry, "max", NULL, expected, NULL);
    }
    tl_config_done(entry);
}

static void read_adjust(tl_config_object *object, tl_config *config) {
    static const tl_config_map rule = {
        .need = TL_CONFIG_REQUIRED, .least = 1, .most = TL_MAX_ADJUST, .example = "{\"motor.d\": {\"step\": 0.05}}"};
    tl_config_object map;
    config->adjust_count = tl_config_entries(object, "adjust", &rule, &map);
    config->adjust = tl_config_take(object->reader, config->adjust_count, sizeof *config->adjust);
    if (config->adjust == NULL) {
        return;
    }
    tl_plan_adjust *adjust = config->adjust;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        tl_config_object entry;
        begin_variable(&map, item, "{\"step\": 0.05}", &entry);
        adjust->where = tl_config_keep(object->reader, entry.path);
        adjust->variable = item->string;
        read_adjusted(&entry, adjust);
        adjust++;
    }
}

/* A match list whose weights are all 0 leaves nothing to optimise. */
static void check_weights(const tl_config_object *object, const tl_config *config) {
    bool any = config->match_count == 0; /* reported already */
    for (size_t i = 0; i < config->match_count; i++) {
        any = any || config->match[i].weight > 0;
    }
    if (!any) {
        tl_config_wrong(object, "match", "weight 0 everywhere",
                        "at least one weight above 0 (it is 1 where none is given)", NULL);
    }
}

static void read_horizon(tl_config_object *object, tl_config *config) {
    static const tl_config_number rule = {.whole = true, .minimum = 1, .maximum = 1000, .example = "2"};
    static const char *const measurements[] = {"lag", "ahead", NULL};
    tl_config_object horizon;
    double prediction = 0;
    size_t index = 0;
    (void)tl_config_member(object, "horizon", TL_CONFIG_OPTIONAL, "{\"prediction\": 2}", &horizon);
    (void)tl_config_get_number(&horizon, "prediction", &rule, &prediction);
    (void)tl_config_get_choice(&horizon, "measurements", TL_CONFIG_OPTIONAL, measurements, &index);
    config->prediction = (uint32_t)prediction;
    config->measurements = index == 0 ? TL_LAG : TL_AHEAD;
    tl_config_done(&horizon);
}

static void read_budget(tl_config_object *object, tl_config *config) {
    static const tl_config_number evaluations_rule = {.whole = true, .minimum = 2, .maximum = 100000, .example = "60"};
    static const tl_config_number time_rule = {
        .above = true, .maximum = TL_CONFIG_LONGEST_S, .expected = TL_CONFIG_DURATION, .example = "0.006"};
    tl_config_object budget;
    double evaluations = 60;
    double time = 0;
    (void)tl_config_member(object, "budget", TL_CONFIG_OPTIONAL, "{\"evaluations\": 60}", &budget);
    (void)tl_config_get_number(&budget, "evaluations", &evaluations_rule, &evaluations);
    config->budget_evaluations = (uint32_t)evaluations;
    config->budget_time = config->step * 6 / 10;
    if (tl_config_get_number(&budget, "time_s", &time_rule, &time)) {
        config->budget_time = tl_config_duration(time);
    }
    tl_config_done(&budget);
}

void tl_config_read_synchronise(tl_config_object *root, tl_config *config) {
    static const char *const algorithms[] = {"nelder-mead", NULL};
    static const tl_config_number margin = {.maximum = 1, .below = true, .example = "0.01"};
    size_t algorithm = 0;
    tl_config_object object;
    config->margin = 0.01;
    config->synchronise = tl_config_member(
        root, "synchronise", TL_CONFIG_OPTIONAL,
        "{\"adjust\": {\"motor.d\": {\"step\": 0.05}}, \"match\": {\"motor.omega\": {\"to\": \"plant.omega\", …}}}",
        &object);
    if (config->synchronise) {
        read_adjust(&object, config);
        read_match(&object, "match", config, true);
        check_weights(&object, config);
    }
    read_horizon(&object, config);
    read_budget(&object, config);
    (void)tl_config_get_choice(&object, "algorithm", TL_CONFIG_OPTIONAL, algorithms, &algorithm);
    (void)tl_config_get_number(&object, "margin", &margin, &config->margin);
    config->algorithm = algorithms[algorithm];
    tl_config_done(&object);
}
