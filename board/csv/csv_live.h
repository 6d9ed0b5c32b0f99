/* Anchor of a live CSV stream: converts row times to stamps of CLOCK_MONOTONIC.
 *
 * Purpose: stamp = row time + base. If a row arrives before its stamp, base is lowered so that the
 *          stamp is the arrival. After each window, base is raised by the least delay (arrival −
 *          stamp) in this window. So a slow clock drift is corrected.
 * Units:   ns. `time` is from the row's time column; `arrival` is on CLOCK_MONOTONIC.
 * Owner:   the caller owns the struct; no allocation, no clock is read.
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_CSV_CSV_LIVE_H
#define TL_BOARD_CSV_CSV_LIVE_H

#include <stdbool.h>

#include "master/base/simtime.h"

/* Length of a window, ns: the time between two corrections of clock drift. */
#define TL_CSV_DRIFT_WINDOW (60 * TL_SECOND)

/* Initialise it with zeros: not set. */
typedef struct tl_csv_anchor {
    bool set;
    tl_time base;     /* stamp of row time 0, ns */
    tl_time quickest; /* least delay in this window, ns */
    tl_time window;   /* end of this window, CLOCK_MONOTONIC */
} tl_csv_anchor;

/* Sets the anchor so that the stamp of this row is its arrival; begins a window. */
void tl_csv_anchor_set(tl_csv_anchor *anchor, tl_time time, tl_time arrival);

/* Returns the stamp of a row, never later than `arrival`. May correct the anchor, which must be
 * set. */
tl_time tl_csv_anchor_stamp(tl_csv_anchor *anchor, tl_time time, tl_time arrival);

#endif
