/* The mail: the mailboxes of all signals of a configuration, in one piece of memory.
 *
 * Purpose: plant I/O writes the piece, the cycle reads it; in two processes it is a block (block.h). How large it is and what lies where
 *          follows from the configuration alone, which both sides have; nothing of it is read from the memory.
 * Memory:  of the caller, zeroed at first, aligned to 8 bytes; better to a page, as a block is. The counts of all mailboxes come first, on a
 *          cache line each, then the slots of one signal after the other.
 * Look-ups: a second look-up of a signal has no mailbox of its own: it reads that of the signal. So twins with different look-ups read the same mail.
 * Thread:  plain data; of the mailboxes see mailbox.h.
 */
#ifndef TL_FIRMWARE_PLANT_PLANT_MAIL_H
#define TL_FIRMWARE_PLANT_PLANT_MAIL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/plant/mailbox.h"
#include "master/base/signal.h"

enum { TL_PLANT_MAIL_LEAST = 256, TL_PLANT_MAIL_MOST = 65536 }; /* readings of a signal */

typedef struct tl_plant_mail_shape {
    size_t signals;
    uint32_t depth[TL_MAX_SIGNALS]; /* powers of two */
    size_t of[TL_MAX_SIGNALS];      /* whose mailbox each reads: its own, or that of an earlier signal */
} tl_plant_mail_shape;

/* Live: what a source reads in hang_s and 10 s is kept, as often as it polls: every period_s (CAN: 1 ms), but not less often than each step, and
 * no more often than each millisecond. The configuration has its second look-ups already: tl_config_use_lookups(). */
void tl_plant_mail_shape_of(const tl_config *config, tl_plant_mail_shape *shape);

/* For how long live readings are kept, ns, if they are not more than TL_PLANT_MAIL_MOST. */
tl_time tl_plant_mail_kept(const tl_config *config);

/* Of the memory; never 0. */
size_t tl_plant_mail_bytes(const tl_plant_mail_shape *shape);

/* Handles on what is in the memory, for either side: whoever only reads may have mapped it read-only. */
void tl_plant_mail_open(const tl_plant_mail_shape *shape, void *memory, tl_mailbox mailboxes[TL_MAX_SIGNALS]);

/* Within one process: memory with the least depth of all, opened: for recordings, whose readings are looked up as they come. The caller frees it with
 * free(). NULL: there is not enough. */
void *tl_plant_mail_make_least(size_t signals, tl_mailbox mailboxes[TL_MAX_SIGNALS]);

#endif
