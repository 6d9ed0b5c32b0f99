/* Emulated Modbus device: one thread, poll(2), a buffer per client.
 *
 * The thread never waits for a single client. The sockets are non-blocking; a request is answered
 * once it is complete. A client that does not accept its answer is disconnected.
 */
#include "firmware/cli/plant_server.h"

#include <errno.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "board/io/wake.h"
#include "firmware/base/os.h"
#include "firmware/process/crash.h"

enum {
    PREFIX = 6,               /* transaction, protocol, length */
    HEADER = 7,               /* and the unit id; the length field counts from there */
    FRAME = HEADER + 253,     /* the longest frame */
    READ_REQUEST = HEADER + 5 /* function, address, count */
};

enum { ILLEGAL_FUNCTION = 1, ILLEGAL_ADDRESS = 2, ILLEGAL_VALUE = 3, NO_SUCH_UNIT = 11 };
enum { MAX_BITS = 2000, MAX_REGISTERS = 125, ADDRESSES = 65536 };

/* One table of one unit. */
typedef struct region {
    uint8_t unit_id;
    tl_modbus_table table;
    size_t first, end; /* range of the channels' addresses */
    uint16_t *words;   /* registers, or bits as 0 and 1, by address */
} region;

typedef struct client {
    int socket;
    size_t used;
    uint8_t frame[FRAME];
} client;

struct tl_plant_server {
    int listener;
    tl_wake wake; /* wakes up the thread to stop it */
    uint16_t port;
    pthread_t thread;
    tl_modbus_channel *channels;
    size_t channel_count;
    region *regions;
    size_t region_count;
    client clients[TL_PLANT_SERVER_CLIENTS]; /* used only by the thread; the first client_count are connected */
    size_t client_count;
    pthread_mutex_t lock; /* protects the counts and the words */
    tl_plant_server_counts counts;
};

/* ---- the registers ---- */

enum { ANY_TABLE = 0 };

static region *find_region(const tl_plant_server *server, uint8_t unit_id, int table) {
    for (size_t i = 0; i < server->region_count; i++) {
        if (server->regions[i].unit_id == unit_id && (table == ANY_TABLE || (int)server->regions[i].table == table)) {
            return &server->regions[i];
        }
    }
    return NULL;
}

/* Returns false if memory is out. */
static bool add_channel(tl_plant_server *server, const tl_modbus_channel *channel) {
    size_t end = channel->address + tl_modbus_registers(channel->type);
    region *own = find_region(server, channel->unit_id, (int)channel->table);
    if (own == NULL) {
        own = &server->regions[server->region_count++];
        *own = (region){.unit_id = channel->unit_id, .table = channel->table, .first = channel->address};
        own->words = calloc(ADDRESSES, sizeof *own->words);
    }
    own->first = channel->address < own->first ? channel->address : own->first;
    own->end = end > own->end ? end : own->end;
    return own->words != NULL;
}

static tl_status make_regions(tl_plant_server *server, const tl_plant_server_settings *settings, tl_error *error) {
    size_t room = settings->channel_count > 0 ? settings->channel_count : 1;
    server->channels = calloc(room, sizeof *server->channels);
    server->regions = calloc(room, sizeof *server->regions);
    bool complete = server->channels != NULL && server->regions != NULL;
    for (size_t i = 0; complete && i < settings->channel_count; i++) {
        server->channels[server->channel_count++] = settings->channels[i];
        complete = add_channel(server, &settings->channels[i]);
    }
    return complete ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "emulated Modbus device: out of memory");
}

void tl_plant_server_set_all(tl_plant_server *server, const double *values, const bool *present) {
    (void)pthread_mutex_lock(&server->lock);
    for (size_t i = 0; i < server->channel_count; i++) {
        if (present == NULL || present[i]) {
            const tl_modbus_channel *channel = &server->channels[i];
            const region *own = find_region(server, channel->unit_id, (int)channel->table);
            tl_modbus_encode(channel, values[i], own->words + channel->address);
        }
    }
    (void)pthread_mutex_unlock(&server->lock);
}

/* ---- one request ---- */

static unsigned word_at(const uint8_t *bytes) {
    return (unsigned)bytes[0] << 8 | bytes[1];
}

static void put_word(uint8_t *bytes, unsigned word) {
    bytes[0] = (uint8_t)(word >> 8);
    bytes[1] = (uint8_t)(word & 0xFF);
}

static bool is_write(uint8_t function) {
    return function == 5 || function == 6 || function == 15 || function == 16 || function == 22 || function == 23;
}

/* Writes the data of a read reply, starting with its byte count. Returns its size in bytes. */
static size_t put_values(const region *own, size_t first, size_t count, uint8_t *data) {
    const uint16_t *words = own->words + first;
    size_t bytes = tl_modbus_is_bit_table(own->table) ? (count + 7) / 8 : 2 * count;
    memset(data, 0, bytes + 1);
    data[0] = (uint8_t)bytes;
    for (size_t i = 0; i < count; i++) {
        if (tl_modbus_is_bit_table(own->table)) {
            data[1 + i / 8] = (uint8_t)(data[1 + i / 8] | words[i] << i % 8);
        } else {
            put_word(data + 1 + 2 * i, words[i]);
        }
    }
    return bytes + 1;
}

/* Returns the exception code that rejects the request, or 0 if it is valid. */
static uint8_t find_exception(const tl_plant_server *server, const uint8_t *request, size_t size) {
    uint8_t unit_id = request[HEADER - 1];
    uint8_t function = request[HEADER];
    if (find_region(server, unit_id, ANY_TABLE) == NULL) {
        return NO_SUCH_UNIT;
    }
    if (function < TL_MODBUS_COIL || function > TL_MODBUS_INPUT) {
        return ILLEGAL_FUNCTION;
    }
    if (size != READ_REQUEST) {
        return ILLEGAL_VALUE;
    }
    size_t first = word_at(request + HEADER + 1);
    size_t count = word_at(request + HEADER + 3);
    if (count < 1 || count > (tl_modbus_is_bit_table((tl_modbus_table)function) ? MAX_BITS : MAX_REGISTERS)) {
        return ILLEGAL_VALUE;
    }
    const region *own = find_region(server, unit_id, function);
    if (own == NULL || first < own->first || first + count > own->end) {
        return ILLEGAL_ADDRESS;
    }
    return 0;
}

/* Answers a complete request; returns the size of the reply in bytes. */
static size_t answer(tl_plant_server *server, const uint8_t *request, size_t size, uint8_t *reply) {
    uint8_t function = request[HEADER];
    size_t end = HEADER + 1;
    (void)pthread_mutex_lock(&server->lock);
    uint8_t exception = find_exception(server, request, size);
    memcpy(reply, request, HEADER + 1);
    if (exception != 0) {
        reply[HEADER] = (uint8_t)(function | 0x80);
        reply[end] = exception;
        end++;
    } else {
        const region *own = find_region(server, request[HEADER - 1], function);
        end += put_values(own, word_at(request + HEADER + 1), word_at(request + HEADER + 3), reply + end);
    }
    server->counts.requests++;
    server->counts.refused_writes += is_write(function) ? 1 : 0;
    (void)pthread_mutex_unlock(&server->lock);
    put_word(reply + 4, (unsigned)(end - PREFIX));
    return end;
}

/* Returns the size of the first request in the frame, 0 if it is not complete. *is_valid is false
 * if the bytes cannot be a request. */
static size_t measure(const client *from, bool *is_valid) {
    *is_valid = true;
    if (from->used < PREFIX) {
        return 0;
    }
    size_t size = PREFIX + word_at(from->frame + 4);
    *is_valid = word_at(from->frame + 2) == 0 && size > HEADER && size <= FRAME;
    return *is_valid && from->used >= size ? size : 0;
}

/* Receives bytes and answers complete requests. Returns false to disconnect the client. */
static bool serve(tl_plant_server *server, client *from) {
    ssize_t count = recv(from->socket, from->frame + from->used, FRAME - from->used, 0);
    if (count <= 0) {
        return count < 0 && (errno == EAGAIN || errno == EINTR);
    }
    from->used += (size_t)count;
    bool is_valid = true;
    for (size_t size = measure(from, &is_valid); size > 0; size = measure(from, &is_valid)) {
        uint8_t reply[FRAME];
        size_t length = answer(server, from->frame, size, reply);
        if (send(from->socket, reply, length, MSG_NOSIGNAL) != (ssize_t)length) {
            return false;
        }
        from->used -= size;
        memmove(from->frame, from->frame + size, from->used);
    }
    return is_valid;
}

/* ---- the thread ---- */

static void accept_client(tl_plant_server *server) {
    int one = 1;
    int socket = accept4(server->listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (socket < 0) {
        (void)poll(NULL, 0, 10); /* no descriptors left, perhaps: avoids a busy loop */
        return;
    }
    if (server->client_count == TL_PLANT_SERVER_CLIENTS) {
        (void)close(socket);
        return;
    }
    (void)setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    server->clients[server->client_count].socket = socket;
    server->clients[server->client_count].used = 0;
    server->client_count++;
}

static void *run(void *context) {
    tl_plant_server *server = context;
    tl_locale_use();
    tl_crash_enter(TL_CRASH_OURS);
    for (;;) {
        struct pollfd ready[2 + TL_PLANT_SERVER_CLIENTS] = {{.fd = server->wake.descriptor, .events = POLLIN},
                                                            {.fd = server->listener, .events = POLLIN}};
        for (size_t i = 0; i < server->client_count; i++) {
            ready[2 + i].fd = server->clients[i].socket;
            ready[2 + i].events = POLLIN;
        }
        if (poll(ready, (nfds_t)(2 + server->client_count), -1) < 0) {
            continue; /* EINTR, or a temporary lack of memory */
        }
        if (ready[0].revents != 0) {
            return NULL;
        }
        /* From the last client to the first: a removed client is replaced by one that was already
         * served. */
        for (size_t i = server->client_count; i-- > 0;) {
            if (ready[2 + i].revents != 0 && !serve(server, &server->clients[i])) {
                (void)close(server->clients[i].socket);
                server->client_count--;
                server->clients[i] = server->clients[server->client_count];
            }
        }
        if (ready[1].revents != 0) {
            accept_client(server);
        }
    }
}

/* ---- start and stop ---- */

static tl_status open_listener(tl_plant_server *server, const tl_plant_server_settings *settings, tl_error *error) {
    struct addrinfo hints = {
        .ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE | AI_NUMERICSERV};
    struct addrinfo *addresses = NULL;
    char service[8];
    (void)snprintf(service, sizeof service, "%u", (unsigned)settings->port);
    int resolved = getaddrinfo(settings->host, service, &hints, &addresses);
    if (resolved != 0) {
        return tl_fail(error, TL_BAD_DATA, "emulated Modbus device: cannot listen at %s: %s", settings->host,
                       gai_strerror(resolved));
    }
    server->listener = tl_tcp_listen(addresses->ai_addr, addresses->ai_addrlen, TL_PLANT_SERVER_CLIENTS, &server->port);
    int failure = errno;
    freeaddrinfo(addresses);
    if (server->listener < 0) {
        return tl_fail(error, TL_TRY_AGAIN, "emulated Modbus device: cannot listen at %s port %u: %s%s", settings->host,
                       (unsigned)settings->port, strerror(failure),
                       failure == EACCES ? "; ports below 1024 need root: use a higher port in the configuration" : "");
    }
    return TL_OK;
}

static tl_status start_thread(tl_plant_server *server, tl_error *error) {
    int failure = tl_wake_make(&server->wake) ? 0 : errno;
    if (failure == 0) {
        failure = tl_side_thread_start(&server->thread, 0, run, server);
    }
    if (failure != 0) {
        return tl_fail(error, TL_TRY_AGAIN, "emulated Modbus device: cannot start its thread: %s", strerror(failure));
    }
    (void)pthread_setname_np(server->thread, "modbus device");
    return TL_OK;
}

static void release(tl_plant_server *server) {
    for (size_t i = 0; i < server->client_count; i++) {
        (void)close(server->clients[i].socket);
    }
    if (server->listener >= 0) {
        (void)close(server->listener);
    }
    tl_wake_release(&server->wake);
    for (size_t i = 0; i < server->region_count; i++) {
        free(server->regions[i].words);
    }
    (void)pthread_mutex_destroy(&server->lock);
    free(server->regions);
    free(server->channels);
    free(server);
}

tl_status tl_plant_server_start(const tl_plant_server_settings *settings, tl_plant_server **server, tl_error *error) {
    tl_plant_server *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "emulated Modbus device: out of memory");
    }
    made->listener = -1;
    made->wake.descriptor = -1;
    (void)pthread_mutex_init(&made->lock, NULL);
    tl_status status = make_regions(made, settings, error);
    if (status == TL_OK) {
        status = open_listener(made, settings, error);
    }
    if (status == TL_OK) {
        status = start_thread(made, error);
    }
    if (status != TL_OK) {
        release(made);
        return status;
    }
    *server = made;
    return TL_OK;
}

uint16_t tl_plant_server_port(const tl_plant_server *server) {
    return server->port;
}

tl_plant_server_counts tl_plant_server_count(tl_plant_server *server) {
    (void)pthread_mutex_lock(&server->lock);
    tl_plant_server_counts counts = server->counts;
    (void)pthread_mutex_unlock(&server->lock);
    return counts;
}

void tl_plant_server_stop(tl_plant_server *server) {
    tl_wake_call(&server->wake);
    (void)pthread_join(server->thread, NULL);
    release(server);
}
