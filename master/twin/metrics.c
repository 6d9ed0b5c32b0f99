/* MSE and MAX: see metrics.h. */
#include "master/twin/metrics.h"

#include <math.h>

void tl_metrics_add(tl_metrics *metrics, double y, double measured, tl_quality quality) {
    if (quality != TL_GOOD || !isfinite(y)) {
        metrics->left_out++;
        return;
    }
    double difference = fabs(y - measured);
    metrics->pairs++;
    metrics->sum_of_squares += difference * difference;
    if (difference > metrics->maximum) {
        metrics->maximum = difference;
    }
}

void tl_metrics_join(tl_metrics *metrics, const tl_metrics *other) {
    metrics->pairs += other->pairs;
    metrics->left_out += other->left_out;
    metrics->sum_of_squares += other->sum_of_squares;
    metrics->maximum = fmax(metrics->maximum, other->maximum);
}

double tl_metrics_mse(const tl_metrics *metrics) {
    return metrics->pairs < 2 ? 0.0 : metrics->sum_of_squares / (double)(metrics->pairs - 1);
}
