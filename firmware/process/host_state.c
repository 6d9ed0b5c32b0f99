/* State of the process that an FMU may change: see host_state.h. */
#include "firmware/process/host_state.h"

#include <fcntl.h>
#include <locale.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>

/* ---- host state ---- */

enum { MOST_HANDLERS = 12, LOCALE_NAME = 64 };

/* Categories of the process's locale that are restored. LC_CTYPE is not: interpreters set it, and
 * it changes no number. */
static const int categories[] = {LC_NUMERIC, LC_TIME, LC_COLLATE, LC_MONETARY, LC_MESSAGES};

enum { CATEGORIES = sizeof categories / sizeof categories[0] };

/* A handler of the program. */
typedef struct kept_handler {
    int signal;
    struct sigaction action;
    tl_host_state_displaced *displaced;
} kept_handler;

/* struct sched_attr of the kernel, in its first version (Linux 3.14). */
typedef struct scheduling {
    uint32_t size;
    uint32_t policy;
    uint64_t flags;
    int32_t nice;
    uint32_t priority;
    uint64_t deadline[3];
} scheduling;

/* Static, because this is the state of the process. */
static struct {
    bool kept;
    uint64_t rounding;
    locale_t locale;                       /* of the thread */
    char locales[CATEGORIES][LOCALE_NAME]; /* of the process */
    sigset_t mask;
    scheduling scheduling;
    cpu_set_t processors;
    int timer_slack; /* ns */
    struct rlimit limits[RLIM_NLIMITS];
    mode_t umask;
    int folder; /* O_PATH; -1: none */
    dev_t device;
    ino_t inode; /* inode of the folder */
    kept_handler handlers[MOST_HANDLERS];
    size_t handler_count;
} host = {.folder = -1};

/* ---- save ---- */

/* The C library has no function for this. If the kernel has none either, returns zeros. */
static scheduling read_scheduling(void) {
    scheduling now = {0};
    (void)syscall(SYS_sched_getattr, 0, &now, (unsigned)sizeof now, 0);
    return now;
}

/* Zeros if the machine has more processors than the set. */
static cpu_set_t read_processors(void) {
    cpu_set_t now;
    CPU_ZERO(&now);
    (void)sched_getaffinity(0, sizeof now, &now);
    return now;
}

static void keep_limits(void) {
    for (int i = 0; i < RLIM_NLIMITS; i++) {
        (void)getrlimit((__rlimit_resource_t)i, &host.limits[i]);
    }
}

static void keep_folder(void) {
    struct stat status;
    host.folder = open(".", O_PATH | O_DIRECTORY | O_CLOEXEC);
    if (host.folder >= 0 && fstat(host.folder, &status) == 0) {
        host.device = status.st_dev;
        host.inode = status.st_ino;
    }
}

void tl_host_state_save(void) {
    host.rounding = tl_fp_control_get();
    host.locale = uselocale((locale_t)0);
    for (size_t i = 0; i < CATEGORIES; i++) {
        (void)snprintf(host.locales[i], LOCALE_NAME, "%s", setlocale(categories[i], NULL));
    }
    (void)pthread_sigmask(SIG_SETMASK, NULL, &host.mask);
    host.scheduling = read_scheduling();
    host.processors = read_processors();
    host.timer_slack = prctl(PR_GET_TIMERSLACK);
    keep_limits();
    if (!host.kept) {
        host.umask = umask(S_IRWXG | S_IRWXO); /* the umask can only be read by setting it */
        (void)umask(host.umask);
        keep_folder();
    }
    host.kept = true;
}

int tl_host_state_handle(int signal, const struct sigaction *action, tl_host_state_displaced *displaced) {
    if (sigaction(signal, action, NULL) != 0) {
        return -1;
    }
    size_t index = 0;
    while (index < host.handler_count && host.handlers[index].signal != signal) {
        index++;
    }
    if (index < MOST_HANDLERS) {
        host.handlers[index] = (kept_handler){signal, *action, displaced};
        host.handler_count = index == host.handler_count ? index + 1 : host.handler_count;
    }
    return 0;
}

/* ---- restore ---- */

static unsigned restore_rounding(void) {
    if (tl_fp_control_get() == host.rounding) {
        return 0;
    }
    tl_fp_control_set(host.rounding);
    return TL_HOST_ROUNDING;
}

/* Our code and the FMUs that we call use the thread's locale. Threads of an FMU use the process's.
 */
static unsigned restore_locale(void) {
    unsigned changed = 0;
    if (uselocale((locale_t)0) != host.locale) {
        (void)uselocale(host.locale);
        changed = TL_HOST_LOCALE;
    }
    for (size_t i = 0; i < CATEGORIES; i++) {
        if (strcmp(setlocale(categories[i], NULL), host.locales[i]) != 0) {
            (void)setlocale(categories[i], host.locales[i]);
            changed = TL_HOST_LOCALE;
        }
    }
    return changed;
}

static unsigned restore_mask(void) {
    sigset_t now;
    if (pthread_sigmask(SIG_SETMASK, NULL, &now) != 0) {
        return 0;
    }
    for (int signal = 1; signal < NSIG; signal++) {
        if (sigismember(&now, signal) != sigismember(&host.mask, signal)) {
            (void)pthread_sigmask(SIG_SETMASK, &host.mask, NULL);
            return TL_HOST_SIGNAL_MASK;
        }
    }
    return 0;
}

static unsigned restore_handler(const kept_handler *own) {
    struct sigaction now;
    if (sigaction(own->signal, NULL, &now) != 0 ||
        ((now.sa_flags & SA_SIGINFO) == (own->action.sa_flags & SA_SIGINFO) &&
         now.sa_handler == own->action.sa_handler)) {
        return 0;
    }
    (void)sigaction(own->signal, &own->action, NULL);
    if (own->displaced != NULL) {
        own->displaced(own->signal, &now);
    }
    return TL_HOST_HANDLERS;
}

static unsigned restore_folder(void) {
    struct stat now;
    if (host.folder < 0 || (stat(".", &now) == 0 && now.st_dev == host.device && now.st_ino == host.inode)) {
        return 0;
    }
    return fchdir(host.folder) == 0 ? TL_HOST_FOLDER : 0;
}

static unsigned restore_scheduling(void) {
    const scheduling now = read_scheduling();
    if (memcmp(&now, &host.scheduling, sizeof now) == 0) {
        return 0;
    }
    return syscall(SYS_sched_setattr, 0, &host.scheduling, 0) == 0 ? TL_HOST_SCHEDULING : 0;
}

static unsigned restore_processors(void) {
    const cpu_set_t now = read_processors();
    if (CPU_EQUAL(&now, &host.processors)) {
        return 0;
    }
    (void)sched_setaffinity(0, sizeof host.processors, &host.processors);
    host.processors = read_processors();
    return CPU_EQUAL(&now, &host.processors) ? 0 : TL_HOST_PROCESSORS;
}

/* The kernel ignores a new value if the thread has real-time scheduling. */
static unsigned restore_timer_slack(void) {
    int now = prctl(PR_GET_TIMERSLACK);
    if (now == host.timer_slack) {
        return 0;
    }
    (void)prctl(PR_SET_TIMERSLACK, (unsigned long)host.timer_slack);
    host.timer_slack = prctl(PR_GET_TIMERSLACK);
    return now == host.timer_slack ? 0 : TL_HOST_TIMER_SLACK;
}

/* Accepts a lowered hard limit if it cannot be raised. */
static unsigned restore_limit(int resource) {
    struct rlimit *own = &host.limits[resource];
    struct rlimit now;
    if (getrlimit((__rlimit_resource_t)resource, &now) != 0 ||
        (now.rlim_cur == own->rlim_cur && now.rlim_max == own->rlim_max)) {
        return 0;
    }
    if (setrlimit((__rlimit_resource_t)resource, own) != 0) {
        own->rlim_max = now.rlim_max;
        own->rlim_cur = own->rlim_cur < now.rlim_max ? own->rlim_cur : now.rlim_max;
        (void)setrlimit((__rlimit_resource_t)resource, own);
    }
    return TL_HOST_LIMITS;
}

static unsigned restore_umask(void) {
    return umask(host.umask) == host.umask ? 0 : TL_HOST_UMASK;
}

/* Each makes one system call if nothing has changed, as do a handler and a limit. */
static unsigned (*const kinds[])(void) = {restore_mask,       restore_folder,     restore_umask,
                                          restore_scheduling, restore_processors, restore_timer_slack};

enum { KINDS = sizeof kinds / sizeof kinds[0] };

_Static_assert((int)KINDS <= TL_HOST_STATE_TURNS && (int)MOST_HANDLERS <= TL_HOST_STATE_TURNS &&
                   (int)RLIM_NLIMITS <= TL_HOST_STATE_TURNS,
               "each has its turn");

static unsigned restore_turn(size_t turn) {
    unsigned changed = turn < KINDS ? kinds[turn]() : 0;
    changed |= turn < host.handler_count ? restore_handler(&host.handlers[turn]) : 0;
    return changed | (turn < RLIM_NLIMITS ? restore_limit((int)turn) : 0);
}

unsigned tl_host_state_restore(void) {
    unsigned changed = host.kept ? restore_rounding() | restore_locale() : 0;
    for (size_t turn = 0; host.kept && turn < TL_HOST_STATE_TURNS; turn++) {
        changed |= restore_turn(turn);
    }
    return changed;
}

unsigned tl_host_state_restore_part(void) {
    static size_t turn;
    turn = (turn + 1) % TL_HOST_STATE_TURNS;
    return host.kept ? restore_rounding() | restore_locale() | restore_turn(turn) : 0;
}

/* ---- describe ---- */

void tl_host_state_describe(unsigned changes, char text[TL_HOST_CHANGE_TEXT]) {
    static const char *const names[TL_HOST_CHANGES] = {
        "floating-point control", "the locale", "the signal mask", "signal handlers",
        "the current folder",     "the umask",  "the scheduling",  "the processors",
        "the timer slack",        "the limits",
    };
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < TL_HOST_CHANGES && used < TL_HOST_CHANGE_TEXT; i++) {
        if ((changes & 1U << i) != 0) {
            const char *between = used == 0 ? "" : (changes >> (i + 1)) == 0 ? " and " : ", ";
            int length = snprintf(text + used, TL_HOST_CHANGE_TEXT - used, "%s%s", between, names[i]);
            used += length > 0 ? (size_t)length : 0;
        }
    }
}
