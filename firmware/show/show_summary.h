/* The numbers of one run, for the page and the JSON object of `show`.
 *
 * Purpose: how well the twin followed, what had to be corrected, and since when, added up from what was recorded.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_SHOW_SHOW_SUMMARY_H
#define TL_FIRMWARE_SHOW_SHOW_SUMMARY_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/record/history.h"
#include "master/twin/twin.h"

enum { TL_SHOW_WINDOWS = 8, TL_SHOW_POINTS = 64 };

/* Sums of Δu = u − nominal over equal parts of the steps. */
typedef struct tl_show_part {
    uint64_t count;
    double delta_sum;
} tl_show_part;

typedef struct tl_show_adjust {
    const tl_recorder_signal *signal;
    uint64_t count; /* of steps with a u */
    double first, last, least, largest;
    double sum;
    double delta_sum;
    double delta_squares;
    tl_show_part windows[TL_SHOW_WINDOWS];
    tl_show_part points[TL_SHOW_POINTS];
} tl_show_adjust;

typedef struct tl_show_match {
    const tl_recorder_signal *signal;
    tl_metrics metrics;
} tl_show_match;

typedef struct tl_show_summary {
    bool any;         /* there are steps */
    int64_t range[2]; /* the first and the last of them */
    size_t windows;   /* at most TL_SHOW_WINDOWS, and not more than steps */
    size_t points;
    uint64_t steps; /* all that were committed, those made up later too */
    uint64_t evaluations;
    uint64_t optimised_steps; /* that needed more than their first guess */
    uint64_t outcomes[TL_OUTCOMES];
    uint64_t unknown_outcomes; /* of a newer program */
    uint64_t time_limited;
    int64_t longest_ns; /* the longest step took this long */
    tl_show_match match[TL_MAX_MATCH];
    size_t match_count;
    tl_show_adjust adjust[TL_MAX_ADJUST];
    size_t adjust_count;
    const tl_history_component *ledger; /* of the whole run */
    size_t ledger_count;                /* 0: none was kept */
    tl_recorder_component total;        /* of the ledger */
} tl_show_summary;

/* Of the steps at or after `from_step`; the ledger is of the whole run. */
tl_status tl_show_summarise(tl_history *history, const tl_history_run *run, int64_t from_step, tl_show_summary *summary,
                            tl_error *error);

/* The first step of window `window`. */
int64_t tl_show_window_start(const tl_show_summary *summary, size_t window);

/* The window before which the mean Δu changed most; 0 where no change stands out: where none is larger than four times
 * what the means would differ by if Δu only varied as it does within the windows. */
size_t tl_show_largest_change(const tl_show_summary *summary, const tl_show_adjust *adjust);

/* Mean Δu of a part; NaN where it has no steps. */
double tl_show_part_mean(const tl_show_part *part);

#endif
