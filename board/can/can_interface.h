/* CAN interface of Linux: for the driver, and for the emulated plant on the other side of the bus.
 *
 * Purpose: creates and binds a raw CAN socket, and reads the state of the interface.
 * Listens: nothing here sends; tests/check/symbols.py checks the symbols of the object.
 * Owner:   the caller closes the socket. Thread: any. Errors: errno.
 * Source:  Linux kernel documentation, networking/can.
 */
#ifndef TL_BOARD_CAN_CAN_INTERFACE_H
#define TL_BOARD_CAN_CAN_INTERFACE_H

#include <stdbool.h>

/* State of an interface. */
typedef struct tl_can_state {
    bool up;      /* set up by the administrator */
    bool running; /* on the bus: false after bus-off */
    bool fd;      /* takes frames of CAN FD */
} tl_can_state;

/* Creates a raw, non-blocking CAN socket; −1 with errno on failure. */
int tl_can_interface_open(void);

/* Index of an interface in the kernel; 0 with errno on failure: ENODEV if it does not exist. */
int tl_can_interface_index(int socket, const char *name);

/* Returns false with errno on failure: ENODEV if it is no CAN interface. */
bool tl_can_interface_bind(int socket, int index);

/* Reads the state. Returns false if the interface does not exist (any more). */
bool tl_can_interface_probe(int socket, const char *name, tl_can_state *state);

/* Describes why tl_can_interface_open() failed; for other reasons as strerror(). */
const char *tl_can_interface_failure(int reason);

#endif
