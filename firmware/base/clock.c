/* The clock of the appliance: see clock.h. */
#include "firmware/base/clock.h"

#include <time.h>

tl_time tl_clock_now(void *context) {
    (void)context;
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

void tl_clock_sleep_until(tl_time instant) {
    struct timespec until = {.tv_sec = (time_t)(instant / TL_SECOND), .tv_nsec = (long)(instant % TL_SECOND)};
    (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
}
