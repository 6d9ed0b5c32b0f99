/* Score test: finds out which of several possible causes explain a residual that has changed.
 *
 * Purpose: the residual is the measured value minus the prediction of a twin without corrections.
 *          Each *candidate* is a possible cause with a size, for example an offset of 2 K, and
 *          predicts the outputs. The test fits the most promising candidates. It returns the *set*
 *          of those that explain the residual as well as the best one.
 * Noise:   learnt from the residual before the onset. All series are averaged over blocks, so that
 *          white and slow noise become one autoregressive process of order 4 for each output. Each
 *          output is whitened with its process and divided by its deviation.
 * Model:   the twin's model is never exact. An error that lasts for the whole window is not a
 *          change. So the test projects two kinds of such errors out of all series: a constant
 *          offset of each output, and the effect of each candidate that acts from the first step
 *          of the window on.
 * Score:   s is the whitened change of the outputs for a small size, and e the whitened residual.
 *          The size is s·e / s·s, and χ² falls by (s·e)² / s·s. (Rao's test, with the variance from
 *          before the onset.)
 * Fit:     Gauss-Newton method for size and onset, with new predictions. The onset has a prior with
 *          the given spread. A fit starts at the best of several onsets.
 * Set:     a candidate belongs to the set if its χ² is at most TL_SCORE_RIVAL above that of the
 *          best one (99 % for two unknowns). If the best one leaves more than the noise, this limit
 *          is multiplied by the ratio of both.
 * Memory:  malloc(). Thread: one.
 */
#ifndef TL_FIRMWARE_MONITOR_SCORE_TEST_H
#define TL_FIRMWARE_MONITOR_SCORE_TEST_H

#include <stdbool.h>
#include <stddef.h>

#define TL_SCORE_RIVAL 9.21
#define TL_SCORE_NOTICED 25.0 /* smallest decrease of χ² that counts as a change: five standard deviations */

/* Largest number of blocks of an output, and of candidates that are fitted because of their score.
 */
enum { TL_SCORE_BLOCKS = 1000, TL_SCORE_FITTED = 16 };

/* Series have a value for each step and output: index step · outputs + output. NaN: there was no
 * measurement. The caller's arrays must outlive the test. */
typedef struct tl_score_window {
    size_t steps, outputs; /* numbers of steps and outputs */
    size_t learn, onset;   /* steps: the noise is learnt from `learn` to `onset` − `onset_spread` */
    double onset_spread;   /* the change began within onset ± onset_spread, steps, ≥ 0 */
    const double *measured;
    const double *predicted; /* without any change */
} tl_score_window;

typedef enum tl_score_verdict {
    TL_SCORE_NOT_BETTER,  /* no candidate predicts noticeably better than "no change" (TL_SCORE_NOTICED) */
    TL_SCORE_FOUND,       /* the candidates of the set explain the residual */
    TL_SCORE_UNEXPLAINED, /* the best candidate predicts better, but leaves much more than the noise */
    TL_SCORE_VERDICTS
} tl_score_verdict;

/* A candidate. `probe`: a small size > 0, in the unit of `size`. Sizes stay within `least` …
 * `most`. `is_level`: size 0 does not mean "no change" (a frozen sensor). Such a candidate has no
 * score and is always fitted. */
typedef struct tl_score_candidate {
    double probe, least, most;
    bool is_level;
    /* results */
    bool failed;       /* no prediction, or no output reacts */
    bool fitted;       /* size, spread, onset and squares are valid */
    bool is_in_set;    /* explains the residual as well as the best candidate */
    double size;       /* estimate */
    double spread;     /* standard deviation of `size` */
    double onset;      /* estimated step */
    double squares;    /* χ² of the steps after the onset, with this candidate in the prediction */
    double noticeable; /* size that lowers χ² by TL_SCORE_NOTICED in this window; infinity: no size does */
    size_t alike;      /* index of the other candidate with the most similar effect; own index: there is none */
    double likeness;   /* absolute cosine of both effects, 0 … 1 */
} tl_score_candidate;

typedef struct tl_score_result {
    tl_score_verdict verdict;
    double squares;      /* χ² of the steps after the onset, without any candidate */
    double expected;     /* the same for noise alone: number of independent samples after the onset */
    size_t best;         /* index of the best candidate; undefined if the verdict is TL_SCORE_NOT_BETTER */
    size_t second;       /* index of the second candidate of the set; `best`: there is none */
    size_t apart_output; /* output in which these two differ most */
    /* A recording longer by this factor would distinguish the two, 1 … 100. 0: unknown, because
     * there is no second candidate, or the factor is outside this range. */
    double apart_factor;
} tl_score_result;

/* Predicts the outputs with a candidate of this size from step `onset` on. Fills `predicted` (steps
 * · outputs values). Returns false if this is not possible, or if `stop` has returned true. */
typedef bool tl_score_predict(void *context, size_t candidate, double size, size_t onset, double *predicted);

typedef struct tl_score_test {
    tl_score_window window;
    tl_score_predict *predict;
    void *context;
    bool (*stop)(void *context); /* returns true to end the test; NULL: never */
    bool only_foresees;          /* no fits: only `noticeable` and `failed` are valid */
} tl_score_test;

/* Runs the test. Returns false if memory is out, or if `stop` has ended it. */
bool tl_score_test_run(const tl_score_test *test, tl_score_candidate *candidate, size_t count, tl_score_result *result);

#endif
