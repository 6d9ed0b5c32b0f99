/* State of the connection to a source, and the time of the next retry.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_IO_LINK_H
#define TL_BOARD_IO_LINK_H

#include <stdbool.h>

#include "board/io/plant_io.h"
#include "master/base/simtime.h"

/* ---- Back-off: increasing waits between failed tries.
 *
 * Purpose: for a device that is absent, broken or silent. The first wait is TL_BACKOFF_FIRST; each
 *          further one is doubled, up to TL_BACKOFF_LAST. The same for all drivers.
 * Units:   ns; `now` is on CLOCK_MONOTONIC (monotonic.h).
 * Owner:   the caller places it; no allocation, no clock is read. Thread: one. Errors: none.
 */

#define TL_BACKOFF_FIRST (TL_SECOND / 10)
#define TL_BACKOFF_LAST (2 * TL_SECOND)

/* Starts as zeros: no failure. Fields are private. */
typedef struct tl_backoff {
    tl_time pause; /* the last wait; 0: none */
    tl_time due;   /* its end */
} tl_backoff;

/* Records a failure: the next wait is longer than the last one. */
void tl_backoff_fail(tl_backoff *backoff, tl_time now);

/* Records success or new information: no wait, and the next failure counts as the first. */
void tl_backoff_reset(tl_backoff *backoff);

/* True if the last try failed. */
bool tl_backoff_is_on(const tl_backoff *backoff);

/* True if a retry is allowed: without a failure, and at the end of the wait. */
bool tl_backoff_is_due(const tl_backoff *backoff, tl_time now);

/* ---- Link state of a device: up, down, or unknown.
 *
 * Purpose: a change is reported once, in a sentence, by the sink's link(); a problem of a part does
 *          not change the state. Each driver defines "up" and which problems are new.
 * Texts:   "DEVICE: TEXT", cut after TL_LINK_TEXT − 1 bytes. DEVICE: "CAN interface can0".
 *          TEXT: what happened and what to do.
 * Owner:   the caller places it; no allocation. Thread: that of the driver's poll. Errors: none.
 */

enum { TL_LINK_TEXT = 608 }; /* bytes: an error's text, the device's name, and the end */

typedef enum tl_link_state { TL_LINK_UNKNOWN, TL_LINK_DOWN, TL_LINK_UP } tl_link_state;

/* Starts as zeros: unknown, so that the first state is reported in any case. */
typedef struct tl_link {
    tl_link_state state;
} tl_link;

/* Also false if unknown. */
bool tl_link_is_up(const tl_link *link);

/* Sets the link up or down without a report. Returns true if it has changed. */
bool tl_link_change(tl_link *link, bool up);

/* Reports a text without a change of the link. `good`: false if a part fails. `device`: NULL if the
 * text names it. */
void tl_link_report(const tl_link *link, const tl_plant_io_sink *sink, bool good, const char *device, const char *text);

/* Sets the link up or down, and reports a change. Returns true if it has changed. */
bool tl_link_set(tl_link *link, const tl_plant_io_sink *sink, bool up, const char *device, const char *text);

#endif
