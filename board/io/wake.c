/* Wake-up call by eventfd: see wake.h. */
#include "board/io/wake.h"

#include <sys/eventfd.h>
#include <unistd.h>

bool tl_wake_make(tl_wake *wake) {
    *wake = (tl_wake){.descriptor = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)};
    return wake->descriptor >= 0;
}

/* Counts first: a thread that the write wakes up must find the call. */
void tl_wake_call(tl_wake *wake) {
    (void)__atomic_fetch_add(&wake->calls, 1U, __ATOMIC_SEQ_CST);
    /* It can only fail if the counter is full; then the call is pending anyway. */
    (void)eventfd_write(wake->descriptor, 1);
}

bool tl_wake_is_called(const tl_wake *wake) {
    return __atomic_load_n(&wake->calls, __ATOMIC_SEQ_CST) != wake->answered;
}

/* If the call is counted but not written yet, it is answered again. */
bool tl_wake_clear(tl_wake *wake) {
    eventfd_t count = 0;
    bool is_called = tl_wake_is_called(wake);
    if (is_called && eventfd_read(wake->descriptor, &count) == 0) {
        wake->answered += (unsigned)count;
    }
    return is_called;
}

void tl_wake_release(tl_wake *wake) {
    if (wake->descriptor >= 0) {
        (void)close(wake->descriptor);
        wake->descriptor = -1;
    }
}
