/* `sources` and `plant`: where the plant's values come from, and what they are. */
#include "firmware/config_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/config_names.h"

/* Frames wake the reader, at most so often: those that come faster are taken together. */
#define CAN_PERIOD_S 0.0005

/* ---- sources ---- */

/* Devices need not be asked more often than a step can be short. */
static void read_period(tl_config_object *object, tl_config_source *source, const tl_config *config) {
    static const tl_config_number period = {.minimum = 1e-5, .maximum = 3600, .example = "0.1"};
    source->period_s = tl_seconds(config->step);
    (void)tl_config_get_number(object, "period_s", &period, &source->period_s);
}

static void read_modbus_tcp(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    static const tl_config_number port_rule = {.whole = true, .minimum = 1, .maximum = 65535, .example = "502"};
    static const tl_config_number timeout = {.minimum = 0.001, .maximum = 60, .example = "0.5"};
    tl_config_object object;
    double port = 502;
    (void)tl_config_member(entry, "modbus_tcp", TL_CONFIG_REQUIRED, "{\"host\": \"192.0.2.10\"}", &object);
    source->kind = TL_SOURCE_MODBUS_TCP;
    source->timeout_s = 0.5;
    (void)tl_config_get_text(&object, "host", TL_CONFIG_REQUIRED, "\"192.0.2.10\"", &source->host);
    (void)tl_config_get_number(&object, "port", &port_rule, &port);
    (void)tl_config_get_number(&object, "timeout_s", &timeout, &source->timeout_s);
    read_period(&object, source, config);
    source->port = (uint16_t)port;
    tl_config_done(&object);
}

static void read_csv(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    tl_config_object object;
    (void)tl_config_member(entry, "csv", TL_CONFIG_REQUIRED, "{\"file\": \"plant.fifo\"}", &object);
    source->kind = TL_SOURCE_CSV;
    source->time_column = "time";
    (void)tl_config_get_text(&object, "file", TL_CONFIG_REQUIRED, "\"plant.fifo\"", &source->file);
    (void)tl_config_get_text(&object, "time_column", TL_CONFIG_OPTIONAL, "\"time\"", &source->time_column);
    read_period(&object, source, config);
    tl_config_done(&object);
}

static void read_source(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    bool modbus = tl_config_get(entry, "modbus_tcp", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    bool csv = tl_config_get(entry, "csv", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    bool can = tl_config_get(entry, "can", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    int kinds = (modbus ? 1 : 0) + (csv ? 1 : 0) + (can ? 1 : 0);
    if (kinds != 1) {
        tl_config_problem(entry->reader, entry->path, tl_json_line(entry->json),
                          kinds > 1 ? "several kinds of source" : "no kind of source",
                          "exactly one of modbus_tcp, csv, can", "{\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}");
    }
    if (modbus) {
        read_modbus_tcp(entry, source, config);
    }
    if (csv) {
        read_csv(entry, source, config);
    }
    if (can) {
        tl_config_read_can_source(entry, source);
        source->period_s = CAN_PERIOD_S;
    }
    tl_config_done(entry);
}

void tl_config_read_sources(tl_config_object *root, tl_config *config) {
    static const tl_config_map rule = {.most = TL_MAX_SIGNALS,
                                       .example = "{\"plc\": {\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}}"};
    tl_config_object map;
    config->source_count = tl_config_entries(root, "sources", &rule, &map);
    config->sources = tl_config_take(root->reader, config->source_count, sizeof *config->sources);
    if (config->sources == NULL) {
        return;
    }
    tl_config_source *source = config->sources;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        tl_config_object entry;
        tl_config_check_name(&map, item, "\"plc\"");
        source->name = item->string;
        if (tl_config_entry(&map, item, "{\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}", &entry)) {
            read_source(&entry, source, config);
        }
        source->where = tl_config_keep(root->reader, entry.path);
        source++;
    }
}

/* ---- where a signal's live values come from ---- */

/* Reads the name of a source of that kind and finds its index. */
static void read_source_name(tl_config_object *object, tl_config_need need, const char *kind,
                             tl_config_signal *signal) {
    const char *name = NULL;
    size_t index = 0;
    const cJSON *item = NULL;
    const cJSON *sources = cJSON_GetObjectItemCaseSensitive(object->reader->root, "sources");
    if (!tl_config_get_text(object, "source", need, "\"plc\"", &name) ||
        (sources != NULL && !cJSON_IsObject(sources))) { /* reported where it stands */
        return;
    }
    cJSON_ArrayForEach(item, sources) {
        if (strcmp(item->string, name) == 0) {
            break;
        }
        index++;
    }
    if (item != NULL && cJSON_GetObjectItemCaseSensitive(item, kind) != NULL) {
        signal->source = index;
    } else {
        char what[64];
        char expected[320];
        (void)snprintf(what, sizeof what, "the name of a %s source", kind);
        tl_config_list_names(what, sources, kind, expected, sizeof expected);
        tl_config_wrong(object, "source", NULL, expected, NULL);
    }
}

static void read_signal_csv(tl_config_object *entry, tl_config_signal *signal) {
    tl_config_object object;
    if (tl_config_member(entry, "csv", TL_CONFIG_OPTIONAL, "{\"column\": \"omega\"}", &object)) {
        (void)tl_config_get_text(&object, "column", TL_CONFIG_OPTIONAL, "\"omega\"", &signal->column);
        read_source_name(&object, TL_CONFIG_OPTIONAL, "csv", signal);
        tl_config_done(&object);
    }
}

/* ---- plant.NAME.modbus ---- */

static void read_unit_id(tl_config_object *object, tl_modbus_channel *channel) {
    static const tl_config_number rule = {
        .whole = true, .maximum = 255, .expected = "a whole number from 0 to 247, or 255", .example = "1"};
    double unit_id = 1;
    if (tl_config_get_number(object, "unit_id", &rule, &unit_id) && unit_id > 247 && unit_id < 255) {
        tl_config_wrong(object, "unit_id", NULL, rule.expected, rule.example);
    }
    channel->unit_id = (uint8_t)unit_id;
}

static void read_table_and_type(tl_config_object *object, tl_modbus_channel *channel) {
    static const char *const tables[] = {"coil", "discrete", "holding", "input", NULL};
    static const tl_modbus_table table_of[] = {TL_MODBUS_COIL, TL_MODBUS_DISCRETE, TL_MODBUS_HOLDING, TL_MODBUS_INPUT};
    static const char *const bit_types[] = {"bit", NULL};
    static const char *const word_types[] = {"int16", "uint16", "int32", "uint32", "float32", "float64", NULL};
    static const char *const all_types[] = {"int16", "uint16", "int32", "uint32", "float32", "float64", "bit", NULL};
    static const tl_modbus_type type_of[] = {TL_MODBUS_INT16,   TL_MODBUS_UINT16,  TL_MODBUS_INT32, TL_MODBUS_UINT32,
                                             TL_MODBUS_FLOAT32, TL_MODBUS_FLOAT64, TL_MODBUS_BIT};
    size_t index = 0;
    if (!tl_config_get_choice(object, "table", TL_CONFIG_REQUIRED, tables, &index)) {
        (void)tl_config_get_choice(object, "type", TL_CONFIG_OPTIONAL, all_types, &index);
        return;
    }
    channel->table = table_of[index];
    channel->type = TL_MODBUS_BIT;
    if (channel->table == TL_MODBUS_COIL || channel->table == TL_MODBUS_DISCRETE) {
        (void)tl_config_get_choice(object, "type", TL_CONFIG_OPTIONAL, bit_types, &index);
    } else if (tl_config_get_choice(object, "type", TL_CONFIG_REQUIRED, word_types, &index)) {
        channel->type = type_of[index];
    }
}

/* After the type: the last register must exist. */
static void read_address(tl_config_object *object, tl_modbus_channel *channel) {
    static const tl_config_number rule = {
        .need = TL_CONFIG_REQUIRED, .whole = true, .maximum = 65535, .example = "100"};
    double address = 0;
    if (!tl_config_get_number(object, "address", &rule, &address)) {
        return;
    }
    size_t registers = tl_modbus_registers(channel->type);
    channel->address = (uint16_t)address;
    if (channel->address + registers > 65536) {
        char expected[96];
        (void)snprintf(expected, sizeof expected, "at most %zu, because the value takes %zu registers",
                       65536 - registers, registers);
        tl_config_wrong(object, "address", NULL, expected, NULL);
    }
}

static bool is_little(tl_config_object *object, const char *key) {
    static const char *const orders[] = {"big", "little", NULL};
    size_t index = 0;
    return tl_config_get_choice(object, key, TL_CONFIG_OPTIONAL, orders, &index) && index == 1;
}

static void read_signal_modbus(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const example =
        "{\"source\": \"plc\", \"table\": \"holding\", \"address\": 100, \"type\": \"int16\"}";
    static const tl_config_number any = {.minimum = -HUGE_VAL, .maximum = HUGE_VAL, .example = "0.1"};
    tl_modbus_channel *channel = &signal->modbus;
    tl_config_object object;
    if (!tl_config_member(entry, "modbus", TL_CONFIG_OPTIONAL, example, &object)) {
        return;
    }
    if (signal->source != SIZE_MAX) {
        tl_config_wrong(entry, "modbus", "modbus beside csv.source", "at most one live source", NULL);
    }
    read_source_name(&object, TL_CONFIG_REQUIRED, "modbus_tcp", signal);
    read_unit_id(&object, channel);
    read_table_and_type(&object, channel);
    read_address(&object, channel);
    channel->words_little = is_little(&object, "words");
    channel->bytes_little = is_little(&object, "bytes");
    channel->scale = 1;
    if (tl_config_get_number(&object, "scale", &any, &channel->scale) && channel->scale == 0) {
        tl_config_wrong(&object, "scale", NULL, "a number other than 0", "0.1");
    }
    (void)tl_config_get_number(&object, "offset", &any, &channel->offset);
    tl_config_done(&object);
}

/* ---- plant.NAME.can ---- */

static void read_signal_can(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const example = "{\"source\": \"bus\", \"id\": \"0x123\", \"start\": 0, \"length\": 16}";
    tl_config_object object;
    if (!tl_config_member(entry, "can", TL_CONFIG_OPTIONAL, example, &object)) {
        return;
    }
    if (signal->source != SIZE_MAX) {
        tl_config_wrong(entry, "can", "can beside another live source", "at most one live source", NULL);
    }
    read_source_name(&object, TL_CONFIG_REQUIRED, "can", signal);
    tl_config_read_can_channel(&object, &signal->can);
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

static void read_signal(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const types[] = {"real", "integer", "boolean", NULL};
    static const tl_type type_of[] = {TL_REAL, TL_INTEGER, TL_BOOLEAN};
    size_t type = 0;
    bool given = tl_config_get(entry, "type", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    bool understood = tl_config_get_choice(entry, "type", TL_CONFIG_OPTIONAL, types, &type) || !given;
    signal->plan.type = type_of[type];
    (void)tl_config_get_text(entry, "unit", TL_CONFIG_MAY_BE_EMPTY, "\"rad/s\"", &signal->plan.unit);
    read_limits(entry, signal);
    if (understood) {
        read_initial(entry, &signal->plan);
    } else { /* its type is not known either */
        (void)tl_config_get(entry, "initial", TL_CONFIG_OPTIONAL, NULL, NULL);
    }
    read_signal_csv(entry, signal);
    read_signal_modbus(entry, signal);
    read_signal_can(entry, signal);
    tl_config_done(entry);
}

void tl_config_read_signals(tl_config_object *root, tl_config *config) {
    static const tl_config_map rule = {.need = TL_CONFIG_REQUIRED,
                                       .least = 1,
                                       .most = TL_MAX_SIGNALS,
                                       .example = "{\"omega\": {\"unit\": \"rad/s\"}}"};
    tl_config_object map;
    config->signal_count = tl_config_entries(root, "plant", &rule, &map);
    config->signals = tl_config_take(root->reader, config->signal_count, sizeof *config->signals);
    if (config->signals == NULL) {
        return;
    }
    tl_config_signal *signal = config->signals;
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        tl_config_object entry;
        tl_config_check_name(&map, item, "\"omega\"");
        signal->of = (size_t)(signal - config->signals);
        signal->plan.name = item->string;
        signal->plan.unit = "";
        signal->column = item->string;
        signal->source = SIZE_MAX;
        if (tl_config_entry(&map, item, "{\"unit\": \"rad/s\"}", &entry)) {
            read_signal(&entry, signal);
        }
        signal->plan.where = tl_config_keep(root->reader, entry.path);
        signal++;
    }
}
