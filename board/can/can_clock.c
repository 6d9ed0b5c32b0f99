/* Receive stamps on CLOCK_MONOTONIC: see can_clock.h. */
#include "board/can/can_clock.h"

void tl_can_clock_empty(tl_can_clock *clock, tl_time monotonic, tl_time wall) {
    clock->floor = monotonic;
    clock->ahead = wall - monotonic;
    clock->known = true;
}

static bool fits(const tl_can_clock *clock, tl_time stamp, tl_time now) {
    return stamp >= clock->floor && stamp <= now;
}

static tl_time nearer(const tl_can_clock *clock, tl_time stamp, tl_time now) {
    if (stamp > now) {
        return now;
    }
    return stamp < clock->floor ? clock->floor : stamp;
}

tl_time tl_can_clock_stamp(tl_can_clock *clock, tl_time received, tl_time monotonic, tl_time wall) {
    tl_time stamp = received > 0 ? received - (wall - monotonic) : monotonic;
    if (received > 0 && clock->known && !fits(clock, stamp, monotonic) &&
        fits(clock, received - clock->ahead, monotonic)) {
        stamp = received - clock->ahead;
    }
    clock->floor = nearer(clock, stamp, monotonic);
    return clock->floor;
}
