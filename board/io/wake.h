/* Wake-up call: from any thread to the one that waits in a driver's poll.
 *
 * Purpose: implements a driver's interrupt(). The waiting thread also polls `descriptor`, which is
 *          readable from a call until it is answered. A call without a waiting thread ends the next
 *          wait at once. Several calls count as one.
 * Owner:   the owner places, makes and releases it. It is an eventfd to which only a number is
 *          written, so that a driver that cannot send can still be interrupted
 *          (tests/check/can_symbols.txt).
 * Thread:  tl_wake_call() from any thread; all else from one.
 */
#ifndef TL_BOARD_IO_WAKE_H
#define TL_BOARD_IO_WAKE_H

#include <stdbool.h>

typedef struct tl_wake {
    int descriptor; /* −1: none */
} tl_wake;

/* Returns false with errno if a resource is missing; then nothing needs to be released. */
bool tl_wake_make(tl_wake *wake);

/* Any thread. */
void tl_wake_call(const tl_wake *wake);

/* True if there is a call that was not answered; does not answer it. */
bool tl_wake_is_called(const tl_wake *wake);

/* The same, and answers the call. */
bool tl_wake_answer(const tl_wake *wake);

/* Also allowed after a failed make, and twice. */
void tl_wake_release(tl_wake *wake);

#endif
