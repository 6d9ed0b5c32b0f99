/* The host of an activation: what a change of the configuration can do to the running plant, and see of it.
 *
 * Purpose: the room says when; the process that it runs in knows how, by memory that it shares with the others of the run.
 * Thread:  all calls are in the thread of the activation, and none waits.
 */
#ifndef TL_FIRMWARE_RETUNE_ACTIVATION_HOST_H
#define TL_FIRMWARE_RETUNE_ACTIVATION_HOST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/monitor/run_status.h"
#include "firmware/retune/probation.h"
#include "firmware/retune/versions.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/live_stage.h"
#include "master/plan/tuning.h"

enum { TL_ACTIVATION_WHY = 192, TL_ACTIVATION_LINE = 512 };

/* How the run is. */
typedef struct tl_activation_view {
    tl_run_status figures;         /* of the run: all begin at 0 with another one, also by a flip */
    double step_s;                 /* T_S */
    bool holds;                    /* safe hold: there is no twin, */
    bool waits;                    /* because it may not begin yet: this is no time of a probation */
    char line[TL_ACTIVATION_LINE]; /* the status line */
} tl_activation_view;

typedef enum tl_activation_news {
    TL_ACTIVATION_WAITS,  /* for the twin, or for the recorder to have kept the one before */
    TL_ACTIVATION_TAKEN,  /* it is in force since a tick, and will be for each twin that follows */
    TL_ACTIVATION_REFUSED /* by the twin */
} tl_activation_news;

/* A candidate whose twin shall run beside the run's. */
typedef struct tl_activation_candidate {
    const char *text;
    size_t size;
    const char *hash;
    tl_live_needs needs;                /* found by a trial, and bounded */
    const tl_lock_yardstick *yardstick; /* what its twin's lock is judged by as well; zeroed: nothing else */
} tl_activation_candidate;

/* In the reason of a shadow that has ended since it could not keep pace beside the run's twin. */
#define TL_ACTIVATION_NO_ROOM "this box does not carry two twins"

typedef enum tl_activation_phase {
    TL_ACTIVATION_NO_SHADOW,
    TL_ACTIVATION_SHADOW_BEGINS,   /* FMUs are loaded */
    TL_ACTIVATION_SHADOW_RECORDED, /* over recorded samples */
    TL_ACTIVATION_SHADOW_LIVE,     /* at the plant's ticks */
    TL_ACTIVATION_SHADOW_FAILED    /* it could not be begun, or is no more: `why` */
} tl_activation_phase;

/* The twin in the other place, and the run's beside it. */
typedef struct tl_activation_shadow {
    tl_activation_phase phase;
    char hash[TL_SHA256_TEXT]; /* of the configuration that it is of; "": not known */
    char why[TL_ACTIVATION_WHY];
    tl_run_status work;
    tl_run_status beside; /* the run's twin, at the same moment */
} tl_activation_shadow;

typedef struct tl_activation_host {
    void *context;
    void (*look)(void *context, tl_activation_view *view);

    /* The hash of the configuration that the run is of now, or will be from its next tick on. */
    void (*in_force)(void *context, char hash[TL_SHA256_TEXT]);

    /* The text of a configuration with this hash that is in the run's memory, with a NUL behind it; room for TL_CONTROL_MOST + 1 bytes. False: none is. */
    bool (*text)(void *context, const char *hash, char *text, size_t *size);

    /* The files of the FMUs that this text names, which is in force, are others than those that the run's twin has loaded. False: they are the same, or nobody can
     * say. Reads them all. */
    bool (*has_other_fmus)(void *context, const char *text, size_t size);

    /* The lock of the run's twin is judged by this yardstick as well (lock_before), from one of its next ticks on; zeroed: by none. */
    void (*judge_by)(void *context, const tl_lock_yardstick *yardstick);

    /* Hands a version's tuning and text, with a NUL behind it, to the run's twin. False: not yet, since the recorder has not kept the one before. */
    bool (*tune)(void *context, const tl_version *version, const char *why, const char *text, const tl_tuning *tuning);

    /* What came of the newest one. */
    tl_activation_news (*was_taken)(void *context, char why[TL_ACTIVATION_WHY]);

    /* A twin of this shall run as a shadow, in place of any other shadow. False: not yet, since what was ordered before is not obeyed. */
    bool (*begin_shadow)(void *context, const tl_activation_candidate *candidate);
    void (*look_at_shadow)(void *context, tl_activation_shadow *shadow);

    /* There shall be none, from now on, or soon. */
    void (*end_shadow)(void *context);

    /* Shadow and run change places between two ticks: the shadow goes on as a new run, and the run's twin as its shadow. False: not yet, as above. */
    bool (*flip)(void *context);

    /* What came of it: taken, or refused since there was no shadow, with the reason. From then on in_force() is of the new twin, and tunings are its. */
    tl_activation_news (*has_flipped)(void *context, char why[TL_ACTIVATION_WHY]);

    /* The run ends, and another one begins with the version that is active on disk. */
    void (*restart)(void *context);

    /* An event, and a line of the log. */
    void (*tell)(void *context, tl_severity severity, const char *text);
} tl_activation_host;

#endif
