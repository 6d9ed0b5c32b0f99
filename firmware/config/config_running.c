/* `recording`, `record`, `realtime` and `emulate`: what the verbs do with a twin. */
#include "firmware/config/config_parts.h"

#include <math.h>
#include <stdio.h>

#include "firmware/base/json_text.h"
#include "firmware/config/config_names.h"

enum { BYTES_PER_MB = 1000000 };

static const tl_config_map COLUMNS = {.need = TL_CONFIG_REQUIRED,
                                      .least = 1,
                                      .most = TL_MAX_SIGNALS,
                                      .example = "{\"omega\": {\"from\": \"motor.omega\"}}"};

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

/* [min, max], seconds between two rows. */
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

static void read_emulated(tl_config_object *entry, tl_config_emulated *emulated) {
    static const tl_config_number noise = {.maximum = HUGE_VAL, .example = "0.01"};
    if (tl_config_get_text(entry, "from", TL_CONFIG_REQUIRED, "\"motor.omega\"", &emulated->from)) {
        char path[TL_JSON_PATH];
        const cJSON *item = cJSON_GetObjectItemCaseSensitive(entry->json, "from");
        tl_json_member_path(path, entry->path, "from");
        tl_config_check_reference(entry->reader, path, tl_json_line(item), emulated->from, TL_CONFIG_EITHER);
    }
    (void)tl_config_get_number(entry, "noise", &noise, &emulated->noise);
    tl_config_done(entry);
}

static void read_column(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    const tl_config *config = context;
    tl_config_emulated *emulated = &config->emulated[index];
    tl_config_object entry;
    if (item->string[0] == '\0' || !tl_text_is_plain(item->string)) {
        tl_config_wrong(map, item->string, "an unusable name", "the name of a column", "\"omega\"");
    }
    emulated->column = item->string;
    if (tl_config_entry(map, item, "{\"from\": \"motor.omega\"}", &entry)) {
        read_emulated(&entry, emulated);
    }
    emulated->where = tl_config_keep(map->reader, entry.path);
}

static void read_columns(tl_config_object *object, tl_config *config) {
    tl_config_object map;
    config->emulated =
        tl_config_take_entries(object, "columns", &COLUMNS, sizeof *config->emulated, &map, &config->emulated_count);
    tl_config_each(&map, read_column, config);
}

void tl_config_read_emulate(tl_config_object *root, tl_config *config) {
    tl_config_object object;
    if (tl_config_member(root, "emulate", TL_CONFIG_OPTIONAL, "{\"columns\": {\"omega\": {\"from\": \"motor.omega\"}}}",
                         &object)) {
        read_columns(&object, config);
        read_message(&object, config);
        tl_config_done(&object);
    }
}
