/* Change detection in one series of numbers.
 *
 * Purpose:   learns how a series behaves, and then finds lasting changes of its mean. The series is
 *            a correction Δu, or the error of a released twin (change_detector.h).
 * Block:     `block` values are averaged. A block counts if at least half of its values are known.
 * Learning:  until `learn` blocks have counted, and further until four times as many. The fit is
 *            renewed each time the number of blocks has doubled: the median, an autoregressive
 *            model of order 8 around it, and the deviation of its innovations from their median.
 *            Memory is fixed: sums and histograms. While all blocks are still kept, the fit and
 *            the sums of the test are computed from all of them again.
 * Test:      each innovation, in deviations, is clipped at ±5. Two cumulative sums follow, one for
 *            each direction, with an allowance of 0.5. A sum above the threshold is a change.
 * Threshold: the larger of two values, at least 10. First, 1.5 times the largest sum while
 *            learning. Second, the sum that is exceeded `rate` times in a block, by an exponential
 *            tail of the peaks.
 * Normal:    a range of lasting levels, means of 16 blocks: those while learning, and half the
 *            width of their range more on both sides. A user may accept further ranges. A lasting
 *            level outside of them is a change, too. So products that were made while learning are
 *            normal.
 * Onset:     the split of the newest block means into two means with the least squared error.
 * After:     the change is estimated for twice as long as the detection took, at least 16 blocks:
 *            as a constant, and as a part of a reference (û of a correction, ŷ of an output). The
 *            one with the smaller squared error counts. If the level is not normal, the series is
 *            off. The series is then watched around the level, so that a lasting change is found
 *            once. The estimate is renewed whenever the time since the onset has doubled. If the
 *            series changes again, it is first tried on all blocks since the onset. The series is
 *            off until its level is normal, and would not be so with the change on top.
 * Source:    E. S. Page, Continuous inspection schemes, Biometrika 41 (1954); N. Levinson, J. Math.
 *            Phys. 25 (1946), for the autoregressive model.
 * Memory:    plain data of the caller, about 32 kB, without pointers. The first TL_SERIES_STORED
 *            bytes can be stored; to continue, a series does not need the blocks behind them.
 * Thread:    one thread at a time.
 */
#ifndef TL_FIRMWARE_MONITOR_CHANGE_SERIES_H
#define TL_FIRMWARE_MONITOR_CHANGE_SERIES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    TL_SERIES_ORDER = 8,  /* of the autoregressive model */
    TL_SERIES_FIRST = 32, /* blocks before the first fit */
    TL_SERIES_BINS = 256, /* of a histogram */
    TL_SERIES_RANGES = 8, /* normal levels: the learnt ones, and those that a user accepts */
    TL_SERIES_KEPT = 1024 /* newest block means that are kept */
};

/* Histogram whose bins double in width if a value lies outside. */
typedef struct tl_series_histogram {
    double least; /* lower end of the first bin */
    double width; /* of a bin, > 0 */
    uint64_t total;
    uint64_t count[TL_SERIES_BINS];
} tl_series_histogram;

typedef enum tl_series_turn {
    TL_SERIES_AS_BEFORE,
    TL_SERIES_CHANGED, /* a change was found; it may be a transient */
    TL_SERIES_SETTLED  /* the change is known: the results are valid */
} tl_series_turn;

/* Fit of the model, and the sums for the next one. */
typedef struct tl_series_fit {
    uint64_t blocks;                      /* learnt */
    uint64_t renewed;                     /* of these, at the last fit; 0: there is no fit yet */
    double median, scale;                 /* of block means; scale: deviation from the median */
    double model[TL_SERIES_ORDER];        /* coefficients, the newest block first */
    double deviation;                     /* of innovations */
    double sum;                           /* since the last fit: Σ d, d = clipped distance from the median */
    double products[TL_SERIES_ORDER + 1]; /* likewise: Σ d(n)·d(n − k) */
    uint64_t pairs;                       /* their number */
    tl_series_histogram levels;           /* block means */
    tl_series_histogram innovations;      /* absolute values, since the last fit */
} tl_series_fit;

/* How far the series is from its learnt median: offset + gain · reference; one of the two is 0. */
typedef struct tl_series_change {
    double offset, gain;
} tl_series_change;

/* Fields are private, except the results. */
typedef struct tl_change_series {
    uint32_t block; /* values in a block, ≥ 1 */
    uint64_t learn; /* blocks until changes are reported */
    double rate;    /* expected false alarms in a block */
    double least;   /* least deviation of a block mean */
    double sum;     /* of the present block: values and references */
    double reference_sum;
    uint32_t values;
    uint32_t known;
    tl_series_fit fit;
    tl_series_change change;   /* around which is watched */
    double cumulative[2];      /* sums in deviations: up, down */
    double peak[2];            /* largest values since they were zero */
    uint64_t zero[2];          /* number of the block at which they were zero last */
    tl_series_histogram peaks; /* of both, while learning */
    uint64_t tested;           /* blocks in `peaks` */
    double largest;            /* sum while learning */
    double threshold;
    uint64_t number;    /* blocks so far */
    uint64_t first;     /* the oldest usable one */
    uint64_t refines;   /* block at which its estimate is renewed; 0: never */
    double lasting_sum; /* of the present lasting level: blocks, and `change` at them */
    double lasting_change;
    uint64_t lasting;                   /* its blocks */
    double normal[TL_SERIES_RANGES][2]; /* lowest and highest normal level: learnt; accepted by a user */
    uint64_t ranges;                    /* their number; 0: nothing was learnt */
    uint64_t opened;                    /* block from which on the estimate holds; only if is_off */
    uint64_t begins;                    /* block with which the last change begins */
    uint64_t settles;                   /* block at which it is known; 0: it is */
    double onset, onset_spread;  /* results, of the last change: index of a value, and half the width of its range */
    double size, size_spread;    /* mean distance from the learnt median since the change; standard error */
    double share;                /* size as a part of the reference, with sign; NaN: the reference is about 0 */
    bool is_off;                 /* the series has left its normal levels */
    bool is_same;                /* after SETTLED: no new change, only a better estimate of the one before */
    double kept[TL_SERIES_KEPT]; /* block n lies at n % TL_SERIES_KEPT */
    double reference[TL_SERIES_KEPT];
    int64_t kept_end[TL_SERIES_KEPT]; /* index of its last value */
} tl_change_series;

#define TL_SERIES_STORED offsetof(tl_change_series, kept)

/* Starts a series that has learnt nothing. `learn`: at least 256 is used. `least`: > 0. */
void tl_change_series_init(tl_change_series *series, uint32_t block, uint64_t learn, double rate, double least);

/* Adds the value with this index, and its reference; indices increase. NaN: not known. */
tl_series_turn tl_change_series_add(tl_change_series *series, int64_t index, double value, double reference);

/* Call it after a gap in time: drops the present block and the sums. The fit and the level stay. */
void tl_change_series_interrupt(tl_change_series *series);

/* Returns the mean distance from the learnt median, over the kept blocks that lie from `first` to
 * `last` (indices); NaN: there is none, or nothing was learnt. */
double tl_change_series_distance(const tl_change_series *series, double first, double last);

/* A user accepts these distances from the learnt median, low ≤ high, as normal. If there are too
 * many ranges, the last one is extended. */
void tl_change_series_accept(tl_change_series *series, double low, double high);

/* Restores what a series has learnt, from TL_SERIES_STORED bytes of it. The series was started with
 * the same block length. Then call tl_change_series_interrupt(). Returns false, and changes
 * nothing, if the bytes cannot be of such a series. */
bool tl_change_series_load(tl_change_series *series, const unsigned char *bytes);

/* Moves all indices, because they count from another instant now. */
void tl_change_series_move(tl_change_series *series, double by);

/* Returns true if changes are reported. */
bool tl_change_series_is_ready(const tl_change_series *series);

#endif
