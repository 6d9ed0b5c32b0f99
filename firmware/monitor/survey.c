/* Survey: measures the signals of a recording: see survey.h. */
#include "firmware/monitor/survey.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/plant/conditioner.h"
#include "firmware/process/interrupt.h"

/* ---- error of a low-pass ---- */

static tl_reading reading_of(const tl_noise_point *point) {
    return (tl_reading){.value = point->value, .stamp = point->stamp, .quality = TL_GOOD};
}

/* Value of a low-pass at `at`, from its value `smooth` at the reading `from`; the next reading `to`
 * is not before `at`. */
static double smooth_to(tl_time low_pass, const tl_reading *from, double smooth, const tl_reading *to, tl_time at) {
    const tl_conditioned before = {.reading = *from, .smooth = smooth};
    return at > from->stamp ? tl_conditioner_between(low_pass, &before, to, at) : smooth;
}

/* Weight of a reading in the result for its own instant: the response to a line that is 1 at it and
 * 0 at its neighbours. */
static double weight_of(const tl_noise_point *point, tl_time low_pass) {
    const tl_reading before = {.value = 0.0, .stamp = point[-1].stamp};
    const tl_reading own = {.value = 1.0, .stamp = point[0].stamp};
    const tl_reading after = {.value = 0.0, .stamp = point[1].stamp};
    tl_time at = own.stamp + low_pass;
    double smooth = smooth_to(low_pass, &before, 0.0, &own, own.stamp);
    if (at <= after.stamp) {
        return smooth_to(low_pass, &own, smooth, &after, at);
    }
    smooth = smooth_to(low_pass, &own, smooth, &after, after.stamp);
    return smooth * exp(-(double)(at - after.stamp) / (double)low_pass);
}

double tl_smoothing_error(const tl_noise_point *points, size_t count, double sigma, tl_time low_pass) {
    double square = sigma * sigma;
    double differences = 0.0;
    double weights = 0.0;
    size_t terms = 0;
    double smooth = count > 0 ? points[0].value : 0.0; /* at reading `next` − 1 */
    size_t next = 1;
    for (size_t i = 1; i + 1 < count; i++) {
        tl_time at = points[i].stamp + low_pass;
        for (; next < count && points[next].stamp <= at; next++) {
            const tl_reading from = reading_of(&points[next - 1]);
            const tl_reading to = reading_of(&points[next]);
            smooth = smooth_to(low_pass, &from, smooth, &to, to.stamp);
        }
        if (next == count) {
            break;
        }
        const tl_reading from = reading_of(&points[next - 1]);
        const tl_reading to = reading_of(&points[next]);
        double difference = points[i].value - smooth_to(low_pass, &from, smooth, &to, at);
        differences += difference * difference;
        weights += weight_of(&points[i], low_pass);
        terms++;
    }
    double error = terms > 0 ? (differences + 2.0 * square * weights) / (double)terms - square : square;
    return fmax(error, 0.0);
}

/* ---- survey ---- */

static const double POLLED = 1.0 / 3.0;       /* share of repeated readings */
static const double WHOLE = 0.05;             /* largest deviation from a multiple, */
static const double MOST_STEPS = 1e6;         /* up to this many multiples, */
static const double NEARLY_ALL = 0.99;        /* for this share of the differences */
static const double COUNTED_NOISE = 0.288675; /* of a value rounded to multiples of 1: 1/√12 */
static const double A_FEW_STEPS = 4.0;
static const double AT_REST = 1.2; /* standard deviation over noise, for a signal that does not move */

/* Receives the readings of a recording. */
typedef struct survey_reader {
    const tl_config *config;
    tl_survey *survey;
    tl_time first, last;
    bool any, is_short_of_memory;
} survey_reader;

static bool is_good(const tl_config_signal *signal, const tl_reading *reading) {
    return reading->quality == TL_GOOD && isfinite(reading->value) && reading->value >= signal->minimum &&
           reading->value <= signal->maximum;
}

static void add_reading(void *context, size_t signal, const tl_reading *reading) {
    survey_reader *self = context;
    tl_survey_signal *added = &self->survey->signals[signal];
    if (!is_good(&self->config->signals[signal], reading)) {
        added->bad++;
        return;
    }
    if (added->kept_count == TL_SURVEY_MOST) {
        added->is_cut = true;
        return;
    }
    bool is_later = added->kept_count == 0 || reading->stamp > added->kept[added->kept_count - 1].stamp;
    tl_noise_point *kept = is_later ? tl_array_grown(added->kept, added->kept_count, sizeof *kept) : NULL;
    self->is_short_of_memory = self->is_short_of_memory || (is_later && kept == NULL);
    if (kept != NULL) {
        added->kept = kept;
        kept[added->kept_count++] = (tl_noise_point){.stamp = reading->stamp, .value = reading->value};
        self->first = self->any && self->first < reading->stamp ? self->first : reading->stamp;
        self->last = self->any && self->last > reading->stamp ? self->last : reading->stamp;
        self->any = true;
    }
}

/* ---- message intervals ---- */

static int compare_doubles(const void *one, const void *other) {
    const double a = *(const double *)one;
    const double b = *(const double *)other;
    return a < b ? -1 : a > b ? 1 : 0;
}

/* Quantile of sorted values. */
static double share_of(const double *sorted, size_t count, double share) {
    size_t place = (size_t)(share * (double)count);
    return sorted[place < count ? place : count - 1];
}

static void measure_times(tl_survey_signal *signal, double *room) {
    size_t count = signal->kept_count < 2 ? 0 : signal->kept_count - 1;
    for (size_t i = 0; i < count; i++) {
        room[i] = tl_seconds(signal->kept[i + 1].stamp - signal->kept[i].stamp);
    }
    if (count > 0) {
        qsort(room, count, sizeof *room, compare_doubles);
        signal->median = tl_time_of_seconds(share_of(room, count, 0.5));
        signal->most = tl_time_of_seconds(share_of(room, count, 0.95));
        signal->rare = tl_time_of_seconds(share_of(room, count, 0.99));
        signal->worst = tl_time_of_seconds(room[count - 1]);
    }
}

/* ---- values ---- */

/* Returns the smallest difference of two values if all differences are multiples of it; else 0. */
static double find_quantum(const double *sorted, size_t count, size_t *values) {
    double least = 0.0;
    size_t multiples = 0;
    *values = count > 0 ? 1 : 0;
    for (size_t i = 1; i < count; i++) {
        double apart = sorted[i] - sorted[i - 1];
        *values += apart > 0.0 ? 1 : 0;
        least = apart > 0.0 && (least <= 0.0 || apart < least) ? apart : least;
    }
    for (size_t i = 1; i < count && least > 0.0; i++) {
        double times = (sorted[i] - sorted[i - 1]) / least;
        multiples += times < MOST_STEPS && fabs(times - nearbyint(times)) <= WHOLE ? 1 : 0;
    }
    bool are_whole = (double)multiples >= NEARLY_ALL * (double)(count > 0 ? count - 1 : 0);
    return least > 0.0 && isfinite(least) && are_whole ? least : 0.0;
}

static bool is_repeat(const tl_noise_point *one, const tl_noise_point *before) {
    return !(one->value < before->value) && !(one->value > before->value);
}

/* Keeps only the readings that change the value. */
static void drop_repeats(tl_survey_signal *signal) {
    size_t kept = signal->kept_count > 0 ? 1 : 0;
    for (size_t i = 1; i < signal->kept_count; i++) {
        if (!is_repeat(&signal->kept[i], &signal->kept[kept - 1])) {
            signal->kept[kept++] = signal->kept[i];
        }
    }
    signal->kept_count = kept;
}

/* Returns the median of all changes; 0 if there are none. */
static double usual_change(const tl_survey_signal *signal, double *room) {
    size_t count = 0;
    for (size_t i = 1; i < signal->kept_count; i++) {
        double change = fabs(signal->kept[i].value - signal->kept[i - 1].value);
        if (change > 0.0) {
            room[count++] = change;
        }
    }
    qsort(room, count, sizeof *room, compare_doubles);
    return count > 0 ? share_of(room, count, 0.5) : 0.0;
}

/* A value with a coarse quantum repeats too, without being polled too often. */
static void measure_values(tl_survey_signal *signal, double *room) {
    size_t values = 0;
    for (size_t i = 0; i < signal->kept_count; i++) {
        room[i] = signal->kept[i].value;
    }
    qsort(room, signal->kept_count, sizeof *room, compare_doubles);
    signal->quantum = find_quantum(room, signal->kept_count, &values);
    signal->is_switched = values <= TL_SURVEY_SWITCH;
    for (size_t i = 1; i < signal->kept_count; i++) {
        signal->repeats += is_repeat(&signal->kept[i], &signal->kept[i - 1]) ? 1 : 0;
    }
    bool often = (double)signal->repeats >= POLLED * (double)signal->kept_count;
    bool is_coarse = signal->quantum > 0.0 && usual_change(signal, room) < A_FEW_STEPS * signal->quantum;
    signal->is_polled = often && !is_coarse && !signal->is_switched;
    if (signal->is_polled) {
        drop_repeats(signal);
    }
}

/* ---- noise ---- */

/* Second pass: removes the outliers and puts their distances into `room`. */
static void drop_outliers(tl_survey_signal *signal, tl_noise_meter *meter, double *room) {
    enum { BEHIND = TL_NOISE_AROUND / 2 };
    size_t count = signal->kept_count;
    size_t kept = 0;
    for (size_t i = 0; i < count + BEHIND; i++) {
        bool is_outlier = false;
        if (i < count) {
            (void)tl_noise_meter_put(meter, signal->kept[i].stamp, signal->kept[i].value, &is_outlier);
        }
        if (i < BEHIND) {
            continue;
        }
        const tl_noise_point checked = signal->kept[i - BEHIND];
        if (is_outlier) {
            room[signal->outliers++] = kept > 0 ? fabs(checked.value - signal->kept[kept - 1].value) : 0.0;
        } else {
            signal->kept[kept++] = checked;
        }
    }
    signal->kept_count = kept;
    if (signal->outliers > 0) {
        qsort(room, (size_t)signal->outliers, sizeof *room, compare_doubles);
        signal->nearest = share_of(room, (size_t)signal->outliers, 0.1);
    }
}

static void measure_moves(tl_survey_signal *signal) {
    double sum = 0.0;
    for (size_t i = 1; i < signal->kept_count; i++) {
        double move = fabs(signal->kept[i].value - signal->kept[i - 1].value);
        sum += move * move;
        signal->jump = fmax(signal->jump, move);
    }
    double mean = signal->kept_count > 1 ? sum / (double)(signal->kept_count - 1) : 0.0;
    signal->move = sqrt(fmax(0.0, mean - 2.0 * signal->sigma * signal->sigma));
}

/* Relative to the first value, because values may be large. */
static bool is_at_rest(const tl_survey_signal *signal) {
    double sum = 0.0;
    double squares = 0.0;
    double count = (double)signal->kept_count;
    for (size_t i = 0; i < signal->kept_count; i++) {
        double off = signal->kept[i].value - signal->kept[0].value;
        sum += off;
        squares += off * off;
    }
    double variance = count > 0.0 ? squares / count - sum / count * (sum / count) : 0.0;
    return variance <= AT_REST * AT_REST * signal->sigma * signal->sigma;
}

static void measure_noise(tl_survey_signal *signal, tl_noise_meter *meter, double *room) {
    tl_noise_found first;
    bool is_outlier = false;
    tl_noise_meter_init(meter, 0);
    for (size_t i = 0; i < signal->kept_count; i++) {
        (void)tl_noise_meter_put(meter, signal->kept[i].stamp, signal->kept[i].value, &is_outlier);
    }
    tl_noise_meter_estimate(meter, &first);
    tl_noise_meter_init(meter, 0);
    tl_noise_meter_use(meter, &first);
    drop_outliers(signal, meter, room);
    tl_noise_meter_estimate(meter, &signal->noise);
    signal->sigma = fmax(signal->noise.sigma, COUNTED_NOISE * signal->quantum);
    measure_moves(signal);
    signal->is_at_rest = is_at_rest(signal);
}

/* ---- survey of all signals ---- */

static tl_status read_all(tl_recording *recording, survey_reader *self, tl_error *error) {
    tl_recording_tick tick;
    bool end = false;
    tl_status status = TL_OK;
    tl_recording_listen(recording, add_reading, self);
    while (status == TL_OK && !end && !self->is_short_of_memory) {
        status = tl_interrupt_requested() != NULL ? tl_fail(error, TL_INTERRUPTED, "interrupted")
                                                  : tl_recording_next(recording, &tick, &end, error);
    }
    return status;
}

static size_t most_readings(const tl_survey *survey) {
    size_t most = 1;
    for (size_t i = 0; i < survey->count; i++) {
        most = survey->signals[i].kept_count > most ? survey->signals[i].kept_count : most;
    }
    return most;
}

tl_status tl_survey_take(tl_recording *recording, const tl_config *config, tl_survey *survey, tl_error *error) {
    survey_reader self = {.config = config, .survey = survey};
    survey->count = config->own_count;
    tl_status status = read_all(recording, &self, error);
    if (status != TL_OK) {
        return status;
    }
    double *room = calloc(most_readings(survey), sizeof *room);
    tl_noise_meter *meter = calloc(1, sizeof *meter);
    if (self.is_short_of_memory || room == NULL || meter == NULL) {
        status = tl_fail(error, TL_TRY_AGAIN, "not enough memory for the recording's readings");
    }
    for (size_t i = 0; status == TL_OK && i < survey->count; i++) {
        tl_survey_signal *signal = &survey->signals[i];
        signal->good = signal->kept_count;
        measure_times(signal, room);
        measure_values(signal, room);
        measure_noise(signal, meter, room);
    }
    survey->length = self.any ? self.last - self.first : 0;
    free(meter);
    free(room);
    return status;
}

void tl_survey_free(tl_survey *survey) {
    for (size_t i = 0; i < TL_MAX_SIGNALS; i++) {
        free(survey->signals[i].kept);
        survey->signals[i].kept = NULL;
        survey->signals[i].kept_count = 0;
    }
}
