/* The mails of a run: two blocks in which io posts what it reads of the plant (plant_mail.h).
 *
 * Purpose: a twin with other sources needs a mail of its own, which io writes once that twin is the run's; until then it reads that of the run as well.
 *          So each place says which mail is its (live_place.h). Twins of one plant share one.
 * Memory:  as far as it is used. One that is made anew is another block: whoever has taken the one before keeps that.
 * Trust:   sizes come from a process that has read the candidate, and are bounded here; a mail of another size than it should have nobody takes.
 * Thread:  the supervisor's.
 */
#ifndef TL_FIRMWARE_TREE_LIVE_MAILS_H
#define TL_FIRMWARE_TREE_LIVE_MAILS_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/process/block.h"
#include "firmware/run/live_stage.h"
#include "master/base/status.h"

typedef struct tl_live_mail {
    tl_block block;
    uint32_t number; /* another one each time it is made; 0: it was not */
} tl_live_mail;

/* Zeroed at first. */
typedef struct tl_live_mails {
    tl_live_mail mail[TL_LIVE_PLACES];
    uint32_t made; /* how many were, in all */
} tl_live_mails;

/* Which one, with room for a plant mail of so many bytes, in place of what was there. Errors: TL_TRY_AGAIN; then it is none. */
tl_status tl_live_mails_make(tl_live_mails *mails, uint32_t which, size_t plant_bytes, tl_error *error);

void tl_live_mails_close(tl_live_mails *mails);

#endif
