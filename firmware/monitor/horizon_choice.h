/* Choice of the prediction horizon T_P from trials with released twins.
 *
 * Purpose:   in lock the matched outputs agree with the plant for many T_P, even if the states
 *            without a sensor are wrong. If the corrections end, wrong states move the matched
 *            outputs. So each trial replays one recording with one T_P, and its released twins
 *            (master/sync/released_twin.h) show what the states were worth.
 * Regret:    the mean square error at each age of the released twins, divided by the smallest one
 *            of all trials; the largest ratio of all ages counts. A wrong model or noise affects
 *            all trials alike, so the ratio shows the states. Ages below the trial's own T_P are
 *            not compared: the corrections have used the measurements of this time.
 *            The same ratio of the locked twin counts too, because a long horizon smooths a fast
 *            change of u. There the square of the noise (a third of a tolerance) is added to both.
 * Choice:    the shortest horizon whose regret is at most TL_HORIZON_EQUAL times the smallest one.
 *            Only horizons that have corrected something count, unless all of them are worse by
 *            TL_HORIZON_QUIET. A horizon that never corrects can be as good in a quiet recording,
 *            but cannot follow a change.
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

enum { TL_HORIZON_TRIALS = 12 }; /* most trials */
#define TL_HORIZON_EQUAL 1.02
#define TL_HORIZON_QUIET 1.25
#define TL_HORIZON_CORRECTS 0.01 /* share of steps with Δu ≠ 0 from which a trial has corrected something */

typedef struct tl_horizon_trial {
    uint32_t prediction;       /* T_P, steps */
    bool rests;                /* with "free_twin": u may rest */
    char fault[TL_ERROR_TEXT]; /* why it has no result; "": it has one */
    tl_released_counts released;
    uint64_t steps;
    uint64_t corrected; /* of these: with Δu ≠ 0 */
    uint64_t evaluations;
    double squares;    /* of the locked twin, as in tl_released_counts */
    uint64_t compared; /* steps in this sum */
    tl_time time;      /* mean wall time of a step, ns */
    /* set by tl_horizon_choose(): */
    double locked; /* error of the locked twin, root mean square, tolerances */
    double error;  /* of the released twins, over all ages */
    double regret; /* ≥ 1; NaN: left out */
    tl_time age;   /* of the largest ratio, ns since the release; 0: it is that of the locked twin */
} tl_horizon_trial;

typedef struct tl_horizon_choice {
    size_t count;
    tl_horizon_trial trial[TL_HORIZON_TRIALS];
    uint32_t released_steps;  /* R of all trials */
    tl_time length;           /* of the replayed part, ns */
    char note[TL_ERROR_TEXT]; /* why there are no trials, or no further ones; "": nothing to say */
    size_t chosen;            /* index; SIZE_MAX: none */
} tl_horizon_choice;

/* Fills `error`, `regret` and `age` of each trial, and `chosen`. `step`: T_S, ns. `budget`: time
 * budget of a step, ns. */
void tl_horizon_choose(tl_horizon_choice *choice, tl_time step, tl_time budget);

#endif
