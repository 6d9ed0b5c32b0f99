/* The part that every link has: being interrupted.
 *
 * Under one lock interrupt() makes the eventfd readable and cuts the connection, where the kind has one to cut.
 */
#include "board/io/modbus_link.h"

#include <errno.h>
#include <modbus.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

tl_time tl_modbus_link_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

bool tl_modbus_link_init(tl_modbus_link *link, const tl_modbus_link_kind *kind, void *context, tl_time timeout) {
    link->kind = kind;
    link->context = context;
    link->timeout = timeout;
    link->descriptor = -1;
    link->wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    if (context == NULL || link->wake < 0 || pthread_mutex_init(&link->lock, NULL) != 0) {
        if (link->wake >= 0) {
            (void)close(link->wake);
        }
        modbus_free(context);
        return false;
    }
    /* It recovers nothing by itself: its own recovery sleeps. */
    (void)modbus_set_error_recovery(context, MODBUS_ERROR_RECOVERY_NONE);
    (void)modbus_set_byte_timeout(context, 0, 0); /* none of its own: the response's goes on */
    return true;
}

void tl_modbus_link_done(tl_modbus_link *link) {
    modbus_free(link->context);
    (void)close(link->wake);
    (void)pthread_mutex_destroy(&link->lock);
}

void tl_modbus_link_interrupt(tl_modbus_link *link) {
    uint64_t one = 1;
    (void)pthread_mutex_lock(&link->lock);
    /* It can only fail where the counter is full, and then it is set anyway. */
    ssize_t written = write(link->wake, &one, sizeof one);
    (void)written;
    if (link->kind->cut != NULL) {
        link->kind->cut(link);
    }
    (void)pthread_mutex_unlock(&link->lock);
}

bool tl_modbus_link_interrupted(tl_modbus_link *link) {
    uint64_t count = 0;
    (void)pthread_mutex_lock(&link->lock); /* not between the two things that interrupt() does */
    bool was = read(link->wake, &count, sizeof count) == (ssize_t)sizeof count;
    (void)pthread_mutex_unlock(&link->lock);
    return was;
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
