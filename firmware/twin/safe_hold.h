/* Safe hold: what is left of a run after a restart loop, or what there is before its twin may begin. There is no twin and no FMU; the plant is read, and its
 * samples are recorded. Log and status line say what has happened, and when the twin is tried again.
 *
 * Purpose: a box that cannot keep its twin alive still loses nothing: what it records can be replayed once the fault is found.
 * Ticks:   as the cycle's, T_S apart; nothing is computed, so ordinary scheduling will do, and what was late is taken up at once.
 * Thread:  the main thread, until it is told to end.
 */
#ifndef TL_FIRMWARE_TWIN_SAFE_HOLD_H
#define TL_FIRMWARE_TWIN_SAFE_HOLD_H

#include "firmware/config/config.h"
#include "firmware/plant/plant_input.h"
#include "firmware/process/heartbeat.h"
#include "firmware/store/outbox.h"
#include "firmware/twin/journal.h"

typedef struct tl_safe_hold_settings {
    const tl_config *config;
    const tl_plant_input *input;
    tl_outbox *outbox;
    tl_journal *journal;
    tl_heartbeats *beats;
    tl_heart *heart;    /* of the thread */
    tl_time time;       /* until the supervisor tries the twin again */
    unsigned missing;   /* starts in a row that got no process; 0: the twin failed */
    unsigned failures;  /* of this loop, */
    const char *reason; /* and why the last of them */
    bool records;       /* somebody writes down what goes into the outbox */
    tl_time
        since; /* 0: after a restart loop. Else: until the saved states of the FMUs are tested; samples from then on */
} tl_safe_hold_settings;

/* Returns once a signal to end has come. */
void tl_safe_hold(const tl_safe_hold_settings *settings);

#endif
