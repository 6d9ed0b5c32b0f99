/* The appliance: a twin kept locked to the live plant, recorded, until it is told to end.
 *
 * Purpose: what `twinlock run` does, supervised or not. Where it is told to hold (supervisor.h) there is no twin: the plant is read and
 *          recorded all the same, so that nothing that happens meanwhile is lost to a later replay.
 * Ends:    on SIGTERM, SIGINT, SIGHUP, or when the duration is over.
 * FMUs:    are confined as far as one process allows (live_confinement.h).
 * Thread:  the main thread of its process; the FMUs with the cycle, the recorder and each plant source have their own.
 */
#ifndef TL_FIRMWARE_RUN_APPLIANCE_H
#define TL_FIRMWARE_RUN_APPLIANCE_H

#include <stdbool.h>

#include "firmware/supervise/supervisor.h"
#include "firmware/twin/assembly.h"

typedef struct tl_appliance_settings {
    tl_assembly *assembly; /* read, not built: built and freed here, in the FMUs' thread */
    const char *database;  /* NULL: as configured */
    bool json;             /* the summary at the end */
    bool status;           /* a status line also where the output is no terminal */
    bool unconfined;       /* FMUs may do what the user can */
} tl_appliance_settings;

/* `start` is NULL where nobody supervises. Returns an exit code; what went wrong was said on the log. */
int tl_appliance_run(const tl_appliance_settings *settings, const tl_start *start);

#endif
