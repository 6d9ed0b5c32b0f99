/* What two configurations read alike: see config_same_signals.h. */
#include "firmware/config/config_same_signals.h"

#include <stdint.h>
#include <string.h>

#include "firmware/json/json_difference.h"

/* What was found to be different, of the candidate. */
typedef struct plant_comparison {
    const tl_config *candidate;
    bool is_other[TL_MAX_SIGNALS];        /* signal */
    bool is_other_source[TL_MAX_SIGNALS]; /* source */
} plant_comparison;

/* ---- differences ---- */

static void note_source(plant_comparison *self, const char *name) {
    for (size_t i = 0; i < self->candidate->source_count; i++) {
        if (strcmp(self->candidate->sources[i].name, name) == 0) {
            self->is_other_source[i] = true;
        }
    }
}

static void note_signal(plant_comparison *self, const char *name) {
    for (size_t i = 0; i < self->candidate->signal_count; i++) {
        if (strcmp(self->candidate->signals[i].plan.name, name) == 0) {
            self->is_other[i] = true;
        }
    }
}

/* What a driver is told of a signal; NULL: all of it. */
static bool is_read_by(const char *key) {
    static const char *const keys[] = {"modbus", "can", "gpio", "csv", "type"};
    bool is = key == NULL;
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++) {
        is = is || strcmp(key, keys[i]) == 0;
    }
    return is;
}

static void see(const tl_json_difference *difference, void *context) {
    plant_comparison *self = context;
    const tl_json_step *way = difference->way;
    if (difference->depth < 2 || difference->is_order || way[0].key == NULL || way[1].key == NULL) {
        return;
    }
    if (strcmp(way[0].key, "sources") == 0) {
        note_source(self, way[1].key);
    } else if (strcmp(way[0].key, "plant") == 0 && is_read_by(difference->depth > 2 ? way[2].key : NULL)) {
        note_signal(self, way[1].key);
    }
}

/* ---- the same ones ---- */

static size_t find_name(const tl_config *config, const char *name) {
    for (size_t i = 0; i < config->signal_count; i++) {
        if (strcmp(config->signals[i].plan.name, name) == 0) {
            return i;
        }
    }
    return TL_NO_SUCH_SIGNAL;
}

/* By name or not, both are of one source by its name. */
static bool is_of_same_source(const plant_comparison *self, const tl_config *run, const tl_config_signal *signal,
                              size_t found) {
    const tl_config *candidate = self->candidate;
    size_t source = run->signals[found].source;
    return source < run->source_count && signal->source < candidate->source_count &&
           !self->is_other_source[signal->source] &&
           strcmp(run->sources[source].name, candidate->sources[signal->source].name) == 0;
}

static size_t find_same(const plant_comparison *self, const tl_config *run, size_t index) {
    const tl_config_signal *signals = self->candidate->signals;
    size_t first = signals[index].of;
    size_t found = find_name(run, signals[index].plan.name);
    if (found == TL_NO_SUCH_SIGNAL) { /* a second look-up may be the first one of its signal */
        found = find_name(run, signals[first].plan.name);
    }
    bool is_same =
        found != TL_NO_SUCH_SIGNAL && !self->is_other[first] && is_of_same_source(self, run, &signals[index], found);
    return is_same ? found : TL_NO_SUCH_SIGNAL;
}

/* The run's driver takes readings for repeated as this one's would. */
static bool repeats_alike(const tl_config *run, const tl_config *candidate, size_t index) {
    return tl_config_repeats(run, &run->signals[index]) == tl_config_repeats(candidate, &candidate->signals[index]);
}

tl_status tl_config_same_signals(const tl_config *run, const tl_config *candidate, tl_same_signals *same,
                                 tl_error *error) {
    plant_comparison self = {.candidate = candidate};
    const tl_json_source before = {run->text, run->size, "the configuration of the run"};
    const tl_json_source after = {candidate->text, candidate->size, "the new configuration"};
    *same =
        (tl_same_signals){.count = candidate->signal_count, .is_each = run->signal_count == candidate->signal_count};
    tl_status status = tl_json_compare(&before, &after, see, &self, error);
    for (size_t i = 0; i < same->count; i++) {
        same->of[i] = status == TL_OK ? find_same(&self, run, i) : TL_NO_SUCH_SIGNAL;
        same->unseen += same->of[i] == TL_NO_SUCH_SIGNAL ? 1 : 0;
        same->is_each = same->is_each && same->of[i] == i && repeats_alike(run, candidate, i);
    }
    return status;
}

bool tl_same_signals_lack_input(const tl_same_signals *same, const tl_config *candidate) {
    for (size_t i = 0; i < same->count; i++) {
        if (same->of[i] == TL_NO_SUCH_SIGNAL && tl_config_feeds(candidate, &candidate->signals[i])) {
            return true;
        }
    }
    return false;
}

void tl_same_signals_sample(const tl_same_signals *same, const tl_sample *of_run, tl_sample *sample) {
    *sample = (tl_sample){.tick = of_run->tick, .instant = of_run->instant};
    for (size_t i = 0; i < same->count; i++) {
        size_t of = same->of[i];
        bool is_seen = of < TL_MAX_SIGNALS;
        sample->values[i] = is_seen ? of_run->values[of] : 0.0;
        sample->stamps[i] = is_seen ? of_run->stamps[of] : TL_TIME_NEVER;
        sample->quality[i] = is_seen ? of_run->quality[of] : (uint8_t)TL_NO_LINK;
    }
}
