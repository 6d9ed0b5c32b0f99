/* The state of this process that an FMU can change behind our back, kept and put back.
 *
 * Purpose: an FMU shares the process with us and with other FMUs. One that sets another rounding mode changes bits in silence, one
 *          that takes SIGTERM cannot be ended, one that changes the folder makes relative file names wrong. What was so before the
 *          FMU was loaded is put back.
 * Covers:  the floating-point control bits, the locale, the signal mask and the scheduling of the thread; the locale, the handlers of the signals
 *          that the program itself handles, the current folder and the umask of the process.
 * Left alone: handlers of all other signals, timers, limits, environment, open files.
 * Thread:  that of the FMUs, but for tl_host_state_handle(), which is for a time when no FMU is being called.
 */
#ifndef TL_FIRMWARE_PROCESS_HOST_STATE_H
#define TL_FIRMWARE_PROCESS_HOST_STATE_H

#include <signal.h>
#include <stddef.h>

/* What can be found changed: bits. */
typedef enum tl_host_change {
    TL_HOST_ROUNDING = 1,
    TL_HOST_LOCALE = 2,
    TL_HOST_SIGNAL_MASK = 4,
    TL_HOST_HANDLERS = 8,
    TL_HOST_FOLDER = 16,
    TL_HOST_UMASK = 32,
    TL_HOST_SCHEDULING = 64
} tl_host_change;

enum { TL_HOST_CHANGES = 7, TL_HOST_CHANGE_TEXT = 192 };

/* What is in force now is right: for the thread that calls, before FMUs are called in it. Folder and umask are those of the first time. */
void tl_host_state_keep(void);

/* Puts back what differs from what was kept; the bits of what did. Nothing was ever kept: does nothing. Costs some 14 system calls. */
unsigned tl_host_state_put_back(void);

/* Told, after a handler of ours was put back, which one of an FMU's had been in its place. */
typedef void tl_host_state_displaced(int signal, const struct sigaction *foreign);

/* sigaction(), for a handler of the program itself: it is kept from now on. `displaced` may be NULL. 0, or -1 with errno. */
int tl_host_state_handle(int signal, const struct sigaction *action, tl_host_state_displaced *displaced);

/* "the rounding mode and the locale" */
void tl_host_state_describe(unsigned changes, char text[TL_HOST_CHANGE_TEXT]);

#endif
