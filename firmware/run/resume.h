/* A warm restart: a run goes on where an earlier one was ended by a kill, a crash, a restart or a reboot.
 *
 * Purpose: the database is the box's memory. The new run takes the newest checkpoint of the earlier one, or begins with the FMUs'
 *          start values, and is led along what that one has recorded since: its samples and its u, without a search. The
 *          time in which nobody ran is missed ticks then, for the cycle to make up.
 * Own:     what is followed is recorded again, as the new run's, and so is the checkpoint: it then needs nothing of the earlier
 *          run, for its replay, or when it is itself ended before it has got any further.
 * When:    the newest run that got anywhere had the same configuration and FMUs, did not end by itself or with an error, and its
 *          last tick is at most `record.resume_s` ago: by the monotonic clock, or after a reboot by UTC. Else an event says
 *          why the twin begins anew.
 * Thread:  one at a time, before the cycle starts: opening and closing may be another one's than what lies between.
 */
#ifndef TL_FIRMWARE_RUN_RESUME_H
#define TL_FIRMWARE_RUN_RESUME_H

#include <stdbool.h>

#include "firmware/base/identity.h"
#include "firmware/base/sha256.h"
#include "firmware/plant/recording.h"
#include "firmware/record/history.h"
#include "firmware/record/recorder.h"
#include "firmware/report/summary.h"
#include "firmware/run/journal.h"
#include "firmware/twin/assembly.h"

typedef struct tl_resume_settings {
    tl_assembly *assembly; /* its twin may be built anew */
    const char *path;      /* of the database */
    tl_recorder *recorder; /* of the new run */
    tl_journal *journal;
} tl_resume_settings;

/* What files tell, for a thread that may open none. */
typedef struct tl_resume_source {
    tl_history *history;         /* NULL: there is nothing to go on with */
    char fmus[TL_SHA256_TEXT];   /* which FMUs these are, */
    char boot[TL_IDENTITY_TEXT]; /* and which boot */
} tl_resume_source;

/* Opens the database; one that cannot be read does not keep the twin from running, and is an event. */
void tl_resume_open(const tl_resume_settings *settings, tl_resume_source *source);
void tl_resume_close(tl_resume_source *source);

/* Leads the twin to where the newest run ended, and fills the summary: `resumption` in it says what was done, of which nothing
 * is no failure.
 * *spoilt: the twin is a new one again, but the recorder's run has got steps of the attempt; end it, and begin another.
 * Errors: TL_FMU_FATAL, or what building the twin anew has met. */
tl_status tl_resume(const tl_resume_settings *settings, const tl_resume_source *source, tl_summary *summary,
                    bool *spoilt, tl_error *error);

/* Whether the replay of a run that went on with another one can begin as that did.
 * Errors: TL_BAD_DATA where the FMUs, or this program, are not those of the run. */
tl_status tl_resume_check(const tl_config *config, const tl_recording_beginning *beginning, tl_error *error);

#endif
