/* Change detection in one series of numbers.
 *
 * Purpose:   fits an autoregressive model and a normal range, and then finds lasting changes of the
 *            mean. The series is a correction Δu, or the error of a released twin
 *            (change_detector.h). Each value has a reference: û for a correction, ŷ for an output.
 * Block:     mean of `block` values. A block in which less than half of the values are known is
 *            dropped.
 * Learning:  blocks 1 to `learn` are only learnt. Blocks up to 4 · `learn` are learnt and tested;
 *            then the fit is final. While the series is off, or a change is not settled, nothing is
 *            learnt. The fit is renewed each time the number of blocks has doubled. It has three
 *            parts: the median; an autoregressive model of order 8 around the median; and the
 *            *deviation*, the robust standard deviation of the model's innovations. The fit uses
 *            sums and histograms; while all blocks are still kept, it uses all blocks again.
 * Test:      each innovation is divided by the deviation and clipped to ±5. Two CUSUM sums, one up
 *            and one down, add it minus 0.5, and do not go below 0. If a sum exceeds the threshold,
 *            a change is found.
 * Threshold: the larger of two values, at least 10 deviations. First, 1.5 times the largest sum
 *            while learning. Second, the sum that normal blocks exceed `rate` times per block; it
 *            is extrapolated with an exponential tail of the learnt peaks.
 * Normal:    a lasting level is the mean of 16 blocks. The range of the levels while learning,
 *            extended by half of its width on both sides, is normal. So the levels of all products
 *            that were made while learning are normal. A user may accept further ranges. A lasting
 *            level outside of all ranges is a change, too.
 * Onset:     the newest blocks are split into two parts with constant means, so that the squared
 *            error is smallest. If the sum was zero for the last time before the split, the onset
 *            is the middle between the two instants; else it is the split.
 * After:     a change *settles* after another time as long as that from onset to detection, at
 *            least 16 blocks. It is then estimated as an offset and as a gain on the reference; the
 *            one with the smaller squared error is used. If the level is not normal, the series is
 *            *off* (has left its normal levels). The tests then use this level as zero, so that one
 *            change is found once. The estimate is renewed whenever the time since the onset has
 *            doubled, until TL_SERIES_KEPT / 2 blocks. If another change is found, the estimate
 *            over all blocks since the first onset is tried first; if it explains both, they are
 *            one change. The series is no longer off if its new level is normal, but would not be
 *            normal if the earlier change still existed (level minus that change).
 * Source:    E. S. Page, Continuous inspection schemes, Biometrika 41 (1954); N. Levinson, J. Math.
 *            Phys. 25 (1946), for the autoregressive model.
 * Memory:    plain data of the caller, about 32 kB, without pointers. The first TL_SERIES_STORED
 *            bytes (7 kB) can be stored. The arrays after them are not needed to continue.
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
    TL_SERIES_RANGES = 8, /* ranges of normal levels: the learnt one, and those that a user accepts */
    TL_SERIES_KEPT = 1024 /* number of newest block means that are kept */
};

/* Histogram. If a value lies outside of all bins, all bins double in width. */
typedef struct tl_series_histogram {
    double least; /* lower end of the first bin */
    double width; /* of a bin, > 0 */
    uint64_t total;
    uint64_t count[TL_SERIES_BINS];
} tl_series_histogram;

typedef enum tl_series_turn {
    TL_SERIES_AS_BEFORE,
    TL_SERIES_CHANGED, /* a change was found; it may be a transient */
    TL_SERIES_SETTLED  /* the change has settled, or its estimate was renewed: the results are valid */
} tl_series_turn;

/* Fit of the model, and the sums for the next one. */
typedef struct tl_series_fit {
    uint64_t blocks;                      /* number of learnt blocks */
    uint64_t renewed;                     /* this number at the last fit; 0: there is no fit yet */
    double median, scale;                 /* of block means; scale: robust standard deviation */
    double model[TL_SERIES_ORDER];        /* coefficients, the newest block first */
    double deviation;                     /* of innovations */
    double sum;                           /* since the last fit: Σ d, d = clipped distance from the median */
    double products[TL_SERIES_ORDER + 1]; /* likewise: Σ d(n)·d(n − k) */
    uint64_t pairs;                       /* number of blocks in `sum` and `products` */
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
    double sum;           /* of the known values of the present block */
    double reference_sum; /* of their references */
    uint32_t values;      /* values of the present block */
    uint32_t known;       /* of these, the known ones */
    tl_series_fit fit;
    tl_series_change change;   /* level that the tests use as zero */
    double cumulative[2];      /* CUSUM sums, in deviations: up, down */
    double peak[2];            /* largest value of each sum since it was zero */
    uint64_t zero[2];          /* number of the block at which each sum was zero last */
    tl_series_histogram peaks; /* of both, while learning */
    uint64_t tested;           /* blocks in `peaks` */
    double largest;            /* largest CUSUM sum while learning */
    double threshold;
    uint64_t number;    /* blocks so far; also the number of the newest one */
    uint64_t first;     /* number of the oldest usable block */
    uint64_t refines;   /* block at which the estimate of the change is renewed; 0: never */
    double lasting_sum; /* over the blocks of the present lasting level: of their means, and of `change` */
    double lasting_change;
    uint64_t lasting;                   /* number of its blocks */
    double normal[TL_SERIES_RANGES][2]; /* lowest and highest level of each normal range; [0] is the learnt one */
    uint64_t ranges;                    /* number of ranges; 0: nothing was learnt */
    uint64_t opened;                    /* first block of the estimate; only if is_off */
    uint64_t begins;                    /* first block of the last change */
    uint64_t settles;                   /* block at which the estimate is settled; 0: no estimate is pending */
    double onset, onset_spread; /* results, of the last change: index of a value ± half the width of its range */
    double size, size_spread;   /* mean distance from the learnt median since the change; standard error */
    double
        share; /* size as a fraction of the mean reference, with its sign; if a gain was fitted: the gain. NaN: the reference is about 0 */
    bool is_off;                 /* the series has left its normal levels */
    bool is_same;                /* after SETTLED: no new change, only a better estimate of the one before */
    double kept[TL_SERIES_KEPT]; /* block n lies at n % TL_SERIES_KEPT */
    double reference[TL_SERIES_KEPT];
    int64_t kept_end[TL_SERIES_KEPT]; /* index of its last value */
} tl_change_series;

#define TL_SERIES_STORED offsetof(tl_change_series, kept)

/* Starts a series that has learnt nothing. Parameters as the fields; a `learn` below 256 becomes
 * 256. */
void tl_change_series_init(tl_change_series *series, uint32_t block, uint64_t learn, double rate, double least);

/* Adds the value with this index, and its reference; indices must increase. NaN: not known. */
tl_series_turn tl_change_series_add(tl_change_series *series, int64_t index, double value, double reference);

/* Call it after a gap in time: drops the present block and the sums. The fit and the level stay. */
void tl_change_series_interrupt(tl_change_series *series);

/* Returns the mean distance from the learnt median, over the kept blocks that lie from `first` to
 * `last` (indices); NaN: there is none, or nothing was learnt. */
double tl_change_series_distance(const tl_change_series *series, double first, double last);

/* A user accepts these distances from the learnt median, low ≤ high, as normal. If there are
 * already TL_SERIES_RANGES ranges, the last one is extended. Ignored if nothing was learnt. */
void tl_change_series_accept(tl_change_series *series, double low, double high);

/* Restores what a series has learnt, from its TL_SERIES_STORED bytes. `series` must be started with
 * the same block length; its `learn`, `rate` and `least` stay. Then call
 * tl_change_series_interrupt(). Returns false, and changes nothing, if the bytes are not valid. */
bool tl_change_series_load(tl_change_series *series, const unsigned char *bytes);

/* Adds `by` to the onset, because indices now count from another instant. Then call
 * tl_change_series_interrupt(), because the indices of kept blocks stay. */
void tl_change_series_move(tl_change_series *series, double by);

/* Returns true if the series has learnt enough to report changes. */
bool tl_change_series_is_ready(const tl_change_series *series);

#endif
