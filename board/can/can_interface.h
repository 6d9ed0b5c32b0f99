/* A CAN interface as Linux knows it: for the driver, and for the emulated plant on the other side of the bus.
 *
 * Purpose: a raw CAN socket, how it is bound to an interface, and what the interface is like now.
 * Listens: nothing here sends; a check holds the object to the symbols that it needs (tests/check/symbols.py).
 * Owner:   the caller closes the socket. Thread: any. Errors: errno.
 * Source:  Linux kernel documentation, networking/can.
 */
#ifndef TL_BOARD_CAN_CAN_INTERFACE_H
#define TL_BOARD_CAN_CAN_INTERFACE_H

#include <stdbool.h>

/* What is known of an interface. */
typedef struct tl_can_state {
    bool up;      /* set up by the administrator */
    bool running; /* on the bus: false after bus-off */
    bool fd;      /* takes frames of CAN FD */
} tl_can_state;

/* A raw CAN socket that does not block; −1, and errno. */
int tl_can_interface_open(void);

/* The number by which the kernel knows an interface; 0, and errno: ENODEV if there is none of that name. */
int tl_can_interface_index(int socket, const char *name);

/* false, and errno: ENODEV if that is no CAN interface. */
bool tl_can_interface_bind(int socket, int index);

/* false if there is no such interface (any more). */
bool tl_can_interface_probe(int socket, const char *name, tl_can_state *state);

/* Why tl_can_interface_open() failed, in words; for other reasons strerror(). */
const char *tl_can_interface_failure(int reason);

#endif
