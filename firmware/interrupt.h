/* SIGINT and SIGTERM as a flag: whoever works long looks at it and ends in good order.
 *
 * Thread: install once, before threads are started; requested() from any thread.
 */
#ifndef TL_FIRMWARE_INTERRUPT_H
#define TL_FIRMWARE_INTERRUPT_H

#include <stdbool.h>

/* From now on the first SIGINT or SIGTERM sets the flag (and lets sleeping calls return with EINTR); SIGPIPE is
 * ignored, so that writing into a closed pipe is an ordinary error. */
void tl_interrupt_install(void);

/* The signal that came ("SIGTERM", "SIGINT"), or NULL. */
const char *tl_interrupt_requested(void);

#endif
