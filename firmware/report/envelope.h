/* The envelope of long curves: the least and the largest value of every stretch of steps, in bounded memory.
 *
 * Purpose: a curve of any length on a page of bounded size, from which no extreme is lost.
 * How:     a fixed number of buckets, each of `width` steps; where a step lies behind the last one, neighbours are merged
 *          and the width doubles. While the width is 1, nothing is left out.
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
    size_t used;    /* buckets up to the last that has a value */
    int64_t width;  /* steps per bucket: a power of 2 */
    int64_t steps;  /* 1 + the last position that was put */
    double *values; /* least and largest of each bucket, channel by channel, in their order of arrival; NaN: none */
    uint8_t *marks;
} tl_envelope;

/* `room` is even. TL_TRY_AGAIN where memory is out. */
tl_status tl_envelope_init(tl_envelope *envelope, size_t channels, size_t room, tl_error *error);

/* A zeroed envelope is allowed. */
void tl_envelope_free(tl_envelope *envelope);

/* The value of a channel at a position ≥ 0, counted in steps; rising within a channel. A value that is not finite leaves a
 * gap. */
void tl_envelope_put(tl_envelope *envelope, size_t channel, int64_t position, double value);

/* Bits for whatever the caller likes to mark a step with; those of a bucket are joined. */
void tl_envelope_mark(tl_envelope *envelope, size_t channel, int64_t position, uint8_t bits);

/* The two values of a bucket in the order in which they came, NaN where there is none; equal while the width is 1. */
void tl_envelope_get(const tl_envelope *envelope, size_t channel, size_t bucket, double pair[2]);

/* The marks of a bucket. */
uint8_t tl_envelope_marks(const tl_envelope *envelope, size_t channel, size_t bucket);

#endif
