/* Clock of the drivers: see monotonic.h. In a file of its own so that a test can replace it. */
#include "board/io/monotonic.h"

#include <time.h>

tl_time tl_monotonic_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}
