/* Where each signal of the plant is looked up, where `delays` shift inputs and outputs by different times.
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

static void look_up_as_input(const tl_config_delays *delays, tl_config_signal *signal) {
    signal->look_back = delays->input_lookup.look_back;
}

static void look_up_as_output(const tl_config_delays *delays, tl_config_signal *signal) {
    signal->look_back = delays->output_lookup.look_back;
    signal->next = (delays->has_output || delays->measure) && delays->next;
}

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
    look_up_as_output(config->delays, signal);
    look_up_as_input(config->delays, &config->signals[first]);
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
        tl_config_wrong(root, "delays", found,
                        "at most 64 together: with delays such a signal is looked up twice, and counts twice", NULL);
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
    if (config->delays == NULL || config->signal_count > TL_MAX_SIGNALS) { /* too many: reported already */
        return;
    }
    for (size_t i = 0; i < config->signal_count; i++) {
        bool matched = is_matched(config, &signals[i]);
        bool feeding = tl_config_feeds(config, &signals[i]);
        if (matched && feeding) {
            add_second(root->reader, config, i);
        } else if (matched) {
            look_up_as_output(config->delays, &signals[i]);
        } else if (feeding) {
            look_up_as_input(config->delays, &signals[i]);
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
    config->second_count = 0;
    for (size_t i = 0; i < config->signal_count; i++) {
        config->signals[i].look_back = 0;
        config->signals[i].next = false;
    }
    for (size_t i = 0; i < config->match_count; i++) {
        config->matched_as[i] = config->match[i].to;
    }
}
