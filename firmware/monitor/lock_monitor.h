/* Lock monitor: determines the lock state of a twin, and when a lost twin is reset.
 *
 * Memory: plain data of the caller.
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_MONITOR_LOCK_MONITOR_H
#define TL_FIRMWARE_MONITOR_LOCK_MONITOR_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/monitor/frozen.h"
#include "firmware/monitor/lock_tally.h"
#include "master/base/simtime.h"
#include "master/twin/account.h"

/* ---- Detects an adjusted variable that was at a bound for most of the last minute.
 *
 * Purpose: a correction at its bound has no further effect. This may last for hours while the twin
 *          is within tolerance, or lost for another reason. So it is reported separately from the
 *          lock state.
 * Minute:  of plant time, in ten blocks of 6 s. The share of steps at a bound is computed at the
 *          end of each block. It is reported if it exceeds half after ten blocks. The report is
 *          cleared when the share is less than a quarter.
 * Thread:  plain data; one thread at a time.
 */

enum { TL_BOUND_BLOCKS = 10 };

#define TL_BOUND_BLOCK (6 * TL_SECOND)

/* REACHED: report that the variable is at a bound. LEFT: clear this report. */
typedef enum tl_bound_turn { TL_BOUND_AS_BEFORE, TL_BOUND_REACHED, TL_BOUND_LEFT } tl_bound_turn;

/* Zeroed initially. */
typedef struct tl_bound_stay {
    int64_t block;                   /* number of the block of the last step */
    uint32_t passed;                 /* blocks since the start, at most TL_BOUND_BLOCKS */
    uint32_t steps[TL_BOUND_BLOCKS]; /* steps of block n at n % TL_BOUND_BLOCKS */
    uint32_t there[TL_BOUND_BLOCKS]; /* of these steps: at a bound */
    bool has_begun;
    bool is_reported;
    tl_bound_turn turn; /* set by the last step; AS_BEFORE: no change */
    double share;       /* share of steps at a bound, as computed last, 0 … 1 */
} tl_bound_stay;

/* Adds a step at `time`, ns; times must not decrease. `is_there`: the variable is at a bound. */
void tl_bound_stay_step(tl_bound_stay *stay, tl_time time, bool is_there);

/* ---- Release check: would the twin stay at the plant without corrections?
 *
 * Purpose:   in lock, y agrees with ŷ even if a signal is miswired or the model is wrong, because u
 *            is corrected until both agree. A released twin (master/sync/released_twin.h) shows
 *            what the corrections hide.
 * Block:     R/4 steps (R: duration of a release); without released twins 150 steps; with an event
 *            horizon ten strokes. Errors are root mean squares over a block. They count if at least
 *            half of its steps had a released twin that was a block old or older.
 * Corrected: the released twin is off by a tolerance or more, or the mean Δu of a Real variable
 *            differs from the approved correction by at least its `step`.
 * Worse:     in TL_RELEASE_SURE blocks in a row the error of the locked twin exceeds that of the
 *            released one by 20 % and 0.1 tolerances. Then the corrections do harm: the horizon is
 *            too short for the plant, or the twin follows noise.
 * Rest:      if it is worse, u should rest at nominal, unless the configuration forbids it, has a
 *            `free_twin`, or has an approved correction. The rest ends when the twin's error
 *            exceeds that before the rest, by the same limits, in TL_RELEASE_BACK blocks in a row.
 *            The first release of a rest does not count: its state is still that of the lock.
 * Thread:    plain data; one thread at a time.
 */

enum { TL_RELEASE_SURE = 4, TL_RELEASE_BACK = 2 };

/* WORSE: report that the corrections do harm. BETTER: clear this report. ENDS: the twin at rest is
 * too far from the plant, so the rest ends and u is searched again. */
typedef enum tl_release_turn {
    TL_RELEASE_AS_BEFORE,
    TL_RELEASE_WORSE,
    TL_RELEASE_BETTER,
    TL_RELEASE_ENDS
} tl_release_turn;

/* Zeroed initially, except `block`. */
typedef struct tl_release_check {
    uint32_t block;                   /* steps (or strokes) of a block */
    uint32_t steps;                   /* of the current block */
    uint32_t released;                /* of these, steps with a released twin that is old enough, or at rest */
    double squares[2][TL_MAX_MATCH];  /* sums of squared errors, tolerances²: locked, released */
    uint32_t counted[TL_MAX_MATCH];   /* number of errors in each sum */
    double correction[TL_MAX_ADJUST]; /* sums of Δu */
    double excess[TL_MAX_ADJUST];     /* sums of Δu minus the approved correction within the bounds */
    int64_t first;                    /* first step of the block */
    /* of the last block: */
    double error[2];      /* locked, released: weighted root mean square of all outputs, in tolerances */
    size_t worst;         /* index of the output with the largest error of the released twin */
    double worst_error;   /* this error, in tolerances */
    size_t strongest;     /* index of the variable with the largest mean excess, measured in its `step` */
    double mean;          /* mean Δu of this variable */
    bool is_off;          /* the released twin is off */
    bool has_excess;      /* a mean Δu differs from the approved correction */
    bool is_corrected;    /* is_off or has_excess is true, or was a short time ago (see Corrected below) */
    int64_t since;        /* first step of the block in which is_corrected became true */
    int64_t corrected_at; /* the last step with is_off, has_excess, or u at a bound */
    int64_t last_step;
    tl_lock_standing standing; /* the last reason, without its times */
    uint32_t in_a_row;         /* blocks in a row that contradict is_worse; at rest: in which the error is too large */
    bool is_worse;
    bool rests;           /* u should rest at nominal */
    double before;        /* error of the locked twin when the rest began, in tolerances */
    uint32_t rested;      /* number of blocks of the rest */
    tl_release_turn turn; /* set by the last step */
} tl_release_check;

/* ---- Lock monitor: decides whether the twin follows the plant.
 *
 * Purpose:    the only code that assesses a run, live or replayed. Inputs: the error of each
 *             committed step in tolerances, Δu, the bounds, the qualities of the plant's signals,
 *             inexact rollbacks of FMUs, and the outputs of released twins. A replay gives the same
 *             states, because there are no other inputs. But a live run that has no time for
 *             released twins is `corrected` less often than its replay.
 * Window:     a single step proves nothing: a lost twin can be within tolerance at every second
 *             step. So the state depends on shares of the steps in a window, and on the size of the
 *             error. Committed steps count, not J: with a long horizon a twin may be within
 *             tolerance all day and never have J < 1. The window has ten parts. A part is 0.1 s
 *             long, or two steps if these are longer. The state is updated at the end of each part.
 *             With an event horizon, strokes (event_horizon.h) whose search has ended count instead
 *             of steps. A part is then one stroke, and three strokes give the first state.
 * Runaway:    a step whose error is at least 1e9 tolerances, or whose search has a J that is not
 *             finite. One such step in the window makes the state `lost`. An output that is not
 *             finite is not compared.
 * Astray:     a lost twin that a reset may help. Two conditions must hold, each in at least a
 *             quarter of the steps of the window and of its newest part. First, the error is at
 *             least ten tolerances. Second, an output has moved that far in one step, and at least
 *             three times as far as its measurement moves. A plant that is sampled fast enough does
 *             not jump like this, and its model only if it is unstable. A twin with a large steady
 *             error is not astray: a reset would lose its state without improving the model.
 * Limits:     each state has one limit to enter it and another one to leave it, so that the monitor
 *             does not oscillate between two states.
 * Corrected:  the twin is in lock, but without corrections it would leave the plant: see the
 *             release check above, or u is at a bound. The state stays for at least one release,
 *             and at least one minute. If its reason changes by more than a tenth, this is
 *             reported: after the first block, then at most once an hour. A new approved correction
 *             ends the state.
 * Tolerances: tolerances and weights are those of the configuration. A second monitor can use those
 *             of another configuration.
 * Thread:     plain data; one thread at a time.
 */

enum {
    TL_LOCK_PARTS = 10,      /* per window */
    TL_LOCK_RECOVERED = 100, /* parts in lock in a row, after which earlier resets do not count */
    TL_LOCK_PERIODS = 8,     /* longest limit cycle of u that is detected, steps */
    TL_LOCK_CAUSE = 256      /* bytes of a cause text */
};

/* Range of a value. */
typedef struct tl_lock_range {
    double least, most;
} tl_lock_range;

/* Statistics of one part of the window. */
typedef struct tl_lock_part {
    uint32_t steps;
    uint32_t free;     /* not compared: nothing is adjusted, or no matched signal was good */
    uint32_t between;  /* not compared: the horizon had good measurements, but the step itself had none */
    uint32_t outside;  /* error of at least one tolerance */
    uint32_t far;      /* error of at least ten tolerances */
    uint32_t jumps;    /* an output moved ten tolerances in one step, and much further than its measurement */
    uint32_t ran_away; /* see Runaway above */
    uint32_t differed; /* before these steps, the rollback of an FMU was found not to be exact */
    double worst;      /* largest error, tolerances */
    uint32_t samples;  /* samples of the plant */
    uint32_t bad[TL_MAX_SIGNALS];                         /* samples that are not good, by signal */
    uint32_t at_bound[TL_MAX_ADJUST];                     /* steps with u at a bound */
    uint32_t cycling[TL_MAX_ADJUST][TL_LOCK_PERIODS + 1]; /* [v][p]: steps in which u has returned after p steps */
    tl_lock_range u[TL_MAX_ADJUST];                       /* range of u */
} tl_lock_part;

/* A change of the state, reported once; or an update of the reason of `corrected`. */
typedef struct tl_lock_change {
    tl_lock_state to;          /* the new state */
    bool is_update;            /* the state is `corrected` as before, with another reason */
    char cause[TL_LOCK_CAUSE]; /* sentence with the value and its limit */
} tl_lock_change;

/* Fields are private, except `tolerances`, `started`, `stay`, `release`, `frozen` and
 * `is_astray`. */
typedef struct tl_lock_monitor {
    const tl_config *config;
    const tl_lock_tolerances
        *tolerances; /* NULL: those of the configuration; may be set between two steps; must outlive the monitor */
    int64_t started; /* t_start in UTC, ms; 0: a replay; may be set between two steps */
    tl_account_adjust adjust[TL_MAX_ADJUST]; /* units, types, steps and bounds of the adjusted variables */
    char unit[TL_MAX_MATCH][TL_LOCK_UNIT];   /* of the matched outputs */
    double approved[TL_MAX_ADJUST];          /* approved corrections */
    uint32_t part_steps;                     /* steps (or strokes) of a part */
    uint32_t parts;                          /* complete parts, at most TL_LOCK_PARTS */
    uint32_t at;                             /* index of the current part */
    tl_lock_part part[TL_LOCK_PARTS];
    double u[TL_LOCK_PERIODS + 1][TL_MAX_ADJUST];   /* of the last steps, the newest first */
    double y[TL_MAX_MATCH], measured[TL_MAX_MATCH]; /* of the last step */
    double stride[TL_MAX_MATCH];                    /* largest move of ŷ in one step, decaying by 1 % per step */
    uint32_t u_count;                               /* number of valid rows in u */
    tl_bound_stay stay[TL_MAX_ADJUST];              /* of the Real variables */
    tl_release_check release;
    tl_frozen_watch frozen; /* the caller adds the samples (tl_frozen_watch_sample()) */
    bool judged;            /* a state was determined */
    bool is_astray;         /* the twin is astray (see above), as determined last */
    uint64_t pending;       /* steps that are not yet counted in a state */
    tl_lock_tally tally;
    tl_lock_change change;
    tl_lock_standing reported; /* the reason of `corrected` that was returned last */
    int64_t update_from;       /* step from which an update may be reported */
} tl_lock_monitor;

/* Length of a run until the first state is known. */
typedef struct tl_lock_window {
    uint32_t strokes; /* event horizon: number of ended strokes; 0: steps count */
    tl_time time;     /* ns; with strokes: their longest possible duration, without the pauses between them */
} tl_lock_window;

tl_lock_window tl_lock_monitor_window(const tl_config *config);

/* Initialises the monitor. `account`: units, types, steps and bounds; they are copied. `config`
 * must outlive the monitor. */
void tl_lock_monitor_init(tl_lock_monitor *monitor, const tl_config *config, const tl_account *account);

/* Call it after a new tuning was applied to the twin and to the configuration (tl_config_retune()).
 * It applies from the next step on; the window stays. After a new approved correction the release
 * check starts again. */
void tl_lock_monitor_retune(tl_lock_monitor *monitor, const tl_tuning *tuning);

/* Adds the sample of a tick; call it before the step of the tick. */
void tl_lock_monitor_sample(tl_lock_monitor *monitor, const tl_sample *sample);

/* Adds a step of this run. Ignores repeated steps of an earlier run that this run resumes. A step
 * with TL_FLAG_RESET (the FMUs were reset before it) starts a new window. Returns a change or an
 * update, valid until the next one; NULL: none. */
const tl_lock_change *tl_lock_monitor_step(tl_lock_monitor *monitor, const tl_record *record);

/* Copies the tally so far. If the run was shorter than a window, or a step of the current part ran
 * away, the copy has the state of the steps so far. */
void tl_lock_monitor_get(const tl_lock_monitor *monitor, tl_lock_tally *tally);

/* ---- Recovery of a lost twin: decides when its FMUs are reset.
 *
 * Purpose: sometimes no correction brings a twin into lock again. If the monitor finds it astray,
 *          its FMUs are reset to their start values (tl_twin_reset()). The pause until the next
 *          reset doubles after each reset. After the twin has been in lock for TL_LOCK_RECOVERED
 *          parts in a row, the pause is the shortest one again.
 * NaN:     the FMUs are also reset after TL_NOT_FINITE_STEPS steps in a row in which a connected or
 *          matched output was not finite. This number doubles after each such reset. After
 *          TL_FINITE_STEPS steps in a row with finite outputs only, it is TL_NOT_FINITE_STEPS
 *          again.
 * Replay:  the decision depends only on records and samples, so that a replay resets at the same
 *          steps.
 * Thread:  plain data; the thread of the twin.
 */

/* Shortest and longest pause between two resets, in parts of the window. */
enum { TL_LOCK_PAUSE_FIRST = 20, TL_LOCK_PAUSE_LAST = 6000 };

/* Steps in a row with an output that is not finite, before the first reset. Steps in a row with
 * finite outputs, after which these resets are forgotten. Largest number of doublings. */
enum { TL_NOT_FINITE_STEPS = 10, TL_FINITE_STEPS = 100, TL_NOT_FINITE_RESETS = 16 };

/* Fields are private. */
typedef struct tl_recovery {
    tl_lock_monitor lock_monitor;
    uint64_t windows; /* number of assessed windows at the last update */
    uint32_t pause;   /* shortest time between two resets, parts; 0: no reset yet, or the twin has recovered */
    uint32_t passed;  /* parts since the last reset */
    uint32_t well;    /* parts in lock in a row */
    uint32_t bad;     /* steps in a row with an output that is not finite */
    uint32_t finite;  /* steps in a row with finite outputs only */
    uint32_t resets;  /* resets because of such outputs; each doubled the number of steps for the next one */
} tl_recovery;

/* As tl_lock_monitor_init(). With an event horizon an astray twin is not reset, because its steps
 * are not compared. */
void tl_recovery_init(tl_recovery *recovery, const tl_config *config, const tl_account *account);

/* Adds a step; the caller first adds its sample to `lock_monitor`. Returns true if the FMUs must be
 * reset before the next step. Sets *change to the result of tl_lock_monitor_step(). */
bool tl_recovery_step(tl_recovery *recovery, const tl_record *record, const tl_lock_change **change);

#endif
