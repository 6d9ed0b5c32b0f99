/* A warm restart: a run goes on where an earlier one was ended by a kill, a crash, a restart or a reboot.
 *
 * Purpose: the database is the box's memory. The main thread looks in it for a run to go on with (past_history.h), and the thread of the FMUs
 *          follows what was found (past_follow.h): the newest checkpoint, else an older one, else the inputs. If there is none, an event
 *          says why the twin begins anew.
 * Thread:  the main thread, before the cycle starts.
 */
#ifndef TL_FIRMWARE_RUN_RESUME_H
#define TL_FIRMWARE_RUN_RESUME_H

#include <stdbool.h>

#include "firmware/fmu/fmu_thread.h"
#include "firmware/plant/recording.h"
#include "firmware/record/recorder.h"
#include "firmware/report/summary.h"
#include "firmware/run/journal.h"
#include "firmware/twin/assembly.h"

typedef struct tl_resume_settings {
    tl_assembly *assembly; /* its twin may be built anew, */
    tl_fmu_thread *thread; /* in this thread */
    const char *path;      /* of the database */
    tl_recorder *recorder; /* of the new run; NULL: nothing is gone on with */
    tl_journal *journal;
} tl_resume_settings;

/* Leads the twin to where the newest run ended, and fills the summary: `resumption` in it says what was done, of which nothing
 * is no failure. A database that cannot be read does not keep the twin from running either.
 * *spoilt: the twin is a new one again, but the recorder's run has got steps of the attempt; end it, and begin another.
 * Errors: TL_FMU_FATAL, or what building the twin anew has met. */
tl_status tl_resume(const tl_resume_settings *settings, tl_summary *summary, bool *spoilt, tl_error *error);

/* Whether the replay of a run that went on with another one can begin as that did.
 * Errors: TL_BAD_DATA where the FMUs, or this program, are not those of the run. */
tl_status tl_resume_check(const tl_config *config, const tl_recording_beginning *beginning, tl_error *error);

#endif
