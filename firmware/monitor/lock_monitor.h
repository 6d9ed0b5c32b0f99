/* The state of the lock, and what is tried if it is lost.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_MONITOR_LOCK_MONITOR_H
#define TL_FIRMWARE_MONITOR_LOCK_MONITOR_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/monitor/lock_tally.h"
#include "master/base/simtime.h"
#include "master/twin/account.h"

/* ---- How long an adjusted variable has been at a bound: whether that was most of the last minute.
 *
 * Purpose: a correction at its bound is as good as none, and may stay there for hours while the twin is within tolerance, or lost for another reason. So it is told
 *          by itself, beside the state of the lock.
 * Minute:  of plant time, in ten blocks; it is judged at the end of each, once ten have passed. Told when it is more than half of the steps, over at less than a quarter.
 * Thread:  plain data; one thread at a time.
 */

enum { TL_BOUND_BLOCKS = 10 };

#define TL_BOUND_BLOCK (6 * TL_SECOND)

typedef enum tl_bound_turn { TL_BOUND_AS_BEFORE, TL_BOUND_REACHED, TL_BOUND_LEFT } tl_bound_turn;

/* Zeroed at first. */
typedef struct tl_bound_stay {
    int64_t block;   /* that of the last step, */
    uint32_t passed; /* and how many are over, TL_BOUND_BLOCKS at most */
    uint32_t steps[TL_BOUND_BLOCKS];
    uint32_t there[TL_BOUND_BLOCKS]; /* of them, at a bound */
    bool has_begun;
    bool is_told;
    tl_bound_turn turn; /* of the last step */
    double share;       /* as judged last */
} tl_bound_stay;

/* A step at this time, ns; times do not go back. */
void tl_bound_stay_step(tl_bound_stay *stay, tl_time time, bool is_there);

/* ---- The judge of the lock: whether the twin is where the plant is.
 *
 * Purpose: one place that says of a run, live or replayed, whether its twin can be believed: from how many tolerances
 *          each committed step was off, from Δu, from bounds, from the plant's qualities, and from what was found of the FMUs' rollback. Nothing else is looked at, so that a replay says the same.
 * Window:  a step proves nothing, and neither do twenty in a row: a twin that is lost can be within tolerance at every second step. So shares
 *          of a window count, and how far off it is. The window is ten parts of 0.1 s each, or of two steps if they are longer; the
 *          state is judged at the end of each part. With an event horizon a step that counts is a stroke whose search has ended.
 * Runaway: one step is enough if an output is further from its measurement than any measurement can resolve, or is no finite number, or a search's J is none.
 * Astray:  in a quarter of the window and more the twin is ten tolerances off, and in as much of it has gone so far in a single step, which the
 *          plant has not. No plant that is sampled fast enough does that, and no model of it, unless it is unstable. One that is off and goes its steady way is
 *          not astray: to begin anew would not make it a better model, and would lose what it has been through.
 * Limits:  each state is left at another limit than it is entered at, so that a twin between two of them does not chatter.
 * Usual:   what Δu is on average while the twin is in lock, learned over TL_LOCK_LEARNS parts before it is held against, and slowly ever after.
 * Yardstick: tolerances and weights are the configuration's. A second judge can use those of another configuration.
 * Thread:  plain data; one thread at a time.
 */

enum {
    TL_LOCK_PARTS = 10,            /* of a window */
    TL_LOCK_LEARNS = 100,          /* parts in lock, before Δu is held against what is usual */
    TL_SYNCHRONISER_MEMORY = 6000, /* parts over which the usual is an average, at most */
    TL_LOCK_PERIODS = 8,           /* steps: the longest limit cycle that is looked for */
    TL_LOCK_CAUSE = 200            /* bytes of a cause */
};

/* From where to where something has been. */
typedef struct tl_lock_range {
    double least, most;
} tl_lock_range;

/* What a part of the window has seen. */
typedef struct tl_lock_part {
    uint32_t steps;
    uint32_t free; /* that were not compared: nothing is adjusted, or no matched signal was good */
    uint32_t
        between; /* nor these, since no matched signal was good at their own instant, but the horizon that they come from had some */
    uint32_t outside; /* out of tolerance, */
    uint32_t far;     /* and by ten tolerances or more */
    uint32_t
        jumps; /* in which an output has gone that far from the step before, and further than its measurement goes */
    uint32_t ran_away;                /* in which an output, or J, was beyond all measure */
    uint32_t rests;                   /* with u at nominal since a twin that is left alone is nearer to the plant */
    uint32_t differed;                /* before which an FMU was found not to come back to where it was */
    double worst;                     /* tolerances */
    uint32_t samples;                 /* of the plant, */
    uint32_t bad[TL_MAX_SIGNALS];     /* and those that were not good, by signal */
    uint32_t at_bound[TL_MAX_ADJUST]; /* steps with u at a bound */
    uint32_t
        cycling[TL_MAX_ADJUST]
               [TL_LOCK_PERIODS + 1]; /* steps at which u was where it was that many steps ago, and elsewhere between */
    double correction[TL_MAX_ADJUST]; /* sum of |Δu| */
    tl_lock_range u[TL_MAX_ADJUST];
} tl_lock_part;

/* A change of the state, to be told once. */
typedef struct tl_lock_change {
    tl_lock_state to;
    char cause[TL_LOCK_CAUSE]; /* a sentence with the value and its limit */
} tl_lock_change;

/* Fields are private, but for `tolerances`, `stay` and `astray`. */
typedef struct tl_lock_monitor {
    const tl_config *config;
    const tl_lock_tolerances
        *tolerances; /* NULL: that of the configuration; may be set between two steps, and must stay */
    tl_account_adjust adjust[TL_MAX_ADJUST]; /* kinds, steps and bounds of the adjusted variables */
    uint32_t part_steps;
    uint32_t parts; /* that are complete, TL_LOCK_PARTS at most */
    uint32_t at;    /* index of the part at hand */
    tl_lock_part part[TL_LOCK_PARTS];
    double u[TL_LOCK_PERIODS + 1][TL_MAX_ADJUST];   /* of the last steps, the newest first, */
    double y[TL_MAX_MATCH], measured[TL_MAX_MATCH]; /* of the last step */
    double stride[TL_MAX_MATCH];                    /* the largest step of y_hat, fading */
    uint32_t u_count;                               /* as far as there were some */
    double usual[TL_MAX_ADJUST];                    /* |Δu| on average */
    tl_bound_stay stay[TL_MAX_ADJUST];              /* of those that are numbers */
    uint32_t learned;                               /* parts */
    bool judged;                                    /* there is a state */
    bool astray;                                    /* as judged last */
    uint64_t pending;                               /* steps that are in no state yet */
    tl_lock_tally tally;
    tl_lock_change change;
} tl_lock_monitor;

/* What a state is judged over first. */
typedef struct tl_lock_window {
    uint32_t strokes; /* that have ended (event horizon); 0: steps */
    tl_time time;     /* ns that they take; strokes: at most, and without what is between them */
} tl_lock_window;

tl_lock_window tl_lock_monitor_window(const tl_config *config);

/* `account` tells kinds, steps and bounds of what is adjusted. Both must stay, but for the account. */
void tl_lock_monitor_init(tl_lock_monitor *judge, const tl_config *config, const tl_account *account);

/* The twin has taken another tuning, and so has the configuration (tl_config_retune()): from the next step on. What was seen of the window stays. */
void tl_lock_monitor_retune(tl_lock_monitor *judge, const tl_tuning *tuning);

/* A sample as the twin was given it. */
void tl_lock_monitor_sample(tl_lock_monitor *judge, const tl_sample *sample);

/* A step of the run's own; what it has followed of an earlier one is passed over. One before which the FMUs began anew (TL_FLAG_RESET) begins a
 * window. The state has changed: how, until it changes again. Else NULL. */
const tl_lock_change *tl_lock_monitor_step(tl_lock_monitor *judge, const tl_record *record);

/* So far. A run that ended before its first window was full is judged by what there is of it; so is one in whose last steps an output ran away. */
void tl_lock_monitor_get(const tl_lock_monitor *judge, tl_lock_tally *tally);

/* ---- Bringing back a twin that is lost: when its FMUs shall begin anew.
 *
 * Purpose: a twin can get to where no correction leads back from; its FMUs then begin anew with their start values (tl_twin_reset()). That
 *          takes the judge's word that it is astray, and is not done for ever: each time it did not help the pause is twice as long.
 * Same:    it follows from records and samples alone, so that a replay does what the run did.
 * Thread:  plain data; that of the twin.
 */

/* Parts of the judge's window. */
enum { TL_LOCK_PAUSE_FIRST = 20, TL_LOCK_PAUSE_LAST = 6000 };

/* Fields are private. */
typedef struct tl_recovery {
    tl_lock_monitor judge;
    uint64_t windows; /* that were judged when it was looked at last */
    uint32_t pause;   /* parts after a reset; 0: there was none that is not forgotten */
    uint32_t passed;  /* since it */
    uint32_t well;    /* parts in lock, one after the other */
} tl_recovery;

/* As tl_lock_monitor_init(). With an event horizon a twin is never brought back: its steps are not compared. */
void tl_recovery_init(tl_recovery *recovery, const tl_config *config, const tl_account *account);

/* A step; its sample goes to the judge. True: the FMUs shall begin anew before the next one. *change as the judge says, or NULL. */
bool tl_recovery_step(tl_recovery *recovery, const tl_record *record, const tl_lock_change **change);

#endif
