/* What lies where in an outbox: shared by the side that writes (outbox.c) and that which reads (outbox_reader.c).
 *
 * Layout:  what controls it, with the events; the ring; two places for checkpoints, and the room in which the next one is made. Each part
 *          begins with a page.
 * Atomics: whatever both sides touch at the same time has 8 bytes and lies on a multiple of 8, so that a 32-bit machine reads it at once too.
 * Thread:  as outbox.h and outbox_reader.h say.
 */
#ifndef TL_FIRMWARE_STORE_OUTBOX_PARTS_H
#define TL_FIRMWARE_STORE_OUTBOX_PARTS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/outbox.h"
#include "firmware/store/recorder_events.h"

enum { TL_OUTBOX_LINE = 64, TL_OUTBOX_PLACES = 2 };

/* Event n lies in slot n % TL_RECORDER_EVENTS. Before it is there, its state is that of an earlier one. */
typedef struct tl_outbox_slot {
    uint64_t state __attribute__((aligned(8)));
    tl_recorder_event_entry entry;
} tl_outbox_slot;

/* What belongs to the bytes of a checkpoint. */
typedef struct tl_outbox_mark {
    int64_t tick;
    uint64_t size;
    uint64_t position; /* of the first entry after it */
    uint64_t behind;   /* what the reader takes before it: that far, and the beginning of its run if that still waits */
    tl_resumption beginning;
    tl_run_tuning tuning; /* in force */
} tl_outbox_mark;

enum { TL_OUTBOX_MARK_WORDS = (sizeof(tl_outbox_mark) + 7) / 8 };

/* Checkpoint n lies in place n % 2. Number 0: none, or one that is being written. The digest is over all of it, so that one that was read
 * while it changed, or that somebody has written into, is none: no order of stores and loads has to see to that. */
typedef struct tl_outbox_place {
    uint64_t number __attribute__((aligned(TL_OUTBOX_LINE)));
    uint64_t digest;
    uint64_t mark[TL_OUTBOX_MARK_WORDS];
} tl_outbox_place;

typedef struct tl_outbox_control {
    uint64_t head __attribute__((aligned(TL_OUTBOX_LINE))); /* end of what is in the ring, for the reader */
    uint64_t put; /* and with a sample that waits for its step; for a successor, or a reader if there is none */
    uint64_t next __attribute__((aligned(TL_OUTBOX_LINE))); /* event */
    uint64_t lost __attribute__((aligned(TL_OUTBOX_LINE)));
    tl_outbox_place places[TL_OUTBOX_PLACES];
    tl_outbox_slot slots[TL_RECORDER_EVENTS];
    bool start_waits;      /* the writer's own: */
    tl_outbox_start start; /* has found no room yet */
} tl_outbox_control;

/* Where the parts are, from the beginning of the memory. */
size_t tl_outbox_ring_at(void);
size_t tl_outbox_place_at(const tl_outbox_settings *settings,
                          unsigned place); /* TL_OUTBOX_PLACES: the room; one more: the end */

/* Checkpoints below it are possible; so numbers never wrap around. */
#define TL_OUTBOX_NUMBERS (UINT64_MAX / 2)

/* What a place says of its checkpoint; false: it has none. The bytes may be of another one. */
bool tl_outbox_place_look(const tl_outbox_place *place, uint64_t *number, uint64_t *digest, tl_outbox_mark *mark);

/* Over the mark as it lies there, padding included, and the bytes. */
uint64_t tl_outbox_digest(uint64_t number, const tl_outbox_mark *mark, const unsigned char *bytes);

/* State of the slot of this event if it is there; one more: if it was left half-written. */
uint64_t tl_outbox_state_if_there(uint64_t number);

/* NULL, or what is wrong with an event. */
const char *tl_outbox_event_fault(const tl_recorder_event_entry *event);

#endif
