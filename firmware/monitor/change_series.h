/* Change detection in one series of numbers.
 *
 * Purpose:   fits an autoregressive model and a normal range, and then finds lasting changes of the
 *            mean. The series is a correction Δu, or the error of a released twin
 *            (change_detector.h). Each value has a reference: û for a correction, ŷ for an output.
 * Block:     mean of `block` values. A block in which less than half of the values are known is
 *            dropped.
 * Learning:  blocks 1 to `learn` are only learnt. Blocks up to 4 · `learn` are learnt and tested;
 *            then the fit is final. While the series is off, or a change is not settled, nothing is
 *            learnt. The fit is renewed each time the number of blocks has doubled: the median, an
 *            autoregressive model of order 8 around it, and the deviation of its innovations
 *            (robust standard deviation, from their median). It is computed from sums and
 *            histograms; as long as all blocks are kept, from all blocks again.
 * Test:      each innovation is divided by the deviation and clipped to ±5. Two CUSUM sums, one up
 *            and one down, add it minus 0.5, and do not go below 0. If a sum exceeds the threshold,
 *            a change is found.
 * Threshold: the larger of two values, at least 10 deviations. First, 1.5 times the largest sum
 *            while learning. Second, the sum that false alarms exceed with the frequency `rate` per
 *            block; it is extrapolated with an exponential tail of the peaks.
 * Normal:    a lasting level is the mean of 16 blocks. Normal are the levels while learning,
 *            extended by half of their range on both sides. A user may accept further ranges. A
 *            lasting level outside of them is a change, too. So the levels of all products that
 *            were made while learning are normal.
 * Onset:     the split of the newest blocks into two parts, each with a constant mean, that has the
 *            least squared error. If the sum was last zero before the split, the onset is the
 *            middle between the two instants.
 * After:     the change is estimated over twice the time of the detection, at least 16 blocks: as
 *            an offset, and as a gain on the reference. The fit with the smaller squared error is
 *            used. If the level is not normal, the series is *off* (has left its normal levels).
 *            The tests then use this level as zero, so that one change is found once. The estimate
 *            is renewed whenever the time since the onset has doubled, until TL_SERIES_KEPT / 2
 *            blocks. If another change is found, the estimate over all blocks since the first onset
 *            is tried first; if it explains both, they are one change. The series is no longer off
 *            if its level is normal, and the level minus the change is not normal.
 * Source:    E. S. Page, Continuous inspection schemes, Biometrika 41 (1954); N. Levinson, J. Math.
 *            Phys. 25 (1946), for the autoregressive model.
 * Memory:    plain data of the caller, about 32 kB, without pointers. The first TL_SERIES_STORED
 *            bytes can be stored. The arrays after them are not needed to continue.
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
    uint32_t block;       /* values in a block, ≥ 1 */
    uint64_t learn;       /* blocks until changes are reported */
    double rate;          /* expected false alarms per block */
    double least;         /* lower limit of each standard deviation, > 0, in the unit of the series */
    double sum;           /* of the values of the present block */
    double reference_sum; /* of their references */
    uint32_t values;
    uint32_t known;
    tl_series_fit fit;
    tl_series_change change;   /* level that the tests use as zero */
    double cumulative[2];      /* CUSUM sums, in deviations: up, down */
    double peak[2];            /* largest value of each sum since it was zero */
    uint64_t zero[2];          /* number of the block at which each sum was zero last */
    tl_series_histogram peaks; /* of both, while learning */
    uint64_t tested;           /* blocks in `peaks` */
    double largest;            /* largest sum while learning */
    double threshold;
    uint64_t number;    /* blocks so far */
    uint64_t first;     /* the oldest usable one */
    uint64_t refines;   /* block at which the estimate of the change is renewed; 0: never */
    double lasting_sum; /* over the blocks of the present lasting level: of their means, and of `change` */
    double lasting_change;
    uint64_t lasting;                   /* its blocks */
    double normal[TL_SERIES_RANGES][2]; /* lowest and highest normal level: learnt; accepted by a user */
    uint64_t ranges;                    /* their number; 0: nothing was learnt */
    uint64_t opened;                    /* first block of the estimate; only if is_off */
    uint64_t begins;                    /* first block of the last change */
    uint64_t settles;                   /* block at which the estimate is settled; 0: no estimate is pending */
    double onset, onset_spread; /* results, of the last change: index of a value, and half the width of its range */
    double size, size_spread;   /* mean distance from the learnt median since the change; standard error */
    double
        share; /* size as a fraction of the reference, with sign; with a fitted gain: the gain. NaN: the reference is about 0 */
    bool is_off;                 /* the series has left its normal levels */
    bool is_same;                /* after SETTLED: no new change, only a better estimate of the one before */
    double kept[TL_SERIES_KEPT]; /* block n lies at n % TL_SERIES_KEPT */
    double reference[TL_SERIES_KEPT];
    int64_t kept_end[TL_SERIES_KEPT]; /* index of its last value */
} tl_change_series;

#define TL_SERIES_STORED offsetof(tl_change_series, kept)

/* Starts a series that has learnt nothing. `learn`: at least 256 blocks are used. */
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
