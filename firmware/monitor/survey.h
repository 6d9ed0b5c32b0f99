/* A recording, measured: range, noise, delays and smoothing of its signals.
 *
 * Thread:  one.
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

/* ---- How far a low-pass takes readings from what was true, as these tell themselves.
 *
 * Idea:    Stein's estimate. What a low-pass makes of the reading of an instant differs from that reading by d; it is off what was true by
 *          E d² − σ² + 2 σ² w in the mean square, if w is the weight with which the reading is in it and the noise is white with deviation σ. So noise that is
 *          taken away and motion that is flattened are weighed without knowing the motion.
 * Purpose: done by the plant's own low-pass (plant/conditioner.h), looked up τ later, as it is when it is matched.
 * Thread:  pure.
 */

/* The mean square error at the readings' own instants, through a low-pass of τ > 0 ns. Without one it is σ². Fewer than three readings: σ². */
double tl_smoothing_error(const tl_noise_point *points, size_t count, double sigma, tl_time low_pass);

/* ---- A recording, looked through for what can be told of its signals without any FMU: noise, message times, bad readings.
 *
 * Purpose: what a proposal (proposal.h) goes by. Readings are taken as they came (tl_recording_listen()), each once; good ones are those that are finite and
 *          within the signal's `min` and `max`.
 * Noise:   by diagnose/noise_meter.h, twice: what the first time says of the noise tells the outliers the second time.
 * Bound:   the first TL_SURVEY_MOST readings of a signal.
 * Owner:   the survey owns its readings; tl_survey_free() frees all.
 * Thread:  one thread.
 */

enum {
    TL_SURVEY_MOST = 200000,
    TL_SURVEY_LEAST =
        TL_NOISE_LEAST + TL_NOISE_WINDOW + TL_NOISE_AROUND, /* good readings to tell anything of their noise */
    TL_SURVEY_SWITCH = 3                                    /* a signal that has so many values or fewer is switched */
};

typedef struct tl_survey_signal {
    uint64_t good, bad; /* readings */
    bool is_cut;        /* there were more */
    tl_time median, most, rare,
        worst;        /* from one good reading to the next: in 50, 95, 99 and 100 % of all cases; 0: there are no two */
    uint64_t repeats; /* good ones with the value of the one before */
    bool is_switched; /* it has a few values only, or one */
    bool is_polled;   /* it is read more often than it changes; the noise is that of the changes */
    double quantum;   /* all values are multiples of this; 0: they are not, as far as one can see */
    uint64_t outliers;
    double nearest; /* nine of ten outliers are further from the reading before them that is none; 0: there are none */
    tl_noise_found noise; /* without the outliers */
    double sigma;         /* the noise: that, or what counting in multiples makes, if that is more */
    double move,
        jump; /* from one reading that is no outlier to the next: root mean square less the noise's, and the most */
    bool is_at_rest;      /* all of it is within its noise */
    tl_noise_point *kept; /* those that are no outliers; of one that is polled, the changes */
    size_t kept_count;
} tl_survey_signal;

typedef struct tl_survey {
    tl_time length; /* from the first good reading of any signal to the last */
    size_t count;   /* the configuration's own signals */
    tl_survey_signal signals[TL_MAX_SIGNALS];
} tl_survey;

/* Reads the recording to its end, and closes it not. The survey was zeroed, and is to be freed even if this fails. Errors: those of tl_recording_next();
 * TL_TRY_AGAIN; TL_INTERRUPTED. */
tl_status tl_survey_take(tl_recording *recording, const tl_config *config, tl_survey *survey, tl_error *error);

void tl_survey_free(tl_survey *survey);

#endif
