/* Ages of the plant's values: see ages.h. */
#include "firmware/report/ages.h"

#include <stdio.h>

/* The unit of the bins is 1.024 µs. Below 16 units, each bin is one unit. From there on, a bin is
 * 1/16 of the largest power of two in the age. */
enum { UNIT_BITS = 10 };

static const size_t PARTS = 16;

static size_t bin_of(tl_time age) {
    uint64_t units = age > 0 ? (uint64_t)age >> UNIT_BITS : 0;
    size_t doublings = 0;
    while (units >> doublings >= 2 * PARTS) {
        doublings++;
    }
    size_t bin = PARTS * doublings + (size_t)(units >> doublings);
    return bin < TL_AGE_BINS ? bin : TL_AGE_BINS - 1;
}

/* Returns the age at the end of a bin, ns. */
static tl_time end_of(size_t bin) {
    size_t doublings = bin < 2 * PARTS ? 0 : bin / PARTS - 1;
    return (tl_time)(bin - PARTS * doublings + 1) << (doublings + UNIT_BITS);
}

static bool is_counted(const tl_config *config, const tl_config_signal *signal) {
    return signal->source < config->source_count && signal->look_back == 0 && signal->between == TL_BETWEEN_LAST &&
           !tl_condition_is_needed(&signal->condition);
}

void tl_ages_add_sample(tl_ages *ages, const tl_config *config, const tl_sample *sample) {
    for (size_t i = 0; i < config->signal_count; i++) {
        bool is_new = sample->quality[i] == TL_GOOD && sample->stamps[i] != ages->newest[i];
        if (is_new && is_counted(config, &config->signals[i])) {
            ages->newest[i] = sample->stamps[i];
            ages->bins[bin_of(tl_sample_age(sample, i))]++;
            ages->values++;
        }
    }
}

tl_time tl_ages_percentile(const tl_ages *ages, unsigned percent) {
    double rank = (double)ages->values * percent / 100.0;
    double before = 0;
    for (size_t bin = 0; bin < TL_AGE_BINS && ages->values != 0; bin++) {
        before += (double)ages->bins[bin];
        if (before >= rank && before > 0) {
            return end_of(bin);
        }
    }
    return ages->values != 0 ? end_of(TL_AGE_BINS - 1) : 0;
}

void tl_ages_write(const tl_ages *ages, char text[TL_AGES_TEXT]) {
    (void)snprintf(text, TL_AGES_TEXT, "values %.3f ms old at their ticks (p50), %.3f ms (p99)",
                   tl_seconds(tl_ages_percentile(ages, 50)) * 1e3, tl_seconds(tl_ages_percentile(ages, 99)) * 1e3);
}
