/* The part that every link has: being interrupted. Whoever waits looks at an eventfd too. */
#include "board/modbus/modbus_link.h"

#include <errno.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

tl_time tl_modbus_link_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

bool tl_modbus_link_init(tl_modbus_link *link, const tl_modbus_link_kind *kind, tl_time timeout) {
    link->kind = kind;
    link->timeout = timeout;
    link->descriptor = -1;
    link->wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    return link->wake >= 0;
}

void tl_modbus_link_done(tl_modbus_link *link) {
    (void)close(link->wake);
}

void tl_modbus_link_interrupt(tl_modbus_link *link) {
    uint64_t one = 1;
    /* It can only fail where the counter is full, and then it is set anyway. */
    ssize_t written = write(link->wake, &one, sizeof one);
    (void)written;
}

bool tl_modbus_link_interrupted(tl_modbus_link *link) {
    uint64_t count = 0;
    return read(link->wake, &count, sizeof count) == (ssize_t)sizeof count;
}

bool tl_modbus_link_is_woken(const tl_modbus_link *link) {
    struct pollfd wake = {.fd = link->wake, .events = POLLIN};
    return poll(&wake, 1, 0) > 0;
}

int tl_modbus_link_await(const tl_modbus_link *link, int descriptor, short events, tl_time deadline) {
    for (;;) {
        struct pollfd both[2] = {{.fd = descriptor, .events = events}, {.fd = link->wake, .events = POLLIN}};
        tl_time left = deadline - tl_modbus_link_now();
        int ready = left > 0 ? poll(both, 2, (int)(left / 1000000) + 1) : 0;
        if (ready == 0) {
            return ETIMEDOUT;
        }
        if (ready < 0 && errno != EINTR) {
            return errno;
        }
        if (ready > 0 && both[1].revents != 0) {
            return EINTR;
        }
        if (ready > 0 && both[0].revents != 0) {
            return 0;
        }
    }
}
