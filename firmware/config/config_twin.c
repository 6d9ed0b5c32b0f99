/* Reads components, connections and how the twin runs. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/json.h"
#include "firmware/config/config.h"
#include "firmware/config/config_reader.h"

/* ---- `recording`, `record`, `detect`, `realtime`, `emulate`: settings of commands. */

enum { BYTES_PER_MB = 1000000 };

static const tl_config_map COLUMNS = {.need = TL_CONFIG_REQUIRED,
                                      .least = 1,
                                      .most = TL_MAX_SIGNALS,
                                      .example = "{\"omega\": {\"from\": \"motor.omega\"}}"};

static const tl_config_map WORDS = {.most = TL_MAX_SIGNALS + TL_MAX_ADJUST,
                                    .example = "{\"tank.pump\": \"feed pump\", \"plant.level\": \"level of tank 1\"}"};

static const tl_config_map ALARMS = {.most = TL_MAX_ADJUST, .example = "{\"tank.pump\": {\"above\": 0.3}}"};

void tl_config_read_recording(tl_config_object *root, tl_config *config) {
    tl_config_object object;
    config->recording_time_column = "time";
    (void)tl_config_member(root, "recording", TL_CONFIG_OPTIONAL, "{\"file\": \"bench.csv\"}", &object);
    (void)tl_config_get_text(&object, "file", TL_CONFIG_OPTIONAL, "\"bench.csv\"", &config->recording_file);
    (void)tl_config_get_text(&object, "time_column", TL_CONFIG_OPTIONAL, "\"time\"", &config->recording_time_column);
    tl_config_done(&object);
}

void tl_config_read_record(tl_config_object *root, tl_config *config) {
    static const tl_config_number size = {.minimum = 1, .maximum = 1e9, .example = "1000"};
    static const tl_config_number commit = {.minimum = 0.05, .maximum = 10, .example = "0.5"};
    static const tl_config_number resume = {.minimum = 0, .maximum = 3600, .example = "60"};
    tl_config_object object;
    double resume_s = 60;
    double max_mb = 1000;
    double commit_s = 0.5;
    (void)tl_config_member(root, "record", TL_CONFIG_OPTIONAL, "{\"file\": \"bench.db\"}", &object);
    (void)tl_config_get_text(&object, "file", TL_CONFIG_REQUIRED, "\"bench.db\"", &config->record_file);
    (void)tl_config_get_number(&object, "max_mb", &size, &max_mb);
    (void)tl_config_get_number(&object, "commit_s", &commit, &commit_s);
    (void)tl_config_get_number(&object, "resume_s", &resume, &resume_s);
    config->record_resume = resume_s > 0.0 ? tl_config_duration(resume_s) : 0;
    config->record_max_bytes = llround(max_mb * BYTES_PER_MB);
    config->record_commit = tl_config_duration(commit_s);
    tl_config_done(&object);
}

static bool is_watched(const tl_config *config, const char *name) {
    bool is = false;
    for (size_t i = 0; i < config->adjust_count; i++) {
        is = is || strcmp(config->adjust[i].variable, name) == 0;
    }
    for (size_t i = 0; i < config->signal_count; i++) {
        is = is || (strncmp(name, "plant.", strlen("plant.")) == 0 &&
                    strcmp(config->signals[i].plan.name, name + strlen("plant.")) == 0);
    }
    return is;
}

/* A wrong name is reported only if it does not follow from another problem. */
typedef struct words_context {
    const tl_config *config;
    bool is_sound;
} words_context;

static void read_words(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    const words_context *self = context;
    tl_config_words *says = &self->config->says[index];
    const char *words = cJSON_IsString(item) ? item->valuestring : "";
    says->name = item->string;
    says->words = words;
    if (self->is_sound && !is_watched(self->config, item->string)) {
        tl_config_wrong(map, item->string, "a name that is neither adjusted nor a signal",
                        "an adjusted variable, or \"plant.\" and the name of a signal", "\"plant.level\"");
    }
    if (words[0] == '\0' || strlen(words) >= TL_CONFIG_WORDS || !tl_text_is_plain(words)) {
        tl_config_wrong(map, item->string, NULL, "a text of 1 to 47 bytes", "\"feed pump\"");
    }
}

static void read_open_point(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    tl_config_name *point = &((tl_config *)context)->fill_in[index];
    point->where = item->string;
    point->name = cJSON_IsString(item) ? item->valuestring : "";
    if (point->name[0] == '\0' || !tl_text_is_plain(point->name)) {
        tl_config_wrong(map, item->string, NULL, "a text", "\"the cycle of the PLC\"");
    }
}

void tl_config_read_fill_in(tl_config_object *root, tl_config *config) {
    static const tl_config_map rule = {.most = SIZE_MAX, .example = "{\"step_s\": \"the cycle of the PLC\"}"};
    tl_config_object map;
    config->fill_in =
        tl_config_take_entries(root, "fill_in", &rule, sizeof *config->fill_in, &map, &config->fill_in_count);
    tl_config_each(&map, read_open_point, config);
}

static void read_alarm(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    static const tl_config_number any = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0.3"};
    static const tl_config_number time = {.above = true, .maximum = TL_CONFIG_LONGEST_S, .example = "60"};
    static const char *const example = "{\"above\": 0.3, \"below\": -0.3, \"for_s\": 60}";
    const words_context *self = context;
    const tl_config *config = self->config;
    tl_config_alarm *alarm = &config->alarms[index];
    tl_config_object entry;
    double lasts_s = 60;
    *alarm = (tl_config_alarm){.above = HUGE_VAL, .below = -HUGE_VAL};
    while (alarm->adjust < config->adjust_count && strcmp(config->adjust[alarm->adjust].variable, item->string) != 0) {
        alarm->adjust++;
    }
    if (self->is_sound && alarm->adjust == config->adjust_count) {
        tl_config_wrong(map, item->string, "a name that is not adjusted", "an adjusted variable", "\"tank.pump\"");
    }
    bool is_object = tl_config_entry(map, item, example, &entry);
    bool has_above = tl_config_get_number(&entry, "above", &any, &alarm->above);
    bool has_below = tl_config_get_number(&entry, "below", &any, &alarm->below);
    (void)tl_config_get_number(&entry, "for_s", &time, &lasts_s);
    alarm->averaging_time = tl_config_duration(lasts_s);
    tl_config_done(&entry);
    if (is_object && !cJSON_HasObjectItem(item, "above") && !cJSON_HasObjectItem(item, "below")) {
        tl_config_wrong(map, item->string, NULL, "above, below, or both", example);
    }
    if (has_above && has_below && alarm->above <= alarm->below) {
        char expected[64];
        (void)snprintf(expected, sizeof expected, "more than below, which is %.15g", alarm->below);
        tl_config_wrong(&entry, "above", NULL, expected, NULL);
    }
}

void tl_config_read_detect(tl_config_object *root, tl_config *config) {
    static const tl_config_number learn = {.minimum = 60, .maximum = TL_CONFIG_LONGEST_S, .example = "86400"};
    static const tl_config_number promise = {.minimum = 1e-3, .maximum = 1e6, .example = "1"};
    static const tl_config_number cycle = {.minimum = 0, .maximum = TL_CONFIG_LONGEST_S, .example = "600"};
    tl_config_object object;
    tl_config_object map;
    double learn_s = 86400;
    double cycle_s = 0;
    config->false_alarms_per_year = 1;
    (void)tl_config_member(root, "detect", TL_CONFIG_OPTIONAL, "{\"false_alarms_per_year\": 1}", &object);
    (void)tl_config_get_number(&object, "false_alarms_per_year", &promise, &config->false_alarms_per_year);
    (void)tl_config_get_number(&object, "learn_s", &learn, &learn_s);
    (void)tl_config_get_number(&object, "cycle_s", &cycle, &cycle_s);
    config->says = tl_config_take_entries(&object, "says", &WORDS, sizeof *config->says, &map, &config->says_count);
    words_context context = {.config = config, .is_sound = root->reader->report->count == 0};
    tl_config_each(&map, read_words, &context);
    config->alarms =
        tl_config_take_entries(&object, "alarm", &ALARMS, sizeof *config->alarms, &map, &config->alarm_count);
    tl_config_each(&map, read_alarm, &context);
    config->detect_learn = tl_config_duration(learn_s);
    config->detect_cycle = cycle_s > 0.0 ? tl_config_duration(cycle_s) : 0;
    tl_config_done(&object);
}

void tl_config_read_realtime(tl_config_object *root, tl_config *config) {
    static const tl_config_number rule = {.whole = true, .maximum = 98, .example = "50"};
    static const tl_config_number hang = {.minimum = 0.1, .maximum = 3600, .example = "2"};
    tl_config_object object;
    double priority = 50;
    double hang_s = 2;
    config->realtime_lock_memory = true;
    (void)tl_config_member(root, "realtime", TL_CONFIG_OPTIONAL, "{\"priority\": 50}", &object);
    (void)tl_config_get_number(&object, "priority", &rule, &priority);
    (void)tl_config_get_boolean(&object, "lock_memory", &config->realtime_lock_memory);
    (void)tl_config_get_number(&object, "hang_s", &hang, &hang_s);
    config->realtime_priority = (int)priority;
    config->realtime_hang = tl_config_duration(hang_s);
    tl_config_done(&object);
}

/* ---- emulate ---- */

/* Reads [min, max]: seconds between two rows. */
static void read_message(tl_config_object *object, tl_config *config) {
    static const char *const expected = "an array of two numbers > 0 (at most 1e9), the first not above the second";
    static const char *const example = "[0.005, 0.02]";
    const cJSON *item = tl_config_get(object, "message_s", TL_CONFIG_OPTIONAL, expected, example);
    if (item == NULL) {
        return;
    }
    bool right = cJSON_IsArray(item) && cJSON_GetArraySize(item) == 2;
    const cJSON *element = NULL;
    if (right) {
        cJSON_ArrayForEach(element, item) {
            right = right && cJSON_IsNumber(element) && element->valuedouble > 0 &&
                    element->valuedouble <= TL_CONFIG_LONGEST_S;
        }
    }
    if (!right || item->child->valuedouble > item->child->next->valuedouble) {
        tl_config_wrong(object, "message_s", NULL, expected, example);
        return;
    }
    config->message_min_s = fmax(item->child->valuedouble, tl_seconds(1));
    config->message_max_s = fmax(item->child->next->valuedouble, tl_seconds(1));
}

static void read_column(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    static const tl_config_number noise = {.maximum = HUGE_VAL, .example = "0.01"};
    const tl_config *config = context;
    tl_config_emulated *emulated = &config->emulated[index];
    tl_config_object entry;
    if (item->string[0] == '\0' || !tl_text_is_plain(item->string)) {
        tl_config_wrong(map, item->string, "an empty name or a control character", "the name of a column", "\"omega\"");
    }
    emulated->column = item->string;
    if (tl_config_entry(map, item, "{\"from\": \"motor.omega\"}", &entry)) {
        if (tl_config_get_text(&entry, "from", TL_CONFIG_REQUIRED, "\"motor.omega\"", &emulated->from)) {
            tl_config_check_reference_of(&entry, "from", emulated->from, TL_CONFIG_EITHER);
        }
        (void)tl_config_get_number(&entry, "noise", &noise, &emulated->noise);
        tl_config_done(&entry);
    }
    emulated->where = tl_config_copy_path(map->reader, entry.path);
}

void tl_config_read_emulate(tl_config_object *root, tl_config *config) {
    tl_config_object object;
    tl_config_object map;
    if (tl_config_member(root, "emulate", TL_CONFIG_OPTIONAL, "{\"columns\": {\"omega\": {\"from\": \"motor.omega\"}}}",
                         &object)) {
        config->emulated = tl_config_take_entries(&object, "columns", &COLUMNS, sizeof *config->emulated, &map,
                                                  &config->emulated_count);
        tl_config_each(&map, read_column, config);
        read_message(&object, config);
        tl_config_done(&object);
    }
}

/* ---- `components` and `connect`: the parts of the twin. */

enum { MOST_COMPONENTS = 62 };

static const tl_config_map COMPONENTS = {.need = TL_CONFIG_REQUIRED,
                                         .least = 1,
                                         .most = MOST_COMPONENTS,
                                         .example = "{\"motor\": {\"fmu\": \"motor.fmu\"}}"};

/* ---- components ---- */

/* JSON has one kind of number, so the type is TL_REAL. The twin converts it if the variable is an
 * Integer. */
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
    component->set = tl_config_take_entries(entry, "set", &rule, sizeof *component->set, &map, &component->set_count);
    tl_plan_set *set = component->set;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        char path[TL_JSON_PATH];
        tl_json_member_path(path, map.path, item->string);
        set->where = tl_config_copy_path(entry->reader, path);
        set->variable = item->string;
        if (cJSON_IsString(item) || cJSON_IsBool(item) || cJSON_IsNumber(item)) {
            fill_value(item, &set->value);
        } else {
            tl_config_wrong(&map, item->string, NULL, "a number, true, false or a text", "0.0515");
        }
        if (item->string[0] == '\0' || !tl_text_is_plain(item->string)) {
            tl_config_wrong(&map, item->string, "an empty name or a control character",
                            "the name of a variable of the FMU", "\"J\"");
        }
        set++;
    }
}

/* In the form that sha256sum prints. */
static void read_hash(tl_config_object *entry, tl_config_component *component) {
    static const char EXAMPLE[] = "\"9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08\"";
    const char *text = NULL;
    if (tl_config_get_text(entry, "sha256", TL_CONFIG_OPTIONAL, EXAMPLE, &text)) {
        component->sha256 = text;
        if (!tl_identity_is_sound(text)) {
            tl_config_wrong(entry, "sha256", NULL, "64 digits of 0 to 9 and a to f, as sha256sum prints them", EXAMPLE);
        }
    }
}

/* A key whose value is an array of names of files. */
typedef struct names_key {
    const char *key;
    const char *expected; /* by the array, */
    const char *example;
    const char *element_expected; /* and by an element */
    const char *element_example;
} names_key;

/* Reads all names. Returns their number. */
static size_t read_names(tl_config_object *entry, const names_key *key, tl_config_name **names) {
    const cJSON *array = tl_config_get_array(entry, key->key, key->expected, key->example);
    size_t count = (size_t)cJSON_GetArraySize(array);
    *names = tl_config_allocate(entry->reader, count, sizeof **names);
    if (*names == NULL) {
        return count;
    }
    size_t i = 0;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, array) {
        char list[TL_JSON_PATH];
        char path[TL_JSON_PATH];
        tl_json_member_path(list, entry->path, key->key);
        tl_json_element_path(path, list, i);
        (*names)[i].where = tl_config_copy_path(entry->reader, path);
        if (cJSON_IsString(item) && item->valuestring[0] != '\0' && tl_text_is_plain(item->valuestring)) {
            (*names)[i].name = item->valuestring;
        } else {
            tl_config_wrong_item(entry->reader, item, path, NULL, key->element_expected, key->element_example);
        }
        i++;
    }
    return count;
}

static const names_key LIBRARIES = {"libraries", "an array of names of shared libraries", "[\"libpython3.11.so.1.0\"]",
                                    "the name of a shared library", "\"libpython3.11.so.1.0\""};
static const names_key READS = {"read", "an array of names of files and folders", "[\"tables\"]",
                                "the name of a file or folder", "\"tables/friction.csv\""};

/* Reads the rollback method, and which states are kept. */
static void read_states(tl_config_object *entry, tl_config_component *component) {
    static const char *const keeps[] = {[TL_KEEP_STATES] = "states",
                                        [TL_KEEP_OUTPUTS] = "outputs",
                                        [TL_KEEP_NONE] = "none",
                                        [TL_KEEP_AUTO] = "auto",
                                        NULL};
    static const char *const names[] = {"auto", "state", "memory", "replay", NULL};
    static const tl_rollback methods[] = {TL_ROLLBACK_AUTO, TL_ROLLBACK_STATE, TL_ROLLBACK_MEMORY, TL_ROLLBACK_REPLAY};
    static const tl_config_number steps = {.whole = true, .minimum = 1, .maximum = 1e5, .example = "1000"};
    size_t keep = TL_KEEP_AUTO;
    size_t method = 0;
    component->replay_steps = TL_REPLAY_STEPS;
    (void)tl_config_get_choice(entry, "keep", TL_CONFIG_OPTIONAL, keeps, &keep);
    (void)tl_config_get_choice(entry, "rollback", TL_CONFIG_OPTIONAL, names, &method);
    (void)tl_config_get_count(entry, "replay_steps", &steps, &component->replay_steps);
    component->keep = (tl_keep)keep;
    component->rollback = methods[method];
}

static void read_component(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    const tl_config *config = context;
    tl_config_component *component = &config->components[index];
    tl_config_object entry;
    tl_config_check_name(map, item, "\"motor\"");
    if (strcmp(item->string, "plant") == 0) {
        tl_config_wrong(map, item->string, "the name \"plant\"", "another name (\"plant\" is the plant itself)",
                        "\"motor\"");
    }
    component->name = item->string;
    if (tl_config_entry(map, item, "{\"fmu\": \"motor.fmu\"}", &entry)) {
        (void)tl_config_get_text(&entry, "fmu", TL_CONFIG_REQUIRED, "\"motor.fmu\"", &component->fmu);
        read_hash(&entry, component);
        read_set(&entry, component);
        read_states(&entry, component);
        component->library_count = read_names(&entry, &LIBRARIES, &component->libraries);
        component->read_count = read_names(&entry, &READS, &component->reads);
        (void)tl_config_get_boolean(&entry, "unconfined", &component->unconfined);
        (void)tl_config_get_boolean(&entry, "logging", &component->logging);
        tl_config_done(&entry);
    }
    component->where = tl_config_copy_path(map->reader, entry.path);
}

void tl_config_read_components(tl_config_object *root, tl_config *config) {
    tl_config_object map;
    config->components = tl_config_take_entries(root, "components", &COMPONENTS, sizeof *config->components, &map,
                                                &config->component_count);
    tl_config_each(&map, read_component, config);
}

/* ---- connect ---- */

/* Reads one end of a connection. Returns NULL if it is not a text. */
static const char *read_end(const tl_config_reader *reader, const cJSON *item, const char *path,
                            tl_config_target target) {
    if (!cJSON_IsString(item)) {
        tl_config_wrong_item(reader, item, path, NULL, "a text", "\"motor.omega\"");
        return NULL;
    }
    tl_config_check_reference(reader, path, tl_json_line(item), item->valuestring, target);
    return item->valuestring;
}

static void read_connection(tl_config_reader *reader, const cJSON *item, const char *path,
                            tl_plan_connection *connection) {
    char end_path[TL_JSON_PATH];
    connection->where = tl_config_copy_path(reader, path);
    if (!cJSON_IsArray(item) || cJSON_GetArraySize(item) != 2) {
        tl_config_wrong_item(reader, item, path, NULL, "an array of two texts, from and to",
                             "[\"plant.torque\", \"motor.M_w\"]");
        return;
    }
    tl_json_element_path(end_path, path, 0);
    connection->from = read_end(reader, item->child, end_path, TL_CONFIG_EITHER);
    tl_json_element_path(end_path, path, 1);
    connection->to = read_end(reader, item->child->next, end_path, TL_CONFIG_VARIABLE);
}

/* Orders connections by their target, then as in the file. */
static int by_target(const void *left, const void *right) {
    const tl_plan_connection *a = *(tl_plan_connection *const *)left;
    const tl_plan_connection *b = *(tl_plan_connection *const *)right;
    int order = strcmp(a->to, b->to);
    return order != 0 ? order : (a > b) - (a < b);
}

/* Reports an input that is connected more than once. */
static void check_targets(tl_config_reader *reader, const tl_config *config) {
    const tl_plan_connection **sorted = tl_config_allocate(reader, config->connection_count, sizeof *sorted);
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
            (void)snprintf(found, sizeof found, "\"%s\", which %s already connects", shown, sorted[i - 1]->where);
            tl_config_wrong_item(reader, tl_json_nearest(reader->root, path), path, found,
                                 "at most one connection per input", NULL);
        }
    }
}

void tl_config_read_connections(tl_config_object *root, tl_config *config) {
    static const char *const expected = "an array of connections [from, to]";
    static const char *const example = "[[\"plant.torque\", \"motor.M_w\"]]";
    const cJSON *array = tl_config_get_array(root, "connect", expected, example);
    config->connection_count = (size_t)cJSON_GetArraySize(array);
    config->connections = tl_config_allocate(root->reader, config->connection_count, sizeof *config->connections);
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
