/* The summary of a recorded run, with its lock.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_REPORT_SHOW_SUMMARY_H
#define TL_FIRMWARE_REPORT_SHOW_SUMMARY_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/monitor/lock_tally.h"
#include "firmware/report/run_figures.h"
#include "firmware/store/history.h"

enum { TL_SHOW_WINDOWS = 8, TL_SHOW_POINTS = 64 };

/* Sums of Δu = u − nominal over equal parts of the steps. */
typedef struct tl_show_part {
    uint64_t count;
    double delta_sum;
} tl_show_part;

/* Of an adjusted variable, beside its figures. */
typedef struct tl_show_adjust {
    double least, largest; /* u */
    double delta_squares;
    tl_show_part windows[TL_SHOW_WINDOWS];
    tl_show_part points[TL_SHOW_POINTS];
} tl_show_adjust;

typedef struct tl_show_summary {
    bool any;         /* there are steps */
    int64_t range[2]; /* the first and the last of them */
    size_t windows;   /* at most TL_SHOW_WINDOWS, and not more than steps */
    size_t points;
    const tl_recorder_signal *match, *adjust;
    size_t match_count, adjust_count;
    tl_run_figures figures; /* the ledger is of the whole run, the rest of these steps */
    tl_lock_tally lock;     /* without a step: no event tells of it */
    tl_time period;
    tl_show_adjust detail[TL_MAX_ADJUST];
} tl_show_summary;

/* Of the steps at or after `from_step`; the ledger is of the whole run. */
tl_status tl_show_summarise(tl_history *history, const tl_history_run *run, int64_t from_step, tl_show_summary *summary,
                            tl_error *error);

/* The first step of window `window`. */
int64_t tl_show_window_start(const tl_show_summary *summary, size_t window);

/* The window before which the mean Δu changed most; 0 where no change stands out: where none is larger than four times
 * what the means would differ by if Δu only varied as it does within the windows. */
size_t tl_show_largest_change(const tl_show_summary *summary, size_t adjust);

/* Mean Δu of a part; NaN where it has no steps. */
double tl_show_part_mean(const tl_show_part *part);

#endif
