/* Network interface of a CAN bus on Linux. The driver and the emulated plant use it.
 *
 * Purpose: creates and binds a raw CAN socket, and reads the state of the interface.
 * Listens: no function sends; tests/check/symbols.py checks this in the object file.
 * Owner:   the caller closes the socket. Thread: any. Errors: in errno.
 * Source:  Linux kernel documentation, networking/can.
 */
#ifndef TL_BOARD_CAN_CAN_INTERFACE_H
#define TL_BOARD_CAN_CAN_INTERFACE_H

#include <stdbool.h>

/* State of an interface. */
typedef struct tl_can_state {
    bool up;      /* enabled by the administrator (IFF_UP) */
    bool running; /* on the bus (IFF_RUNNING): false after bus-off, or without a carrier */
    bool fd;      /* can transport CAN FD frames */
} tl_can_state;

/* Creates a raw, non-blocking CAN socket. Returns −1 with errno on failure. */
int tl_can_interface_open(void);

/* Returns the kernel's index of an interface; 0 with errno on failure: ENODEV if it does not exist.
 */
int tl_can_interface_index(int socket, const char *name);

/* Binds the socket, so that it receives the frames of the interface `index`. Returns false with
 * errno on failure: ENODEV if this is no CAN interface. */
bool tl_can_interface_bind(int socket, int index);

/* Reads the state. Returns false with errno if the interface does not exist (any more). */
bool tl_can_interface_probe(int socket, const char *name, tl_can_state *state);

/* Describes why tl_can_interface_open() failed. `reason`: the errno that it has set. The text is
 * static or that of strerror(): copy it before the next call. */
const char *tl_can_interface_failure(int reason);

#endif
