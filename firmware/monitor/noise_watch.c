/* The noise of what is matched, while it is matched: see noise_watch.h. */
#include "firmware/monitor/noise_watch.h"

#include <stdint.h>
#include <string.h>

static const double TOLERANCES = 3.0;
static const double REPEATED = 1.0 / 3.0; /* more: they are polls of one value, and tell nothing */

/* Of "plant.NAME"; SIZE_MAX: there is none. */
static size_t find(const tl_config *config, const char *reference) {
    size_t found = SIZE_MAX;
    for (size_t i = 0; i < config->signal_count; i++) {
        bool is_it = strncmp(reference, "plant.", 6) == 0 && strcmp(reference + 6, config->signals[i].plan.name) == 0;
        found = is_it ? i : found;
    }
    return found;
}

static size_t readings_of(const tl_config *config, size_t match) {
    if (!config->synchronise || !(config->match[match].weight > 0.0) || config->event.start.signal != NULL) {
        return SIZE_MAX;
    }
    const char *name = tl_config_reading_of(config, match);
    size_t signal = find(config, name != NULL ? name : config->matched_as[match]);
    return signal != SIZE_MAX && config->signals[signal].plan.type == TL_REAL ? signal : SIZE_MAX;
}

void tl_noise_watch_init(tl_noise_watch *watch, const tl_config *config) {
    watch->config = config;
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        watch->signal[i] = i < config->match_count ? readings_of(config, i) : SIZE_MAX;
        watch->newest[i] = TL_TIME_NEVER;
        watch->is_told[i] = false;
        tl_noise_meter_init(&watch->meters[i], TL_NOISE_WATCH_MOST);
    }
}

static tl_noise_turn judge(tl_noise_watch *watch, size_t match, double *sigma) {
    const tl_noise_meter *meter = &watch->meters[match];
    double tolerance = watch->config->match[match].tolerance;
    tl_noise_found found;
    tl_noise_meter_tell(meter, &found);
    *sigma = found.sigma;
    bool is_polled = (double)meter->repeats > REPEATED * (double)meter->readings;
    if (!watch->is_told[match] && !is_polled && tl_noise_exceeds(&found, tolerance)) {
        watch->is_told[match] = true;
        return TL_NOISE_IS_LARGE;
    }
    if (watch->is_told[match] && tolerance >= TOLERANCES * found.sigma) {
        watch->is_told[match] = false;
        return TL_NOISE_IS_SMALL;
    }
    return TL_NOISE_AS_BEFORE;
}

tl_noise_turn tl_noise_watch_sample(tl_noise_watch *watch, const tl_sample *sample, size_t match, double *sigma) {
    size_t signal = watch->signal[match];
    bool is_outlier = false;
    if (signal == SIZE_MAX || sample->stamps[signal] == watch->newest[match] || sample->quality[signal] != TL_GOOD) {
        return TL_NOISE_AS_BEFORE;
    }
    watch->newest[match] = sample->stamps[signal];
    bool is_judged =
        tl_noise_meter_put(&watch->meters[match], sample->stamps[signal], sample->values[signal], &is_outlier);
    return is_judged && watch->meters[match].readings % TL_NOISE_WATCH_EACH == 0 ? judge(watch, match, sigma)
                                                                                 : TL_NOISE_AS_BEFORE;
}
