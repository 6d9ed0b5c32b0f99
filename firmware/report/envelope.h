/* Envelope of long curves: minimum and maximum of each range of steps, in bounded memory.
 *
 * Purpose: shows a curve of any length on a page of bounded size without losing an extreme value.
 * Method:  a fixed number of buckets of `width` steps each. If a step does not fit into the last
 *          bucket, pairs of neighbours are merged and the width doubles. While the width is 1, the
 *          curve is complete.
 * Owner:   tl_envelope owns its memory; valid until tl_envelope_free().
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_ENVELOPE_H
#define TL_FIRMWARE_REPORT_ENVELOPE_H

#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"

typedef struct tl_envelope {
    size_t channels;
    size_t room;    /* buckets per channel */
    size_t used;    /* buckets up to the last one with a value */
    int64_t width;  /* steps per bucket: a power of 2 */
    int64_t steps;  /* 1 + the largest position so far */
    double *values; /* minimum and maximum of each bucket, in order of time; NaN: no value */
    uint8_t *marks;
} tl_envelope;

/* Allocates an empty envelope. `room` must be even. Errors: TL_TRY_AGAIN if memory is out. */
tl_status tl_envelope_init(tl_envelope *envelope, size_t channels, size_t room, tl_error *error);

/* Frees the envelope. A zeroed one is allowed. */
void tl_envelope_free(tl_envelope *envelope);

/* Adds the value of a channel at `position` ≥ 0, in steps. Positions must rise within a channel. A
 * value that is not finite leaves a gap. */
void tl_envelope_put(tl_envelope *envelope, size_t channel, int64_t position, double value);

/* Marks a step with `bits`, whose meaning the caller defines. A bucket has the bits of all its
 * steps. */
void tl_envelope_mark(tl_envelope *envelope, size_t channel, int64_t position, uint8_t bits);

/* Returns the two values of a bucket in the order in which they occurred; NaN if there are none.
 * While the width is 1 they are equal. */
void tl_envelope_get(const tl_envelope *envelope, size_t channel, size_t bucket, double pair[2]);

/* Returns the marks of a bucket. */
uint8_t tl_envelope_marks(const tl_envelope *envelope, size_t channel, size_t bucket);

#endif
