/* The rows of one run as they were recorded, handed out one by one.
 *
 * Purpose: a table may have a hundred million rows. They are read in short transactions, so that a slow reader (a pager)
 *          does not keep the recorder from writing its log back, and none of them is kept.
 * Trust:   none, as in history.h: a row that the recorder does not write is damage, and not handed out.
 * Numbers: finite, or NaN if what was recorded was not.
 * Codes:   at least 0. A newer program may have written one that has no name here.
 * Errors:  those of history.h.
 * Thread:  the history's.
 */
#ifndef TL_FIRMWARE_STORE_HISTORY_ROWS_H
#define TL_FIRMWARE_STORE_HISTORY_ROWS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/history.h"

/* One signal of the plant at one tick. */
typedef struct tl_history_sample {
    int64_t tick;
    size_t signal;
    double value;
    int64_t quality; /* tl_quality */
    tl_time stamp;   /* ns, of the run's clock; TL_TIME_NEVER: there never was a reading */
} tl_history_sample;

/* One step; what tl_record says of it. */
typedef struct tl_history_step {
    int64_t step;
    int64_t outcome; /* tl_outcome */
    int64_t stop;    /* tl_stop */
    double objective;
    double objective_nominal;
    int64_t evaluations;
    int64_t executions;
    tl_time used;
    int64_t predicted;
    uint32_t flags;
    uint32_t held;
} tl_history_step;

/* One matched output after one step. */
typedef struct tl_history_output {
    int64_t step;
    size_t signal;
    double y;
    double y_hat;
    int64_t quality;  /* tl_quality, of y_hat */
    int64_t readings; /* of the plant within the step; */
    double squares;   /* Σ(y − ŷ)² at them; NaN if that was not finite; */
    int64_t rejected; /* and those that were rejected */
} tl_history_output;

/* One adjusted variable in one step. */
typedef struct tl_history_adjustment {
    int64_t step;
    size_t signal;
    double u;
    double u_hat; /* nominal */
} tl_history_adjustment;

/* An event; texts are valid while it is handed out. */
typedef struct tl_history_event {
    const char *at; /* UTC */
    bool has_tick;
    int64_t tick;
    const char *severity;
    const char *source;
    const char *text;
} tl_history_event;

/* Who takes rows. */
typedef struct tl_history_visitor {
    void *context;
    size_t signals[TL_HISTORY_ADJUST + 1]; /* of each tl_history_kind, what there is room for: another one is damage */
    /* NULL: nobody takes the rows of this table, and they are not read. */
    void (*sample)(void *context, const tl_history_sample *sample);
    void (*step)(void *context, const tl_history_step *step);
    void (*output)(void *context, const tl_history_output *output);
    void (*adjustment)(void *context, const tl_history_adjustment *adjustment);
    void (*event)(void *context, const tl_history_event *event);
} tl_history_visitor;

typedef enum tl_history_table {
    TL_HISTORY_SAMPLES,
    TL_HISTORY_STEPS,
    TL_HISTORY_OUTPUTS,
    TL_HISTORY_ADJUSTMENTS
} tl_history_table;

/* The first and the last tick (of samples) or step that is there at or after `from`; *any is false if there is none. */
tl_status tl_history_range(tl_history *history, const tl_history_run *run, tl_history_table table, int64_t from,
                           int64_t range[2], bool *any, tl_error *error);

/* Hands out each row with range[0] ≤ tick or step ≤ range[1]: table by table in the order of the visitor, each in the order
 * of tick or step, then signal. A signal is an index into what tl_history_signals() gives. Events are not among them. */
tl_status tl_history_rows(tl_history *history, const tl_history_run *run, const int64_t range[2],
                          const tl_history_visitor *visitor, tl_error *error);

/* Hands out the events since `from_at` ("": all), the last `most` of them (−1: all), the oldest first. */
tl_status tl_history_events(tl_history *history, const tl_history_run *run, const char *from_at, int64_t most,
                            const tl_history_visitor *visitor, tl_error *error);

#endif
