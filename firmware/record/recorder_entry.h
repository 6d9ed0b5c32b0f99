/* What waits in the recorder's ring: samples and steps, cut to the signals that the run has.
 *
 * Purpose: a tl_sample is 1.1 kB, of which a plant with three signals uses 60 bytes; the ring then lasts longer.
 * Format:  one byte that says what follows, then its fields one after the other; private to this process.
 * Thread:  put: the producer; take: the consumer.
 */
#ifndef TL_FIRMWARE_RECORD_RECORDER_ENTRY_H
#define TL_FIRMWARE_RECORD_RECORDER_ENTRY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/record/recorder_ring.h"
#include "firmware/record/run_types.h"
#include "master/base/signal.h"
#include "master/twin/twin.h"

/* How many of each the run has: at most TL_MAX_SIGNALS, TL_MAX_MATCH, TL_MAX_ADJUST, TL_RECORDER_COMPONENTS. */
typedef struct tl_recorder_shape {
    size_t plant;
    size_t match;
    size_t adjust;
    size_t components;
} tl_recorder_shape;

typedef enum tl_recorder_kind { TL_ENTRY_START, TL_ENTRY_SAMPLE, TL_ENTRY_STEP } tl_recorder_kind;

typedef struct tl_recorder_entry {
    tl_recorder_kind kind;
    tl_resumption beginning; /* TL_ENTRY_START */
    tl_sample sample;
    tl_record record;
    tl_recorder_component ledger[TL_RECORDER_COMPONENTS]; /* as of the record */
} tl_recorder_entry;

/* Bytes of an entry in the ring. */
size_t tl_recorder_entry_size(const tl_recorder_shape *shape, tl_recorder_kind kind);

/* False, and nothing is put, where the ring has no room. Stamps are put relative to `start`. */
bool tl_recorder_entry_put_start(tl_recorder_ring *ring, const tl_recorder_shape *shape,
                                 const tl_resumption *beginning);
bool tl_recorder_entry_put_sample(tl_recorder_ring *ring, const tl_recorder_shape *shape, const tl_sample *sample,
                                  tl_time start);
bool tl_recorder_entry_put_step(tl_recorder_ring *ring, const tl_recorder_shape *shape, const tl_record *record,
                                const tl_recorder_component *ledger);

/* The entry at the cursor, which must be before the ring's end; moves the cursor behind it. Fields beyond the shape
 * are not set. */
void tl_recorder_entry_take(const tl_recorder_ring *ring, const tl_recorder_shape *shape, size_t *cursor,
                            tl_recorder_entry *entry);

#endif
