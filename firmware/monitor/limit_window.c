/* Limit window: see limit_window.h. */
#include "firmware/monitor/limit_window.h"

static bool is_outside(const tl_config_alarm *alarm, double mean) {
    return mean > alarm->above || mean < alarm->below;
}

/* Compares the newest `parts` parts with the limits, and sets the results. */
static tl_limit_side find_side(tl_limit_window *window, const tl_config_alarm *alarm, uint64_t parts) {
    uint64_t outside = 0;
    uint64_t newest = 0; /* parts in a row */
    double sum = 0.0;
    double since = 0.0;
    for (uint64_t back = 1; back <= parts; back++) {
        uint64_t at = (window->parts - back) % TL_LIMIT_PARTS;
        sum += window->mean[at];
        if (is_outside(alarm, window->mean[at])) {
            outside++;
        }
        if (outside == back) {
            newest = back;
            since = sum;
        }
    }
    newest = newest > 0 ? newest : parts;
    window->onset = window->first[(window->parts - newest) % TL_LIMIT_PARTS];
    window->whole = sum / (double)parts;
    window->size = newest < parts ? since / (double)newest : window->whole;
    if (is_outside(alarm, window->whole)) {
        return 2 * outside >= parts ? TL_LIMIT_OUTSIDE : TL_LIMIT_UNKNOWN;
    }
    return 2 * outside <= parts ? TL_LIMIT_WITHIN : TL_LIMIT_UNKNOWN;
}

tl_limit_side tl_limit_window_add(tl_limit_window *window, const tl_config_alarm *alarm, tl_time period, int64_t step,
                                  double value) {
    const uint64_t lasts = (uint64_t)((alarm->averaging_time + period - 1) / period);
    const uint64_t length = (lasts + TL_LIMIT_PARTS - 1) / TL_LIMIT_PARTS; /* steps of a part */
    const uint64_t parts = (lasts + length - 1) / length;
    window->first[TL_LIMIT_PARTS] = window->values == 0 ? step : window->first[TL_LIMIT_PARTS];
    window->sum += value;
    window->values++;
    if (window->values < length) {
        return TL_LIMIT_UNKNOWN;
    }
    window->mean[window->parts % TL_LIMIT_PARTS] = window->sum / (double)window->values;
    window->first[window->parts % TL_LIMIT_PARTS] = window->first[TL_LIMIT_PARTS];
    window->spread = (int64_t)(length / 2) + 1;
    window->parts++;
    window->values = 0;
    window->sum = 0.0;
    return window->parts >= parts ? find_side(window, alarm, parts) : TL_LIMIT_UNKNOWN;
}
