/* `sources.NAME.modbus_tcp`, `sources.NAME.modbus_rtu` and `plant.NAME.modbus`. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "firmware/config/config_parts.h"
#include "firmware/config/config_reader.h"

/* ---- sources.NAME ---- */

void tl_config_read_modbus_tcp_source(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
    static const tl_config_number port_rule = {.whole = true, .minimum = 1, .maximum = 65535, .example = "502"};
    static const tl_config_number timeout = {.minimum = 0.001, .maximum = 60, .example = "0.5"};
    tl_config_object object;
    double port = 502;
    (void)tl_config_member(entry, "modbus_tcp", TL_CONFIG_REQUIRED, "{\"host\": \"192.0.2.10\"}", &object);
    source->kind = TL_SOURCE_MODBUS_TCP;
    source->timeout_s = 0.5;
    (void)tl_config_get_text(&object, "host", TL_CONFIG_REQUIRED, "\"192.0.2.10\"", &source->host);
    (void)tl_config_get_number(&object, "port", &port_rule, &port);
    (void)tl_config_get_boolean(&object, "any_unit_id", &source->any_unit_id);
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

void tl_config_read_modbus_rtu_source(tl_config_object *entry, tl_config_source *source, const tl_config *config) {
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

void tl_config_read_modbus_signal(tl_config_object *entry, tl_config_signal *signal) {
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
