/* Noise of measured signals: see noise.h. */
#include "firmware/monitor/noise.h"

#include <math.h>
#include <string.h>

/* ---- noise estimate ---- */

enum { AN_OCTAVE = 4, LOWEST = -64, REFRESH = 32, QUANTILES = 3 };

/* Quantiles of |x| for a standard normal x. */
static const struct { double share, size; } QUANTILE[QUANTILES] = {{0.5, 0.674490}, {0.6, 0.841621}, {0.7, 1.036433}};

/* Largest interval between two readings, so that the span of a window fits into tl_time. */
static const tl_time FARTHEST = INT64_MAX / TL_NOISE_WINDOW;

static const double ACCURACY = 0.85;
static const double ALIKE = 0.15; /* two orders differ by less with very many readings, */
static const double CHANCE = 2.0; /* plus this over √count, for chance */
static const double TOLERANCES = 3.0;

void tl_noise_meter_init(tl_noise_meter *meter, uint32_t most) {
    memset(meter, 0, sizeof *meter);
    meter->most = most;
}

/* ---- histogram ---- */

static void forget_half(tl_noise_sizes *sizes) {
    sizes->none /= 2;
    sizes->count = sizes->none;
    for (int i = 0; i < TL_NOISE_BINS; i++) {
        sizes->bins[i] /= 2;
        sizes->count += sizes->bins[i];
    }
}

static void add_size(tl_noise_sizes *sizes, double size, uint32_t most) {
    if (!isfinite(size)) {
        return;
    }
    double place = size > 0.0 ? (log2(size) - LOWEST) * AN_OCTAVE : -1.0;
    if (place < 0.0) {
        sizes->none++;
    } else {
        sizes->bins[place < TL_NOISE_BINS - 1 ? (int)place : TL_NOISE_BINS - 1]++;
    }
    sizes->count++;
    if (most != 0 && sizes->count >= most) {
        forget_half(sizes);
    }
}

/* Interpolates within a bin on the logarithmic scale; a bin is about a fifth wide. */
static double quantile_of(const tl_noise_sizes *sizes, double share) {
    double rank = share * sizes->count;
    double before = sizes->none;
    if (rank <= before) {
        return 0.0;
    }
    for (int i = 0; i < TL_NOISE_BINS; i++) {
        if (before + sizes->bins[i] >= rank) {
            return exp2((i + (rank - before) / sizes->bins[i]) / AN_OCTAVE + LOWEST);
        }
        before += sizes->bins[i];
    }
    return 0.0;
}

static double deviation_of(const tl_noise_sizes *sizes) {
    double sum = 0.0;
    for (int i = 0; i < QUANTILES; i++) {
        sum += quantile_of(sizes, QUANTILE[i].share) / QUANTILE[i].size;
    }
    return sum / QUANTILES;
}

/* ---- differences ---- */

/* Difference of the middle reading from the polynomial through `half` readings on each side,
 * divided by the factor for white noise. */
static double distance_of(const tl_noise_point *middle, int half) {
    double sum = 0.0;
    double squares = 1.0;
    for (int j = -half; j <= half; j++) {
        double weight = j != 0 ? 1.0 : 0.0;
        for (int k = -half; k <= half && j != 0; k++) {
            if (k != j && k != 0) {
                weight *= (double)(middle->stamp - middle[k].stamp) / (double)(middle[j].stamp - middle[k].stamp);
            }
        }
        sum += weight * (middle[j].value - middle->value);
        squares += weight * weight;
    }
    return fabs(sum) / sqrt(squares);
}

static void push_point(tl_noise_point *points, uint32_t *count, uint32_t room, const tl_noise_point *point) {
    if (*count == room) {
        memmove(points, points + 1, (room - 1) * sizeof *points);
        (*count)--;
    }
    points[(*count)++] = *point;
}

static void keep_point(tl_noise_meter *meter, const tl_noise_point *point) {
    push_point(meter->window, &meter->window_count, TL_NOISE_WINDOW, point);
    if (meter->window_count < TL_NOISE_WINDOW) {
        return;
    }
    for (int i = 0; i < TL_NOISE_ORDERS; i++) {
        add_size(&meter->sizes[i], distance_of(&meter->window[TL_NOISE_WINDOW / 2], i + 1), meter->most);
    }
    if (!meter->is_known && meter->sizes[0].count >= TL_NOISE_LEAST / 2 && meter->sizes[0].count % REFRESH == 0) {
        meter->scale = deviation_of(&meter->sizes[0]);
    }
}

/* ---- outliers ---- */

static double median_of(const double *values) {
    double sorted[TL_NOISE_AROUND] = {0};
    for (int i = 0; i < TL_NOISE_AROUND; i++) {
        int place = i;
        for (; place > 0 && sorted[place - 1] > values[i]; place--) {
            sorted[place] = sorted[place - 1];
        }
        sorted[place] = values[i];
    }
    return sorted[TL_NOISE_AROUND / 2];
}

static bool is_outlier_among(const tl_noise_meter *meter) {
    double values[TL_NOISE_AROUND];
    for (int i = 0; i < TL_NOISE_AROUND; i++) {
        values[i] = meter->around[i].value;
    }
    double median = median_of(values);
    for (int i = 0; i < TL_NOISE_AROUND; i++) {
        values[i] = fabs(values[i] - median);
    }
    double off = values[TL_NOISE_AROUND / 2];
    return meter->scale > 0.0 && off > TL_NOISE_OUTLIER * meter->scale && off > TL_NOISE_OUTLIER * median_of(values);
}

void tl_noise_meter_use(tl_noise_meter *meter, const tl_noise_found *found) {
    meter->is_known = true;
    meter->scale = found->by_order[0];
}

bool tl_noise_meter_put(tl_noise_meter *meter, tl_time stamp, double value, bool *is_outlier) {
    const tl_noise_point point = {.stamp = stamp, .value = value};
    const tl_noise_point *last = &meter->around[meter->around_count == 0 ? 0 : meter->around_count - 1];
    *is_outlier = false;
    bool is_next = meter->around_count == 0 ||
                   (stamp > last->stamp && (uint64_t)stamp - (uint64_t)last->stamp <= (uint64_t)FARTHEST);
    if (!isfinite(value) || !is_next) {
        return false;
    }
    meter->readings++;
    meter->repeats += meter->around_count > 0 && !(value < last->value) && !(value > last->value) ? 1 : 0;
    push_point(meter->around, &meter->around_count, TL_NOISE_AROUND, &point);
    if (meter->around_count < TL_NOISE_AROUND) {
        return false;
    }
    *is_outlier = is_outlier_among(meter);
    if (*is_outlier) {
        meter->outliers++;
    } else {
        keep_point(meter, &meter->around[TL_NOISE_AROUND / 2]);
    }
    return true;
}

/* ---- results ---- */

void tl_noise_meter_estimate(const tl_noise_meter *meter, tl_noise_found *found) {
    for (int i = 0; i < TL_NOISE_ORDERS; i++) {
        found->by_order[i] = deviation_of(&meter->sizes[i]);
    }
    found->count = meter->sizes[TL_NOISE_ORDERS - 1].count;
    found->sigma = fmin(found->by_order[0], fmax(found->by_order[1], found->by_order[2]));
    found->is_enough = found->count >= TL_NOISE_LEAST;
    double most = ALIKE + (found->count > 0 ? CHANCE / sqrt((double)found->count) : 0.0);
    found->is_too_fast = fabs(found->by_order[1] - found->by_order[2]) > most * found->by_order[1];
}

bool tl_noise_exceeds(const tl_noise_found *found, double tolerance) {
    bool is_reported = found->is_enough && !found->is_too_fast;
    return is_reported && tolerance < TOLERANCES * ACCURACY * found->sigma;
}

/* ---- noise watch ---- */

static const double REPEATED =
    1.0 / 3.0; /* above this share of repeated values, the signal is polled too often for an estimate */

size_t tl_noise_watch_readings(const tl_config *config, size_t match) {
    if (!config->synchronise || !(config->match[match].weight > 0.0) || config->event.start.signal != NULL) {
        return SIZE_MAX;
    }
    const char *name = tl_config_reading_of(config, match);
    size_t signal = tl_config_signal_of(config, name != NULL ? name : config->matched_as[match]);
    return signal != SIZE_MAX && config->signals[signal].plan.type == TL_REAL ? signal : SIZE_MAX;
}

void tl_noise_watch_init(tl_noise_watch *watch, const tl_config *config) {
    watch->config = config;
    for (size_t i = 0; i < TL_MAX_MATCH; i++) {
        watch->signal[i] = i < config->match_count ? tl_noise_watch_readings(config, i) : SIZE_MAX;
        watch->newest[i] = TL_TIME_NEVER;
        watch->is_reported[i] = false;
        tl_noise_meter_init(&watch->meters[i], TL_NOISE_WATCH_MOST);
    }
}

static tl_noise_turn assess_noise(tl_noise_watch *watch, size_t match, double *sigma) {
    const tl_noise_meter *meter = &watch->meters[match];
    double tolerance = watch->config->match[match].tolerance;
    tl_noise_found found;
    tl_noise_meter_estimate(meter, &found);
    *sigma = found.sigma;
    bool is_polled = (double)meter->repeats > REPEATED * (double)meter->readings;
    if (!watch->is_reported[match] && !is_polled && tl_noise_exceeds(&found, tolerance)) {
        watch->is_reported[match] = true;
        return TL_NOISE_IS_LARGE;
    }
    if (watch->is_reported[match] && tolerance >= TOLERANCES * found.sigma) {
        watch->is_reported[match] = false;
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
    bool is_checked =
        tl_noise_meter_put(&watch->meters[match], sample->stamps[signal], sample->values[signal], &is_outlier);
    return is_checked && watch->meters[match].readings % TL_NOISE_WATCH_EACH == 0 ? assess_noise(watch, match, sigma)
                                                                                  : TL_NOISE_AS_BEFORE;
}
