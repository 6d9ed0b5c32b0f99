/* Limits: see process_limits.h. */
#include "firmware/process/process_limits.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>

#include "firmware/process/sanitizer.h"

/* Where there is no limit: more than any main thread needs. The stack does not count as data, and the main thread's grows by itself. */
#define LARGEST_STACK ((rlim_t)64 * 1024 * 1024)

bool tl_process_limits_hold_memory(void) {
    return TL_HAS_SANITIZER == 0;
}

/* Never more than there is: what somebody else has limited stays so. */
static bool limit(int resource, rlim_t most) {
    struct rlimit now;
    if (getrlimit((__rlimit_resource_t)resource, &now) != 0) {
        return false;
    }
    if (now.rlim_max == RLIM_INFINITY || now.rlim_max > most) {
        now.rlim_max = most;
    }
    now.rlim_cur = now.rlim_max;
    return setrlimit((__rlimit_resource_t)resource, &now) == 0;
}

static rlim_t stack_now(void) {
    struct rlimit now;
    return getrlimit(RLIMIT_STACK, &now) == 0 && now.rlim_cur != RLIM_INFINITY ? now.rlim_cur : LARGEST_STACK;
}

/* All numbers of open descriptors are below this; where nobody can tell (no /proc), the limit as it is. */
static rlim_t open_descriptors(void) {
    rlim_t most = 0;
    DIR *folder = opendir("/proc/self/fd");
    if (folder == NULL) {
        return RLIM_INFINITY - TL_PROCESS_LIMITS_DESCRIPTORS;
    }
    for (const struct dirent *entry = readdir(folder); entry != NULL; entry = readdir(folder)) {
        rlim_t number = strtoul(entry->d_name, NULL, 10);
        most = number >= most ? number + 1 : most;
    }
    (void)closedir(folder);
    return most;
}

tl_status tl_process_limits_set(uint64_t memory, uint64_t file, tl_error *error) {
    bool done =
        (memory == 0 || !tl_process_limits_hold_memory() || limit(RLIMIT_DATA, (rlim_t)memory)) &&
        (file == 0 || limit(RLIMIT_FSIZE, (rlim_t)file)) && limit(RLIMIT_CORE, 0) && limit(RLIMIT_STACK, stack_now()) &&
        limit(RLIMIT_MSGQUEUE, 0) && limit(RLIMIT_SIGPENDING, TL_PROCESS_LIMITS_SIGNALS) &&
        limit(RLIMIT_NOFILE, open_descriptors() + TL_PROCESS_LIMITS_DESCRIPTORS) && prctl(PR_SET_DUMPABLE, 0) == 0;
    return done ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "limits of the process could not be set: %s", strerror(errno));
}

void tl_process_limits_permit(int resource, rlim_t least) {
    struct rlimit now;
    if (getrlimit((__rlimit_resource_t)resource, &now) != 0 || now.rlim_cur >= least) {
        return;
    }
    const struct rlimit wanted = {.rlim_cur = least, .rlim_max = now.rlim_max < least ? least : now.rlim_max};
    if (setrlimit((__rlimit_resource_t)resource, &wanted) != 0) {
        now.rlim_cur = now.rlim_max;
        (void)setrlimit((__rlimit_resource_t)resource, &now);
    }
}
