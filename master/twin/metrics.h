/* MSE and MAX of a simulated output, compared with the plant at the same instants.
 *
 * Source: thesis eq. 5.2 (MSE = Σ_{i=0..n}(y_i − ŷ_i)²/n, n + 1 pairs) and 5.3. Pairs whose ŷ is
 *         not good are left out and counted.
 * Thread: plain data. Starts as zeros.
 */
#ifndef TL_MASTER_TWIN_METRICS_H
#define TL_MASTER_TWIN_METRICS_H

#include <stdint.h>

#include "master/base/signal.h"

typedef struct tl_metrics {
    uint64_t pairs;        /* number of pairs that count */
    uint64_t left_out;     /* number of pairs that do not count */
    double sum_of_squares; /* Σ(y − ŷ)², in the output's unit squared */
    double maximum;        /* largest |y − ŷ|, in the output's unit */
} tl_metrics;

/* Adds a pair. It is left out if the measurement is not good or y is not finite. */
void tl_metrics_add(tl_metrics *metrics, double y, double measured, tl_quality quality);

/* Adds the metrics of another period. */
void tl_metrics_join(tl_metrics *metrics, const tl_metrics *other);

/* Returns sum_of_squares/(pairs − 1), or 0 if there are fewer than two pairs. */
double tl_metrics_mse(const tl_metrics *metrics);

#endif
