/* `sources` and `plant`: reads the sources of the plant's values, and the properties of its
 * signals. */

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/config/config_reader.h"
#include "firmware/config/drivers.h"

enum { KINDS_TEXT = 256 };

static const tl_config_map SOURCES = {.most = TL_MAX_SIGNALS,
                                      .example = "{\"plc\": {\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}}"};
static const tl_config_map SIGNALS = {
    .need = TL_CONFIG_REQUIRED, .least = 1, .most = TL_MAX_SIGNALS, .example = "{\"omega\": {\"unit\": \"rad/s\"}}"};

/* ---- sources ---- */

/* Lists all kinds, or only those of the entry. */
static void list_kinds(tl_config_object *entry, bool all, const char *before, char *text, size_t size) {
    size_t used = (size_t)snprintf(text, size, "%s", before);
    const char *comma = "";
    for (const tl_driver *const *row = tl_drivers; *row != NULL && used < size; row++) {
        if (all || tl_config_get(entry, (*row)->name, TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
            used += (size_t)snprintf(text + used, size - used, "%s%s", comma, (*row)->name);
            comma = all ? ", " : " and ";
        }
    }
}

static void read_of_kind(tl_config_object *entry, const tl_driver *row, tl_config_source *source) {
    /* The shortest period equals the shortest step. */
    static const tl_config_number period = {.minimum = 1e-5, .maximum = 3600, .example = "0.1"};
    tl_config_object object;
    void *settings = tl_config_allocate(entry->reader, 1, row->settings_bytes);
    if (settings != NULL) {
        (void)tl_config_member(entry, row->name, TL_CONFIG_REQUIRED, row->source_example, &object);
        source->driver = row;
        source->settings = settings;
        row->read_source(&object, source);
        source->period_s = row->period_s;
        if (row->period_s == 0) {
            source->period_s = tl_seconds(entry->reader->config->step);
            (void)tl_config_get_number(&object, "period_s", &period, &source->period_s);
        }
        tl_config_done(&object);
    }
}

static void read_source(tl_config_object *entry, tl_config_source *source) {
    size_t found = 0;
    for (const tl_driver *const *row = tl_drivers; *row != NULL; row++) {
        if (tl_config_get(entry, (*row)->name, TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
            found++;
            read_of_kind(entry, *row, source);
        }
    }
    if (found != 1) {
        char what[KINDS_TEXT];
        char expected[KINDS_TEXT];
        list_kinds(entry, found == 0, found == 0 ? "none of " : "", what, sizeof what);
        list_kinds(entry, true, "exactly one of ", expected, sizeof expected);
        tl_config_problem(entry->reader, entry->path, tl_json_line(entry->json), what, expected,
                          "{\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}");
    }
    tl_config_done(entry);
}

static void read_named_source(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    const tl_config *config = context;
    tl_config_source *source = &config->sources[index];
    tl_config_object entry;
    tl_config_check_name(map, item, "\"plc\"");
    source->name = item->string;
    if (tl_config_entry(map, item, "{\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}", &entry)) {
        read_source(&entry, source);
    }
    source->where = tl_config_copy_path(map->reader, entry.path);
}

void tl_config_read_sources(tl_config_object *root, tl_config *config) {
    tl_config_object map;
    config->sources =
        tl_config_take_entries(root, "sources", &SOURCES, sizeof *config->sources, &map, &config->source_count);
    tl_config_each(&map, read_named_source, config);
}

/* ---- plant.NAME.KEY: the address of a signal in its live source ---- */

/* Lists the kinds of sources that such signals can have, ended by NULL, and a text with their
 * names. */
static void find_kinds(const tl_driver *row, const char *kinds[TL_MAX_DRIVERS + 1], char *what, size_t size) {
    size_t count = 0;
    size_t used = (size_t)snprintf(what, size, "the name of a ");
    for (const tl_driver *const *other = tl_drivers; *other != NULL && used < size; other++) {
        if (strcmp((*other)->signal_key, row->signal_key) == 0) {
            used += (size_t)snprintf(what + used, size - used, "%s%s", count == 0 ? "" : " or ", (*other)->name);
            kinds[count++] = (*other)->name;
        }
    }
    kinds[count] = NULL;
    if (used < size) {
        (void)snprintf(what + used, size - used, " source");
    }
}

/* Returns true if a row with the same signal key has read the source. An invalid source may have
 * several kinds. */
static bool is_read_by(const tl_config_source *source, const tl_driver *row) {
    return source->driver != NULL && strcmp(source->driver->signal_key, row->signal_key) == 0;
}

/* Reads the name of a source and sets the signal's source index. Returns the source in the file, or
 * NULL. */
static const cJSON *read_source_name(tl_config_object *object, const tl_driver *row, tl_config_signal *signal) {
    const tl_config_need need = row->source_is_optional ? TL_CONFIG_OPTIONAL : TL_CONFIG_REQUIRED;
    const tl_config *config = object->reader->config;
    const char *kinds[TL_MAX_DRIVERS + 1];
    const char *name = NULL;
    char what[KINDS_TEXT];
    size_t index = 0;
    const cJSON *item = NULL;
    const cJSON *sources = cJSON_GetObjectItemCaseSensitive(object->reader->root, "sources");
    if (!tl_config_get_text(object, "source", need, "\"plc\"", &name) ||
        (sources != NULL && !cJSON_IsObject(sources))) { /* reported with the section */
        return NULL;
    }
    cJSON_ArrayForEach(item, sources) {
        if (strcmp(item->string, name) == 0) {
            break;
        }
        index++;
    }
    find_kinds(row, kinds, what, sizeof what);
    if (item != NULL && tl_config_is_of_kind(item, kinds)) {
        if (index < config->source_count && is_read_by(&config->sources[index], row)) {
            signal->source = index;
        }
        return item;
    }
    char expected[320];
    tl_config_list_names(what, sources, kinds, expected, sizeof expected);
    tl_config_wrong(object, "source", NULL, expected, NULL);
    return NULL;
}

/* A signal has at most one live source. A further one is validated and ignored. */
static void read_channel(tl_config_object *entry, const tl_driver *row, tl_config_signal *signal) {
    tl_config_object object;
    tl_config_signal further = *signal;
    const bool is_further = signal->source != SIZE_MAX;
    tl_config_signal *target = is_further ? &further : signal;
    if (!tl_config_member(entry, row->signal_key, TL_CONFIG_OPTIONAL, row->signal_example, &object)) {
        return;
    }
    if (is_further) {
        char found[128];
        (void)snprintf(found, sizeof found, "%s in addition to another live source", row->signal_key);
        tl_config_wrong(entry, row->signal_key, found, "at most one live source", NULL);
    }
    target->channel = tl_config_allocate(entry->reader, 1, row->channel_bytes);
    if (target->channel != NULL) {
        const cJSON *named = read_source_name(&object, row, target);
        further.source = SIZE_MAX;
        row->read_signal(&object, named, target);
        tl_config_done(&object);
    }
}

/* ---- plant.NAME ---- */

static void read_initial(tl_config_object *entry, tl_plan_signal *plan) {
    static const tl_config_number real = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0.5"};
    static const tl_config_number integer = {
        .whole = true, .minimum = -INT32_MAX, .maximum = INT32_MAX, .example = "3"};
    bool boolean = false;
    if (plan->type == TL_BOOLEAN) {
        plan->has_initial = tl_config_get_boolean(entry, "initial", &boolean);
        plan->initial = boolean ? 1 : 0;
    } else {
        plan->has_initial =
            tl_config_get_number(entry, "initial", plan->type == TL_INTEGER ? &integer : &real, &plan->initial);
    }
}

static void read_limits(tl_config_object *entry, tl_config_signal *signal) {
    static const tl_config_number limit = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0"};
    static const tl_config_number stale = {
        .above = true, .maximum = TL_CONFIG_LONGEST_S, .expected = TL_CONFIG_DURATION, .example = "0.1"};
    signal->minimum = -HUGE_VAL;
    signal->maximum = HUGE_VAL;
    bool low = tl_config_get_number(entry, "min", &limit, &signal->minimum);
    bool high = tl_config_get_number(entry, "max", &limit, &signal->maximum);
    if (low && high && signal->minimum > signal->maximum) {
        char expected[64];
        (void)snprintf(expected, sizeof expected, "at least min, which is %.15g", signal->minimum);
        tl_config_wrong(entry, "max", NULL, expected, NULL);
    }
    if (tl_config_get_number(entry, "stale_s", &stale, &signal->stale_s)) {
        signal->stale_s = fmax(signal->stale_s, tl_seconds(1));
    }
}

/* Reads `between` and every_s. config_lookups.c checks later whether the signal feeds an input, and
 * what else is required. */
static void read_between(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const choices[] = {
        [TL_BETWEEN_LAST] = "last", [TL_BETWEEN_LINE] = "line", [TL_BETWEEN_MEAN] = "mean", NULL};
    size_t between = TL_BETWEEN_LAST;
    (void)tl_config_get_choice(entry, "between", TL_CONFIG_OPTIONAL, choices, &between);
    signal->as_input = (tl_between)between;
    bool is_given = tl_config_get(entry, "every_s", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    signal->every = is_given ? 1 : 0; /* an invalid value must not be reported as missing too */
    (void)tl_config_get_duration(entry, "every_s", TL_CONFIG_OPTIONAL, "0.04", &signal->every);
}

static void read_signal(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const types[] = {"real", "integer", "boolean", NULL};
    static const tl_type type_of[] = {TL_REAL, TL_INTEGER, TL_BOOLEAN};
    size_t type = 0;
    bool has_type = tl_config_get(entry, "type", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    bool is_valid = tl_config_get_choice(entry, "type", TL_CONFIG_OPTIONAL, types, &type) || !has_type;
    signal->plan.type = type_of[type];
    (void)tl_config_get_text(entry, "unit", TL_CONFIG_MAY_BE_EMPTY, "\"rad/s\"", &signal->plan.unit);
    read_limits(entry, signal);
    read_between(entry, signal);
    if (is_valid) {
        read_initial(entry, &signal->plan);
    } else { /* the type is invalid, so `initial` cannot be checked */
        (void)tl_config_get(entry, "initial", TL_CONFIG_OPTIONAL, NULL, NULL);
    }
    for (const tl_driver *const *row = tl_drivers; *row != NULL; row++) {
        if ((*row)->read_signal != NULL) {
            read_channel(entry, *row, signal);
        }
    }
    tl_config_done(entry);
}

static void read_named_signal(const tl_config_object *map, const cJSON *item, size_t index, void *context) {
    const tl_config *config = context;
    tl_config_signal *signal = &config->signals[index];
    tl_config_object entry;
    tl_config_check_name(map, item, "\"omega\"");
    signal->of = index;
    signal->plan.name = item->string;
    signal->plan.unit = "";
    signal->column = item->string;
    signal->scale = 1;
    signal->source = SIZE_MAX;
    if (tl_config_entry(map, item, "{\"unit\": \"rad/s\"}", &entry)) {
        read_signal(&entry, signal);
    }
    signal->plan.where = tl_config_copy_path(map->reader, entry.path);
}

void tl_config_read_signals(tl_config_object *root, tl_config *config) {
    tl_config_object map;
    config->signals =
        tl_config_take_entries(root, "plant", &SIGNALS, sizeof *config->signals, &map, &config->signal_count);
    tl_config_each(&map, read_named_signal, config);
    config->own_count = config->signal_count;
}
