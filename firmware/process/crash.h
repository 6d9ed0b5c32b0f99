/* Crash report: logs which FMU crashed, and in which of its functions.
 *
 * Purpose: on SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT the handler writes one line to standard
 *          error. Then the process ends by that signal as usual, with a core dump if those are
 *          enabled. So a supervisor sees the same exit status as without the handler.
 * Cause:   a crash during an FMU call, in the thread that calls FMUs, is attributed to that FMU. A
 *          crash in a thread that is not ours is attributed to an unknown FMU. Any other crash is a
 *          bug of twinlock, or an FMU has overwritten memory.
 * Stack:   the main thread and the FMU thread have an alternate signal stack, so that stack
 *          overflows are reported too.
 * Others:  a handler that was installed before ours (a sanitizer's) is called after the line is
 *          written. If an FMU installs a handler, host_state.h restores ours, which then calls the
 *          FMU's handler first. If the FMU's handler returns or jumps away (longjmp), the signal
 *          counts as handled, because virtual machines handle null pointers this way. If the FMU's
 *          handler raises the signal again, as Python's faulthandler does, our handler reports the
 *          crash.
 * Late:    after tl_process_complete() the line is a warning, and the process exits as planned.
 * Caught:  see TL_CRASH_CATCH().
 * Thread:  install from one thread; each thread calls tl_crash_enter() for itself.
 */
#ifndef TL_FIRMWARE_PROCESS_CRASH_H
#define TL_FIRMWARE_PROCESS_CRASH_H

#include <setjmp.h>

typedef enum tl_crash_thread {
    TL_CRASH_FOREIGN,   /* every thread that has not called tl_crash_enter() */
    TL_CRASH_OURS,      /* a thread of twinlock that does not call FMUs */
    TL_CRASH_CALLS_FMUS /* the FMU thread */
} tl_crash_thread;

/* Installs the handlers and marks the calling thread as ours. Call it at the start of the process,
 * and again in a child after fork(). A forked child that does not call this function reports no
 * crash; so a process that an FMU has forked reports none. Ignored signals stay ignored. */
void tl_crash_install(void);

/* Sets the kind of the calling thread. At most one thread at a time may call FMUs. */
void tl_crash_enter(tl_crash_thread entered);

/* ---- Catches a crash in an FMU call, if the caller can do without that call.
 *
 * TL_CRASH_CATCH() works like setjmp(): it is false at first. If the calling thread crashes before
 * tl_crash_catch_end(), execution continues at TL_CRASH_CATCH(), which is then true. So the
 * function that uses TL_CRASH_CATCH() must not return before tl_crash_catch_end(), and must not
 * change its local variables in between. After a crash the FMU's memory may be inconsistent, and
 * the FMU's locks are not released. Only for the thread that calls FMUs. */
#define TL_CRASH_CATCH() (sigsetjmp(*tl_crash_catch_begin(), 0) != 0)

/* Private: use TL_CRASH_CATCH(). */
sigjmp_buf *tl_crash_catch_begin(void);

/* From now on crashes of this thread are no longer caught. */
void tl_crash_catch_end(void);

/* Returns the name of the signal that this thread has caught last, for example "Segmentation
 * fault"; "": none. */
const char *tl_crash_caught(void);

#endif
