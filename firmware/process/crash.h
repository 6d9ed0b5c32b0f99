/* A crash is told: which FMU, and in which of its functions.
 *
 * Purpose: SIGSEGV, SIGBUS, SIGFPE, SIGILL and SIGABRT write one line to the log's place before they do what they always do: the
 *          process ends by that signal, with a core where cores are wanted. Who supervises sees what it would have seen.
 * Blame:   a crash in the thread that calls FMUs, during a call, is that FMU's; one in a thread that is not ours was begun by an FMU;
 *          any other is a bug of twinlock, or comes of memory that an FMU has destroyed before.
 * Stack:   the handler has a stack of its own in the main thread and in that of the FMUs, so that it can tell of an overflow too.
 * Others:  a handler that was there before (a sanitizer's) is called after the line is written. One that an FMU has installed is called
 *          first, once host_state.h has put ours back. If it returns or jumps away, the signal is handled: a virtual machine's null
 *          pointers are no crash. If it gives the signal to its predecessor, as Python's faulthandler does, that is us.
 * Thread:  install from one thread; enter from each thread for itself.
 */
#ifndef TL_FIRMWARE_PROCESS_CRASH_H
#define TL_FIRMWARE_PROCESS_CRASH_H

typedef enum tl_crash_thread {
    TL_CRASH_FOREIGN, /* what a thread is that has not entered */
    TL_CRASH_OURS,
    TL_CRASH_CALLS_FMUS
} tl_crash_thread;

/* Once at the start of the process, and again in one that was forked from it: a process that did not is silent, so that what an FMU
 * forks does not speak for us. The caller's thread is ours. Nothing is done about a signal that is ignored. */
void tl_crash_install(void);

/* The calling thread is ours from now on. At most one at a time calls FMUs. */
void tl_crash_enter(tl_crash_thread entered);

#endif
