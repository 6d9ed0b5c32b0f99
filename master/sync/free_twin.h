/* The free-run check: a twin without corrections, and its contest with the corrected one.
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

/* ---- Which of two twins is nearer to the plant: the one that is locked, or the one that is left alone.
 *
 * Purpose: a lock follows what was measured, with its noise. If the model is right it does harm, and nobody sees it: held against the measurements that it has used, the
 *          locked twin always looks nearer. So what that has gained it has to be taken off.
 * Method:  with n the noise of a measurement ŷ, L the locked twin's output and F the free twin's, which knows nothing of n, the harm is
 *            E(L − x)² − E(F − x)² = E(L − ŷ)² − E(F − ŷ)² + 2·E(L − x)·n,    x: the plant's true value,
 *          and the last term is 2·g·s²: the noise that there is, s² = E n², times the part g of it that the lock follows. Both come from predictions P, each of which begins at a
 *          committed instant, runs with nominal u, and ends once it has outrun what that instant has used: there L − P is the part g of ŷ − P; and the
 *          noise that the instant has followed is in the errors of two predictions in a row, with opposite signs:
 *            s² = E(L − ŷ)·(P − ŷ) − E(P − ŷ)·(P' − ŷ'),    P': the prediction before.
 *          What a model does not know of the plant is in one of them, or lasts; what lasts is taken off both. If it swings as fast as predictions follow each other, it has opposite
 *          signs, too; so what is more than half a tolerance is not taken for noise, of which a tolerance is to be three times as much (config/SPEC.md).
 *          These are averages over minutes. If that of late differs by more than three times its standard error, times have changed, and what was before is forgotten.
 * Verdict: over the last TL_CONTEST_TRIALS trials, and what was learned of the noise before: u rests at nominal if the harm is more than nothing by 1.5 times its standard error. It
 *          rests until the twin that rests is further off than a locked one would be: over these trials by as much, or all at once.
 * Bounded: an error counts 3 tolerances at most, so that an outlier does not decide.
 * Source:  not the dissertation: the covariance penalty of statistics, and the correlation of innovations by which filters are adapted.
 * Thread:  plain data; one thread at a time.
 */

enum {
    TL_CONTEST_TRIALS = 50,   /* that are remembered, */
    TL_CONTEST_LEAST = 20,    /* and without which nothing is decided */
    TL_CONTEST_MEMORY = 1000, /* trials over which what is known of the noise is an average, at most, */
    TL_CONTEST_RECENT = 50,   /* and over which the recent one is */
    TL_CONTEST_LOST =
        6 /* times in a row that all those that are remembered were lost: the free twin is of no use any more */
};

/* How far each matched output is off after a step, in tolerances, times the root of its weight; 0 if nothing good is there to hold it against. What is not finite is
 * as far as can be. */
typedef struct tl_contest_errors {
    double locked[TL_MAX_MATCH]; /* of the twin: locked, or resting */
    double free[TL_MAX_MATCH];
    double predicted[TL_MAX_MATCH]; /* of no meaning while u rests */
    double weight;                  /* Σ of the weights of all outputs, measured or not */
} tl_contest_errors;

/* Means of squares over one trial. */
typedef struct tl_contest_trial {
    double locked;
    double free;
} tl_contest_trial;

/* An average that forgets, of a value and of its square. */
typedef struct tl_contest_average {
    double mean;
    double square;
} tl_contest_average;

/* What is known of the noise, over so many trials. */
typedef struct tl_contest_noise {
    tl_contest_average locked;   /* E(L − ŷ)², */
    tl_contest_average surprise; /* E(P − ŷ)², */
    tl_contest_average kept;     /* E(L − ŷ)·(P − ŷ), */
    tl_contest_average noise;    /* and s² */
    uint32_t count;
} tl_contest_noise;

/* What follows from a step. */
typedef struct tl_contest_verdict {
    bool predict; /* the next prediction begins at the instant that was just committed */
    bool turned;  /* u begins to rest, or rests no more */
    bool adopt;   /* the free twin's state is the better one, and goes on being so: the twin goes on from there */
    bool renew;   /* the free twin begins anew from the twin's state */
} tl_contest_verdict;

/* Fields are private, but `rests`. Zeroed but for `guard`: one that begins. */
typedef struct tl_contest {
    uint32_t guard; /* steps of a trial, and of a prediction, ≥ 1 */
    double weight;  /* as in the errors of the step at hand */
    bool rests;
    bool follows; /* the prediction before this one is known: */
    double before[TL_MAX_MATCH];
    double lasting
        [TL_MAX_MATCH]; /* what predictions before that one were off by, on average: the model's error, and no noise */
    uint32_t steps;     /* of the trial at hand, */
    uint32_t counted;
    tl_contest_trial sum;
    tl_contest_trial trial[TL_CONTEST_TRIALS];
    uint32_t count; /* trials remembered */
    uint32_t at;    /* where the next one goes */
    uint32_t since; /* trials, since a whole memory was lost */
    uint32_t lost;  /* such memories in a row */
    tl_contest_noise known;
    tl_contest_noise recent; /* of the newest ones only: if times have changed, this is what is known */
    double excess;           /* of the twin that rests: how far it has been further off than a locked one, summed */
} tl_contest;

/* After each committed step. `measured`: false if there was nothing good to hold any output against. */
tl_contest_verdict tl_contest_step(tl_contest *contest, const tl_contest_errors *errors, bool measured);

/* Predictions begin anew, and what was seen of them is forgotten; u does not rest. What is known of the noise stays. */
void tl_contest_begin_anew(tl_contest *contest);

/* All of it, but `guard`. */
void tl_contest_archive(tl_contest *contest, tl_archive *archive);

/* ---- The free twin: the same co-simulation, left alone beside the locked one, and what its predictions say of the lock.
 *
 * Purpose: a lock must do no harm over time. So what it makes of the measurements is held against a twin that never sees them (free_twin.h). Where that one predicts
 *          better, u rests at nominal; and the twin goes on from the free twin's state if that is the better one.
 * Method:  in the FMUs of the twin itself: after each committed step they are led to the free twin's state and back, and while u does not rest to a
 *          prediction's as well. Each of the two executes all components once a step, with nominal u; nothing of it is in any other count.
 * States:  three of each FMU: the free twin's, the prediction's, and where the twin is meanwhile.
 * Not:     for FMUs that are led back by replay: each way there and back would be all of the run again.
 * Thread:  the twin's. Memory: the arena, at start-up; states are the FMUs' own.
 */

/* Fields are private, but `counts`. Zeroed: there is none. */
typedef struct tl_free_twin {
    tl_exchange *exchange;
    const tl_objective *objective;
    bool is_led;
    bool predicts; /* `predicted` is where a prediction is; else it is to begin */
    tl_snapshot free;
    tl_snapshot predicted;
    tl_contest contest;
    uint64_t *executions; /* of each component, while steps that do not count are made */
    tl_free_twin_counts counts;
} tl_free_twin;

/* For an exchange whose values are placed. `guard`: steps until a prediction has outrun what its beginning has used; 0: there shall be no free twin. False when
 * memory is out. */
bool tl_free_twin_init(tl_free_twin *twin, tl_arena *arena, tl_exchange *exchange, const tl_objective *objective,
                       uint32_t guard);

/* The FMUs stand at the committed instant, where both begin, and u does not rest. Also later, if the FMUs have begun anew, or their states are worth nothing any
 * more. */
tl_status tl_free_twin_begin(tl_free_twin *twin, tl_error *error);

/* `record` is complete, and the FMUs are left where they are after its step: or, with `adopt` in the verdict, where the free twin is, and its values are in all ports;
 * then the caches begin anew. Errors: TL_FMU_FAILED, TL_FMU_FATAL if they cannot be led back. */
tl_status tl_free_twin_follow(tl_free_twin *twin, const tl_record *record, tl_contest_verdict *verdict,
                              tl_error *error);

/* Whether u rests from the next step on. */
bool tl_free_twin_rests(const tl_free_twin *twin);

/* What was seen of a lock with other tolerances or bounds says nothing; u does not rest. */
void tl_free_twin_retune(tl_free_twin *twin);

/* What it knows, and both states. When loading, the FMUs are not called but to make states of the bytes. */
tl_status tl_free_twin_archive(tl_free_twin *twin, tl_archive *archive, tl_error *error);

/* Gives a component's states back, before it is freed, or if they are worth nothing any more. tl_free_twin_begin() makes others. */
void tl_free_twin_end_component(tl_free_twin *twin, size_t component);

#endif
