/* Reads what was recorded.
 *
 * Thread:  one for each history.
 */
#ifndef TL_FIRMWARE_STORE_HISTORY_H
#define TL_FIRMWARE_STORE_HISTORY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/run_types.h"
#include "master/base/signal.h"
#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/twin/twin.h"

/* ---- History: what a database that the recorder wrote holds. Reading only, also while a run is being written.
 *
 * Purpose: runs, their signals and configurations, and the ticks of a run one by one, for `show` and for replaying what
 *          a box saw. config/SPEC.md, "Database", says what everything means.
 * Reading: in short transactions, so that a slow reader does not keep the recorder from writing its log back.
 * Trust:   none. Whatever is given out is what the recorder writes: in range, in order, finite, UTF-8. Anything else is damage.
 * Owner:   texts and arrays that are given out live until tl_history_close().
 * Errors:  TL_BAD_DATA (no database of ours, damaged, no such run), TL_TRY_AGAIN (locked, no permission).
 * Thread:  one thread at a time.
 */

typedef struct tl_history tl_history;

typedef struct tl_history_run {
    int64_t run; /* its id */
    const char *verb;
    const char *name;               /* of the configuration */
    const char *version;            /* of the program that wrote it */
    const char *configuration_hash; /* SHA-256 of the configuration's text */
    const char *started;            /* UTC */
    const char *ended;              /* UTC; NULL: is being written, or was killed and nobody wrote since */
    const char *ended_reason;       /* NULL like ended */
    const char *committed;          /* UTC of the last commit */
    tl_time step;                   /* T_S, ns */
    uint32_t prediction;            /* T_P */
    uint32_t lead;                  /* step i was computed at tick i + lead */
    tl_pairing measurements;
    uint64_t samples, steps, events, lost; /* written, and lost */
    tl_resumption resumption;              /* `start` and `started` are not in it: */
    bool has_start;                        /* t_start is known on the clock of that boot, */
    tl_time start;                         /* ns */
    const char *boot;
    const char *fmus;       /* SHA-256 over those of the FMUs */
    int64_t removed_before; /* retention has removed the ticks and steps before this one; 0: none */
} tl_history_run;

typedef enum tl_history_kind { TL_HISTORY_PLANT, TL_HISTORY_MATCH, TL_HISTORY_ADJUST } tl_history_kind;

tl_status tl_history_open(const char *path, tl_history **history, tl_error *error);

/* NULL is allowed. */
void tl_history_close(tl_history *history);

/* All runs, the oldest first; none is no error. */
tl_status tl_history_runs(tl_history *history, const tl_history_run **runs, size_t *count, tl_error *error);

/* The run with this id; with 0 the last one. */
tl_status tl_history_find(tl_history *history, int64_t id, const tl_history_run **run, tl_error *error);

/* A configuration that a run took while it ran, which differs from the one before in its tuning. */
typedef struct tl_history_tuning {
    int64_t tick;     /* the first with it */
    const char *hash; /* SHA-256 of the configuration's text */
    const char *at;   /* UTC */
    const char *who;
    const char *origin;
    const char *why;
} tl_history_tuning;

/* More of one run are damage. */
enum { TL_HISTORY_TUNINGS = 100000 };

/* Those of a run, in the order of their ticks; none in most, and in those of a program that took none. */
tl_status tl_history_tunings(tl_history *history, const tl_history_run *run, const tl_history_tuning **tunings,
                             size_t *count, tl_error *error);

/* The text of a configuration that a run or a tuning names. */
tl_status tl_history_text(tl_history *history, const char *hash, const char **text, tl_error *error);

/* The signals of one kind, in the order of the arrays of tl_sample (plant) and tl_record (match, adjust). */
tl_status tl_history_signals(tl_history *history, const tl_history_run *run, tl_history_kind kind,
                             const tl_recorder_signal **signals, size_t *count, tl_error *error);

/* The ledger of a run, as of the last commit; the plant is the last component. None in the runs of a program that kept no ledger. */
tl_status tl_history_ledger(tl_history *history, const tl_history_run *run, const tl_run_component **components,
                            size_t *count, tl_error *error);

/* The twin after a tick, as the run had saved it. */
typedef struct tl_history_checkpoint {
    int64_t tick;
    const char *format; /* who can read it */
    const unsigned char *bytes;
    size_t size;
    bool whole; /* false: damaged */
} tl_history_checkpoint;

/* The newest before `before`; NULL where there is none. */
tl_status tl_history_checkpoint_before(tl_history *history, const tl_history_run *run, int64_t before,
                                       const tl_history_checkpoint **checkpoint, tl_error *error);

/* What the newest steps took, ns per execution, at most a second; 0 where that is not known. */
tl_time tl_history_execution_cost(tl_history *history, const tl_history_run *run);

/* The newest step that is there; −1: none. */
tl_status tl_history_last_step(tl_history *history, const tl_history_run *run, int64_t *step, tl_error *error);

/* The last tick or step that a run can have: no time of it is out of range. */
int64_t tl_history_last_possible(const tl_history_run *run);

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

/* One tick, and the step that was computed at it: tick − lead. */
typedef struct tl_history_tick {
    tl_sample sample;        /* stamps count from t_start; signals that the run does not have: no link */
    bool has_step;           /* false for the first ticks, and where the record of the step was lost */
    tl_history_step step;    /* with has_step. Its codes have names here. TL_MADE_UP: the run missed this tick */
    double u[TL_MAX_ADJUST]; /* of the adjusted variables, */
    size_t adjusted;         /* of which so many have one */
} tl_history_tick;

/* A walk through the ticks of a run that are still there. */
typedef struct tl_history_ticks tl_history_ticks;

/* From tick `from` on. The history must outlive the walk. Several walks may be under way. */
tl_status tl_history_ticks_begin(tl_history *history, const tl_history_run *run, int64_t from, tl_history_ticks **ticks,
                                 tl_error *error);

/* The next tick that is there; ticks that were lost or removed are left out, so look at sample.tick. *end where there
 * is none (yet, in a run that is being written). */
tl_status tl_history_ticks_next(tl_history_ticks *ticks, tl_history_tick *tick, bool *end, tl_error *error);

/* NULL is allowed. */
void tl_history_ticks_end(tl_history_ticks *ticks);

/* Adds to the words of an error what is wrong with the pages of the file, if it is small and that is it: reads all of it, so never
 * while a plant waits. NULL is allowed. */
void tl_history_diagnose(tl_history *history, tl_error *error);

/* ---- The rows of one run as they were recorded, handed out one by one.
 *
 * Purpose: a table may have a hundred million rows. They are read in short transactions, so that a slow reader (a pager)
 *          does not keep the recorder from writing its log back, and none of them is kept.
 * Trust:   none, as in history.h: a row that the recorder does not write is damage, and not handed out.
 * Numbers: finite, or NaN if what was recorded was not.
 * Codes:   at least 0. A newer program may have written one that has no name here.
 * Errors:  those of history.h.
 * Thread:  the history's.
 */

/* One signal of the plant at one tick. */
typedef struct tl_history_sample {
    int64_t tick;
    size_t signal;
    double value;
    int64_t quality; /* tl_quality */
    tl_time stamp;   /* ns, of the run's clock; TL_TIME_NEVER: there never was a reading */
} tl_history_sample;

/* One matched output after one step. */
typedef struct tl_history_output {
    int64_t step;
    size_t signal;
    double y;
    double measured;
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
    double nominal; /* nominal */
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
    bool strict;                           /* codes that have no name here are damage too */
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

/* The first and the last tick (of samples) or step that is there at or after `from` (INT64_MIN: of all); *any is false if there is none. */
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
