/* Types of a recorded run: signals, start of a run, counts of components, severities of events.
 *
 * Purpose: modules that write, read or show a run share these types without depending on the
 *          recorder.
 * Thread:  plain data; the name functions are pure.
 */
#ifndef TL_FIRMWARE_STORE_RUN_TYPES_H
#define TL_FIRMWARE_STORE_RUN_TYPES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/plan/tuning.h"

enum { TL_MINUTE = 60, TL_HOUR = 3600 }; /* s; lengths of the periods that periods.h summarises */
/* Largest time (ns), tick and count that the recorder writes. A sum of four cannot overflow. */
#define TL_ROW_NUMBER_MAX (INT64_MAX / 4)

enum { TL_RECORDER_NAME = 80 }; /* room for "plant.", a name of at most 63 characters, and the NUL */

/* A plant signal, matched output or adjusted variable. */
typedef struct tl_recorder_signal {
    const char *name; /* "motor.omega", "plant.omega" */
    const char *unit; /* "": it has no unit */
    const char *to;   /* plant signal that a matched output is compared with; NULL: not a matched output */
    tl_type type;
} tl_recorder_signal;

/* Counts of one component since the run began, as in tl_twin_ledger (master/twin/twin.h). */
typedef struct tl_execution_counts {
    uint64_t plain;      /* executions if nothing were saved */
    uint64_t predicted;  /* executions that the ledger predicts */
    uint64_t executions; /* executions done */
    uint64_t repeated;   /* executions repeated so that an FMU catches up */
    uint64_t uncached;   /* results that the full cache did not store */
} tl_execution_counts;

/* A component and its counts. */
typedef struct tl_run_component {
    const char *name;
    tl_execution_counts counts;
} tl_run_component;

/* Largest number of components: the FMUs, and the plant as one more. */
enum { TL_RECORDER_COMPONENTS = 64 };

/* How a run started: whether it resumed an earlier run, and from which state. */
typedef enum tl_resumed_from {
    TL_RESUMED_NOT,
    TL_RESUMED_CHECKPOINT, /* the state of the twin that the earlier run saved */
    TL_RESUMED_START,      /* the FMUs' start values, at the start of the earlier run */
    TL_RESUMED_INPUTS      /* the FMUs' start values at a later tick, from which on the recorded inputs exist */
} tl_resumed_from;

/* Returns "", "checkpoint", "start" or "inputs". The second function is the inverse; it returns
 * TL_RESUMED_NOT for an unknown name. */
const char *tl_resumed_from_name(tl_resumed_from from);
tl_resumed_from tl_resumed_from_named(const char *name);

/* How a run resumes an earlier run. A resumed run keeps t_start, so that its ticks continue. */
typedef struct tl_resumption {
    tl_resumed_from from; /* TL_RESUMED_NOT: no resume; then `run` and `tick` have no meaning */
    int64_t run;          /* id of the earlier run */
    int64_t tick;         /* first tick that the new run computes itself; before, it repeats the earlier run */
    tl_time start;        /* t_start, ns, on the clock of the samples' stamps (CLOCK_MONOTONIC) */
    int64_t started;      /* t_start, ms since 1970-01-01 UTC */
    double start_s;       /* the FMUs' time at tick 0, s (tl_experiment in plan.h) */
} tl_resumption;

/* A tuning that a twin uses, and the configuration that contains it. */
typedef struct tl_run_tuning {
    int64_t tick;              /* first tick with this tuning */
    uint32_t number;           /* of the request (live_tuning.h); 0: no request, or unknown */
    char hash[TL_SHA256_TEXT]; /* SHA-256 of the configuration, hexadecimal; "": unknown */
    char unused[3];            /* explicit padding, so that each byte is defined */
    tl_tuning values;
} tl_run_tuning;

/* A configuration that a run may switch to, besides that of its file. The recorder knows the text
 * before the run uses it. */
typedef struct tl_recorder_known {
    uint32_t number;    /* of the request, as in tl_run_tuning; 0: of any request */
    const char *hash;   /* SHA-256 of the text; "": unused element */
    const char *text;   /* UTF-8 */
    const char *at;     /* when it was activated, UTC (ISO 8601); NULL: the time of recording */
    const char *who;    /* user who requested it */
    const char *origin; /* way of the request: "reload", "network", … (change.h) */
    const char *why;    /* the user's reason; "": none */
} tl_recorder_known;

/* A finding (monitor/finding.h) as a row of the database. Times: s since t_start, negative if
 * before it. Texts are UTF-8. `kind`, `subject` and `state` have the names of JSON. */
typedef struct tl_run_finding {
    int64_t number;             /* 1, 2, … in a database */
    const char *kind;           /* "step", "drift", "freeze", "limit" */
    const char *subject;        /* "correction", "output", "signal" */
    const char *variable;       /* adjusted variable; else the plant signal, without "plant." */
    const char *says;           /* the user's words for the variable; "": none */
    const char *unit;           /* "": none */
    double onset, onset_spread; /* when the change began, and half the width of its range */
    double found, gone;         /* when it was detected, and when it ended; gone NaN: it lasts */
    double size, size_spread;   /* change and its standard error, in `unit` */
    double percent;             /* change in % of the mean before; NaN: unknown */
    const char *also;           /* further variables that have changed, one per line */
    const char *cause;          /* "plant"; "plant.NAME": this sensor, or an input that acts on it alone; "": unknown */
    const char *state;          /* "open", "gone"; "normal": accepted by a user, or learnt as the normal state */
} tl_run_finding;

/* State of the change detector (monitor/change_detector.h). */
typedef struct tl_run_detection {
    bool is_ready;         /* learning has ended, and changes are reported */
    double learnt, needed; /* s of learning so far, and s that learning takes */
    double watched;        /* s since learning ended */
} tl_run_detection;

/* Findings and state of the change detector, and its bytes for the next process. */
typedef struct tl_run_changes {
    tl_run_detection detection;
    bool is_new;                   /* learning began again: open findings of live runs become "normal" */
    int64_t started;               /* t_start, ms since 1970 UTC; 0: a replay */
    const tl_run_finding *finding; /* array */
    size_t count;                  /* number of findings */
    const unsigned char *learned;  /* what the detector has learnt, as in change_detector.h */
    size_t size;                   /* bytes of `learned` */
} tl_run_changes;

/* Severity of an event. */
typedef enum tl_severity { TL_EVENT_INFO, TL_EVENT_WARNING, TL_EVENT_ERROR } tl_severity;

/* Returns "info", "warning" or "error". */
const char *tl_severity_name(tl_severity severity);

#endif
