/* How far a low-pass takes readings from what was true: see smoothing.h. */
#include "firmware/monitor/smoothing.h"

#include <math.h>

#include "firmware/plant/conditioner.h"

static tl_reading reading_of(const tl_noise_point *point) {
    return (tl_reading){.value = point->value, .stamp = point->stamp, .quality = TL_GOOD};
}

/* Where a low-pass that was at `smooth` at one reading is at `at`, of which the next reading is no earlier. */
static double follow(tl_time low_pass, const tl_reading *from, double smooth, const tl_reading *to, tl_time at) {
    const tl_conditioned before = {.reading = *from, .smooth = smooth};
    return at > from->stamp ? tl_conditioner_between(low_pass, &before, to, at) : smooth;
}

/* Of a reading, in what is made of its instant: the answer to a line that is 1 there and 0 at its neighbours. */
static double weight_of(const tl_noise_point *point, tl_time low_pass) {
    const tl_reading before = {.value = 0.0, .stamp = point[-1].stamp};
    const tl_reading own = {.value = 1.0, .stamp = point[0].stamp};
    const tl_reading after = {.value = 0.0, .stamp = point[1].stamp};
    tl_time at = own.stamp + low_pass;
    double smooth = follow(low_pass, &before, 0.0, &own, own.stamp);
    if (at <= after.stamp) {
        return follow(low_pass, &own, smooth, &after, at);
    }
    smooth = follow(low_pass, &own, smooth, &after, after.stamp);
    return smooth * exp(-(double)(at - after.stamp) / (double)low_pass);
}

double tl_smoothing_error(const tl_noise_point *points, size_t count, double sigma, tl_time low_pass) {
    double square = sigma * sigma;
    double differences = 0.0;
    double weights = 0.0;
    size_t terms = 0;
    double smooth = count > 0 ? points[0].value : 0.0; /* at `next` − 1 */
    size_t next = 1;
    for (size_t i = 1; i + 1 < count; i++) {
        tl_time at = points[i].stamp + low_pass;
        for (; next < count && points[next].stamp <= at; next++) {
            const tl_reading from = reading_of(&points[next - 1]);
            const tl_reading to = reading_of(&points[next]);
            smooth = follow(low_pass, &from, smooth, &to, to.stamp);
        }
        if (next == count) {
            break;
        }
        const tl_reading from = reading_of(&points[next - 1]);
        const tl_reading to = reading_of(&points[next]);
        double difference = points[i].value - follow(low_pass, &from, smooth, &to, at);
        differences += difference * difference;
        weights += weight_of(&points[i], low_pass);
        terms++;
    }
    double error = terms > 0 ? (differences + 2.0 * square * weights) / (double)terms - square : square;
    return fmax(error, 0.0);
}
