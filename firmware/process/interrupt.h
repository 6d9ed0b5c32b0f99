/* SIGINT, SIGTERM and SIGHUP as a flag: whoever works long looks at it and ends in good order.
 *
 * Thread: install once, before threads are started; requested() and times() from any thread; reclaim() from the main thread, which
 *         takes the signals before all others as long as it does not block them.
 */
#ifndef TL_FIRMWARE_PROCESS_INTERRUPT_H
#define TL_FIRMWARE_PROCESS_INTERRUPT_H

#include <stdbool.h>

/* From now on the first SIGINT, SIGTERM or SIGHUP sets the flag (and lets sleeping calls return with EINTR); SIGPIPE is
 * ignored, so that writing into a closed pipe is an ordinary error. SIGHUP stays ignored where it is. */
void tl_interrupt_install(void);

/* Does who started us (nohup) want to outlive the terminal? */
bool tl_interrupt_ignores_hangup(void);

/* The signal that came ("SIGTERM", "SIGINT", "SIGHUP"), or NULL. */
const char *tl_interrupt_requested(void);

/* Its number; 0: none came. */
int tl_interrupt_signal(void);

/* How many of them came. */
unsigned tl_interrupt_times(void);

/* Puts our handlers back where others have taken their place since they were installed, or ignore the signals: an FMU whose call lasts
 * shall not keep the program from being ended. */
void tl_interrupt_reclaim(void);

#endif
