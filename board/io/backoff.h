/* Back-off: waiting longer and longer between attempts that fail.
 *
 * Purpose: what a driver does with a device that is absent, dead or silent. The first wait is TL_BACKOFF_FIRST, each further
 *          one is twice as long, up to TL_BACKOFF_LAST. All drivers wait alike.
 * Units:   ns; `now` is on CLOCK_MONOTONIC (monotonic.h).
 * Owner:   placed by its owner; no allocation, no clock is asked here. Thread: one. Errors: none.
 */
#ifndef TL_BOARD_IO_BACKOFF_H
#define TL_BOARD_IO_BACKOFF_H

#include <stdbool.h>

#include "master/base/simtime.h"

#define TL_BACKOFF_FIRST (TL_SECOND / 10)
#define TL_BACKOFF_LAST (2 * TL_SECOND)

/* Zeroed: nothing has failed. Fields are private. */
typedef struct tl_backoff {
    tl_time pause; /* the last wait; 0: none */
    tl_time due;   /* its end */
} tl_backoff;

/* An attempt has failed just now: the next one waits, longer than this one did. */
void tl_backoff_fail(tl_backoff *backoff, tl_time now);

/* All is well, or there is news: nothing is waited for, and the next failure is the first one. */
void tl_backoff_reset(tl_backoff *backoff);

/* Has the last attempt failed? */
bool tl_backoff_is_on(const tl_backoff *backoff);

/* May it be tried now? It may if nothing has failed, and at the end of the wait. */
bool tl_backoff_is_due(const tl_backoff *backoff, tl_time now);

#endif
