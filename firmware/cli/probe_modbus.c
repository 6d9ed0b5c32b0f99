/* Modbus in a probe: see probe_modbus.h. */
#include "firmware/cli/probe_modbus.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/config/drivers.h"
#include "firmware/config/json_document.h"

const char *const tl_probe_modbus_tables[] = {"", "coil", "discrete", "holding", "input"};

void tl_probe_modbus_begin(tl_probe_modbus *self, const tl_config *config) {
    *self = (tl_probe_modbus){.config = config};
    for (size_t i = 0; i < config->own_count; i++) {
        if (tl_probe_modbus_has(config, i)) {
            self->channels[i] = *(const tl_modbus_channel *)config->signals[i].channel;
        }
    }
}

bool tl_probe_modbus_has_source(const tl_config *config, size_t source) {
    return config->sources[source].driver->io == &tl_modbus_driver;
}

bool tl_probe_modbus_has(const tl_config *config, size_t signal) {
    const size_t source = config->signals[signal].source;
    return source != SIZE_MAX && tl_probe_modbus_has_source(config, source);
}

bool tl_probe_modbus_is_raw(const tl_config *config, size_t signal) {
    const tl_modbus_channel *channel = config->signals[signal].channel;
    return tl_probe_modbus_has(config, signal) && tl_modbus_registers(channel->type) <= TL_PROBE_REGISTERS;
}

/* ---- raw registers ---- */

static tl_modbus_type raw_type(const tl_modbus_channel *channel) {
    if (tl_modbus_registers(channel->type) == 2) {
        return TL_MODBUS_UINT32;
    }
    return channel->type == TL_MODBUS_BIT ? TL_MODBUS_BIT : TL_MODBUS_UINT16;
}

/* The channel of the changed configuration: most significant word and byte first, no scale
 * and no codes. */
static tl_modbus_channel raw_channel(const tl_modbus_channel *channel) {
    return (tl_modbus_channel){.unit_id = channel->unit_id,
                               .table = channel->table,
                               .address = channel->address,
                               .type = raw_type(channel),
                               .scale = 1};
}

static bool set_item(cJSON *object, const char *key, cJSON *item) {
    cJSON_DeleteItemFromObjectCaseSensitive(object, key);
    return cJSON_AddItemToObject(object, key, item) != 0;
}

static bool set_raw(cJSON *modbus, const tl_modbus_channel *channel) {
    static const char *const decoding[] = {"type", "words", "bytes", "scale", "offset", "bit", "byte", "not_available"};
    static const char *const types[] = {
        [TL_MODBUS_BIT] = "bit", [TL_MODBUS_UINT16] = "uint16", [TL_MODBUS_UINT32] = "uint32"};
    for (size_t i = 0; i < sizeof decoding / sizeof decoding[0]; i++) {
        cJSON_DeleteItemFromObjectCaseSensitive(modbus, decoding[i]);
    }
    return set_item(modbus, "type", cJSON_CreateString(types[raw_type(channel)])) &&
           set_item(modbus, "table", cJSON_CreateString(tl_probe_modbus_tables[channel->table])) &&
           set_item(modbus, "address", cJSON_CreateNumber(channel->address)) &&
           set_item(modbus, "unit_id", cJSON_CreateNumber(channel->unit_id));
}

static bool set_port(const tl_probe_modbus *self, cJSON *root) {
    const tl_config_source *source = &self->config->sources[self->source];
    const cJSON *sources = cJSON_GetObjectItemCaseSensitive(root, "sources");
    const cJSON *named = cJSON_GetObjectItemCaseSensitive(sources, source->name);
    cJSON *settings = cJSON_GetObjectItemCaseSensitive(named, source->driver->name);
    return set_item(settings, "port", cJSON_CreateNumber(self->port));
}

char *tl_probe_modbus_text(const tl_probe_modbus *self) {
    const tl_config *config = self->config;
    cJSON *root = cJSON_Duplicate(config->tree, 1);
    const cJSON *plant = cJSON_GetObjectItemCaseSensitive(root, "plant");
    bool is_made = root != NULL && (self->port == 0 || set_port(self, root));
    for (size_t i = 0; i < config->own_count && is_made; i++) {
        if (tl_probe_modbus_is_raw(config, i)) {
            const cJSON *signal = cJSON_GetObjectItemCaseSensitive(plant, config->signals[i].plan.name);
            is_made = set_raw(cJSON_GetObjectItemCaseSensitive(signal, "modbus"), &self->channels[i]);
        }
    }
    char *text = is_made ? cJSON_PrintUnformatted(root) : NULL;
    cJSON_Delete(root);
    return text;
}

void tl_probe_modbus_convert(void *context, size_t signal, tl_reading *reading) {
    tl_probe_modbus *self = context;
    if (!tl_probe_modbus_is_raw(self->config, signal)) {
        return;
    }
    const tl_modbus_channel raw = raw_channel(&self->channels[signal]);
    tl_modbus_encode(&raw, reading->value, self->registers[signal]);
    self->has_registers[signal] = true;
    if (!tl_modbus_decode(&self->channels[signal], self->registers[signal], &reading->value)) {
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
    const tl_modbus_channel *channel = &self->channels[signal];
    const char *request = tl_probe_modbus_has(self->config, signal) ? strstr(message, ": unit ") : NULL;
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
