/* The recorder's queue of events: from any thread, the cycle included, to the recorder thread.
 *
 * Purpose: an event must never make its caller wait. A put is a fixed number of atomic additions and one copy of 300
 *          bytes: wait-free, no lock, no loop. A full queue refuses; the caller counts it.
 * Method:  a put first reserves (so that at most TL_RECORDER_EVENTS are ever out), then draws a number, whose slot is
 *          free because all numbers that are out follow each other. The consumer takes slots in that order and stops
 *          at one that is reserved but not filled yet; it finds it filled the next time.
 * Thread:  put from any thread; peek and release from one.
 */
#ifndef TL_FIRMWARE_RECORD_RECORDER_EVENTS_H
#define TL_FIRMWARE_RECORD_RECORDER_EVENTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/record/run_types.h"

enum { TL_RECORDER_EVENTS = 512, TL_EVENT_SOURCE = 32, TL_EVENT_TEXT = 224 };

typedef struct tl_recorder_event_entry {
    int64_t at;        /* UTC, ms */
    int64_t tick;      /* −1: none */
    uint64_t position; /* of an outbox: end of its ring when the event was put; else 0 */
    tl_severity severity;
    char source[TL_EVENT_SOURCE];
    char text[TL_EVENT_TEXT];
} tl_recorder_event_entry;

typedef struct tl_recorder_event_slot {
    uint32_t filled;
    tl_recorder_event_entry entry;
} tl_recorder_event_slot;

/* A zeroed queue is empty. */
typedef struct tl_recorder_events {
    tl_recorder_event_slot slots[TL_RECORDER_EVENTS];
    uint32_t reserved; /* slots that are out: reserved and not yet released */
    uint32_t next;     /* number of the next put */
    uint32_t oldest;   /* consumer's own: number of the oldest slot that is out */
} tl_recorder_events;

/* Fills an entry with the texts, cut to what it holds, and the time now. */
void tl_recorder_event_fill(tl_recorder_event_entry *entry, int64_t tick, tl_severity severity, const char *source,
                            const char *text);

/* False where the queue is full. */
bool tl_recorder_events_put(tl_recorder_events *events, const tl_recorder_event_entry *entry);

/* The entry `index` places behind the oldest one; NULL where there is none yet. Valid until released. */
const tl_recorder_event_entry *tl_recorder_events_peek(const tl_recorder_events *events, uint32_t index);

/* Gives the `count` oldest ones back; they must have been seen by peek. */
void tl_recorder_events_release(tl_recorder_events *events, uint32_t count);

#endif
