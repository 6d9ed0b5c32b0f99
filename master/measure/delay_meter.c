/* Delay meter: see delay_meter.h. */
#include "master/measure/delay_meter.h"

#include <math.h>

#define SURE 0.7
#define LOST 0.4
#define STILL 0.02      /* of y's standard deviation: a smaller range counts as constant */
#define SPREAD 1.0      /* standard deviation of the lag, in steps, that halves the confidence */
#define INDEPENDENT 4.0 /* steps that contain as much information as one with independent noise */
#define DISTINCT 0.02

/* Times in ns and instants stay below it, so that sums and differences of two cannot overflow. */
static const int64_t FAR = INT64_MAX / 4;

/* By instant, in a ring. */
typedef struct ring {
    double *values;
    bool *good;
    int64_t end; /* first instant that is not there yet */
} ring;

struct tl_delay_meter {
    tl_time step;
    int64_t lags; /* N */
    size_t mask;
    ring seen;      /* ŷ at t_j */
    ring simulated; /* y at t_j */
    int64_t next;   /* next instant of y to be counted */
    int64_t free;   /* steps in a row without a correction */
    bool has_last;
    tl_time last_stamp;
    double last_value;
    /* moments over the window, by lag + N */
    double weight;
    double mean_y, square_y;
    double mean[2 * TL_DELAY_LAGS + 1], square[2 * TL_DELAY_LAGS + 1], product[2 * TL_DELAY_LAGS + 1];
    double coefficient[2 * TL_DELAY_LAGS + 1];
    /* derived values */
    int64_t steady; /* steps in a row with a confident and similar result */
    tl_time about;  /* that result */
    tl_delay_measured measured;
};

static bool init_ring(ring *made, tl_arena *arena, size_t size, int64_t first) {
    made->values = tl_arena_take(arena, size, sizeof *made->values);
    made->good = tl_arena_take(arena, size, sizeof *made->good);
    made->end = first;
    return made->values != NULL && made->good != NULL;
}

tl_delay_meter *tl_delay_meter_create(tl_arena *arena, uint32_t lags, tl_time step, size_t late) {
    size_t size = 1;
    while (size < late + 4 * ((size_t)lags + 1)) {
        size *= 2;
    }
    tl_delay_meter *meter = tl_arena_take(arena, 1, sizeof *meter);
    if (meter == NULL || !init_ring(&meter->seen, arena, size, 0) || !init_ring(&meter->simulated, arena, size, 1)) {
        return NULL;
    }
    meter->step = step;
    meter->lags = lags;
    meter->mask = size - 1;
    meter->next = lags + 1;
    return meter;
}

static void add_value(const tl_delay_meter *meter, ring *into, double value, bool good) {
    size_t slot = (size_t)into->end & meter->mask;
    into->values[slot] = value;
    into->good[slot] = good;
    into->end++;
}

/* ---- ŷ ---- */

void tl_delay_meter_see(tl_delay_meter *meter, tl_time stamp, double value, bool good) {
    ring *seen = &meter->seen;
    if (meter->has_last && stamp <= meter->last_stamp) {
        return;
    }
    if (!good || !isfinite(value)) {
        meter->has_last = false;
        return;
    }
    bool joined = meter->has_last && stamp - meter->last_stamp <= meter->lags * meter->step;
    int64_t newest = stamp / meter->step - (stamp % meter->step < 0);
    int64_t oldest = newest - (int64_t)meter->mask;
    seen->end = seen->end > oldest ? seen->end : oldest; /* older values in the ring are too old for any y */
    while (seen->end <= newest) {
        tl_time at = seen->end * meter->step;
        bool between = joined && at > meter->last_stamp;
        double share = between ? (double)(at - meter->last_stamp) / (double)(stamp - meter->last_stamp) : 0.0;
        bool exact = at == stamp;
        add_value(meter, seen, exact ? value : meter->last_value + share * (value - meter->last_value),
                  between || exact);
    }
    meter->has_last = true;
    meter->last_stamp = stamp;
    meter->last_value = value;
}

/* ---- moments ---- */

/* Whether all data of instant j is there and counts, and y moves around it. */
static bool counts(const tl_delay_meter *meter, int64_t j) {
    const ring *y = &meter->simulated;
    double least = y->values[(size_t)j & meter->mask];
    double most = least;
    bool good = y->good[(size_t)j & meter->mask];
    for (int64_t i = j - meter->lags; i <= j + meter->lags; i++) {
        double value = y->values[(size_t)i & meter->mask];
        least = fmin(least, value);
        most = fmax(most, value);
        good = good && meter->seen.good[(size_t)i & meter->mask];
    }
    double deviation = meter->weight > 0.0 ? sqrt(meter->square_y / meter->weight) : 0.0;
    return good && most - least > STILL * deviation && most > least;
}

/* Decaying means, and sums of squares about them. A new value moves a mean by its share; the rest
 * of the difference goes into the squares. */
static void count(tl_delay_meter *meter, int64_t j) {
    const double fade = 1.0 - 1.0 / TL_DELAY_MEMORY;
    double before = fade * meter->weight;
    meter->weight = before + 1.0;
    double share = 1.0 / meter->weight;
    double off_y = meter->simulated.values[(size_t)j & meter->mask] - meter->mean_y;
    meter->mean_y += share * off_y;
    meter->square_y = fade * meter->square_y + before * share * off_y * off_y;
    for (int64_t lag = -meter->lags; lag <= meter->lags; lag++) {
        int64_t i = lag + meter->lags;
        double off = meter->seen.values[(size_t)(j - lag) & meter->mask] - meter->mean[i];
        meter->mean[i] += share * off;
        meter->square[i] = fade * meter->square[i] + before * share * off * off;
        meter->product[i] = fade * meter->product[i] + before * share * off * off_y;
        double size = meter->square_y * meter->square[i];
        meter->coefficient[i] = size > 0.0 ? meter->product[i] / sqrt(size) : 0.0;
    }
}

/* ---- the peak ---- */

static int64_t find_peak(const tl_delay_meter *meter) {
    int64_t best = 0;
    for (int64_t i = 1; i <= 2 * meter->lags; i++) {
        best = meter->coefficient[i] > meter->coefficient[best] ? i : best;
    }
    return best;
}

/* 1 if there is no other peak, 0 if one is as high. */
static double distinctness(const tl_delay_meter *meter, int64_t peak) {
    const double *c = meter->coefficient;
    double other = -1.0;
    for (int64_t i = 0; i <= 2 * meter->lags; i++) {
        bool rises = i == 0 || c[i] > c[i - 1];
        bool falls = i == 2 * meter->lags || c[i] >= c[i + 1];
        if (i != peak && rises && falls) {
            other = fmax(other, c[i]);
        }
    }
    double ahead = (c[peak] - other) / (1.0 - c[peak] + DISTINCT);
    return fmin(ahead, 1.0);
}

static double confidence(const tl_delay_meter *meter, int64_t peak) {
    const double *c = &meter->coefficient[peak];
    double sharpness = 2.0 * c[0] - c[-1] - c[1];
    if (!(c[0] > 0.0) || !(sharpness > 0.0)) {
        return 0.0;
    }
    double variance = INDEPENDENT * (1.0 - c[0] * c[0]) / (meter->weight * c[0] * sharpness);
    double steps = fmin(meter->weight / (double)(2 * meter->lags + 1), 1.0);
    return steps * c[0] * distinctness(meter, peak) / (1.0 + variance / (SPREAD * SPREAD));
}

static void check_peak(tl_delay_meter *meter) {
    int64_t peak = find_peak(meter);
    double part = 0.0;
    meter->measured.confidence = 0.0;
    if (peak > 0 && peak < 2 * meter->lags) {
        const double *c = &meter->coefficient[peak];
        double sharpness = 2.0 * c[0] - c[-1] - c[1];
        part = sharpness > 0.0 ? 0.5 * (c[1] - c[-1]) / sharpness : 0.0;
        meter->measured.confidence = confidence(meter, peak);
    }
    meter->measured.newest = (tl_time)llround(((double)(peak - meter->lags) + part) * (double)meter->step);
}

/* ---- the delay in use ---- */

static tl_time distance(tl_time a, tl_time b) {
    return a > b ? a - b : b - a;
}

static void decide_delay(tl_delay_meter *meter) {
    tl_delay_measured *measured = &meter->measured;
    bool sure = measured->confidence >= SURE;
    bool same = meter->steady > 0 && distance(measured->newest, meter->about) <= meter->step / 2;
    meter->about = same ? meter->about : measured->newest;
    meter->steady = !sure ? 0 : same ? meter->steady + 1 : 1;
    if (meter->steady > 2 * meter->lags) {
        bool moved = distance(measured->newest, measured->delay) > meter->step * 3 / 4;
        measured->delay = moved || !measured->known ? measured->newest : measured->delay;
        measured->known = true;
        measured->lost = false;
    }
    measured->lost = measured->lost || (measured->known && measured->confidence < LOST);
}

void tl_delay_meter_step(tl_delay_meter *meter, int64_t j, double y, bool free) {
    meter->free = free ? meter->free + 1 : 0;
    meter->simulated.end = j; /* j is the next one */
    add_value(meter, &meter->simulated, y, free && meter->free > meter->lags && isfinite(y));
    /* Counts up to two instants per step, to catch up if ŷ was late. Skips instants whose data has
     * left the rings. */
    int64_t oldest = meter->simulated.end - (int64_t)meter->mask + meter->lags;
    meter->next = meter->next > oldest ? meter->next : oldest;
    oldest = meter->seen.end - (int64_t)meter->mask + meter->lags;
    meter->next = meter->next > oldest ? meter->next : oldest;
    for (int turn = 0; turn < 2; turn++) {
        int64_t needed = meter->next + meter->lags;
        if (needed >= meter->simulated.end || needed >= meter->seen.end) {
            return;
        }
        if (counts(meter, meter->next)) {
            count(meter, meter->next);
            check_peak(meter);
            decide_delay(meter);
        }
        meter->next++;
    }
}

tl_delay_measured tl_delay_meter_get(const tl_delay_meter *meter) {
    return meter->measured;
}

/* Limits each product by its squares, so that no coefficient exceeds 1. */
static bool are_moments(const tl_delay_meter *meter) {
    bool right = meter->weight >= 0.0 && meter->square_y >= 0.0;
    for (int64_t i = 0; i <= 2 * meter->lags; i++) {
        double most = 1.001 * sqrt(meter->square_y) * sqrt(meter->square[i]);
        right =
            right && meter->square[i] >= 0.0 && fabs(meter->product[i]) <= most && fabs(meter->coefficient[i]) <= 1.001;
    }
    return right;
}

static bool is_time(tl_time time) {
    return time >= -FAR && time <= FAR;
}

static bool is_instant(int64_t instant) {
    return instant >= 0 && instant <= FAR;
}

static void require_sound(const tl_delay_meter *meter, tl_archive *archive) {
    const double numbers[] = {meter->last_value, meter->weight, meter->mean_y, meter->square_y,
                              meter->measured.confidence};
    size_t lags = sizeof meter->mean / sizeof meter->mean[0];
    tl_archive_require_finite(archive, numbers, sizeof numbers / sizeof numbers[0]);
    tl_archive_require_finite(archive, meter->mean, lags);
    tl_archive_require_finite(archive, meter->square, lags);
    tl_archive_require_finite(archive, meter->product, lags);
    tl_archive_require_finite(archive, meter->coefficient, lags);
    tl_archive_require_finite(archive, meter->seen.values, meter->mask + 1);
    tl_archive_require_finite(archive, meter->simulated.values, meter->mask + 1);
    tl_archive_require(archive, are_moments(meter) && is_instant(meter->seen.end) && is_instant(meter->simulated.end) &&
                                    is_instant(meter->next) && is_instant(meter->free) && is_instant(meter->steady));
    tl_archive_require(archive, is_time(meter->last_stamp) && is_time(meter->about) &&
                                    is_time(meter->measured.newest) && is_time(meter->measured.delay));
}

static void archive_ring(const tl_delay_meter *meter, ring *own, tl_archive *archive) {
    tl_archive_part(archive, &own->end, sizeof own->end);
    tl_archive_part(archive, own->values, (meter->mask + 1) * sizeof *own->values);
    for (size_t i = 0; i <= meter->mask; i++) {
        tl_archive_flag(archive, &own->good[i]);
    }
}

static void archive_moments(tl_delay_meter *meter, tl_archive *archive) {
    tl_archive_part(archive, &meter->weight, sizeof meter->weight);
    tl_archive_part(archive, &meter->mean_y, sizeof meter->mean_y);
    tl_archive_part(archive, &meter->square_y, sizeof meter->square_y);
    tl_archive_part(archive, meter->mean, sizeof meter->mean);
    tl_archive_part(archive, meter->square, sizeof meter->square);
    tl_archive_part(archive, meter->product, sizeof meter->product);
    tl_archive_part(archive, meter->coefficient, sizeof meter->coefficient);
}

/* Archives member by member: settings and pointers are left out. */
void tl_delay_meter_archive(tl_delay_meter *meter, tl_archive *archive) {
    tl_delay_measured *measured = &meter->measured;
    archive_ring(meter, &meter->seen, archive);
    archive_ring(meter, &meter->simulated, archive);
    tl_archive_part(archive, &meter->next, sizeof meter->next);
    tl_archive_part(archive, &meter->free, sizeof meter->free);
    tl_archive_flag(archive, &meter->has_last);
    tl_archive_part(archive, &meter->last_stamp, sizeof meter->last_stamp);
    tl_archive_part(archive, &meter->last_value, sizeof meter->last_value);
    archive_moments(meter, archive);
    tl_archive_part(archive, &meter->steady, sizeof meter->steady);
    tl_archive_part(archive, &meter->about, sizeof meter->about);
    tl_archive_flag(archive, &measured->known);
    tl_archive_flag(archive, &measured->lost);
    tl_archive_part(archive, &measured->delay, sizeof measured->delay);
    tl_archive_part(archive, &measured->newest, sizeof measured->newest);
    tl_archive_part(archive, &measured->confidence, sizeof measured->confidence);
    if (tl_archive_is_loading(archive) && tl_archive_is_whole(archive)) {
        require_sound(meter, archive);
    }
}
