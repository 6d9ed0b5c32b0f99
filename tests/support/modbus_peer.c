/* See modbus_peer.h. */
#include "tests/support/modbus_peer.h"

#include <netinet/in.h>
#include <poll.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <unity.h>

enum { BACKLOG = 4 };

void tl_modbus_peer_forget(tl_modbus_peer *peer) {
    peer->requests = 0;
    peer->connections = 0;
    peer->recorded = 0;
}

void tl_modbus_peer_bind(tl_modbus_peer *peer) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}};
    socklen_t size = sizeof address;
    peer->listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    TEST_ASSERT_TRUE(peer->listener >= 0);
    TEST_ASSERT_EQUAL_INT(0, bind(peer->listener, (struct sockaddr *)&address, sizeof address));
    TEST_ASSERT_EQUAL_INT(0, getsockname(peer->listener, (struct sockaddr *)&address, &size));
    peer->port = ntohs(address.sin_port);
}

/* Replaces the client by the newest one. */
static int accept_next(tl_modbus_peer *peer, int client) {
    if (client >= 0) {
        (void)close(client);
    }
    int next = accept(peer->listener, NULL, NULL);
    (void)pthread_mutex_lock(&peer->lock);
    peer->connections++;
    (void)pthread_mutex_unlock(&peer->lock);
    return next;
}

static void *run_server(void *context) {
    tl_modbus_peer *peer = context;
    int client = -1;
    for (;;) {
        struct pollfd all[3] = {{.fd = peer->wake, .events = POLLIN},
                                {.fd = peer->listener, .events = POLLIN},
                                {.fd = client, .events = POLLIN}};
        (void)poll(all, 3, -1);
        bool stopped = all[0].revents != 0;
        if (client >= 0 && (stopped || (all[2].revents != 0 && !peer->serve(client)))) {
            (void)close(client);
            client = -1;
        }
        if (stopped) {
            return NULL;
        }
        if (all[1].revents != 0) {
            client = accept_next(peer, client);
        }
    }
}

void tl_modbus_peer_listen(tl_modbus_peer *peer, bool (*serve)(int client)) {
    if (peer->listener < 0) {
        tl_modbus_peer_bind(peer);
    }
    peer->serve = serve;
    TEST_ASSERT_EQUAL_INT(0, listen(peer->listener, BACKLOG));
    tl_modbus_peer_run(peer, run_server);
}

void tl_modbus_peer_run(tl_modbus_peer *peer, void *(*run)(void *)) {
    peer->wake = eventfd(0, EFD_CLOEXEC);
    TEST_ASSERT_TRUE(peer->wake >= 0);
    TEST_ASSERT_EQUAL_INT(0, pthread_create(&peer->thread, NULL, run, peer));
    peer->runs = true;
}

void tl_modbus_peer_stop(tl_modbus_peer *peer) {
    if (peer->runs) {
        /* no assertion: it would end tearDown() here after a failure */
        (void)eventfd_write(peer->wake, 1);
        (void)pthread_join(peer->thread, NULL);
        (void)close(peer->wake);
        peer->runs = false;
    }
    if (peer->listener >= 0) {
        (void)close(peer->listener);
        peer->listener = -1;
    }
}

void tl_modbus_peer_note(tl_modbus_peer *peer, const uint8_t *request, size_t size) {
    if (peer->recorded + size <= TL_MODBUS_PEER_RECORD) {
        memcpy(peer->record + peer->recorded, request, size);
        peer->recorded += size;
    }
    peer->requests++;
}

static size_t read_locked(tl_modbus_peer *peer, const size_t *count) {
    (void)pthread_mutex_lock(&peer->lock);
    size_t value = *count;
    (void)pthread_mutex_unlock(&peer->lock);
    return value;
}

size_t tl_modbus_peer_requests(tl_modbus_peer *peer) {
    return read_locked(peer, &peer->requests);
}

size_t tl_modbus_peer_connections(tl_modbus_peer *peer) {
    return read_locked(peer, &peer->connections);
}

size_t tl_modbus_peer_values(unsigned function, unsigned address, unsigned count, uint8_t *data) {
    bool is_of_bits = function <= 2;
    memset(data, 0, 256);
    data[0] = (uint8_t)(is_of_bits ? (count + 7) / 8 : 2 * count);
    for (unsigned i = 0; i < count; i++) {
        unsigned at = address + i;
        if (is_of_bits) {
            data[1 + i / 8] = (uint8_t)(data[1 + i / 8] | at % 2 << i % 8);
        } else {
            data[1 + 2 * i] = (uint8_t)(at / 256);
            data[2 + 2 * i] = (uint8_t)(at % 256);
        }
    }
    return 1U + data[0];
}

uint16_t tl_modbus_peer_sum(const uint8_t *bytes, size_t size) {
    unsigned sum = 0xFFFF;
    for (size_t i = 0; i < 8 * size; i++) {
        sum ^= i % 8 == 0 ? bytes[i / 8] : 0U;
        sum = (sum & 1) != 0 ? sum >> 1 ^ 0xA001U : sum >> 1;
    }
    return (uint16_t)sum;
}
