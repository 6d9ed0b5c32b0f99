/* A value of the plant: type, quality, one time-stamped reading, and one sample of all signals.
 *
 * Purpose: the types that plant I/O, the twin and the recorder share.
 * Values:  double; Booleans are 0 or 1, integers are exact (|value| < 2^31).
 * Thread:  plain data.
 */
#ifndef TL_MASTER_BASE_SIGNAL_H
#define TL_MASTER_BASE_SIGNAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"

/* Base types of FMI 2.0. */
typedef enum tl_type { TL_REAL, TL_INTEGER, TL_BOOLEAN, TL_STRING, TL_ENUMERATION } tl_type;

/* Only TL_GOOD enters an objective. Databases store the codes: add at the end only. */
typedef enum tl_quality {
    TL_GOOD = 0,
    TL_STALE,        /* older than the signal's stale time */
    TL_OUT_OF_RANGE, /* outside the signal's min..max */
    TL_NOT_A_NUMBER, /* not finite, text that is no number, or a code for a missing value */
    TL_NO_LINK,      /* the device does not answer, or has never answered */
    TL_OUTLIER,      /* rejected, or not confirmed yet: too far from the last accepted reading (plant/conditioner.h) */
    TL_FROZEN,       /* the readings repeat one value while the plant moves */
    TL_LAST_QUALITY = TL_FROZEN
} tl_quality;

enum {
    TL_MAX_SIGNALS = 64, /* plant signals of one twin */
    TL_MAX_MATCH = 64,   /* outputs compared with the plant */
    TL_MAX_ADJUST = 8    /* variables adjusted */
};

/* Value of a signal between two of its readings. */
typedef enum tl_between {
    TL_BETWEEN_LAST, /* the last reading, held */
    TL_BETWEEN_LINE, /* linear interpolation */
    TL_BETWEEN_MEAN  /* mean of the linear interpolation over a macro step */
} tl_between;

/* Conditioning of a signal's readings before they are matched, in this order (plant/conditioner.h).
 * All zero: none. At most one of gate and leap is above 0. */
typedef struct tl_condition {
    double gate; /* > 0: a reading further than this (signal's unit) from the last accepted one is rejected; 0: none */
    double leap; /* > 0: isolated outliers are rejected, but no reading within this of the last accepted one; 0: none */
    bool keeps_outliers; /* as configured: true: `leap` gets no default (6 tolerances), so isolated outliers stay */
    uint32_t median;     /* odd number of readings, 3 … 99; 0 and 1: none */
    tl_time low_pass;    /* time constant τ of a first-order low-pass, ns; 0: none */
} tl_condition;

/* One value as a driver read it. */
typedef struct tl_reading {
    double value;
    tl_time stamp; /* when the value was true at the plant, on the clock of the cycle */
    tl_quality quality;
} tl_reading;

/* The plant at one instant t_m = t_start + tick·T_S: of each signal the newest reading at or before
 * t_m. With a configured delay between plant and simulation: the reading at a fixed time before t_m
 * (plan/plan.h). */
typedef struct tl_sample {
    int64_t tick;
    tl_time instant; /* t_m, on the clock of the stamps */
    double values[TL_MAX_SIGNALS];
    tl_time stamps[TL_MAX_SIGNALS];  /* TL_TIME_NEVER: there was no reading yet */
    uint8_t quality[TL_MAX_SIGNALS]; /* tl_quality */
    uint64_t moved; /* bit i: the value of signal i was slightly beyond a limit and was moved to it; not recorded */
} tl_sample;

/* Returns true if any conditioning is configured. */
bool tl_condition_is_needed(const tl_condition *condition);

/* "good", "stale", "out of range", "not a number", "no link", "outlier", "frozen". */
const char *tl_quality_name(tl_quality quality);

/* Age of a signal's reading at the instant of the sample, ns; 0 if there is no reading, or if it is
 * later. */
tl_time tl_sample_age(const tl_sample *sample, size_t signal);

/* "Real", "Integer", "Boolean", "String", "Enumeration", as FMI 2.0 writes them. */
const char *tl_type_name(tl_type type);

#endif
