/* Summary of a recorded run, computed from the rows of its database.
 *
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_SHOW_SUMMARY_H
#define TL_FIRMWARE_REPORT_SHOW_SUMMARY_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/monitor/lock_tally.h"
#include "firmware/report/run_figures.h"
#include "firmware/store/history.h"

/* Largest number of equal parts into which the steps are divided: windows, to find changes of Δu,
 * and points of a curve of Δu. */
enum { TL_SHOW_WINDOWS = 8, TL_SHOW_POINTS = 64 };

/* Sum of Δu = u − û over one part of the steps. */
typedef struct tl_show_part {
    uint64_t count;
    double correction_sum;
} tl_show_part;

/* Details of an adjusted variable, in addition to its run figures. */
typedef struct tl_show_adjust {
    double least, largest;     /* of u */
    double correction_squares; /* sum of Δu² */
    tl_show_part windows[TL_SHOW_WINDOWS];
    tl_show_part points[TL_SHOW_POINTS];
} tl_show_adjust;

/* Signals and texts belong to the history. */
typedef struct tl_show_summary {
    bool any;         /* there are steps */
    int64_t range[2]; /* first and last step */
    int64_t own;      /* first step after those resumed from an earlier run; 0: none was resumed */
    size_t windows;   /* at most TL_SHOW_WINDOWS, and at most the number of steps */
    size_t points;    /* at most TL_SHOW_POINTS, and at most the number of steps */
    const tl_recorder_signal *match, *adjust; /* matched outputs, adjusted variables */
    size_t match_count, adjust_count;
    tl_run_figures figures; /* of these steps; only the ledger is of the whole run */
    tl_lock_tally lock;     /* computed from the events; all zeros if no event reports a lock state */
    tl_time period;         /* T_S, ns */
    tl_show_adjust detail[TL_MAX_ADJUST];
} tl_show_summary;

/* Summarises the steps at or after `from_step`; the ledger is of the whole run. Errors: those of
 * history.h. */
tl_status tl_show_summarise(tl_history *history, const tl_history_run *run, int64_t from_step, tl_show_summary *summary,
                            tl_error *error);

/* Returns the first step of a window, 0 ≤ window < summary->windows. */
int64_t tl_show_window_start(const tl_show_summary *summary, size_t window);

/* Returns the window, from 1, at whose start the mean Δu of variable `adjust` changed most; 0 if no
 * change is significant. A change is significant if it is larger than four standard errors of the
 * difference of both means. They are computed from the variance of Δu within the windows. */
size_t tl_show_largest_change(const tl_show_summary *summary, size_t adjust);

/* Returns the mean Δu of a part; NaN if it has no steps. */
double tl_show_part_mean(const tl_show_part *part);

#endif
