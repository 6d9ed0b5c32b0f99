/* Arrivals: compares the number of readings with the number that the configuration expects.
 *
 * Purpose: a device that answers more slowly than its period_s, or a sender that is slower than
 *          every_s, gives fewer readings. That changes no quality, so it is reported here: once per
 *          signal as an event, and at the end in the summary.
 * Counted: posts into the sample buffers, with or without a value. A signal is checked only if
 *          tl_config_interval() knows its longest interval: not a further look-up (NAME@…).
 * Bound:   O(1) per tick; O(signals) every TL_ARRIVALS_CHECK (2 s).
 * Thread:  plain data; the thread of the cycle.
 */
#ifndef TL_FIRMWARE_TWIN_ARRIVALS_H
#define TL_FIRMWARE_TWIN_ARRIVALS_H

#include <stdint.h>

#include "firmware/plant/plant_input.h"
#include "firmware/report/journal.h"
#include "firmware/report/summary.h"

/* Time between two checks, ns. A check skips a signal until TL_ARRIVALS_LEAST readings were due. */
#define TL_ARRIVALS_CHECK (2 * TL_SECOND)
enum { TL_ARRIVALS_LEAST = 20 };

/* Fields are private. Zeroed: counting begins with the next check. */
typedef struct tl_arrivals {
    tl_time begun;                  /* CLOCK_MONOTONIC; 0: not begun */
    tl_time due;                    /* instant of the next check */
    uint64_t first[TL_MAX_SIGNALS]; /* posts of each signal at `begun` */
    tl_time since[TL_MAX_SIGNALS];  /* instant at which each signal was last checked, not skipped */
    uint64_t posts[TL_MAX_SIGNALS]; /* posts at that instant */
    uint64_t reported;              /* bit i: signal i was reported */
} tl_arrivals;

/* Call it at each tick. `now`: CLOCK_MONOTONIC. Reports a signal once, if fewer than three quarters
 * of its expected readings have come since its last check. The event has no tick, because a replay
 * cannot repeat it. */
void tl_arrivals_check(tl_arrivals *self, const tl_plant_input *input, const tl_config *config, tl_journal *journal,
                       tl_time now);

/* Sets `readings` and `expected` of the summary: counts from `begun` until `now`. */
void tl_arrivals_sum_up(const tl_arrivals *self, const tl_plant_input *input, const tl_config *config, tl_time now,
                        tl_summary *summary);

#endif
