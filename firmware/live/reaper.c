/* The reaper: see reaper.h. */
#include "firmware/live/reaper.h"

#include <errno.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "firmware/base/log.h"
#include "firmware/base/side_thread.h"

/* It has one call to make; and locked memory is dear. */
enum { STACK_BYTES = 256 * 1024 };

static void *reap(void *context) {
    pid_t *dead = context;
    siginfo_t info;
    id_t number = (id_t)*dead;
    free(dead);
    (void)waitid(P_PID, number, &info, WEXITED);
    return NULL;
}

void tl_reaper_take(tl_reaper *reaper, pid_t dead) {
    pid_t *copy = malloc(sizeof *copy); /* the thread's: it may begin after whoever made it is gone */
    int result = ENOMEM;
    if (copy != NULL) {
        *copy = dead;
        result = tl_side_thread_start(&reaper->thread, STACK_BYTES, reap, copy);
    }
    reaper->works = result == 0;
    if (result != 0) {
        free(copy);
        tl_log(TL_LOG_WARNING, "the dead process %d stays in the list of processes until this one ends: %s", (int)dead,
               strerror(result));
    }
}

bool tl_reaper_rests(tl_reaper *reaper) {
    if (reaper->works && pthread_tryjoin_np(reaper->thread, NULL) == 0) {
        reaper->works = false;
    }
    return !reaper->works;
}

void tl_reaper_leave(tl_reaper *reaper) {
    if (!tl_reaper_rests(reaper)) {
        (void)pthread_detach(reaper->thread);
        reaper->works = false;
    }
}
