/* Real-time scheduling: see realtime.h. */
#include "firmware/realtime.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>

/* Room for an FMU's own stack; small enough to be locked. */
enum { STACK_BYTES = 1024 * 1024 };

void tl_realtime_lock_memory(tl_journal *journal) {
    struct rlimit limit;
    bool unlimited = getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY;
    /* With a limit, locking future mappings too would make a later allocation fail. */
    if (mlockall(unlimited ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT) != 0) {
        tl_journal_event(journal, -1, TL_EVENT_INFO, "cycle",
                         "memory is not locked (%s): a page fault may delay a cycle; raise LimitMEMLOCK to permit it",
                         strerror(errno));
    }
}

static int start(pthread_t *thread, int priority, void *(*run)(void *), void *context) {
    pthread_attr_t attributes;
    int result = pthread_attr_init(&attributes);
    if (result != 0) {
        return result;
    }
    (void)pthread_attr_setstacksize(&attributes, STACK_BYTES);
    if (priority > 0) {
        const struct sched_param parameter = {.sched_priority = priority};
        (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
        (void)pthread_attr_setschedpolicy(&attributes, SCHED_FIFO);
        (void)pthread_attr_setschedparam(&attributes, &parameter);
    }
    result = pthread_create(thread, &attributes, run, context);
    (void)pthread_attr_destroy(&attributes);
    return result;
}

int tl_realtime_start(pthread_t *thread, int priority, void *(*run)(void *), void *context, tl_journal *journal) {
    int result = start(thread, priority, run, context);
    if (result == EPERM && priority > 0) {
        tl_journal_event(journal, -1, TL_EVENT_INFO, "cycle",
                         "no permission for SCHED_FIFO: ordinary scheduling is used and ticks may be missed; grant "
                         "CAP_SYS_NICE or raise LimitRTPRIO to permit it");
        result = start(thread, 0, run, context);
    }
    return result;
}
