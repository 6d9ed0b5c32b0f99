/* Live host: gives an activation access to the live run: status of the twins, tunings, shadow and
 * handover. An activation changes the configuration of the run in several steps (activation.h).
 *
 * Purpose: reads and writes the memory that the config manager shares with the other processes. The
 *          live twin is in the slot that the handover block names (handover.h).
 * Orders:  start a shadow, end it, hand over: the supervisor executes them (handover_control.h).
 *          The host writes the next order when the supervisor has executed the previous one. Orders
 *          outlive the process: a restarted config manager finds the order and its result.
 * Tunings: both slots share one sequence of numbers, because the recorder reports only the number
 *          of the newest tuning that it has recorded.
 * Trust:   status blocks come from processes with FMUs: their numbers are bounded, names cleaned.
 * Memory:  the caller owns all blocks; they must outlive the host.
 * Errors:  the functions of the host return them.
 * Thread:  the config manager's.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_HOST_H
#define TL_FIRMWARE_LIVE_LIVE_HOST_H

#include "firmware/live/live_blocks.h"
#include "firmware/report/journal.h"
#include "firmware/retune/activation.h"
#include "firmware/twin/live_tuning.h"

/* The caller sets all fields but the private ones. */
typedef struct tl_live_host {
    tl_live_config_manager_status *live_status; /* written by this process */
    const tl_live_twin_status *twins[TL_TWIN_SLOTS];
    tl_live_tuning *tunings[TL_TWIN_SLOTS];
    const tl_live_recorder_status *recorder; /* NULL: nothing is recorded */
    const tl_handover *handover_block;
    tl_live_candidate *candidate;
    char hash[TL_TWIN_SLOTS][TL_SHA256_TEXT]; /* SHA-256 of the configuration in each slot; "": none */
    const char *path;      /* path of the configuration file; relative file names start at its folder */
    const char *text;      /* configuration of the run when this process started */
    const char *text_hash; /* of `text` */
    tl_time step;          /* T_S, ns */
    tl_journal *journal;
    bool wants_none; /* private: the order to end the shadow still waits for the previous order */
    uint32_t given;  /* private: number of the newest tuning that this process wrote */
} tl_live_host;

/* Returns the functions for an activation. `host` must outlive it. */
tl_activation_host tl_live_host_functions(tl_live_host *host);

/* Call it regularly. Gives an order that had to wait for the previous one. */
void tl_live_host_poll(tl_live_host *host);

#endif
