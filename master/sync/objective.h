/* Objective: distance of the simulated from the measured outputs, in units of their tolerances.
 *
 * Purpose: J = Σ residuals² (eq. 4.3). A residual is √weight·(y − ŷ)/tolerance at one
 *          horizon sample, from the output's own T_D to T_P. Beyond `huber` tolerances it is
 *          √weight·√(2·huber·|d| − huber²) with the sign of d. A penalty is √factor·(u − û)/step or
 *          √factor·(u − u of the step before)/step. J < 1 counts as "within tolerance". A ŷ that is
 *          not good has weight 0.
 * Unseen:  an unknown is a u of one macro step. It is unseen if there is no measurement at the
 *          sample where it first has an effect, for example between two messages of the plant. Then
 *          the measurements of a dynamic horizon depend only on the sum of several unknowns, which
 *          may oscillate against each other. An unseen unknown is damped by the residual
 *          √TL_UNSEEN_RATE·(u − u of the step before)/step, unless its rate penalty is larger.
 *          Motor bench, messages every 25 to 40 ms, T_P of 4 to 6: without damping the true MSE is
 *          up to 93 (rad/s)² while the twin reports 0.05; with it, at most 0.44.
 * NaN:     an output that is not finite makes J of its candidate NaN. If u is not the cause,
 *          tl_objective_leave_out() gives this output weight 0 in this step, as for a ŷ that is not
 *          good.
 * Use:     tl_objective_prepare() once per step; then for each candidate tl_objective_at() at each
 *          depth and tl_objective_penalise() once.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_OBJECTIVE_H
#define TL_MASTER_SYNC_OBJECTIVE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/graph/exchange.h"
#include "master/measure/noise_estimate.h"
#include "master/plan/tuning.h"
#include "master/sync/horizon.h"

typedef struct tl_objective_term {
    const tl_port *port;      /* y */
    size_t signal;            /* ŷ */
    tl_conversion conversion; /* from the signal's unit to the port's */
    double tolerance;
    double weight; /* 0: compared only */
    double huber;  /* 0: none */
    int32_t shift; /* ŷ of t_j is in the sample of tick j + shift (Δo); there is none before tick 0 */
} tl_objective_term;

/* Penalties (0: none) of one adjusted variable, and its `step`, as in tl_plan_adjust. */
typedef struct tl_objective_penalty {
    double deviation;
    double rate;
    double step;
} tl_objective_penalty;

/* Rate penalty of unseen unknowns. In a test with T_P = 6, a tenth of it damped them too little. */
#define TL_UNSEEN_RATE 1e-2

/* One matched output at one horizon sample, prepared for the step. */
typedef struct tl_objective_target {
    const double *real;         /* address of y; NULL: it is an integer */
    const fmi2Integer *integer; /* address of y; NULL: it is Real */
    double value;               /* ŷ, in y's unit */
    double scale;               /* 1/tolerance; 0: ŷ is not good */
    double root_weight;
    double huber; /* infinity: none */
} tl_objective_target;

typedef struct tl_objective {
    const tl_exchange *exchange;
    const tl_horizon *horizon;
    const tl_objective_term *terms;
    size_t term_count;
    tl_objective_penalty penalties[TL_MAX_ADJUST];
    bool penalised;                     /* a penalty is above 0: J has residuals of penalties */
    size_t matched;                     /* number of terms with a weight above 0 */
    tl_objective_target *targets;       /* [(depth − T_D)·matched + …] */
    tl_noise_estimate *noise_estimates; /* of the matched ŷ, in y's unit */
    size_t damping_count;               /* number of damping residuals: one per unknown of a dynamic horizon, or 0 */
    bool *damped;                       /* of each of these: true if J includes it in this step */
    size_t residual_count;              /* of samples, damping and penalties, in this order */
    size_t residual_most;               /* largest residual_count: with all penalties */
} tl_objective;

/* Parts of an objective. The penalties are copied; all else must outlive it. */
typedef struct tl_objective_settings {
    const tl_exchange *exchange; /* initialised */
    const tl_horizon *horizon;
    const tl_objective_term *terms;
    size_t term_count;
    const tl_objective_penalty *penalties; /* one for each adjusted variable */
    bool damps;                            /* damps unseen unknowns; false for Booleans, which have no small changes */
} tl_objective_settings;

/* Returns false if memory is out. */
bool tl_objective_init(tl_objective *objective, tl_arena *arena, const tl_objective_settings *settings);

/* Applies a tuning from the next step on. `terms` are those of the objective and get the new
 * values; the penalties are copied. Returns in factors[i] the ratio of new to old residual i at the
 * same y and u, without huber; 1 if the old one was absent. Room: residual_most. */
void tl_objective_retune(tl_objective *objective, tl_objective_term *terms, const tl_tuning *tuning, double *factors);

/* Looks up the measurements for step i, and finds the unseen unknowns. Returns false if no
 * measurement is good. */
bool tl_objective_prepare(tl_objective *objective, int64_t step);

/* Contribution of the present outputs to J, `depth` steps (T_D … T_P) after t_i. Fills their part
 * of `residuals` and of `course`, the y of all samples (`matched` values per sample). */
double tl_objective_at(const tl_objective *objective, uint32_t depth, double *residuals, double *course);

/* The first match whose y in this course should count and is not finite; SIZE_MAX: none. */
size_t tl_objective_find_bad(const tl_objective *objective, const double *course);

/* Leaves the y that are not finite out of J in this step; their residuals become 0. Returns the
 * contribution of the other samples; HUGE_VAL, without any change, if none would remain. */
double tl_objective_leave_out(tl_objective *objective, const double *course, double *residuals);

/* Contribution of u itself to J: damping, deviation from nominal, and rate. Fills the rest of the
 * residuals, also those that do not belong to J in this step. `before`: u of the step before, by
 * variable. */
double tl_objective_penalise(const tl_objective *objective, const double *u, const double *nominal,
                             const double *before, double *residuals);

/* Predicts the residuals of the next step, if the candidate with this course is committed and its u
 * stays constant. The samples shift by one. The new last sample is extrapolated linearly from the
 * last two: `earlier` is y of the last but one. Penalties are 0. A y that is not finite is left
 * out. */
void tl_objective_forecast(const tl_objective *objective, const double *course, const double *earlier,
                           double *residuals);

/* Mean contribution of the measurement noise to the square of each residual; 0 for penalties. */
void tl_objective_noise(const tl_objective *objective, double *squares);

/* Returns the contribution to J of these `y` of the matched outputs, compared with the plant at
 * `tick`. */
double tl_objective_sample(const tl_objective *objective, int64_t tick, const double *y);

/* Returns the number of samples of the horizon: T_P − T_D + 1. */
size_t tl_objective_samples(const tl_objective *objective);

/* Largest change of a sample's residual between two candidates, in tolerances. */
double tl_objective_change(const tl_objective *objective, const double *residuals, const double *others);

/* Copies the present y of each matched term. */
void tl_objective_matched(const tl_objective *objective, double *y);

/* Return the present y of a term, and the ŷ that is paired with the y of t_tick, in the unit of
 * y. */
double tl_objective_y(const tl_objective *objective, size_t term);
double tl_objective_measured(const tl_objective *objective, size_t term, int64_t tick, tl_quality *quality);

#endif
