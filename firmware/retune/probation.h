/* Probation: a new version is active for a limited time, and must prove that it works.
 *
 * Purpose: decides whether the probation continues, or the version is kept or rolled back. Pure
 *          logic: the caller passes the time and the state of the run.
 * Rolled back at once, if
 *          - the twin has failed, or has not run for TL_PROBATION_START without a break;
 *          - at least TL_PROBATION_MISSES deadlines were missed on probation. This must be more
 *            than TL_PROBATION_MISS_PERCENT of its steps, and more than TL_PROBATION_MISS_TIMES the
 *            share that the configuration before missed. Skipped ticks are not steps, because a
 *            restart skips all ticks of its gap;
 *          - the lock is lost for TL_PROBATION_LOST without a break. The first TL_PROBATION_GRACE
 *            does not count, or the first half of the time if that is shorter. After a
 *            resume this exception applies again, because the twin may have just started;
 *          - the lock is lost for as long by the tolerances before, and no user has to confirm the
 *            version;
 *          - the plant's sources could not be opened for TL_PROBATION_SHUT.
 * Lock:    steps do not count while the plant's sources are not open.
 * Tolerances: the lock is evaluated by the tolerances and weights of the new version, and by those
 *             of the version before (lock_before). So a version with wider tolerances cannot pass
 *             only because they are wider.
 * End:     when the time is over, the version is kept if all of these are true; else it is rolled
 *          back:
 *          - no user has to confirm it;
 *          - the twin runs, and the plant's sources are open;
 *          - the required share of the probation's steps was in lock, by both sets of tolerances;
 *          - the lock is not lost by the tolerances before.
 * No lock: if the twin has executed steps and none of them was evaluated (event horizon: no stroke
 *          has ended), no lock is required. But a matched signal must have been good at least once.
 * Confirmed: the version is kept at once.
 * Time:    only the time that the caller passes, because a box without a clock may start in 1970.
 * Thread:  plain data.
 */
#ifndef TL_FIRMWARE_RETUNE_PROBATION_H
#define TL_FIRMWARE_RETUNE_PROBATION_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/monitor/run_status.h"
#include "master/base/simtime.h"

enum {
    TL_PROBATION_WHY = 256,
    TL_PROBATION_WIDENED = 128,
    TL_PROBATION_MISSES = 3,
    TL_PROBATION_MISS_PERCENT = 1,
    TL_PROBATION_MISS_TIMES = 3,
    TL_PROBATION_LONGEST_S = 7 * 24 * 3600
};

#define TL_PROBATION_GRACE (10 * TL_SECOND)
#define TL_PROBATION_LOST (2 * TL_SECOND)
#define TL_PROBATION_START (30 * TL_SECOND)
#define TL_PROBATION_SHUT (10 * TL_SECOND)

/* Terms of a probation. */
typedef struct tl_probation_terms {
    uint32_t given_s;    /* 1 … TL_PROBATION_LONGEST_S */
    double require_lock; /* percent of the probation's steps in lock, 0 … 100; 0: not required */
    bool must_confirm;   /* kept only if a user confirms it */
} tl_probation_terms;

/* Progress of a probation: all that is saved on disk, and enough to resume it. */
typedef struct tl_probation_account {
    tl_probation_terms terms;
    uint64_t before_steps, before_misses; /* of the configuration before */
    uint64_t left_ms;
    uint64_t steps, misses, skipped; /* on probation */
    tl_lock_tally lock, lock_before; /* only steps that were evaluated; lock_before: by the tolerances before, */
    tl_lock_tolerances tolerances;   /* which are these, in the order of the new version's outputs; zeroed: none */
    char widened
        [TL_PROBATION_WIDENED]; /* "motor.omega: tolerance 1 → 3": the first output with a narrower tolerance before; "": none */
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

/* Begins a probation. `before`: the newest state of the configuration before. `now`: the state from
 * which counts are measured; NULL: the run has not started yet, and all counts are 0. */
void tl_probation_begin(tl_probation *probation, const tl_probation_terms *terms, const tl_run_status *before,
                        const tl_run_status *now);

/* Resumes a probation after a restart of the config manager or of the box. Limits all saved values
 * to their valid ranges. The time between is unknown, so counting continues with the first state
 * that is passed. */
void tl_probation_resume(tl_probation *probation, const tl_probation_account *account);

/* Evaluates the state `now`, `passed` ns after the previous call. Once the version is kept or
 * rolled back, the result stays. */
tl_probation_result tl_probation_feed(tl_probation *probation, tl_time passed, const tl_run_status *now);

/* Keeps the version or rolls it back, as a user decided. Does nothing if the probation has ended.
 * Returns how it ended. */
tl_probation_result tl_probation_decide(tl_probation *probation, tl_probation_result result, const char *why);

/* True if so many deadlines were missed that the version is rolled back: the rule above.
 * `…_before`: of the configuration before. */
bool tl_probation_is_too_many(uint64_t misses, uint64_t steps, uint64_t misses_before, uint64_t steps_before);

/* True if the lock was lost by the tolerances before, in the state passed last. */
bool tl_probation_was_lost_before(const tl_probation *probation);

#endif
