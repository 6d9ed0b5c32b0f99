/* Cures of a Modbus source: see probe_cures.h. */
#include "firmware/cli/probe_cures.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
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
typedef struct mapping_change {
    bool words; /* the other word order */
    bool table; /* the other table: input and holding, discrete and coil */
    int shift;  /* of addresses */
    int unit;   /* unit id; -1: as configured */
    uint16_t port;
} mapping_change;

static const mapping_change SINGLE[] = {
    {true, false, 0, -1, 0}, {false, true, 0, -1, 0}, {false, false, -1, -1, 0}, {false, false, 1, -1, 0}};
static const mapping_change DOUBLE[] = {{true, true, 0, -1, 0},
                                        {true, false, -1, -1, 0},
                                        {true, false, 1, -1, 0},
                                        {false, true, -1, -1, 0},
                                        {false, true, 1, -1, 0}};
static const mapping_change SILENT[] = {
    {false, false, 0, -1, MODBUS_PORT}, {false, false, 0, 1, 0}, {false, false, 0, 2, 0}, {false, false, 0, 3, 0},
    {false, false, 0, 255, 0},          {false, false, 0, 0, 0}};

#define COUNT_OF(array) (sizeof(array) / sizeof(array)[0])

typedef struct cure_search {
    const tl_plant_probe *found;
    const tl_probe_modbus *present;
    int (*run_role)(const char *role, void *context);
    size_t source;
    bool is_silent;               /* no signal has an answer */
    bool is_refused;              /* it accepts no connection */
    bool is_illegal;              /* it has no such register */
    size_t plausible;             /* number of plausible mappings */
    size_t strong;                /* strong values of the newest of them */
    const mapping_change *newest; /* the newest of them */
    tl_probe_modbus tried;        /* registers of the mapping that was read last */
    tl_plant_probe read;
} cure_search;

/* ---- plausibility ---- */

typedef enum verdict {
    IS_ABSURD, /* no such register, denormal, or far out of range */
    IS_BAD,    /* out of range, NaN, or no value for another reason */
    IS_WEAK,   /* in range, but many register contents are */
    IS_STRONG
} verdict;

static verdict grade_float(const tl_config_signal *signal, double raw, double value) {
    const double low = isfinite(signal->minimum) ? fabs(signal->minimum) : 0;
    const double high = isfinite(signal->maximum) ? fabs(signal->maximum) : 0;
    const double size = fmax(low, high) > 0 ? fmax(low, high) : 1; /* of the limits */
    const double most = fmax(low, high) > 0 ? ABSURD * size : LARGEST;
    if (fabs(raw) > 0 && (fabs(raw) < (double)FLT_MIN || fabs(value) > most)) {
        return IS_ABSURD;
    }
    if (value < signal->minimum || value > signal->maximum) {
        return IS_BAD;
    }
    return fabs(raw) > 0 && fabs(value) > SMALL * size ? IS_STRONG : IS_WEAK;
}

static verdict grade_registers(const tl_config_signal *signal, const tl_modbus_channel *channel,
                               const uint16_t *registers) {
    tl_modbus_channel plain = *channel;
    double raw = 0;
    double value = 0;
    plain.scale = 1;
    plain.offset = 0;
    if (!tl_modbus_decode(&plain, registers, &raw) || !tl_modbus_decode(channel, registers, &value)) {
        return IS_BAD;
    }
    if (channel->type == TL_MODBUS_FLOAT32) {
        return grade_float(signal, raw, value);
    }
    if (value < signal->minimum || value > signal->maximum) {
        return IS_BAD;
    }
    const double contents = ldexp(1, 16 * (int)tl_modbus_registers(channel->type));
    const double in_range = (signal->maximum - signal->minimum) / fabs(channel->scale);
    return fabs(raw) > 0 && channel->type != TL_MODBUS_BIT && in_range * RARE <= contents ? IS_STRONG : IS_WEAK;
}

/* Grades a signal as it was read. The driver calls a missing register illegal. */
static verdict grade(const tl_plant_probe *found, const tl_probe_modbus *read, size_t signal,
                     const tl_modbus_channel *channel) {
    const tl_plant_probe_signal *own = &found->signals[signal];
    if (own->last.quality == TL_NO_LINK || !read->has_registers[signal]) {
        return strstr(own->cause, "Illegal") != NULL ? IS_ABSURD : IS_BAD;
    }
    return grade_registers(&read->config->signals[signal], channel, read->registers[signal]);
}

/* ---- mappings ---- */

/* Only signals that are read raw can be judged and changed. */
static bool is_of_source(const cure_search *self, size_t signal) {
    const tl_config *config = self->present->config;
    return config->signals[signal].source == self->source && tl_probe_modbus_is_raw(config, signal);
}

/* Changes a channel. Returns false if it has no such neighbour. */
static bool apply(const mapping_change *step, tl_modbus_channel *channel) {
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
static bool set_mapping(cure_search *self, const mapping_change *step) {
    const tl_config *config = self->present->config;
    const tl_modbus_settings *settings = config->sources[self->source].settings;
    const bool is_line = settings->line.device != NULL;
    bool changes = step->port != 0 && step->port != settings->port;
    tl_probe_modbus_begin(&self->tried, config);
    self->tried.source = self->source;
    self->tried.port = step->port;
    if (is_line && (step->port != 0 || step->unit == 0 || step->unit == UINT8_MAX)) {
        return false;
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

static tl_status read_mapping(cure_search *self, tl_error *error) {
    const tl_modbus_settings *source = self->present->config->sources[self->source].settings;
    char *text = tl_probe_modbus_text(&self->tried);
    const tl_plant_probe_settings settings = {
        .config = self->present->config,
        .text = text,
        .duration = tl_time_of_seconds(PASS_S + 2 * source->timeout_s),
        .is_brief = true,
        .run_role = self->run_role,
        .convert = tl_probe_modbus_convert,
        .concerns = tl_probe_modbus_concerns,
        .context = &self->tried,
    };
    tl_status status = text != NULL ? tl_plant_probe_run(&settings, &self->read, error)
                                    : tl_fail(error, TL_TRY_AGAIN, "not enough memory for the configuration");
    free(text);
    return status;
}

/* Returns true if the mapping that was read is plausible and the present one is not, where both
 * differ. *strong: number of strong values where both differ. */
static bool is_plausible(const cure_search *self, size_t *strong) {
    *strong = 0;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            const tl_modbus_channel *channel = &self->tried.channels[i];
            const bool is_kept = self->tried.port == 0 && is_same(channel, &self->present->channels[i]);
            const verdict now = grade(self->found, self->present, i, &self->present->channels[i]);
            const verdict then = grade(&self->read, &self->tried, i, channel);
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
static bool is_off(const cure_search *self, size_t signal) {
    static const uint16_t zeros[TL_PROBE_REGISTERS];
    return self->found->signals[signal].last.quality == TL_NOT_A_NUMBER ||
           memcmp(self->present->registers[signal], zeros, sizeof zeros) == 0;
}

/* Returns true if the device has a value or refuses the request; false also if a gateway answers
 * that it has no such unit. */
static bool has_answer(const tl_plant_probe_signal *signal) {
    return signal->last.quality != TL_NO_LINK ||
           (strstr(signal->cause, ": unit ") != NULL && strstr(signal->cause, "check unit_id") == NULL);
}

/* Returns true if the mapping, not only a sensor, must be wrong. */
static bool is_wrong(cure_search *self) {
    size_t absurd = 0;
    size_t bad = 0;
    size_t answers = 0;
    size_t missing = 0;
    self->is_illegal = false;
    self->is_refused = false;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            const tl_plant_probe_signal *signal = &self->found->signals[i];
            const verdict now = grade(self->found, self->present, i, &self->present->channels[i]);
            const bool has_value = signal->last.quality != TL_NO_LINK;
            absurd += now == IS_ABSURD ? 1 : 0;
            bad += now == IS_BAD && has_value && !is_off(self, i) ? 1 : 0;
            missing += now == IS_BAD && !has_value ? 1 : 0;
            answers += has_answer(signal) ? 1 : 0;
            self->is_refused = self->is_refused || strstr(signal->cause, "no connection") != NULL;
            self->is_illegal = self->is_illegal || (now == IS_ABSURD && !has_value);
        }
    }
    self->is_silent = answers == 0 && missing > 0;
    return self->is_silent || (missing == 0 && (absurd > 0 || bad >= 2));
}

/* ---- proposals ---- */

static void describe_signal(const cure_search *self, const tl_modbus_channel *present, const tl_modbus_channel *wanted,
                            char text[TL_PROBE_CURE]) {
    const char *words = wanted->words_little ? "little" : "big";
    size_t used = (size_t)snprintf(text, TL_PROBE_CURE, "%s", self->is_silent ? "perhaps" : "likely");
    if (self->newest->port != 0) {
        used += (size_t)snprintf(text + used, TL_PROBE_CURE - used, " \"port\": %d in its source", MODBUS_PORT);
    }
    if (wanted->unit_id != present->unit_id) {
        used += (size_t)snprintf(text + used, TL_PROBE_CURE - used, " \"unit_id\": %u instead of %u",
                                 (unsigned)wanted->unit_id, (unsigned)present->unit_id);
    }
    if (wanted->table != present->table) {
        const char *table = tl_probe_modbus_tables[wanted->table];
        used += (size_t)snprintf(text + used, TL_PROBE_CURE - used, " \"table\": \"%s\"", table);
    }
    if (wanted->address != present->address) {
        used += (size_t)snprintf(text + used, TL_PROBE_CURE - used, " \"address\": %u", (unsigned)wanted->address);
    }
    if (wanted->words_little != present->words_little) {
        (void)snprintf(text + used, TL_PROBE_CURE - used, " \"words\": \"%s\"", words);
    }
}

/* Writes the proposal for each signal whose mapping it changes. */
static void propose(cure_search *self, bool is_proven, char cures[TL_MAX_SIGNALS][TL_PROBE_CURE]) {
    (void)set_mapping(self, self->newest);
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        const tl_modbus_channel *present = &self->present->channels[i];
        const tl_modbus_channel *wanted = &self->tried.channels[i];
        if (is_of_source(self, i) && !is_proven) {
            (void)snprintf(cures[i], TL_PROBE_CURE,
                           "several mappings may be right: compare with the display of the device");
        } else if (is_of_source(self, i) && (self->newest->port != 0 || !is_same(present, wanted))) {
            describe_signal(self, present, wanted, cures[i]);
        }
    }
}

/* Reads each mapping and counts the plausible ones. */
static tl_status try_all(cure_search *self, const mapping_change *steps, size_t count, tl_error *error) {
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
static bool is_proven(const cure_search *self) {
    return self->plausible == 1 && (self->is_silent || self->is_illegal || self->strong >= 2 ||
                                    (!self->newest->table && self->newest->shift == 0));
}

static tl_status search_source(cure_search *self, char cures[TL_MAX_SIGNALS][TL_PROBE_CURE], tl_error *error) {
    tl_status status = TL_OK;
    self->plausible = 0;
    if (!is_wrong(self)) {
        return TL_OK;
    }
    tl_log(TL_LOG_NOTICE, "%s: no plausible values: other mappings are tried",
           self->present->config->sources[self->source].name);
    if (self->is_silent) { /* a unit id needs a connection */
        status = try_all(self, SILENT, self->is_refused ? 1 : COUNT_OF(SILENT), error);
    } else {
        status = try_all(self, SINGLE, COUNT_OF(SINGLE), error);
    }
    if (status == TL_OK && self->plausible == 0 && !self->is_silent) {
        status = try_all(self, DOUBLE, COUNT_OF(DOUBLE), error);
    }
    if (status == TL_OK && self->plausible > 0 && tl_interrupt_requested() == NULL) {
        propose(self, is_proven(self), cures);
    }
    return status;
}

tl_status tl_probe_cures_find(const tl_plant_probe *found, const tl_probe_modbus *present,
                              int (*run_role)(const char *role, void *context),
                              char cures[TL_MAX_SIGNALS][TL_PROBE_CURE], tl_error *error) {
    static cure_search self; /* static, because it is too large for the stack */
    const tl_config *config = present->config;
    tl_status status = TL_OK;
    memset(cures, 0, TL_MAX_SIGNALS * sizeof cures[0]);
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
