/* A thread of ordinary scheduling and without signals: see side_thread.h. */
#include "firmware/base/side_thread.h"

#include <sched.h>
#include <signal.h>

int tl_side_thread_start(pthread_t *thread, size_t stack, void *(*run)(void *context), void *context) {
    const struct sched_param ordinary = {.sched_priority = 0};
    pthread_attr_t attributes;
    sigset_t all;
    sigset_t before;
    int failure = pthread_attr_init(&attributes);
    if (failure != 0) {
        return failure;
    }
    if (stack > 0) {
        (void)pthread_attr_setstacksize(&attributes, stack);
    }
    (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    (void)pthread_attr_setschedpolicy(&attributes, SCHED_OTHER);
    (void)pthread_attr_setschedparam(&attributes, &ordinary);
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before); /* inherited by the thread */
    failure = pthread_create(thread, &attributes, run, context);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    (void)pthread_attr_destroy(&attributes);
    return failure;
}
