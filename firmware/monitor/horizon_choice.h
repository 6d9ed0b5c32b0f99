/* Choice of the prediction horizon T_P from trials with released twins.
 *
 * Purpose:   in lock, many values of T_P give the same agreement of the matched outputs, even if
 *            the states without a sensor are wrong. If the corrections end, wrong states move the
 *            matched outputs. So each trial replays the recording with one T_P, and its released
 *            twins (master/sync/released_twin.h) show how accurate these states were.
 * Regret:    the *age* is the time since the release. The *regret* of a trial is the largest ratio,
 *            over all ages, of its mean square error to the smallest one of all trials. A wrong
 *            model or noise affects all trials alike, so the ratio depends only on the states. Ages
 *            below the trial's own T_P are not compared: in mode lag, the corrections before the
 *            release have used measurements of the next T_P steps. An age is compared if it has at
 *            least 20 released steps. The same ratio of the locked twin counts too, because a long
 *            horizon smooths a fast change of u. For this ratio, the square of the noise (taken as
 *            a third of a tolerance) is added to numerator and denominator. It counts only if some
 *            age was compared.
 * Choice:    the shortest horizon whose regret is at most TL_HORIZON_EQUAL times the smallest one;
 *            of two equal horizons, the one without `rests`. Only trials with corrections count,
 *            unless a trial without them has a regret smaller by the factor TL_HORIZON_QUIET: in a
 *            quiet recording a trial without corrections can be as good, but cannot follow a
 *            change.
 * Left out:  a trial that failed, or whose steps take longer than the time budget.
 * Thread:    pure functions on plain data.
 */
#ifndef TL_FIRMWARE_MONITOR_HORIZON_CHOICE_H
#define TL_FIRMWARE_MONITOR_HORIZON_CHOICE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/base/status.h"
#include "master/twin/account.h"

enum { TL_HORIZON_TRIALS = 12 }; /* maximum number of trials */
#define TL_HORIZON_EQUAL 1.02    /* horizons with regrets within this factor are equally good */
#define TL_HORIZON_QUIET 1.25    /* factor of regret from which a trial without corrections is chosen */
#define TL_HORIZON_CORRECTS 0.01 /* share of steps with Δu ≠ 0 from which a trial has corrected something */

typedef struct tl_horizon_trial {
    uint32_t prediction;       /* T_P, steps */
    bool rests;                /* the trial has the key `free_twin`: u may stay nominal */
    char fault[TL_ERROR_TEXT]; /* why the trial has no result; "": it has a result */
    tl_released_counts released;
    uint64_t steps;
    uint64_t corrected; /* of these: with Δu ≠ 0 */
    uint64_t evaluations;
    double squares;    /* Σ squared errors of the locked twin, tolerances², as in tl_released_counts */
    uint64_t compared; /* number of steps in this sum */
    tl_time time;      /* mean wall time of a step, ns */
    /* set by tl_horizon_choose(): */
    double locked; /* root mean square error of the locked twin, tolerances; NaN: not known */
    double error;  /* the same of the released twins, over all ages */
    double regret; /* ≥ 1; NaN: left out, or no age was compared */
    tl_time age;   /* age with the largest ratio, ns; 0: the largest ratio is that of the locked twin */
} tl_horizon_trial;

typedef struct tl_horizon_choice {
    size_t count;
    tl_horizon_trial trial[TL_HORIZON_TRIALS];
    uint32_t released_steps;  /* steps of a release (R), the same in all trials */
    tl_time length;           /* of the replayed part, ns */
    char note[TL_ERROR_TEXT]; /* why there are no trials, or no further ones; "": nothing to say */
    size_t chosen;            /* index in `trial`; SIZE_MAX: none */
} tl_horizon_choice;

/* Fills `locked`, `error`, `regret` and `age` of each trial, and `chosen`. The trials must be
 * sorted by T_P. `step`: T_S, ns. `budget`: time budget of a step, ns. */
void tl_horizon_choose(tl_horizon_choice *choice, tl_time step, tl_time budget);

#endif
