/* The host of an activation (activation.h) in a live run: how the twins are, their tunings, the shadow and the flip.
 *
 * Purpose: what an activation asks and orders, by the memory that the activator shares with the others of the run. It talks about two places
 *          (handover.h): whatever it says of the run is of the place that the stage says.
 * Orders:  one at a time, each obeyed before the next is given. They outlive the process: a successor finds what was ordered and what came of it.
 * Tunings: their numbers grow over both places, so that what the recorder says of one is never taken for another.
 * Trust:   pulses are those of processes with FMUs: numbers are bounded, names are cleaned.
 * Thread:  the activator's.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_HOST_H
#define TL_FIRMWARE_LIVE_LIVE_HOST_H

#include "firmware/live/live_blocks.h"
#include "firmware/retune/activation.h"
#include "firmware/twin/journal.h"
#include "firmware/twin/live_tuning.h"

/* Set by its user, but for the private ones. */
typedef struct tl_live_host {
    tl_live_config_manager_pulse *pulse; /* ours */
    const tl_live_twin_pulse *twins[TL_TWIN_SLOTS];
    tl_live_tuning *tunings[TL_TWIN_SLOTS];
    const tl_live_recorder_pulse *recorder; /* NULL: nothing is recorded */
    const tl_handover *stage;
    tl_live_candidate *candidate;
    char hash[TL_TWIN_SLOTS][TL_SHA256_TEXT]; /* of the configuration in each place; "": none is */
    const char *path;                         /* of the configuration: relative names start at its folder */
    const char *text;                         /* of what the run was of as we began, */
    const char *text_hash;                    /* and its hash */
    tl_time step;
    tl_journal *journal;
    bool wants_none; /* private: a shadow is to end, once what was ordered before is obeyed */
    uint32_t given;  /* private: number of the tuning that was written last, by us */
} tl_live_host;

/* What an activation is given; the host stays. */
tl_activation_host tl_live_host_functions(tl_live_host *host);

/* Every now and then: gives an order that had to wait. */
void tl_live_host_look(tl_live_host *host);

#endif
