/* Wake-up call by eventfd: see wake.h. */
#include "board/io/wake.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

bool tl_wake_make(tl_wake *wake) {
    wake->descriptor = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    return wake->descriptor >= 0;
}

void tl_wake_call(const tl_wake *wake) {
    /* It can only fail if the counter is full; then the call is pending anyway. */
    (void)eventfd_write(wake->descriptor, 1);
}

bool tl_wake_is_called(const tl_wake *wake) {
    struct pollfd one = {.fd = wake->descriptor, .events = POLLIN};
    return poll(&one, 1, 0) > 0;
}

bool tl_wake_clear(const tl_wake *wake) {
    eventfd_t count = 0;
    return eventfd_read(wake->descriptor, &count) == 0;
}

void tl_wake_release(tl_wake *wake) {
    if (wake->descriptor >= 0) {
        (void)close(wake->descriptor);
        wake->descriptor = -1;
    }
}
