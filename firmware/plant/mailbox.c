/* A ring of versioned slots: a seqlock per reading.
 *
 * Post n goes to slot n mod TL_MAILBOX_READINGS. Its sequence is 2n+1 while it is written and 2n+2 when it stands, so
 * a reader that looks for post n knows whether a slot holds that one, is being overwritten, or holds a later one.
 *
 * Without fences (ThreadSanitizer does not know them): the writer's stores to the fields release, so they stay after
 * the odd sequence; the reader's loads of them acquire, so they stay before its second look at the sequence. A reader
 * that saw one new field therefore sees the odd sequence, or a later one.
 */
#include "firmware/plant/mailbox.h"

#include <string.h>

void tl_mailbox_post(tl_mailbox *mailbox, const tl_reading *reading) {
    uint64_t post = __atomic_load_n(&mailbox->count, __ATOMIC_RELAXED); /* ours alone */
    tl_mailbox_slot *slot = &mailbox->slots[post % TL_MAILBOX_READINGS];
    uint64_t value = 0;
    memcpy(&value, &reading->value, sizeof value);
    __atomic_store_n(&slot->sequence, 2 * post + 1, __ATOMIC_RELAXED);
    __atomic_store_n(&slot->value, value, __ATOMIC_RELEASE);
    __atomic_store_n(&slot->stamp, reading->stamp, __ATOMIC_RELEASE);
    __atomic_store_n(&slot->quality, (uint64_t)reading->quality, __ATOMIC_RELEASE);
    __atomic_store_n(&slot->sequence, 2 * post + 2, __ATOMIC_RELEASE);
    __atomic_store_n(&mailbox->count, post + 1, __ATOMIC_RELEASE);
}

/* false where that post is no longer kept. */
static bool look(const tl_mailbox *mailbox, uint64_t post, tl_reading *reading) {
    const tl_mailbox_slot *slot = &mailbox->slots[post % TL_MAILBOX_READINGS];
    uint64_t before = __atomic_load_n(&slot->sequence, __ATOMIC_ACQUIRE);
    uint64_t value = __atomic_load_n(&slot->value, __ATOMIC_ACQUIRE);
    int64_t stamp = __atomic_load_n(&slot->stamp, __ATOMIC_ACQUIRE);
    uint64_t quality = __atomic_load_n(&slot->quality, __ATOMIC_ACQUIRE);
    uint64_t after = __atomic_load_n(&slot->sequence, __ATOMIC_RELAXED);
    if (before != 2 * post + 2 || after != before) {
        return false;
    }
    memcpy(&reading->value, &value, sizeof value);
    reading->stamp = stamp;
    reading->quality = (tl_quality)quality;
    return true;
}

/* What a look-up has found on its way back from the newest reading. */
typedef struct find {
    tl_time from;
    tl_time until;
    bool any;
    tl_reading best;
} find;

/* true where nothing older can be better. */
static bool settle(find *sought, const tl_reading *reading) {
    bool before = reading->stamp <= sought->from;
    bool first = !sought->any || reading->stamp < sought->best.stamp;
    if (reading->stamp <= sought->until && first && (!before || !sought->any || reading->stamp == sought->from)) {
        sought->best = *reading;
        sought->any = true;
    }
    return before;
}

bool tl_mailbox_from(const tl_mailbox *mailbox, tl_time from, tl_time until, tl_reading *reading) {
    for (int attempt = 0; attempt < TL_MAILBOX_READINGS; attempt++) {
        uint64_t count = __atomic_load_n(&mailbox->count, __ATOMIC_ACQUIRE);
        uint64_t oldest = count > TL_MAILBOX_READINGS ? count - TL_MAILBOX_READINGS : 0;
        find sought = {.from = from, .until = until};
        tl_reading found = {.quality = TL_NO_LINK};
        uint64_t post = count;
        bool settled = false;
        while (!settled && post > oldest && look(mailbox, post - 1, &found)) {
            post--;
            settled = settle(&sought, &found);
        }
        if (sought.any) {
            *reading = sought.best;
            return true;
        }
        if (post == 0) {
            return false; /* nothing was forgotten */
        }
        if (post < count) { /* the oldest that is kept: what came before is forgotten */
            *reading = found;
            return true;
        }
        /* Not even the newest was kept until we looked at it: the writer went once around meanwhile. */
    }
    return false;
}

bool tl_mailbox_at(const tl_mailbox *mailbox, tl_time instant, tl_reading *reading) {
    return tl_mailbox_from(mailbox, instant, instant, reading);
}
