/* Free-run check: compares the corrected twin with a twin that runs without corrections.
 *
 * Thread:  the one that steps the twin.
 */
#ifndef TL_MASTER_SYNC_FREE_TWIN_H
#define TL_MASTER_SYNC_FREE_TWIN_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/signal.h"
#include "master/base/status.h"
#include "master/graph/exchange.h"
#include "master/graph/snapshot.h"
#include "master/sync/objective.h"
#include "master/sync/record.h"

/* ---- Which twin is nearer to the plant: the locked one or the free-running one.
 *
 * Purpose: a locked twin follows the measurements with their noise. If the model is right,
 *          corrections do harm. That is not visible in y − ŷ, because the locked twin has used
 *          these same measurements. So the gain from using them is subtracted.
 * Method:  n is the noise of a measurement ŷ, L the output of the locked twin, F that of the
 *          free-running twin, which is independent of n, and x the true value of the plant. The
 *          harm is
 *            E(L − x)² − E(F − x)² = E(L − ŷ)² − E(F − ŷ)² + 2·E(L − x)·n,
 *          and its last term is 2·g·s²: the noise s² = E n² times the share g of it that the lock
 *          follows. Both are estimated from predictions P. A prediction starts at a committed
 *          instant, runs with nominal u, and ends when the measurements used at its start no longer
 *          matter. There L − P is the share g of ŷ − P. The noise at the start has opposite signs
 *          in the errors of two predictions in a row:
 *            s² = E(L − ŷ)·(P − ŷ) − E(P − ŷ)·(P' − ŷ'),    P': the prediction before.
 *          A model error is in one of the predictions, or lasts; a lasting error is subtracted from
 *          both. A model error that swings as fast as predictions follow each other would look like
 *          noise. So noise is limited to half a tolerance (a tolerance should be three times the
 *          noise, see config/SPEC.md).
 *          These are averages over minutes. If the recent average differs by more than three
 *          standard errors, the older one is dropped.
 * Verdict: over the last TL_FREE_RUN_CHECK_TRIALS trials and the known noise: u rests at nominal if
 *          the harm is above zero by 1.5 standard errors. It rests until the resting twin is
 *          further off than a locked one would be: by the same margin over these trials, or by a
 *          large one at once.
 * Bounded: an error counts as 3 tolerances at most, so that no outlier decides.
 * Source:  not the dissertation: the covariance penalty of statistics, and the correlation of
 *          innovations that adaptive filters use.
 * Thread:  plain data; one thread at a time.
 */

enum {
    TL_FREE_RUN_CHECK_TRIALS = 50,   /* trials that are remembered */
    TL_FREE_RUN_CHECK_LEAST = 20,    /* fewer trials decide nothing */
    TL_FREE_RUN_CHECK_MEMORY = 1000, /* the noise is averaged over at most this many trials */
    TL_FREE_RUN_CHECK_RECENT = 50,   /* and the recent noise over these */
    TL_FREE_RUN_CHECK_LOST = 6       /* memories in a row that were lost: the free-running twin is useless */
};

/* Error of each matched output after a step, in tolerances times the root of its weight; 0 if there
 * is no good measurement. A value that is not finite counts as the largest error. */
typedef struct tl_free_run_check_errors {
    double locked[TL_MAX_MATCH]; /* of the twin, locked or resting */
    double free[TL_MAX_MATCH];
    double predicted[TL_MAX_MATCH]; /* meaningless while u rests */
    double weight;                  /* Σ weights of all outputs, measured or not */
} tl_free_run_check_errors;

/* Means of squares over one trial. */
typedef struct tl_free_run_check_trial {
    double locked;
    double free;
} tl_free_run_check_trial;

/* Decaying average of a value and of its square. */
typedef struct tl_free_run_check_average {
    double mean;
    double square;
} tl_free_run_check_average;

/* Known noise, averaged over `count` trials. */
typedef struct tl_free_run_check_noise {
    tl_free_run_check_average locked;   /* E(L − ŷ)² */
    tl_free_run_check_average surprise; /* E(P − ŷ)² */
    tl_free_run_check_average kept;     /* E(L − ŷ)·(P − ŷ) */
    tl_free_run_check_average noise;    /* s² */
    uint32_t count;
} tl_free_run_check_noise;

/* Result of a step. */
typedef struct tl_free_run_check_verdict {
    bool predict; /* the next prediction starts at the instant committed last */
    bool turned;  /* u has started or stopped to rest */
    bool adopt;   /* the state of the free-running twin is lastingly better: the twin continues from it */
    bool renew;   /* the free-running twin restarts from the twin's state */
} tl_free_run_check_verdict;

/* Fields are private, except `rests`. Starts as zeros, except `guard`. */
typedef struct tl_free_run_check {
    uint32_t guard; /* steps of a trial and of a prediction, ≥ 1 */
    double weight;  /* as in the errors of the current step */
    bool rests;
    bool follows; /* `before` is the error of the previous prediction */
    double before[TL_MAX_MATCH];
    double lasting[TL_MAX_MATCH]; /* mean error of the predictions before that one: the model's error, not noise */
    uint32_t steps;               /* of the current trial */
    uint32_t counted;
    tl_free_run_check_trial sum;
    tl_free_run_check_trial trial[TL_FREE_RUN_CHECK_TRIALS];
    uint32_t count; /* trials remembered */
    uint32_t at;    /* where the next trial is stored */
    uint32_t since; /* trials since a whole memory was lost */
    uint32_t lost;  /* such memories in a row */
    tl_free_run_check_noise known;
    tl_free_run_check_noise recent; /* of the newest trials only: replaces `known` if conditions have changed */
    double excess;                  /* how much further off the resting twin was than a locked one, summed */
} tl_free_run_check;

/* Evaluates a committed step. `measured`: false if no output had a good measurement. */
tl_free_run_check_verdict tl_free_run_check_step(tl_free_run_check *contest, const tl_free_run_check_errors *errors,
                                                 bool measured);

/* Restarts the predictions and drops their history; u does not rest. The known noise stays. */
void tl_free_run_check_reset(tl_free_run_check *contest);

/* Archives all but `guard`. */
void tl_free_run_check_archive(tl_free_run_check *contest, tl_archive *archive);

/* ---- The free-running twin: the same co-simulation without corrections, beside the locked one.
 *
 * Purpose: a lock must do no harm over time. So its use of the measurements is compared with a twin
 *          that never sees them. If that one predicts better, u rests at nominal. If its state is
 *          the better one, the twin continues from it.
 * Method:  in the FMUs of the twin itself. After each committed step they are set to the state of
 *          the free-running twin and back; while u does not rest, also to that of a prediction.
 *          Each of the two executes all components once per step with nominal u. No other count
 *          includes these executions.
 * States:  three of each FMU: free-running twin, prediction, and the twin's own meanwhile.
 * Not for: FMUs that are rolled back by replay. Each rollback would repeat the whole run.
 * Thread:  the twin's. Memory: the arena, at start-up; the states belong to the FMUs.
 */

/* Fields are private, except `counts`. Zeroed: there is no free-running twin. */
typedef struct tl_free_twin {
    tl_exchange *exchange;
    const tl_objective *objective;
    bool is_led;
    bool predicts; /* `predicted` holds a prediction; else one is to start */
    tl_snapshot free;
    tl_snapshot predicted;
    tl_free_run_check contest;
    uint64_t *executions; /* of each component, saved while steps are executed that do not count */
    tl_free_twin_counts counts;
} tl_free_twin;

/* For an exchange that is initialised. `guard`: steps until a prediction is independent of the
 * measurements used at its start; 0: no free-running twin. Returns false if memory is out. */
bool tl_free_twin_init(tl_free_twin *twin, tl_arena *arena, tl_exchange *exchange, const tl_objective *objective,
                       uint32_t guard);

/* Starts both at the committed instant; u does not rest. Also called after the FMUs were reset, or
 * if their states have become invalid. */
tl_status tl_free_twin_begin(tl_free_twin *twin, tl_error *error);

/* Follows a committed step with its complete record. Leaves the FMUs where they were; or, with
 * `adopt` in the verdict, in the state of the free-running twin with its values in all ports. Then
 * the caller resets the caches. Errors: TL_FMU_FAILED or TL_FMU_FATAL if a rollback fails. */
tl_status tl_free_twin_follow(tl_free_twin *twin, const tl_record *record, tl_free_run_check_verdict *verdict,
                              tl_error *error);

/* True if u rests from the next step on. */
bool tl_free_twin_rests(const tl_free_twin *twin);

/* Drops what was learned with other tolerances or bounds; u does not rest. */
void tl_free_twin_retune(tl_free_twin *twin);

/* Archives all data and both states. Loading calls the FMUs only to deserialise states. */
tl_status tl_free_twin_archive(tl_free_twin *twin, tl_archive *archive, tl_error *error);

/* Frees a component's states, before the component is freed or if they have become invalid.
 * tl_free_twin_begin() creates others. */
void tl_free_twin_end_component(tl_free_twin *twin, size_t component);

#endif
