/* Interrupt flag: SIGINT, SIGTERM and SIGHUP set a flag that long operations poll, so that they end
 * properly.
 *
 * Thread: install once, before threads are started. tl_interrupt_reclaim() from the main thread,
 *         which receives these signals first while it does not block them. All others from any
 *         thread.
 */
#ifndef TL_FIRMWARE_PROCESS_INTERRUPT_H
#define TL_FIRMWARE_PROCESS_INTERRUPT_H

#include <stdbool.h>

/* Installs the handlers: the first SIGINT, SIGTERM or SIGHUP sets the flag, and each interrupts
 * sleeping calls with EINTR. Ignores SIGPIPE, so that writing to a closed pipe is an ordinary
 * error. An ignored SIGHUP stays ignored. */
void tl_interrupt_install(void);

/* Returns whether SIGHUP is ignored, as with nohup: then the program outlives its terminal. */
bool tl_interrupt_ignores_hangup(void);

/* Returns the name of the last signal received ("SIGTERM", "SIGINT", "SIGHUP"), or NULL. */
const char *tl_interrupt_requested(void);

/* Returns its number; 0: none was received. */
int tl_interrupt_signal(void);

/* Returns how many were received. */
unsigned tl_interrupt_times(void);

/* Reinstalls our handlers if an FMU has replaced them or ignores the signals, so that the program
 * can be ended during a long FMU call. */
void tl_interrupt_reclaim(void);

#endif
