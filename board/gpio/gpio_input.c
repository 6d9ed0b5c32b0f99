/* Level and edges of a GPIO line: see gpio_input.h. */
#include "board/gpio/gpio_input.h"

/* ---- gpio debounce ---- */

static void tl_gpio_debounce_start(tl_gpio_debounce *debounce, tl_time time, bool level) {
    *debounce = (tl_gpio_debounce){.time = time, .level = level, .newest = level};
}

/* No further edge comes before that time; the same evaluation. */
static bool tl_gpio_debounce_pass(tl_gpio_debounce *debounce, tl_time now, tl_time *since) {
    if (!debounce->pending || now - debounce->since < debounce->time) {
        return false;
    }
    debounce->pending = false;
    bool changed = debounce->level != debounce->newest;
    debounce->level = debounce->newest;
    *since = debounce->since;
    return changed;
}

/* Adds an edge to that level, not earlier than the one before. Returns true if an earlier edge, or
 * this one, has changed the valid level; *since is the time. */
static bool tl_gpio_debounce_edge(tl_gpio_debounce *debounce, bool level, tl_time stamp, tl_time *since) {
    bool changed = tl_gpio_debounce_pass(debounce, stamp, since);
    debounce->newest = level;
    debounce->since = stamp;
    debounce->pending = true;
    return debounce->time == 0 ? tl_gpio_debounce_pass(debounce, stamp, since) : changed;
}

/* ---- gpio input ---- */

static void fill(tl_gpio_input *input, tl_time stamp, tl_reading *reading) {
    input->posted = stamp > input->posted ? stamp : input->posted;
    *reading = (tl_reading){.value = input->debounce.level ? 1 : 0, .stamp = input->posted, .quality = TL_GOOD};
}

void tl_gpio_input_start(tl_gpio_input *input, const tl_gpio_input_settings *settings, tl_reading *reading) {
    *input = (tl_gpio_input){
        .level = settings->level, .last_stamp = settings->stamp, .posted = settings->stamp, .missed = settings->missed};
    tl_gpio_debounce_start(&input->debounce, settings->debounce, settings->level);
    fill(input, settings->stamp, reading);
}

static bool move(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading) {
    tl_time since = stamp;
    input->level = level;
    input->last_stamp = stamp;
    input->doubtful = false;
    bool changed = tl_gpio_debounce_edge(&input->debounce, level, stamp, &since);
    if (changed) {
        fill(input, since, reading);
    }
    return changed;
}

bool tl_gpio_input_edge(tl_gpio_input *input, bool level, tl_time stamp, tl_time now, tl_reading *reading) {
    if (stamp > now) { /* from another clock */
        stamp = now;
    }
    if (stamp < input->last_stamp) {
        return false;
    }
    input->missed += level == input->level ? 1 : 0;
    return move(input, level, stamp, reading);
}

bool tl_gpio_input_level(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading) {
    if (level != input->level) {
        bool believed = input->doubtful;
        input->doubtful = true;
        return believed && tl_gpio_input_resync(input, level, stamp, reading);
    }
    input->doubtful = false;
    bool changed = tl_gpio_input_advance(input, stamp, reading);
    if (!changed && !input->debounce.pending) {
        fill(input, stamp, reading);
        return true;
    }
    return changed;
}

bool tl_gpio_input_resync(tl_gpio_input *input, bool level, tl_time stamp, tl_reading *reading) {
    input->missed += level != input->level ? 1 : 0;
    tl_time at = stamp > input->last_stamp ? stamp : input->last_stamp;
    bool changed = move(input, level, at, reading);
    if (!changed && !input->debounce.pending) {
        fill(input, at, reading);
        return true;
    }
    return changed;
}

bool tl_gpio_input_advance(tl_gpio_input *input, tl_time now, tl_reading *reading) {
    tl_time since = now;
    bool changed = tl_gpio_debounce_pass(&input->debounce, now, &since);
    if (changed) {
        fill(input, since, reading);
    }
    return changed;
}

tl_time tl_gpio_input_due(const tl_gpio_input *input) {
    return input->debounce.pending ? input->debounce.since + input->debounce.time : INT64_MAX;
}
