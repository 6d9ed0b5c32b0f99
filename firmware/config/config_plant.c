/* `sources` and `plant`: where the plant's values come from, and what they are. */
#include "firmware/config/config_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/config/config_reader.h"

static const tl_config_map SOURCES = {.most = TL_MAX_SIGNALS,
                                      .example = "{\"plc\": {\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}}"};
static const tl_config_map SIGNALS = {
    .need = TL_CONFIG_REQUIRED, .least = 1, .most = TL_MAX_SIGNALS, .example = "{\"omega\": {\"unit\": \"rad/s\"}}"};

/* ---- sources ---- */

static void read_csv(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    tl_config_object object;
    (void)tl_config_member(entry, "csv", TL_CONFIG_REQUIRED, "{\"file\": \"plant.fifo\"}", &object);
    source->kind = TL_SOURCE_CSV;
    source->time_column = "time";
    (void)tl_config_get_text(&object, "file", TL_CONFIG_REQUIRED, "\"plant.fifo\"", &source->file);
    (void)tl_config_get_text(&object, "time_column", TL_CONFIG_OPTIONAL, "\"time\"", &source->time_column);
    tl_config_read_period(&object, source, config);
    tl_config_done(&object);
}

/* Every kind of source, and who reads it. */
static const struct kind {
    const char *key;
    void (*read)(tl_config_object *entry, tl_config_source *source, const tl_config *config);
} KINDS[] = {
    {"modbus_tcp", tl_config_read_modbus_tcp_source},
    {"modbus_rtu", tl_config_read_modbus_rtu_source},
    {"can", tl_config_read_can_source},
    {"gpio", tl_config_read_gpio_source},
    {"csv", read_csv},
};

enum { KIND_COUNT = sizeof KINDS / sizeof KINDS[0] };

/* Names all kinds, or those that the entry has. */
static void list_kinds(tl_config_object *entry, bool all, const char *before, char *text, size_t size) {
    size_t used = (size_t)snprintf(text, size, "%s", before);
    const char *comma = "";
    for (size_t i = 0; i < KIND_COUNT; i++) {
        if (all || tl_config_get(entry, KINDS[i].key, TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
            used += (size_t)snprintf(text + used, size - used, "%s%s", comma, KINDS[i].key);
            comma = all ? ", " : " and ";
        }
    }
}

static void read_source(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    size_t found = 0;
    for (size_t i = 0; i < KIND_COUNT; i++) {
        if (tl_config_get(entry, KINDS[i].key, TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
            found++;
            KINDS[i].read(entry, source, config);
        }
    }
    if (found != 1) {
        char what[128];
        char expected[128];
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
    source->line.device = "";
    if (tl_config_entry(map, item, "{\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}", &entry)) {
        read_source(&entry, source, config);
    }
    source->where = tl_config_keep(map->reader, entry.path);
}

void tl_config_read_sources(tl_config_object *root, tl_config *config) {
    tl_config_object map;
    config->sources =
        tl_config_take_entries(root, "sources", &SOURCES, sizeof *config->sources, &map, &config->source_count);
    tl_config_each(&map, read_named_source, config);
}

/* ---- plant.NAME.csv ---- */

static void read_signal_csv(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const kinds[] = {"csv", NULL};
    tl_config_object object;
    if (tl_config_member(entry, "csv", TL_CONFIG_OPTIONAL, "{\"column\": \"omega\"}", &object)) {
        (void)tl_config_get_text(&object, "column", TL_CONFIG_OPTIONAL, "\"omega\"", &signal->column);
        (void)tl_config_read_source_name(&object, TL_CONFIG_OPTIONAL, "the name of a csv source", kinds, signal);
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

/* What it is between two readings. Whether it feeds an input, and what else has to be, is known later: config_lookups.c. */
static void read_between(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const choices[] = {
        [TL_BETWEEN_LAST] = "last", [TL_BETWEEN_LINE] = "line", [TL_BETWEEN_MEAN] = "mean", NULL};
    static const tl_config_number every = {
        .above = true, .maximum = TL_CONFIG_LONGEST_S, .expected = TL_CONFIG_DURATION, .example = "0.04"};
    size_t between = TL_BETWEEN_LAST;
    double every_s = 0;
    (void)tl_config_get_choice(entry, "between", TL_CONFIG_OPTIONAL, choices, &between);
    signal->as_input = (tl_between)between;
    bool is_given = tl_config_get(entry, "every_s", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    bool is_right = tl_config_get_number(entry, "every_s", &every, &every_s);
    signal->every = is_right   ? tl_config_duration(every_s)
                    : is_given ? 1
                               : 0; /* what is wrong is not missing as well */
}

static void read_signal(tl_config_object *entry, const tl_config *config, tl_config_signal *signal) {
    static const char *const types[] = {"real", "integer", "boolean", NULL};
    static const tl_type type_of[] = {TL_REAL, TL_INTEGER, TL_BOOLEAN};
    size_t type = 0;
    bool given = tl_config_get(entry, "type", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    bool understood = tl_config_get_choice(entry, "type", TL_CONFIG_OPTIONAL, types, &type) || !given;
    signal->plan.type = type_of[type];
    (void)tl_config_get_text(entry, "unit", TL_CONFIG_MAY_BE_EMPTY, "\"rad/s\"", &signal->plan.unit);
    read_limits(entry, signal);
    read_between(entry, signal);
    if (understood) {
        read_initial(entry, &signal->plan);
    } else { /* its type is not known either */
        (void)tl_config_get(entry, "initial", TL_CONFIG_OPTIONAL, NULL, NULL);
    }
    read_signal_csv(entry, signal);
    tl_config_read_modbus_signal(entry, signal);
    tl_config_read_can_signal(entry, signal);
    tl_config_read_gpio_signal(entry, config, signal);
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
    signal->source = SIZE_MAX;
    if (tl_config_entry(map, item, "{\"unit\": \"rad/s\"}", &entry)) {
        read_signal(&entry, config, signal);
    }
    signal->plan.where = tl_config_keep(map->reader, entry.path);
}

void tl_config_read_signals(tl_config_object *root, tl_config *config) {
    tl_config_object map;
    config->signals =
        tl_config_take_entries(root, "plant", &SIGNALS, sizeof *config->signals, &map, &config->signal_count);
    tl_config_each(&map, read_named_signal, config);
}
