/* `delays`: reads the chains by which signals reach plant and simulation, and computes their
 * delays. */

#include <stdio.h>
#include <string.h>

#include "firmware/config/config.h"
#include "firmware/config/config_reader.h"
#include "master/plan/plan.h"

enum { FOUND = 128, EXPECTED = 320, NO_PARTICIPANT = TL_CONFIG_PARTICIPANTS };

/* ---- participants ---- */

static void read_participants(tl_config_object *object, tl_config_need need, tl_config_delays *delays) {
    static const tl_config_number dead_rule = {.maximum = 3600, .example = "0.004"};
    static const tl_config_number cycle_rule = {
        .need = TL_CONFIG_REQUIRED, .above = true, .maximum = 3600, .example = "0.008"};
    static const char *const example = "{\"dead_s\": 0.004, \"cycle_s\": 0.008}";
    const tl_config_map rule = {.need = need,
                                .least = 1,
                                .most = TL_CONFIG_PARTICIPANTS,
                                .example = "{\"bus\": {\"cycle_s\": 0.008}, \"plant\": {\"cycle_s\": 0.0001}}"};
    tl_config_object map;
    size_t count = tl_config_entries(object, "participants", &rule, &map);
    const cJSON *item = NULL;
    cJSON_ArrayForEach(item, map.json) {
        tl_config_object entry;
        double dead_s = 0;
        double cycle_s = 1;
        tl_config_check_name(&map, item, "\"bus\"");
        if (tl_config_entry(&map, item, example, &entry)) {
            (void)tl_config_get_number(&entry, "dead_s", &dead_rule, &dead_s);
            (void)tl_config_get_number(&entry, "cycle_s", &cycle_rule, &cycle_s);
            tl_config_done(&entry);
        }
        if (count <= TL_CONFIG_PARTICIPANTS) {
            size_t index = delays->participant_count++;
            delays->names[index] = item->string;
            delays->participants[index] =
                (tl_delay_participant){tl_time_of_seconds(dead_s), tl_config_duration(cycle_s), index};
        }
    }
}

/* Returns the participant that an item names, or NO_PARTICIPANT after it was reported. */
static size_t find_participant(const tl_config_object *object, const cJSON *item, const char *path,
                               const tl_config_delays *delays) {
    char expected[EXPECTED];
    const cJSON *participants = cJSON_GetObjectItemCaseSensitive(object->reader->root, "delays");
    participants = cJSON_GetObjectItemCaseSensitive(participants, "participants");
    for (size_t i = 0; cJSON_IsString(item) && i < delays->participant_count; i++) {
        if (strcmp(delays->names[i], item->valuestring) == 0) {
            return i;
        }
    }
    tl_config_list_names("the name of a participant", participants, NULL, expected, sizeof expected);
    tl_config_wrong_item(object->reader, item, path, NULL, expected, NULL);
    return NO_PARTICIPANT;
}

/* ---- synchronous ---- */

/* Adds a participant to the group whose first participant is *first. */
static void join_group(const tl_config_object *object, const cJSON *item, const char *path, size_t *first,
                       bool *grouped, tl_config_delays *delays) {
    size_t index = find_participant(object, item, path, delays);
    if (index == NO_PARTICIPANT) {
        return;
    }
    if (grouped[index]) {
        tl_config_wrong_item(object->reader, item, path, NULL,
                             "each participant in at most one group (all participants of a group are synchronous)",
                             NULL);
        return;
    }
    grouped[index] = true;
    *first = *first == NO_PARTICIPANT ? index : *first;
    delays->participants[index].base = *first;
}

static void read_synchronous(tl_config_object *object, tl_config_delays *delays) {
    static const char *const expected = "an array of groups, each an array of two or more participants";
    static const char *const example = "[[\"acquisition\", \"simulation\"]]";
    char path[TL_JSON_PATH];
    bool grouped[TL_CONFIG_PARTICIPANTS] = {false};
    const cJSON *groups = tl_config_get_array(object, "synchronous", expected, example);
    const cJSON *group = NULL;
    size_t number = 0;
    tl_json_member_path(path, object->path, "synchronous");
    cJSON_ArrayForEach(group, groups) {
        char group_path[TL_JSON_PATH];
        size_t first = NO_PARTICIPANT;
        size_t position = 0;
        const cJSON *item = NULL;
        tl_json_element_path(group_path, path, number++);
        if (!cJSON_IsArray(group) || cJSON_GetArraySize(group) < 2) {
            tl_config_wrong_item(object->reader, group, group_path, NULL, "an array of two or more participants",
                                 "[\"acquisition\", \"simulation\"]");
            continue;
        }
        cJSON_ArrayForEach(item, group) {
            char item_path[TL_JSON_PATH];
            tl_json_element_path(item_path, group_path, position++);
            join_group(object, item, item_path, &first, grouped, delays);
        }
    }
}

/* ---- chains ---- */

/* Reads the indices of a chain. Returns false if one is invalid. */
static bool read_parts(const tl_config_object *object, const cJSON *array, const char *path,
                       const tl_config_delays *delays, tl_config_chain *chain) {
    const cJSON *item = NULL;
    size_t position = 0;
    bool right = true;
    cJSON_ArrayForEach(item, array) {
        char item_path[TL_JSON_PATH];
        tl_json_element_path(item_path, path, position++);
        size_t index = find_participant(object, item, item_path, delays);
        right = right && index != NO_PARTICIPANT;
        if (right) {
            chain->parts[chain->length++] = index;
        }
    }
    return right;
}

/* Reads one chain. Returns false if it is invalid. */
static bool read_chain(tl_config_object *object, const char *key, const char *example, const tl_config_delays *delays,
                       tl_config_chain *chain) {
    char path[TL_JSON_PATH];
    char expected[96];
    (void)snprintf(expected, sizeof expected, "an array of 1 to %d participants", (int)TL_DELAY_CHAIN);
    const cJSON *array = tl_config_get(object, key, TL_CONFIG_REQUIRED, expected, example);
    int size = cJSON_GetArraySize(array);
    if (array == NULL) {
        return false;
    }
    if (!cJSON_IsArray(array) || size < 1 || size > TL_DELAY_CHAIN) {
        tl_config_wrong(object, key, NULL, expected, example);
        return false;
    }
    tl_json_member_path(path, object->path, key);
    if (!read_parts(object, array, path, delays, chain)) {
        return false;
    }
    if (!tl_delay_of_chain(delays->participants, chain->parts, chain->length, &chain->density)) {
        (void)snprintf(expected, sizeof expected, "at most %d links between participants that are not synchronous",
                       (int)TL_DELAY_LINKS);
        tl_config_wrong(object, key, "a chain with more links", expected, NULL);
        return false;
    }
    return true;
}

/* Reads `input` or `output`. Returns true if it is present and valid. Sets `delay`: by how much the
 * simulation is later. */
static bool read_pair(tl_config_object *object, const char *key, tl_config_delays *delays, tl_config_pair *pair) {
    static const char *const plant = "[\"bus\", \"plant\", \"bus\"]";
    static const char *const simulation = "[\"bus\", \"acquisition\", \"simulation\"]";
    static const char *const expected = "an object with two chains, or a number of seconds";
    static const char *const example = "{\"plant\": [\"bus\", \"plant\"], \"simulation\": […]}";
    const cJSON *item = tl_config_get(object, key, TL_CONFIG_OPTIONAL, expected, example);
    static const tl_config_number seconds_rule = {
        .minimum = -TL_CONFIG_LONGEST_S, .maximum = TL_CONFIG_LONGEST_S, .example = "0.008"};
    tl_config_object member;
    double seconds = 0;
    if (item == NULL) {
        return false;
    }
    if (cJSON_IsNumber(item)) { /* the delay itself, for example a measured one */
        bool is_valid = tl_config_get_number(object, key, &seconds_rule, &seconds);
        pair->delay = tl_time_of_seconds(seconds);
        return is_valid;
    }
    if (!cJSON_IsObject(item)) {
        tl_config_wrong(object, key, NULL, expected, example);
        return false;
    }
    (void)tl_config_entry(object, item, example, &member);
    bool right = read_chain(&member, "plant", plant, delays, &pair->plant);
    right = read_chain(&member, "simulation", simulation, delays, &pair->simulation) && right;
    tl_config_done(&member);
    pair->delay = tl_delay_mode(&pair->simulation.density) - tl_delay_mode(&pair->plant.density);
    return right;
}

/* ---- resulting shifts ---- */

/* Samples are only kept for this time. */
static void check_near(const tl_config_object *object, const char *key, tl_time shift, tl_time wait, tl_time step) {
    char found[FOUND];
    char expected[EXPECTED];
    tl_time longest = TL_CONFIG_LONGEST_SHIFT * step;
    if (shift <= longest - wait && shift >= -longest) {
        return;
    }
    (void)snprintf(found, sizeof found, "a shift by %.9g s%s", tl_seconds(shift < 0 ? -shift : shift + wait),
                   shift > 0 && wait > 0 ? ", with the cycle of the plant's last participant" : "");
    (void)snprintf(expected, sizeof expected, "at most %d times step_s, which is %.15g s", (int)TL_CONFIG_LONGEST_SHIFT,
                   tl_seconds(longest));
    tl_config_wrong(object, key, found, expected, NULL);
}

/* Eq. 4.15 counts from the command, so Δo includes Δi. If inputs are shifted by Δi, outputs are
 * shifted by less. */
static void find_shifts(const tl_config_object *object, tl_time step, tl_config_delays *delays) {
    const tl_config_chain *last = &delays->output.plant;
    tl_time cycle = step;
    if (step <= 0) {
        return; /* invalid; reported before */
    }
    if (delays->has_input) {
        check_near(object, "input", delays->input.delay, 0, step);
    }
    if (delays->has_output) {
        cycle = last->length > 0 ? delays->participants[last->parts[last->length - 1]].cycle : step;
        delays->shift = (delays->has_input ? delays->input.delay : 0) - delays->output.delay;
    }
    delays->wait = (delays->has_output || delays->measure) && delays->next ? cycle : 0;
    check_near(object, "output", delays->shift, delays->wait, step);
}

/* The largest range that TL_DELAY_LAGS permits: N is one more than the range in steps. */
static tl_time longest_range(tl_time step) {
    return (TL_DELAY_LAGS - 1) * step;
}

/* Reads `true` or an object. */
static void read_measure(tl_config_object *object, tl_time step, tl_config_delays *delays) {
    static const char *const expected = "true or an object";
    static const char *const example = "{\"range_s\": 0.1}";
    const cJSON *item = tl_config_get(object, "measure", TL_CONFIG_OPTIONAL, expected, example);
    tl_config_object measure;
    delays->measure = item != NULL;
    delays->range = longest_range(step) / 2;
    if (item == NULL || cJSON_IsTrue(item)) {
        return;
    }
    if (!cJSON_IsObject(item)) {
        tl_config_wrong(object, "measure", NULL, expected, example);
        return;
    }
    (void)tl_config_entry(object, item, example, &measure);
    (void)tl_config_get_duration(&measure, "range_s", TL_CONFIG_OPTIONAL, "0.1", &delays->range);
    if (step > 0 && delays->range > longest_range(step)) {
        char most[EXPECTED];
        (void)snprintf(most, sizeof most, "at most %d times step_s, which is %.15g s", (int)TL_DELAY_LAGS - 1,
                       tl_seconds(longest_range(step)));
        tl_config_wrong(&measure, "range_s", NULL, most, NULL);
    }
    tl_config_done(&measure);
}

static void read_object(tl_config_object *root, tl_config_object *object, tl_time step, tl_config_delays *delays) {
    static const char *const choices[] = {"next", "newest", NULL};
    size_t take = 0;
    const cJSON *input = cJSON_GetObjectItemCaseSensitive(object->json, "input");
    const cJSON *output = cJSON_GetObjectItemCaseSensitive(object->json, "output");
    bool chains = cJSON_IsObject(input) || cJSON_IsObject(output);
    read_participants(object, chains ? TL_CONFIG_REQUIRED : TL_CONFIG_OPTIONAL, delays);
    read_synchronous(object, delays);
    delays->has_input = read_pair(object, "input", delays, &delays->input);
    delays->has_output = read_pair(object, "output", delays, &delays->output);
    (void)tl_config_get_choice(object, "take", TL_CONFIG_OPTIONAL, choices, &take);
    delays->next = take == 0;
    read_measure(object, step, delays);
    if (input == NULL && output == NULL && !delays->measure) {
        tl_config_wrong(root, "delays", "no delay", "\"input\", \"output\" or \"measure\"", "{\"measure\": true}");
    }
    tl_config_done(object);
}

void tl_config_read_delays(tl_config_object *root, tl_config *config) {
    static const char *const expected = "an object or \"measure\"";
    static const char *const example = "{\"participants\": {…}, \"output\": {…}}";
    const cJSON *item = tl_config_get(root, "delays", TL_CONFIG_OPTIONAL, expected, example);
    tl_config_delays *delays = item != NULL ? tl_config_allocate(root->reader, 1, sizeof *delays) : NULL;
    tl_config_object object;
    if (delays == NULL) {
        return;
    }
    if (cJSON_IsString(item) && strcmp(item->valuestring, "measure") == 0) {
        *delays = (tl_config_delays){.next = true, .measure = true, .range = longest_range(config->step) / 2};
        find_shifts(root, config->step, delays);
    } else if (cJSON_IsObject(item)) {
        (void)tl_config_entry(root, item, example, &object);
        read_object(root, &object, config->step, delays);
        find_shifts(&object, config->step, delays);
    } else {
        tl_config_wrong(root, "delays", NULL, expected, example);
        return;
    }
    config->delays = delays;
}
