/* The state of a connection to a source, and when a lost one is tried again.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_IO_LINK_H
#define TL_BOARD_IO_LINK_H

#include <stdbool.h>

#include "board/io/plant_io.h"
#include "master/base/simtime.h"

/* ---- Back-off: waiting longer and longer between attempts that fail.
 *
 * Purpose: what a driver does with a device that is absent, dead or silent. The first wait is TL_BACKOFF_FIRST, each further
 *          one is twice as long, up to TL_BACKOFF_LAST. All drivers wait alike.
 * Units:   ns; `now` is on CLOCK_MONOTONIC (monotonic.h).
 * Owner:   placed by its owner; no allocation, no clock is asked here. Thread: one. Errors: none.
 */

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

/* ---- The link to a device as a driver tells it: up, down, or not known yet.
 *
 * Purpose: a change is told once, in a sentence, by the sink's link(); trouble of a part is told with the link as it is.
 *          What "up" means, and whether a part's trouble is news, is each driver's own business.
 * Texts:   "WHO: TEXT", cut after TL_LINK_TEXT − 1 bytes. Who: the device, for people ("CAN interface can0"). Text: what
 *          happened and what to do about it.
 * Owner:   placed by its owner; no allocation. Thread: that of the driver's poll. Errors: none.
 */

enum { TL_LINK_TEXT = 608 }; /* bytes: an error's text, the device's name, and the end */

typedef enum tl_link_state { TL_LINK_UNKNOWN, TL_LINK_DOWN, TL_LINK_UP } tl_link_state;

/* Zeroed: not known, so that the first state is told whichever it is. */
typedef struct tl_link {
    tl_link_state state;
} tl_link;

/* false also where it is not known yet. */
bool tl_link_is_up(const tl_link *link);

/* The link is up, or down, and nothing is told. true if that is news. */
bool tl_link_change(tl_link *link, bool up);

/* Tells a text, with the link as it is. */
void tl_link_report(const tl_link *link, const tl_plant_io_sink *sink, const char *who, const char *text);

/* Both: the link is up, or down, and if that is news, it is told. true if it is. */
bool tl_link_set(tl_link *link, const tl_plant_io_sink *sink, bool up, const char *who, const char *text);

#endif
