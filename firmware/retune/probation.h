/* Probation: a new version is active for a limited time, and is then kept or rolled back
 * (versions.h).
 *
 * Purpose: decides whether the probation continues, or the version is kept or rolled back. Pure
 *          logic: the caller passes the time and the state of the run.
 * Rolled back at once, if
 *          - the twin has failed, or did not run for 30 s (TL_PROBATION_START) without
 *            interruption;
 *          - too many deadlines were missed on probation: at least 3 (TL_PROBATION_MISSES), and
 *            more than 1 % of the steps (TL_PROBATION_MISS_PERCENT), and more than 3 times
 *            (TL_PROBATION_MISS_TIMES) the share of the previous version. Skipped ticks are not
 *            steps, because a restart skips all ticks of its gap;
 *          - the lock is lost for 2 s (TL_PROBATION_LOST) without interruption. The first 10 s
 *            (TL_PROBATION_GRACE) do not count; in a probation under 20 s, the first half. The same
 *            holds after a resume of the probation, for 10 s or half of the remaining time, because
 *            the twin may have just started;
 *          - the lock is lost for 2 s in the same way, but by the tolerances of the previous
 *            version, and the new version needs no confirmation;
 *          - the plant's sources could not be opened for 10 s (TL_PROBATION_SHUT) without
 *            interruption.
 * Lock:    steps while the plant's sources are not open do not count for the lock.
 * Tolerances: the lock is evaluated with the tolerances and weights of the new version, and with
 *             those of the previous version (lock_before). So a version with wider tolerances
 *             cannot pass only because they are wider.
 * End:     when the time is over, the version is kept if all of these are true; else it is rolled
 *          back:
 *          - it does not need a confirmation;
 *          - the twin runs, and the plant's sources are open;
 *          - with each of the two sets of tolerances, the share of the probation's steps in lock
 *            reaches `require_lock`;
 *          - at the end, the lock is not lost with the tolerances of the previous version.
 * No lock: the lock is not required if no step could be evaluated, although the twin has executed
 *          more steps than it skipped ticks. With an event horizon, for example, no stroke has
 *          ended. But a matched signal must have been good at least once.
 * Confirmed: if a user confirms the version, the version is kept at once.
 * Time:    only the durations that the caller passes. The calendar time is not used, because a box
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
    TL_PROBATION_LONGEST_S = 7 * 24 * 3600 /* longest probation, s */
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
    bool must_confirm;   /* the version is kept only if a user confirms it */
} tl_probation_terms;

/* Progress of a probation, as saved on disk: all that is needed to resume it. */
typedef struct tl_probation_account {
    tl_probation_terms terms;
    uint64_t before_steps, before_misses; /* steps and missed deadlines of the previous version, for comparison */
    uint64_t left_ms;                     /* remaining time, ms */
    uint64_t steps, misses, skipped;      /* on probation: steps, missed deadlines, skipped ticks */
    tl_lock_tally lock, lock_before;      /* counts of the evaluated steps: by the new tolerances; by `tolerances` */
    tl_lock_tolerances tolerances;        /* of the previous version, in the order of the new outputs; zeroed: none */
    char widened
        [TL_PROBATION_WIDENED]; /* "motor.omega: tolerance 1 → 3": the first output with a wider tolerance than before; "": none */
} tl_probation_account;

typedef enum tl_probation_result {
    TL_PROBATION_CONTINUES,
    TL_PROBATION_KEPT,
    TL_PROBATION_ROLLED_BACK
} tl_probation_result;

typedef struct tl_probation {
    tl_probation_account account;
    tl_probation_result result;
    char why[TL_PROBATION_WHY]; /* of `result`: "in lock in 97.2 % of the steps (required 95 %)"; "": it continues */
    /* private */
    bool has_last;
    tl_run_status last;
    tl_time left, grace, lost, down; /* ns: remaining; remaining of the grace; lock lost; twin not running */
    tl_time lost_before;             /* as `lost`, with the previous version's tolerances */
    tl_time shut;                    /* ns: how long the sources are not open */
} tl_probation;

/* Begins a probation. `before`: newest state with the previous version. `now`: state from which
 * counting starts, if the same twin continues; NULL: another twin or run, with counts at 0. */
void tl_probation_begin(tl_probation *probation, const tl_probation_terms *terms, const tl_run_status *before,
                        const tl_run_status *now);

/* Resumes a probation after a restart of the config manager or of the box. Limits the saved times
 * and percentages to their valid ranges. How long neither ran is unknown, so counting continues
 * from the first state that tl_probation_feed() receives. */
void tl_probation_resume(tl_probation *probation, const tl_probation_account *account);

/* Evaluates the state `now` of the run, `passed` ns after the previous call. After the probation
 * has ended, always returns the same result. */
tl_probation_result tl_probation_feed(tl_probation *probation, tl_time passed, const tl_run_status *now);

/* Ends the probation with the decision of a user: TL_PROBATION_KEPT or TL_PROBATION_ROLLED_BACK.
 * Does nothing if it has already ended. Returns the result of the probation. */
tl_probation_result tl_probation_decide(tl_probation *probation, tl_probation_result result, const char *why);

/* Returns true if by the rule above too many deadlines were missed. `…_before`: counts of the
 * previous version. */
bool tl_probation_is_too_many(uint64_t misses, uint64_t steps, uint64_t misses_before, uint64_t steps_before);

/* Returns true if the lock is lost by the previous version's tolerances, in the last state that
 * tl_probation_feed() received. */
bool tl_probation_is_lost_by_previous(const tl_probation *probation);

#endif
