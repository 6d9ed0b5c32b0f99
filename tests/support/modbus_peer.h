/* What is at the other end of a Modbus driver under test: a thread that answers as the test wants, and keeps every request.
 *
 * Purpose: tests of the driver differ in what the peer answers; how it runs, what it keeps and what a right answer holds
 *          is alike.
 * Use:     the peer is static, = TL_MODBUS_PEER; tl_modbus_peer_forget() in setUp(), tl_modbus_peer_stop() in tearDown().
 * Errors:  what does not go well fails the test.
 * Thread:  the test's, but for what its comment says.
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
    int wake;      /* can be read: the thread is to end */
    int listener;  /* −1: none */
    uint16_t port; /* of the listener */
    bool (*serve)(int client);
    pthread_mutex_t lock; /* of what follows, and of what the test tells the thread */
    size_t requests;
    size_t connections;
    size_t recorded;                       /* bytes */
    uint8_t record[TL_MODBUS_PEER_RECORD]; /* the requests, one behind the other */
} tl_modbus_peer;

#define TL_MODBUS_PEER                                                                                                 \
    { .listener = -1, .lock = PTHREAD_MUTEX_INITIALIZER }

/* Forgets what was asked. The thread does not run. */
void tl_modbus_peer_forget(tl_modbus_peer *peer);

/* Takes a free port of 127.0.0.1; nobody listens there yet. */
void tl_modbus_peer_bind(tl_modbus_peer *peer);

/* Listens, at a port of its own if it has none yet, and has one client at a time: the newest. `serve` is called in the
 * thread if the client has sent something, and reads it; false: the connection is over. */
void tl_modbus_peer_listen(tl_modbus_peer *peer, bool (*serve)(int client));

/* Runs the thread: until `wake` can be read. Its context is the peer. */
void tl_modbus_peer_run(tl_modbus_peer *peer, void *(*run)(void *));

/* Ends the thread if it runs, and closes the listener if there is one. */
void tl_modbus_peer_stop(tl_modbus_peer *peer);

/* Keeps a request, as long as there is room. The caller has the lock. */
void tl_modbus_peer_note(tl_modbus_peer *peer, const uint8_t *request, size_t size);

/* How many there were. Any thread. */
size_t tl_modbus_peer_requests(tl_modbus_peer *peer);
size_t tl_modbus_peer_connections(tl_modbus_peer *peer);

/* What stands behind the function's code in a right answer: the number of bytes, then the values. Each register holds its
 * own address, each bit if its address is odd. Returns the size; `data` has room for 256. Any thread. */
size_t tl_modbus_peer_values(unsigned function, unsigned address, unsigned count, uint8_t *data);

#endif
