/* TCP connection of the Modbus driver.
 *
 * libmodbus is not used here. Its reading functions accept the answer of any unit and of most
 * protocols, and do not check the length. Its raw requests always have transaction 0, so that a
 * late answer looks like the next one. A request has 12 bytes, and only reading ones exist
 * (modbus_link.h). An answer is received up to the expected length, as far as it is right.
 *
 * Some gateways forward the frames of a serial line as they are. These have a check sum, but no
 * transaction.
 */
#include "board/modbus/modbus_link.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "board/io/link.h"
#include "board/io/monotonic.h"

typedef struct tcp_link {
    tl_modbus_link link;
    char *host;
    char service[8];
    bool any_unit_id;
    bool any_transaction_id;
    bool rtu_framing;
    uint16_t transaction; /* of the last request */
    bool has_surplus;     /* bytes followed a short answer */
    bool has_answered;    /* there was an answer on this connection */
} tcp_link;

/* Result of a started connect: errno, or 0 if it is connected. */
static int await_connection(const tl_modbus_link *link, int descriptor, tl_time deadline) {
    int failure = tl_modbus_link_await(link, descriptor, POLLOUT, deadline);
    socklen_t size = sizeof failure;
    if (failure == 0 && getsockopt(descriptor, SOL_SOCKET, SO_ERROR, &failure, &size) != 0) {
        failure = errno;
    }
    return failure;
}

/* True if the socket is connected to itself: TCP does that if no server listens on a port of the
 * ephemeral range. */
static bool is_self_connected(int descriptor) {
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

/* Tries one address. Returns 0 or errno. */
static int connect_to(tl_modbus_link *link, const struct addrinfo *address, tl_time deadline) {
    int one = 1;
    int descriptor =
        socket(address->ai_family, address->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, address->ai_protocol);
    if (descriptor < 0) {
        return errno;
    }
    int failure = 0;
    if (connect(descriptor, address->ai_addr, address->ai_addrlen) != 0) {
        failure = errno == EINPROGRESS || errno == EINTR ? await_connection(link, descriptor, deadline) : errno;
    }
    if (failure == 0 && is_self_connected(descriptor)) {
        failure = ECONNREFUSED;
    }
    if (failure != 0) {
        (void)close(descriptor);
        return failure;
    }
    (void)setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    link->descriptor = descriptor;
    return 0;
}

static bool tcp_connect(tl_modbus_link *link, char *cause, size_t cause_size) {
    const tcp_link *tcp = (const tcp_link *)link;
    struct addrinfo hints = {.ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = AI_NUMERICSERV};
    struct addrinfo *addresses = NULL;
    int resolved = getaddrinfo(tcp->host, tcp->service, &hints, &addresses);
    if (resolved != 0) {
        (void)snprintf(cause, cause_size, "the name cannot be resolved: %s: check host, or write its IP address",
                       gai_strerror(resolved));
        return false;
    }
    tl_time remaining_addresses = 0;
    for (const struct addrinfo *address = addresses; address != NULL; address = address->ai_next) {
        remaining_addresses++;
    }
    /* Each address gets its share of the remaining time, so that a silent first one leaves time for
     * the second. */
    tl_time deadline = tl_monotonic_now() + link->timeout;
    int failure = EADDRNOTAVAIL;
    for (const struct addrinfo *address = addresses; address != NULL && failure != 0; address = address->ai_next) {
        tl_time now = tl_monotonic_now();
        failure = tl_wake_is_called(&link->wake)
                      ? EINTR
                      : connect_to(link, address, now + (deadline - now) / remaining_addresses);
        remaining_addresses--;
        if (failure == EINTR) {
            break;
        }
    }
    freeaddrinfo(addresses);
    if (failure != 0) {
        (void)snprintf(cause, cause_size, "no connection: %s: check %s", strerror(failure),
                       failure == ECONNREFUSED ? "host and port, and that the device's Modbus server is on"
                                               : "host, port, cable and firewall");
        return false;
    }
    return true;
}

/* Nothing may come without a request: otherwise the server has closed or sends too much. */
static tl_modbus_health tcp_check(const tl_modbus_link *link) {
    uint8_t byte = 0;
    ssize_t count = recv(link->descriptor, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
    if (count > 0 || ((const tcp_link *)link)->has_surplus) {
        return TL_MODBUS_TALKATIVE;
    }
    return count < 0 && (errno == EAGAIN || errno == EINTR) ? TL_MODBUS_SOUND : TL_MODBUS_CLOSED;
}

static tl_modbus_outcome failed_with(int failure) {
    tl_modbus_outcome outcome = {.kind = TL_MODBUS_FAILED, .found = failure};
    return outcome;
}

/* Waits for at most `room` bytes. Returns 0 or errno. */
static int receive(const tl_modbus_link *link, uint8_t *bytes, size_t room, tl_time deadline, size_t *size) {
    int failure = tl_modbus_link_await(link, link->descriptor, POLLIN, deadline);
    if (failure != 0) {
        return failure;
    }
    ssize_t count = recv(link->descriptor, bytes, room, 0);
    if (count == 0) {
        return *size == 0 ? ECONNRESET : EPROTO;
    }
    if (count < 0) {
        return errno == EAGAIN || errno == EINTR ? 0 : errno;
    }
    *size += (size_t)count;
    return 0;
}

/* Bytes of an answer before and after its values, and of a request. An exception has no values. */
typedef struct framing {
    size_t head, sum, request;
} framing;

static const framing TCP_FRAMES = {.head = TL_MODBUS_TCP_FIRST, .request = TL_MODBUS_TCP_REQUEST};
static const framing RTU_FRAMES = {
    .head = TL_MODBUS_RTU_FIRST, .sum = TL_MODBUS_SUM, .request = TL_MODBUS_BODY_REQUEST + TL_MODBUS_SUM};

static tl_modbus_outcome check_answer(const tcp_link *tcp, const tl_modbus_question *asked, const uint8_t *answer,
                                      size_t size, size_t *missing) {
    return tcp->rtu_framing ? tl_modbus_check_framed(asked, answer, size, missing)
                            : tl_modbus_check_tcp(asked, answer, size, missing);
}

static tl_modbus_outcome exchange(tcp_link *tcp, const tl_modbus_read *read, tl_modbus_values *values) {
    tl_modbus_link *link = &tcp->link;
    const framing *frame = tcp->rtu_framing ? &RTU_FRAMES : &TCP_FRAMES;
    uint8_t request[TL_MODBUS_TCP_REQUEST];
    uint8_t answer[TL_MODBUS_TCP_ANSWER];
    tcp->transaction++;
    const tl_modbus_question asked = {.read = read,
                                      .transaction = tcp->transaction,
                                      .any_unit_id = tcp->any_unit_id,
                                      .any_transaction_id = tcp->any_transaction_id};
    if (tcp->rtu_framing) {
        tl_modbus_put_framed(&asked, request);
    } else {
        tl_modbus_put_request(&asked, request);
    }
    errno = EIO;
    if (send(link->descriptor, request, frame->request, MSG_NOSIGNAL) != (ssize_t)frame->request) {
        return failed_with(errno);
    }
    tl_time deadline = tl_monotonic_now() + link->timeout;
    const size_t most = frame->head + tl_modbus_value_bytes(read) + frame->sum;
    size_t size = 0;
    size_t missing = 0;
    tl_modbus_outcome outcome = check_answer(tcp, &asked, answer, size, &missing);
    while (missing > 0) {
        int failure = receive(link, answer + size, most - size, deadline, &size);
        if (failure != 0) {
            return failed_with(failure);
        }
        outcome = check_answer(tcp, &asked, answer, size, &missing);
    }
    if (outcome.kind == TL_MODBUS_VALUES) {
        tl_modbus_take_values(read, answer + frame->head, values);
    }
    tcp->has_surplus = outcome.kind == TL_MODBUS_EXCEPTION && size > frame->head + frame->sum;
    tcp->has_answered = true;
    return outcome;
}

static void tcp_close(tl_modbus_link *link) {
    tcp_link *tcp = (tcp_link *)link;
    if (link->descriptor >= 0) {
        (void)close(link->descriptor);
        link->descriptor = -1;
    }
    tcp->has_surplus = false;
    tcp->has_answered = false;
}

/* A device may close a connection after each answer. Such a request is sent again on a new one. */
static tl_modbus_outcome tcp_ask(tl_modbus_link *link, const tl_modbus_read *read, tl_modbus_values *values) {
    tcp_link *tcp = (tcp_link *)link;
    char cause[TL_LINK_TEXT];
    tl_modbus_outcome outcome = exchange(tcp, read, values);
    const bool is_closed = outcome.kind == TL_MODBUS_FAILED && (outcome.found == ECONNRESET || outcome.found == EPIPE);
    if (is_closed && tcp->has_answered) {
        tcp_close(link);
        if (!tcp_connect(link, cause, sizeof cause)) {
            return outcome;
        }
        tl_modbus_link_begin_pause(link);
        return tl_modbus_link_await_pause(link) ? exchange(tcp, read, values) : outcome;
    }
    return outcome;
}

static void tcp_failed(tl_modbus_link *link, const tl_modbus_outcome *outcome) {
    (void)outcome;
    tcp_close(link);
}

static void tcp_release(tl_modbus_link *link) {
    tcp_link *tcp = (tcp_link *)link;
    tcp_close(link);
    tl_modbus_link_done(link);
    free(tcp->host);
    free(tcp);
}

static const tl_modbus_link_kind TCP = {.connect = tcp_connect,
                                        .check = tcp_check,
                                        .ask = tcp_ask,
                                        .failed = tcp_failed,
                                        .close = tcp_close,
                                        .release = tcp_release};

tl_modbus_link *tl_modbus_tcp_make(const tl_modbus_server *server, tl_time timeout) {
    tcp_link *tcp = calloc(1, sizeof *tcp);
    if (tcp == NULL) {
        return NULL;
    }
    char name[TL_MODBUS_LINK_NAME];
    const tl_modbus_link_settings settings = {.kind = &TCP, .timeout = timeout, .name = name};
    tcp->host = strdup(server->host);
    tcp->any_unit_id = server->any_unit_id;
    tcp->any_transaction_id = server->any_transaction_id;
    tcp->rtu_framing = server->rtu_framing;
    (void)snprintf(tcp->service, sizeof tcp->service, "%u", (unsigned)server->port);
    (void)snprintf(name, sizeof name, "Modbus server %.80s:%s", server->host, tcp->service);
    if (tcp->host == NULL || !tl_modbus_link_init(&tcp->link, &settings)) {
        free(tcp->host);
        free(tcp);
        return NULL;
    }
    return &tcp->link;
}
