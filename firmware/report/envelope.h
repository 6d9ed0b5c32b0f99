/* Envelope of long curves: minimum and maximum of each range of steps, in bounded memory.
 *
 * Purpose: shows a curve of any length on a page of bounded size without losing an extreme value.
 * Method:  each curve (channel) has a fixed number of buckets of `width` steps. If a step lies
 *          beyond the last bucket, each pair of neighbours is merged and the width doubles. While
 *          the width is 1, the curve is complete.
 * Owner:   tl_envelope owns its memory until tl_envelope_free().
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_ENVELOPE_H
#define TL_FIRMWARE_REPORT_ENVELOPE_H

#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"

/* The caller may read all fields except the arrays. */
typedef struct tl_envelope {
    size_t channels; /* number of curves */
    size_t room;     /* buckets per channel */
    size_t used;     /* buckets up to the last one with a value or a mark, over all channels */
    int64_t width;   /* steps per bucket: a power of 2 */
    int64_t steps;   /* 1 + the largest position so far */
    double *values;  /* minimum and maximum of each bucket, the earlier one first; NaN: no value */
    uint8_t *marks;  /* bits of each bucket: tl_envelope_mark() */
} tl_envelope;

/* Allocates an empty envelope of `channels` curves, with `room` buckets for each: even and > 0.
 * Errors: TL_TRY_AGAIN if memory is out. */
tl_status tl_envelope_init(tl_envelope *envelope, size_t channels, size_t room, tl_error *error);

/* Frees the envelope. A zeroed one is allowed. */
void tl_envelope_free(tl_envelope *envelope);

/* Adds the value of a channel at `position` ≥ 0, in steps. Within a channel, each position must be
 * larger than the one before. A value that is not finite leaves a gap. */
void tl_envelope_put(tl_envelope *envelope, size_t channel, int64_t position, double value);

/* Marks a step with `bits`, whose meaning the caller defines. A bucket has the bits of all its
 * steps. */
void tl_envelope_mark(tl_envelope *envelope, size_t channel, int64_t position, uint8_t bits);

/* Sets `pair` to minimum and maximum of a bucket (< `used`), in the order in which they occurred;
 * NaN if it has no value. While the width is 1 both are equal. */
void tl_envelope_get(const tl_envelope *envelope, size_t channel, size_t bucket, double pair[2]);

/* Returns the marks of a bucket. */
uint8_t tl_envelope_marks(const tl_envelope *envelope, size_t channel, size_t bucket);

#endif
