/* `sources` and `plant`: where the plant's values come from, and what they are. */
#include "firmware/config_parts.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/config_names.h"

/* ---- sources ---- */

void tl_config_read_period(tl_config_object *object, tl_config_source *source, const tl_config *config) {
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
    tl_config_read_period(&object, source, config);
    source->port = (uint16_t)port;
    tl_config_done(&object);
}

static void read_device(tl_config_object *object, tl_config_source *source, const tl_config *config) {
    static const char *const example = "\"/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0\"";
    source->line.device = "";
    if (!tl_config_get_text(object, "device", TL_CONFIG_REQUIRED, example, &source->line.device)) {
        return;
    }
    for (const tl_config_source *other = config->sources; other < source; other++) {
        if (other->kind == TL_SOURCE_MODBUS_RTU && strcmp(other->line.device, source->line.device) == 0) {
            char found[TL_JSON_PATH + 32];
            (void)snprintf(found, sizeof found, "the device of %s", other->where);
            tl_config_wrong(object, "device", found, "a line of its own: one source reads all units of a line", NULL);
            return;
        }
    }
}

static void read_baud(tl_config_object *object, tl_config_source *source) {
    char expected[160];
    size_t used = (size_t)snprintf(expected, sizeof expected, "one of");
    for (const uint32_t *baud = tl_modbus_bauds; *baud != 0; baud++) {
        used += (size_t)snprintf(expected + used, sizeof expected - used, "%s %u", baud == tl_modbus_bauds ? "" : ",",
                                 (unsigned)*baud);
    }
    const tl_config_number rule = {
        .whole = true, .minimum = 1200, .maximum = 1000000, .expected = expected, .example = "19200"};
    double given = 19200;
    const uint32_t *known = tl_modbus_bauds;
    if (tl_config_get_number(object, "baud", &rule, &given)) {
        while (*known != 0 && *known != (uint32_t)given) {
            known++;
        }
        if (*known == 0) {
            tl_config_wrong(object, "baud", NULL, expected, "19200");
        }
    }
    source->line.baud = (uint32_t)given;
}

static void read_modbus_rtu(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    static const tl_config_number timeout = {.minimum = 0.001, .maximum = 60, .example = "0.5"};
    static const tl_config_number stop_rule = {.whole = true, .minimum = 1, .maximum = 2, .example = "1"};
    static const char *const parities[] = {"even", "odd", "none", NULL};
    tl_config_object object;
    size_t parity = 0;
    (void)tl_config_member(entry, "modbus_rtu", TL_CONFIG_REQUIRED, "{\"device\": \"/dev/ttyUSB0\"}", &object);
    source->kind = TL_SOURCE_MODBUS_RTU;
    source->timeout_s = 0.5;
    read_device(&object, source, config);
    read_baud(&object, source);
    (void)tl_config_get_choice(&object, "parity", TL_CONFIG_OPTIONAL, parities, &parity);
    double stop_bits = parity == 2 ? 2 : 1;
    (void)tl_config_get_number(&object, "stop_bits", &stop_rule, &stop_bits);
    (void)tl_config_get_boolean(&object, "rs485", &source->line.rs485);
    (void)tl_config_get_number(&object, "timeout_s", &timeout, &source->timeout_s);
    tl_config_read_period(&object, source, config);
    source->line.parity = "EON"[parity];
    source->line.stop_bits = (uint8_t)stop_bits;
    tl_config_done(&object);
}

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
    {"modbus_tcp", read_modbus_tcp},
    {"modbus_rtu", read_modbus_rtu},
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
        source->line.device = "";
        if (tl_config_entry(&map, item, "{\"modbus_tcp\": {\"host\": \"192.0.2.10\"}}", &entry)) {
            read_source(&entry, source, config);
        }
        source->where = tl_config_keep(root->reader, entry.path);
        source++;
    }
}

/* ---- where a signal's live values come from ---- */

const cJSON *tl_config_read_source_name(tl_config_object *object, tl_config_need need, const char *what,
                                        const char *const *kinds, tl_config_signal *signal) {
    const char *name = NULL;
    size_t index = 0;
    const cJSON *item = NULL;
    const cJSON *sources = cJSON_GetObjectItemCaseSensitive(object->reader->root, "sources");
    if (!tl_config_get_text(object, "source", need, "\"plc\"", &name) ||
        (sources != NULL && !cJSON_IsObject(sources))) { /* reported where it stands */
        return NULL;
    }
    cJSON_ArrayForEach(item, sources) {
        if (strcmp(item->string, name) == 0) {
            break;
        }
        index++;
    }
    if (item != NULL && tl_config_is_of_kind(item, kinds)) {
        signal->source = index;
        return item;
    }
    char expected[320];
    tl_config_list_names(what, sources, kinds, expected, sizeof expected);
    tl_config_wrong(object, "source", NULL, expected, NULL);
    return NULL;
}

static void read_signal_csv(tl_config_object *entry, tl_config_signal *signal) {
    static const char *const kinds[] = {"csv", NULL};
    tl_config_object object;
    if (tl_config_member(entry, "csv", TL_CONFIG_OPTIONAL, "{\"column\": \"omega\"}", &object)) {
        (void)tl_config_get_text(&object, "column", TL_CONFIG_OPTIONAL, "\"omega\"", &signal->column);
        (void)tl_config_read_source_name(&object, TL_CONFIG_OPTIONAL, "the name of a csv source", kinds, signal);
        tl_config_done(&object);
    }
}

/* ---- plant.NAME.modbus ---- */

/* 0, 255: the device itself, behind no gateway; 0 on a line is everybody, and nobody answers. */
static void read_unit_id(tl_config_object *object, const cJSON *source, tl_modbus_channel *channel) {
    static const char *const line[] = {"modbus_rtu", NULL};
    static const tl_config_number rule = {
        .whole = true, .maximum = 255, .expected = "a whole number from 0 to 247, or 255", .example = "1"};
    double unit_id = 1;
    if (tl_config_get_number(object, "unit_id", &rule, &unit_id)) {
        if (unit_id > 247 && unit_id < 255) {
            tl_config_wrong(object, "unit_id", NULL, rule.expected, rule.example);
        } else if ((unit_id < 1 || unit_id > 247) && source != NULL && tl_config_is_of_kind(source, line)) {
            tl_config_wrong(object, "unit_id", NULL, "a unit of a line, a whole number from 1 to 247", rule.example);
        }
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
    static const char *const kinds[] = {"modbus_tcp", "modbus_rtu", NULL};
    tl_modbus_channel *channel = &signal->modbus;
    tl_config_object object;
    if (!tl_config_member(entry, "modbus", TL_CONFIG_OPTIONAL, example, &object)) {
        return;
    }
    if (signal->source != SIZE_MAX) {
        tl_config_wrong(entry, "modbus", "modbus beside csv.source", "at most one live source", NULL);
    }
    const cJSON *source = tl_config_read_source_name(&object, TL_CONFIG_REQUIRED,
                                                     "the name of a modbus_tcp or modbus_rtu source", kinds, signal);
    read_unit_id(&object, source, channel);
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

static void read_signal(tl_config_object *entry, const tl_config *config, tl_config_signal *signal) {
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
    tl_config_read_can_signal(entry, signal);
    tl_config_read_gpio_signal(entry, config, signal);
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
            read_signal(&entry, config, signal);
        }
        signal->plan.where = tl_config_keep(root->reader, entry.path);
        signal++;
    }
}
