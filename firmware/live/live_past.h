/* What a live twin goes on from: the side of the twin.
 *
 * Purpose: a twin whose predecessor has died in the same run finds checkpoint and entries in the outbox, and asks nobody. Any other asks the
 *          recorder, who looks in the database and answers with an image (past.h); if that is of no use, with an older one. A recorder that does
 *          not answer is waited for no longer than TL_LIVE_PAST_PATIENCE: the plant's lock comes first.
 *          A shadow has no predecessor: it asks for the recorded samples of the run beside which it begins.
 * Trust:   an image is copied before it is looked at.
 * Thread:  the main thread of the twin's process; FMUs are called in theirs.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_PAST_H
#define TL_FIRMWARE_LIVE_LIVE_PAST_H

#include "firmware/fmu/fmu_thread.h"
#include "firmware/live/live_wire.h"
#include "firmware/live/recorded_course.h"
#include "firmware/process/block.h"
#include "firmware/report/summary.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/journal.h"

#define TL_LIVE_PAST_PATIENCE (10 * TL_SECOND)

/* What is shared with the recorder. */
typedef struct tl_live_memory {
    const tl_live_recorder_pulse *recorder; /* NULL: nothing is recorded */
    tl_block *past;
    tl_live_twin_pulse *pulse; /* ours */
    uint32_t twin;             /* the number of this start, */
    uint32_t place;            /* and where */
    tl_time ended;             /* of a run before that is not gone on with: when its last tick was; 0: not known */
} tl_live_memory;

typedef struct tl_live_past_settings {
    tl_live_memory *memory;
    const tl_config *run;  /* of a shadow: the configuration of the run beside which it begins */
    tl_assembly *assembly; /* built; its twin may be built anew */
    tl_fmu_thread *thread;
    tl_outbox *outbox; /* nothing was put yet */
    tl_journal *journal;
    tl_heart *heart;        /* of the caller */
    tl_recorded_show *show; /* of a shadow: told how far it is, */
    void *context;          /* with this */
    bool no_checkpoints; /* pasts that begin with one are passed over: loading one has ended a process (live_wire.h) */
} tl_live_past_settings;

/* Leads the twin to where an earlier one was ended, and fills the summary: `resumption` in it says what was done, of which nothing is no failure.
 * Gives the memory of the past back. Errors: TL_FMU_FATAL, or what building the twin anew has met. */
tl_status tl_live_past_follow(const tl_live_past_settings *settings, tl_summary *summary, tl_error *error);

/* Of a shadow, instead: leads it over what was recorded of the run that began at `start` (recorded_course.h). *next is the tick that it is ready for. Errors: those of tl_recorded_course_take(). */
tl_status tl_live_past_begin_shadow(const tl_live_past_settings *settings, tl_time start, int64_t *next,
                                    tl_error *error);

#endif
