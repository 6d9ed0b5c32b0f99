/* The objective: see objective.h. */
#include "master/sync/objective.h"

bool tl_objective_is_measured(const tl_objective *objective, int64_t first, int64_t last) {
    for (int64_t tick = first; tick <= last; tick++) {
        const tl_sample *sample = tl_plant_sample(&objective->exchange->plant, tick);
        for (size_t i = 0; i < objective->term_count; i++) {
            const tl_objective_term *term = &objective->terms[i];
            if (term->weight > 0.0 && sample->quality[term->signal] == TL_GOOD) {
                return true;
            }
        }
    }
    return false;
}

double tl_objective_y(const tl_objective *objective, size_t term) {
    return tl_exchange_value(objective->exchange, objective->terms[term].port);
}

double tl_objective_y_hat(const tl_objective *objective, size_t term, int64_t tick, tl_quality *quality) {
    const tl_objective_term *description = &objective->terms[term];
    const tl_sample *sample = tl_plant_sample(&objective->exchange->plant, tick);
    *quality = (tl_quality)sample->quality[description->signal];
    return description->conversion.factor * sample->values[description->signal] + description->conversion.offset;
}

double tl_objective_at(const tl_objective *objective, int64_t tick) {
    double sum = 0.0;
    for (size_t i = 0; i < objective->term_count; i++) {
        const tl_objective_term *term = &objective->terms[i];
        if (term->weight > 0.0) {
            tl_quality quality;
            double y_hat = tl_objective_y_hat(objective, i, tick, &quality);
            if (quality == TL_GOOD) {
                double difference = (tl_objective_y(objective, i) - y_hat) / term->tolerance;
                sum += term->weight * difference * difference;
            }
        }
    }
    return sum;
}
