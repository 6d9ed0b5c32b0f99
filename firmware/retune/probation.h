/* Probation: a new configuration is in force for a given time, and has to show that it is right.
 *
 * Purpose: whether it goes on, is kept or is returned from. Pure logic: time and figures are handed in, nothing is asked and nothing written.
 * Returned from at once:
 *          - the twin has failed, or does not run for TL_PROBATION_START without a break;
 *          - deadlines: TL_PROBATION_MISSES and more were missed on probation, and that is more than TL_PROBATION_MISS_PERCENT of its steps, and more
 *            than TL_PROBATION_MISS_TIMES the share that the configuration before has missed. Ticks that were skipped are no steps: of those, a
 *            restart has as many as its gap was long;
 *          - the lock is lost for TL_PROBATION_LOST without a break. In the first TL_PROBATION_GRACE, or half of its time if that is
 *            less, that does not count; nor again after it was resumed, since a twin may just have begun.
 *          - the lock is lost for as long by the yardstick before, and nobody must confirm it;
 *          - the plant's sources could not be opened for TL_PROBATION_SHUT.
 * Lock:    steps do not count as long as the plant's sources are not opened.
 * Yardstick: the lock is judged by the tolerances and weights of the new version, and by those of the version that is returned to (lock_before). So a wider
 *          tolerance does not decide on itself.
 * When the time is over: kept if nobody must confirm it, the twin runs, and the asked share of the probation's steps was in lock by both yardsticks, and the lock is not lost by the one before; else returned from. If it has computed steps and none of them was judged (event
 *          horizon: no stroke has ended), its lock is not asked, if a matched signal was good at least once.
 * Confirmed: kept at once.
 * Time:    the time that was handed in; a box may come up in 1970.
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

/* What is asked. */
typedef struct tl_probation_terms {
    uint32_t given_s;    /* 1 … TL_PROBATION_LONGEST_S */
    double require_lock; /* percent of the probation's steps in lock, 0 … 100; 0: not asked */
    bool must_confirm;   /* kept only if somebody confirms it */
} tl_probation_terms;

/* What a probation has come to: all that is kept of it on disk, and enough to go on with it. */
typedef struct tl_probation_account {
    tl_probation_terms terms;
    uint64_t before_steps, before_misses; /* of the configuration before */
    uint64_t left_ms;
    uint64_t steps, misses, skipped; /* on probation; */
    tl_lock_tally lock, lock_before; /* only the steps that were judged, and these by the yardstick before; */
    tl_lock_tolerances tolerances; /* which is this, in the order of the new version's outputs; zeroed: there is none */
    char widened
        [TL_PROBATION_WIDENED]; /* "motor.omega: tolerance 1 → 3": the first output that it judges more strictly; "": none */
} tl_probation_account;

typedef enum tl_probation_result { TL_PROBATION_GOES_ON, TL_PROBATION_KEPT, TL_PROBATION_RETURN } tl_probation_result;

typedef struct tl_probation {
    tl_probation_account account;
    tl_probation_result result;
    char why[TL_PROBATION_WHY]; /* "in lock for 97.2 % of the steps, asked were 95 %"; "": it goes on */
    /* private */
    bool has_last;
    tl_run_status last;
    tl_time left, grace, lost, down; /* ns */
    tl_time lost_before;             /* as `lost`, by the yardstick before */
    tl_time shut;
} tl_probation;

/* `before`: the configuration before, as it was at the end, or is. `now`: what counts from here on begins with; NULL: a run that has
 * not begun yet, all counts at 0. */
void tl_probation_begin(tl_probation *probation, const tl_probation_terms *terms, const tl_run_status *before,
                        const tl_run_status *now);

/* After a new start of whoever keeps it, or of the box: what was kept is taken as far as it can be true. What has happened meanwhile is not known: counting
 * goes on with the first snapshot. */
void tl_probation_resume(tl_probation *probation, const tl_probation_account *account);

/* So much time has passed since the last call, and this is how the twin is now. Once it is kept or returned from it stays so. */
tl_probation_result tl_probation_feed(tl_probation *probation, tl_time passed, const tl_run_status *now);

/* A user keeps the version, or returns from it. No effect if the probation has ended. Returns how it ended. */
tl_probation_result tl_probation_decide(tl_probation *probation, tl_probation_result result, const char *why);

/* The rule of missed deadlines: so many of so many steps are too many, after so many of so many before. */
bool tl_probation_is_too_many(uint64_t misses, uint64_t steps, uint64_t misses_before, uint64_t steps_before);

/* By the yardstick before, the lock was lost when it was looked at last. */
bool tl_probation_is_lost_before(const tl_probation *probation);

#endif
