/* Trend of the corrections: see trend.h. */
#include "firmware/report/trend.h"

#include <math.h>
#include <string.h>

#include "firmware/base/text.h"
#include "firmware/report/show.h"

/* State while the periods are read. */
typedef struct trend_walk {
    tl_trend *trend;
    const tl_recorder_signal *adjust;
    size_t adjust_count;
    int64_t first_ms, last_ms; /* starts of the periods */
    bool any;
} trend_walk;

static int64_t start_of(const tl_history_period *period) {
    int64_t started = 0;
    if (tl_show_is_live(period->run)) {
        (void)tl_utc_parse(period->run->started, &started);
    }
    return started + period->start_s * 1000;
}

static void take_range(void *context, const tl_history_period *period) {
    trend_walk *walk = context;
    const int64_t at = start_of(period);
    walk->first_ms = !walk->any || at < walk->first_ms ? at : walk->first_ms;
    walk->last_ms = !walk->any || at > walk->last_ms ? at : walk->last_ms;
    walk->any = true;
}

static void take_period(void *context, const tl_history_period *period) {
    const trend_walk *walk = context;
    tl_trend *trend = walk->trend;
    const int64_t after = start_of(period) - trend->from_ms;
    if (strcmp(period->kind, "adjust") != 0 || after < 0 || after / trend->width_ms >= (int64_t)trend->parts) {
        return;
    }
    for (size_t i = 0; i < walk->adjust_count; i++) {
        tl_trend_part *part = &trend->part[i][after / trend->width_ms];
        if (strcmp(walk->adjust[i].name, period->name) == 0 && isfinite(period->mean)) {
            const double count = (double)period->count;
            const double apart = period->mean - part->mean;
            const double before = (double)part->count;
            part->count += period->count;
            part->mean += apart * count / (before + count);
            part->squares +=
                period->spread * period->spread * count + apart * apart * before * count / (before + count);
        }
    }
}

/* Finds where the minutes or hours begin and end. */
static tl_status find_range(tl_history *history, const tl_history_run *run, int length_s, trend_walk *walk,
                            tl_error *error) {
    const tl_history_visitor visitor = {.context = walk, .period = take_range};
    walk->any = false;
    return tl_history_periods(history, run, length_s, &visitor, error);
}

tl_status tl_trend_read(tl_history *history, const tl_history_run *run, tl_trend *trend, tl_error *error) {
    trend_walk walk = {.trend = trend};
    const tl_history_visitor visitor = {.context = &walk, .period = take_period};
    memset(trend, 0, sizeof *trend);
    tl_status status = tl_history_signals(history, run, TL_HISTORY_ADJUST, &walk.adjust, &walk.adjust_count, error);
    status = status == TL_OK ? find_range(history, run, TL_HOUR, &walk, error) : status;
    const int64_t first_hour = walk.first_ms;
    int length_s = TL_MINUTE;
    status = status == TL_OK ? find_range(history, run, length_s, &walk, error) : status;
    if (status == TL_OK && (!walk.any || walk.first_ms >= first_hour + (int64_t)TL_HOUR * 1000)) {
        length_s = TL_HOUR;
        status = find_range(history, run, length_s, &walk, error);
    }
    if (status != TL_OK || !walk.any) {
        return status;
    }
    const int64_t length_ms = (int64_t)length_s * 1000;
    const int64_t periods = (walk.last_ms - walk.first_ms) / length_ms + 1;
    trend->from_ms = walk.first_ms;
    trend->width_ms = ((periods - 1) / TL_TREND_PARTS + 1) * length_ms;
    trend->parts = (size_t)((walk.last_ms - walk.first_ms) / trend->width_ms + 1);
    return tl_history_periods(history, run, length_s, &visitor, error);
}
