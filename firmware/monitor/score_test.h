/* Score test: which of several causes explains a residual that has changed?
 *
 * Purpose: the residual is what was measured minus what a twin without corrections predicts. Each
 *          candidate predicts the outputs for a size of its own. The test fits all promising ones,
 *          and returns those that explain the residual as well as the best one.
 * Noise:   learnt from the residual before the onset. All series are averaged over blocks, so that
 *          white and slow noise become one autoregressive process of order 4 for each output. Each
 *          output is whitened with it and divided by its deviation.
 * Model:   it is never exact, so what lasts for the whole window is projected out: a constant of
 *          each output, and the effect of each candidate from the first step on.
 * Score:   s is the whitened change of the outputs for a small size, and e the whitened residual.
 *          The size is s·e / s·s, and χ² falls by (s·e)² / s·s. (Rao's test, with the variance
 *          from before the onset.)
 * Fit:     Gauss-Newton with new predictions, of the size and of the onset. The onset has a prior
 *          with the given spread. A fit starts at the best of several onsets.
 * Set:     a candidate belongs to the answer if its χ² is at most TL_SCORE_RIVAL above that of the
 *          best one (99 % for two unknowns). If the best one leaves more than the noise, this
 *          distance grows by the ratio.
 * Memory:  malloc(). Thread: one.
 */
#ifndef TL_FIRMWARE_MONITOR_SCORE_TEST_H
#define TL_FIRMWARE_MONITOR_SCORE_TEST_H

#include <stdbool.h>
#include <stddef.h>

#define TL_SCORE_RIVAL 9.21
#define TL_SCORE_NOTICED 25.0 /* least fall of χ²: five standard deviations */

/* Largest number of blocks of an output. */
enum { TL_SCORE_BLOCKS = 1000, TL_SCORE_FITTED = 16 };

/* Series have a value for each step and output: index step · outputs + output. NaN: there was no
 * measurement. The caller's arrays must outlive the test. */
typedef struct tl_score_window {
    size_t steps, outputs;
    size_t learn, onset; /* steps: the noise is learnt from `learn` to `onset` */
    double onset_spread; /* steps, ≥ 0 */
    const double *measured;
    const double *predicted; /* without any change */
} tl_score_window;

typedef enum tl_score_verdict {
    TL_SCORE_NOTHING, /* no candidate explains anything: there is no change, or it is not visible yet */
    TL_SCORE_FOUND,
    TL_SCORE_NONE, /* the best candidate leaves much more than the noise */
    TL_SCORE_VERDICTS
} tl_score_verdict;

/* A candidate. `probe`: a small size > 0, in the unit of `size`. Sizes stay within `least` and
 * `most`. `is_level`: the prediction at size 0 is not the one without a change (a frozen sensor).
 * Such a candidate has no score, and is always fitted. */
typedef struct tl_score_candidate {
    double probe, least, most;
    bool is_level;
    /* results */
    bool failed;    /* no prediction, or no output reacts */
    bool fitted;    /* size, spread, onset and squares are valid */
    bool is_in_set; /* explains the residual as well as the best one */
    double size;    /* estimate, and its standard deviation */
    double spread;
    double onset;      /* step */
    double squares;    /* χ² */
    double noticeable; /* size that lowers χ² by TL_SCORE_NOTICED in this window; infinity: none does */
    size_t alike;      /* the other candidate whose effect is most similar, and the cosine of both */
    double likeness;
} tl_score_candidate;

typedef struct tl_score_result {
    tl_score_verdict verdict;
    double squares;  /* χ² without any change */
    double expected; /* χ² of noise alone: number of independent samples after the onset */
    size_t best;     /* candidate; undefined if the verdict is TL_SCORE_NOTHING */
    /* The best and the second candidate of the set: the output in which they differ most, and how
     * many times as long a record tells them apart. 0: there is no second one, or they do not
     * differ. */
    size_t second;
    size_t apart_output;
    double apart_factor;
} tl_score_result;

/* Predicts the outputs if a candidate has this size from step `onset` on. Returns false if that is
 * not possible; `stop` of the test may be the reason. */
typedef bool tl_score_predict(void *context, size_t candidate, double size, size_t onset, double *predicted);

typedef struct tl_score_test {
    tl_score_window window;
    tl_score_predict *predict;
    void *context;
    bool (*stop)(void *context); /* true: end soon; NULL: never */
    bool only_foresees;          /* fill in `noticeable` and `failed` only */
} tl_score_test;

/* Runs the test. Returns false if memory is out, or if `stop` has ended it. */
bool tl_score_test_run(const tl_score_test *test, tl_score_candidate *candidate, size_t count, tl_score_result *result);

#endif
