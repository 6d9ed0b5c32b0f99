/* A TCP connection that can be interrupted.
 *
 * Under one lock interrupt() makes the eventfd readable and shuts the socket down, and the owner publishes its socket.
 * So either interrupt() sees the socket, or the owner, who looks at the eventfd after it has published, sees that it was
 * interrupted; and nobody shuts a descriptor down that has just been closed and given to somebody else.
 */
#include "board/io/modbus_link.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

tl_time tl_modbus_link_now(void) {
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

bool tl_modbus_link_make(tl_modbus_link *link, const char *host, uint16_t port) {
    memset(link, 0, sizeof *link);
    link->socket = -1;
    link->wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    link->host = strdup(host);
    (void)snprintf(link->service, sizeof link->service, "%u", (unsigned)port);
    if (link->wake < 0 || link->host == NULL || pthread_mutex_init(&link->lock, NULL) != 0) {
        if (link->wake >= 0) {
            (void)close(link->wake);
        }
        free(link->host);
        return false;
    }
    return true;
}

static void publish(tl_modbus_link *link, int descriptor) {
    (void)pthread_mutex_lock(&link->lock);
    int old = link->socket;
    link->socket = descriptor;
    (void)pthread_mutex_unlock(&link->lock);
    if (old >= 0) {
        (void)close(old);
    }
}

/* Readable now? Leaves it so. */
static bool wake_is_set(const tl_modbus_link *link) {
    struct pollfd wake = {.fd = link->wake, .events = POLLIN};
    return poll(&wake, 1, 0) > 0;
}

/* errno of the connection that was begun, 0 where it stands. */
static int await(const tl_modbus_link *link, int descriptor, tl_time deadline) {
    for (;;) {
        struct pollfd both[2] = {{.fd = descriptor, .events = POLLOUT}, {.fd = link->wake, .events = POLLIN}};
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
            int failure = 0;
            socklen_t size = sizeof failure;
            return getsockopt(descriptor, SOL_SOCKET, SO_ERROR, &failure, &size) == 0 ? failure : errno;
        }
    }
}

/* TCP may connect a socket to itself, where nobody listens on a port from which the system also serves itself. */
static bool is_own_echo(int descriptor) {
    struct sockaddr_storage own;
    struct sockaddr_storage other;
    memset(&own, 0, sizeof own);
    memset(&other, 0, sizeof other);
    socklen_t own_size = sizeof own;
    socklen_t other_size = sizeof other;
    return getsockname(descriptor, (struct sockaddr *)&own, &own_size) == 0 &&
           getpeername(descriptor, (struct sockaddr *)&other, &other_size) == 0 && own_size == other_size &&
           memcmp(&own, &other, own_size) == 0;
}

/* One address: 0, or errno. */
static int connect_to(tl_modbus_link *link, const struct addrinfo *address, tl_time deadline) {
    int one = 1;
    int descriptor =
        socket(address->ai_family, address->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, address->ai_protocol);
    if (descriptor < 0) {
        return errno;
    }
    int failure = 0;
    if (descriptor >= FD_SETSIZE) { /* libmodbus waits with select() */
        failure = EMFILE;
    } else if (connect(descriptor, address->ai_addr, address->ai_addrlen) != 0) {
        failure = errno == EINPROGRESS || errno == EINTR ? await(link, descriptor, deadline) : errno;
    }
    if (failure == 0 && is_own_echo(descriptor)) {
        failure = ECONNREFUSED;
    }
    if (failure != 0) {
        (void)close(descriptor);
        return failure;
    }
    (void)setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    publish(link, descriptor);
    return 0;
}

bool tl_modbus_link_connect(tl_modbus_link *link, tl_time timeout, char *cause, size_t cause_size) {
    struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = AI_NUMERICSERV};
    struct addrinfo *addresses = NULL;
    int resolved = getaddrinfo(link->host, link->service, &hints, &addresses);
    if (resolved != 0) {
        (void)snprintf(cause, cause_size, "the name cannot be resolved: %s", gai_strerror(resolved));
        return false;
    }
    tl_time left_addresses = 0;
    for (const struct addrinfo *address = addresses; address != NULL; address = address->ai_next) {
        left_addresses++;
    }
    /* Each address gets its share of what is left, so that a silent first one leaves time for the second. */
    tl_time deadline = tl_modbus_link_now() + timeout;
    int failure = EADDRNOTAVAIL;
    for (const struct addrinfo *address = addresses; address != NULL && failure != 0; address = address->ai_next) {
        tl_time now = tl_modbus_link_now();
        failure = wake_is_set(link) ? EINTR : connect_to(link, address, now + (deadline - now) / left_addresses);
        left_addresses--;
        if (failure == EINTR) {
            break;
        }
    }
    freeaddrinfo(addresses);
    if (failure != 0) {
        (void)snprintf(cause, cause_size, "no connection: %s", strerror(failure));
        return false;
    }
    if (wake_is_set(link)) { /* between the wait and the publication, or by the one who has seen it */
        publish(link, -1);
        return false;
    }
    return true;
}

bool tl_modbus_link_stray(const tl_modbus_link *link) {
    struct pollfd one = {.fd = link->socket, .events = POLLIN};
    return poll(&one, 1, 0) > 0;
}

void tl_modbus_link_close(tl_modbus_link *link) {
    publish(link, -1);
}

void tl_modbus_link_interrupt(tl_modbus_link *link) {
    uint64_t one = 1;
    (void)pthread_mutex_lock(&link->lock);
    /* It can only fail where the counter is full, and then it is set anyway. */
    ssize_t written = write(link->wake, &one, sizeof one);
    (void)written;
    if (link->socket >= 0) {
        (void)shutdown(link->socket, SHUT_RDWR);
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

void tl_modbus_link_release(tl_modbus_link *link) {
    publish(link, -1);
    (void)close(link->wake);
    (void)pthread_mutex_destroy(&link->lock);
    free(link->host);
}
