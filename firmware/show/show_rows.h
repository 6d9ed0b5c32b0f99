/* Rows of one run, handed out one by one.
 *
 * Purpose: the tables of a run may have a hundred million rows; they are read in short transactions, so that a slow
 *          reader (a pager) does not keep the recorder from writing its log back.
 * Errors:  those of history.h.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_SHOW_SHOW_ROWS_H
#define TL_FIRMWARE_SHOW_SHOW_ROWS_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/record/history.h"

struct sqlite3_stmt;

/* An event as it is in the database; texts are valid while it is handed out. */
typedef struct tl_show_event {
    const char *at; /* UTC */
    bool has_tick;
    int64_t tick;
    const char *severity;
    const char *source;
    const char *text;
} tl_show_event;

typedef enum tl_show_source {
    TL_SHOW_FROM_SAMPLES, /* tick, signal, value, quality, stamp_ns */
    TL_SHOW_FROM_STEPS,   /* step, 0, outcome, stop, J, J_nominal, evaluations, executions, used_ns, predicted, flags,
                                 held */
    TL_SHOW_FROM_OUTPUTS, /* step, signal, y, y_hat, quality */
    TL_SHOW_FROM_ADJUSTMENTS, /* step, signal, u, u_hat */
} tl_show_source;

/* The first and the last tick or step at or after `from`; false where there is none. */
tl_status tl_show_range(tl_history *history, const tl_history_run *run, tl_show_source source, int64_t from,
                        int64_t range[2], bool *any, tl_error *error);

/* Who takes the rows. */
typedef struct tl_show_taker {
    void (*take)(void *context, struct sqlite3_stmt *row);
    void *context;
} tl_show_taker;

/* Hands out each row with range[0] ≤ tick or step ≤ range[1], in the order of the key. Signals are below `signals`, values
 * finite numbers or NULL, codes and counts ≥ 0, times in range; else the database is damaged. */
tl_status tl_show_rows(tl_history *history, const tl_history_run *run, tl_show_source source, const int64_t range[2],
                       size_t signals, tl_show_taker taker, tl_error *error);

/* Who takes the events. */
typedef struct tl_show_event_taker {
    void (*take)(void *context, const tl_show_event *event);
    void *context;
} tl_show_event_taker;

/* Events of the run since `from_at` ("": all), the last `most` of them (−1: all), the oldest first. */
tl_status tl_show_event_rows(tl_history *history, const tl_history_run *run, const char *from_at, int64_t most,
                             tl_show_event_taker taker, tl_error *error);

#endif
