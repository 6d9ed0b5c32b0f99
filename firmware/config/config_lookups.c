/* Where each signal of the plant is looked up, where `delays` shift inputs and outputs by different times, or where what lies between two readings
 * waits for the next one (`between`; firmware/plant/plant_input.c says what it is).
 *
 * Only in mode lag a step waits; in the others the last reading stands, whatever is asked for (`check` says so): a line that is drawn on beyond the
 * last one takes its noise along several times over.
 * The wait is a fixed one: `every_s` of the slowest such signal, for inputs and for outputs, and a macro step more for a mean over it. All of a kind
 * are looked up as far back, so that all of what belongs to an instant is in one sample.
 *
 * A sample has one value for each signal. One that feeds an input and is matched as well is looked up twice: it is there a second time,
 * behind the others, as NAME@match, which is no name that a user can give.
 */
#include "firmware/config/config_parts.h"

#include <stdio.h>
#include <string.h>

#define SECOND "@match"

/* Whether a reference is "plant.NAME" of this signal. */
static bool leads_to(const char *reference, const tl_config_signal *signal) {
    return reference != NULL && strncmp(reference, "plant.", 6) == 0 && strcmp(reference + 6, signal->plan.name) == 0;
}

/* A command. */
bool tl_config_feeds(const tl_config *config, const tl_config_signal *signal) {
    if (leads_to(config->event.start.signal, signal)) {
        return true;
    }
    for (size_t i = 0; i < config->connection_count; i++) {
        if (leads_to(config->connections[i].from, signal)) {
            return true;
        }
    }
    return false;
}

static bool is_matched(const tl_config *config, const tl_config_signal *signal) {
    for (size_t i = 0; i < config->match_count; i++) {
        if (leads_to(config->match[i].to, signal)) {
            return true;
        }
    }
    return false;
}

static tl_between input_between(const tl_config *config, const tl_config_signal *signal) {
    return config->measurements == TL_LAG ? signal->as_input : TL_BETWEEN_LAST;
}

static void look_up_as_input(const tl_config *config, tl_config_signal *signal) {
    signal->look_back = config->input_lookup.look_back;
    signal->between = input_between(config, signal);
    signal->next = false;
}

/* What it is between two readings, where it is matched. It is looked up once: on a line if any match asks for that. */
static tl_between matched_between(const tl_config *config, const tl_config_signal *signal) {
    for (size_t i = 0; config->measurements == TL_LAG && i < config->match_count; i++) {
        if (leads_to(config->match[i].to, signal) && config->matched_between[i] != TL_BETWEEN_LAST) {
            return config->matched_between[i];
        }
    }
    return TL_BETWEEN_LAST;
}

static void look_up_as_output(const tl_config *config, tl_config_signal *signal) {
    const tl_config_delays *delays = config->delays;
    signal->look_back = config->output_lookup.look_back;
    signal->next = delays != NULL && (delays->has_output || delays->measure) && delays->next;
    signal->between = matched_between(config, signal);
}

/* ---- what waits for a next reading ---- */

/* A key that stands in the list of the plant's signals, or in that of what is matched. */
typedef struct listed {
    const tl_config_reader *reader;
    const char *where; /* the entry's path */
    const cJSON *entry;
} listed;

static listed find_signal(const tl_config_object *root, const tl_config_signal *signal) {
    const cJSON *plant = cJSON_GetObjectItemCaseSensitive(root->json, "plant");
    return (listed){root->reader, signal->plan.where, cJSON_GetObjectItemCaseSensitive(plant, signal->plan.name)};
}

static listed find_match(const tl_config_object *root, const tl_plan_match *match) {
    const cJSON *parent = cJSON_GetObjectItemCaseSensitive(root->json, "synchronise");
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(parent, "match");
    list = list != NULL ? list : cJSON_GetObjectItemCaseSensitive(root->json, "compare");
    return (listed){root->reader, match->where, cJSON_GetObjectItemCaseSensitive(list, match->variable)};
}

static void wrong(const listed *place, const char *key, const char *found, const char *expected, const char *example) {
    char path[TL_JSON_PATH];
    char described[128];
    const cJSON *item = cJSON_GetObjectItemCaseSensitive(place->entry, key);
    tl_json_member_path(path, place->where, key);
    tl_config_describe(item, described, sizeof described);
    tl_config_problem(place->reader, path, tl_json_line(item != NULL ? item : place->entry),
                      found != NULL ? found : described, expected, example);
}

/* What has to be where a signal is looked up between two readings; `place` asks for it. */
static void check_wait(const tl_config_object *root, const listed *place, const tl_config *config,
                       const tl_config_signal *signal) {
    static const char *const no_more = "at most 1000 times step_s";
    const listed own = find_signal(root, signal);
    if (signal->plan.type != TL_REAL) {
        wrong(place, "between", NULL, "\"last\": between two readings of an Integer or Boolean signal there is nothing",
              NULL);
        return;
    }
    if (signal->every == 0) {
        wrong(&own, "every_s", "none", "the longest time from one reading to the next, for which a step waits", "0.04");
    } else if (config->step > 0 && signal->every > TL_CONFIG_LONGEST_SHIFT * config->step) {
        wrong(&own, "every_s", NULL, no_more, NULL);
    }
}

static void check_input(const tl_config_object *root, const tl_config *config, const tl_config_signal *signal) {
    const listed place = find_signal(root, signal);
    if (signal->as_input == TL_BETWEEN_LAST) {
        return;
    }
    if (!tl_config_feeds(config, signal)) {
        wrong(&place, "between", "a signal that feeds no input",
              "no such key: of a signal that is matched it stands beside its \"to\"", NULL);
        return;
    }
    check_wait(root, &place, config, signal);
}

static void check_matched(const tl_config_object *root, const tl_config *config, size_t index) {
    const listed place = find_match(root, &config->match[index]);
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        if (leads_to(config->match[index].to, signal) && config->matched_between[index] != TL_BETWEEN_LAST) {
            check_wait(root, &place, config, signal);
        }
    }
}

static tl_time longer(tl_time a, tl_time b) {
    return a > b ? a : b;
}

static tl_time wait_of_inputs(const tl_config *config) {
    tl_time wait = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        tl_between between = input_between(config, signal);
        tl_time own = between == TL_BETWEEN_MEAN ? signal->every + config->step : signal->every;
        wait = longer(wait, between != TL_BETWEEN_LAST ? own : 0);
    }
    return wait;
}

static tl_time wait_of_outputs(const tl_config *config) {
    tl_time wait = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        const tl_config_signal *signal = &config->signals[i];
        wait = longer(wait, matched_between(config, signal) != TL_BETWEEN_LAST ? signal->every : 0);
    }
    return wait;
}

/* Of what is too long, which was told, there is none. */
static tl_delay_lookup place(tl_time shift, tl_time wait, tl_time step) {
    tl_time longest = (tl_time)2 * TL_CONFIG_LONGEST_SHIFT * step;
    bool is_wrong = step <= 0 || shift > longest || shift < -longest || wait > longest;
    static const tl_delay_lookup none = {0};
    return is_wrong ? none : tl_delay_look_up(shift, wait, step);
}

static void find_lookups(tl_config_object *root, tl_config *config) {
    const tl_config_delays *delays = config->delays;
    bool shifts_inputs = delays != NULL && delays->has_input;
    tl_time wait = wait_of_outputs(config);
    for (size_t i = 0; i < config->signal_count; i++) {
        check_input(root, config, &config->signals[i]);
    }
    for (size_t i = 0; i < config->match_count; i++) {
        check_matched(root, config, i);
    }
    wait = delays != NULL ? longer(wait, delays->wait) : wait;
    config->input_lookup = place(shifts_inputs ? delays->input.delay : 0, wait_of_inputs(config), config->step);
    config->output_lookup = place(delays != NULL ? delays->shift : 0, wait, config->step);
}

/* ---- look-ups ---- */

/* "plant.NAME@match"; NULL where memory is out. */
static const char *second_name(tl_config_reader *reader, const tl_config_signal *signal) {
    size_t size = strlen(signal->plan.name) + sizeof("plant." SECOND);
    char *name = tl_config_take(reader, size, 1);
    if (name != NULL) {
        (void)snprintf(name, size, "plant.%s" SECOND, signal->plan.name);
    }
    return name;
}

static void add_second(tl_config_reader *reader, tl_config *config, size_t first) {
    tl_config_signal *signal = &config->signals[config->signal_count + config->second_count];
    const char *name = second_name(reader, &config->signals[first]);
    if (name == NULL) {
        return;
    }
    *signal = config->signals[first];
    signal->plan.name = name + strlen("plant.");
    signal->of = first;
    look_up_as_output(config, signal);
    look_up_as_input(config, &config->signals[first]);
    for (size_t i = 0; i < config->match_count; i++) {
        if (leads_to(config->match[i].to, &config->signals[first])) {
            config->matched_as[i] = name;
        }
    }
    config->second_count++;
}

static void check_count(const tl_config_object *root, const tl_config *config) {
    char found[128];
    size_t count = config->signal_count + config->second_count;
    if (count > TL_MAX_SIGNALS) {
        (void)snprintf(found, sizeof found, "%zu signals, and %zu of them feed an input and are matched",
                       config->signal_count, config->second_count);
        tl_config_wrong(
            root, config->delays != NULL ? "delays" : "plant", found,
            "at most 64 together: with delays or a \"between\" such a signal is looked up twice, and counts "
            "twice",
            NULL);
    }
}

void tl_config_place_lookups(tl_config_object *root, tl_config *config) {
    size_t room = config->signal_count + config->match_count;
    tl_config_signal *signals = tl_config_take(root->reader, room, sizeof *signals);
    config->matched_as = tl_config_take(root->reader, config->match_count, sizeof *config->matched_as);
    if (signals == NULL || config->matched_as == NULL || config->signals == NULL) {
        return;
    }
    memcpy(signals, config->signals, config->signal_count * sizeof *signals);
    config->signals = signals;
    for (size_t i = 0; i < config->match_count; i++) {
        config->matched_as[i] = config->match[i].to;
    }
    if (config->matched_between == NULL ||
        config->signal_count > TL_MAX_SIGNALS) { /* nothing, or too many: reported already */
        return;
    }
    find_lookups(root, config);
    if (config->delays == NULL && config->input_lookup.ticks == 0 && config->output_lookup.ticks == 0) {
        return;
    }
    for (size_t i = 0; i < config->signal_count; i++) {
        bool matched = is_matched(config, &signals[i]);
        bool feeding = tl_config_feeds(config, &signals[i]);
        if (matched && feeding) {
            add_second(root->reader, config, i);
        } else if (matched) {
            look_up_as_output(config, &signals[i]);
        } else if (feeding) {
            look_up_as_input(config, &signals[i]);
        }
    }
    check_count(root, config);
}

void tl_config_use_lookups(tl_config *config) {
    if (config->signal_count != 0 && config->signals[config->signal_count - 1].of == config->signal_count - 1) {
        config->signal_count += config->second_count;
    }
}

void tl_config_forget_delays(tl_config *config) {
    config->delays = NULL;
    config->input_lookup = (tl_delay_lookup){0};
    config->output_lookup = (tl_delay_lookup){0};
    config->second_count = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        config->signals[i].look_back = 0;
        config->signals[i].next = false;
        config->signals[i].between = TL_BETWEEN_LAST;
    }
    for (size_t i = 0; i < config->match_count; i++) {
        config->matched_as[i] = config->match[i].to;
    }
}
