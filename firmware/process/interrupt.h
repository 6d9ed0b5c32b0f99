/* Interrupt flag: SIGINT, SIGTERM and SIGHUP set a flag. Long operations poll it and then end in an
 * orderly way.
 *
 * Thread:  call tl_interrupt_install() once, before threads are started, and tl_interrupt_reclaim()
 *          from the main thread; all others from any thread.
 */
#ifndef TL_FIRMWARE_PROCESS_INTERRUPT_H
#define TL_FIRMWARE_PROCESS_INTERRUPT_H

#include <stdbool.h>

/* Installs the handlers. Each SIGINT, SIGTERM or SIGHUP sets the flag, is counted, and interrupts a
 * blocking system call with EINTR. The kernel delivers it to the main thread, unless that thread
 * blocks it. Ignores SIGPIPE, so that writing to a closed pipe only returns an error. An ignored
 * SIGHUP stays ignored. */
void tl_interrupt_install(void);

/* Returns true if this process ignores SIGHUP, as with nohup. Then it continues without its
 * terminal. */
bool tl_interrupt_ignores_hangup(void);

/* Returns the name of the last signal received ("SIGTERM", "SIGINT", "SIGHUP"); NULL: none. */
const char *tl_interrupt_requested(void);

/* Returns the number of the last signal received; 0: none. */
int tl_interrupt_signal(void);

/* Returns how many SIGINT, SIGTERM and SIGHUP were received. */
unsigned tl_interrupt_times(void);

/* Reinstalls our handlers of SIGINT, SIGTERM and SIGHUP if an FMU has replaced them or ignores the
 * signals. So the program can be ended during a long FMU call. */
void tl_interrupt_reclaim(void);

#endif
