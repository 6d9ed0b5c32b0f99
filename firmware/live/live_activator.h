/* The activator of a run, from the side of the supervisor: begun when somebody knocks at the control socket.
 *
 * Purpose: a process that changes configurations is needed now and then (activator.h). It is begun with the run, which may have a probation to go on
 *          with, ends when it has nothing to do, and is begun again when somebody asks. If it fails, the next one goes on with what is on disk.
 * Trust:   the supervisor reads nothing of what clients say, and one wish of the activator's: that the run shall begin anew.
 * Account: none; the run does not depend on it. One that fails is begun again after a pause that doubles, up to 5 min; for a client after a second
 *          at most. Failures are told once a minute.
 * Waiting: never, but for a fork.
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_ACTIVATOR_H
#define TL_FIRMWARE_LIVE_LIVE_ACTIVATOR_H

#include <stdbool.h>

#include "firmware/live/live_wire.h"
#include "firmware/process/block.h"
#include "firmware/process/role.h"

/* Fields are private but for the first two. */
typedef struct tl_live_activator {
    int listener;   /* the control socket; −1: there is none, and never an activator */
    tl_block pulse; /* tl_live_activator_pulse and its outbox; made by open */
    tl_role role;
    tl_heartbeats_seen seen;
    bool wants;     /* another one is to be begun */
    bool was_told;  /* to end */
    bool is_silent; /* and was killed for it */
    tl_time pause, rests;
    tl_time told;    /* when a failure was told; 0: never */
    unsigned untold; /* failures since */
} tl_live_activator;

/* What the tree does for it. */
typedef struct tl_live_activator_host {
    void *context;
    pid_t (*begin)(void *context); /* 0: it could not be, and that was said */
    void (*tell)(void *context, unsigned times,
                 const char *reason); /* it has failed: an event, and a line of the log */
} tl_live_activator_host;

/* Makes its memory, and the socket at `path`, unless that is NULL. A socket that cannot be made is told on the log: the plant's twin comes first.
 * Errors: TL_TRY_AGAIN. */
tl_status tl_live_activator_open(tl_live_activator *activator, const char *path, tl_error *error);

/* As often as the supervisor looks. `ends`: the run does, and so shall it. True: the run shall begin anew. */
bool tl_live_activator_look(tl_live_activator *activator, const tl_live_activator_host *host, bool ends);

/* Kills it if it has not ended, without waiting, and removes the socket. */
void tl_live_activator_close(tl_live_activator *activator, const char *path);

#endif
