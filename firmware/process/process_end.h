/* Process end: the processes of this program end through this module.
 *
 * Purpose: once the work is done, no FMU code can change the exit code. Output is flushed for at
 *          most 1 s, and the process exits. It runs no destructor of an FMU and no exit handler,
 *          and does not join threads that an FMU has started.
 * Scripts: interpreters are an exception (tl_process_run_exit_handlers()). Their exit handlers run,
 *          because these write what scripts have printed. If a handler crashes, or if all take
 *          longer than TL_PROCESS_END_S, the process exits with the planned exit code.
 * exit():  if an FMU calls exit(), the process exits with 70, and the log names the FMU and the
 *          function that called it. Exception: see tl_process_complete(). A call of _exit() cannot
 *          be detected from inside the process.
 * Thread:  tl_process_begin() and tl_process_end() from the main thread; all others from any.
 */
#ifndef TL_FIRMWARE_PROCESS_PROCESS_END_H
#define TL_FIRMWARE_PROCESS_PROCESS_END_H

#include <stdbool.h>

/* Time limit of exit handlers and of tl_process_give_up(), s. */
enum { TL_PROCESS_END_S = 2 };

/* Call it at the start of the process, before a library is loaded, and again in a forked child. */
void tl_process_begin(void);

/* Ends the process with this exit code. AddressSanitizer checks for leaks first, unless an
 * interpreter was opened. */
void tl_process_end(int code) __attribute__((noreturn));

/* Marks all results as complete: from now on the process only frees its FMUs. If an FMU then
 * crashes or calls exit(), a warning is logged and the process ends with this exit code. */
void tl_process_complete(int code);

/* For the crash handler: returns true after tl_process_complete(). */
bool tl_process_is_complete(void);

/* Ends the process with exit code 70 within TL_PROCESS_END_S, because an FMU has not returned or
 * has called exit(). Logs `why` and saves unfinished work (tl_process_set_saver()). The parent
 * removes the folders of the FMUs. */
void tl_process_give_up(const char *why) __attribute__((noreturn));

/* Sets the function that saves unfinished work before tl_process_give_up() ends the process; `why`:
 * its argument. The function must not wait for the FMU thread. NULL: none. */
typedef void tl_process_saver(void *context, const char *why);
void tl_process_set_saver(tl_process_saver *keeper, void *context);

/* From now on tl_process_end() runs exit handlers, because an interpreter was opened. */
void tl_process_run_exit_handlers(void);

/* For the crash handler: exit at once with the planned exit code, and else return. The first
 * function exits only if the process is already ending, the second one only after
 * tl_process_complete(). */
void tl_process_end_if_ending(void);
void tl_process_end_if_complete(void);

#endif
