/* Modbus in a probe: see probe_modbus.h. */
#include "firmware/cli/probe_modbus.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/config/drivers.h"
#include "firmware/config/json_document.h"

const tl_modbus_channel *tl_probe_modbus_channel(const tl_config *config, size_t signal) {
    const size_t source = config->signals[signal].source;
    return source != SIZE_MAX && config->sources[source].driver->io == &tl_modbus_driver
               ? config->signals[signal].channel
               : NULL;
}

/* ---- raw registers ---- */

static tl_modbus_type raw_type(const tl_modbus_channel *channel) {
    switch (tl_modbus_registers(channel->type)) {
    case 1:
        return channel->type == TL_MODBUS_BIT ? TL_MODBUS_BIT : TL_MODBUS_UINT16;
    case 2:
        return TL_MODBUS_UINT32;
    default:
        return TL_MODBUS_FLOAT64;
    }
}

/* The channel of the changed configuration: most significant word and byte first, no scale. */
static tl_modbus_channel raw_channel(const tl_modbus_channel *channel) {
    return (tl_modbus_channel){.unit_id = channel->unit_id,
                               .table = channel->table,
                               .address = channel->address,
                               .type = raw_type(channel),
                               .scale = 1};
}

static bool set_raw(cJSON *modbus, tl_modbus_type type) {
    static const char *const keys[] = {"type", "words", "bytes", "scale", "offset"};
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++) {
        cJSON_DeleteItemFromObjectCaseSensitive(modbus, keys[i]);
    }
    const char *name = type == TL_MODBUS_UINT16 ? "uint16" : type == TL_MODBUS_UINT32 ? "uint32" : "float64";
    return cJSON_AddStringToObject(modbus, "type", name) != NULL;
}

char *tl_probe_modbus_text(const tl_config *config) {
    cJSON *root = cJSON_Duplicate(config->tree, 1);
    const cJSON *plant = cJSON_GetObjectItemCaseSensitive(root, "plant");
    bool is_made = root != NULL;
    for (size_t i = 0; i < config->own_count && is_made; i++) {
        const tl_modbus_channel *channel = tl_probe_modbus_channel(config, i);
        if (channel != NULL && channel->type != TL_MODBUS_BIT) {
            const cJSON *signal = cJSON_GetObjectItemCaseSensitive(plant, config->signals[i].plan.name);
            is_made = set_raw(cJSON_GetObjectItemCaseSensitive(signal, "modbus"), raw_type(channel));
        }
    }
    char *text = is_made ? cJSON_PrintUnformatted(root) : NULL;
    cJSON_Delete(root);
    return text;
}

void tl_probe_modbus_convert(void *context, size_t signal, tl_reading *reading) {
    tl_probe_modbus *self = context;
    const tl_modbus_channel *channel = tl_probe_modbus_channel(self->config, signal);
    if (channel == NULL || channel->type == TL_MODBUS_BIT) {
        return;
    }
    const tl_modbus_channel raw = raw_channel(channel);
    tl_modbus_encode(&raw, reading->value, self->registers[signal]);
    self->has_registers[signal] = true;
    if (!tl_modbus_decode(channel, self->registers[signal], &reading->value)) {
        reading->quality = TL_NOT_A_NUMBER;
    }
}

/* ---- messages ---- */

/* Skips to the next number and parses it. */
static unsigned long take_number(const char **text) {
    char *end = NULL;
    *text += strcspn(*text, "0123456789");
    const unsigned long number = strtoul(*text, &end, 10);
    *text = end;
    return number;
}

/* The driver names the request: "…: unit 1, input register 0 to 2: …". Other messages are about the
 * whole device. */
bool tl_probe_modbus_concerns(void *context, size_t signal, const char *message) {
    const tl_probe_modbus *self = context;
    const tl_modbus_channel *channel = tl_probe_modbus_channel(self->config, signal);
    const char *request = channel != NULL ? strstr(message, ": unit ") : NULL;
    char own[64];
    if (request == NULL) {
        return true;
    }
    (void)snprintf(own, sizeof own, ": unit %u, %s ", (unsigned)channel->unit_id, tl_modbus_table_name(channel->table));
    if (strncmp(request, own, strlen(own)) != 0) {
        return false;
    }
    request += strlen(own);
    const unsigned long first = take_number(&request);
    const unsigned long last = take_number(&request);
    return channel->address >= first && channel->address <= last;
}
