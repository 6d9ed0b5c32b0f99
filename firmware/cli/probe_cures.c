/* Cures of a Modbus source: see probe_cures.h. */
#include "firmware/cli/probe_cures.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/config/drivers.h"
#include "firmware/process/interrupt.h"

/* Each mapping is read for at most this time, and two time-outs. */
static const double PASS_S = 1.2;

/* A value this many times beyond its limits, or this large without limits, is absurd. A value below
 * this part of its limits, or of 1, proves nothing. */
static const double ABSURD = 1000;
static const double LARGEST = 1e15;
static const double SMALL = 1e-6;

/* An integer in its range proves something if at most one of so many register contents is in range.
 */
static const double RARE = 8;

enum { MODBUS_PORT = 502 };

/* A change of the mapping of all signals of a source. */
typedef struct change {
    bool words; /* the other word order */
    bool table; /* the other table: input and holding, discrete and coil */
    int shift;  /* of addresses */
    int unit;   /* unit id; -1: as configured */
    uint16_t port;
} change;

static const change SINGLE[] = {
    {true, false, 0, -1, 0}, {false, true, 0, -1, 0}, {false, false, -1, -1, 0}, {false, false, 1, -1, 0}};
static const change DOUBLE[] = {{true, true, 0, -1, 0},
                                {true, false, -1, -1, 0},
                                {true, false, 1, -1, 0},
                                {false, true, -1, -1, 0},
                                {false, true, 1, -1, 0}};
static const change SILENT[] = {
    {false, false, 0, -1, MODBUS_PORT}, {false, false, 0, 1, 0}, {false, false, 0, 2, 0}, {false, false, 0, 3, 0},
    {false, false, 0, 255, 0},          {false, false, 0, 0, 0}};

#define COUNT_OF(array) (sizeof(array) / sizeof(array)[0])

typedef struct search {
    const tl_plant_probe *found;
    const tl_probe_modbus *present;
    int (*run_role)(const char *role, void *context);
    size_t source;
    bool is_silent;        /* it does not answer, or a gateway answers that it has no such unit */
    bool is_illegal;       /* it has no such register */
    size_t plausible;      /* number of plausible mappings */
    size_t strong;         /* strong values of the newest of them */
    const change *newest;  /* the newest of them */
    tl_probe_modbus tried; /* registers of the mapping that was read last */
    tl_plant_probe read;
} search;

/* ---- plausibility ---- */

typedef enum verdict {
    IS_ABSURD, /* no such register, denormal, or far out of range */
    IS_BAD,    /* out of range, NaN, or no value for another reason */
    IS_WEAK,   /* in range, but many register contents are */
    IS_STRONG
} verdict;

static verdict judge_float(const tl_config_signal *signal, const tl_modbus_channel *channel, double raw, double value) {
    const bool has_limits = isfinite(signal->minimum) || isfinite(signal->maximum);
    const double low = isfinite(signal->minimum) ? fabs(signal->minimum) : 0;
    const double high = isfinite(signal->maximum) ? fabs(signal->maximum) : 0;
    const double size = has_limits ? fmax(low, high) : 1;
    const double most = has_limits ? ABSURD * size : LARGEST;
    const double least = channel->type == TL_MODBUS_FLOAT32 ? (double)FLT_MIN : DBL_MIN;
    if (fabs(raw) > 0 && (fabs(raw) < least || (size > 0 && fabs(value) > most))) {
        return IS_ABSURD;
    }
    if (value < signal->minimum || value > signal->maximum) {
        return IS_BAD;
    }
    return fabs(raw) > 0 && fabs(value) > SMALL * size ? IS_STRONG : IS_WEAK;
}

static verdict judge_registers(const tl_config_signal *signal, const tl_modbus_channel *channel,
                               const uint16_t *registers) {
    tl_modbus_channel plain = *channel;
    double raw = 0;
    double value = 0;
    plain.scale = 1;
    plain.offset = 0;
    if (!tl_modbus_decode(&plain, registers, &raw) || !tl_modbus_decode(channel, registers, &value)) {
        return IS_BAD;
    }
    if (channel->type == TL_MODBUS_FLOAT32 || channel->type == TL_MODBUS_FLOAT64) {
        return judge_float(signal, channel, raw, value);
    }
    if (value < signal->minimum || value > signal->maximum) {
        return IS_BAD;
    }
    const double contents = ldexp(1, 16 * (int)tl_modbus_registers(channel->type));
    const double in_range = (signal->maximum - signal->minimum) / fabs(channel->scale);
    return fabs(raw) > 0 && channel->type != TL_MODBUS_BIT && in_range * RARE <= contents ? IS_STRONG : IS_WEAK;
}

/* Judges a signal as it was read. The driver calls a missing register illegal. */
static verdict judge(const tl_plant_probe *found, const tl_probe_modbus *read, size_t signal,
                     const tl_modbus_channel *channel) {
    const tl_plant_probe_signal *own = &found->signals[signal];
    if (own->last.quality == TL_NO_LINK || !read->has_registers[signal]) {
        return strstr(own->cause, "Illegal") != NULL ? IS_ABSURD : IS_BAD;
    }
    return judge_registers(&read->config->signals[signal], channel, read->registers[signal]);
}

/* ---- mappings ---- */

static bool is_of_source(const search *self, size_t signal) {
    return self->present->config->signals[signal].source == self->source;
}

/* Changes a channel. Returns false if it has no such neighbour. */
static bool apply(const change *step, tl_modbus_channel *channel) {
    static const tl_modbus_table other[] = {[TL_MODBUS_COIL] = TL_MODBUS_DISCRETE,
                                            [TL_MODBUS_DISCRETE] = TL_MODBUS_COIL,
                                            [TL_MODBUS_HOLDING] = TL_MODBUS_INPUT,
                                            [TL_MODBUS_INPUT] = TL_MODBUS_HOLDING};
    const size_t registers = tl_modbus_registers(channel->type);
    const long address = (long)channel->address + step->shift;
    channel->words_little = channel->words_little != (step->words && registers > 1);
    channel->table = step->table ? other[channel->table] : channel->table;
    channel->address = (uint16_t)address;
    channel->unit_id = step->unit >= 0 ? (uint8_t)step->unit : channel->unit_id;
    return address >= 0 && address + (long)registers <= 65536;
}

static bool is_same(const tl_modbus_channel *a, const tl_modbus_channel *b) {
    return a->words_little == b->words_little && a->table == b->table && a->address == b->address &&
           a->unit_id == b->unit_id;
}

/* Sets the changed mapping. Returns false if it is impossible, or changes nothing. */
static bool set_mapping(search *self, const change *step) {
    const tl_config *config = self->present->config;
    const tl_driver *driver = config->sources[self->source].driver;
    const bool is_line = strcmp(driver->name, "modbus_rtu") == 0;
    bool changes = false;
    tl_probe_modbus_begin(&self->tried, config);
    self->tried.slow = self->source;
    self->tried.port = step->port;
    if (is_line && (step->port != 0 || step->unit == 0 || step->unit == UINT8_MAX)) {
        return false;
    }
    if (step->port != 0) {
        const tl_modbus_settings *settings = config->sources[self->source].settings;
        changes = settings->port != step->port;
    }
    for (size_t i = 0; i < config->own_count; i++) {
        if (is_of_source(self, i)) {
            if (!apply(step, &self->tried.channels[i])) {
                return false;
            }
            changes = changes || !is_same(&self->tried.channels[i], &self->present->channels[i]);
        }
    }
    return changes;
}

static tl_status read_mapping(search *self, tl_error *error) {
    const tl_config *present = self->present->config;
    const tl_modbus_settings *source = present->sources[self->source].settings;
    char *text = tl_probe_modbus_text(&self->tried);
    tl_config config = {.path = NULL};
    tl_problems problems;
    tl_problems_init(&problems, present->path);
    if (text == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration");
    }
    tl_status status = tl_config_read_text(present->path, text, strlen(text), &config, &problems.report);
    if (status != TL_OK) {
        (void)tl_fail(error, status, "another mapping has problems: see above");
    } else {
        const tl_plant_probe_settings settings = {
            .config = &config,
            .text = text,
            .duration = tl_time_of_seconds(PASS_S + 2 * source->timeout_s),
            .is_brief = true,
            .run_role = self->run_role,
            .convert = tl_probe_modbus_convert,
            .concerns = tl_probe_modbus_concerns,
            .context = &self->tried,
        };
        tl_config_use_lookups(&config);
        status = tl_plant_probe_run(&settings, &self->read, error);
    }
    tl_config_free(&config);
    free(text);
    return status;
}

/* Returns true if the mapping that was read is plausible and the present one is not, where both
 * differ. *strong: number of strong values where both differ. */
static bool is_plausible(const search *self, size_t *strong) {
    *strong = 0;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            const tl_modbus_channel *channel = &self->tried.channels[i];
            const bool is_kept = self->tried.port == 0 && is_same(channel, &self->present->channels[i]);
            const verdict now = judge(self->found, self->present, i, &self->present->channels[i]);
            const verdict then = judge(&self->read, &self->tried, i, channel);
            if (then < IS_WEAK || (now == IS_STRONG && !is_kept)) {
                return false;
            }
            *strong += then == IS_STRONG && !is_kept ? 1 : 0;
        }
    }
    return *strong > 0;
}

/* Returns true if a value proves nothing against its mapping: a sensor that is off often gives 0 or
 * NaN. */
static bool is_off(const search *self, size_t signal) {
    static const uint16_t zeros[TL_PROBE_REGISTERS];
    return self->found->signals[signal].last.quality == TL_NOT_A_NUMBER ||
           memcmp(self->present->registers[signal], zeros, sizeof zeros) == 0;
}

/* Returns true if the mapping, not only a sensor, must be wrong. */
static bool is_wrong(search *self) {
    size_t absurd = 0;
    size_t bad = 0;
    size_t answers = 0;
    size_t missing = 0;
    self->is_illegal = false;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            const tl_plant_probe_signal *signal = &self->found->signals[i];
            const verdict now = judge(self->found, self->present, i, &self->present->channels[i]);
            const bool has_value = signal->last.quality != TL_NO_LINK;
            const bool has_answer =
                strstr(signal->cause, ": unit ") != NULL && strstr(signal->cause, "check unit_id") == NULL;
            absurd += now == IS_ABSURD ? 1 : 0;
            bad += now == IS_BAD && has_value && !is_off(self, i) ? 1 : 0;
            missing += now == IS_BAD && !has_value ? 1 : 0;
            answers += has_value || has_answer ? 1 : 0;
            self->is_illegal = self->is_illegal || (now == IS_ABSURD && !has_value);
        }
    }
    self->is_silent = answers == 0 && missing > 0;
    return self->is_silent || (missing == 0 && (absurd > 0 || bad >= 2));
}

/* ---- proposals ---- */

static void describe_signal(const search *self, size_t signal, const tl_modbus_channel *wanted,
                            char text[TL_PROBE_CURE]) {
    static const char *const tables[] = {"", "coil", "discrete", "holding", "input"};
    const tl_modbus_channel *present = &self->present->channels[signal];
    char words[24] = "";
    char table[32] = "";
    char address[24] = "";
    char unit[24] = "";
    if (wanted->words_little != present->words_little) {
        (void)snprintf(words, sizeof words, ", \"words\": \"%s\"", wanted->words_little ? "little" : "big");
    }
    if (wanted->table != present->table) {
        (void)snprintf(table, sizeof table, ", \"table\": \"%s\"", tables[wanted->table]);
    }
    if (wanted->address != present->address) {
        (void)snprintf(address, sizeof address, ", \"address\": %u", (unsigned)wanted->address);
    }
    if (wanted->unit_id != present->unit_id) {
        (void)snprintf(unit, sizeof unit, ", \"unit_id\": %u", (unsigned)wanted->unit_id);
    }
    char all[sizeof words + sizeof table + sizeof address + sizeof unit];
    (void)snprintf(all, sizeof all, "%s%s%s%s", unit, table, address, words);
    (void)snprintf(text, TL_PROBE_CURE, "%.*s", TL_PROBE_CURE - 1, all[0] != '\0' ? all + 2 : "");
}

static void propose(search *self, const change *step, tl_probe_cures *cures) {
    (void)set_mapping(self, step);
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            describe_signal(self, i, &self->tried.channels[i], cures->signals[i]);
        }
    }
    cures->ports[self->source] = step->port;
}

/* Reads each mapping and counts the plausible ones. */
static tl_status try_all(search *self, const change *steps, size_t count, tl_error *error) {
    tl_status status = TL_OK;
    size_t strong = 0;
    for (size_t i = 0; i < count && status == TL_OK && tl_interrupt_requested() == NULL; i++) {
        if (set_mapping(self, &steps[i])) {
            status = read_mapping(self, error);
            if (status == TL_OK && is_plausible(self, &strong)) {
                self->newest = &steps[i];
                self->strong = strong;
                self->plausible++;
            }
        }
    }
    return status;
}

/* Another table or address of a device that has the present ones needs two strong values: one can
 * be in its range by chance. */
static bool is_proven(const search *self) {
    return self->plausible == 1 && (self->is_silent || self->is_illegal || self->strong >= 2 ||
                                    (!self->newest->table && self->newest->shift == 0));
}

static tl_status search_source(search *self, tl_probe_cures *cures, tl_error *error) {
    const tl_config_source *source = &self->present->config->sources[self->source];
    tl_status status = TL_OK;
    self->plausible = 0;
    if (!is_wrong(self)) {
        return TL_OK;
    }
    tl_log(TL_LOG_NOTICE, "%s: no plausible values: other mappings are tried", source->name);
    if (self->is_silent) { /* without a connection, another unit id is of no use */
        const bool is_refused = strstr(self->found->messages[self->source], "no connection") != NULL;
        status = try_all(self, SILENT, is_refused ? 1 : COUNT_OF(SILENT), error);
    } else {
        status = try_all(self, SINGLE, COUNT_OF(SINGLE), error);
    }
    if (status == TL_OK && self->plausible == 0 && !self->is_silent) {
        status = try_all(self, DOUBLE, COUNT_OF(DOUBLE), error);
    }
    if (status == TL_OK && self->plausible > 0 && tl_interrupt_requested() == NULL) {
        cures->unclear[self->source] = !is_proven(self);
        if (is_proven(self)) {
            propose(self, self->newest, cures);
        }
    }
    return status;
}

tl_status tl_probe_cures_find(const tl_plant_probe *found, const tl_probe_modbus *present,
                              int (*run_role)(const char *role, void *context), tl_probe_cures *cures,
                              tl_error *error) {
    static search self; /* static, because it is too large for the stack */
    const tl_config *config = present->config;
    tl_status status = TL_OK;
    memset(cures, 0, sizeof *cures);
    self.found = found;
    self.present = present;
    self.run_role = run_role;
    for (size_t i = 0; i < config->source_count && status == TL_OK; i++) {
        self.source = i;
        if (tl_probe_modbus_has_source(config, i)) {
            status = search_source(&self, cures, error);
        }
    }
    return status;
}
