/* The peer of a Modbus driver under test: a thread that answers with a function of the test, and
 * records the requests.
 *
 * Use:    a static peer, = TL_MODBUS_PEER; tl_modbus_peer_forget() in setUp(),
 *         tl_modbus_peer_stop() in tearDown().
 * Errors: each failure fails the test.
 * Thread: the thread of the test, unless a comment says otherwise.
 */
#ifndef TL_TESTS_SUPPORT_MODBUS_PEER_H
#define TL_TESTS_SUPPORT_MODBUS_PEER_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { TL_MODBUS_PEER_RECORD = 65536 };

typedef struct tl_modbus_peer {
    pthread_t thread;
    bool runs;
    int wake;      /* eventfd; readable: the thread must end */
    int listener;  /* −1: none */
    uint16_t port; /* of the listener */
    bool (*serve)(int client);
    pthread_mutex_t lock; /* guards the fields below, and what the test and its peer share */
    size_t requests;
    size_t connections;
    size_t recorded;                       /* bytes */
    uint8_t record[TL_MODBUS_PEER_RECORD]; /* the requests, without gaps */
} tl_modbus_peer;

#define TL_MODBUS_PEER                                                                                                 \
    { .listener = -1, .lock = PTHREAD_MUTEX_INITIALIZER }

/* Clears the record. The thread must not run. */
void tl_modbus_peer_forget(tl_modbus_peer *peer);

/* Reserves a free port of 127.0.0.1 without listening. */
void tl_modbus_peer_bind(tl_modbus_peer *peer);

/* Listens at the reserved port, or at a free one, and serves one client at a time: the newest. The
 * thread calls `serve` if the client has sent data. `serve` reads the data; it returns false to
 * close the connection. */
void tl_modbus_peer_listen(tl_modbus_peer *peer, bool (*serve)(int client));

/* Starts a thread with the peer as its context. It must end when `wake` is readable. */
void tl_modbus_peer_run(tl_modbus_peer *peer, void *(*run)(void *));

/* Ends the thread, if it runs, and closes the listener, if there is one. */
void tl_modbus_peer_stop(tl_modbus_peer *peer);

/* Records a request, if there is room. The caller holds the lock. */
void tl_modbus_peer_note(tl_modbus_peer *peer, const uint8_t *request, size_t size);

/* Numbers of requests and of connections. Any thread. */
size_t tl_modbus_peer_requests(tl_modbus_peer *peer);
size_t tl_modbus_peer_connections(tl_modbus_peer *peer);

/* Writes the data of a right answer after the function code: the number of bytes, then the values.
 * A register holds its address; a bit is 1 if its address is odd. `data` has room for 256 bytes.
 * Returns the size. Any thread. */
size_t tl_modbus_peer_values(unsigned function, unsigned address, unsigned count, uint8_t *data);

/* Returns the check sum of a frame of a line, which is sent with the lower byte first. */
uint16_t tl_modbus_peer_sum(const uint8_t *bytes, size_t size);

#endif
