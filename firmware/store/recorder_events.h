/* An event as it waits to be written.
 *
 * Size:   fixed, texts are cut; no pointers, so that it can wait in memory that another process reads (outbox.h).
 * Thread: plain data.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_EVENTS_H
#define TL_FIRMWARE_STORE_RECORDER_EVENTS_H

#include <stdint.h>

#include "firmware/store/run_types.h"

/* That wait at most; a power of two. */
enum { TL_RECORDER_EVENTS = 512 };
enum { TL_EVENT_SOURCE = 32, TL_EVENT_TEXT = 224 };

typedef struct tl_recorder_event_entry {
    int64_t at;        /* UTC, ms */
    int64_t tick;      /* −1: none */
    uint64_t position; /* of an outbox: end of its ring when the event was put; else 0 */
    tl_severity severity;
    char source[TL_EVENT_SOURCE];
    char text[TL_EVENT_TEXT];
} tl_recorder_event_entry;

/* Fills an entry with the texts, cut to what it holds, and the time now. */
void tl_recorder_event_fill(tl_recorder_event_entry *entry, int64_t tick, tl_severity severity, const char *source,
                            const char *text);

#endif
