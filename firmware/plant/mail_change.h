/* From one mail to another: a twin that takes over with other sources sees the plant by those of the run before until its own are read.
 *
 * Purpose: io is begun anew for a twin with another plant, and needs a moment until it has read each signal. A signal that both plants read alike
 *          (config_same_signals.h) is looked up in the mail of the run before until then; so one whose source does not change need not even be stale.
 * Beside:  a shadow sees of the plant what the run's mail has: of the other signals there is no reading.
 * Change:  begins with the tick of the flip. From then on each signal is looked up in its own mail as soon as there is a good reading for the instant that is
 *          looked up, and in any case TL_MAIL_CHANGE_LONGEST later: the old mail is written by nobody any more, and may be never stale by its limits.
 * Bound:   a look-up a signal that has not changed over, and nothing once all have. No allocation, no system call.
 * Owner:   the caller places it; input and mailboxes must stay. What the input looks up is this one's from open on.
 * Thread:  that of the input; tl_mail_change_is_over() any.
 */
#ifndef TL_FIRMWARE_PLANT_MAIL_CHANGE_H
#define TL_FIRMWARE_PLANT_MAIL_CHANGE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/config/config_same_signals.h"
#include "firmware/plant/mailbox.h"
#include "firmware/plant/plant_input.h"

#define TL_MAIL_CHANGE_LONGEST TL_SECOND

/* Fields are private. A zeroed one is over, and changes nothing. */
typedef struct tl_mail_change {
    tl_plant_input *input;
    tl_mailbox own[TL_MAX_SIGNALS];
    bool waits[TL_MAX_SIGNALS];
    size_t waiting; /* how many do; atomic */
    bool has_begun;
    tl_time until;
} tl_mail_change;

/* The mailboxes of `input` are its own; `of_run` are those of the run beside which it is a shadow. From now on what is the same is looked up there. */
void tl_mail_change_open(tl_mail_change *change, tl_plant_input *input, const tl_same_signals *same,
                         const tl_mailbox of_run[]);

/* At the tick of the flip, of this instant: its own mail is written from now on, or soon. */
void tl_mail_change_begin(tl_mail_change *change, tl_time instant);

/* At each tick, before its sample is taken. */
void tl_mail_change_look(tl_mail_change *change, tl_time instant);

/* Nothing is looked up in the mail of the run before any more, and never will be. */
bool tl_mail_change_is_over(const tl_mail_change *change);

#endif
