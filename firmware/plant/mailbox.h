/* A mailbox: the newest readings of one signal, from one writer thread to one reader thread, wait-free.
 *
 * Purpose: plant I/O posts, the cycle looks up; neither ever waits for the other. The last TL_MAILBOX_READINGS
 *          readings are kept, so that a sample can be looked up at its own instant after a missed tick.
 * Thread:  exactly one writer and one reader at a time.
 * Bound:   post O(1); lookup O(TL_MAILBOX_READINGS), and retried at most that often where the writer overwrites the
 *          whole ring between two of its steps.
 */
#ifndef TL_FIRMWARE_PLANT_MAILBOX_H
#define TL_FIRMWARE_PLANT_MAILBOX_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/signal.h"

enum { TL_MAILBOX_READINGS = 256 };

typedef struct tl_mailbox_slot {
    uint64_t sequence; /* odd while the slot is written */
    uint64_t value;    /* bits of the double */
    int64_t stamp;
    uint64_t quality;
} tl_mailbox_slot;

/* A zeroed mailbox is empty. Fields are private; placed by the owner. */
typedef struct tl_mailbox {
    tl_mailbox_slot slots[TL_MAILBOX_READINGS];
    uint64_t count; /* readings posted so far */
} tl_mailbox;

/* Writer. Stamps should not decrease; one that does is looked up in order of posting. */
void tl_mailbox_post(tl_mailbox *mailbox, const tl_reading *reading);

/* Reader: of the readings with stamp ≤ until the first with stamp ≥ from; where there is none, the newest before; else as
 * below. */
bool tl_mailbox_from(const tl_mailbox *mailbox, tl_time from, tl_time until, tl_reading *reading);

/* Reader: the newest reading with stamp ≤ instant; the oldest kept one where all are later than `instant` and
 * something had to be forgotten. false where there is none; *reading is then as it was. */
bool tl_mailbox_at(const tl_mailbox *mailbox, tl_time instant, tl_reading *reading);

#endif
