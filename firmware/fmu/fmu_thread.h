/* The FMU thread: the one thread that calls functions of the FMUs, from loading to freeing.
 *
 * Purpose: FMI allows calls from any thread, but some FMUs need all calls from one thread, because
 *          they have data in thread-local variables or in an interpreter's thread state. FMUs also
 *          expect the stack size with which they were tested: TL_FMU_THREAD_STACK, the usual size
 *          of a main thread.
 * Jobs:    the thread executes one job after the other. While a caller waits for a job, it checks
 *          how long the current FMU call lasts, unless another process does (tl_fmu_watch).
 * Signals: the thread blocks no signal, because programs that an FMU starts would inherit the mask.
 *          The main thread blocks none either, and the kernel prefers it. So it gets the signals
 *          that request termination (interrupt.h). SIGUSR1 wakes the FMU thread from a sleep; it is
 *          not sent during a call of an FMU.
 * Thread:  all functions are called by the main thread, or by the thread that started the FMU
 *          thread.
 */
#ifndef TL_FIRMWARE_FMU_FMU_THREAD_H
#define TL_FIRMWARE_FMU_FMU_THREAD_H

#include <stdbool.h>
#include <sys/types.h>

#include "master/base/status.h"

enum { TL_FMU_THREAD_STACK = 8 * 1024 * 1024 }; /* bytes */

typedef struct tl_fmu_thread tl_fmu_thread;

/* Runs in the FMU thread. */
typedef void tl_fmu_job(void *context);

/* Which process checks how long a call lasts, and terminates the FMU process if it lasts too long.
 */
typedef enum tl_fmu_watch {
    TL_FMU_WATCHED_HERE,     /* the caller that waits for a job (fmu_call_timeout.h) */
    TL_FMU_WATCHED_ELSEWHERE /* another process */
} tl_fmu_watch;

/* Starts the thread. Errors: TL_TRY_AGAIN if memory is out; then *thread is NULL. */
tl_status tl_fmu_thread_start(tl_fmu_watch watch, tl_fmu_thread **thread, tl_error *error);

/* Waits for the present job, ends the thread and frees it. NULL is allowed. */
void tl_fmu_thread_end(tl_fmu_thread *thread);

/* Starts a job and does not wait for it. The previous job must be done. `context` must be valid
 * until the job is done. */
void tl_fmu_thread_begin(tl_fmu_thread *thread, tl_fmu_job *job, void *context);

/* Starts a job and waits until it is done. If a signal requests termination, this function wakes
 * the thread, so that the job notices the request. */
void tl_fmu_thread_call(tl_fmu_thread *thread, tl_fmu_job *job, void *context);

/* Waits until the job is done. Meanwhile wakes the thread from each sleep (SIGUSR1), so that the
 * job notices a request to end. */
void tl_fmu_thread_wake_and_wait(tl_fmu_thread *thread);

/* Starts a thread, executes a single job and ends the thread; another process checks the duration.
 * Errors: TL_TRY_AGAIN if the thread could not be started; the error is logged. */
tl_status tl_fmu_thread_run(tl_fmu_job *job, void *context);

/* Checks the duration of the current FMU call once. Call it repeatedly if the caller does other
 * work while a job runs. With TL_FMU_WATCHED_ELSEWHERE it checks no duration, but only reinstalls
 * our signal handlers, because an FMU may have replaced them (interrupt.h). */
void tl_fmu_thread_watch(tl_fmu_thread *thread);

/* Returns the kernel's thread id (gettid), for scheduling. Valid after the first job is done. */
pid_t tl_fmu_thread_number(const tl_fmu_thread *thread);

#endif
