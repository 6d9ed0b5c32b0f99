/* A packet of a control socket: a message of an exact size, and memory that may come with it.
 *
 * Purpose: private to the room: what both ends do alike.
 * Trust:   whatever arrives may be of any size and may bring any descriptor. None of them stays open; of one that is handed over as text the bytes
 *          are copied if it is plain memory (memfd, tmpfs), where reading neither waits nor fails.
 * Thread:  one for each socket.
 */
#ifndef TL_FIRMWARE_RETUNE_CONTROL_PACKET_H
#define TL_FIRMWARE_RETUNE_CONTROL_PACKET_H

#include <stdbool.h>
#include <stddef.h>

/* Sends `size` bytes as one packet, with `length` bytes of text in memory unless `text` is NULL. False, and errno: it could not be. */
bool tl_control_packet_send(int socket, const void *bytes, size_t size, const char *text, size_t length);

typedef enum tl_control_arrival {
    TL_CONTROL_NONE,    /* nothing is there yet */
    TL_CONTROL_PACKET,  /* exactly `size` bytes */
    TL_CONTROL_GARBAGE, /* something else */
    TL_CONTROL_CLOSED
} tl_control_arrival;

/* Takes what is there. `text`, of TL_CONTROL_MOST + 1 bytes (NULL: none is wanted), gets what came as memory, with a NUL; *length is 0 if there was none. */
tl_control_arrival tl_control_packet_take(int socket, void *bytes, size_t size, char *text, size_t *length);

#endif
