/* Modbus in a probe: see probe_modbus.h. */
#include "firmware/config/probe_modbus.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/config/drivers.h"
#include "firmware/config/json_document.h"

const char *const tl_probe_modbus_tables[] = {"", "coil", "discrete", "holding", "input"};
const char *const tl_probe_modbus_types[] = {
    [TL_MODBUS_BIT] = "bit",     [TL_MODBUS_INT16] = "int16",   [TL_MODBUS_UINT16] = "uint16",
    [TL_MODBUS_INT32] = "int32", [TL_MODBUS_UINT32] = "uint32", [TL_MODBUS_FLOAT32] = "float32",
    [TL_MODBUS_INT64] = "int64", [TL_MODBUS_UINT64] = "uint64", [TL_MODBUS_FLOAT64] = "float64"};

void tl_probe_modbus_begin(tl_probe_modbus *self, const tl_config *config) {
    *self = (tl_probe_modbus){.config = config};
    for (size_t i = 0; i < config->own_count; i++) {
        if (tl_probe_modbus_has(config, i)) {
            self->channels[i] = *(const tl_modbus_channel *)config->signals[i].channel;
            self->is_int64[i] = tl_modbus_registers(self->channels[i].type) == TL_PROBE_REGISTERS &&
                                self->channels[i].type != TL_MODBUS_FLOAT64;
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

/* ---- raw registers ---- */

size_t tl_probe_modbus_width(const tl_probe_modbus *self, size_t signal) {
    return self->width[signal] > 0 ? self->width[signal] : tl_modbus_registers(self->channels[signal].type);
}

static tl_modbus_type raw_type(const tl_probe_modbus *self, size_t signal) {
    if (self->channels[signal].type == TL_MODBUS_BIT) {
        return TL_MODBUS_BIT;
    }
    switch (tl_probe_modbus_width(self, signal)) {
    case 1:
        return TL_MODBUS_UINT16;
    case 2:
        return TL_MODBUS_UINT32;
    default:
        return self->is_int64[signal] ? TL_MODBUS_INT64 : TL_MODBUS_FLOAT64;
    }
}

/* The channel of the changed configuration: no scale and no codes. */
static tl_modbus_channel raw_channel(const tl_probe_modbus *self, size_t signal) {
    const tl_modbus_channel *channel = &self->channels[signal];
    return (tl_modbus_channel){.unit_id = channel->unit_id,
                               .table = channel->table,
                               .address = channel->address,
                               .type = raw_type(self, signal),
                               .words_little = channel->words_little,
                               .bytes_little = channel->bytes_little,
                               .scale = 1};
}

static bool set_item(cJSON *object, const char *key, cJSON *item) {
    cJSON_DeleteItemFromObjectCaseSensitive(object, key);
    return cJSON_AddItemToObject(object, key, item) != 0;
}

static bool set_raw(cJSON *modbus, const tl_modbus_channel *raw) {
    static const char *const decoding[] = {"type", "words", "bytes", "scale", "offset", "bit", "byte", "not_available"};
    for (size_t i = 0; i < sizeof decoding / sizeof decoding[0]; i++) {
        cJSON_DeleteItemFromObjectCaseSensitive(modbus, decoding[i]);
    }
    return set_item(modbus, "type", cJSON_CreateString(tl_probe_modbus_types[raw->type])) &&
           set_item(modbus, "table", cJSON_CreateString(tl_probe_modbus_tables[raw->table])) &&
           (!raw->words_little || set_item(modbus, "words", cJSON_CreateString("little"))) &&
           (!raw->bytes_little || set_item(modbus, "bytes", cJSON_CreateString("little"))) &&
           set_item(modbus, "address", cJSON_CreateNumber(raw->address)) &&
           set_item(modbus, "unit_id", cJSON_CreateNumber(raw->unit_id));
}

const char *tl_probe_modbus_framing(const tl_probe_modbus *self) {
    const tl_modbus_settings *present = self->config->sources[self->source].settings;
    return present->rtu_framing != self->link.other_framing ? "rtu" : "tcp";
}

static bool set_link(const tl_probe_modbus *self, cJSON *root) {
    const tl_config_source *source = &self->config->sources[self->source];
    const tl_probe_link *link = &self->link;
    const cJSON *sources = cJSON_GetObjectItemCaseSensitive(root, "sources");
    const cJSON *named = cJSON_GetObjectItemCaseSensitive(sources, source->name);
    cJSON *settings = cJSON_GetObjectItemCaseSensitive(named, source->driver->name);
    return (link->port == 0 || set_item(settings, "port", cJSON_CreateNumber(link->port))) &&
           (!link->other_framing || set_item(settings, "framing", cJSON_CreateString(tl_probe_modbus_framing(self)))) &&
           (!(link->pause_s > 0) || set_item(settings, "pause_s", cJSON_CreateNumber(link->pause_s))) &&
           (link->most_registers == 0 ||
            set_item(settings, "most_registers", cJSON_CreateNumber(link->most_registers)));
}

char *tl_probe_modbus_text(const tl_probe_modbus *self) {
    const tl_config *config = self->config;
    cJSON *root = cJSON_Duplicate(config->tree, 1);
    const cJSON *plant = cJSON_GetObjectItemCaseSensitive(root, "plant");
    bool is_made = root != NULL && set_link(self, root);
    for (size_t i = 0; i < config->own_count && is_made; i++) {
        if (tl_probe_modbus_has(config, i)) {
            const tl_modbus_channel raw = raw_channel(self, i);
            const cJSON *signal = cJSON_GetObjectItemCaseSensitive(plant, config->signals[i].plan.name);
            is_made = set_raw(cJSON_GetObjectItemCaseSensitive(signal, "modbus"), &raw);
        }
    }
    char *text = is_made ? cJSON_PrintUnformatted(root) : NULL;
    cJSON_Delete(root);
    return text;
}

void tl_probe_modbus_convert(void *context, size_t signal, tl_reading *reading) {
    tl_probe_modbus *self = context;
    if (!tl_probe_modbus_has(self->config, signal)) {
        return;
    }
    const tl_modbus_channel raw = raw_channel(self, signal);
    uint16_t registers[TL_PROBE_REGISTERS] = {0};
    tl_modbus_encode(&raw, reading->value, registers);
    for (size_t i = 0; i < TL_PROBE_REGISTERS; i++) {
        const bool moves = self->has_registers[signal] && registers[i] != self->registers[signal][i];
        self->moved[signal] |= moves ? 1U << i : 0;
        self->registers[signal][i] = registers[i];
    }
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
