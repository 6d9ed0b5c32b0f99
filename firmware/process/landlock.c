/* Landlock, by its system calls, for which the C library has no functions: see landlock.h. */
#include "firmware/process/landlock.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "firmware/process/sanitizer.h"

enum { PLACE = 4096, WITH_PORTS = 4 }; /* the version that knows TCP ports */

/* ---- the kernel's words, beyond the headers of Debian 12 (version 2) ---- */

#define EMPTY_FILE (UINT64_C(1) << 14)
#define COMMAND_DEVICE (UINT64_C(1) << 15)
#define TAKE_TCP_PORT (UINT64_C(1) << 0)
#define CONNECT_TCP_PORT (UINT64_C(1) << 1)
#define RULE_TCP_PORT 2
#define ABSTRACT_SOCKETS (UINT64_C(1) << 0)
#define SIGNALS (UINT64_C(1) << 1)

/* struct landlock_ruleset_attr of version 6. */
typedef struct rule_set {
    uint64_t files;
    uint64_t network;
    uint64_t scopes;
} rule_set;

/* struct landlock_net_port_attr of version 4. */
typedef struct port_rule {
    uint64_t rights;
    uint64_t port;
} port_rule;

enum { FILES_ONLY = sizeof(uint64_t), WITH_NETWORK = 2 * sizeof(uint64_t) };

/* ---- rights ---- */

#define LOOK (LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR)
/* No devices, sockets, pipes and links. */
#define CHANGE                                                                                                         \
    (LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_DIR |                       \
     LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR | LANDLOCK_ACCESS_FS_REFER | EMPTY_FILE)
#define NEVER                                                                                                          \
    (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_BLOCK |                       \
     LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_SYM)
/* What can be said of a file that is no folder. */
#define OF_FILES (LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_WRITE_FILE | EMPTY_FILE | COMMAND_DEVICE)

/* What this version knows of all that. */
static uint64_t known(int version) {
    enum { FIRST = 13 }; /* rights of version 1; each of the versions 2, 3 and 5 brought one more */
    int count = FIRST + (version >= 2 ? 1 : 0) + (version >= TL_LANDLOCK_TRUNCATION ? 1 : 0) + (version >= 5 ? 1 : 0);
    return (UINT64_C(1) << count) - 1;
}

/* ---- what programs are made of ---- */

/* Not /etc/passwd: who has an account here is no FMU's affair, and programs do without (HOME says the same). */
static const char *const readable[] = {
    "/usr",
    "/lib",
    "/lib64",
    "/lib32",
    "/opt", /* programs, libraries, their data */
    "/etc/localtime",
    "/etc/timezone",
    "/etc/alternatives",
    "/dev/null",
    "/dev/zero",
    "/dev/random",
    "/dev/urandom",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
    "/proc/uptime",
    "/proc/version",
    "/proc/filesystems",
    "/proc/sys/vm/overcommit_memory",
    "/proc/sys/vm/max_map_count",
    "/proc/sys/kernel/osrelease",
    "/proc/sys/kernel/ngroups_max",
    "/proc/sys/kernel/pid_max",
    "/proc/sys/kernel/threads-max",
    "/proc/sys/kernel/cap_last_cap",
    "/sys/devices/system/cpu",
    "/sys/devices/system/node",
    "/sys/kernel/mm", /* how runtimes measure a machine */
    "/sys/fs/cgroup", /* and what they may have of it */
};

/* What a process may know of itself: not its environment, its network (the plant's addresses), its threads' copies of both, its memory. The kernel makes
 * such a file anew when nobody has it open and memory is short, and a rule is of the file that it was made for: so each stays open. */
static const char *const own[] = {
    "/proc/self/auxv",   "/proc/self/cgroup", "/proc/self/cmdline",   "/proc/self/comm",         "/proc/self/fd",
    "/proc/self/limits", "/proc/self/maps",   "/proc/self/mountinfo", "/proc/self/mounts",       "/proc/self/smaps",
    "/proc/self/stat",   "/proc/self/statm",  "/proc/self/status",    "/proc/self/smaps_rollup",
#if TL_HAS_SANITIZER
    "/proc/self/task", /* the search for leaks stops all threads */
#endif
};

/* Settings of the loader, of the C library's locales, and of interpreters and virtual machines: what begins so in /etc. */
static const char *const settings[] = {"ld.so.", "locale", "python", "java", "mono", "dotnet"};

static const char *const writable[] = {"/dev/null"};

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* ---- rules ---- */

static long add_rule(int rules, int place, uint64_t rights) {
    const struct landlock_path_beneath_attr rule = {.allowed_access = rights, .parent_fd = place};
    return syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0);
}

/* The place, which the caller closes. False, with errno: it failed. What is missing, or out of reach, needs no rule, and is -1. */
static bool allow_open(int rules, const char *path, uint64_t rights, int *place) {
    struct stat what;
    *place = open(path, O_PATH | O_CLOEXEC);
    if (*place < 0) {
        return errno == ENOENT || errno == ENOTDIR || errno == EACCES;
    }
    return fstat(*place, &what) == 0 &&
           add_rule(rules, *place, S_ISDIR(what.st_mode) ? rights : rights & OF_FILES) == 0;
}

static bool allow(int rules, const char *path, uint64_t rights) {
    int place = -1;
    bool done = allow_open(rules, path, rights, &place);
    int cause = errno;
    if (place >= 0) {
        (void)close(place);
    }
    errno = cause;
    return done;
}

static bool allow_own(int rules, uint64_t rights) {
    bool done = true;
    for (size_t i = 0; i < COUNT(own) && done; i++) {
        int stays = -1;
        done = allow_open(rules, own[i], rights, &stays);
    }
    return done;
}

static bool allow_all(int rules, const char *const *paths, size_t count, uint64_t rights) {
    bool done = true;
    for (size_t i = 0; i < count && done; i++) {
        done = allow(rules, paths[i], rights);
    }
    return done;
}

static bool is_setting(const char *name) {
    bool is = false;
    for (size_t i = 0; i < COUNT(settings) && !is; i++) {
        is = strncmp(name, settings[i], strlen(settings[i])) == 0;
    }
    return is;
}

static bool allow_settings(int rules, uint64_t rights) {
    char path[PLACE];
    bool done = true;
    DIR *folder = opendir("/etc");
    const struct dirent *entry = NULL;
    while (done && folder != NULL && (entry = readdir(folder)) != NULL) {
        if (is_setting(entry->d_name)) {
            (void)snprintf(path, sizeof path, "/etc/%s", entry->d_name);
            done = allow(rules, path, rights);
        }
    }
    if (folder != NULL) {
        (void)closedir(folder);
    }
    return done;
}

static bool allow_places(int rules, const tl_confine_settings *places, uint64_t all) {
    const uint64_t look = all & LOOK;
    const uint64_t change = all & (LOOK | CHANGE);
    return allow_all(rules, readable, COUNT(readable), look) && allow_own(rules, look) && allow_settings(rules, look) &&
           allow_all(rules, writable, COUNT(writable), change) &&
           allow_all(rules, places->read, places->read_count, look) &&
           allow_all(rules, places->write, places->write_count, change | (all & COMMAND_DEVICE)) &&
           (places->folder == NULL || allow(rules, places->folder, change));
}

static bool allow_ports(int rules, const tl_confine_settings *places) {
    bool done = true;
    for (size_t i = 0; i < places->port_count && done; i++) {
        const port_rule rule = {.rights = CONNECT_TCP_PORT, .port = places->ports[i]};
        done = syscall(SYS_landlock_add_rule, rules, RULE_TCP_PORT, &rule, 0) == 0;
    }
    return done;
}

/* ---- the whole ---- */

int tl_landlock_version(void) {
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    return version > 0 ? (int)version : 0;
}

static int make_rules(int version) {
    const rule_set set = {
        .files = (LOOK | CHANGE | NEVER | COMMAND_DEVICE) & known(version),
        .network = TAKE_TCP_PORT | CONNECT_TCP_PORT,
        .scopes = SIGNALS | ABSTRACT_SOCKETS,
    };
    size_t size = version >= 6 ? sizeof set : version >= WITH_PORTS ? WITH_NETWORK : FILES_ONLY;
    return (int)syscall(SYS_landlock_create_ruleset, &set, size, 0);
}

tl_status tl_landlock_restrict(const tl_confine_settings *places, tl_error *error) {
    const int version = places->landlock;
    int rules = make_rules(version);
    bool done = rules >= 0 && allow_places(rules, places, known(version)) &&
                (version < WITH_PORTS || allow_ports(rules, places)) &&
                syscall(SYS_landlock_restrict_self, rules, 0) == 0;
    int cause = errno;
    if (rules >= 0) {
        (void)close(rules);
    }
    return done ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "Landlock could not be switched on: %s", strerror(cause));
}
