/* Events from many threads to one, wait-free. The header says how. */
#include "firmware/record/recorder_events.h"

#include <string.h>

#include "firmware/text/utc.h"

/* The numbers wrap at 2^32, and slots with them. */
typedef char tl_recorder_events_is_power_of_two[(TL_RECORDER_EVENTS & (TL_RECORDER_EVENTS - 1)) == 0 ? 1 : -1];

static void copy_text(char *to, size_t size, const char *from) {
    size_t length = strnlen(from, size - 1);
    memcpy(to, from, length);
    memset(to + length, 0, size - length);
}

void tl_recorder_event_fill(tl_recorder_event_entry *entry, int64_t tick, tl_severity severity, const char *source,
                            const char *text) {
    entry->at = tl_utc_now();
    entry->tick = tick;
    entry->position = 0;
    entry->severity = severity;
    copy_text(entry->source, sizeof entry->source, source);
    copy_text(entry->text, sizeof entry->text, text);
}

bool tl_recorder_events_put(tl_recorder_events *events, const tl_recorder_event_entry *entry) {
    /* Acquire: what the consumer did to a slot before it released it comes before what we do to it. */
    if (__atomic_fetch_add(&events->reserved, 1, __ATOMIC_ACQUIRE) >= TL_RECORDER_EVENTS) {
        (void)__atomic_fetch_sub(&events->reserved, 1, __ATOMIC_RELAXED);
        return false;
    }
    /* Whoever stood still since it reserved may draw a slot that was released meanwhile. The one that reserved after that has
     * drawn before it, and passes on here what it has seen. */
    uint32_t number = __atomic_fetch_add(&events->next, 1, __ATOMIC_ACQ_REL);
    tl_recorder_event_slot *slot = &events->slots[number % TL_RECORDER_EVENTS];
    slot->entry = *entry;
    __atomic_store_n(&slot->filled, 1, __ATOMIC_RELEASE);
    return true;
}

const tl_recorder_event_entry *tl_recorder_events_peek(const tl_recorder_events *events, uint32_t index) {
    if (index >= TL_RECORDER_EVENTS) {
        return NULL;
    }
    const tl_recorder_event_slot *slot = &events->slots[(events->oldest + index) % TL_RECORDER_EVENTS];
    return __atomic_load_n(&slot->filled, __ATOMIC_ACQUIRE) == 1 ? &slot->entry : NULL;
}

void tl_recorder_events_release(tl_recorder_events *events, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) {
        __atomic_store_n(&events->slots[(events->oldest + i) % TL_RECORDER_EVENTS].filled, 0, __ATOMIC_RELAXED);
    }
    events->oldest += count;
    (void)__atomic_fetch_sub(&events->reserved, count, __ATOMIC_RELEASE);
}
