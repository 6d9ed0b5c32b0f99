/* The system's own clock: what is tested may have one of its own. */
#include "tests/support/real_time.h"

#include <time.h>

tl_time tl_test_now(void) {
    struct timespec time;
    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return (tl_time)time.tv_sec * TL_SECOND + time.tv_nsec;
}

void tl_test_pause_ms(long ms) {
    const struct timespec time = {.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000};
    (void)nanosleep(&time, NULL);
}
