/* Look-ups: computes the instant at which each signal of the plant is looked up, from `delays`,
 * `between` and `condition` (firmware/plant/plant_input.c does the look-up).
 *
 * Between:   only in mode lag a step can wait for the next reading. In the other modes the last
 *            reading is used, whatever is configured (`check` reports this). Extrapolation from the
 *            last readings would amplify their noise several times.
 * Wait:      it is fixed: `every_s` of the slowest such signal, for inputs and for outputs
 *            separately, plus one macro step for a mean. All inputs, and all outputs, are looked up
 *            with the same wait, so that one sample contains all values of an instant.
 * Condition: conditioning (plant/conditioner.c) delays the readings of a matched signal: half of
 *            the median's readings, every_s each, and the time constant of a low-pass, which is its
 *            lag. A step waits for this too, except in mode ahead. The low-pass is evaluated
 *            between the readings' stamps, so it is always looked up on the line.
 * Outliers:  rejected by default, unless a gate or a median does it, or there is no room for the
 *            further look-ups. With an event horizon, the instant of a reading counts: none there.
 * Names:     a sample has one value per signal. If a signal feeds an input and is matched too, the
 *            sample contains it a second time, after all others, as NAME@match; a user cannot
 *            define such a name. A matched signal that is conditioned or on a line is included once
 *            more, as it came, if there is room: NAME@reading.
 */
#include "firmware/config/config_reader.h"
#include "firmware/config/drivers.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define SECOND "@match"

static const char PLANT[] = "plant.";

size_t tl_config_signal_of(const tl_config *config, const char *reference) {
    size_t found = SIZE_MAX;
    for (size_t i = 0; reference != NULL && found == SIZE_MAX && i < config->signal_count; i++) {
        bool is_signal = strncmp(reference, PLANT, strlen(PLANT)) == 0 &&
                         strcmp(reference + strlen(PLANT), config->signals[i].plan.name) == 0;
        found = is_signal ? i : found;
    }
    return found;
}

static void note_input(tl_config *config, const char *reference) {
    size_t at = tl_config_signal_of(config, reference);
    if (at != SIZE_MAX) {
        config->signals[at].feeds = true;
    }
}

/* Records how each signal is used. All matches of a signal share one look-up: the first one with a
 * line, or with a condition, decides. */
static void note_uses(tl_config *config) {
    note_input(config, config->event.start.signal);
    for (size_t i = 0; i < config->connection_count; i++) {
        note_input(config, config->connections[i].from);
    }
    for (size_t i = 0; i < config->match_count; i++) {
        size_t at = tl_config_signal_of(config, config->match[i].to);
        if (at != SIZE_MAX) {
            tl_config_signal *signal = &config->signals[at];
            const tl_condition *first = &signal->matched_condition;
            bool has_condition = tl_condition_is_needed(first) || first->keeps_outliers;
            signal->is_matched = true;
            signal->as_output = signal->as_output != TL_BETWEEN_LAST ? signal->as_output : config->matched_between[i];
            signal->matched_condition = has_condition ? signal->matched_condition : config->conditions[i];
        }
    }
}

/* Rejects outliers of matched Reals. With several matches of a signal, the largest tolerance
 * counts. */
static void find_leaps(tl_config *config) {
    static const double tolerances = 6.0; /* at least 18 standard deviations of the noise */
    size_t count = config->signal_count;
    for (size_t i = 0; i < config->signal_count; i++) {
        count += config->signals[i].is_matched && config->signals[i].feeds ? 1 : 0;
    }
    for (size_t i = 0; i < config->match_count && count <= TL_MAX_SIGNALS && config->event.start.signal == NULL; i++) {
        size_t at = tl_config_signal_of(config, config->match[i].to);
        bool rejects = at != SIZE_MAX && config->match[i].weight > 0 && config->signals[at].plan.type == TL_REAL;
        if (rejects) {
            tl_condition *condition = &config->signals[at].matched_condition;
            bool is_free = condition->gate <= 0.0 && condition->median <= 1 && !condition->keeps_outliers;
            condition->leap = is_free ? fmax(condition->leap, tolerances * config->match[i].tolerance) : 0.0;
        }
    }
}

/* Returns the longest interval between two messages of the matched signals. */
static tl_time longest_wait(const tl_config *config) {
    static const tl_time unknown = 5; /* steps, if no signal gives every_s */
    tl_time longest = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        longest = signal->is_matched && signal->every > longest ? signal->every : longest;
    }
    tl_time most = TL_CONFIG_LONGEST_SHIFT * config->step;
    longest = longest == 0 ? unknown * config->step : longest;
    return longest < most ? longest : most;
}

uint32_t tl_config_free_twin_guard(const tl_config *config) {
    static const tl_time least = 2;
    if (!config->free_twin) {
        return 0;
    }
    tl_time wait = longest_wait(config);
    tl_time memory = 0;
    for (size_t i = 0; i < config->match_count; i++) {
        /* After three time constants the filter has practically forgotten a value. */
        const tl_condition *condition = &config->conditions[i];
        tl_time own = (condition->median > 1 ? (tl_time)(condition->median - 1) * wait : 0) + 3 * condition->low_pass;
        memory = own > memory ? own : memory;
    }
    tl_time steps = (2 * wait + memory + config->step - 1) / config->step;
    return (uint32_t)(steps > least ? steps : least);
}

bool tl_config_is_polled(const tl_config *config, const tl_config_signal *signal) {
    return signal->source < config->source_count && config->sources[signal->source].driver->is_polled;
}

tl_time tl_config_repeats(const tl_config *config, const tl_config_signal *signal) {
    if (!tl_config_is_polled(config, signal)) {
        return 0;
    }
    tl_time period = tl_time_of_seconds(config->sources[signal->source].period_s);
    tl_time half_stale = tl_time_of_seconds(signal->stale_s) / 2; /* polls may be late */
    tl_time due = half_stale > 0 && half_stale < signal->every ? half_stale : signal->every;
    return due > period ? due - period : 0;
}

tl_time tl_config_interval(const tl_config *config, const tl_config_signal *signal) {
    const bool is_own = signal->source < config->source_count && &config->signals[signal->of] == signal;
    tl_time period =
        tl_config_is_polled(config, signal) ? tl_time_of_seconds(config->sources[signal->source].period_s) : 0;
    return is_own ? signal->every > period ? signal->every : period : 0;
}

static tl_between input_between(const tl_config *config, const tl_config_signal *signal) {
    return config->measurements == TL_LAG ? signal->as_input : TL_BETWEEN_LAST;
}

static void look_up_as_input(const tl_config *config, tl_config_signal *signal) {
    signal->look_back = config->input_lookup.look_back;
    signal->between = input_between(config, signal);
    signal->next = false;
}

/* How a matched signal is looked up between two readings. */
static tl_between output_between(const tl_config *config, const tl_config_signal *signal) {
    bool is_smooth = config->measurements != TL_AHEAD && signal->matched_condition.low_pass > 0;
    return is_smooth ? TL_BETWEEN_LINE : config->measurements == TL_LAG ? signal->as_output : TL_BETWEEN_LAST;
}

static void look_up_as_output(const tl_config *config, tl_config_signal *signal) {
    const tl_config_delays *delays = config->delays;
    signal->look_back = config->output_lookup.look_back;
    signal->next = delays != NULL && (delays->has_output || delays->measure) && delays->next;
    signal->between = output_between(config, signal);
    signal->condition = signal->matched_condition;
}

/* ---- waiting for a next reading ---- */

/* Returns the object at a path of the file. */
static tl_config_object object_at(const tl_config_object *root, const char *where) {
    const char *path = where != NULL ? where : ""; /* memory was out when the path was copied */
    tl_config_object object = {.reader = root->reader, .json = tl_json_nearest(root->json, path)};
    (void)snprintf(object.path, sizeof object.path, "%s", path);
    return object;
}

/* Checks the requirements for a look-up between two readings, which `object` requests. */
static void check_wait(const tl_config_object *root, const tl_config_object *object, const tl_config *config,
                       const tl_config_signal *signal) {
    static const char *const limit = "at most 1000 times step_s";
    const tl_config_object own = object_at(root, signal->plan.where);
    if (signal->plan.type != TL_REAL) {
        tl_config_wrong(object, "between", NULL,
                        "\"last\" (an Integer or Boolean signal has no value between two readings)", NULL);
        return;
    }
    if (signal->every == 0) {
        tl_config_wrong(&own, "every_s", "nothing",
                        "the longest time from one reading to the next, in s (a step waits that long)", "0.04");
    } else if (config->step > 0 && signal->every > TL_CONFIG_LONGEST_SHIFT * config->step) {
        tl_config_wrong(&own, "every_s", NULL, limit, NULL);
    }
}

static void check_input(const tl_config_object *root, const tl_config *config, const tl_config_signal *signal) {
    const tl_config_object object = object_at(root, signal->plan.where);
    if (signal->as_input == TL_BETWEEN_LAST) {
        return;
    }
    if (!signal->feeds) {
        tl_config_wrong(&object, "between", "a signal that feeds no input",
                        "no \"between\" here (for a matched signal: in its match, next to \"to\")", NULL);
        return;
    }
    check_wait(root, &object, config, signal);
}

/* A reading is conditioned once for all its matches. */
static bool is_same_condition(const tl_condition *one, const tl_condition *other) {
    return one->median == other->median && one->low_pass == other->low_pass &&
           one->keeps_outliers == other->keeps_outliers && !(one->gate < other->gate) && !(one->gate > other->gate);
}

static tl_time every_of(const tl_config *config, const tl_config_signal *signal) {
    return signal->every > 0 ? signal->every : config->step;
}

static tl_time lag_of(const tl_config *config, const tl_config_signal *signal) {
    const tl_condition *condition = &signal->matched_condition;
    tl_time half = condition->median > 1 ? (tl_time)(condition->median - 1) / 2 : 0;
    return half * every_of(config, signal) + condition->low_pass;
}

static tl_time wait_of_condition(const tl_config *config, const tl_config_signal *signal) {
    return config->measurements == TL_AHEAD ? 0 : lag_of(config, signal);
}

tl_time tl_config_condition_lag(const tl_config *config, size_t match) {
    return lag_of(config, &config->signals[tl_config_signal_of(config, config->match[match].to)]);
}

/* Checks the condition beside a "to"; `signal` is the target. */
static void check_condition(const tl_config_object *object, const tl_config *config, size_t index,
                            const tl_config_signal *signal) {
    const tl_condition *own = &config->conditions[index];
    tl_time longest = TL_CONFIG_LONGEST_SHIFT * config->step;
    bool has_event = tl_config_signal_of(config, config->event.start.signal) != SIZE_MAX &&
                     tl_config_signal_of(config, config->event.end.signal) != SIZE_MAX && config->event.window > 0 &&
                     config->event.longest > 0;
    if (has_event && config->match[index].weight > 0) {
        tl_config_wrong(object, "condition", "a condition together with horizon.event",
                        "no condition (it would move the instant of the event)", NULL);
    } else if (!is_same_condition(own, &signal->matched_condition)) {
        tl_config_wrong(object, "condition", "another condition than that of an earlier match with the same signal",
                        "the same condition in all matches of a signal", NULL);
    } else if (own->low_pass > 0 && signal->plan.type != TL_REAL) {
        tl_config_wrong(object, "condition", "a low-pass on a signal that is not Real", "\"median\" or \"gate\"", NULL);
    } else if (wait_of_condition(config, signal) > longest) {
        tl_config_wrong(object, "condition", "a condition for which a step waits longer than 1000 times step_s",
                        "a shorter median or low-pass, or a smaller every_s of the signal", NULL);
    }
}

static void check_matched(const tl_config_object *root, const tl_config *config, size_t index) {
    const tl_config_object object = object_at(root, config->match[index].where);
    size_t at = tl_config_signal_of(config, config->match[index].to);
    if (at != SIZE_MAX && config->matched_between[index] != TL_BETWEEN_LAST) {
        check_wait(root, &object, config, &config->signals[at]);
    }
    if (at != SIZE_MAX && config->step > 0 && tl_condition_is_needed(&config->conditions[index])) {
        check_condition(&object, config, index, &config->signals[at]);
    }
}

static tl_time longer(tl_time a, tl_time b) {
    return a > b ? a : b;
}

/* A look-up that is too long was reported before; then none is used. */
static tl_delay_lookup make_lookup(tl_time shift, tl_time wait, tl_time step) {
    tl_time longest = (tl_time)2 * TL_CONFIG_LONGEST_SHIFT * step;
    bool is_invalid = step <= 0 || shift > longest || shift < -longest || wait > longest;
    static const tl_delay_lookup none = {0};
    return is_invalid ? none : tl_delay_look_up(shift, wait, step);
}

static void find_lookups(tl_config_object *root, tl_config *config) {
    const tl_config_delays *delays = config->delays;
    bool shifts_inputs = delays != NULL && delays->has_input;
    tl_time input_wait = 0;
    tl_time output_wait = delays != NULL ? delays->wait : 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        tl_between between = input_between(config, signal);
        tl_time own = between == TL_BETWEEN_MEAN ? signal->every + config->step : signal->every;
        tl_time next = output_between(config, signal) != TL_BETWEEN_LAST ? every_of(config, signal) : 0;
        input_wait = longer(input_wait, between != TL_BETWEEN_LAST ? own : 0);
        output_wait = longer(output_wait, wait_of_condition(config, signal) + next);
        check_input(root, config, signal);
    }
    for (size_t i = 0; i < config->match_count; i++) {
        check_matched(root, config, i);
    }
    config->input_lookup = make_lookup(shifts_inputs ? delays->input.delay : 0, input_wait, config->step);
    config->output_lookup = make_lookup(delays != NULL ? delays->shift : 0, output_wait, config->step);
}

/* ---- look-ups ---- */

/* Adds a further look-up of a signal after all others, a copy of the one at `from`, with the name
 * "plant.NAME" + suffix. Sets `names` of the matches of this signal. Returns NULL if memory is out.
 */
static tl_config_signal *add_look_up(tl_config_reader *reader, tl_config *config, size_t from, const char *suffix,
                                     const char **names) {
    tl_config_signal *signal = &config->signals[config->signal_count + config->further_count];
    size_t of = config->signals[from].of;
    size_t size = sizeof PLANT + strlen(config->signals[of].plan.name) + strlen(suffix);
    char *name = tl_config_allocate(reader, size, 1);
    if (name == NULL) {
        return NULL;
    }
    (void)snprintf(name, size, "%s%s%s", PLANT, config->signals[of].plan.name, suffix);
    *signal = config->signals[from];
    signal->plan.name = name + strlen(PLANT);
    signal->feeds = false;
    for (size_t i = 0; i < config->match_count; i++) {
        names[i] = tl_config_signal_of(config, config->match[i].to) == of ? name : names[i];
    }
    config->further_count++;
    return signal;
}

static void add_second(tl_config_reader *reader, tl_config *config, size_t first) {
    tl_config_signal *second = add_look_up(reader, config, first, SECOND, config->matched_as);
    if (second != NULL) {
        look_up_as_output(config, second);
        look_up_as_input(config, &config->signals[first]);
    }
}

/* Adds NAME@reading for a matched look-up. */
static void add_reading(tl_config_reader *reader, tl_config *config, size_t matched) {
    tl_config_signal *signal = add_look_up(reader, config, matched, TL_CONFIG_READING, config->reading_as);
    if (signal != NULL) {
        signal->is_reading = true;
        signal->shows = matched;
        signal->look_back = 0;
        signal->next = false;
        signal->between = TL_BETWEEN_LAST;
        signal->condition = (tl_condition){0};
    }
}

/* A matched signal that is used as it came needs no NAME@reading. If there is no room, it is left
 * out. */
static void add_readings(tl_config_reader *reader, tl_config *config) {
    size_t count = config->signal_count + config->further_count;
    for (size_t i = 0; i < count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        bool is_changed = signal->between != TL_BETWEEN_LAST || tl_condition_is_needed(&signal->condition);
        if (signal->is_matched && !signal->feeds && is_changed &&
            config->signal_count + config->further_count < TL_MAX_SIGNALS) {
            add_reading(reader, config, i);
        }
    }
}

static void check_count(const tl_config_object *root, const tl_config *config) {
    char found[128];
    size_t count = config->signal_count + config->further_count;
    if (count > TL_MAX_SIGNALS) {
        (void)snprintf(found, sizeof found, "%zu signals, and %zu of them feed an input and are matched",
                       config->signal_count, config->further_count);
        tl_config_wrong(
            root, config->delays != NULL ? "delays" : "plant", found,
            "at most 64 in all (with \"delays\", \"between\" or \"condition\", a signal with both uses counts twice)",
            NULL);
    }
}

void tl_config_build_lookups(tl_config_object *root, tl_config *config) {
    size_t room = config->signal_count + 2 * config->match_count;
    tl_config_signal *signals = tl_config_allocate(root->reader, room, sizeof *signals);
    config->matched_as = tl_config_allocate(root->reader, config->match_count, sizeof *config->matched_as);
    config->reading_as = tl_config_allocate(root->reader, config->match_count, sizeof *config->reading_as);
    if (signals == NULL || config->matched_as == NULL || config->reading_as == NULL || config->signals == NULL) {
        return;
    }
    memcpy(signals, config->signals, config->signal_count * sizeof *signals);
    config->signals = signals;
    for (size_t i = 0; i < config->match_count; i++) {
        config->matched_as[i] = config->match[i].to;
    }
    if (config->matched_between == NULL || config->conditions == NULL ||
        config->signal_count > TL_MAX_SIGNALS) { /* absent, or too many signals: reported before */
        return;
    }
    note_uses(config);
    find_leaps(config);
    find_lookups(root, config);
    bool is_unchanged = config->input_lookup.ticks == 0 && config->output_lookup.ticks == 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        is_unchanged = is_unchanged && !tl_condition_is_needed(&signals[i].matched_condition);
    }
    if (config->delays == NULL && is_unchanged) {
        return;
    }
    for (size_t i = 0; i < config->signal_count; i++) {
        if (signals[i].is_matched && signals[i].feeds) {
            add_second(root->reader, config, i);
        } else if (signals[i].is_matched) {
            look_up_as_output(config, &signals[i]);
        } else if (signals[i].feeds) {
            look_up_as_input(config, &signals[i]);
        }
    }
    check_count(root, config);
    add_readings(root->reader, config);
}

const char *tl_config_reading_of(const tl_config *config, size_t match) {
    size_t at = tl_config_signal_of(config, config->matched_as[match]);
    const tl_config_signal *signal = at != SIZE_MAX ? &config->signals[at] : NULL;
    bool is_unchanged =
        signal == NULL || (signal->between == TL_BETWEEN_LAST && !tl_condition_is_needed(&signal->condition));
    return config->reading_as[match] != NULL ? config->reading_as[match] : is_unchanged ? NULL : "";
}

void tl_config_use_lookups(tl_config *config) {
    config->signal_count = config->own_count + config->further_count;
}

tl_config_measured tl_config_measures_delay(const tl_config *config) {
    bool is_released = config->adjust_count != 0 && config->released_steps != 0 && config->event.start.signal == NULL;
    return config->delays != NULL && config->delays->measure ? TL_DELAY_USED
           : is_released                                     ? TL_DELAY_REPORTED
                                                             : TL_DELAY_NOT_MEASURED;
}

void tl_config_forget_delays(tl_config *config) {
    config->delays = NULL;
    config->input_lookup = (tl_delay_lookup){0};
    config->output_lookup = (tl_delay_lookup){0};
    config->further_count = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        config->signals[i].look_back = 0;
        config->signals[i].next = false;
        config->signals[i].between = TL_BETWEEN_LAST;
        config->signals[i].condition = (tl_condition){0};
    }
    for (size_t i = 0; i < config->match_count; i++) {
        config->matched_as[i] = config->match[i].to;
        config->reading_as[i] = NULL;
    }
}

/* ---- outputs of the FMUs ---- */

const char *tl_config_output_name(const tl_config *config, size_t output) {
    if (output < config->match_count) {
        return config->match[output].variable;
    }
    output -= config->match_count;
    if (output >= config->connection_count) {
        return NULL;
    }
    bool is_one = output + config->match_count < TL_CONFIG_OUTPUTS - 1;
    return is_one ? config->connections[output].from : "an output";
}

bool tl_config_is_bad_output(const tl_config *config, uint64_t bad_outputs, size_t output) {
    const bool is_bad = output < TL_CONFIG_OUTPUTS && (bad_outputs >> output & 1U) != 0;
    const char *name = is_bad ? tl_config_output_name(config, output) : NULL;
    if (name == NULL) {
        return false;
    }
    size_t i = 0;
    while (strcmp(tl_config_output_name(config, i), name) != 0) {
        i++;
    }
    return i == output;
}
