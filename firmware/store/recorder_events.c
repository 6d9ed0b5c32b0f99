/* An event as it waits to be written: see recorder_events.h. */
#include "firmware/store/recorder_events.h"

#include <string.h>

#include "firmware/base/utc.h"

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
