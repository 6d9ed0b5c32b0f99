/* History: reads the recorded runs from a database; read-only, also while a run is being written.
 *
 * Owner:   a history owns the texts and arrays that it returns.
 * Thread:  one at a time for each history.
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

/* ---- Runs of a database, and everything that belongs to one run.
 *
 * Purpose: returns runs, their signals and configurations, and the ticks of a run one by one, for
 *          `show` and for replay. docs/reference/database.md explains the tables.
 * Reading: in short transactions, because the recorder cannot write its log (FILE-wal) back during
 *          one. Callbacks are called within one, so they must not block, except `pause`.
 * Trust:   the database is untrusted. Returned values are valid: in range, ordered, UTF-8, as the
 *          recorder writes them. All other content is reported as damage.
 * Owner:   returned texts and arrays are valid until tl_history_close().
 * Errors:  TL_BAD_DATA (not a twinlock database, damaged, no such run), TL_TRY_AGAIN (locked, no
 *          permission, out of memory).
 */

typedef struct tl_history tl_history;

typedef struct tl_history_run {
    int64_t run;                    /* id, from 1 */
    const char *verb;               /* "run", "hold" (safe hold), "replay" */
    const char *name;               /* of the configuration */
    const char *version;            /* of the program that wrote it */
    const char *configuration_hash; /* SHA-256 of the configuration's text */
    const char *started;            /* UTC */
    const char *ended;              /* UTC; NULL: being written, or killed and no run has followed */
    const char *ended_reason;       /* NULL if `ended` is NULL */
    const char *committed;          /* UTC of the last commit */
    tl_time step;                   /* T_S, ns */
    uint32_t prediction;            /* T_P, steps */
    uint32_t lead;                  /* step i was computed at tick i + lead */
    tl_pairing measurements;
    tl_experiment experiment;              /* start and stop time of the FMUs; zeros in safe hold */
    uint64_t samples, steps, events, lost; /* numbers of written entries; `lost`: of those not written */
    tl_resumption resumption;              /* `start` and `started` are not set */
    bool has_start;                        /* `start` is known */
    tl_time start;                         /* t_start, CLOCK_MONOTONIC of `boot`, ns */
    const char *boot;                      /* boot ID of the system */
    const char *fmus;                      /* SHA-256 over the SHA-256 of the FMUs; "": unknown */
    int64_t removed_before;                /* the file has no earlier ticks and steps; 0: it has all */
} tl_history_run;

/* Plant signals, matched outputs, adjusted variables. */
typedef enum tl_history_kind { TL_HISTORY_PLANT, TL_HISTORY_MATCH, TL_HISTORY_ADJUST } tl_history_kind;

/* Opens an existing database (tl_database_open()); *history is NULL after a failure. */
tl_status tl_history_open(const char *path, tl_history **history, tl_error *error);

/* NULL is allowed. */
void tl_history_close(tl_history *history);

/* Returns all runs, the oldest first; an empty list is no error. */
tl_status tl_history_runs(tl_history *history, const tl_history_run **runs, size_t *count, tl_error *error);

/* Finds the run with this id; 0: the last run. Fails with TL_BAD_DATA if there is no such run. */
tl_status tl_history_find(tl_history *history, int64_t id, const tl_history_run **run, tl_error *error);

/* A configuration that a run switched to. Only its tuning differs from that of the one before. */
typedef struct tl_history_tuning {
    int64_t tick;       /* first tick with it */
    const char *hash;   /* SHA-256 of the configuration's text */
    const char *at;     /* UTC */
    const char *who;    /* user who requested it; "": unknown */
    const char *origin; /* way of the request (change.h) */
    const char *why;
} tl_history_tuning;

/* Most tunings of a run; more are damage. */
enum { TL_HISTORY_TUNINGS = 100000 };

/* Returns the tunings of a run in the order of their ticks. Most runs have none. */
tl_status tl_history_tunings(tl_history *history, const tl_history_run *run, const tl_history_tuning **tunings,
                             size_t *count, tl_error *error);

/* Returns the text of a configuration. `hash`: of a run or a tuning. *text is "" if the text was
 * unknown, or was removed with the ticks of its runs. */
tl_status tl_history_configuration_text(tl_history *history, const char *hash, const char **text, tl_error *error);

/* Returns the signals of one kind, in the order of the arrays of tl_sample (plant) and tl_record
 * (match, adjust). */
tl_status tl_history_signals(tl_history *history, const tl_history_run *run, tl_history_kind kind,
                             const tl_recorder_signal **signals, size_t *count, tl_error *error);

/* Returns the counts of all components at the last commit; the plant is the last component. */
tl_status tl_history_ledger(tl_history *history, const tl_history_run *run, const tl_run_component **components,
                            size_t *count, tl_error *error);

/* A finding, with the user's notes and the answer of `twinlock explain`. */
typedef struct tl_history_finding {
    tl_run_finding row;          /* numbers may be NaN, except onset and found */
    int64_t run;                 /* the times in `row` count from t_start of this run */
    int64_t started;             /* that t_start, ms since 1970 UTC; 0: of a replay */
    const char *acknowledged_at; /* UTC; NULL: not acknowledged, and the next two are NULL */
    const char *acknowledged_by;
    const char *note;         /* NULL: none */
    const char *explained_at; /* UTC; NULL: not explained, and `explanation` is NULL */
    const char *explanation;  /* answer of `twinlock explain` */
} tl_history_finding;

/* Most findings of a database; more are damage. */
enum { TL_HISTORY_FINDINGS = 1000000 };

/* If `run` is a replay, returns its findings, else those of all live runs; ordered by number. */
tl_status tl_history_findings(tl_history *history, const tl_history_run *run, const tl_history_finding **findings,
                              size_t *count, tl_error *error);

/* Reads the state of the change detector that this replay, or else any live run, has stored last.
 * *any is false if there is none. */
tl_status tl_history_detection(tl_history *history, const tl_history_run *run, tl_run_detection *detection, bool *any,
                               tl_error *error);

/* A checkpoint: the twin after a tick. */
typedef struct tl_history_checkpoint {
    int64_t tick;
    const char *format; /* only a program with the same tl_identity_format() can load it */
    const unsigned char *bytes;
    size_t size;
    bool whole; /* false: damaged, the digest of `bytes` is wrong */
} tl_history_checkpoint;

/* Finds the newest checkpoint before tick `before`; *checkpoint is NULL if there is none. */
tl_status tl_history_checkpoint_before(tl_history *history, const tl_history_run *run, int64_t before,
                                       const tl_history_checkpoint **checkpoint, tl_error *error);

/* Returns the mean time of one FMU execution in the newest 1000 steps, ns, ≤ 1 s; 0: unknown. */
tl_time tl_history_execution_cost(tl_history *history, const tl_history_run *run);

/* Finds the number of the newest recorded step; −1: none. */
tl_status tl_history_last_step(tl_history *history, const tl_history_run *run, int64_t *step, tl_error *error);

/* Returns the last tick or step that a run can have, so that no time is out of range. */
int64_t tl_history_last_possible(const tl_history_run *run);

/* One step; the fields are those of tl_record (record.h). Numbers that were not finite are NaN. */
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

/* One tick and the step that was computed at it, which is step tick − lead. */
typedef struct tl_history_tick {
    tl_sample sample;        /* stamps: ns since t_start; a signal without a row has TL_NO_LINK */
    bool has_step;           /* false for the first ticks, and if the step was lost */
    tl_history_step step;    /* valid if has_step; with known codes. TL_CAUGHT_UP: the run missed this tick */
    double u[TL_MAX_ADJUST]; /* applied u of the adjusted variables */
    size_t adjusted;         /* number of valid elements of u */
} tl_history_tick;

/* Iterator over the recorded ticks of a run. */
typedef struct tl_history_ticks tl_history_ticks;

/* Starts at tick `from`. The history must outlive the iterator. Several iterators may exist. */
tl_status tl_history_ticks_begin(tl_history *history, const tl_history_run *run, int64_t from, tl_history_ticks **ticks,
                                 tl_error *error);

/* Reads the next recorded tick. Lost and removed ticks are skipped, so check sample.tick. *end is
 * true, and `tick` not set, if there is no further tick (yet, if the run is being written). */
tl_status tl_history_ticks_next(tl_history_ticks *ticks, tl_history_tick *tick, bool *end, tl_error *error);

/* NULL is allowed. */
void tl_history_ticks_end(tl_history_ticks *ticks);

/* Checks the pages of a file of at most 64 MB, and appends the first corruption to the error's
 * text. Reads the whole file: do not call during a live run. A NULL history is allowed. */
void tl_history_diagnose(tl_history *history, tl_error *error);

/* ---- Rows of one run, as they were recorded, passed to callbacks one by one.
 *
 * Purpose: a table may have a hundred million rows. They are read in transactions of at most 4096
 *          rows, and no row is stored. Callbacks may be slow, for example print to a pager.
 * Trust:   a row that the recorder cannot have written is damage, and is not passed on.
 * Numbers: finite, or NaN if the recorded value was not finite.
 * Codes:   at least 0. A newer program may have written codes that are unknown here.
 * Signals: `signal` is an index into the array of tl_history_signals().
 */

/* One plant signal at one tick. */
typedef struct tl_history_sample {
    int64_t tick;
    size_t signal;
    double value;
    int64_t quality; /* tl_quality */
    tl_time stamp;   /* ns since t_start; TL_TIME_NEVER: no reading yet */
} tl_history_sample;

/* One matched output after one step. */
typedef struct tl_history_output {
    int64_t step;
    size_t signal;
    double y;
    double measured;
    int64_t quality;  /* tl_quality of the measured value */
    int64_t readings; /* number of readings within the step */
    double squares;   /* Σ(y − ŷ)² at the readings; NaN if it was not finite */
    int64_t rejected; /* number of rejected readings */
    double released;  /* y of a released twin; NaN: there was none, or it was not finite */
} tl_history_output;

/* One adjusted variable in one step. */
typedef struct tl_history_adjustment {
    int64_t step;
    size_t signal;
    double u;       /* applied */
    double nominal; /* û */
} tl_history_adjustment;

/* An event; the texts are valid during the callback. */
typedef struct tl_history_event {
    const char *at; /* UTC */
    bool has_tick;
    int64_t tick;
    const char *severity; /* "info", "warning", "error", or an unknown code as a number */
    const char *source;   /* one word, for example "plant" */
    const char *text;
} tl_history_event;

/* Summary of one minute or hour of a series. Texts are valid during the callback. */
typedef struct tl_history_period {
    const tl_history_run *run;
    int64_t start_s;  /* start of the minute or hour, s since t_start of the run */
    const char *kind; /* "plant"; "match": Δy; "adjust": Δu; "outcome" */
    const char *name; /* of the signal, variable or outcome; "": unknown */
    const char *unit;
    int64_t count;                       /* of values, or of steps */
    double mean, least, largest, spread; /* spread: standard deviation. NaN: not finite, or an outcome */
} tl_history_period;

/* Callbacks for rows. */
typedef struct tl_history_visitor {
    void *context;
    bool strict;                           /* unknown codes are damage too (not in output.quality) */
    size_t signals[TL_HISTORY_ADJUST + 1]; /* count of each tl_history_kind; a higher index is damage */
    /* NULL: tl_history_rows() skips this table; `event` and `period`: see the functions below. */
    void (*sample)(void *context, const tl_history_sample *sample);
    void (*step)(void *context, const tl_history_step *step);
    void (*output)(void *context, const tl_history_output *output);
    void (*adjustment)(void *context, const tl_history_adjustment *adjustment);
    void (*event)(void *context, const tl_history_event *event);
    void (*period)(void *context, const tl_history_period *period);
    void (*pause)(void *context); /* may be NULL; called between transactions: the time for output */
} tl_history_visitor;

/* Tables that tl_history_range() searches. */
typedef enum tl_history_table {
    TL_HISTORY_SAMPLES,
    TL_HISTORY_STEPS,
    TL_HISTORY_OUTPUTS,
    TL_HISTORY_ADJUSTMENTS
} tl_history_table;

/* Finds the first and the last recorded tick (of samples) or step at or after `from` (INT64_MIN: of
 * all). *any is false if there is none. */
tl_status tl_history_range(tl_history *history, const tl_history_run *run, tl_history_table table, int64_t from,
                           int64_t range[2], bool *any, tl_error *error);

/* Passes each row with range[0] ≤ tick or step ≤ range[1] to its callback: samples, steps, outputs,
 * then adjustments, each ordered by tick or step, then signal. Events and periods: see below. */
tl_status tl_history_rows(tl_history *history, const tl_history_run *run, const int64_t range[2],
                          const tl_history_visitor *visitor, tl_error *error);

/* Passes minutes (`length_s` 60) or hours (3600) to the callback: of `run` if it is a replay, else
 * of all live runs. Order: run, time, kind, signal. */
tl_status tl_history_periods(tl_history *history, const tl_history_run *run, int length_s,
                             const tl_history_visitor *visitor, tl_error *error);

/* Passes the events of the run at or after `from_at` (UTC, ISO 8601; "": all) to the callback, of
 * these the newest `most` (−1: all). Order: oldest first. */
tl_status tl_history_events(tl_history *history, const tl_history_run *run, const char *from_at, int64_t most,
                            const tl_history_visitor *visitor, tl_error *error);

#endif
