/* The objective: how far the simulated outputs are from the measured ones, in units of their tolerances.
 *
 * Purpose: J = Σ residuals² (eq. 4.3, DESIGN.md). A residual is √weight·(y − ŷ)/tolerance at one horizon sample from the
 *          output's own T_D to T_P, beyond `huber` tolerances √weight·√(2·huber·|d| − huber²) with its sign; or a penalty,
 *          √factor·(u − û)/step or √factor·(u − the u before)/step. J < 1 reads "within tolerance" at one sample. A ŷ
 *          whose quality is not good has no weight.
 * Unseen:  in a dynamic horizon a sample may be missing at the instant at which an unknown is first felt, as between two messages. Only the sum of
 *          several unknowns is seen then, and they may swing against each other. So such an unknown is damped: √TL_UNSEEN_RATE·(u − the u
 *          before)/step belongs to J, if the penalty of its rate is not that large anyway.
 * Use:     once per step tl_objective_prepare(); then, for each candidate, tl_objective_at() at each depth and
 *          tl_objective_penalise() once.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_SYNC_OBJECTIVE_H
#define TL_MASTER_SYNC_OBJECTIVE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/graph/exchange.h"
#include "master/measure/jitter.h"
#include "master/plan/tuning.h"
#include "master/sync/horizon.h"

typedef struct tl_objective_term {
    const tl_port *port;      /* y */
    size_t signal;            /* ŷ */
    tl_conversion conversion; /* from the signal's unit to the port's */
    double tolerance;
    double weight; /* 0: compared only */
    double huber;  /* 0: none */
    int32_t shift; /* ŷ of t_j is in the sample of tick j + shift (Δo); before tick 0 there is none */
} tl_objective_term;

/* Penalties of one adjusted variable. */
typedef struct tl_objective_penalty {
    double deviation;
    double rate;
    double step;
} tl_objective_penalty;

/* Of unknowns that no sample sees; measured: a tenth of it is too little at T_P = 6. */
#define TL_UNSEEN_RATE 1e-2

/* One matched output at one horizon sample, as prepared. */
typedef struct tl_objective_target {
    const double *real;         /* where y is; NULL: */
    const fmi2Integer *integer; /* here */
    double value;               /* ŷ, in y's unit */
    double scale;               /* 1/tolerance; 0: not measured */
    double root_weight;
    double huber; /* infinity: none */
} tl_objective_target;

typedef struct tl_objective {
    const tl_exchange *exchange;
    const tl_horizon *horizon;
    const tl_objective_term *terms;
    size_t term_count;
    tl_objective_penalty penalties[TL_MAX_ADJUST];
    bool penalised;
    size_t matched;               /* terms with a weight */
    tl_objective_target *targets; /* [(depth − T_D)·matched + …] */
    tl_jitter *jitters;           /* of the matched ŷ, in y's unit */
    size_t damping_count;         /* residuals of unknowns that may be unseen: all of a dynamic horizon, or none */
    bool *damped;                 /* of each of these: in this step it belongs to J */
    size_t residual_count;        /* of the samples, of the damping, then of the penalties, */
    size_t residual_most;         /* and if there were penalties */
} tl_objective;

/* What an objective is made of. The penalties are copied; all else must outlive it. */
typedef struct tl_objective_settings {
    const tl_exchange *exchange; /* its values are placed */
    const tl_horizon *horizon;
    const tl_objective_term *terms;
    size_t term_count;
    const tl_objective_penalty *penalties; /* one for each adjusted variable */
    bool damps; /* unknowns that no sample sees: not Boolean ones, which cannot move a little */
} tl_objective_settings;

/* False when memory is out. */
bool tl_objective_init(tl_objective *objective, tl_arena *arena, const tl_objective_settings *settings);

/* From the next step on. `terms` are those of the objective, which get these values; the penalties are copied. factors[i], of residual_most, is how
 * much larger residual i of the same difference is than it was. */
void tl_objective_retune(tl_objective *objective, tl_objective_term *terms, const tl_tuning *tuning, double *factors);

/* Looks up the measurements that step i is matched with, and which unknowns they do not see; false where none of them is good. */
bool tl_objective_prepare(tl_objective *objective, int64_t step);

/* What the outputs as they stand contribute `depth` steps (T_D … T_P) after t_i; fills their part of the residuals, and of
 * the course: the y themselves, `matched` of them at each sample. */
double tl_objective_at(const tl_objective *objective, uint32_t depth, double *residuals, double *course);

/* What u costs beside: its rate if it is damped, its distance from nominal and its rate; fills the rest of the residuals, also of what is not damped in this
 * step. `before` is the u of the step before, by variable. */
double tl_objective_penalise(const tl_objective *objective, const double *u, const double *nominal,
                             const double *before, double *residuals);

/* The residuals of the samples to be expected one step after a candidate with this course was committed, if its u is held: its
 * samples come one nearer, and the outputs go on from the last one as they went from `earlier` (the y of the sample before)
 * to it. Penalties are left out. */
void tl_objective_forecast(const tl_objective *objective, const double *course, const double *earlier,
                           double *residuals);

/* What the noise of the measurements contributes to the square of each residual, on average; penalties have none. */
void tl_objective_noise(const tl_objective *objective, double *squares);

/* What these y of the matched outputs cost against the plant of `tick`, wherever that lies. */
double tl_objective_sample(const tl_objective *objective, int64_t tick, const double *y);

/* Samples of the horizon: T_P − T_D + 1. */
size_t tl_objective_samples(const tl_objective *objective);

/* The largest change of a sample's residual between two candidates, in tolerances. */
double tl_objective_change(const tl_objective *objective, const double *residuals, const double *others);

/* y of each matched term as it stands now. */
void tl_objective_matched(const tl_objective *objective, double *y);

/* y of one term as it stands, and the ŷ that is paired with y at t_tick; ŷ in y's unit. */
double tl_objective_y(const tl_objective *objective, size_t term);
double tl_objective_y_hat(const tl_objective *objective, size_t term, int64_t tick, tl_quality *quality);

#endif
