/* The readings of one signal, conditioned each once as it comes, and kept to be looked up.
 *
 * Purpose: between the mailbox that a source posts into and the look-up of a sample. What has come by an instant is the same whenever that is asked,
 *          so a run that has missed ticks sees what it would have seen.
 * Again:   a reading with a stamp no later than the newest that was taken is that one again, and is passed over; one whose stamp is later than the
 *          instant waits for its time.
 * Trust:   none in the mailbox; so many readings are taken at once as it is deep.
 * Memory:  the heap's, when made. Thread: the cycle's.
 */
#ifndef TL_FIRMWARE_PLANT_READING_STREAM_H
#define TL_FIRMWARE_PLANT_READING_STREAM_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/plant/conditioner.h"
#include "firmware/plant/mailbox.h"

typedef struct tl_reading_stream tl_reading_stream;

/* For as many readings as a mailbox of that depth has, a power of two. NULL: there is not enough memory. free() releases it. */
tl_reading_stream *tl_reading_stream_make(const tl_condition *condition, tl_time stale, uint32_t depth);

/* Before an instant's readings are put: none of them was rejected yet. */
void tl_reading_stream_begin(tl_reading_stream *stream);

/* The next reading of the mailbox with a stamp ≤ until; false: there is none yet. */
bool tl_reading_stream_next(tl_reading_stream *stream, const tl_mailbox *mailbox, tl_time until, tl_reading *reading);

/* It, judged (plant_input.c). */
void tl_reading_stream_put(tl_reading_stream *stream, const tl_reading *reading);

/* What has come out, to be looked up; and, under the same stamps, where the low-pass was: the same where there is none. */
const tl_mailbox *tl_reading_stream_out(const tl_reading_stream *stream);
const tl_mailbox *tl_reading_stream_smooth(const tl_reading_stream *stream);

/* τ; 0: there is none. */
tl_time tl_reading_stream_low_pass(const tl_reading_stream *stream);

/* What came last, as it came; if any was rejected since the last begin, the last of these, with the quality TL_OUTLIER. False: nothing has come. */
bool tl_reading_stream_newest(const tl_reading_stream *stream, tl_reading *reading);

#endif
