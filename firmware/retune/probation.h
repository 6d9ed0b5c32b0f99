/* Probation: a new version is active for a limited time, and must prove that it works.
 *
 * Purpose: decides whether the probation continues, or the version is kept or rolled back. Pure
 *          logic: the caller passes the time and the state of the run.
 * Rolled back at once, if
 *          - the twin has failed, or was not running for TL_PROBATION_START without interruption;
 *          - too many deadlines were missed on probation: at least TL_PROBATION_MISSES, more than
 *            TL_PROBATION_MISS_PERCENT of the steps, and more than TL_PROBATION_MISS_TIMES times
 *            the share of the configuration before. Skipped ticks are not steps, because a restart
 *            skips all ticks of its gap;
 *          - the lock is lost for TL_PROBATION_LOST without interruption. The first
 *            TL_PROBATION_GRACE of the probation does not count, or only its first half if that is
 *            shorter. After a resume the same applies to the remaining time, because the twin may
 *            have just started;
 *          - the lock is lost for as long by the tolerances of the version before, and the version
 *            does not need a confirmation;
 *          - the plant's sources could not be opened for TL_PROBATION_SHUT without interruption.
 * Lock:    steps do not count while the plant's sources are not open.
 * Tolerances: the lock is evaluated by the tolerances and weights of the new version, and by those
 *             of the version before (lock_before). So a version with wider tolerances cannot pass
 *             only because they are wider.
 * End:     when the time is over, the version is kept if all of these are true; else it is rolled
 *          back:
 *          - it does not need a confirmation;
 *          - the twin runs, and the plant's sources are open;
 *          - the required share of the probation's steps was in lock, by both sets of tolerances;
 *          - the lock is not lost by the tolerances of the version before.
 * No lock: no lock is required if the twin has executed steps but none of them was evaluated (event
 *          horizon: no stroke has ended). But a matched signal must have been good at least once.
 * Confirmed: if a user confirms the version, it is kept at once.
 * Time:    only the time that the caller passes. The calendar time is not used, because a box
 *          without a battery-backed clock may start in 1970.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_RETUNE_PROBATION_H
#define TL_FIRMWARE_RETUNE_PROBATION_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/monitor/run_status.h"
#include "master/base/simtime.h"

enum {
    TL_PROBATION_WHY = 256,     /* bytes of `why` */
    TL_PROBATION_WIDENED = 128, /* bytes of `widened` */
    TL_PROBATION_MISSES = 3,
    TL_PROBATION_MISS_PERCENT = 1,
    TL_PROBATION_MISS_TIMES = 3,
    TL_PROBATION_LONGEST_S = 7 * 24 * 3600
};

/* Times of the rules above, ns. */
#define TL_PROBATION_GRACE (10 * TL_SECOND)
#define TL_PROBATION_LOST (2 * TL_SECOND)
#define TL_PROBATION_START (30 * TL_SECOND)
#define TL_PROBATION_SHUT (10 * TL_SECOND)

/* Terms of a probation. */
typedef struct tl_probation_terms {
    uint32_t given_s;    /* duration: 1 … TL_PROBATION_LONGEST_S */
    double require_lock; /* percent of the probation's steps in lock, 0 … 100; 0: not required */
    bool must_confirm;   /* kept only if a user confirms it */
} tl_probation_terms;

/* Progress of a probation: all that is saved on disk, and enough to resume it. */
typedef struct tl_probation_account {
    tl_probation_terms terms;
    uint64_t before_steps, before_misses; /* of the configuration before */
    uint64_t left_ms;                     /* remaining time */
    uint64_t steps, misses, skipped;      /* on probation */
    tl_lock_tally lock, lock_before;      /* evaluated steps only; lock_before: by `tolerances` */
    tl_lock_tolerances tolerances;        /* of the version before, in the order of the new outputs; zeroed: none */
    char widened
        [TL_PROBATION_WIDENED]; /* "motor.omega: tolerance 1 → 3": the first output with a wider tolerance than before; "": none */
} tl_probation_account;

typedef enum tl_probation_result { TL_PROBATION_CONTINUES, TL_PROBATION_KEPT, TL_PROBATION_RETURN } tl_probation_result;

typedef struct tl_probation {
    tl_probation_account account;
    tl_probation_result result;
    char why[TL_PROBATION_WHY]; /* "in lock in 97.2 % of the steps (required 95 %)"; "": it continues */
    /* private */
    bool has_last;
    tl_run_status last;
    tl_time left, grace, lost, down; /* ns */
    tl_time lost_before;             /* as `lost`, by the tolerances before */
    tl_time shut;
} tl_probation;

/* Begins a probation. `before`: the newest state of the configuration before. `now`: the state
 * from which counts are measured; NULL: another run or twin starts, with all counts at 0. */
void tl_probation_begin(tl_probation *probation, const tl_probation_terms *terms, const tl_run_status *before,
                        const tl_run_status *now);

/* Resumes a probation after a restart of the config manager or of the box. Limits the saved times
 * and percentages to their valid ranges. The downtime is unknown, so counting continues from the
 * first state that tl_probation_feed() receives. */
void tl_probation_resume(tl_probation *probation, const tl_probation_account *account);

/* Evaluates the state `now`, `passed` ns after the previous call. After the probation has ended, it
 * always returns the same result. */
tl_probation_result tl_probation_feed(tl_probation *probation, tl_time passed, const tl_run_status *now);

/* Ends the probation with the decision of a user: TL_PROBATION_KEPT or TL_PROBATION_RETURN. Does
 * nothing if it has already ended. Returns the result of the probation. */
tl_probation_result tl_probation_decide(tl_probation *probation, tl_probation_result result, const char *why);

/* Returns true if too many deadlines were missed by the rule above. `…_before`: counts of the
 * configuration before. */
bool tl_probation_is_too_many(uint64_t misses, uint64_t steps, uint64_t misses_before, uint64_t steps_before);

/* Returns true if the lock was lost by the tolerances of the version before, in the last state that
 * tl_probation_feed() received. */
bool tl_probation_was_lost_before(const tl_probation *probation);

#endif
