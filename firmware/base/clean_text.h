/* Clean text: what a stranger has written, so that it can be shown and kept.
 *
 * Purpose: the one way for all that comes from a process with FMUs, be it printed, logged, an error or a name. What is left is valid UTF-8 that cannot
 *          command a terminal, forge a line's end or turn its direction: printable characters and tabs as they are; control characters and what is
 *          no UTF-8 as \xHH; C1, separators of lines, what turns or hides as \u{HEX} (master/base/utf8.h).
 * Thread:  pure; safe in a signal handler.
 */
#ifndef TL_FIRMWARE_BASE_CLEAN_TEXT_H
#define TL_FIRMWARE_BASE_CLEAN_TEXT_H

#include <stddef.h>

/* As much of `size` bytes as fits into `room` > 0 with a NUL behind it; nothing is cut in its middle. The bytes must be our own by now: nobody may
 * change them meanwhile. Returns the length. */
size_t tl_clean_text(const char *bytes, size_t size, char *clean, size_t room);

#endif
