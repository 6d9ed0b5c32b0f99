/* The thread of the FMUs: all that is called of them, from loading to freeing, is called in it.
 *
 * Purpose: FMI lets an importer call from any thread, and vendors have not all heard of it: what an FMU keeps in a thread-local variable
 *          or an interpreter's thread state must be there in its next call. And they want the stack that they were tested with:
 *          TL_FMU_THREAD_STACK, what a main thread has.
 * Jobs:    the thread does what it is told, one job after the other. Who waits for one keeps an eye on it, unless another process does.
 * Signals: none is blocked in it, since programs that an FMU starts would inherit that; the main thread takes those that ask to end.
 *          SIGUSR1 wakes it from a sleep of ours.
 * Thread:  all functions are the main thread's, or that of who started it.
 */
#ifndef TL_FIRMWARE_FMU_FMU_THREAD_H
#define TL_FIRMWARE_FMU_FMU_THREAD_H

#include <stdbool.h>
#include <sys/types.h>

#include "master/base/status.h"

enum { TL_FMU_THREAD_STACK = 8 * 1024 * 1024 };

typedef struct tl_fmu_thread tl_fmu_thread;

typedef void tl_fmu_job(void *context);

/* Who looks for how long a call lasts, and ends the process if it must be. */
typedef enum tl_fmu_watch {
    TL_FMU_WATCHED_HERE,     /* who waits for a job (fmu_call_timeout.h) */
    TL_FMU_WATCHED_ELSEWHERE /* another process */
} tl_fmu_watch;

/* Errors: TL_TRY_AGAIN. */
tl_status tl_fmu_thread_start(tl_fmu_watch watch, tl_fmu_thread **thread, tl_error *error);

/* Ends it, once its job is done. NULL is allowed. */
void tl_fmu_thread_end(tl_fmu_thread *thread);

/* Hands it a job, and does not wait. The one before must be done. */
void tl_fmu_thread_begin(tl_fmu_thread *thread, tl_fmu_job *job, void *context);

/* The same, and waits until it is done; a signal that asks to end wakes it, so that it may see to that. */
void tl_fmu_thread_call(tl_fmu_thread *thread, tl_fmu_job *job, void *context);

/* Waits until the job is done, and wakes it from every sleep of its own: it was told to end. */
void tl_fmu_thread_hurry(tl_fmu_thread *thread);

/* All of it for a single job, watched elsewhere: start, call, end. What fails was said on the log. */
tl_status tl_fmu_thread_run(tl_fmu_job *job, void *context);

/* Only keeps an eye on a job that runs: for who does something else meanwhile. */
void tl_fmu_thread_watch(tl_fmu_thread *thread);

/* As the kernel counts threads, for scheduling. Once a job is done. */
pid_t tl_fmu_thread_number(const tl_fmu_thread *thread);

#endif
