/* Pasts out of an outbox: what a dead process has left for its successor.
 *
 * Purpose: the twin's outbox outlives it (outbox.h). Its successor goes on from the newest checkpoint in it and the entries since, or from
 *          the older one; at last from the entries alone. That needs no file, and loses no tick that was computed.
 * When:    as past.h says. A run that was ended before it had got any further than that which it went on with is passed over, if
 *          what is left reaches back to the one before. It is the same boot, so t_start stands as it is. That configuration and FMUs are
 *          those of the predecessor is the affair of who starts both.
 * Trust:   none in what is left: whoever died may have written anything before. What comes of it is checked as any image (past.h).
 * Owner:   pasts are copies, so that the outbox may be written while one is followed. Looking for the next one must come before that.
 * Thread:  that of the outbox's writer.
 */
#ifndef TL_FIRMWARE_TWIN_PAST_OUTBOX_H
#define TL_FIRMWARE_TWIN_PAST_OUTBOX_H

#include <stdbool.h>

#include "firmware/store/outbox.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/past.h"

typedef struct tl_past_outbox tl_past_outbox;

/* Both must outlive it. NULL: no run is left in it, nobody wants one (`record.resume_s` is 0), or memory is out. */
tl_past_outbox *tl_past_outbox_open(const tl_outbox *outbox, const tl_assembly *assembly, tl_past_tell *tell,
                                    void *context);

/* NULL is allowed. */
void tl_past_outbox_close(tl_past_outbox *left);

/* The newest past, then ever older ones, as long as nothing was put into the outbox; `past` lives until the next call. False: there is none
 * (any more), and why was told. NULL is allowed. */
bool tl_past_outbox_next(tl_past_outbox *left, tl_past *past);

#endif
