/* `sources.NAME.modbus_tcp`, `sources.NAME.modbus_rtu` and `plant.NAME.modbus`: the two rows of the
 * driver board/modbus. */
#include <arpa/inet.h>
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "board/io/bits.h"
#include "board/modbus/modbus.h"
#include "firmware/config/config_change.h"
#include "firmware/config/config_reader.h"
#include "firmware/config/drivers.h"

enum { EXPECTED = 160 };

/* ---- sources.NAME ---- */

static void read_timeout(tl_config_object *object, tl_modbus_settings *settings) {
    static const tl_config_number timeout = {.minimum = 0.001, .maximum = 60, .example = "0.5"};
    settings->timeout_s = 0.5;
    (void)tl_config_get_number(object, "timeout_s", &timeout, &settings->timeout_s);
}

/* How devices are asked, by TCP and on a line. */
static void read_manners(tl_config_object *object, tl_modbus_settings *settings) {
    static const tl_config_number most = {
        .whole = true, .minimum = 1, .maximum = TL_MODBUS_MAX_REGISTERS, .example = "16"};
    static const tl_config_number pause = {.minimum = 0, .maximum = 60, .example = "0.05"};
    double most_registers = TL_MODBUS_MAX_REGISTERS;
    (void)tl_config_get_number(object, "most_registers", &most, &most_registers);
    (void)tl_config_get_boolean(object, "split_failed", &settings->split_failed);
    (void)tl_config_get_number(object, "pause_s", &pause, &settings->pause_s);
    settings->most_registers = (uint8_t)most_registers;
}

static void read_tcp_source(tl_config_object *object, tl_config_source *source) {
    static const tl_config_number port_rule = {.whole = true, .minimum = 1, .maximum = 65535, .example = "502"};
    static const char *const framings[] = {"tcp", "rtu", NULL};
    tl_modbus_settings *settings = source->settings;
    size_t framing = 0;
    double port = 502;
    (void)tl_config_get_text(object, "host", TL_CONFIG_REQUIRED, "\"192.0.2.10\"", &settings->host);
    (void)tl_config_get_number(object, "port", &port_rule, &port);
    (void)tl_config_get_boolean(object, "any_unit_id", &settings->any_unit_id);
    (void)tl_config_get_boolean(object, "any_transaction_id", &settings->any_transaction_id);
    (void)tl_config_get_choice(object, "framing", TL_CONFIG_OPTIONAL, framings, &framing);
    settings->rtu_framing = framing == 1;
    read_timeout(object, settings);
    read_manners(object, settings);
    settings->port = (uint16_t)port;
}

/* The path is kept as written. */
static const char *device_of(const tl_config_source *source) {
    const tl_modbus_settings *settings = source->settings;
    return settings->line.device;
}

static void read_device(tl_config_object *object, tl_config_source *source) {
    static const char *const example = "\"/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0\"";
    tl_modbus_settings *settings = source->settings;
    settings->line.device = "";
    if (!tl_config_get_text(object, "device", TL_CONFIG_REQUIRED, example, &settings->line.device)) {
        return;
    }
    for (const tl_config_source *other = object->reader->config->sources; other < source; other++) {
        if (other->driver == source->driver && strcmp(device_of(other), device_of(source)) == 0) {
            char found[TL_JSON_PATH + 32];
            (void)snprintf(found, sizeof found, "the device of %s", other->where);
            tl_config_wrong(object, "device", found,
                            "a device that no other source uses (one source reads all units of a line)", NULL);
            return;
        }
    }
}

static void read_baud(tl_config_object *object, tl_modbus_line *line) {
    char expected[160];
    size_t used = (size_t)snprintf(expected, sizeof expected, "one of");
    for (const uint32_t *baud = tl_modbus_bauds; *baud != 0; baud++) {
        used += (size_t)snprintf(expected + used, sizeof expected - used, "%s %u", baud == tl_modbus_bauds ? "" : ",",
                                 (unsigned)*baud);
    }
    const tl_config_number rule = {
        .whole = true, .minimum = 1200, .maximum = 1000000, .expected = expected, .example = "19200"};
    double value = 19200;
    const uint32_t *known = tl_modbus_bauds;
    if (tl_config_get_number(object, "baud", &rule, &value)) {
        while (*known != 0 && *known != (uint32_t)value) {
            known++;
        }
        if (*known == 0) {
            tl_config_wrong(object, "baud", NULL, expected, "19200");
        }
    }
    line->baud = (uint32_t)value;
}

static void read_rtu_source(tl_config_object *object, tl_config_source *source) {
    static const tl_config_number stop_rule = {.whole = true, .minimum = 1, .maximum = 2, .example = "1"};
    static const char *const parities[] = {"even", "odd", "none", NULL};
    tl_modbus_settings *settings = source->settings;
    tl_modbus_line *line = &settings->line;
    size_t parity = 0;
    read_device(object, source);
    read_baud(object, line);
    (void)tl_config_get_choice(object, "parity", TL_CONFIG_OPTIONAL, parities, &parity);
    double stop_bits = parity == 2 ? 2 : 1;
    (void)tl_config_get_number(object, "stop_bits", &stop_rule, &stop_bits);
    (void)tl_config_get_boolean(object, "rs485", &line->rs485);
    (void)tl_config_get_boolean(object, "echo", &line->echo);
    read_timeout(object, settings);
    read_manners(object, settings);
    line->parity = "EON"[parity];
    line->stop_bits = (uint8_t)stop_bits;
}

/* ---- plant.NAME.modbus ---- */

/* 0 and 255 address the device itself, without a gateway. On a serial line, 0 is a broadcast, and
 * no device answers it. */
static void read_unit_id(tl_config_object *object, const cJSON *source, tl_modbus_channel *channel) {
    static const char *const line[] = {"modbus_rtu", NULL};
    static const tl_config_number rule = {
        .whole = true, .maximum = 255, .expected = "a whole number from 0 to 247, or 255", .example = "1"};
    double unit_id = 1;
    if (tl_config_get_number(object, "unit_id", &rule, &unit_id)) {
        if (unit_id > 247 && unit_id < 255) {
            tl_config_wrong(object, "unit_id", NULL, rule.expected, rule.example);
        } else if ((unit_id < 1 || unit_id > 247) && source != NULL && tl_config_is_of_kind(source, line)) {
            tl_config_wrong(object, "unit_id", NULL, "a whole number from 1 to 247 (modbus_rtu has no 0 and 255)",
                            rule.example);
        }
    }
    channel->unit_id = (uint8_t)unit_id;
}

static void read_table_and_type(tl_config_object *object, tl_modbus_channel *channel) {
    static const char *const tables[] = {"coil", "discrete", "holding", "input", NULL};
    static const tl_modbus_table table_of[] = {TL_MODBUS_COIL, TL_MODBUS_DISCRETE, TL_MODBUS_HOLDING, TL_MODBUS_INPUT};
    static const char *const bit_types[] = {"bit", NULL};
    static const char *const word_types[] = {"int16",   "uint16", "int32", "uint32", "int64", "uint64", "float32",
                                             "float64", "bcd16",  "bcd32", "int8",   "uint8", "bit",    NULL};
    static const tl_modbus_type type_of[] = {
        TL_MODBUS_INT16,  TL_MODBUS_UINT16,  TL_MODBUS_INT32,       TL_MODBUS_UINT32, TL_MODBUS_INT64,
        TL_MODBUS_UINT64, TL_MODBUS_FLOAT32, TL_MODBUS_FLOAT64,     TL_MODBUS_BCD16,  TL_MODBUS_BCD32,
        TL_MODBUS_INT8,   TL_MODBUS_UINT8,   TL_MODBUS_REGISTER_BIT};
    size_t index = 0;
    if (!tl_config_get_choice(object, "table", TL_CONFIG_REQUIRED, tables, &index)) {
        (void)tl_config_get_choice(object, "type", TL_CONFIG_OPTIONAL, word_types, &index);
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

/* The part of a register; other types have none. */
static void read_part(tl_config_object *object, tl_modbus_channel *channel) {
    static const tl_config_number rule = {
        .need = TL_CONFIG_REQUIRED, .whole = true, .minimum = 0, .maximum = 15, .example = "3"};
    static const char *const parts[] = {"low", "high", NULL};
    double bit = 0;
    size_t part = 0;
    if (channel->type == TL_MODBUS_REGISTER_BIT) {
        (void)tl_config_get_number(object, "bit", &rule, &bit);
    } else if (tl_modbus_part_bits(channel->type) == 8) {
        (void)tl_config_get_choice(object, "byte", TL_CONFIG_OPTIONAL, parts, &part);
    }
    channel->bit = (uint8_t)(8.0 * (double)part + bit);
}

/* The raw numbers of a type. A signed integer may also be written as the content of its
 * registers. */
static tl_config_number raw_rule(tl_modbus_type type) {
    switch (type) {
    case TL_MODBUS_FLOAT32:
        return (tl_config_number){.minimum = -(double)FLT_MAX, .maximum = (double)FLT_MAX};
    case TL_MODBUS_FLOAT64:
        return (tl_config_number){.minimum = -DBL_MAX, .maximum = DBL_MAX};
    case TL_MODBUS_BCD16:
        return (tl_config_number){.whole = true, .maximum = 9999};
    case TL_MODBUS_BCD32:
        return (tl_config_number){.whole = true, .maximum = 99999999};
    case TL_MODBUS_INT8:
        return (tl_config_number){.whole = true, .minimum = INT8_MIN, .maximum = UINT8_MAX};
    case TL_MODBUS_INT16:
        return (tl_config_number){.whole = true, .minimum = INT16_MIN, .maximum = UINT16_MAX};
    case TL_MODBUS_INT32:
        return (tl_config_number){.whole = true, .minimum = INT32_MIN, .maximum = UINT32_MAX};
    case TL_MODBUS_INT64: /* a double cannot hold the content of all registers */
        return (tl_config_number){.whole = true, .minimum = -0x1p63, .maximum = 0x1p63};
    case TL_MODBUS_UINT8:
        return (tl_config_number){.whole = true, .maximum = UINT8_MAX};
    case TL_MODBUS_UINT32:
        return (tl_config_number){.whole = true, .maximum = UINT32_MAX};
    case TL_MODBUS_UINT64:
        return (tl_config_number){.whole = true, .maximum = 0x1p64};
    case TL_MODBUS_UINT16:
    case TL_MODBUS_BIT:
    case TL_MODBUS_REGISTER_BIT:
        break;
    }
    return (tl_config_number){.whole = true, .maximum = UINT16_MAX};
}

/* The number that the driver reads if a device sends this one. */
static double as_read(const tl_modbus_channel *channel, double code) {
    const double turns = ldexp(1, channel->type == TL_MODBUS_INT8 ? 8 : 16 * (int)tl_modbus_registers(channel->type));
    const bool is_signed = channel->type == TL_MODBUS_INT8 || channel->type == TL_MODBUS_INT16 ||
                           channel->type == TL_MODBUS_INT32 || channel->type == TL_MODBUS_INT64;
    if (channel->type == TL_MODBUS_FLOAT32) {
        return tl_bits_to_float32(tl_bits_of_float32(code));
    }
    return is_signed && code >= turns / 2 ? code - turns : code;
}

static void read_codes(tl_config_object *object, tl_modbus_channel *channel) {
    char expected[EXPECTED];
    const tl_config_number rule = raw_rule(channel->type);
    if (channel->type == TL_MODBUS_BIT || channel->type == TL_MODBUS_REGISTER_BIT) {
        return; /* the key is unknown */
    }
    (void)snprintf(expected, sizeof expected, "an array of 1 to %d %s from %.15g to %.15g", (int)TL_MODBUS_CODES,
                   rule.whole ? "whole numbers" : "numbers", rule.minimum, rule.maximum);
    const cJSON *codes = tl_config_get_array(object, "not_available", expected, "[32768]");
    const cJSON *code = NULL;
    bool is_right = cJSON_GetArraySize(codes) >= 1 && cJSON_GetArraySize(codes) <= TL_MODBUS_CODES;
    cJSON_ArrayForEach(code, codes) {
        const double number = code->valuedouble;
        is_right = is_right && cJSON_IsNumber(code) && number >= rule.minimum && number <= rule.maximum &&
                   (!rule.whole || number == floor(number));
        if (is_right) {
            channel->codes[channel->code_count] = as_read(channel, number);
            channel->code_count++;
        }
    }
    if (codes != NULL && !is_right) {
        tl_config_wrong(object, "not_available", NULL, expected, "[32768]");
    }
}

/* Called after the type is known, because the last register must exist. */
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

static void read_signal(tl_config_object *object, const cJSON *named, tl_config_signal *signal) {
    tl_modbus_channel *channel = signal->channel;
    read_unit_id(object, named, channel);
    read_table_and_type(object, channel);
    read_part(object, channel);
    read_codes(object, channel);
    read_address(object, channel);
    channel->words_little = is_little(object, "words");
    channel->bytes_little = is_little(object, "bytes");
    tl_config_get_scale(object, &channel->scale, &channel->offset);
}

/* ---- the rows ---- */

/* The resolution of a host name cannot be interrupted and has its own time limits. */
static const tl_time RESOLVE = 60 * TL_SECOND;

/* Time-outs of a poll between two readings: one to connect, three for a request that the device
 * rejects in three forms. */
enum { POLL_TIMEOUTS = 4 };

/* Bits of the longest request and its response on a serial line. */
enum { LINE_BITS = 264 * 12 };

static void reach_server(const tl_config_source *source, tl_source_reach *reach) {
    const tl_modbus_settings *settings = source->settings;
    unsigned char address[sizeof(struct in6_addr)];
    reach->port = settings->port;
    reach->names =
        inet_pton(AF_INET, settings->host, address) != 1 && inet_pton(AF_INET6, settings->host, address) != 1;
    reach->wait =
        POLL_TIMEOUTS * tl_time_of_seconds(settings->timeout_s + settings->pause_s) + (reach->names ? RESOLVE : 0);
}

static void reach_line(const tl_config_source *source, tl_source_reach *reach) {
    const tl_modbus_settings *settings = source->settings;
    reach->write = settings->line.device;
    reach->wait = POLL_TIMEOUTS * (tl_time_of_seconds(settings->timeout_s + settings->pause_s) +
                                   LINE_BITS * TL_SECOND / settings->line.baud);
}

/* TCP: `path` is NULL. */
static tl_status open_modbus(const tl_config_source *source, const char *path, const void *channels, size_t count,
                             tl_plant_io **io, tl_error *error) {
    tl_modbus_settings settings = *(const tl_modbus_settings *)source->settings;
    settings.line.device = path;
    settings.period_s = source->period_s;
    settings.channels = channels;
    settings.channel_count = count;
    return tl_modbus_open(&settings, io, error);
}

static const tl_change_rule TCP_RULES[] = {
    {"sources.*.modbus_tcp.any_transaction_id", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_tcp.any_unit_id", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_tcp.most_registers", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_tcp.pause_s", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_tcp.period_s", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_tcp.split_failed", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_tcp.timeout_s", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_tcp.**", TL_RULE_COMMISSION, NULL},
    {"plant.*.modbus.**", TL_RULE_COMMISSION, NULL},
    {NULL, TL_RULE_COMMISSION, NULL},
};

static const tl_change_rule RTU_RULES[] = {
    {"sources.*.modbus_rtu.most_registers", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_rtu.pause_s", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_rtu.period_s", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_rtu.split_failed", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_rtu.timeout_s", TL_RULE_RETUNE, NULL},
    {"sources.*.modbus_rtu.**", TL_RULE_COMMISSION, NULL},
    {NULL, TL_RULE_COMMISSION, NULL},
};

const tl_driver tl_driver_modbus_tcp = {
    .name = "modbus_tcp",
    .source_example = "{\"host\": \"192.0.2.10\"}",
    .signal_example = "{\"source\": \"plc\", \"table\": \"holding\", \"address\": 100, \"type\": \"int16\"}",
    .signal_key = "modbus",
    .settings_bytes = sizeof(tl_modbus_settings),
    .channel_bytes = sizeof(tl_modbus_channel),
    .read_source = read_tcp_source,
    .read_signal = read_signal,
    .rules = TCP_RULES,
    .is_polled = true,
    .io = &tl_modbus_driver,
    .access = &tl_modbus_tcp_access,
    .reach = reach_server,
    .open = open_modbus,
};

const tl_driver tl_driver_modbus_rtu = {
    .name = "modbus_rtu",
    .source_example = "{\"device\": \"/dev/ttyUSB0\"}",
    .signal_key = "modbus",
    .settings_bytes = sizeof(tl_modbus_settings),
    .channel_bytes = sizeof(tl_modbus_channel),
    .read_source = read_rtu_source,
    .rules = RTU_RULES,
    .is_polled = true,
    .not_played = "by Modbus RTU",
    .io = &tl_modbus_driver,
    .access = &tl_modbus_rtu_access,
    .reach = reach_line,
    .open = open_modbus,
};
