/* The TCP connection of the Modbus driver.
 *
 * interrupt() shuts the socket down, under the lock under which the owner publishes its socket. So either interrupt() sees
 * the socket, or the owner, who looks at the eventfd after it has published, sees that it was interrupted; and nobody
 * shuts a descriptor down that has just been closed and given to somebody else.
 *
 * Of libmodbus only the reading functions are used; it does not connect.
 */
#include "board/io/modbus_link.h"

#include <errno.h>
#include <modbus.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <unistd.h>

typedef struct tcp_link {
    tl_modbus_link link;
    char *host;
    char service[8];
} tcp_link;

static void publish(tl_modbus_link *link, int descriptor) {
    (void)pthread_mutex_lock(&link->lock);
    int old = link->descriptor;
    link->descriptor = descriptor;
    (void)pthread_mutex_unlock(&link->lock);
    if (old >= 0) {
        (void)close(old);
    }
}

/* errno of the connection that was begun, 0 where it stands. */
static int await_connection(const tl_modbus_link *link, int descriptor, tl_time deadline) {
    int failure = tl_modbus_link_await(link, descriptor, POLLOUT, deadline);
    socklen_t size = sizeof failure;
    if (failure == 0 && getsockopt(descriptor, SOL_SOCKET, SO_ERROR, &failure, &size) != 0) {
        failure = errno;
    }
    return failure;
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
        failure = errno == EINPROGRESS || errno == EINTR ? await_connection(link, descriptor, deadline) : errno;
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

static bool tcp_connect(tl_modbus_link *link, char *cause, size_t cause_size) {
    const tcp_link *tcp = (const tcp_link *)link;
    struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = AI_NUMERICSERV};
    struct addrinfo *addresses = NULL;
    int resolved = getaddrinfo(tcp->host, tcp->service, &hints, &addresses);
    if (resolved != 0) {
        (void)snprintf(cause, cause_size, "the name cannot be resolved: %s", gai_strerror(resolved));
        return false;
    }
    tl_time left_addresses = 0;
    for (const struct addrinfo *address = addresses; address != NULL; address = address->ai_next) {
        left_addresses++;
    }
    /* Each address gets its share of what is left, so that a silent first one leaves time for the second. */
    tl_time deadline = tl_modbus_link_now() + link->timeout;
    int failure = EADDRNOTAVAIL;
    for (const struct addrinfo *address = addresses; address != NULL && failure != 0; address = address->ai_next) {
        tl_time now = tl_modbus_link_now();
        failure =
            tl_modbus_link_is_woken(link) ? EINTR : connect_to(link, address, now + (deadline - now) / left_addresses);
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
    if (tl_modbus_link_is_woken(link)) { /* between the wait and the publication, or by the one who has seen it */
        publish(link, -1);
        return false;
    }
    (void)modbus_set_socket(link->context, link->descriptor);
    return true;
}

/* Nothing comes while nothing was asked for: else the other side has closed, or talks out of turn. */
static bool tcp_is_sound(const tl_modbus_link *link) {
    struct pollfd one = {.fd = link->descriptor, .events = POLLIN};
    return poll(&one, 1, 0) == 0;
}

static int tcp_ask(tl_modbus_link *link, const tl_modbus_read *read, tl_modbus_values *values) {
    int count = -1;
    if (modbus_set_slave(link->context, read->unit_id) != 0) {
        return errno;
    }
    switch (read->table) {
    case TL_MODBUS_COIL:
        count = modbus_read_bits(link->context, read->address, read->count, values->bits);
        break;
    case TL_MODBUS_DISCRETE:
        count = modbus_read_input_bits(link->context, read->address, read->count, values->bits);
        break;
    case TL_MODBUS_HOLDING:
        count = modbus_read_registers(link->context, read->address, read->count, values->registers);
        break;
    case TL_MODBUS_INPUT:
        count = modbus_read_input_registers(link->context, read->address, read->count, values->registers);
        break;
    }
    if (count == read->count) {
        return 0;
    }
    return count < 0 ? errno : EMBBADDATA;
}

static void tcp_close(tl_modbus_link *link) {
    publish(link, -1);
}

static void tcp_failed(tl_modbus_link *link, int failure) {
    (void)failure;
    publish(link, -1);
}

static void tcp_cut(tl_modbus_link *link) {
    if (link->descriptor >= 0) {
        (void)shutdown(link->descriptor, SHUT_RDWR);
    }
}

static void tcp_release(tl_modbus_link *link) {
    tcp_link *tcp = (tcp_link *)link;
    publish(link, -1);
    tl_modbus_link_done(link);
    free(tcp->host);
    free(tcp);
}

static const tl_modbus_link_kind TCP = {.connect = tcp_connect,
                                        .is_sound = tcp_is_sound,
                                        .ask = tcp_ask,
                                        .failed = tcp_failed,
                                        .close = tcp_close,
                                        .cut = tcp_cut,
                                        .release = tcp_release};

tl_modbus_link *tl_modbus_tcp_make(const char *host, uint16_t port, tl_time timeout) {
    tcp_link *tcp = calloc(1, sizeof *tcp);
    if (tcp == NULL) {
        return NULL;
    }
    tcp->host = strdup(host);
    (void)snprintf(tcp->service, sizeof tcp->service, "%u", (unsigned)port);
    (void)snprintf(tcp->link.name, sizeof tcp->link.name, "Modbus server %.80s:%s", host, tcp->service);
    /* Neither address nor port is used: the socket is ours. */
    if (tcp->host == NULL || !tl_modbus_link_init(&tcp->link, &TCP, modbus_new_tcp("127.0.0.1", 502), timeout)) {
        free(tcp->host);
        free(tcp);
        return NULL;
    }
    (void)modbus_set_response_timeout(tcp->link.context, (uint32_t)(timeout / TL_SECOND),
                                      (uint32_t)(timeout % TL_SECOND / 1000));
    return &tcp->link;
}
