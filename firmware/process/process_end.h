/* The end of the process: one way out for all of them.
 *
 * Purpose: once the work is done nothing of a vendor's can change what it ends with. What is buffered is written, and the process is gone:
 *          no destructor of an FMU runs, no exit handler, and a thread that an FMU has left behind is not waited for. An
 *          interpreter is the exception (tl_process_run_exit_handlers()): its exit handlers run, since they write what scripts have
 *          printed; if they crash, or last longer than TL_PROCESS_END_S, that is the end as well.
 * Noticed: an FMU that calls exit() by itself: the process then ends with 70, and the log names the FMU and its function. _exit()
 *          cannot be noticed from within.
 * Thread:  begin and end from the main thread; all others from any.
 */
#ifndef TL_FIRMWARE_PROCESS_PROCESS_END_H
#define TL_FIRMWARE_PROCESS_PROCESS_END_H

enum { TL_PROCESS_END_S = 2 };

/* At the start of the process, before anything is loaded, and again in one that was forked from it. */
void tl_process_begin(void);

/* Ends the process with this exit code. Sanitizers look for leaks first, unless an interpreter is open. */
void tl_process_end(int code) __attribute__((noreturn));

/* Ends the process, with exit code 70, while an FMU has not returned, or at its will. Says `why` on the log, and keeps what can be
 * kept; its parent removes the folders of its FMUs. */
void tl_process_give_up(const char *why) __attribute__((noreturn));

/* Who keeps what can be kept of unfinished work, told why. It must not wait for the thread of the FMUs. NULL: nobody. */
typedef void tl_process_keeper(void *context, const char *why);
void tl_process_keep(tl_process_keeper *keeper, void *context);

/* From now on tl_process_end() runs exit handlers: an interpreter has been opened. */
void tl_process_run_exit_handlers(void);

/* For the handler of a crash: where the process is ending, it ends now, with the code that it was to end with. */
void tl_process_end_if_ending(void);

#endif
