/* The types of a recorded run: its signals, how it begins, what its components count, how much an event matters.
 *
 * Purpose: all that write, read or show a run mean the same by its parts, and need not know the recorder for that.
 * Thread:  plain data; the names are pure.
 */
#ifndef TL_FIRMWARE_STORE_RUN_TYPES_H
#define TL_FIRMWARE_STORE_RUN_TYPES_H

#include <stdint.h>

#include "firmware/base/identity.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/plan/tuning.h"

enum { TL_RECORDER_NAME = 80 }; /* bytes of "plant." and a name of at most 63 characters */

/* One name with its unit. */
typedef struct tl_recorder_signal {
    const char *name; /* "motor.omega", "plant.omega" */
    const char *unit; /* "" where there is none */
    const char *to;   /* match: the plant signal compared with; else NULL */
    tl_type type;
} tl_recorder_signal;

/* One component in the ledger, counted since the run began; see tl_twin_ledger. */
typedef struct tl_recorder_component {
    uint64_t plain;
    uint64_t predicted;
    uint64_t executions;
    uint64_t caught_up;
    uint64_t unstored;
} tl_recorder_component;

typedef struct tl_run_component {
    const char *name;
    tl_recorder_component counts;
} tl_run_component;

/* FMUs and the plant. */
enum { TL_RECORDER_COMPONENTS = 64 };

/* How a run began; of one that goes on with an earlier one, what it began with. */
typedef enum tl_resumed_from {
    TL_RESUMED_NOT,
    TL_RESUMED_CHECKPOINT, /* the twin as that run had saved it */
    TL_RESUMED_START,      /* the FMUs' start values, where that run began */
    TL_RESUMED_INPUTS      /* the same, some time before it ended */
} tl_resumed_from;

/* "", "checkpoint", "start", "inputs"; and from a name, TL_RESUMED_NOT where it is none. */
const char *tl_resumed_from_name(tl_resumed_from from);
tl_resumed_from tl_resumed_from_named(const char *name);

/* How a run goes on with an earlier one. */
typedef struct tl_resumption {
    tl_resumed_from from; /* TL_RESUMED_NOT: it does not, and nothing below means anything */
    int64_t run;          /* which */
    int64_t tick;         /* the first of its own: those before it were that run's, and are followed */
    tl_time start;        /* t_start on the clock of the samples' stamps; both are that run's */
    int64_t started;      /* and UTC, ms */
} tl_resumption;

/* A tuning that a twin has in force, and of which configuration it is. */
typedef struct tl_run_tuning {
    int64_t tick; /* the first with it */
    uint32_t
        number; /* of what the twin was told it by, see live_tuning.h; 0: it was built with it, or that is not known */
    char hash[TL_SHA256_TEXT]; /* of the configuration's text: tl_identity_is_sound(); "": not known */
    char unused[3];            /* so that no byte of it is indeterminate */
    tl_tuning values;
} tl_run_tuning;

/* A configuration that a run may be begun with, or take, besides its own. */
typedef struct tl_recorder_known {
    uint32_t number;    /* as in tl_run_tuning; 0: any */
    const char *hash;   /* of the text; "": there is none */
    const char *text;   /* UTF-8 */
    const char *at;     /* UTC, when it was taken; NULL: when it is recorded */
    const char *who;    /* told so, */
    const char *origin; /* how, */
    const char *why;
} tl_recorder_known;

/* How much an event matters. */
typedef enum tl_severity { TL_EVENT_INFO, TL_EVENT_WARNING, TL_EVENT_ERROR } tl_severity;

/* "info", "warning", "error". */
const char *tl_severity_name(tl_severity severity);

#endif
