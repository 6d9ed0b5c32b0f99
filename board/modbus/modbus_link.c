/* The part that every link has: being interrupted. Whoever waits looks at the wake-up call too. */
#include "board/modbus/modbus_link.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>

#include "board/io/monotonic.h"

bool tl_modbus_link_init(tl_modbus_link *link, const tl_modbus_link_settings *settings) {
    *link = (tl_modbus_link){.kind = settings->kind, .timeout = settings->timeout, .descriptor = -1};
    (void)snprintf(link->name, sizeof link->name, "%s", settings->name);
    return tl_wake_make(&link->wake);
}

void tl_modbus_link_done(tl_modbus_link *link) {
    tl_wake_release(&link->wake);
}

int tl_modbus_link_await(const tl_modbus_link *link, int descriptor, short events, tl_time deadline) {
    for (;;) {
        struct pollfd both[2] = {{.fd = descriptor, .events = events}, {.fd = link->wake.descriptor, .events = POLLIN}};
        tl_time left = deadline - tl_monotonic_now();
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
