/* CSV rows from a FIFO, while they are written.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_CSV_CSV_LIVE_H
#define TL_BOARD_CSV_CSV_LIVE_H

#include <stdbool.h>

#include "master/base/simtime.h"

#define TL_CSV_DRIFT_WINDOW (60 * TL_SECOND)

/* Starts as zeros: not set. */
typedef struct tl_csv_anchor {
    bool set;
    tl_time base;     /* stamp of row time 0 */
    tl_time quickest; /* least delay within the window */
    tl_time window;   /* its end */
} tl_csv_anchor;

/* Anchors rows to a row that arrived at `arrival`. */
void tl_csv_anchor_set(tl_csv_anchor *anchor, tl_time time, tl_time arrival);

/* Stamp of a row; the anchor must be set. */
tl_time tl_csv_anchor_stamp(tl_csv_anchor *anchor, tl_time time, tl_time arrival);

#endif
