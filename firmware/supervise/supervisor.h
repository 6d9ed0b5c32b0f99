/* The supervisor: a small process that keeps the appliance alive.
 *
 * Purpose: the appliance runs in a child process, since an FMU may hang, or destroy the memory of the process that it is in.
 *          The supervisor has no FMU and no plant, and no thread but the one that reaps a dead child (reaper.h). It listens to the
 *          child's heartbeats (heartbeat.h), ends a child that is silent, begins a new one, and strokes the box's watchdog and systemd's.
 * Stroked: while everybody is alive, and while the supervisor does something about it if not: in the pause before a restart.
 *          Not while a thread is silent, and no more once even safe hold could not be kept up TL_RESTARTS_MOST times.
 *          Nor once a dead child has not been reaped for 30 s.
 * Ends:    only one that the child announced (heartbeat.h) is orderly: the run is over, or it could not begin before anything ever
 *          ran, which is told to whoever started the supervisor by the exit code; or the supervisor was asked to end, and asked the
 *          child. Any other end is a failure, which is named, with the FMU and its function if one was being called.
 * Restart: of what failed. At once after the first failure; the pause doubles with each that is not forgiven, up to 8 s.
 * Hold:    after a restart loop (restarts.h) the child is told to hold: no twin.
 * Signals: SIGTERM, SIGINT and SIGHUP (but not under nohup) end the child, and then the supervisor. A child that has not ended 16 s
 *          later is killed, some seconds after it would have given up an FMU that does not return (fmu_patience.h). An orderly end in any case: all failures are forgiven. A supervisor that is killed takes the child with it.
 */
#ifndef TL_FIRMWARE_SUPERVISE_SUPERVISOR_H
#define TL_FIRMWARE_SUPERVISE_SUPERVISOR_H

#include <stdbool.h>

#include "firmware/process/heartbeat.h"
#include "firmware/supervise/restarts.h"

/* What a child is told at its start. NULL in its place: nobody supervises. */
typedef struct tl_start {
    tl_heartbeats *beats;
    const tl_restarts *restarts; /* which start this is, and why */
    bool again;                  /* after a failure */
    bool hold;                   /* safe hold */
} tl_start;

typedef struct tl_supervisor_settings {
    const char *state;    /* a folder for the account of restarts, of one supervisor at a time; NULL: none */
    const char *watchdog; /* the device; NULL: none */
    int watchdog_s;
    /* The appliance: called in the child, which ends with what this returns, an exit code. */
    int (*run)(void *context, const tl_start *start);
    void *context;
} tl_supervisor_settings;

/* Returns an exit code once no child runs any more: the one that the last child announced; 75 where it announced none, or had to be
 * killed. That child is not reaped, which is done when the process ends. The caller must be the only thread of its process. SIGCHLD is
 * as by default from now on. */
int tl_supervise(const tl_supervisor_settings *settings);

#endif
