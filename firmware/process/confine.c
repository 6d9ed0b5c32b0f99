/* Confinement, in the necessary order: see confine.h. */
#include "firmware/process/confine.h"

#include <dirent.h>
#include <errno.h>
#include <grp.h>
#include <linux/capability.h>
#include <linux/securebits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "firmware/process/sanitizer.h"

/* ---- privileges ---- */

#define NO_ROOT                                                                                                        \
    (SECBIT_NOROOT | SECBIT_NOROOT_LOCKED | SECBIT_NO_SETUID_FIXUP_LOCKED | SECBIT_KEEP_CAPS_LOCKED |                  \
     SECBIT_NO_CAP_AMBIENT_RAISE | SECBIT_NO_CAP_AMBIENT_RAISE_LOCKED)

static bool read_capabilities(struct __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3]) {
    struct __user_cap_header_struct header = {.version = _LINUX_CAPABILITY_VERSION_3};
    memset(data, 0, _LINUX_CAPABILITY_U32S_3 * sizeof *data);
    return syscall(SYS_capget, &header, data) == 0;
}

static bool has_capability(unsigned capability) {
    struct __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3];
    return read_capabilities(data) && (data[CAP_TO_INDEX(capability)].effective & CAP_TO_MASK(capability)) != 0;
}

static bool has_none(void) {
    struct __user_cap_data_struct data[_LINUX_CAPABILITY_U32S_3];
    uint32_t all = 0;
    bool known = read_capabilities(data);
    for (size_t i = 0; i < _LINUX_CAPABILITY_U32S_3; i++) {
        all |= data[i].effective | data[i].permitted | data[i].inheritable;
    }
    return known && all == 0;
}

static bool may_change_user(void) {
    return has_capability(CAP_SETUID) && has_capability(CAP_SETGID);
}

/* Drops capabilities that exec could give back. Without CAP_SETPCAP this is not possible. The
 * process then has only its present capabilities to drop. */
static bool forbid_new(void) {
    if (!has_capability(CAP_SETPCAP)) {
        return true;
    }
    for (unsigned long capability = 0; prctl(PR_CAPBSET_READ, capability) >= 0; capability++) {
        if (prctl(PR_CAPBSET_DROP, capability) != 0) {
            return false;
        }
    }
    return prctl(PR_SET_SECUREBITS, NO_ROOT) == 0;
}

/* Does nothing without capabilities, because a service's filter may refuse capset(). */
static bool drop_effective(void) {
    if (has_none()) {
        return true;
    }
    struct __user_cap_header_struct header = {.version = _LINUX_CAPABILITY_VERSION_3};
    struct __user_cap_data_struct none[_LINUX_CAPABILITY_U32S_3];
    memset(none, 0, sizeof none);
    (void)prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_CLEAR_ALL, 0, 0, 0); /* fails before Linux 4.3, which has none */
    return syscall(SYS_capset, &header, none) == 0;
}

static tl_status drop_privileges(tl_error *error) {
    return forbid_new() && drop_effective()
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "capabilities cannot be dropped: %s", strerror(errno));
}

/* Changes to user and group `user` (> 0), without other groups and capabilities. Sets
 * PR_SET_PDEATHSIG again, because the kernel resets it when the user changes. */
static tl_status become_user(uint32_t user, tl_error *error) {
    int signal = 0;
    const pid_t parent = getppid();
    (void)prctl(PR_GET_PDEATHSIG, &signal);
    if (!forbid_new() || setgroups(0, NULL) != 0 || setresgid(user, user, user) != 0 ||
        setresuid(user, user, user) != 0 || !drop_effective() || prctl(PR_SET_PDEATHSIG, signal) != 0) {
        return tl_fail(error, TL_TRY_AGAIN, "the user cannot be changed to %lu: %s", (unsigned long)user,
                       strerror(errno));
    }
    return signal == 0 || getppid() == parent ? TL_OK : tl_fail(error, TL_INTERRUPTED, "the parent process has ended");
}

/* ---- limits ---- */

/* Stack limit if there is none yet; more than a main thread needs. Stacks do not count as data, and
 * that of the main thread grows automatically. */
#define LARGEST_STACK ((rlim_t)64 * 1024 * 1024)

/* No memory limit with a sanitizer, whose own memory is larger. */
static const bool LIMITS_MEMORY = TL_HAS_SANITIZER == 0;

/* Lowers a limit; never raises one that was set from outside. */
static bool lower_limit(int resource, rlim_t most) {
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

/* Returns a number above all open descriptors. Without /proc it is unknown; then the limit does not
 * change. */
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

static tl_status set_limits(uint64_t memory, uint64_t file, tl_error *error) {
    struct rlimit stack;
    bool has_stack = getrlimit(RLIMIT_STACK, &stack) == 0 && stack.rlim_cur != RLIM_INFINITY;
    bool done = (memory == 0 || !LIMITS_MEMORY || lower_limit(RLIMIT_DATA, (rlim_t)memory)) &&
                (file == 0 || lower_limit(RLIMIT_FSIZE, (rlim_t)file)) && lower_limit(RLIMIT_CORE, 0) &&
                lower_limit(RLIMIT_STACK, has_stack ? stack.rlim_cur : LARGEST_STACK) &&
                lower_limit(RLIMIT_MSGQUEUE, 0) && lower_limit(RLIMIT_SIGPENDING, TL_PROCESS_LIMITS_SIGNALS) &&
                lower_limit(RLIMIT_NOFILE, open_descriptors() + TL_PROCESS_LIMITS_DESCRIPTORS) &&
                prctl(PR_SET_DUMPABLE, 0) == 0;
    return done ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "the process limits cannot be set: %s", strerror(errno));
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

/* ---- kernel support ---- */

void tl_confine_probe(tl_confine_facts *facts) {
    *facts = (tl_confine_facts){
        .filter = tl_filter_is_offered(),
        .notifies = tl_filter_can_notify(),
        .landlock = tl_landlock_version(),
        .memory = LIMITS_MEMORY,
        .user = may_change_user(),
    };
}

uint64_t tl_confine_fair_memory(void) {
    long pages = sysconf(_SC_PHYS_PAGES);
    long size = sysconf(_SC_PAGESIZE);
    const uint64_t most = (uint64_t)TL_CONFINE_MEMORY_MIB * 1024 * 1024;
    uint64_t half = pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size / 2 : 0;
    return half < most ? half : most;
}

/* ---- confine ---- */

/* Keeps capabilities with a plant or keeps_files, because devices and files of other users may need
 * them. */
static tl_status reduce_privileges(const tl_confine_settings *settings, tl_error *error) {
    if (settings->user != 0) {
        return become_user(settings->user, error);
    }
    return settings->plant != NULL || settings->keeps_files ? TL_OK : drop_privileges(error);
}

static tl_status restrict_calls(const tl_confine_settings *settings, tl_confine_facts *facts, int *listener,
                                tl_error *error) {
    const bool filters = tl_filter_is_offered(); /* later the filter refuses this query */
    tl_status status = filters ? tl_filter_load(settings, listener, error) : TL_OK;
    if (status == TL_OK) {
        *facts = (tl_confine_facts){.filter = filters,
                                    .notifies = listener != NULL && *listener >= 0,
                                    .landlock = settings->landlock,
                                    .memory = settings->memory != 0 && LIMITS_MEMORY,
                                    .user = settings->user != 0};
    }
    return status;
}

tl_status tl_confine(const tl_confine_settings *settings, tl_confine_facts *facts, int *listener, tl_error *error) {
    tl_confine_settings own = *settings;
    own.landlock = settings->landlock_newest < 0 ? 0 : tl_landlock_version();
    own.landlock = settings->landlock_newest > 0 && settings->landlock_newest < own.landlock ? settings->landlock_newest
                                                                                             : own.landlock;
    *facts = (tl_confine_facts){0};
    if (listener != NULL) {
        *listener = -1;
    }
    if (own.folder != NULL && (chdir(own.folder) != 0 || setenv("TMPDIR", own.folder, 1) != 0)) {
        return tl_fail(error, TL_BAD_USAGE, "%.300s: cannot be used as working folder: %s", own.folder,
                       strerror(errno));
    }
    tl_status status = reduce_privileges(&own, error);
    status = status != TL_OK ? status : set_limits(own.memory, own.file_bytes, error);
    if (status == TL_OK && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
        status = tl_fail(error, TL_TRY_AGAIN, "no_new_privs cannot be set: %s", strerror(errno));
    }
    status = status == TL_OK && own.landlock > 0 ? tl_landlock_restrict(&own, error) : status;
    return status == TL_OK ? restrict_calls(&own, facts, listener, error) : status;
}

/* ---- describe ---- */

void tl_confine_describe(const tl_confine_facts *facts, char text[TL_CONFINE_TEXT]) {
    const char *const sentences[] = {
        facts->landlock > 0 ? ""
        : facts->user
            ? "this kernel has no Landlock: FMUs can read and write what every user may"
            : "this kernel has no Landlock: FMUs can read and write files of this user, and control its other "
              "processes (/proc/PID/mem)",
        facts->filter
            ? ""
            : "this kernel has no seccomp: FMUs can open sockets, start programs and signal processes of this user",
        facts->filter && !facts->notifies
            ? "denied system calls of FMUs are not reported, because this kernel's seccomp has no notifications"
            : "",
        facts->memory ? "" : "the memory of FMUs has no limit",
    };
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < sizeof sentences / sizeof sentences[0]; i++) {
        if (sentences[i][0] != '\0' && used < TL_CONFINE_TEXT) {
            int length = snprintf(text + used, TL_CONFINE_TEXT - used, "%s%s", used > 0 ? "; " : "", sentences[i]);
            used += length > 0 ? (size_t)length : 0;
        }
    }
}
