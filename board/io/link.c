/* State of a connection, and back-off: see link.h. */
#include "board/io/link.h"

#include <stdio.h>

/* ---- backoff ---- */

void tl_backoff_fail(tl_backoff *backoff, tl_time now) {
    tl_time next = backoff->pause > 0 ? 2 * backoff->pause : TL_BACKOFF_FIRST;
    backoff->pause = next < TL_BACKOFF_LAST ? next : TL_BACKOFF_LAST;
    backoff->due = now + backoff->pause;
}

void tl_backoff_reset(tl_backoff *backoff) {
    *backoff = (tl_backoff){.pause = 0};
}

bool tl_backoff_is_on(const tl_backoff *backoff) {
    return backoff->pause > 0;
}

bool tl_backoff_is_due(const tl_backoff *backoff, tl_time now) {
    return backoff->pause == 0 || now >= backoff->due;
}

/* ---- link ---- */

bool tl_link_is_up(const tl_link *link) {
    return link->state == TL_LINK_UP;
}

bool tl_link_change(tl_link *link, bool up) {
    tl_link_state before = link->state;
    link->state = up ? TL_LINK_UP : TL_LINK_DOWN;
    return link->state != before;
}

void tl_link_report(const tl_link *link, const tl_plant_io_sink *sink, bool good, const char *device,
                    const char *text) {
    bool up = tl_link_is_up(link);
    char whole[TL_LINK_TEXT];
    (void)snprintf(whole, sizeof whole, "%s%s%s", device != NULL ? device : "", device != NULL ? ": " : "", text);
    if (up && !good && sink->part_failed != NULL) {
        sink->part_failed(sink->context, whole);
    } else {
        sink->link(sink->context, up, whole);
    }
}

bool tl_link_set(tl_link *link, const tl_plant_io_sink *sink, bool up, const char *device, const char *text) {
    bool has_changed = tl_link_change(link, up);
    if (has_changed) {
        tl_link_report(link, sink, true, device, text);
    }
    return has_changed;
}
