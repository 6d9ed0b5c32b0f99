/* Real-time scheduling: see realtime.h. */
#include "firmware/twin/realtime.h"

#include <errno.h>
#include <stddef.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>

/* The smallest there is. */
enum { PAGE = 4096 };

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

void tl_realtime_tell_refused(tl_journal *journal) {
    tl_journal_event(journal, -1, TL_EVENT_INFO, "cycle",
                     "no permission for SCHED_FIFO: ordinary scheduling is used and ticks may be missed; grant "
                     "CAP_SYS_NICE or raise LimitRTPRIO to permit it");
}

__attribute__((noinline)) void tl_realtime_touch_stack(void) {
    volatile char room[TL_REALTIME_STACK];
    for (size_t i = 0; i < sizeof room; i += PAGE) {
        room[i] = 0;
    }
}
