/* The host of an activation: what a change of the configuration can do to the running plant, and see of it.
 *
 * Purpose: the room says when; the process that it runs in knows how, by memory that it shares with the others of the run.
 * Thread:  all calls are in the thread of the activation, and none waits.
 */
#ifndef TL_FIRMWARE_ACTIVATE_ACTIVATION_HOST_H
#define TL_FIRMWARE_ACTIVATE_ACTIVATION_HOST_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/sha256.h"
#include "firmware/outbox/run_types.h"
#include "firmware/versions/probation.h"
#include "master/plan/tuning.h"

enum { TL_ACTIVATION_WHY = 192, TL_ACTIVATION_LINE = 512 };

/* How the run is. */
typedef struct tl_activation_view {
    tl_probation_snapshot figures;
    double step_s;                 /* T_S */
    bool holds;                    /* safe hold: there is no twin */
    char line[TL_ACTIVATION_LINE]; /* the status line */
} tl_activation_view;

/* What a twin is to take. */
typedef struct tl_activation_tuning {
    const tl_tuning *tuning;
    const char *text; /* of the configuration that it is of, with a NUL behind it */
    size_t size;
    const char *hash;
    const char *who, *origin, *why;
} tl_activation_tuning;

typedef enum tl_activation_news {
    TL_ACTIVATION_WAITS,  /* for the twin, or for the recorder to have kept the one before */
    TL_ACTIVATION_TAKEN,  /* it is in force since a tick, and will be for each twin that follows */
    TL_ACTIVATION_REFUSED /* by the twin */
} tl_activation_news;

typedef struct tl_activation_host {
    void *context;
    void (*look)(void *context, tl_activation_view *view);

    /* The hash of the configuration that the run is of now, or will be from its next tick on. */
    void (*in_force)(void *context, char hash[TL_SHA256_TEXT]);

    /* Hands it over. False: not yet, since the recorder has not kept the one before. */
    bool (*tune)(void *context, const tl_activation_tuning *tuning);

    /* What came of the newest one. */
    tl_activation_news (*was_taken)(void *context, char why[TL_ACTIVATION_WHY]);

    /* The run ends, and another one begins with the version that is active on disk. */
    void (*restart)(void *context);

    /* An event, and a line of the log. */
    void (*tell)(void *context, tl_severity severity, const char *text);
} tl_activation_host;

#endif
