/* Limit window: checks whether the mean of a correction leaves the limits that the user has set.
 *
 * Window: the newest known values, for the time `lasts` of the alarm, in at most 16 parts. There is
 *         a result at the end of each part.
 * Rule:   the correction is outside if the mean of the window and the means of at least half of its
 *         parts are outside. So one extreme value is not enough. The correction is within if the
 *         mean of the window and the means of at least half of its parts are within.
 * Memory: plain data of the caller; zeroed: the window is empty.
 * Thread: one at a time.
 */
#ifndef TL_FIRMWARE_MONITOR_LIMIT_WINDOW_H
#define TL_FIRMWARE_MONITOR_LIMIT_WINDOW_H

#include <stdint.h>

#include "firmware/config/config.h"

enum { TL_LIMIT_PARTS = 16 };

typedef enum tl_limit_side {
    TL_LIMIT_UNKNOWN, /* the window is not full, the part is not complete, or neither rule applies */
    TL_LIMIT_WITHIN,
    TL_LIMIT_OUTSIDE
} tl_limit_side;

typedef struct tl_limit_window {
    uint64_t parts;                    /* complete so far */
    uint64_t values;                   /* number of values of the present part */
    double sum;                        /* sum of these values */
    double mean[TL_LIMIT_PARTS];       /* part n lies at n % TL_LIMIT_PARTS */
    int64_t first[TL_LIMIT_PARTS + 1]; /* first step of each part; the last: of the present part */
    /* results, after TL_LIMIT_OUTSIDE: */
    int64_t onset;  /* first step of the unbroken row of newest parts outside; if there is none, of the window */
    int64_t spread; /* uncertainty of the onset: half the steps of a part, ≥ 1 */
    double size;    /* mean since the onset */
    double whole;   /* mean of the window */
} tl_limit_window;

/* Adds the known value of a step, in the variable's unit; do not call it for an unknown one.
 * `period`: T_S, ns. */
tl_limit_side tl_limit_window_add(tl_limit_window *window, const tl_config_alarm *alarm, tl_time period, int64_t step,
                                  double value);

#endif
