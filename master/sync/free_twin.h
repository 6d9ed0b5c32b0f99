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
#include "master/sync/side_twin.h"

/* ---- Free-run check: is the locked twin nearer to the plant, or the free-running one?
 *
 * Purpose: a locked twin follows the measurements with their noise. If the model is right,
 *          corrections increase its distance from the plant: the harm. The harm is not visible in
 *          y − ŷ, because the locked twin has used these same measurements. The term 2·g·s² below
 *          accounts for that.
 * Method:  n is the noise of a measurement ŷ, and x the true value of the plant. L is the output of
 *          the locked twin. F is the output of the free-running twin; it is independent of n. The
 *          harm is
 *            E(L − x)² − E(F − x)² = E(L − ŷ)² − E(F − ŷ)² + 2·E(L − x)·n.
 *          The last term is 2·g·s². s² = E n² is the noise; g is the share of the noise that the
 *          locked twin follows. Both are estimated from predictions P. A prediction starts at a
 *          committed instant, runs with nominal u, and ends when the measurements used at its start
 *          no longer matter. At its end, L − P is the share g of ŷ − P. The noise at the start has
 *          opposite signs in the errors of two consecutive predictions:
 *            s² = E(L − ŷ)·(P − ŷ) − E(P − ŷ)·(P' − ŷ'),    P': the prediction before.
 *          A lasting model error is in both predictions; it is subtracted from both. A model error
 *          that oscillates with the period of the predictions would look like noise. So noise is
 *          limited to half a tolerance (a tolerance should be three times the noise, see
 *          config/SPEC.md).
 *          These are averages over minutes. If the recent average shows by three standard errors
 *          that conditions have changed, it replaces the older one.
 * Trial:   `guard` steps in a row. It counts if at least half of them had a good measurement.
 * Verdict: from the last TL_FREE_RUN_CHECK_TRIALS trials and the known noise. u starts resting at
 *          nominal if the harm is above zero by 1.5 standard errors. u stops resting if the resting
 *          twin's error is larger than a locked twin's would be: by 1.5 standard errors over these
 *          trials, or by much in a few trials.
 * Bounded: an error counts as 3 tolerances at most, so that no outlier decides.
 * Source:  not the dissertation: the covariance penalty of statistics, and the correlation of
 *          innovations that adaptive filters use.
 * Thread:  plain data; one thread at a time.
 */

enum {
    TL_FREE_RUN_CHECK_TRIALS = 50,   /* trials that are remembered */
    TL_FREE_RUN_CHECK_LEAST = 20,    /* with fewer trials there is no decision */
    TL_FREE_RUN_CHECK_MEMORY = 1000, /* the noise is averaged over at most this many trials */
    TL_FREE_RUN_CHECK_RECENT = 50,   /* the recent noise is averaged over this many trials */
    TL_FREE_RUN_CHECK_LOST = 6 /* the free-running twin restarts if it is worse in 6 rings of 50 trials in a row */
};

/* Error of each matched output after a step: √weight·(y − ŷ)/tolerance; 0 if there is no good
 * measurement. A value that is not finite counts as the largest error. */
typedef struct tl_free_run_check_errors {
    double locked[TL_MAX_MATCH];    /* of the twin, locked or resting */
    double free[TL_MAX_MATCH];      /* of the free-running twin */
    double predicted[TL_MAX_MATCH]; /* of the prediction; undefined while u rests */
    double weight;                  /* Σ weights of all outputs, measured or not */
} tl_free_run_check_errors;

/* Mean of the sum of squared errors over one trial. */
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
    bool turned;  /* u has started or stopped resting at nominal */
    bool adopt;   /* the state of the free-running twin has long been better: the twin continues from it */
    bool renew;   /* the free-running twin restarts from the twin's state */
} tl_free_run_check_verdict;

/* Fields are private, except `rests`. Starts as zeros, except `guard`. */
typedef struct tl_free_run_check {
    uint32_t guard;               /* steps of a trial and of a prediction, ≥ 1 */
    double weight;                /* as in the errors of the current step */
    bool rests;                   /* u rests at nominal */
    bool follows;                 /* `before` is valid */
    double before[TL_MAX_MATCH];  /* error of the previous prediction */
    double lasting[TL_MAX_MATCH]; /* mean error of the predictions before `before`: the lasting model error */
    uint32_t steps;               /* of the current trial */
    uint32_t counted;             /* of these, steps with a good measurement */
    tl_free_run_check_trial sum;
    tl_free_run_check_trial trial[TL_FREE_RUN_CHECK_TRIALS];
    uint32_t count; /* trials remembered */
    uint32_t at;    /* index of the next trial in the ring `trial` */
    uint32_t since; /* trials since `lost` was updated last */
    uint32_t lost;  /* rings in a row over which the free-running twin was worse */
    tl_free_run_check_noise known;
    tl_free_run_check_noise recent; /* of the newest trials only: replaces `known` if conditions have changed */
    double excess;                  /* sum of the resting twin's errors beyond the allowed ones, ≥ 0 */
} tl_free_run_check;

/* Evaluates a committed step. `measured`: false if no output had a good measurement. */
tl_free_run_check_verdict tl_free_run_check_step(tl_free_run_check *free_run_check,
                                                 const tl_free_run_check_errors *errors, bool measured);

/* Restarts the predictions and drops their history; u does not rest. The known noise stays. */
void tl_free_run_check_reset(tl_free_run_check *free_run_check);

/* Saves or loads all data except `guard`. */
void tl_free_run_check_archive(tl_free_run_check *free_run_check, tl_archive *archive);

/* ---- The free-running twin: the same co-simulation without corrections, beside the locked one.
 *
 * Purpose: synchronisation must do no harm over time. So the twin is compared with a twin that is
 *          never corrected. If the free-running twin predicts the plant better, u rests at nominal.
 *          If its state has been better for long, the twin continues from this state.
 * Method:  both use the FMUs of the twin itself. After each committed step, the FMUs are set to the
 *          state of the free-running twin and execute one step with nominal u. If u does not rest,
 *          the same follows with the state of a prediction. Then the twin's own state is restored.
 *          No other count includes these executions.
 * States:  three of each FMU: of the free-running twin, of the prediction, and the twin's own.
 * Not for: FMUs that are rolled back by replay. Each rollback would repeat the whole run.
 * Thread:  the twin's. Memory: the arena, at start-up; states: fmi/component.h.
 */

/* Fields are private, except `counts`. Zeroed: there is no free-running twin. */
typedef struct tl_free_twin {
    tl_side_twin side;
    const tl_objective *objective;
    bool is_enabled; /* there is a free-running twin */
    bool predicts;   /* `predicted` holds a prediction; else the next one must start */
    tl_snapshot free;
    tl_snapshot predicted;
    tl_free_run_check free_run_check;
    tl_free_twin_counts counts;
} tl_free_twin;

/* For an exchange that is initialised. `guard`: steps until a prediction is independent of the
 * measurements used at its start; 0: no free-running twin. Returns false if memory is out. */
bool tl_free_twin_init(tl_free_twin *twin, tl_arena *arena, tl_exchange *exchange, const tl_objective *objective,
                       uint32_t guard);

/* Starts the free-running twin and a prediction at the committed instant; u does not rest. Also
 * call it after a reset of the FMUs, or if their states have become invalid. */
tl_status tl_free_twin_begin(tl_free_twin *twin, tl_error *error);

/* Call after each committed step if is_enabled, with its complete record. Executes the same step of
 * the free-running twin and of the prediction, and returns the verdict. Afterwards the FMUs are in
 * their state from before the call. With verdict->adopt, they have the state and the port values of
 * the free-running twin, and the caller must reset the caches.
 * Errors: TL_FMU_FAILED or TL_FMU_FATAL if a rollback fails. */
tl_status tl_free_twin_follow(tl_free_twin *twin, const tl_record *record, tl_free_run_check_verdict *verdict,
                              tl_error *error);

/* True if u rests from the next step on. */
bool tl_free_twin_rests(const tl_free_twin *twin);

/* Call after a change of tolerances or bounds: drops the data learned with the old ones; u does not
 * rest. */
void tl_free_twin_retune(tl_free_twin *twin);

/* Saves or loads all data and both states. Loading calls the FMUs only to deserialise states. */
tl_status tl_free_twin_archive(tl_free_twin *twin, tl_archive *archive, tl_error *error);

/* Frees a component's states. Call it before the component is freed, or if its states have become
 * invalid. tl_free_twin_begin() creates new ones. */
void tl_free_twin_end_component(tl_free_twin *twin, size_t component);

#endif
