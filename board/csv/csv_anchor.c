/* Maps the time of rows to our clock. */
#include "board/csv/csv_anchor.h"

static void open_window(tl_csv_anchor *anchor, tl_time arrival) {
    anchor->quickest = INT64_MAX;
    anchor->window = arrival + TL_CSV_DRIFT_WINDOW;
}

void tl_csv_anchor_set(tl_csv_anchor *anchor, tl_time time, tl_time arrival) {
    anchor->set = true;
    anchor->base = arrival - time;
    open_window(anchor, arrival);
}

tl_time tl_csv_anchor_stamp(tl_csv_anchor *anchor, tl_time time, tl_time arrival) {
    tl_time delay = arrival - (anchor->base + time);
    if (delay < 0) {
        anchor->base += delay;
        delay = 0;
    }
    anchor->quickest = delay < anchor->quickest ? delay : anchor->quickest;
    if (arrival >= anchor->window) {
        anchor->base += anchor->quickest;
        open_window(anchor, arrival);
    }
    return anchor->base + time;
}
