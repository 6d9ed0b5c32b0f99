/* Handover control: the supervisor's part of a handover. Executes the requests of the config
 * manager and writes the handover block (tl_handover).
 *
 * Purpose: decides which slot has the live twin, and whether the other slot has a shadow. Decides
 *          when the two swap, and which of the two record queues the recorder reads. The supervisor
 *          executes these decisions (tl_orders).
 * Orders:  requests of the config manager, one after the other. While a handover is announced,
 *          requests wait. A request for a shadow waits for three conditions: the slot's previous
 *          twin has ended, the live twin is ready, and the recorder is not behind. It is rejected
 *          after TL_HANDOVER_CONTROL_PATIENCE (30 s). All other requests are executed or rejected
 *          at once. The handover block reports the reason.
 * Hold:    in safe hold there is no shadow, and no handover.
 * Handover: the handover block announces to both twins the tick at which they swap. This tick is at
 *           least tl_handover_ahead() (0.25 s or more) in the future. The handover is done when the
 *           live twin has reported it, or has died. A live twin that has not reported it within
 *           tl_handover_ahead() after that tick is killed. If the run ends before that tick, the
 *           handover is dropped.
 * Recorder: after a handover the recorder continues with the old record queue until it has written
 *           that queue to the end: it is *behind*. Then a new recorder is started for the other
 *           queue. If the next handover comes earlier, a recorder may be two handovers behind.
 * Trust:   requests and status blocks come from other processes: numbers are bounded, and each
 *          value is read once.
 * Memory:  the caller owns all blocks that the object points to.
 * Errors:  the handover block reports them.
 * Thread:  the supervisor's; only it writes the handover block.
 */
#ifndef TL_FIRMWARE_LIVE_HANDOVER_CONTROL_H
#define TL_FIRMWARE_LIVE_HANDOVER_CONTROL_H

#include <stdbool.h>

#include "firmware/live/supervisor.h"
#include "firmware/live/twin_slots.h"

#define TL_HANDOVER_CONTROL_PATIENCE (30 * TL_SECOND)

/* The caller sets the first fields and zeroes the rest. */
typedef struct tl_handover_control {
    tl_handover *handover_block;
    tl_twin_slot *slots; /* TL_TWIN_SLOTS; slot 0 starts with the configuration of the command line */
    const tl_live_config_manager_status *orders; /* has the newest request of the config manager */
    const tl_block *candidate;                   /* a tl_live_candidate, written by the config manager */
    const tl_live_recorder_status *recorder;     /* NULL: nothing is recorded */
    tl_time step;                                /* of the run, ns; it does not change */
    bool unconfined; /* permits components with `unconfined`: FMUs with all rights of the user */
    void *context;
    void (*report)(void *context, const char *text); /* reports a handover: log and event */
    bool holds;                                      /* safe hold; the caller sets it, also during the run */
    /* private */
    bool wants_shadow;
    uint32_t done;               /* newest completed handover; the handover block may be one ahead */
    tl_time until;               /* ns; the live twin is killed if it has not handed over by then */
    uint32_t waiting;            /* number of the waiting request; 0: none waits */
    tl_time since;               /* ns; start of its wait */
    uint32_t recorder_slot;      /* slot whose record queue the recorder reads */
    uint32_t recorder_handovers; /* number of the handover that made the twin of this slot the live twin */
} tl_handover_control;

/* Called in each loop of the supervisor. Executes requests of the config manager and handovers.
 * Sets shadow, kill_twin, swap, recorder and soon in *orders: what the supervisor must do. `now`:
 * ns, monotonic clock. `ends`: all processes are ending. */
void tl_handover_control_poll(tl_handover_control *control, tl_time now, bool ends, tl_orders *orders);

/* Reports that the shadow has ended, or could not be started. */
void tl_handover_control_note_end_of_shadow(tl_handover_control *control, const char *reason);

/* Called before a recorder is started. If the old record queue is fully recorded, sets
 * `recorder_slot` and `recorder_handovers` to the other queue. */
void tl_handover_control_begin_recorder(tl_handover_control *control);

#endif
