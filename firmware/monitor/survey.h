/* Survey: measures range, noise, message intervals and smoothing of the signals of a recording.
 *
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_MONITOR_SURVEY_H
#define TL_FIRMWARE_MONITOR_SURVEY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/monitor/noise.h"
#include "firmware/plant/recording.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Error of readings after a low-pass, estimated from the readings alone.
 *
 * Source: Stein's unbiased risk estimate. The mean square error is E d² − σ² + 2 σ² w. d is the
 *         difference between the low-pass and the reading of the same instant. w is the weight of
 *         that reading in the output of the low-pass. σ is the standard deviation of the noise,
 *         which must be white. The error includes the remaining noise and the flattened motion. The
 *         motion need not be known.
 * Method: uses the low-pass of the plant input (plant/conditioner.h). Its output is read one time
 *         constant later, as for a matched signal, to compensate for its lag.
 * Thread: pure functions.
 */

/* Returns the mean square error at the readings' own instants after a low-pass with time constant
 * `low_pass` > 0, ns. `sigma`: σ. Returns σ² (the error without a low-pass) if there are too few
 * readings, for example fewer than three. */
double tl_smoothing_error(const tl_noise_point *points, size_t count, double sigma, tl_time low_pass);

/* ---- Survey of a recording without any FMU: noise, message intervals, bad readings.
 *
 * Purpose: input of a proposal (proposal.h). Each reading is used once, before any conditioning
 *          (tl_recording_listen()). A reading is good if it is finite and within the signal's `min`
 *          and `max`.
 * Noise:   estimated twice with monitor/noise.h: the first estimate gives the outlier limit of the
 *          second one.
 * Bound:   uses only the first TL_SURVEY_MOST readings of each signal.
 * Owner:   the survey owns its readings; tl_survey_free() frees them.
 * Thread:  one thread.
 */

enum {
    TL_SURVEY_MOST = 200000, /* good readings of a signal that are used */
    TL_SURVEY_LEAST =
        TL_NOISE_LEAST + TL_NOISE_WINDOW + TL_NOISE_AROUND, /* good readings that a noise estimate needs */
    TL_SURVEY_SWITCH = 3 /* a signal with at most this number of values is a switch */
};

typedef struct tl_survey_signal {
    uint64_t good, bad; /* number of used good readings, and of bad ones */
    bool is_cut;        /* there were more than TL_SURVEY_MOST good ones */
    tl_time median, most, rare,
        worst; /* interval between good readings that 50, 95, 99 and 100 % do not exceed, ns; 0: fewer than two */
    uint64_t repeats; /* good readings that equal the one before */
    bool is_switched; /* the signal has at most TL_SURVEY_SWITCH different values */
    bool is_polled;   /* the signal is read more often than updated by its device; its noise is that of the changes */
    double quantum;   /* values differ by multiples of this, in the signal's unit; 0: not found */
    uint64_t outliers;
    double nearest;       /* 90 % of the outliers are at least this far from the last other reading; 0: no outlier */
    tl_noise_found noise; /* without the outliers */
    double sigma;         /* σ of the estimate, or of the rounding to the quantum if that is larger */
    double move, jump;    /* changes between readings without outliers: RMS minus the noise, and maximum */
    bool is_at_rest;      /* the signal does not move by more than its noise */
    tl_noise_point *kept; /* readings without outliers; if is_polled, only the changes */
    size_t kept_count;
} tl_survey_signal;

typedef struct tl_survey {
    tl_time length; /* from the first good reading of any signal to the last, ns */
    size_t count;   /* number of the configuration's own signals */
    tl_survey_signal signals[TL_MAX_SIGNALS];
} tl_survey;

/* Reads the recording to its end; the caller closes it. The survey must be zeroed, and must be
 * freed even after an error. Errors: those of tl_recording_next(); TL_TRY_AGAIN if memory is out;
 * TL_INTERRUPTED. */
tl_status tl_survey_take(tl_recording *recording, const tl_config *config, tl_survey *survey, tl_error *error);

void tl_survey_free(tl_survey *survey);

#endif
