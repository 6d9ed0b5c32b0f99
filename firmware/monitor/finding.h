/* Finding: a change of the plant, of its model or of a sensor, with the time at which it began.
 *
 * Purpose: the result of the change detector (change_detector.h), for summaries, events and JSON.
 * Thread:  plain data, pure functions.
 */
#ifndef TL_FIRMWARE_MONITOR_FINDING_H
#define TL_FIRMWARE_MONITOR_FINDING_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/store/run_types.h"

enum { TL_FINDING_NAME = 64, TL_FINDING_UNIT = 24, TL_FINDING_TEXT = 416, TL_FINDINGS = 64 };

typedef enum tl_finding_kind {
    TL_FINDING_STEP,   /* a lasting change of the mean */
    TL_FINDING_DRIFT,  /* the mean has more than doubled its first change, in the same direction */
    TL_FINDING_FREEZE, /* a signal repeats one value (frozen.h) */
    TL_FINDING_LIMIT   /* a correction is outside the user's limits (limit_window.h) */
} tl_finding_kind;

/* What has changed. */
typedef enum tl_finding_subject {
    TL_FINDING_CORRECTION, /* Δu of an adjusted variable */
    TL_FINDING_OUTPUT,     /* ŷ minus y of the released twin, of a matched or compared output */
    TL_FINDING_SIGNAL      /* a signal of the plant; only with FREEZE */
} tl_finding_subject;

/* Cause, from the outputs of the twin released before the onset (master/sync/released_twin.h). */
typedef enum tl_finding_cause {
    TL_FINDING_NO_CAUSE, /* not known: not decided yet, no output was off, or there is only one output */
    TL_FINDING_SENSOR,   /* one output was off: its sensor, or an input that acts on it alone */
    TL_FINDING_PLANT     /* several outputs were off: the plant, not one sensor */
} tl_finding_cause;

/* Times are s since t_start. Texts that are too long are cut. */
typedef struct tl_finding {
    uint32_t number; /* 1, 2, …, in the order of detection */
    tl_finding_kind kind;
    tl_finding_subject subject;
    uint32_t index;                 /* of the adjusted variable, match or signal */
    char variable[TL_FINDING_NAME]; /* name; OUTPUT, SIGNAL: of the plant's signal, without "plant." */
    char says[TL_CONFIG_WORDS];     /* the user's words for the variable; "": none */
    char unit[TL_FINDING_UNIT];     /* "": none */
    bool is_gone;                   /* the variable is normal again */
    bool is_normal;                 /* a user has accepted its level as normal */
    double onset, onset_spread;     /* instant of its beginning ± half the width of the possible range */
    double found, gone;             /* instants of its detection and of its end (only if is_gone) */
    double size, size_spread;       /* change in the variable's unit, and its standard error */
    double percent; /* size in percent of the mean û or ŷ since the onset; NaN: that mean is about 0 */
    tl_finding_cause cause;
    bool is_decided;               /* `cause` is final */
    char sensor[TL_FINDING_NAME];  /* if the cause is SENSOR: name of its signal, without "plant." */
    uint64_t corrections, outputs; /* bit i: adjusted variable i, or output i, has changed */
} tl_finding;

/* Results of a change detector. */
typedef struct tl_changes {
    const tl_finding *finding; /* in the order of detection; beyond TL_FINDINGS the oldest closed one is dropped */
    size_t count;
    tl_run_detection detection;
} tl_changes;

/* Returns true if it is neither gone nor accepted as normal. */
bool tl_finding_is_open(const tl_finding *finding);

/* Names for JSON: "step", "drift", "freeze", "limit"; "correction", "output", "signal"; "open",
 * "gone", "normal". */
const char *tl_finding_kind_name(tl_finding_kind kind);
const char *tl_finding_subject_name(tl_finding_subject subject);
const char *tl_finding_state_name(const tl_finding *finding);

/* Writes one sentence without a full stop: "feed pump: pump.flow: correction +0.012 m3/s (+5 %)
 * since t = 22680 s ± 10 s". `now`, `started`: as in tl_lock_instant_write(). */
void tl_finding_write(const tl_finding *finding, double now, int64_t started, char text[TL_FINDING_TEXT]);

/* Writes the cause: "sensor plant.level, or an input that acts on it alone"; empty: not known. */
void tl_finding_write_cause(const tl_finding *finding, char text[TL_FINDING_TEXT]);

#endif
