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
 * Purpose: limits retries with a device that is absent, broken or silent. The first wait is
 *          TL_BACKOFF_FIRST; each further wait is twice the last one, up to TL_BACKOFF_LAST. All
 *          drivers use these values.
 * Units:   ns; `now` is on CLOCK_MONOTONIC (monotonic.h).
 * Owner:   the caller owns the struct; no allocation, no clock is read. Thread: one. Errors: none.
 */

#define TL_BACKOFF_FIRST (TL_SECOND / 10)
#define TL_BACKOFF_LAST (2 * TL_SECOND)

/* Initialise it with zeros: no failure. Fields are private. */
typedef struct tl_backoff {
    tl_time pause; /* length of the last wait, ns; 0: no failure */
    tl_time due;   /* end of the wait, CLOCK_MONOTONIC */
} tl_backoff;

/* Records a failure, and begins a wait at `now`: twice as long as the last one, within the
 * limits. */
void tl_backoff_fail(tl_backoff *backoff, tl_time now);

/* Records a success, or a sign that the device may work again. Ends the wait; the next failure
 * counts as the first. */
void tl_backoff_reset(tl_backoff *backoff);

/* True if there was a failure since the last reset, also after the end of its wait. */
bool tl_backoff_is_on(const tl_backoff *backoff);

/* True if a try is allowed: there was no failure, or its wait is over. */
bool tl_backoff_is_due(const tl_backoff *backoff, tl_time now);

/* ---- Link state of a device: up, down, or unknown.
 *
 * Purpose: reports each change once, by the sink's link(). A problem of a part of the device does
 *          not change the state. Each driver defines when its link is up, and when it reports a
 *          problem again.
 * Texts:   "DEVICE: TEXT", truncated to TL_LINK_TEXT − 1 bytes. Example of DEVICE: "CAN interface
 *          can0". TEXT: what happened and what to do.
 * Owner:   the caller owns the struct; no allocation. Thread: that of the driver's poll. Errors:
 *          none.
 */

enum { TL_LINK_TEXT = 608 }; /* bytes: name of the device, text of an error, and the NUL */

typedef enum tl_link_state { TL_LINK_UNKNOWN, TL_LINK_DOWN, TL_LINK_UP } tl_link_state;

/* Initialise it with zeros: unknown, so that the first state is always reported. */
typedef struct tl_link {
    tl_link_state state;
} tl_link;

/* False if the link is down or unknown. */
bool tl_link_is_up(const tl_link *link);

/* Sets the link up or down without a report. Returns true if this changed the state. */
bool tl_link_change(tl_link *link, bool up);

/* Reports a text and does not change the link. `good`: false for a problem, true for its end. A
 * problem goes to part_failed(), if the link is up and the sink has this function. Otherwise the
 * text goes to link(), with the present state. `device`: its name; NULL if the text names it. */
void tl_link_report(const tl_link *link, const tl_plant_io_sink *sink, bool good, const char *device, const char *text);

/* Sets the link up or down. If this changes the state, reports it to link() and returns true.
 * `device`, `text`: as for tl_link_report(). */
bool tl_link_set(tl_link *link, const tl_plant_io_sink *sink, bool up, const char *device, const char *text);

#endif
