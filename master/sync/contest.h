/* Which of two twins is nearer to the plant: the one that is locked, or the one that is left alone.
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
#ifndef TL_MASTER_SYNC_CONTEST_H
#define TL_MASTER_SYNC_CONTEST_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/signal.h"

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

#endif
