/* The objective: how far the simulated outputs are from the measured ones, in units of their tolerances.
 *
 * Purpose: J = Σ over terms and horizon samples of weight·((y − ŷ)/tolerance)² (eq. 4.3, DESIGN.md). J < 1 reads "within
 *          tolerance" at one sample. A ŷ whose quality is not good is left out.
 * Thread:  the twin's.
 */
#ifndef TL_MASTER_SYNC_OBJECTIVE_H
#define TL_MASTER_SYNC_OBJECTIVE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/graph/exchange.h"

typedef struct tl_objective_term {
    const tl_port *port;      /* y */
    size_t signal;            /* ŷ */
    tl_conversion conversion; /* from the signal's unit to the port's */
    double tolerance;
    double weight; /* 0: compared only */
} tl_objective_term;

typedef struct tl_objective {
    const tl_exchange *exchange;
    const tl_objective_term *terms;
    size_t term_count;
} tl_objective;

/* Within tolerance. */
#define TL_OBJECTIVE_TOLERANCE 1.0

/* Whether any weighted term has a good measurement at the ticks first … last. */
bool tl_objective_is_measured(const tl_objective *objective, int64_t first, int64_t last);

/* What the outputs as they stand contribute at the instant of `tick`. */
double tl_objective_at(const tl_objective *objective, int64_t tick);

/* y and ŷ of one term as they stand at `tick`; ŷ in y's unit. */
double tl_objective_y(const tl_objective *objective, size_t term);
double tl_objective_y_hat(const tl_objective *objective, size_t term, int64_t tick, tl_quality *quality);

#endif
