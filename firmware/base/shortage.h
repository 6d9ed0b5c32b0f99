/* Whether something failed only because something ran out: descriptors, memory, space on a disk.
 *
 * Purpose: such a failure says nothing about the file that was to be opened. Another time it may work: TL_TRY_AGAIN, not TL_BAD_DATA,
 *          so that who starts the program tries again.
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_BASE_SHORTAGE_H
#define TL_FIRMWARE_BASE_SHORTAGE_H

#include <stdbool.h>

/* `code` as errno has it. */
bool tl_shortage_is(int code);

/* The same for a sentence of the C library's in which such a code was put into words: what dlerror() says. */
bool tl_shortage_is_told(const char *sentence);

#endif
