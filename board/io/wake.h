/* A wake-up call: from any thread to the one that waits in a driver's poll.
 *
 * Purpose: what a driver's interrupt() does. Who waits by poll(2) waits for `descriptor` too, which is readable after a call
 *          until it is answered. A call is not lost if nobody waits: the next wait ends at once. Several calls are one.
 * Owner:   placed by its owner, who makes and releases it. It is an eventfd, and nothing but a number is ever written there:
 *          that is how a driver that cannot send can be interrupted all the same (tests/check/can_symbols.txt).
 * Thread:  call() from any thread; all else from one.
 */
#ifndef TL_BOARD_IO_WAKE_H
#define TL_BOARD_IO_WAKE_H

#include <stdbool.h>

typedef struct tl_wake {
    int descriptor; /* −1: there is none */
} tl_wake;

/* false if a resource is missing, and errno says which; nothing needs to be released then. */
bool tl_wake_make(tl_wake *wake);

/* Any thread. */
void tl_wake_call(const tl_wake *wake);

/* Is there a call that was not answered? This does not answer it. */
bool tl_wake_is_called(const tl_wake *wake);

/* The same, and answers it: the next one says no. */
bool tl_wake_answer(const tl_wake *wake);

/* Also of one that could not be made, and twice. */
void tl_wake_release(tl_wake *wake);

#endif
