/* Landlock through its system calls, because the C library has no functions for it: see confine.h.
 */
#include "firmware/process/confine.h"

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

enum { PLACE = 4096, WITH_PORTS = 4 }; /* first version with TCP ports */

/* ---- kernel constants that the headers of Debian 12 (version 2) lack ---- */

#define EMPTY_FILE (UINT64_C(1) << 14)
#define COMMAND_DEVICE (UINT64_C(1) << 15)
#define BIND_TCP_PORT (UINT64_C(1) << 0)
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

#define READ_FILES (LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR)
/* Without devices, sockets, pipes and links. */
#define CHANGE_FILES                                                                                                   \
    (LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_MAKE_REG | LANDLOCK_ACCESS_FS_MAKE_DIR |                       \
     LANDLOCK_ACCESS_FS_REMOVE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR | LANDLOCK_ACCESS_FS_REFER | EMPTY_FILE)
#define NEVER_ALLOWED                                                                                                  \
    (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_BLOCK |                       \
     LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_SYM)
/* Rights that apply to a file that is no folder. */
#define OF_FILES (LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_WRITE_FILE | EMPTY_FILE | COMMAND_DEVICE)

/* Rights that this version knows. */
static uint64_t known(int version) {
    enum { FIRST = 13 }; /* number of rights in version 1; versions 2, 3 and 5 added one each */
    int count = FIRST + (version >= 2 ? 1 : 0) + (version >= TL_LANDLOCK_TRUNCATION ? 1 : 0) + (version >= 5 ? 1 : 0);
    return (UINT64_C(1) << count) - 1;
}

/* ---- readable files of programs ---- */

/* /etc/passwd is missing on purpose: FMUs must not see the accounts, and programs work without it
 * (HOME contains the home folder). */
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
    "/sys/kernel/mm", /* runtimes read the properties of the machine */
    "/sys/fs/cgroup", /* and their limits */
};

/* What a process may read about itself. Missing on purpose: its environment, its network (addresses
 * of the plant), its threads' copies of both, and its memory. If such a file is closed and memory
 * is short, the kernel recreates it with another inode. A rule applies only to the inode that it
 * was made for, so each file stays open. */
static const char *const own[] = {
    "/proc/self/auxv",   "/proc/self/cgroup", "/proc/self/cmdline",   "/proc/self/comm",         "/proc/self/fd",
    "/proc/self/limits", "/proc/self/maps",   "/proc/self/mountinfo", "/proc/self/mounts",       "/proc/self/smaps",
    "/proc/self/stat",   "/proc/self/statm",  "/proc/self/status",    "/proc/self/smaps_rollup",
#if TL_HAS_SANITIZER
    "/proc/self/task", /* the leak check stops all threads */
#endif
};

/* Prefixes of names in /etc: settings of the loader, of locales, and of interpreters and virtual
 * machines. */
static const char *const etc_names[] = {"ld.so.", "locale", "python", "java", "mono", "dotnet"};

static const char *const writable[] = {"/dev/null"};

#define COUNT(array) (sizeof(array) / sizeof(array)[0])

/* ---- rules ---- */

typedef struct landlock_rules {
    int set;
    bool failed; /* errno is the cause; no further rule is added */
} landlock_rules;

/* Adds a rule and returns the open path, which the caller closes. A path that is missing or not
 * accessible needs no rule: returns -1. */
static int allow_open(landlock_rules *list, const char *path, uint64_t rights) {
    struct stat facts = {.st_mode = 0};
    int file = open(path, O_PATH | O_CLOEXEC);
    if (file < 0) {
        list->failed = errno != ENOENT && errno != ENOTDIR && errno != EACCES;
        return file;
    }
    list->failed = fstat(file, &facts) != 0;
    const struct landlock_path_beneath_attr rule = {
        .allowed_access = S_ISDIR(facts.st_mode) ? rights : rights & OF_FILES, .parent_fd = file};
    list->failed = list->failed || syscall(SYS_landlock_add_rule, list->set, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) != 0;
    return file;
}

static void allow_path(landlock_rules *list, const char *path, uint64_t rights) {
    int file = allow_open(list, path, rights);
    int cause = errno;
    if (file >= 0) {
        (void)close(file);
    }
    errno = cause;
}

static void allow_all(landlock_rules *list, const char *const *paths, size_t count, uint64_t rights) {
    for (size_t i = 0; i < count && !list->failed; i++) {
        allow_path(list, paths[i], rights);
    }
}

static bool is_setting(const char *name) {
    bool is = false;
    for (size_t i = 0; i < COUNT(etc_names) && !is; i++) {
        is = strncmp(name, etc_names[i], strlen(etc_names[i])) == 0;
    }
    return is;
}

static void allow_settings(landlock_rules *list, uint64_t rights) {
    char path[PLACE];
    DIR *folder = opendir("/etc");
    const struct dirent *entry = NULL;
    while (!list->failed && folder != NULL && (entry = readdir(folder)) != NULL) {
        if (is_setting(entry->d_name)) {
            (void)snprintf(path, sizeof path, "/etc/%s", entry->d_name);
            allow_path(list, path, rights);
        }
    }
    if (folder != NULL) {
        (void)closedir(folder);
    }
}

static void allow_places(landlock_rules *list, const tl_confine_settings *settings, uint64_t all) {
    const uint64_t read_rights = all & READ_FILES;
    const uint64_t change_rights = all & (READ_FILES | CHANGE_FILES);
    allow_all(list, readable, COUNT(readable), read_rights);
    for (size_t i = 0; i < COUNT(own) && !list->failed; i++) {
        (void)allow_open(list, own[i], read_rights); /* stays open */
    }
    allow_settings(list, read_rights);
    allow_all(list, writable, COUNT(writable), change_rights);
    allow_all(list, settings->read, settings->read_count, read_rights);
    allow_all(list, settings->write, settings->write_count, change_rights | (all & COMMAND_DEVICE));
    allow_all(list, &settings->folder, settings->folder != NULL ? 1 : 0, change_rights);
}

static void allow_ports(landlock_rules *list, const tl_confine_settings *settings) {
    for (size_t i = 0; i < settings->port_count && !list->failed; i++) {
        const port_rule rule = {.rights = CONNECT_TCP_PORT, .port = settings->ports[i]};
        list->failed = syscall(SYS_landlock_add_rule, list->set, RULE_TCP_PORT, &rule, 0) != 0;
    }
}

/* ---- apply ---- */

int tl_landlock_version(void) {
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    return version > 0 ? (int)version : 0;
}

static int make_rules(int version) {
    const rule_set set = {
        .files = (READ_FILES | CHANGE_FILES | NEVER_ALLOWED | COMMAND_DEVICE) & known(version),
        .network = BIND_TCP_PORT | CONNECT_TCP_PORT,
        .scopes = SIGNALS | ABSTRACT_SOCKETS,
    };
    size_t size = version >= 6 ? sizeof set : version >= WITH_PORTS ? WITH_NETWORK : FILES_ONLY;
    return (int)syscall(SYS_landlock_create_ruleset, &set, size, 0);
}

tl_status tl_landlock_restrict(const tl_confine_settings *settings, tl_error *error) {
    landlock_rules list = {.set = make_rules(settings->landlock)};
    list.failed = list.set < 0;
    if (!list.failed) {
        allow_places(&list, settings, known(settings->landlock));
    }
    if (settings->landlock >= WITH_PORTS && !list.failed) {
        allow_ports(&list, settings);
    }
    list.failed = list.failed || syscall(SYS_landlock_restrict_self, list.set, 0) != 0;
    int cause = errno;
    if (list.set >= 0) {
        (void)close(list.set);
    }
    return list.failed ? tl_fail(error, TL_TRY_AGAIN, "Landlock cannot be enabled: %s", strerror(cause)) : TL_OK;
}
