/* Wake-up call: any thread ends the wait of the thread that polls a driver.
 *
 * Purpose: implements a driver's interrupt(). The waiting thread also polls `descriptor`. A call
 *          makes the descriptor readable until tl_wake_clear() answers the call. If no thread waits
 *          at the call, the next wait returns at once. Several calls count as one.
 * Owner:   the driver owns the struct.
 * Method:  an eventfd. A test forbids write() and send() in the CAN driver and in board/io, and
 *          allows eventfd_write() (tests/check/can_symbols.txt).
 * Thread:  tl_wake_call() from any thread; all else from the thread that polls.
 */
#ifndef TL_BOARD_IO_WAKE_H
#define TL_BOARD_IO_WAKE_H

#include <stdbool.h>

typedef struct tl_wake {
    int descriptor;    /* to poll for POLLIN; −1: not made */
    unsigned calls;    /* private: number of calls */
    unsigned answered; /* private: number of answered calls */
} tl_wake;

/* Creates the descriptor. Returns false with errno if a resource is missing; then nothing needs to
 * be released. */
bool tl_wake_make(tl_wake *wake);

/* Ends the present or the next wait. Any thread. */
void tl_wake_call(tl_wake *wake);

/* Returns true if a call is not answered yet; does not answer it. Makes no system call. */
bool tl_wake_is_called(const tl_wake *wake);

/* Answers all calls. Returns true if there was one; makes a system call only in this case. */
bool tl_wake_clear(tl_wake *wake);

/* Closes the descriptor. Allowed twice, and after tl_wake_make() has failed. */
void tl_wake_release(tl_wake *wake);

#endif
