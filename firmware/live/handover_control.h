/* The change of twins, from the side of the supervisor: obeys the activator's orders, and keeps the stage (handover.h).
 *
 * Purpose: which place the run is of, whether there shall be a shadow in the other one, when they change places, and which of the two outboxes the recorder
 *          reads. What has to be done for it, the supervisor does (tl_orders).
 * Orders:  one after the other. One that cannot be obeyed yet (the twin before has not ended, the run's has not begun, the recorder is not that far) waits,
 *          and is refused after TL_HANDOVER_CONTROL_PATIENCE. What is refused is answered on the stage, with the reason.
 * Hold:    in safe hold there is no shadow, and no flip.
 * Flip:    announced for a tick far enough ahead; done once the run's twin has said that it has done its part, or is dead. One that has not said it as long
 *          after that tick as it was announced before is killed. If all end before that tick, there is no flip.
 * Recorder: is behind a flip until it has written all that came by the outbox before; then another one is begun for the other outbox. It may be two flips
 *          behind.
 * Trust:   orders and pulses are other processes' words: numbers are bounded, and nothing is read twice.
 * Thread:  the supervisor's; the stage is written by it alone.
 */
#ifndef TL_FIRMWARE_LIVE_HANDOVER_CONTROL_H
#define TL_FIRMWARE_LIVE_HANDOVER_CONTROL_H

#include <stdbool.h>

#include "firmware/live/supervisor.h"
#include "firmware/live/twin_slots.h"

#define TL_HANDOVER_CONTROL_PATIENCE (30 * TL_SECOND)

/* Begins with what its user sets, and zeros. */
typedef struct tl_handover_control {
    tl_handover *stage;
    tl_twin_slot *places; /* TL_TWIN_SLOTS; the run's own configuration has moved into the first */
    const tl_live_config_manager_pulse *orders;
    const tl_block *candidate;
    const tl_live_recorder_pulse *recorder; /* NULL: nothing is recorded */
    tl_time step;                           /* of the run: it does not change */
    bool unconfined;                        /* FMUs may do what the user can, if their configuration says so */
    void *context;
    void (*tell)(void *context, const char *text); /* a flip is announced: an event, and a line of the log */
    bool holds;                                    /* also set by its user: the twin of the run is in safe hold */
    /* private */
    bool wants_shadow;
    uint32_t done;    /* number of the newest flip that is done; another one than that of the stage: it is under way, */
    tl_time until;    /* and whoever has not done its part by then is killed */
    uint32_t waiting; /* number of the order that waits, */
    tl_time since;    /* and since when */
    uint32_t recorder_place;     /* whose outbox is read, */
    uint32_t recorder_handovers; /* since this flip */
} tl_handover_control;

/* As often as the supervisor looks. */
void tl_handover_control_look(tl_handover_control *change, tl_time now, bool ends, tl_orders *orders);

/* The shadow has ended, or could not be begun. */
void tl_handover_control_note_end_of_shadow(tl_handover_control *change, const char *reason);

/* A recorder is to be begun: it has `recorder_place` and `recorder_handovers` then. */
void tl_handover_control_begin_recorder(tl_handover_control *change);

#endif
