/* A reading that a poll has found again.
 *
 * Purpose: a register is often read more often than its device writes it. Conditions, lines and figures count readings, so what was only read again must not count: a
 *          median of three would hold the same one three times.
 * Rule:    a good reading with the value of the one before, and so soon after it that none was due, is that one again. So is the second of two equal values in a row that
 *          a device has really written, which nobody can tell: a line to the next other value begins at the first of them.
 * Thread:  plain data; the source's.
 */
#ifndef TL_FIRMWARE_PLANT_REPEATED_READING_H
#define TL_FIRMWARE_PLANT_REPEATED_READING_H

#include <stdbool.h>

#include "master/base/signal.h"

/* Of one channel. Private; zeroed: nothing was read. */
typedef struct tl_repeated_reading {
    tl_reading last; /* that was a new one */
    bool has_last;
} tl_repeated_reading;

/* Whether it is the one before again. `within`: ns from that one on, in which no other is due; 0: each is a new one. */
bool tl_repeated_reading_is(tl_repeated_reading *self, tl_time within, const tl_reading *reading);

#endif
