/* `sources.NAME.can` and `plant.NAME.can`: a CAN interface, and the position of a signal in the
 * frames of its bus; the row of the driver board/can. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board/can/can.h"
#include "firmware/config/config_change.h"
#include "firmware/config/config_reader.h"
#include "firmware/config/drivers.h"

enum { EXPECTED = 160 };

/* Frames wake up the reader at most this often; faster frames are processed together. */
#define PERIOD_S 0.0005

/* ---- sources.NAME.can ---- */

static void read_source(tl_config_object *object, tl_config_source *source) {
    tl_can_settings *settings = source->settings;
    if (!tl_config_get_text(object, "interface", TL_CONFIG_REQUIRED, "\"can0\"", &settings->interface)) {
        return;
    }
    const char *name = settings->interface;
    if (strlen(name) > TL_CAN_INTERFACE || strpbrk(name, "/: \t") != NULL || strcmp(name, ".") == 0 ||
        strcmp(name, "..") == 0) {
        tl_config_wrong(object, "interface", NULL,
                        "the name of a network interface: at most 15 characters, no space, slash or colon", "\"can0\"");
    }
}

/* ---- plant.NAME.can ---- */

/* Accepts a number or a hexadecimal text. */
static bool parse_id(const cJSON *item, double *id) {
    if (cJSON_IsNumber(item)) {
        *id = item->valuedouble;
        return *id == floor(*id);
    }
    const char *text = cJSON_IsString(item) ? item->valuestring : "";
    size_t digits = strlen(text) > 2 ? strspn(text + 2, "0123456789abcdefABCDEF") : 0;
    if (strncmp(text, "0x", 2) != 0 || digits == 0 || digits > 8 || text[2 + digits] != '\0') {
        return false;
    }
    *id = (double)strtoul(text + 2, NULL, 16);
    return true;
}

static void read_pgn(tl_config_object *object, tl_can_channel *channel) {
    static const tl_config_number pgn_rule = {.whole = true, .maximum = 0x3FFFF, .example = "61444"};
    static const tl_config_number source_rule = {.whole = true, .maximum = 255, .example = "0"};
    double pgn = 0;
    double source = 0;
    bool extended = true;
    if (tl_config_get_number(object, "pgn", &pgn_rule, &pgn) && tl_can_pgn_is_addressed((uint32_t)pgn) &&
        ((uint32_t)pgn & 0xFF) != 0) {
        tl_config_wrong(object, "pgn", NULL,
                        "a multiple of 256 (PDU1), or one whose lower 16 bits are at least 0xF000 (PDU2)", "61444");
    }
    bool has_source = tl_config_get_number(object, "source_address", &source_rule, &source);
    if (tl_config_get(object, "id", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
        tl_config_wrong(object, "id", NULL, "either id or pgn", NULL);
    }
    if (tl_config_get_boolean(object, "extended", &extended) && !extended) {
        tl_config_wrong(object, "extended", NULL, "true, because a PGN needs an id of 29 bits", NULL);
    }
    channel->id = tl_can_pgn_id((uint32_t)pgn, (uint8_t)source);
    channel->extended = true;
    channel->match = has_source ? TL_CAN_BY_PGN_AND_SOURCE : TL_CAN_BY_PGN;
}

static void read_id(tl_config_object *object, tl_can_channel *channel) {
    static const char *const expected = "an id from 0 to 0x1FFFFFFF, a whole number or a hexadecimal text";
    static const char *const example = "\"0x18FEF100\"";
    double id = 0;
    const cJSON *item = tl_config_get(object, "id", TL_CONFIG_REQUIRED, expected, example);
    bool is_valid = item != NULL && parse_id(item, &id) && id >= 0 && id <= 0x1FFFFFFF;
    if (item != NULL && !is_valid) {
        tl_config_wrong(object, "id", NULL, expected, example);
    }
    channel->id = is_valid ? (uint32_t)id : 0;
    channel->extended = channel->id > 0x7FF;
    if (tl_config_get_boolean(object, "extended", &channel->extended) && !channel->extended && channel->id > 0x7FF) {
        tl_config_wrong(object, "extended", NULL, "true, because the id has more than 11 bits", NULL);
    }
}

static void read_frame(tl_config_object *object, tl_can_channel *channel) {
    static const tl_config_number rule = {.whole = true,
                                          .minimum = 1,
                                          .maximum = TL_CAN_BYTES,
                                          .expected = "a length of a frame: 1 to 8, 12, 16, 20, 24, 32, 48 or 64",
                                          .example = "8"};
    bool has_bytes = tl_config_get(object, "bytes", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL;
    double bytes =
        has_bytes ? TL_CAN_BYTES : 8; /* if the length is invalid, all bits are accepted: one mistake, one problem */
    if (tl_config_get_number(object, "bytes", &rule, &bytes) && !tl_can_is_length((unsigned)bytes)) {
        tl_config_wrong(object, "bytes", NULL, rule.expected, rule.example);
        bytes = TL_CAN_BYTES;
    }
    channel->bytes = (uint8_t)bytes;
    channel->fd = channel->bytes > 8;
    if (tl_config_get_boolean(object, "fd", &channel->fd) && !channel->fd && channel->bytes > 8) {
        tl_config_wrong(object, "fd", NULL, "true, because a classic frame has at most 8 bytes", NULL);
    }
}

/* Reads start, length and order. `length` 0: the file must give it. Returns false if the number of
 * bits is unknown. */
static bool read_field(tl_config_object *object, size_t most, size_t length, size_t bytes, tl_can_field *field) {
    static const char *const orders[] = {"intel", "motorola", NULL};
    static const tl_config_number start_rule = {
        .need = TL_CONFIG_REQUIRED, .whole = true, .maximum = 8 * TL_CAN_BYTES - 1, .example = "0"};
    const tl_config_number length_rule = {.need = length == 0 ? TL_CONFIG_REQUIRED : TL_CONFIG_OPTIONAL,
                                          .whole = true,
                                          .minimum = 1,
                                          .maximum = (double)most,
                                          .example = "16"};
    char expected[EXPECTED];
    double start = 0;
    double bits = length == 0 ? 1 : (double)length;
    size_t order = 0;
    bool has_start = tl_config_get_number(object, "start", &start_rule, &start);
    bool has_length = tl_config_get_number(object, "length", &length_rule, &bits) || length != 0;
    if (length != 0 && bits != (double)length) {
        (void)snprintf(expected, sizeof expected, "%zu, the number of bits of its type", length);
        tl_config_wrong(object, "length", NULL, expected, NULL);
        bits = (double)length;
    }
    (void)tl_config_get_choice(object, "order", TL_CONFIG_OPTIONAL, orders, &order);
    *field = (tl_can_field){
        .start = (uint16_t)start, .length = (uint16_t)bits, .order = order == 0 ? TL_CAN_INTEL : TL_CAN_MOTOROLA};
    size_t needed = tl_can_field_bytes(field);
    if (has_start && needed > bytes) {
        (void)snprintf(expected, sizeof expected,
                       "a start with which all %u bits (%s) fit into the frame's %zu bytes (now they need %zu)",
                       (unsigned)field->length, orders[order], bytes, needed);
        tl_config_wrong(object, "start", NULL, expected, NULL);
    }
    return has_length;
}

/* Returns false if the number of bits is unknown. */
static bool read_type(tl_config_object *object, tl_can_channel *channel) {
    static const char *const types[] = {[TL_CAN_UNSIGNED] = "unsigned",
                                        [TL_CAN_SIGNED] = "signed",
                                        [TL_CAN_FLOAT32] = "float32",
                                        [TL_CAN_FLOAT64] = "float64",
                                        NULL};
    static const size_t length_of[] = {[TL_CAN_FLOAT32] = 32, [TL_CAN_FLOAT64] = 64};
    size_t index = TL_CAN_UNSIGNED;
    (void)tl_config_get_choice(object, "type", TL_CONFIG_OPTIONAL, types, &index);
    channel->type = (tl_can_type)index;
    return read_field(object, 64, length_of[index], channel->bytes, &channel->field);
}

static void read_not_available(tl_config_object *object, bool has_length, tl_can_channel *channel) {
    bool fits = channel->type == TL_CAN_UNSIGNED && (channel->field.length >= 2 || !has_length);
    if (tl_config_get_boolean(object, "not_available", &channel->not_available) && channel->not_available && !fits) {
        tl_config_wrong(object, "not_available", NULL, "false, because the signal is not unsigned with 2 bits or more",
                        NULL);
    }
}

/* ---- multiplexors ---- */

/* Reads "3-7". */
static bool parse_range(const char *text, double *low, double *high) {
    static const char digits[] = "0123456789";
    size_t first = strspn(text, digits);
    size_t last = text[first] == '-' ? strspn(text + first + 1, digits) : 0;
    if (first == 0 || last == 0 || text[first + 1 + last] != '\0') {
        return false;
    }
    *low = strtod(text, NULL);
    *high = strtod(text + first + 1, NULL);
    return true;
}

static bool read_value(const cJSON *item, double most, uint32_t *value, uint32_t *further) {
    double low = cJSON_IsNumber(item) ? item->valuedouble : -1;
    double high = low;
    if (cJSON_IsString(item) && !parse_range(item->valuestring, &low, &high)) {
        return false;
    }
    bool right = low >= 0 && low <= high && high <= most && low == floor(low);
    *value = right ? (uint32_t)low : 0;
    *further = right ? (uint32_t)(high - low) : 0;
    return right;
}

/* One value or range, or an array of them. */
static void read_values(tl_config_object *object, int bits, tl_can_condition *condition) {
    char expected[EXPECTED];
    double most = ldexp(1, bits) - 1;
    (void)snprintf(expected, sizeof expected,
                   "a whole number from 0 to %.15g, a range \"3-7\", or an array of 1 to %d of these", most,
                   (int)TL_CAN_CONDITION_VALUES);
    const cJSON *item = tl_config_get(object, "value", TL_CONFIG_REQUIRED, expected, "3");
    if (item == NULL) {
        return;
    }
    int count = cJSON_IsArray(item) ? cJSON_GetArraySize(item) : 1;
    bool right = count >= 1 && count <= TL_CAN_CONDITION_VALUES;
    const cJSON *one = cJSON_IsArray(item) ? item->child : item;
    for (int i = 0; right && i < count; i++) {
        right = read_value(one, most, &condition->values[i], &condition->further[i]);
        one = one->next;
    }
    condition->value_count = (size_t)count;
    if (!right) {
        tl_config_wrong(object, "value", NULL, expected, "3");
    }
}

/* Reads a multiplexor, then the one on which it depends, and so on. */
static void read_multiplex(tl_config_object *outer, tl_can_channel *channel) {
    static const char *const example = "{\"start\": 0, \"length\": 4, \"value\": 3}";
    tl_config_object levels[TL_CAN_CONDITIONS];
    tl_config_object *object = outer;
    for (size_t i = 0; i < TL_CAN_CONDITIONS; i++) {
        if (!tl_config_member(object, "multiplex", TL_CONFIG_OPTIONAL, example, &levels[i])) {
            break;
        }
        object = &levels[i];
        tl_can_condition *condition = &channel->conditions[i];
        bool has_length = read_field(object, TL_CAN_MULTIPLEXOR_BITS, 0, channel->bytes, &condition->field);
        read_values(object, has_length ? condition->field.length : TL_CAN_MULTIPLEXOR_BITS, condition);
        channel->condition_count = i + 1;
    }
    if (channel->condition_count == TL_CAN_CONDITIONS &&
        tl_config_get(object, "multiplex", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
        tl_config_wrong(object, "multiplex", NULL, "at most 4 nested multiplexors", NULL);
    }
    for (size_t i = 0; i < channel->condition_count; i++) {
        tl_config_done(&levels[i]);
    }
}

static void read_signal(tl_config_object *object, const cJSON *named, tl_config_signal *signal) {
    tl_can_channel *channel = signal->channel;
    (void)named;
    if (tl_config_get(object, "pgn", TL_CONFIG_OPTIONAL, NULL, NULL) != NULL) {
        read_pgn(object, channel);
    } else {
        read_id(object, channel);
    }
    read_frame(object, channel);
    read_not_available(object, read_type(object, channel), channel);
    tl_config_get_scale(object, &channel->scale, &channel->offset);
    read_multiplex(object, channel);
}

/* ---- the row ---- */

static tl_status open_can(const tl_config_source *source, const char *path, const void *channels, size_t count,
                          tl_plant_io **io, tl_error *error) {
    tl_can_settings settings = *(const tl_can_settings *)source->settings;
    (void)path;
    settings.channels = channels;
    settings.channel_count = count;
    return tl_can_open(&settings, io, error);
}

static const tl_change_rule RULES[] = {
    {"sources.*.can.**", TL_RULE_COMMISSION, NULL},
    {"plant.*.can.**", TL_RULE_COMMISSION, NULL},
    {NULL, TL_RULE_COMMISSION, NULL},
};

const tl_driver tl_driver_can = {
    .name = "can",
    .signal_key = "can",
    .source_example = "{\"interface\": \"can0\"}",
    .signal_example = "{\"source\": \"bus\", \"id\": \"0x123\", \"start\": 0, \"length\": 16}",
    .period_s = PERIOD_S,
    .settings_bytes = sizeof(tl_can_settings),
    .channel_bytes = sizeof(tl_can_channel),
    .read_source = read_source,
    .read_signal = read_signal,
    .rules = RULES,
    .is_silent = true,
    .io = &tl_can_driver,
    .access = &tl_can_access,
    .open = open_can,
};
