/* Trend: course of the corrections over all live runs of a database, from its minutes or hours.
 *
 * Purpose: shows when a correction has changed, even after the steps were deleted from the
 *          database.
 * Parts:   the time is divided into at most TL_TREND_PARTS equal parts. They consist of whole
 *          minutes if the database still has the minutes of the first hour, else of whole hours.
 * Errors:  those of history.h.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_TREND_H
#define TL_FIRMWARE_REPORT_TREND_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/store/history.h"

enum { TL_TREND_PARTS = 512 };

/* Δu in one part. */
typedef struct tl_trend_part {
    int64_t count; /* number of steps; 0: none, and the other fields are 0 */
    double mean;
    double squares; /* of the deviations from the mean; the standard deviation is √(squares / count) */
} tl_trend_part;

/* About 100 kB. */
typedef struct tl_trend {
    size_t parts;     /* 0: there is no trend */
    int64_t from_ms;  /* start of the first part, ms since 1970 UTC; in a replay since t_start */
    int64_t width_ms; /* length of a part, ms */
    tl_trend_part part[TL_MAX_ADJUST][TL_TREND_PARTS];
} tl_trend;

/* Reads the trend of the adjusted variables of a run: from all live runs, by name of the variable.
 * If `run` is a replay, only from this run. */
tl_status tl_trend_read(tl_history *history, const tl_history_run *run, tl_trend *trend, tl_error *error);

#endif
