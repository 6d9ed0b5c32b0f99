/* Cures of a Modbus source: see probe_cures.h. */
#include "firmware/cli/probe_cures.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/config/probe_evidence.h"
#include "firmware/process/interrupt.h"

/* Each mapping is read for at most this time, and two time-outs. */
static const double PASS_S = 1.2;

/* Scores are natural logarithms. Costs: how rare each mistake is. */
static const double WORDS_COST = 0.8;
static const double BYTES_COST = 2.5;
static const double PLACE_COST = 3;
static const double NOTATION_COST = 1.5;
static const double FIXED_COST = 5;  /* of a register that does not move with its value */
static const double SIGNAL_COST = 3; /* type or scale of one signal */
static const double SIGN_COST = 2;
static const double AT_START = -0.2; /* the plant is at its start; or not */
static const double ELSEWHERE = -1.6;

/* Least advantage of a proposal over the present mapping; of another type, scale or sign of one
 * signal; over the next mapping; and of one that is worth a remark. */
static const double BETTER = 5;
static const double SIGNAL_BETTER = 3.5;
static const double SIGNAL_BETTER_ELSEWHERE = 5;
static const double CLEARER = 2;
static const double REMARKABLE = 0.3;

/* An evidence below these is doubtful, or bad: then its signal gets a remark at least. */
static const double DOUBTFUL = -1;
static const double BAD = -3;

/* Evidence of a register that the device does not have. */
static const double MISSING = -12;

/* No other mapping is read after this time. */
static const double SEARCH_S = 20;

/* Tried if nothing answers. */
static const uint16_t PORTS[] = {502, 1502, 5020, 4001, 8899};
static const uint8_t UNITS[] = {1, 2, 3, 10, 247, 255, 0};
static const double PAUSES_S[] = {0.5, 1, 2};

/* Addresses in a manual from which each table counts, if they are written with the table. */
enum { HOLDING_FIRST = 40001, INPUT_FIRST = 30001 };

#define COUNT_OF(array) (sizeof(array) / sizeof(array)[0])

typedef struct candidate {
    double score;
    tl_probe_link link;
    tl_modbus_channel channels[TL_MAX_SIGNALS];
    bool is_unclear[TL_MAX_SIGNALS]; /* another type, scale or sign of the signal may be right */
} candidate;

typedef struct cure_search {
    const tl_plant_probe *found;
    const tl_probe_modbus *present;
    int (*run_role)(const char *role, void *context);
    size_t source;
    bool is_silent;        /* no signal has an answer */
    tl_probe_modbus tried; /* the mapping that was read last */
    tl_plant_probe read;
    int unit;    /* that was asked last; -1: as configured */
    tl_time end; /* no mapping is read after it */
    tl_error *error;
    tl_status status; /* of the readings */
    candidate best;
    double next; /* score of the best one with another connection, place or order */
} cure_search;

static bool is_of_source(const cure_search *self, size_t signal) {
    return self->present->config->signals[signal].source == self->source;
}

static const tl_modbus_settings *settings_of(const cure_search *self) {
    return self->present->config->sources[self->source].settings;
}

/* ---- readings ---- */

static bool is_over(const cure_search *self) {
    return self->status != TL_OK || tl_interrupt_requested() != NULL || tl_clock_now(NULL) > self->end;
}

/* Types that may be mistaken for each other. */
static const tl_modbus_type NUMBERS[] = {TL_MODBUS_INT16,   TL_MODBUS_UINT16, TL_MODBUS_INT32,  TL_MODBUS_UINT32,
                                         TL_MODBUS_FLOAT32, TL_MODBUS_INT64,  TL_MODBUS_FLOAT64};

static bool is_number(tl_modbus_type type) {
    bool found = false;
    for (size_t i = 0; i < COUNT_OF(NUMBERS); i++) {
        found = found || NUMBERS[i] == type;
    }
    return found;
}

static void read_once(cure_search *self) {
    const tl_probe_link *link = &self->tried.link;
    memset(self->tried.has_registers, 0, sizeof self->tried.has_registers);
    char *text = tl_probe_modbus_text(&self->tried);
    const tl_plant_probe_settings settings = {
        .config = self->present->config,
        .text = text,
        .duration = tl_time_of_seconds(PASS_S + 2 * settings_of(self)->timeout_s + 5 * link->pause_s),
        .is_brief = true,
        .run_role = self->run_role,
        .convert = tl_probe_modbus_convert,
        .concerns = tl_probe_modbus_concerns,
        .context = &self->tried,
    };
    self->status = text != NULL ? tl_plant_probe_run(&settings, &self->read, self->error)
                                : tl_fail(self->error, TL_TRY_AGAIN, "not enough memory for the configuration");
    free(text);
}

/* The driver calls a missing register illegal; other problems concern the connection. */
static bool is_illegal(const tl_plant_probe_signal *signal) {
    return signal->last.quality == TL_NO_LINK && strstr(signal->cause, "Illegal") != NULL;
}

/* Changes how the registers of a signal are read that gave none: fewer of them, or as int64 if they
 * are no float64. Returns false if there is no other way. */
static bool change_reading(cure_search *self, size_t signal) {
    const tl_quality quality = self->read.signals[signal].last.quality;
    const size_t width = tl_probe_modbus_width(&self->tried, signal);
    const bool is_wider = width > tl_modbus_registers(self->tried.channels[signal].type);
    if (quality == TL_NO_LINK && self->tried.width[signal] > 1 &&
        (is_wider || is_illegal(&self->read.signals[signal]))) {
        self->tried.width[signal] = width / 2;
        return true;
    }
    const bool is_no_float64 = quality == TL_NOT_A_NUMBER && !self->tried.has_registers[signal];
    const bool changes = is_no_float64 && !self->tried.is_int64[signal];
    self->tried.is_int64[signal] = self->tried.is_int64[signal] || changes;
    return changes;
}

/* Reads self->tried, `width` registers of each value if it has so many and no part of a register
 * or bit is meant; 0: as the types have. Returns false if that failed. */
static bool read_mapping(cure_search *self, size_t width) {
    bool is_again = true;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        self->tried.is_int64[i] = false;
        self->tried.width[i] = is_of_source(self, i) && is_number(self->tried.channels[i].type) ? width : 0;
    }
    while (is_again && tl_interrupt_requested() == NULL) {
        read_once(self);
        is_again = false;
        for (size_t i = 0; i < self->present->config->own_count && self->status == TL_OK; i++) {
            is_again = (is_of_source(self, i) && change_reading(self, i)) || is_again;
        }
    }
    return self->status == TL_OK && tl_interrupt_requested() == NULL;
}

/* Returns true if the device has a value or refuses the request; false also if a gateway answers
 * that it has no such unit. */
static bool has_answer(const tl_plant_probe_signal *signal) {
    return signal->last.quality != TL_NO_LINK ||
           (strstr(signal->cause, ": unit ") != NULL && strstr(signal->cause, "check unit_id") == NULL);
}

/* Counts the signals without value, whose registers may yet exist. */
static size_t count_missing(const cure_search *self, const tl_plant_probe *read) {
    size_t missing = 0;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        const tl_plant_probe_signal *signal = &read->signals[i];
        missing += is_of_source(self, i) && signal->last.quality == TL_NO_LINK && !is_illegal(signal) ? 1 : 0;
    }
    return missing;
}

static bool is_refused(const cure_search *self, const tl_plant_probe *read) {
    bool refused = false;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        refused = refused || (is_of_source(self, i) && strstr(read->signals[i].cause, "no connection") != NULL);
    }
    return refused;
}

/* ---- scores ---- */

static bool is_same_order(const tl_modbus_channel *a, const tl_modbus_channel *b) {
    return a->words_little == b->words_little && a->bytes_little == b->bytes_little && a->table == b->table &&
           a->address == b->address && a->unit_id == b->unit_id;
}

static bool is_same_decoding(const tl_modbus_channel *a, const tl_modbus_channel *b) {
    return a->type == b->type && fabs(a->scale - b->scale) <= 1e-9 * fabs(b->scale);
}

static bool is_same_link(const tl_probe_link *a, const tl_probe_link *b) {
    return a->port == b->port && a->other_framing == b->other_framing && a->most_registers == b->most_registers &&
           a->pause_s >= b->pause_s && a->pause_s <= b->pause_s;
}

/* Ignores type, scale and sign. */
static bool is_same_mapping(const cure_search *self, const candidate *a, const tl_modbus_channel *channels,
                            const tl_probe_link *link) {
    bool same = is_same_link(&a->link, link);
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        same = same && (!is_of_source(self, i) || is_same_order(&a->channels[i], &channels[i]));
    }
    return same;
}

/* Keeps the mapping if it is the best, or the next one. */
static void offer(cure_search *self, const candidate *offered) {
    if (is_same_mapping(self, &self->best, offered->channels, &offered->link)) {
        self->best = offered->score > self->best.score ? *offered : self->best;
    } else if (offered->score > self->best.score) {
        self->next = self->best.score;
        self->best = *offered;
    } else {
        self->next = fmax(self->next, offered->score);
    }
}

/* Returns true if the last register of a value stays the same, and not 0, while others change: it
 * belongs to another value. Known only of registers that were read for long. */
static bool is_fixed(const cure_search *self, size_t signal, const tl_modbus_channel *channel) {
    const tl_modbus_channel *present = &self->present->channels[signal];
    const size_t count = tl_modbus_registers(channel->type);
    const size_t last = channel->words_little ? 0 : count - 1;
    const unsigned moved = self->present->moved[signal];
    return count > 1 && count == tl_modbus_registers(present->type) && channel->table == present->table &&
           channel->address == present->address && self->present->has_registers[signal] && moved != 0 &&
           (moved & 1U << last) == 0 && self->present->registers[signal][last] != 0;
}

/* Evidence of a signal as it was read, decoded by `channel`. */
static double evidence_of(const cure_search *self, size_t signal, const tl_modbus_channel *channel, bool at_start) {
    const tl_plant_probe_signal *read = &self->read.signals[signal];
    if (tl_modbus_registers(channel->type) > tl_probe_modbus_width(&self->tried, signal)) {
        return MISSING;
    }
    if (read->last.quality == TL_NO_LINK || !self->tried.has_registers[signal]) {
        return read->last.quality == TL_NO_LINK ? MISSING : TL_PROBE_NO_VALUE;
    }
    return tl_probe_evidence(&self->present->config->signals[signal], channel, self->tried.registers[signal],
                             at_start) -
           (is_fixed(self, signal, channel) ? FIXED_COST : 0);
}

/* Decoding of one signal: as configured (the first one), the best one, and the next one that gives
 * another value. */
typedef struct decoding_choice {
    tl_modbus_channel best;
    double value; /* of `best` */
    double score, next, present;
} decoding_choice;

static void choose(decoding_choice *self, const tl_modbus_channel *channel, double value, double score) {
    const bool is_equal = fabs(value - self->value) <= 1e-9 * fabs(value);
    if (!isfinite(self->present)) {
        self->present = score;
    }
    if (score > self->score) {
        self->next = is_equal ? self->next : self->score;
        self->score = score;
        self->best = *channel;
        self->value = value;
    } else if (!is_equal) {
        self->next = fmax(self->next, score);
    }
}

static void choose_changed(const cure_search *self, size_t signal, const tl_modbus_channel *channel, double cost,
                           bool at_start, decoding_choice *choice) {
    double value = 0;
    (void)tl_modbus_decode(channel, self->tried.registers[signal], &value);
    choose(choice, channel, value, evidence_of(self, signal, channel, at_start) - cost);
}

/* Tries each other scale, the other sign, and each other type that the registers can hold. */
static void choose_decoding(const cure_search *self, size_t signal, const tl_modbus_channel *channel, bool at_start,
                            decoding_choice *choice) {
    static const double factors[] = {10, 0.1, 100, 0.01, 1000, 0.001, -1};
    const double present = evidence_of(self, signal, channel, at_start);
    *choice = (decoding_choice){.score = -HUGE_VAL, .next = -HUGE_VAL, .present = -HUGE_VAL};
    choose_changed(self, signal, channel, 0, at_start, choice);
    if (!is_number(channel->type) || !self->tried.has_registers[signal] || !(fabs(present - TL_PROBE_NO_VALUE) > 0)) {
        return;
    }
    for (size_t i = 0; i < COUNT_OF(factors); i++) {
        tl_modbus_channel other = *channel;
        other.scale *= factors[i];
        choose_changed(self, signal, &other, factors[i] > 0 ? SIGNAL_COST : SIGN_COST, at_start, choice);
    }
    for (size_t i = 0; i < COUNT_OF(NUMBERS); i++) {
        tl_modbus_channel other = *channel;
        other.type = NUMBERS[i];
        if (other.type != channel->type &&
            tl_modbus_registers(other.type) <= tl_probe_modbus_width(&self->tried, signal)) {
            choose_changed(self, signal, &other, SIGNAL_COST, at_start, choice);
        }
    }
}

/* Offers the channels, each with another type, scale or sign if that is clearly better. */
static void offer_choices(cure_search *self, const tl_modbus_channel *channels, double cost, bool at_start) {
    static candidate offered; /* static, because it is large */
    offered.score = (at_start ? AT_START : ELSEWHERE) - cost;
    offered.link = self->tried.link;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            decoding_choice choice;
            choose_decoding(self, i, &channels[i], at_start, &choice);
            const double gain = choice.score - choice.present;
            const bool is_clear =
                gain > (at_start ? SIGNAL_BETTER : SIGNAL_BETTER_ELSEWHERE) && choice.score - choice.next > CLEARER;
            offered.is_unclear[i] =
                !is_clear && (gain > REMARKABLE || (choice.present < BAD && choice.present > MISSING));
            offered.channels[i] = is_clear ? choice.best : channels[i];
            offered.score += is_clear ? choice.score : choice.present;
        }
    }
    offer(self, &offered);
}

/* Sets the same order for all channels. Returns its cost: 0 if it changes nothing. */
static double set_order(const cure_search *self, bool words_little, bool bytes_little,
                        tl_modbus_channel channels[TL_MAX_SIGNALS]) {
    double words_cost = 0;
    double bytes_cost = 0;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        const tl_modbus_channel *tried = &self->tried.channels[i];
        channels[i] = *tried;
        if (is_of_source(self, i) && tl_modbus_registers(tried->type) > 1 && tried->words_little != words_little) {
            channels[i].words_little = words_little;
            words_cost = WORDS_COST;
        }
        if (is_of_source(self, i) && tried->type != TL_MODBUS_BIT && tried->bytes_little != bytes_little) {
            channels[i].bytes_little = bytes_little;
            bytes_cost = BYTES_COST;
        }
    }
    return words_cost + bytes_cost;
}

/* Offers what was read, as it was, and in all word and byte orders. */
static void offer_orders(cure_search *self, double cost) {
    tl_modbus_channel channels[TL_MAX_SIGNALS];
    offer_choices(self, self->tried.channels, cost, true);
    offer_choices(self, self->tried.channels, cost, false);
    for (unsigned order = 0; order < 4; order++) {
        const double more = set_order(self, (order & 1) != 0, (order & 2) != 0, channels);
        if (more > 0) {
            offer_choices(self, channels, cost + more, true);
            offer_choices(self, channels, cost + more, false);
        }
    }
}

/* Score of what was read, exactly as it was. */
static double score_unchanged(const cure_search *self) {
    double at_start = AT_START;
    double elsewhere = ELSEWHERE;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            at_start += evidence_of(self, i, &self->tried.channels[i], true);
            elsewhere += evidence_of(self, i, &self->tried.channels[i], false);
        }
    }
    return fmax(at_start, elsewhere);
}

/* ---- places ---- */

/* Changes the places of all signals. Returns false if one does not exist. */
static bool set_place(cure_search *self, const tl_modbus_channel *from, bool other_table, long shift) {
    static const tl_modbus_table other[] = {[TL_MODBUS_COIL] = TL_MODBUS_DISCRETE,
                                            [TL_MODBUS_DISCRETE] = TL_MODBUS_COIL,
                                            [TL_MODBUS_HOLDING] = TL_MODBUS_INPUT,
                                            [TL_MODBUS_INPUT] = TL_MODBUS_HOLDING};
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            tl_modbus_channel *channel = &self->tried.channels[i];
            const long address = from[i].address + shift;
            if (address < 0 || address + (long)tl_modbus_registers(channel->type) > 65536) {
                return false;
            }
            channel->table = other_table ? other[from[i].table] : from[i].table;
            channel->address = (uint16_t)address;
        }
    }
    return true;
}

/* Returns the number that manuals add to the addresses of this table, if all addresses may have
 * it; else 0. */
static long notation_of(const cure_search *self) {
    unsigned least = UINT16_MAX;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        const unsigned address = self->present->channels[i].address;
        least = is_of_source(self, i) && address < least ? address : least;
    }
    return least >= HOLDING_FIRST ? HOLDING_FIRST : least >= INPUT_FIRST ? INPUT_FIRST : 0;
}

/* Reads and offers all other places of the mapping self->tried. */
static void try_places(cure_search *self) {
    tl_modbus_channel from[TL_MAX_SIGNALS];
    const long notation = notation_of(self);
    memcpy(from, self->tried.channels, sizeof from);
    for (int i = 0; i < 12 && !is_over(self); i++) {
        const bool other_table = i % 2 != 0;
        const long step = (long[]){0, -1, 1}[i / 2 % 3];
        const bool is_noted = notation > 0 && i < 6;
        const double cost = (other_table ? PLACE_COST : 0) + (step != 0 ? PLACE_COST : 0);
        const bool is_new = is_noted || (i % 6 != 0 && (notation > 0 || i < 6));
        if (is_new && set_place(self, from, other_table, step - (is_noted ? notation : 0)) &&
            read_mapping(self, TL_PROBE_REGISTERS)) {
            offer_orders(self, cost + (is_noted ? NOTATION_COST : 0));
        }
    }
}

/* ---- connections ---- */

static void set_unit(cure_search *self, int unit) {
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            self->tried.channels[i].unit_id = unit >= 0 ? (uint8_t)unit : self->present->channels[i].unit_id;
        }
    }
}

/* Reads self->tried with another unit, -1: the present one. Returns true if the device answers. */
static bool is_answered(cure_search *self, tl_probe_link link, int unit) {
    const bool is_line = settings_of(self)->line.device != NULL;
    if (is_line && (link.port != 0 || link.other_framing || unit == 0 || unit == UINT8_MAX)) {
        return false;
    }
    self->tried.link = link;
    self->unit = unit;
    set_unit(self, unit);
    return !is_over(self) && read_mapping(self, 0) && count_missing(self, &self->read) == 0;
}

/* Sets *port to one that accepts a connection. Returns true if the device answers there. */
static bool find_port(cure_search *self, uint16_t *port) {
    for (size_t i = 0; i < COUNT_OF(PORTS); i++) {
        if (PORTS[i] != settings_of(self)->port) {
            const bool answers = is_answered(self, (tl_probe_link){.port = PORTS[i]}, -1);
            if (answers || (*port == 0 && !is_refused(self, &self->read))) {
                *port = PORTS[i];
            }
            if (answers) {
                return true;
            }
        }
    }
    return false;
}

/* Drops most_registers, or raises it as far as the device answers, and reads so. Returns true. */
static bool raise_limit(cure_search *self, int unit) {
    tl_probe_link link = self->tried.link;
    tl_probe_link longer = link;
    longer.most_registers = 0;
    if (is_answered(self, longer, unit)) {
        return true;
    }
    for (uint8_t most = 2; most <= 64; most = (uint8_t)(most * 2)) {
        longer.most_registers = most;
        if (!is_answered(self, longer, unit)) {
            break;
        }
        link = longer;
    }
    (void)is_answered(self, link, unit);
    return true;
}

static bool find_unit(cure_search *self, tl_probe_link link) {
    for (size_t i = 0; i < COUNT_OF(UNITS); i++) {
        if (is_answered(self, link, UNITS[i])) {
            return true;
        }
    }
    return false;
}

/* Finds other keys of the connection with which the device answers, and reads with them. First one
 * key, then two. */
static bool find_link(cure_search *self) {
    tl_probe_link base = {0};
    const bool refused = is_refused(self, self->found);
    if (self->is_silent && refused && find_port(self, &base.port)) {
        return true;
    }
    if (self->is_silent && refused && base.port == 0) {
        return false;
    }
    tl_probe_link framing = base;
    tl_probe_link single = base;
    framing.other_framing = true;
    single.most_registers = 1;
    if (is_answered(self, framing, -1) || (is_answered(self, single, -1) && raise_limit(self, -1)) ||
        (self->is_silent && find_unit(self, base))) {
        return true;
    }
    for (size_t i = 0; i < COUNT_OF(PAUSES_S); i++) {
        tl_probe_link pause = base;
        pause.pause_s = PAUSES_S[i];
        if (is_answered(self, pause, -1)) {
            return true;
        }
    }
    framing.most_registers = 1;
    if (is_answered(self, framing, -1) || (self->is_silent && find_unit(self, framing))) {
        return raise_limit(self, self->unit);
    }
    single.pause_s = PAUSES_S[0];
    if (is_answered(self, single, -1) || (self->is_silent && find_unit(self, single))) {
        return raise_limit(self, self->unit);
    }
    framing.pause_s = PAUSES_S[0];
    return is_answered(self, framing, -1) && raise_limit(self, -1);
}

/* ---- proposals ---- */

static void add_key(char text[TL_PROBE_CURE], const char *format, ...) TL_PRINTF(2, 3);

static void add_key(char text[TL_PROBE_CURE], const char *format, ...) {
    const size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(text + used, TL_PROBE_CURE - used, format, arguments);
    va_end(arguments);
}

static void describe_link(const cure_search *self, char text[TL_PROBE_CURE]) {
    const tl_probe_link *link = &self->best.link;
    const tl_probe_modbus changed = {.config = self->present->config, .source = self->source, .link = *link};
    if (link->port != 0) {
        add_key(text, " \"port\": %u in its source", (unsigned)link->port);
    }
    if (link->other_framing) {
        add_key(text, " \"framing\": \"%s\" in its source", tl_probe_modbus_framing(&changed));
    }
    if (link->pause_s > 0) {
        add_key(text, " \"pause_s\": %g in its source", link->pause_s);
    }
    if (link->most_registers != 0) {
        add_key(text, " \"most_registers\": %u in its source", (unsigned)link->most_registers);
    }
}

static void describe_signal(const cure_search *self, size_t signal, char text[TL_PROBE_CURE]) {
    const tl_modbus_channel *present = &self->present->channels[signal];
    const tl_modbus_channel *wanted = &self->best.channels[signal];
    if (wanted->unit_id != present->unit_id) {
        add_key(text, " \"unit_id\": %u instead of %u", (unsigned)wanted->unit_id, (unsigned)present->unit_id);
    }
    if (wanted->table != present->table) {
        add_key(text, " \"table\": \"%s\"", tl_probe_modbus_tables[wanted->table]);
    }
    if (wanted->address != present->address) {
        add_key(text, " \"address\": %u", (unsigned)wanted->address);
    }
    if (wanted->type != present->type) {
        add_key(text, " \"type\": \"%s\"", tl_probe_modbus_types[wanted->type]);
    }
    if (wanted->words_little != present->words_little) {
        add_key(text, " \"words\": \"%s\"", wanted->words_little ? "little" : "big");
    }
    if (wanted->bytes_little != present->bytes_little) {
        add_key(text, " \"bytes\": \"%s\"", wanted->bytes_little ? "little" : "big");
    }
    if (fabs(wanted->scale - present->scale) > 1e-9 * fabs(present->scale)) {
        add_key(text, " \"scale\": %.9g", wanted->scale);
    }
}

/* Writes the proposal for each signal whose mapping it changes. */
static void propose(const cure_search *self, double unchanged, char cures[TL_MAX_SIGNALS][TL_PROBE_CURE]) {
    const tl_probe_link no_change = {0};
    const candidate *best = &self->best;
    const bool is_same_source = is_same_mapping(self, best, self->present->channels, &no_change);
    const double gain = best->score - unchanged;
    const bool is_clear = is_same_source || (gain > BETTER && best->score - self->next > CLEARER);
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        const tl_modbus_channel *present = &self->present->channels[i];
        const bool is_changed = is_of_source(self, i) && (!is_same_link(&best->link, &no_change) ||
                                                          !is_same_order(&best->channels[i], present) ||
                                                          !is_same_decoding(&best->channels[i], present));
        if (is_changed && is_clear) {
            (void)snprintf(cures[i], TL_PROBE_CURE, "%s", self->is_silent ? "perhaps" : "likely");
            describe_link(self, cures[i]);
            describe_signal(self, i, cures[i]);
        } else if (is_of_source(self, i) && (best->is_unclear[i] || (is_changed && gain > REMARKABLE))) {
            (void)snprintf(cures[i], TL_PROBE_CURE, "cannot be told: compare with the display of the device");
        }
    }
}

/* Counts doubtful values; an absurd one twice. A sensor that is off often gives 0 or NaN. */
static size_t count_doubts(const cure_search *self) {
    size_t doubts = 0;
    for (size_t i = 0; i < self->present->config->own_count; i++) {
        if (is_of_source(self, i)) {
            const tl_modbus_channel *channel = &self->tried.channels[i];
            const double evidence = evidence_of(self, i, channel, false);
            const bool is_off = self->read.signals[i].last.quality == TL_NOT_A_NUMBER;
            const bool has_start = self->present->config->signals[i].plan.has_initial;
            doubts += evidence <= TL_PROBE_ABSURD ? 2 : 0;
            doubts += !is_off && evidence < DOUBTFUL ? 1 : 0;
            doubts += has_start && !(fabs(evidence - TL_PROBE_NO_VALUE) > 0) ? 1 : 0;
            doubts += has_start && evidence_of(self, i, channel, true) < DOUBTFUL ? 2 : 0;
        }
    }
    return doubts;
}

/* Offers the mapping that was read, and the others that the doubts suggest. */
static void offer_all(cure_search *self) {
    const size_t doubts = count_doubts(self);
    if (doubts > 0 && !read_mapping(self, TL_PROBE_REGISTERS)) {
        return;
    }
    if (doubts > 0) {
        offer_orders(self, 0);
    } else {
        offer_choices(self, self->tried.channels, 0, true);
    }
    if (doubts >= 2) {
        tl_log(TL_LOG_NOTICE, "%s: no plausible values: other mappings are tried",
               self->present->config->sources[self->source].name);
        try_places(self);
    }
}

static void search_source(cure_search *self, char cures[TL_MAX_SIGNALS][TL_PROBE_CURE]) {
    const tl_config *config = self->present->config;
    size_t answers = 0;
    self->tried = *self->present;
    self->tried.source = self->source;
    self->read = *self->found;
    self->best = (candidate){.score = -HUGE_VAL};
    self->next = -HUGE_VAL;
    self->end = tl_clock_now(NULL) + tl_time_of_seconds(SEARCH_S);
    for (size_t i = 0; i < config->own_count; i++) {
        answers += is_of_source(self, i) && has_answer(&self->found->signals[i]) ? 1 : 0;
    }
    const size_t missing = count_missing(self, self->found);
    const double unchanged = score_unchanged(self);
    self->is_silent = answers == 0 && missing > 0;
    if (missing > 0) {
        tl_log(TL_LOG_NOTICE, "%s: no answer: other mappings are tried", config->sources[self->source].name);
    }
    if (missing == 0 || find_link(self)) {
        offer_all(self);
    }
    if (self->status == TL_OK && tl_interrupt_requested() == NULL && isfinite(self->best.score)) {
        propose(self, unchanged, cures);
    }
}

tl_status tl_probe_cures_find(const tl_plant_probe *found, const tl_probe_modbus *present,
                              int (*run_role)(const char *role, void *context),
                              char cures[TL_MAX_SIGNALS][TL_PROBE_CURE], tl_error *error) {
    static cure_search self; /* static, because it is too large for the stack */
    const tl_config *config = present->config;
    memset(cures, 0, TL_MAX_SIGNALS * sizeof cures[0]);
    self.found = found;
    self.present = present;
    self.run_role = run_role;
    self.error = error;
    self.status = TL_OK;
    for (size_t i = 0; i < config->source_count && self.status == TL_OK; i++) {
        self.source = i;
        if (tl_probe_modbus_has_source(config, i)) {
            search_source(&self, cures);
        }
    }
    return self.status;
}
