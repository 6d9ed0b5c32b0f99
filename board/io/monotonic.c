/* The clock of the drivers: see monotonic.h. Alone in its file, so that a test can be the clock. */
#include "board/io/monotonic.h"

#include <time.h>

tl_time tl_monotonic_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}
