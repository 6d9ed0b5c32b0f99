/* What a live twin goes on from: the side of the twin.
 *
 * Purpose: a twin whose predecessor has died in the same run finds checkpoint and entries in the outbox, and asks nobody. Any other asks the
 *          recorder, who looks in the database and answers with an image (past.h); if that is of no use, with an older one. A recorder that does
 *          not answer is waited for no longer than TL_LIVE_PAST_PATIENCE: the plant's lock comes first.
 * Trust:   an image is copied before it is looked at.
 * Thread:  the main thread of the twin's process; FMUs are called in theirs.
 */
#ifndef TL_FIRMWARE_LIVE_LIVE_PAST_H
#define TL_FIRMWARE_LIVE_LIVE_PAST_H

#include "firmware/fmu/fmu_thread.h"
#include "firmware/live/live_wire.h"
#include "firmware/process/block.h"
#include "firmware/report/summary.h"
#include "firmware/run/journal.h"
#include "firmware/twin/assembly.h"

#define TL_LIVE_PAST_PATIENCE (10 * TL_SECOND)

/* What is shared with the recorder. Zeroed: there is none. */
typedef struct tl_live_memory {
    tl_block recorder; /* its pulse */
    tl_block past;
    tl_live_twin_pulse *pulse; /* ours */
    uint32_t twin;             /* the number of this start */
} tl_live_memory;

/* Takes the descriptors. *taken is what the recorder has taken of the twin's outbox. Errors: TL_BAD_DATA. */
tl_status tl_live_memory_take(tl_live_memory *memory, const tl_outbox_taken **taken, tl_error *error);

typedef struct tl_live_past_settings {
    tl_live_memory *memory;
    tl_assembly *assembly; /* built; its twin may be built anew */
    tl_fmu_thread *thread;
    tl_outbox *outbox; /* nothing was put yet */
    tl_journal *journal;
    tl_heart *heart; /* of the caller */
} tl_live_past_settings;

/* Leads the twin to where an earlier one was ended, and fills the summary: `resumption` in it says what was done, of which nothing is no failure.
 * Gives the memory of the past back. Errors: TL_FMU_FATAL, or what building the twin anew has met. */
tl_status tl_live_past_follow(const tl_live_past_settings *settings, tl_summary *summary, tl_error *error);

#endif
