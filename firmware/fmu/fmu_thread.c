/* The FMU thread, see fmu_thread.h. */
#include "firmware/fmu/fmu_thread.h"

#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/process/crash.h"
#include "firmware/process/fmu_call.h"
#include "firmware/process/fmu_call_timeout.h"
#include "firmware/process/host_state.h"
#include "firmware/process/interrupt.h"

/* Interval of checks while waiting (20 ms), and a guard area that a large stack frame cannot skip.
 */
static const tl_time WATCH_PERIOD = TL_SECOND / 50;
enum { GUARD_BYTES = 1024 * 1024 };

struct tl_fmu_thread {
    pthread_t handle;
    pid_t number;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    tl_fmu_job *job; /* running or about to start; NULL: none */
    void *context;
    bool end;
    tl_fmu_watch watch;
    tl_fmu_call_timeout timeout; /* of the waiting thread, if it checks the duration */
};

/* ---- in the thread ---- */

/* Interrupts a sleep and has no other effect. */
static void wake_up(int signal) {
    (void)signal;
}

/* Returns NULL if the thread is to end. */
static tl_fmu_job *next_job(tl_fmu_thread *thread) {
    (void)pthread_mutex_lock(&thread->lock);
    while (thread->job == NULL && !thread->end) {
        (void)pthread_cond_wait(&thread->changed, &thread->lock);
    }
    tl_fmu_job *job = thread->job;
    (void)pthread_mutex_unlock(&thread->lock);
    return job;
}

static void set_job(tl_fmu_thread *thread, tl_fmu_job *job, void *context) {
    (void)pthread_mutex_lock(&thread->lock);
    thread->job = job;
    thread->context = context;
    (void)pthread_cond_broadcast(&thread->changed);
    (void)pthread_mutex_unlock(&thread->lock);
}

static void *run_jobs(void *context) {
    tl_fmu_thread *thread = context;
    thread->number = (pid_t)syscall(SYS_gettid);
    (void)pthread_setname_np(pthread_self(), "fmus");
    tl_crash_enter(TL_CRASH_CALLS_FMUS);
    for (tl_fmu_job *job = next_job(thread); job != NULL; job = next_job(thread)) {
        tl_locale_use();
        tl_host_state_save();
        job(thread->context);
        set_job(thread, NULL, NULL);
    }
    return NULL;
}

/* ---- for the caller ---- */

static int make_thread(tl_fmu_thread *thread) {
    pthread_attr_t attributes;
    int result = pthread_attr_init(&attributes);
    if (result != 0) {
        return result;
    }
    (void)pthread_attr_setstacksize(&attributes, TL_FMU_THREAD_STACK + GUARD_BYTES);
    (void)pthread_attr_setguardsize(&attributes, GUARD_BYTES);
    result = pthread_create(&thread->handle, &attributes, run_jobs, thread);
    (void)pthread_attr_destroy(&attributes);
    return result;
}

static void destroy_thread(tl_fmu_thread *thread) {
    (void)pthread_cond_destroy(&thread->changed);
    (void)pthread_mutex_destroy(&thread->lock);
    free(thread);
}

tl_status tl_fmu_thread_start(tl_fmu_watch watch, tl_fmu_thread **thread, tl_error *error) {
    tl_fmu_thread *created = calloc(1, sizeof *created);
    *thread = NULL;
    if (created == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "FMU thread: not enough memory; free memory and try again");
    }
    pthread_condattr_t attributes;
    struct sigaction action = {.sa_handler = wake_up};
    (void)sigemptyset(&action.sa_mask);
    (void)tl_host_state_handle(SIGUSR1, &action, NULL);
    (void)pthread_mutex_init(&created->lock, NULL);
    (void)pthread_condattr_init(&attributes);
    (void)pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
    (void)pthread_cond_init(&created->changed, &attributes);
    (void)pthread_condattr_destroy(&attributes);
    created->watch = watch;
    int result = make_thread(created);
    if (result != 0) {
        destroy_thread(created);
        return tl_fail(error, TL_TRY_AGAIN,
                       "FMU thread: cannot be created with %d MiB of stack: %s; free memory, or raise ulimit -v",
                       TL_FMU_THREAD_STACK >> 20, strerror(result));
    }
    *thread = created;
    return TL_OK;
}

void tl_fmu_thread_begin(tl_fmu_thread *thread, tl_fmu_job *job, void *context) {
    set_job(thread, job, context);
}

/* Waits for LOOK at most. Returns true if the job is done. */
static bool is_done_soon(tl_fmu_thread *thread) {
    tl_time until = tl_clock_now(NULL) + WATCH_PERIOD;
    const struct timespec instant = {.tv_sec = (time_t)(until / TL_SECOND), .tv_nsec = (long)(until % TL_SECOND)};
    (void)pthread_mutex_lock(&thread->lock);
    int result = 0;
    while (thread->job != NULL && result == 0) {
        result = pthread_cond_timedwait(&thread->changed, &thread->lock, &instant);
    }
    bool done = thread->job == NULL;
    (void)pthread_mutex_unlock(&thread->lock);
    return done;
}

/* Sends no signal during a call of an FMU, because it would interrupt the FMU's system calls too.
 * The signal may arrive just before the thread sleeps, so the caller repeats it. */
static void interrupt_sleep(const tl_fmu_thread *thread) {
    tl_fmu_call call;
    if (!tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call)) {
        (void)pthread_kill(thread->handle, SIGUSR1);
    }
}

/* Waits until the job is done. If a signal requests termination, wakes the thread so that the job
 * notices it. */
static void wait_for_job(tl_fmu_thread *thread) {
    while (!is_done_soon(thread)) {
        tl_fmu_thread_watch(thread);
        if (tl_interrupt_requested() != NULL) {
            interrupt_sleep(thread);
        }
    }
}

void tl_fmu_thread_wake_and_wait(tl_fmu_thread *thread) {
    do {
        tl_fmu_thread_watch(thread);
        interrupt_sleep(thread);
    } while (!is_done_soon(thread));
}

void tl_fmu_thread_call(tl_fmu_thread *thread, tl_fmu_job *job, void *context) {
    tl_fmu_thread_begin(thread, job, context);
    wait_for_job(thread);
}

void tl_fmu_thread_end(tl_fmu_thread *thread) {
    if (thread == NULL) {
        return;
    }
    wait_for_job(thread);
    (void)pthread_mutex_lock(&thread->lock);
    thread->end = true;
    (void)pthread_cond_broadcast(&thread->changed);
    (void)pthread_mutex_unlock(&thread->lock);
    (void)pthread_join(thread->handle, NULL);
    destroy_thread(thread);
}

tl_status tl_fmu_thread_run(tl_fmu_job *job, void *context) {
    tl_error error;
    tl_fmu_thread *thread = NULL;
    tl_status status = tl_fmu_thread_start(TL_FMU_WATCHED_ELSEWHERE, &thread, &error);
    if (thread == NULL) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return status;
    }
    tl_fmu_thread_call(thread, job, context);
    tl_fmu_thread_end(thread);
    return TL_OK;
}

void tl_fmu_thread_watch(tl_fmu_thread *thread) {
    if (thread->watch == TL_FMU_WATCHED_HERE) {
        tl_fmu_call_timeout_poll(&thread->timeout);
    } else {
        tl_interrupt_reclaim(); /* an FMU in a long call may have installed its own signal handlers */
    }
}

pid_t tl_fmu_thread_number(const tl_fmu_thread *thread) {
    return thread->number;
}
