/* Change detection in one series: see change_series.h. */
#include "firmware/monitor/change_series.h"

#include <math.h>
#include <string.h>

static const double GAUSS = 1.4826; /* deviation of a normal distribution, in median absolute deviations */
static const double MOST = 5.0;     /* innovations are clipped here, deviations */
static const double FAR_OUT = 6.0;  /* distances from the median are clipped here in a fit, scales */
static const double ALLOWANCE = 0.5;
static const double MARGIN = 1.5;         /* threshold, in largest sums while learning */
static const double LEAST_THRESHOLD = 10; /* deviations: three blocks at least */
static const double PEAK_WIDTH = 0.25;    /* of a bin of peaks, deviations; it doubles if needed */
static const double TAIL = 0.05;          /* share of the peaks that count as tail */
enum {
    LEAST_TAIL = 20,   /* peaks */
    LONGEST = 4,       /* learning ends after this many times `learn` */
    LEAST_LEARN = 256, /* blocks */
    ROUNDS = 3,        /* two fits and a test */
    LASTING = 16,      /* blocks of a lasting level */
    BEFORE = 32        /* least number of blocks before the sum was zero, for the split */
};

/* Least part of a step that an autoregressive model passes on, so that a fit near an integrator
 * does not give an endless spread. */
static const double LEAST_GAIN = 0.05;

/* Levels beyond the learnt range are normal up to this part of its width. */
static const double BEYOND = 0.5;

/* One estimate explains two changes if its error is at most this many times larger. */
static const double ALIKE = 2.0;

/* A reference below this part of a size gives no share. */
static const double ABOUT_ZERO = 0.01;

/* Larger values count as not known: their squares could overflow. */
static const double UNKNOWN = 1e100;

/* Smaller widths of stored histograms are no data of ours: a part of them would be 0. */
static const double LEAST_WIDTH = 1e-200;

/* Keeps the model stable if it is fitted to few blocks. */
static const double LARGEST_REFLECTION = 0.98;

/* Longest reach of an onset's spread, blocks. */
static const double MOST_SPREAD = 100.0;

/* ---- histogram ---- */

static void begin_histogram(tl_series_histogram *histogram, double least, double width) {
    *histogram = (tl_series_histogram){.least = least, .width = width};
}

/* Doubles the width; the old range becomes the lower or the upper half. */
static void widen(tl_series_histogram *histogram, bool downward) {
    uint64_t merged[TL_SERIES_BINS] = {0};
    size_t offset = downward ? TL_SERIES_BINS / 2 : 0;
    for (size_t i = 0; i < TL_SERIES_BINS; i++) {
        merged[offset + i / 2] += histogram->count[i];
    }
    memcpy(histogram->count, merged, sizeof merged);
    histogram->least -= downward ? TL_SERIES_BINS * histogram->width : 0.0;
    histogram->width *= 2.0;
}

static void add_to_histogram(tl_series_histogram *histogram, double value) {
    while (value < histogram->least) {
        widen(histogram, true);
    }
    while (value >= histogram->least + TL_SERIES_BINS * histogram->width) {
        widen(histogram, false);
    }
    size_t bin = (size_t)((value - histogram->least) / histogram->width);
    histogram->count[bin < TL_SERIES_BINS ? bin : TL_SERIES_BINS - 1]++;
    histogram->total++;
}

static double quantile(const tl_series_histogram *histogram, double share) {
    double wanted = share * (double)histogram->total;
    double below = 0.0;
    for (size_t i = 0; i < TL_SERIES_BINS; i++) {
        double in = (double)histogram->count[i];
        if (below + in >= wanted && in > 0.0) {
            return histogram->least + histogram->width * ((double)i + (wanted - below) / in);
        }
        below += in;
    }
    return histogram->least + histogram->width * TL_SERIES_BINS;
}

/* Deviation by the median of the absolute distances from `centre`. */
static double find_scale(const tl_series_histogram *histogram, double centre) {
    tl_series_histogram distances;
    begin_histogram(&distances, 0.0, histogram->width / 2);
    for (size_t i = 0; i < TL_SERIES_BINS; i++) {
        double distance = fabs(histogram->least + histogram->width * ((double)i + 0.5) - centre);
        if (histogram->count[i] != 0) {
            add_to_histogram(&distances, distance);
            size_t bin = (size_t)((distance - distances.least) / distances.width);
            distances.count[bin < TL_SERIES_BINS ? bin : TL_SERIES_BINS - 1] += histogram->count[i] - 1;
            distances.total += histogram->count[i] - 1;
        }
    }
    return GAUSS * quantile(&distances, 0.5);
}

/* ---- fit ---- */

static double kept(const tl_change_series *series, uint64_t number) {
    return series->kept[number % TL_SERIES_KEPT];
}

/* Distance of a block from the learnt median and a change. */
static double distance_from(const tl_change_series *series, uint64_t number, const tl_series_change *change) {
    return kept(series, number) - series->fit.median - change->offset -
           change->gain * series->reference[number % TL_SERIES_KEPT];
}

static double residual(const tl_change_series *series, uint64_t number) {
    return distance_from(series, number, &series->change);
}

static double clipped(double value, double most) {
    return fmin(fmax(value, -most), most);
}

static void drop_peaks(tl_change_series *series) {
    begin_histogram(&series->peaks, 0.0, PEAK_WIDTH);
    series->tested = 0;
    series->largest = 0.0;
}

static void begin_interval(tl_change_series *series) {
    tl_series_fit *fit = &series->fit;
    fit->sum = 0.0;
    fit->pairs = 0;
    memset(fit->products, 0, sizeof fit->products);
    begin_histogram(&fit->innovations, 0.0, fit->deviation / 32);
    fit->renewed = fit->blocks;
    series->cumulative[0] = series->cumulative[1] = 0.0;
    series->peak[0] = series->peak[1] = 0.0;
    if (fit->blocks <= series->learn / 2) { /* the sums of a fit of fewer blocks say little */
        drop_peaks(series);
    }
}

/* The first fit: median and scale of few blocks. */
static void fit_first(tl_change_series *series) {
    tl_series_fit *fit = &series->fit;
    double least = HUGE_VAL;
    double most = -HUGE_VAL;
    for (uint64_t n = series->number - TL_SERIES_FIRST + 1; n <= series->number; n++) {
        least = fmin(least, kept(series, n));
        most = fmax(most, kept(series, n));
    }
    double width = fmax((most - least) / (TL_SERIES_BINS / 4.0), series->least / 4);
    begin_histogram(&fit->levels, (most + least) / 2 - width * (TL_SERIES_BINS / 2.0), width);
    for (uint64_t n = series->number - TL_SERIES_FIRST + 1; n <= series->number; n++) {
        add_to_histogram(&fit->levels, kept(series, n));
    }
    fit->median = quantile(&fit->levels, 0.5);
    fit->scale = fmax(find_scale(&fit->levels, fit->median), series->least);
    fit->deviation = fit->scale;
}

/* Solves for the model by Levinson's recursion. Returns the variance of its innovations. */
static double solve_model(const double *covariance, double *model) {
    double before[TL_SERIES_ORDER];
    double error = covariance[0];
    memset(model, 0, TL_SERIES_ORDER * sizeof *model);
    for (int m = 0; m < TL_SERIES_ORDER && error > 0.0; m++) {
        double sum = covariance[m + 1];
        for (int k = 0; k < m; k++) {
            sum -= model[k] * covariance[m - k];
        }
        double reflection = clipped(sum / error, LARGEST_REFLECTION);
        memcpy(before, model, sizeof before);
        for (int k = 0; k < m; k++) {
            model[k] = before[k] - reflection * before[m - 1 - k];
        }
        model[m] = reflection;
        error *= 1.0 - reflection * reflection;
    }
    return error;
}

/* Variance of the innovations of another model. */
static double variance_with(const double *covariance, const double *model) {
    double sum = covariance[0];
    for (int k = 0; k < TL_SERIES_ORDER; k++) {
        sum -= 2.0 * model[k] * covariance[k + 1];
        for (int m = 0; m < TL_SERIES_ORDER; m++) {
            sum += model[k] * model[m] * covariance[k > m ? k - m : m - k];
        }
    }
    return sum;
}

/* The deviation is that of the innovations so far, as the new model changes their variance. */
static void renew_fit(tl_change_series *series) {
    tl_series_fit *fit = &series->fit;
    double covariance[TL_SERIES_ORDER + 1];
    double model[TL_SERIES_ORDER];
    double mean = fit->sum / (double)fit->pairs;
    for (int k = 0; k <= TL_SERIES_ORDER; k++) {
        covariance[k] = fit->products[k] / (double)fit->pairs - mean * mean;
    }
    double ridge = series->least * series->least;
    covariance[0] += ridge + covariance[0] * TL_SERIES_ORDER / (double)fit->pairs;
    double variance = solve_model(covariance, model);
    double before = variance_with(covariance, fit->model);
    double change = sqrt(fmax(variance, 0.0) / fmax(before, ridge));
    fit->deviation = fmax(GAUSS * quantile(&fit->innovations, 0.5) * change, series->least);
    memcpy(fit->model, model, sizeof model);
    fit->median = quantile(&fit->levels, 0.5);
    fit->scale = fmax(find_scale(&fit->levels, fit->median), series->least);
}

/* Sum of the coefficients: the model passes on the rest of a step. */
static double gain_of(const tl_series_fit *fit) {
    double sum = 0.0;
    for (int k = 0; k < TL_SERIES_ORDER; k++) {
        sum += fit->model[k];
    }
    return fmax(1.0 - sum, LEAST_GAIN);
}

/* The sum that is exceeded `rate` times in a block. */
static double find_tail(const tl_change_series *series) {
    const tl_series_histogram *peaks = &series->peaks;
    if (peaks->total == 0) {
        return 0.0;
    }
    double in_tail = fmin(fmax(TAIL * (double)peaks->total, LEAST_TAIL), (double)peaks->total);
    double begins = quantile(peaks, 1.0 - in_tail / (double)peaks->total);
    double sum = 0.0;
    double count = 0.0;
    for (size_t i = 0; i < TL_SERIES_BINS; i++) {
        double value = peaks->least + peaks->width * ((double)i + 0.5);
        sum += value > begins ? (value - begins) * (double)peaks->count[i] : 0.0;
        count += value > begins ? (double)peaks->count[i] : 0.0;
    }
    double decay = count > 0.0 ? sum / count * (1.0 + 1.0 / sqrt(count)) : 0.0; /* one standard error more */
    return begins + decay * log(fmax(in_tail / ((double)series->tested * series->rate), 1.0));
}

static void set_threshold(tl_change_series *series) {
    series->threshold = fmax(fmax(MARGIN * series->largest, find_tail(series)), LEAST_THRESHOLD);
}

/* A fit is due whenever the number of blocks has doubled, also after `learn` of them. */
static bool is_due(const tl_change_series *series) {
    uint64_t due = LONGEST * series->learn;
    while (due > series->fit.blocks) {
        due /= 2;
    }
    return due == series->fit.blocks;
}

bool tl_change_series_is_ready(const tl_change_series *series) {
    return series->threshold > 0.0 && series->fit.blocks >= series->learn;
}

/* ---- test ---- */

/* NaN: not enough blocks since the last gap. */
static double find_innovation(const tl_change_series *series) {
    const tl_series_fit *fit = &series->fit;
    if (fit->renewed == 0 || series->number < series->first + TL_SERIES_ORDER) {
        return (double)NAN;
    }
    double innovation = residual(series, series->number);
    for (uint64_t k = 0; k < TL_SERIES_ORDER; k++) {
        innovation -= fit->model[k] * residual(series, series->number - 1 - k);
    }
    return innovation;
}

static void end_peak(tl_change_series *series, int side, bool learns) {
    if (series->peak[side] > 0.0 && learns) {
        add_to_histogram(&series->peaks, series->peak[side]);
    }
    series->peak[side] = 0.0;
    series->zero[side] = series->number;
}

/* Advances both sums. Returns the side that exceeds the threshold; −1: none. */
static int test_block(tl_change_series *series, double innovation, bool learns) {
    double z = clipped(innovation / series->fit.deviation, MOST);
    int found = -1;
    series->tested += learns ? 1 : 0;
    for (int side = 0; side < 2; side++) {
        double *sum = &series->cumulative[side];
        *sum = fmax(0.0, *sum + (side == 0 ? z : -z) - ALLOWANCE);
        series->peak[side] = fmax(series->peak[side], *sum);
        series->largest = learns ? fmax(series->largest, *sum) : series->largest;
        if (*sum <= 0.0) {
            end_peak(series, side, learns);
        } else if (tl_change_series_is_ready(series) && *sum > series->threshold) {
            found = side;
        }
    }
    return found;
}

/* ---- learning ---- */

/* Adds the newest block to the sums of the next fit. */
static void add_to_fit(tl_change_series *series, double innovation) {
    tl_series_fit *fit = &series->fit;
    double most = FAR_OUT * fit->scale;
    double distance = clipped(kept(series, series->number) - fit->median, most);
    fit->sum += distance;
    for (uint64_t k = 0; k <= TL_SERIES_ORDER; k++) {
        fit->products[k] += distance * clipped(kept(series, series->number - k) - fit->median, most);
    }
    fit->pairs++;
    add_to_histogram(&fit->innovations, fabs(innovation));
}

/* Computes fit and test again from all blocks, which are still kept. */
static void repeat_kept(tl_change_series *series) {
    uint64_t newest = series->number;
    uint64_t oldest = series->first + TL_SERIES_ORDER;
    drop_peaks(series);
    for (int round = 0; round < ROUNDS; round++) {
        begin_interval(series);
        for (series->number = oldest; series->number <= newest; series->number++) {
            double innovation = find_innovation(series);
            if (round < ROUNDS - 1) {
                add_to_fit(series, innovation);
            } else {
                (void)test_block(series, innovation, true);
            }
        }
        series->number = newest;
        if (round < ROUNDS - 1) {
            renew_fit(series);
        }
    }
}

static bool is_in_range(const tl_change_series *series, size_t range, double level) {
    double beyond = BEYOND * (series->normal[0][1] - series->normal[0][0]) + series->least;
    return level >= series->normal[range][0] - beyond && level <= series->normal[range][1] + beyond;
}

static bool is_normal(const tl_change_series *series, double level) {
    bool is_in_any = false;
    for (size_t i = 0; i < series->ranges; i++) {
        is_in_any = is_in_any || is_in_range(series, i, level);
    }
    return is_in_any;
}

static void widen_normal(double range[2], double level) {
    range[0] = fmin(range[0], level);
    range[1] = fmax(range[1], level);
}

static void learn_level(tl_change_series *series, double level) {
    if (series->ranges == 0) {
        series->normal[0][0] = series->normal[0][1] = level;
        series->ranges = 1;
    }
    widen_normal(series->normal[0], level);
}

static void drop_lasting(tl_change_series *series) {
    series->lasting_sum = 0.0;
    series->lasting_change = 0.0;
    series->lasting = 0;
}

/* Adds the newest block to the present lasting level. Returns true if that has left the normal
 * range, which is moved along with a change while the series is off. */
static bool add_lasting(tl_change_series *series, bool learns) {
    series->lasting_sum += kept(series, series->number);
    series->lasting_change += kept(series, series->number) - series->fit.median - residual(series, series->number);
    series->lasting++;
    if (series->lasting < LASTING) {
        return false;
    }
    double level = series->lasting_sum / LASTING;
    double moved = level - (series->is_off ? series->lasting_change / LASTING : 0.0);
    drop_lasting(series);
    if (tl_change_series_is_ready(series) && !is_normal(series, moved)) {
        return true;
    }
    if (learns && (!tl_change_series_is_ready(series) || is_in_range(series, 0, level))) {
        learn_level(series, level);
    }
    return false;
}

/* Adds the newest block to the fit, and renews it when it is due. */
static void learn_block(tl_change_series *series, double innovation) {
    tl_series_fit *fit = &series->fit;
    fit->blocks++;
    if (fit->renewed == 0) {
        if (fit->blocks == TL_SERIES_FIRST) {
            fit_first(series);
            begin_interval(series);
        }
        return;
    }
    add_to_histogram(&fit->levels, kept(series, series->number));
    if (isfinite(innovation)) {
        add_to_fit(series, innovation);
    }
    if (is_due(series) && fit->pairs > TL_SERIES_ORDER) {
        renew_fit(series);
        if (series->number - series->first + 1 == fit->blocks && fit->blocks <= TL_SERIES_KEPT) {
            repeat_kept(series);
        }
        set_threshold(series);
        begin_interval(series);
    }
}

/* ---- a change ---- */

static void restart_sums(tl_change_series *series) {
    for (int side = 0; side < 2; side++) {
        series->cumulative[side] = 0.0;
        series->peak[side] = 0.0;
        series->zero[side] = series->number;
    }
    drop_lasting(series);
}

/* The two means of the best split. */
typedef struct split {
    uint64_t at; /* first block of the second part */
    double before, after;
    double deviation; /* of the blocks from their mean */
} split;

static split find_split(const tl_change_series *series, uint64_t from) {
    double total = 0.0;
    double squares = 0.0;
    double count = (double)(series->number - from + 1);
    for (uint64_t n = from; n <= series->number; n++) {
        total += residual(series, n);
        squares += residual(series, n) * residual(series, n);
    }
    split best = {.at = from + 1};
    double most = -1.0;
    double sum = 0.0;
    for (uint64_t n = from + 1; n <= series->number; n++) {
        sum += residual(series, n - 1);
        double left = (double)(n - from);
        double before = sum / left;
        double after = (total - sum) / (count - left);
        double gain = (after - before) * (after - before) * left * (count - left) / count;
        if (gain > most) {
            most = gain;
            best = (split){.at = n, .before = before, .after = after};
        }
    }
    double mean = total / count;
    best.deviation = sqrt(fmax(squares / count - mean * mean - most / count, 0.0));
    return best;
}

static uint64_t oldest_kept(const tl_change_series *series) {
    uint64_t oldest = series->number >= TL_SERIES_KEPT ? series->number - TL_SERIES_KEPT + 1 : 0;
    return oldest > series->first ? oldest : series->first;
}

static double spread_of_mean(const tl_change_series *series, double blocks) {
    return series->fit.deviation / gain_of(&series->fit) / sqrt(fmax(blocks, 1.0));
}

/* A change, fitted to all blocks from one on. */
typedef struct fitted_change {
    tl_series_change change;
    double size, reference; /* means */
    double error;           /* mean square */
} fitted_change;

static fitted_change estimate_change(const tl_change_series *series, uint64_t from) {
    double sum[2] = {0.0, 0.0}; /* of x, the distance from the median, and r, the reference */
    double xx = 0.0;
    double xr = 0.0;
    double rr = 0.0;
    double count = (double)(series->number - from + 1);
    for (uint64_t n = from; n <= series->number; n++) {
        double x = kept(series, n) - series->fit.median;
        double r = series->reference[n % TL_SERIES_KEPT];
        sum[0] += x;
        sum[1] += r;
        xx += x * x;
        xr += x * r;
        rr += r * r;
    }
    fitted_change found = {.size = sum[0] / count, .reference = sum[1] / count};
    double without = rr > 0.0 ? xx - xr * xr / rr : HUGE_VAL;
    double constant = xx - sum[0] * sum[0] / count;
    bool is_part = without < constant;
    found.change.gain = is_part ? xr / rr : 0.0;
    found.change.offset = is_part ? 0.0 : found.size;
    found.error = fmax(is_part ? without : constant, 0.0) / count;
    return found;
}

/* Mean square error of another estimate. */
static double error_of(const tl_change_series *series, uint64_t from, const tl_series_change *change) {
    double sum = 0.0;
    for (uint64_t n = from; n <= series->number; n++) {
        double error = distance_from(series, n, change);
        sum += error * error;
    }
    return sum / (double)(series->number - from + 1);
}

static uint64_t later_of(uint64_t one, uint64_t other) {
    return one > other ? one : other;
}

static void set_size(tl_change_series *series, const fitted_change *found, uint64_t from) {
    bool is_constant = !(found->change.gain > 0.0 || found->change.gain < 0.0);
    bool has_share = fabs(found->reference) > ABOUT_ZERO * fabs(found->size);
    series->size = found->size;
    series->size_spread = spread_of_mean(series, (double)(series->number - from + 1));
    series->share = !is_constant ? found->change.gain : has_share ? found->size / found->reference : (double)NAN;
}

static double end_of_block(const tl_change_series *series, uint64_t number) {
    return (double)series->kept_end[number % TL_SERIES_KEPT] + 1.0;
}

/* The split is late if the change comes gradually. The sum began to rise when it was zero last, or
 * earlier. So the onset lies between both. `ratio`: noise, in changes. */
static void set_onset(tl_change_series *series, uint64_t split_at, uint64_t zero, double ratio) {
    double late = end_of_block(series, split_at - 1);
    double early = zero < split_at && zero >= oldest_kept(series) ? end_of_block(series, zero) : late;
    series->onset = (early + late) / 2.0;
    series->onset_spread = (late - early) / 2.0 + series->block * (1.0 + fmin(ratio * ratio, MOST_SPREAD));
}

/* `zero`: the last block before the change, or an earlier one. */
static void begin_change(tl_change_series *series, uint64_t zero) {
    uint64_t took = series->number - zero;
    uint64_t reach = took + (took > BEFORE ? took : BEFORE);
    uint64_t oldest = oldest_kept(series);
    split found = find_split(series, series->number - oldest > reach ? series->number - reach : oldest);
    double change = fabs(found.after - found.before);
    set_onset(series, found.at, zero, change > 0.0 ? found.deviation / change : HUGE_VAL);
    fitted_change first = estimate_change(series, found.at);
    set_size(series, &first, found.at);
    series->begins = found.at;
    series->opened = series->is_off ? series->opened : found.at;
    uint64_t settle = 2 * (series->number - found.at + 1);
    series->settles = series->number + (settle > LASTING ? settle : LASTING);
}

/* The estimate is renewed when it has twice as many blocks. */
static void plan_refinement(tl_change_series *series, uint64_t from) {
    uint64_t count = series->number - from + 1;
    series->refines = series->is_off && count <= TL_SERIES_KEPT / 2 ? series->number + count : 0;
}

/* Renews the estimate of the last change. */
static void refine(tl_change_series *series) {
    uint64_t from = later_of(series->opened, oldest_kept(series));
    fitted_change found = estimate_change(series, from);
    set_size(series, &found, from);
    series->change = found.change;
    plan_refinement(series, from);
    series->is_same = true;
}

/* The change so far, as a mean since a block. */
static double mean_change(const tl_change_series *series, uint64_t from) {
    double sum = 0.0;
    for (uint64_t n = from; n <= series->number; n++) {
        sum += kept(series, n) - series->fit.median - residual(series, n);
    }
    return sum / (double)(series->number - from + 1);
}

/* Estimates the change, around which the series is watched from now on. */
static void settle(tl_change_series *series) {
    uint64_t begins = later_of(series->begins, oldest_kept(series));
    uint64_t opened = later_of(series->opened, oldest_kept(series));
    fitted_change last = estimate_change(series, begins);
    fitted_change all = estimate_change(series, opened);
    double noise = fmax(last.error, series->fit.deviation * series->fit.deviation);
    series->is_same = series->is_off && error_of(series, begins, &all.change) <= ALIKE * noise;
    set_size(series, series->is_same ? &all : &last, series->is_same ? opened : begins);
    double level = last.size + series->fit.median;
    double moved = level - (series->is_off ? mean_change(series, begins) : 0.0);
    series->is_off = series->is_same || !is_normal(series, level) || (series->is_off && is_normal(series, moved));
    series->change = series->is_same ? all.change : last.change;
    series->settles = 0;
    series->opened = series->is_same ? opened : begins;
    plan_refinement(series, series->opened);
    restart_sums(series);
}

double tl_change_series_distance(const tl_change_series *series, double first, double last) {
    const tl_series_change none = {0};
    double sum = 0.0;
    double count = 0.0;
    for (uint64_t n = oldest_kept(series); n <= series->number && series->fit.renewed != 0; n++) {
        double end = end_of_block(series, n);
        if (end - series->block >= first && end - 1.0 <= last) {
            sum += distance_from(series, n, &none);
            count += 1.0;
        }
    }
    return count > 0.0 ? sum / count : (double)NAN;
}

/* ---- blocks ---- */

static tl_series_turn add_block(tl_change_series *series) {
    double innovation = find_innovation(series);
    bool learns = !series->is_off && series->settles == 0 && series->fit.blocks < LONGEST * series->learn;
    if (series->settles != 0) {
        if (series->number < series->settles) {
            return TL_SERIES_AS_BEFORE;
        }
        settle(series);
        return TL_SERIES_SETTLED;
    }
    int found = isfinite(innovation) ? test_block(series, innovation, learns) : -1;
    if (found >= 0) {
        begin_change(series, series->zero[found]);
        return TL_SERIES_CHANGED;
    }
    if (add_lasting(series, learns)) {
        begin_change(series, series->number - LASTING);
        return TL_SERIES_CHANGED;
    }
    if (learns) {
        learn_block(series, innovation);
    }
    if (series->refines == series->number) {
        refine(series);
        return TL_SERIES_SETTLED;
    }
    return TL_SERIES_AS_BEFORE;
}

static void drop_block(tl_change_series *series) {
    series->values = 0;
    series->known = 0;
    series->sum = 0.0;
    series->reference_sum = 0.0;
}

tl_series_turn tl_change_series_add(tl_change_series *series, int64_t index, double value, double reference) {
    series->values++;
    if (fabs(value) < UNKNOWN && fabs(reference) < UNKNOWN) { /* false for NaN */
        series->sum += value;
        series->reference_sum += reference;
        series->known++;
    }
    if (series->values < series->block) {
        return TL_SERIES_AS_BEFORE;
    }
    bool counts = 2 * series->known >= series->values;
    double known = fmax(series->known, 1.0);
    double mean = series->sum / known;
    double reference_mean = series->reference_sum / known;
    drop_block(series);
    if (!counts) {
        return TL_SERIES_AS_BEFORE;
    }
    series->number++;
    series->kept[series->number % TL_SERIES_KEPT] = mean;
    series->reference[series->number % TL_SERIES_KEPT] = reference_mean;
    series->kept_end[series->number % TL_SERIES_KEPT] = index;
    return add_block(series);
}

void tl_change_series_interrupt(tl_change_series *series) {
    drop_block(series);
    series->first = series->number + 1;
    restart_sums(series);
}

void tl_change_series_init(tl_change_series *series, uint32_t block, uint64_t learn, double rate, double least) {
    *series = (tl_change_series){.block = block, .rate = rate, .least = least, .first = 1};
    series->learn = learn > LEAST_LEARN ? learn : LEAST_LEARN;
    drop_peaks(series);
}

void tl_change_series_accept(tl_change_series *series, double low, double high) {
    if (series->ranges == 0) {
        return;
    }
    double *range = series->normal[TL_SERIES_RANGES - 1];
    if (series->ranges < TL_SERIES_RANGES) {
        range = series->normal[series->ranges++];
        range[0] = range[1] = series->fit.median + low;
    }
    widen_normal(range, series->fit.median + low);
    widen_normal(range, series->fit.median + high);
    series->is_off = series->is_off && !is_normal(series, series->fit.median + series->size);
}

/* ---- storing ---- */

static bool is_histogram(const tl_series_histogram *histogram) {
    uint64_t total = 0;
    for (size_t i = 0; i < TL_SERIES_BINS; i++) {
        total += histogram->count[i] <= histogram->total ? histogram->count[i] : UINT64_MAX / TL_SERIES_BINS;
    }
    return total == histogram->total && fabs(histogram->least) < UNKNOWN && histogram->width > LEAST_WIDTH &&
           histogram->width < UNKNOWN;
}

static bool are_finite(const double *values, size_t count) {
    for (size_t i = 0; i < count; i++) {
        if (!(fabs(values[i]) < UNKNOWN * UNKNOWN)) {
            return false;
        }
    }
    return true;
}

static bool is_fit(const tl_series_fit *fit) {
    const double numbers[] = {fit->median, fit->scale, fit->deviation, fit->sum};
    return are_finite(numbers, sizeof numbers / sizeof numbers[0]) && are_finite(fit->model, TL_SERIES_ORDER) &&
           are_finite(fit->products, TL_SERIES_ORDER + 1) && fit->scale > LEAST_WIDTH && fit->deviation > LEAST_WIDTH &&
           is_histogram(&fit->levels) && is_histogram(&fit->innovations);
}

static bool is_flag(const bool *flag) {
    unsigned char byte = 2;
    memcpy(&byte, flag, sizeof *flag);
    return byte <= 1;
}

/* The bytes may come from a damaged file. Numbers that could overflow are no data of ours. */
static bool is_sound(const tl_change_series *series) {
    static const uint64_t most = UINT64_MAX / 1024;
    const double numbers[] = {series->change.offset, series->change.gain,   series->largest,      series->threshold,
                              series->lasting_sum,   series->onset,         series->onset_spread, series->size,
                              series->size_spread,   series->lasting_change};
    return are_finite(numbers, sizeof numbers / sizeof numbers[0]) && series->threshold >= 0.0 &&
           series->number < most && series->fit.blocks <= series->number && series->opened <= series->number &&
           series->ranges <= TL_SERIES_RANGES &&
           are_finite(series->normal[0], sizeof series->normal / sizeof(double)) && series->begins <= series->number &&
           is_flag(&series->is_off) && is_flag(&series->is_same) && is_histogram(&series->peaks) &&
           (series->tested != 0 || series->peaks.total == 0) && (series->fit.renewed == 0 || is_fit(&series->fit));
}

bool tl_change_series_load(tl_change_series *series, const unsigned char *bytes) {
    tl_change_series stored = {0};
    memcpy(&stored, bytes, TL_SERIES_STORED);
    if (stored.block != series->block || !is_sound(&stored)) {
        return false;
    }
    if (stored.fit.renewed == 0) { /* its first fit needs the blocks that were not stored */
        return true;
    }
    stored.learn = series->learn;
    stored.rate = series->rate;
    stored.least = series->least;
    if (stored.settles != 0) { /* its estimate needs them, too: the first one remains */
        stored.change = (tl_series_change){.offset = stored.size};
        stored.settles = 0;
        stored.is_off = true;
    }
    stored.refines = 0;
    memcpy(series, &stored, TL_SERIES_STORED);
    if (series->threshold > 0.0) { /* the rate may be another one */
        set_threshold(series);
    }
    return true;
}

void tl_change_series_move(tl_change_series *series, double by) {
    series->onset += by;
}
