/* What a cycle is made of.
 *
 * Purpose: private to cycle.c (its ticks), cycle_tuning.c (another tuning) and cycle_flip.c (from one place to the other).
 */
#ifndef TL_FIRMWARE_TWIN_CYCLE_PARTS_H
#define TL_FIRMWARE_TWIN_CYCLE_PARTS_H

#include "firmware/base/latest.h"
#include "firmware/monitor/lock_rescue.h"
#include "firmware/twin/checkpointer.h"
#include "firmware/twin/cycle.h"
#include "firmware/twin/watch.h"

/* A flip that was announced. */
typedef struct tl_cycle_flip {
    uint32_t number; /* of the newest that was seen */
    bool is_ahead;   /* it is of this cycle's concern, and is still to come: */
    int64_t tick;    /* from this tick on */
} tl_cycle_flip;

struct tl_cycle {
    tl_cycle_settings settings;
    tl_heart *heart;
    tl_time start;      /* t_0 */
    int64_t next_tick;  /* not yet computed */
    int64_t warm_up;    /* ticks at which no step is due yet, or none that counts */
    int64_t first_step; /* that counts */
    int64_t last_tick;  /* after it the duration is over */
    bool stop;
    bool is_shadow;
    bool is_behind; /* a shadow that has not been at the plant's ticks yet */
    bool has_run;   /* a run has begun in the outbox, and has not ended */
    tl_cycle_flip flip;
    tl_resumption resumption; /* how the run began that a flip brings */
    uint64_t skipped;         /* ticks in all, */
    bool has_skipped;         /* and the newest */
    bool has_begun;           /* the twin has, and is silent no longer than a cycle may be */
    tl_summary summary;
    tl_watch watch;
    tl_lock_rescue rescue;
    tl_lock_judge
        second; /* judges the same steps by the yardstick of the version that a probation may return to, if there is one */
    tl_lock_yardstick yardstick; /* of it */
    tl_checkpointer checkpointer;
    uint32_t tuned;       /* number of the tuning that was looked at last */
    bool was_tuned;       /* what is in force is not what the twin was built with, but */
    tl_run_tuning tuning; /* this: as taken last, */
    bool has_tuning;      /* and not in the outbox yet */
    tl_status status;
    tl_error error;
    tl_cycle_status shown;
    tl_latest published; /* the same, for other threads */
};

/* ---- cycle_tuning.c ---- */

/* At the start of a tick. */
void tl_cycle_look_for_tuning(tl_cycle *cycle);

/* A run ends, and the twin goes on: what is in force, whether this cycle took it or what it goes on with had it, is kept for a run that may come. */
void tl_cycle_keep_in_force(tl_cycle *cycle);

/* A run begins after the twin was built: what is in force goes into it with its first sample, if the twin was not built with it. */
void tl_cycle_put_in_force(tl_cycle *cycle);

/* At the start of a tick: by which yardstick the second judge judges. */
void tl_cycle_look_for_yardstick(tl_cycle *cycle);

/* Both judges begin anew. */
void tl_cycle_begin_judges(tl_cycle *cycle, const tl_account *account);

/* ---- cycle_flip.c ---- */

/* How much later than the run's instant the next tick begins: who is the shadow at it lets the other go first. */
tl_time tl_cycle_delay(const tl_cycle *cycle);

/* At the start of a tick. */
void tl_cycle_look_for_flip(tl_cycle *cycle);

/* Before and after a tick is computed, `budget` NULL: it was made up. Errors: an FMU cannot be led back to where it is to be saved; the twin is over. */
tl_status tl_cycle_before_tick(tl_cycle *cycle);
tl_status tl_cycle_after_tick(tl_cycle *cycle, int64_t tick, const tl_budget *budget);

/* Mode ahead: the last record of a run that ends by a flip is complete with this sample, and both are put. */
void tl_cycle_hand_over_with(tl_cycle *cycle);

/* Nothing is missed any more: the next tick is at its time. */
void tl_cycle_be_live(tl_cycle *cycle);

#endif
