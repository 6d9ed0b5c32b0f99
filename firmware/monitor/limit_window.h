/* Limit window: watches if the mean of a correction leaves the limits that the user names.
 *
 * Window: the newest `lasts` of known values, in at most 16 parts. A result follows each part.
 * Rule:   outside, if the mean of the window and the means of half of its parts are outside. So one
 *         step, however large, cannot put it outside. Likewise for within; else it is neither.
 * Memory: plain data of the caller; zeroed: the window is empty.
 * Thread: one at a time.
 */
#ifndef TL_FIRMWARE_MONITOR_LIMIT_WINDOW_H
#define TL_FIRMWARE_MONITOR_LIMIT_WINDOW_H

#include <stdint.h>

#include "firmware/config/config.h"

enum { TL_LIMIT_PARTS = 16 };

typedef enum tl_limit_side {
    TL_LIMIT_UNKNOWN, /* the window is not full, a part is not complete, or it is neither */
    TL_LIMIT_WITHIN,
    TL_LIMIT_OUTSIDE
} tl_limit_side;

typedef struct tl_limit_window {
    uint64_t parts;                    /* complete so far */
    uint64_t values;                   /* of the present part */
    double sum;                        /* of them */
    double mean[TL_LIMIT_PARTS];       /* part n lies at n % TL_LIMIT_PARTS */
    int64_t first[TL_LIMIT_PARTS + 1]; /* first step of each part; the last: of the present part */
    /* results, after TL_LIMIT_OUTSIDE: */
    int64_t onset;  /* first step of the newest parts that are all outside; else of the window */
    int64_t spread; /* half the steps of a part, ≥ 1 */
    double size;    /* mean since the onset */
    double whole;   /* mean of the window */
} tl_limit_window;

/* Adds a value in the variable's unit, if it is known. `period`: T_S, ns. */
tl_limit_side tl_limit_window_add(tl_limit_window *window, const tl_config_alarm *alarm, tl_time period, int64_t step,
                                  double value);

#endif
