/* Crash report: logs which FMU crashed, and in which of its functions.
 *
 * Purpose: on SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT the handler writes one line to standard
 *          error. Then the process ends by that signal as usual, with a core dump if those are
 *          enabled. So a supervisor sees the same exit status as without the handler.
 * Blame:   a crash during a call in the thread that calls FMUs is attributed to that FMU. A crash
 *          in a thread that is not ours is attributed to an FMU. Any other is a bug of twinlock, or
 *          an FMU has overwritten memory.
 * Stack:   the main thread and the FMU thread have an alternate signal stack, so that stack
 *          overflows are reported too.
 * Others:  a handler that was installed before ours (a sanitizer's) is called after the line is
 *          written. A handler that an FMU has installed is called first, once host_state.h has
 *          restored ours. If it returns or jumps away, the signal counts as handled, because
 *          virtual machines handle null pointers this way. If it forwards the signal to the
 *          previous handler, as Python's faulthandler does, ours reports it.
 * Late:    after tl_process_complete() the line is a warning, and the process exits as planned.
 * Caught:  see TL_CRASH_CATCH().
 * Thread:  install from one thread; each thread calls tl_crash_enter() for itself.
 */
#ifndef TL_FIRMWARE_PROCESS_CRASH_H
#define TL_FIRMWARE_PROCESS_CRASH_H

#include <setjmp.h>

typedef enum tl_crash_thread {
    TL_CRASH_FOREIGN, /* every thread that has not called tl_crash_enter() */
    TL_CRASH_OURS,
    TL_CRASH_CALLS_FMUS
} tl_crash_thread;

/* Installs the handlers. Call it at the start of the process and again after a fork: other forked
 * processes report nothing, so that a process that an FMU forks does not report for us. Marks the
 * calling thread as ours. Ignored signals stay ignored. */
void tl_crash_install(void);

/* Marks the calling thread as ours. At most one thread at a time may call FMUs. */
void tl_crash_enter(tl_crash_thread entered);

/* ---- Catches a crash in a call that another method can replace.
 *
 * TL_CRASH_CATCH() is false at first. If the calling thread, which calls FMUs, crashes before
 * tl_crash_catch_end(), it is true and execution continues there. So the function that uses it must
 * not return before tl_crash_catch_end(), and must not change its variables in between. The FMU's
 * memory is then as the crash left it, and its locks are not released. */
#define TL_CRASH_CATCH() (sigsetjmp(*tl_crash_catch_begin(), 0) != 0)

/* Private: use TL_CRASH_CATCH(). */
sigjmp_buf *tl_crash_catch_begin(void);

void tl_crash_catch_end(void);

/* Returns the name of the signal that was caught last: "Segmentation fault". */
const char *tl_crash_caught(void);

#endif
