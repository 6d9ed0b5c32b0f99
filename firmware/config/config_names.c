/* Names and references: see config_names.h. */
#include "firmware/config/config_names.h"

#include <stdio.h>
#include <string.h>

#include "firmware/base/json_text.h"
#include "firmware/config/json_document.h"
#include "master/base/nearest.h"
#include "master/base/signal.h"

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
        if (used < size && (kinds == NULL || tl_config_is_of_kind(entry, kinds))) {
            tl_text_for_people(entry->string, name, sizeof name);
            used += (size_t)snprintf(text + used, size - used, "%s%s", before, name);
            before = ", ";
        }
    }
}

/* ---- references ---- */

static const char *shape_of(tl_config_target target) {
    switch (target) {
    case TL_CONFIG_VARIABLE:
        return "component.variable";
    case TL_CONFIG_SIGNAL:
        return "a signal of the plant";
    case TL_CONFIG_EITHER:
        break;
    }
    return "component.variable or plant.signal";
}

/* True where `name` is a key of the section, or where nothing can be said about it. Only as many keys are offered as a
 * valid section has, so that a hostile file takes no longer. */
static bool is_key(const cJSON *section, const char *name, tl_nearest *nearest) {
    if (!cJSON_IsObject(section) || cJSON_GetObjectItemCaseSensitive(section, name) != NULL) {
        return true;
    }
    size_t left = TL_MAX_SIGNALS;
    for (const cJSON *entry = section->child; entry != NULL && left > 0; entry = entry->next) {
        tl_nearest_offer(nearest, entry->string);
        left--;
    }
    return false;
}

static void report_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                             const char *expected, const char *example) {
    char shown[TL_JSON_SHOWN];
    char found[FOUND];
    tl_text_for_people(text, shown, sizeof shown);
    (void)snprintf(found, sizeof found, "\"%s\"", shown);
    tl_config_problem(reader, path, line, found, expected, example);
}

/* The name before or after the dot is not in the section: the nearest that is, or all of them. */
static void report_unknown(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                           const cJSON *section, const char *example) {
    char expected[EXPECTED];
    bool signal = strncmp(text, "plant.", strlen("plant.")) == 0;
    const char *what = signal ? "a signal that \"plant\" has" : "a variable of one of \"components\"";
    tl_config_list_names(what, section, NULL, expected, sizeof expected);
    report_reference(reader, path, line, text, example != NULL ? what : expected, example);
}

static void check_signal(const tl_config_reader *reader, const char *path, size_t line, const char *text) {
    char example[EXPECTED];
    const char *name = strchr(text, '.') + 1;
    const cJSON *section = cJSON_GetObjectItemCaseSensitive(reader->root, "plant");
    tl_nearest nearest = {.text = name};
    if (!is_key(section, name, &nearest)) {
        (void)snprintf(example, sizeof example, "\"plant.%s\"", nearest.best != NULL ? nearest.best : "");
        report_unknown(reader, path, line, text, section, nearest.best != NULL ? example : NULL);
    }
}

static void check_variable(const tl_config_reader *reader, const char *path, size_t line, const char *text) {
    char example[EXPECTED];
    char component[NAME_CHARS + 1];
    char variable[TL_JSON_SHOWN];
    const char *dot = strchr(text, '.');
    const cJSON *section = cJSON_GetObjectItemCaseSensitive(reader->root, "components");
    (void)snprintf(component, sizeof component, "%.*s", (int)(dot - text), text);
    tl_nearest nearest = {.text = component};
    if (!is_key(section, component, &nearest)) {
        tl_text_for_people(dot + 1, variable, sizeof variable);
        (void)snprintf(example, sizeof example, "\"%s.%s\"", nearest.best != NULL ? nearest.best : "", variable);
        report_unknown(reader, path, line, text, section, nearest.best != NULL ? example : NULL);
    }
}

/* NAME.anything, plant.NAME */
static bool has_shape(const char *text, bool signal) {
    const char *dot = strchr(text, '.');
    return dot != NULL && is_name(text, (size_t)(dot - text)) && dot[1] != '\0' && tl_text_is_plain(dot) &&
           (!signal || is_name(dot + 1, strlen(dot + 1)));
}

void tl_config_check_reference(const tl_config_reader *reader, const char *path, size_t line, const char *text,
                               tl_config_target target) {
    bool signal = strncmp(text, "plant.", strlen("plant.")) == 0;
    if (!has_shape(text, signal) || (target == TL_CONFIG_SIGNAL && !signal)) {
        report_reference(reader, path, line, text, shape_of(target),
                         target == TL_CONFIG_SIGNAL ? "\"plant.omega\"" : "\"motor.omega\"");
    } else if (target == TL_CONFIG_VARIABLE && signal) {
        report_reference(reader, path, line, text, "component.variable (the plant is only listened to)",
                         "\"motor.omega\"");
    } else if (signal) {
        check_signal(reader, path, line, text);
    } else {
        check_variable(reader, path, line, text);
    }
}
