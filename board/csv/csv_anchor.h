/* The time of a stream's rows on our clock. Private to the live CSV driver.
 *
 * Purpose: stamp = base + time of the row. The first row sets the base. No stamp may be later than the arrival, so a
 *          row that comes early moves the base back. Where for a minute even the quickest row was late, the base moves
 *          forward by that much. So it follows the writer's clock for years, and single late rows change nothing.
 * Clock:   arrivals, and so stamps, are on the caller's clock. While rows go forward, stamps never go back.
 */
#ifndef TL_BOARD_CSV_CSV_ANCHOR_H
#define TL_BOARD_CSV_CSV_ANCHOR_H

#include <stdbool.h>

#include "master/base/simtime.h"

#define TL_CSV_DRIFT_WINDOW (60 * TL_SECOND)

/* Zeroed is not set. */
typedef struct tl_csv_anchor {
    bool set;
    tl_time base;     /* stamp of row time 0 */
    tl_time quickest; /* least delay within the window */
    tl_time window;   /* its end */
} tl_csv_anchor;

/* A row of that time came at `arrival`: from now on it is stamped so. */
void tl_csv_anchor_set(tl_csv_anchor *anchor, tl_time time, tl_time arrival);

/* The stamp of a row; the anchor must be set. */
tl_time tl_csv_anchor_stamp(tl_csv_anchor *anchor, tl_time time, tl_time arrival);

#endif
