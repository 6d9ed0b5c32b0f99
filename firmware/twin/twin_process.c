/* FMU process, seen from its parent: see twin_process.h. */
#include "firmware/twin/twin_process.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/base/relay.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/process/bounds.h"
#include "firmware/process/confine.h"
#include "firmware/process/fmu_call_timeout.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/private_folder.h"
#include "firmware/twin/assembly.h"
#include "firmware/twin/twin_role.h"

static const uint64_t MIB = UINT64_C(1024) * 1024;

enum {
    FILES = TL_FMU_ENTRIES,
    PROCESSES = 1 << 22,
    POLL_MS = 50,
    STACK = 256 * 1024, /* small, because the supervisor locks its memory */
    ANSWERS =
        64 /* most denied calls to answer before the process is checked again, because it may send them without end */
};

/* Limits of its output. */
enum {
    OUTPUT_PATIENCE = 2000,     /* ms */
    OUTPUT_MOST = 32 << 20,     /* bytes, burst */
    OUTPUT_RATE = 16 << 10,     /* bytes per second after the burst */
    OUTPUT_PAGE_MOST = 64 << 20 /* bytes */
};

/* Our descriptors. If there are two ends, the second one belongs to the process. START: socket over
 * which the process sends LISTENER, which reports denied calls. START is closed after that, or when
 * the process closes its end. STOP: ends the watch thread. WAKE: there is something to log. */
enum { OUTPUT, PAGE = OUTPUT + 2, START = PAGE + 2, NOTHING = START + 2, STOP, WAKE, LISTENER, ENDS };

enum { LINES, PAGE_LINES, RELAYS };

/* Remaining budget: for lines of an FMU, and for lines with a level. */
enum { FMUS_LINES, OUR_LINES, KINDS };

typedef struct budget {
    int64_t remaining;
    tl_time updated;
} budget;

struct tl_twin_process {
    tl_twin_process_settings settings;
    tl_private_folder folder;
    uint32_t user; /* user ID of the process; 0: ours */
    tl_block job;
    tl_role role;
    tl_bounds bounds;
    int ends[ENDS]; /* -1: none, or closed */
    pthread_t output_thread, watch_thread;
    bool has_output_thread, has_watch_thread, output_stops;
    /* of the watch thread */
    tl_fmu_call_timeout patience;
    tl_time forward_at; /* when a received signal is forwarded; repeated, because an FMU may have swallowed it */
    /* of the output thread, or under the locks of the relays */
    size_t logged; /* number of denied calls that were logged */
    tl_relay relays[RELAYS];
    bool ended[RELAYS];
    budget budgets[KINDS];
    bool has_overflowed;
    bool is_stuck; /* our log is not read */
    bool page_is_too_long;
    uint64_t dropped;
    uint64_t page_bytes;
    pthread_mutex_t lock;             /* protects all fields below */
    bool may_kill;                    /* its process ID is valid */
    char killed[TL_TWIN_KILLED_TEXT]; /* reason; "": not killed */
    tl_fmu_refusals refusals;
    size_t reported; /* number of denied calls that were reported */
};

static void close_end(tl_twin_process *self, int end) {
    if (self->ends[end] >= 0) {
        (void)close(self->ends[end]);
    }
    self->ends[end] = -1;
}

static void signal_end(const tl_twin_process *self, int end) {
    const uint64_t one = 1;
    (void)!write(self->ends[end], &one, sizeof one);
}

static void notify_parent(const tl_twin_process *self) {
    if (self->settings.channel != NULL) {
        tl_channel_nudge(self->settings.channel);
    }
}

/* ---- output ---- */

static bool fits_budget(budget *has, size_t bytes) {
    tl_time now = tl_clock_now(NULL);
    const double passed = tl_seconds(now - has->updated);
    if (passed > 0.001) {
        double left = (double)has->remaining + passed * OUTPUT_RATE;
        has->remaining = left > OUTPUT_MOST ? OUTPUT_MOST : (int64_t)left;
        has->updated = now;
    }
    bool may = has->remaining >= (int64_t)bytes;
    has->remaining -= may ? (int64_t)bytes : 0;
    return may;
}

/* A line without a level comes from an FMU. */
static void forward_output(void *context, const char *line) {
    tl_twin_process *self = context;
    const char *text = NULL;
    int level = tl_log_level_of(line, &text);
    bool passed = fits_budget(&self->budgets[level == TL_LOG_FOREIGN ? FMUS_LINES : OUR_LINES], strlen(line) + 1);
    if (passed) {
        passed = tl_log_foreign(level, text, self->is_stuck ? 0 : OUTPUT_PATIENCE);
        self->is_stuck = !passed;
    } else if (!self->has_overflowed) {
        self->has_overflowed = true;
        (void)tl_log_foreign(TL_LOG_WARNING,
                             "FMUs print too much: what exceeds 32 MiB, and then 16 KiB/s, is not logged",
                             OUTPUT_PATIENCE);
    }
    self->dropped += passed ? 0 : 1;
}

static void forward_page(void *context, const char *line) {
    tl_twin_process *self = context;
    self->page_bytes += strlen(line) + 1;
    if (self->page_bytes <= OUTPUT_PAGE_MOST) {
        (void)fprintf(self->settings.page, "%s\n", line);
    } else {
        __atomic_store_n(&self->page_is_too_long, true, __ATOMIC_RELEASE);
    }
}

void tl_twin_process_flush(tl_twin_process *process) {
    for (int i = 0; i < RELAYS; i++) {
        if (!__atomic_load_n(&process->ended[i], __ATOMIC_ACQUIRE) && !tl_relay_drain(&process->relays[i]) &&
            !__atomic_exchange_n(&process->ended[i], true, __ATOMIC_ACQ_REL)) {
            notify_parent(process);
        }
    }
}

static const char *next_refusal(tl_twin_process *self, size_t *reported) {
    (void)pthread_mutex_lock(&self->lock);
    const char *text = tl_fmu_refusals_next(&self->refusals, reported);
    (void)pthread_mutex_unlock(&self->lock);
    return text;
}

/* Without the lock: the listener may wait for a thread that waits for it. */
static void log_refusals(tl_twin_process *self) {
    const char *text = NULL;
    while ((text = next_refusal(self, &self->logged)) != NULL) {
        if (!self->settings.is_silent) {
            (void)tl_log_foreign(TL_LOG_WARNING, text, OUTPUT_PATIENCE);
        }
        if (self->settings.on_event != NULL) {
            self->settings.on_event(self->settings.context, text);
        }
    }
}

/* Only this thread may wait for the reader of our log. It does not poll closed pipes, because they
 * are always ready. */
static void *run_output(void *context) {
    tl_twin_process *self = context;
    bool stop = false;
    while (!stop) {
        struct pollfd watched[RELAYS + 1];
        uint64_t count = 0;
        for (int i = 0; i < RELAYS; i++) {
            bool ended = __atomic_load_n(&self->ended[i], __ATOMIC_ACQUIRE);
            watched[i] = (struct pollfd){.fd = ended ? -1 : self->relays[i].descriptor, .events = POLLIN};
        }
        watched[RELAYS] = (struct pollfd){.fd = self->ends[WAKE], .events = POLLIN};
        (void)poll(watched, RELAYS + 1, -1);
        (void)!read(self->ends[WAKE], &count, sizeof count);
        stop = __atomic_load_n(&self->output_stops, __ATOMIC_ACQUIRE);
        tl_twin_process_flush(self);
        log_refusals(self);
    }
    return NULL;
}

/* ---- watch thread: never blocks ---- */

static void kill_process(tl_twin_process *self, const char *why) {
    if (self->killed[0] == '\0' && self->may_kill) {
        (void)snprintf(self->killed, sizeof self->killed, "%s", why);
        (void)kill(self->role.pid, SIGKILL);
        notify_parent(self);
    }
}

static void check_calls(tl_twin_process *self) {
    char text[256];
    tl_fmu_call call;
    bool is_called = tl_fmu_calls_poll(self->settings.calls, &call);
    const tl_fmu_call_timeout_view view = {
        .now = tl_clock_now(NULL),
        .call = is_called ? &call : NULL,
        .asked = tl_interrupt_requested(),
        .times = tl_interrupt_times(),
        .whatever = true,
    };
    if (tl_fmu_call_timeout_is_over(&self->patience, &view, text, sizeof text)) {
        kill_process(self, text);
    }
}

static void check_bounds(tl_twin_process *self) {
    char found[TL_BOUNDS_TEXT];
    char text[TL_TWIN_KILLED_TEXT];
    if (self->may_kill && !tl_bounds_are_kept(&self->bounds, self->role.pid, found)) {
        (void)snprintf(text, sizeof text, "the FMU process was killed: %s", found);
        kill_process(self, text);
    }
    if (__atomic_load_n(&self->page_is_too_long, __ATOMIC_ACQUIRE)) {
        (void)snprintf(text, sizeof text, "the FMU process was killed: the page of the check is longer than %d MB",
                       OUTPUT_PAGE_MOST / 1000000);
        kill_process(self, text);
    }
}

/* Not before the process has its handlers, because a signal would kill it until then. */
static void forward_signal(tl_twin_process *self) {
    int asked = tl_interrupt_signal();
    tl_time now = tl_clock_now(NULL);
    if (asked != 0 && self->ends[START] < 0 && self->may_kill && now >= self->forward_at) {
        self->forward_at = now + TL_SECOND / 2;
        (void)kill(self->role.pid, asked);
    }
}

/* The FMU waits for the answer, so it comes before all else. The lock is needed because other
 * threads read the list. */
static void answer_refusals(tl_twin_process *self) {
    tl_refusal refusal;
    bool is_new = false;
    for (int i = 0; i < ANSWERS && tl_refusal_take(self->ends[LISTENER], &refusal); i++) {
        (void)pthread_mutex_lock(&self->lock);
        is_new = tl_fmu_refusals_note(&self->refusals, &refusal, self->settings.calls) || is_new;
        (void)pthread_mutex_unlock(&self->lock);
        tl_refusal_answer(self->ends[LISTENER], &refusal);
    }
    if (is_new) {
        signal_end(self, WAKE);
    }
}

static void *run_watch(void *context) {
    enum { STOPS, STARTS, LISTENS, WATCHED };
    tl_twin_process *self = context;
    tl_time next = 0;
    for (;;) {
        struct pollfd watched[WATCHED] = {
            [STOPS] = {.fd = self->ends[STOP], .events = POLLIN},
            [STARTS] = {.fd = self->ends[START], .events = POLLIN},
            [LISTENS] = {.fd = self->ends[LISTENER], .events = POLLIN},
        };
        (void)poll(watched, WATCHED, POLL_MS);
        if (watched[STOPS].revents != 0) {
            return NULL;
        }
        if (watched[STARTS].revents != 0) {
            char byte = 0; /* with the listener; none if the kernel lacks it, or if nothing is denied */
            (void)tl_packet_take(self->ends[START], &byte, sizeof byte, &self->ends[LISTENER]);
            close_end(self, START);
        }
        if (watched[LISTENS].revents != 0) {
            answer_refusals(self);
        }
        if ((watched[LISTENS].revents & (POLLHUP | POLLERR)) != 0) {
            close_end(self, LISTENER);
        }
        tl_time now = tl_clock_now(NULL);
        if (now >= next) {
            next = now + POLL_MS * (TL_SECOND / 1000);
            (void)pthread_mutex_lock(&self->lock);
            if (self->settings.passes_signals) {
                forward_signal(self);
                check_calls(self);
            }
            check_bounds(self);
            (void)pthread_mutex_unlock(&self->lock);
        }
    }
}

/* ---- limits ---- */

/* The limits are those of fmu_archive.h. */
tl_twin_fmus tl_twin_fmus_of(const tl_config *config) {
    uint64_t sum = 0;
    for (size_t i = 0; i < config->component_count; i++) {
        char path[PATH_MAX];
        struct stat about;
        if (tl_config_fmu_path(config, config->components[i].fmu, path, sizeof path) && stat(path, &about) == 0) {
            uint64_t most = (uint64_t)about.st_size * TL_FMU_RATIO;
            most = most < TL_FMU_RATIO_FROM_BYTES ? TL_FMU_RATIO_FROM_BYTES : most;
            sum += most < TL_FMU_TOTAL_BYTES ? most : TL_FMU_TOTAL_BYTES;
        }
    }
    return (tl_twin_fmus){.count = config->component_count, .unpacked_bytes = sum};
}

/* Returns true if another user can enter all parent folders. */
static bool is_open_to_others(const char *folder) {
    char path[PATH_MAX];
    struct stat about;
    if (realpath(folder, path) == NULL) {
        return false;
    }
    for (char *end = path + strlen(path); end != NULL; end = strrchr(path, '/')) {
        *end = '\0';
        if (stat(path[0] == '\0' ? "/" : path, &about) != 0 || (about.st_mode & S_IXOTH) == 0) {
            return false;
        }
    }
    return true;
}

/* If we are root, the process gets a user ID that is not used otherwise: from a range that systemd
 * leaves free, plus our process ID, different for each of our simultaneous processes. Process IDs
 * are below PROCESSES.
 * It stays root, without root's capabilities, if that user cannot reach the folder. The same
 * applies in a container whose root has only some user IDs, or may not change the owner of a
 * folder.
 * In safe hold there is no folder, because nothing is unpacked or written, and because safe hold
 * must also work if no folder can be created. */
static tl_status make_folder(tl_twin_process *process, tl_error *error) {
    const tl_twin_job *job = process->settings.job;
    const char *folder = getenv("TMPDIR");
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    bool is_open = job->holds || is_open_to_others(folder == NULL || folder[0] == '\0' ? "/tmp" : folder);
    if (!job->unconfined && geteuid() == 0 && facts.user && is_open) {
        process->user = 0x70000000U + process->settings.which * PROCESSES + (uint32_t)getpid();
    }
    if (job->holds ||
        (process->user != 0 && tl_private_folder_make("twin", process->user, &process->folder, error) == TL_OK)) {
        return TL_OK;
    }
    process->user = 0;
    return tl_private_folder_make("twin", 0, &process->folder, error);
}

/* ---- start ---- */

enum { VARIABLE = PATH_MAX + 32 };

/* Variables added to the environment of the process. */
typedef struct environment {
    char texts[TL_ROLE_VARIABLES][VARIABLE];
    const char *variables[TL_ROLE_VARIABLES];
    size_t count;
} environment;

/* A text that is too long is omitted. */
static void add_variable(environment *made, const char *name, const char *value, const char *end) {
    char *text = made->texts[made->count];
    if (snprintf(text, VARIABLE, "%s=%s%s", name, value, end) < VARIABLE) {
        made->variables[made->count++] = text;
    }
}

/* In a confined process HOME is its own folder: libraries find no settings there and need no user
 * database. Python writes no compiled files: the folder is deleted at the end, and without Landlock
 * Python may not rename files. */
static void build_environment(const tl_twin_process *process, environment *made) {
    const char *home = getenv("HOME");
    made->count = 0;
    if (process->settings.job->holds) {
        return;
    }
    add_variable(made, "TMPDIR", process->folder.path, "");
    if (process->settings.job->unconfined) {
        return;
    }
    add_variable(made, "HOME", process->folder.path, "");
    add_variable(made, "PYTHONDONTWRITEBYTECODE", "1", "");
    if (home != NULL) {
        add_variable(made, TL_READABLE_PATHS_HOME, home, "");
    }
    if (home != NULL && home[0] == '/' && getenv("PYTHONUSERBASE") == NULL) { /* packages of the user */
        add_variable(made, "PYTHONUSERBASE", home, "/.local");
    }
}

/* Inherited variables that are not secret: language, paths of libraries and Python, number of
 * threads, licences, and variables for tests and emulators of whole programs. */
static const char *const inherited[] = {"PATH",
                                        "LANG",
                                        "LANGUAGE",
                                        "LC_*",
                                        "LOCPATH",
                                        "TZ",
                                        "TZDIR",
                                        "USER",
                                        "LOGNAME",
                                        "LD_LIBRARY_PATH",
                                        "PYTHON*",
                                        "VIRTUAL_ENV",
                                        "CONDA_PREFIX",
                                        "TWINLOCK_*",
                                        "OMP_*",
                                        "KMP_*",
                                        "GOMP_*",
                                        "OPENBLAS_*",
                                        "GOTO_NUM_THREADS",
                                        "MKL_*",
                                        "BLIS_*",
                                        "NUMEXPR_*",
                                        "LM_LICENSE_FILE",
                                        "MALLOC_*",
                                        "GLIBC_TUNABLES",
                                        "ASAN_OPTIONS",
                                        "LSAN_OPTIONS",
                                        "TSAN_OPTIONS",
                                        "UBSAN_OPTIONS",
                                        "QEMU_*",
                                        NULL};

/* Used instead of exec on a machine without it. */
static int run_forked(const char *title, void *context) {
    const tl_twin_process *process = context;
    (void)title;
    return tl_twin_role_run(process->settings.tasks);
}

static tl_status open_ends(tl_twin_process *process, tl_error *error) {
    static tl_relay_line *const passes[RELAYS] = {[LINES] = forward_output, [PAGE_LINES] = forward_page};
    int *ends = process->ends;
    ends[NOTHING] = open("/dev/null", O_RDWR | O_CLOEXEC);
    ends[STOP] = eventfd(0, EFD_CLOEXEC);
    ends[WAKE] = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    bool all = ends[NOTHING] >= 0 && ends[STOP] >= 0 && ends[WAKE] >= 0 && pipe2(&ends[OUTPUT], O_CLOEXEC) == 0 &&
               (process->settings.page == NULL || pipe2(&ends[PAGE], O_CLOEXEC) == 0) &&
               socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, &ends[START]) == 0;
    for (int i = 0; i < RELAYS; i++) {
        int *end = &ends[i == LINES ? OUTPUT : PAGE];
        process->ended[i] = *end < 0;
        if (*end >= 0) {
            tl_relay_open(&process->relays[i], *end, passes[i], process);
            *end = -1; /* now owned by the relay */
        }
    }
    return all ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "no pipes for the FMU process: %s", strerror(errno));
}

static tl_status start_role(tl_twin_process *process, tl_error *error) {
    const int *ends = process->ends;
    environment around;
    build_environment(process, &around);
    tl_role_settings settings = {
        .title = process->settings.title,
        .variables = around.variables,
        .variable_count = around.count,
        .inherits = process->settings.job->unconfined ? NULL : inherited,
        .fallback = run_forked,
        .context = process,
    };
    memcpy(settings.descriptors, process->settings.given, sizeof settings.descriptors);
    settings.descriptors[0] = ends[NOTHING];
    const int output = ends[process->settings.is_silent ? NOTHING : OUTPUT + 1];
    settings.descriptors[TL_TWIN_OUTPUT] = output;
    settings.descriptors[TL_TWIN_OUTPUT + 1] = output;
    settings.descriptors[TL_TWIN_JOB] = process->job.descriptor;
    settings.descriptors[TL_TWIN_START_SOCKET] = ends[START + 1];
    if (process->settings.job->task == TL_TASK_CHECK) {
        settings.descriptors[TL_TWIN_PAGE] = ends[process->settings.page != NULL ? PAGE + 1 : NOTHING];
    }
    tl_status status = tl_role_start(&settings, &process->role, error);
    for (int end = OUTPUT; end < START; end += 2) {
        close_end(process, end + 1);
    }
    close_end(process, START + 1);
    close_end(process, NOTHING);
    process->may_kill = status == TL_OK;
    return status;
}

static bool start_thread(tl_twin_process *process, pthread_t *thread, void *(*run)(void *context), tl_error *error) {
    int result = tl_side_thread_start(thread, STACK, run, process);
    if (result != 0) {
        (void)tl_fail(error, TL_TRY_AGAIN, "no thread to watch the FMU process: %s", strerror(result));
    }
    return result == 0;
}

static tl_status start_process(tl_twin_process *process, tl_error *error) {
    const tl_twin_fmus *fmus = &process->settings.fmus;
    tl_status status = make_folder(process, error);
    tl_twin_job job = *process->settings.job;
    job.folder = process->folder.path;
    job.memory = process->settings.memory_limit;
    job.user = process->user;
    if (status == TL_OK) {
        status = tl_twin_job_make(&job, &process->job, error);
    }
    if (status == TL_OK) {
        status = open_ends(process, error);
    }
    if (status == TL_OK) {
        status = start_role(process, error);
    }
    if (status != TL_OK) {
        return status;
    }
    process->bounds = (tl_bounds){.folder = process->settings.job->holds ? NULL : process->folder.path,
                                  .bytes = TL_TWIN_FOLDER_MIB * MIB + fmus->unpacked_bytes,
                                  .files = FILES * (fmus->count + 1),
                                  .threads = TL_TWIN_THREADS,
                                  .memory = process->settings.memory_limit};
    process->has_output_thread = start_thread(process, &process->output_thread, run_output, error);
    process->has_watch_thread =
        process->has_output_thread && start_thread(process, &process->watch_thread, run_watch, error);
    return process->has_watch_thread ? TL_OK : error->status;
}

tl_status tl_twin_process_start(const tl_twin_process_settings *settings, tl_twin_process **process, tl_error *error) {
    tl_twin_process *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the FMU process");
    }
    made->settings = *settings;
    if (made->settings.memory_limit == 0) {
        made->settings.memory_limit = tl_confine_fair_memory();
    }
    for (int i = 0; i < ENDS; i++) {
        made->ends[i] = -1;
    }
    for (int i = 0; i < RELAYS; i++) {
        made->ended[i] = true;
    }
    for (int i = 0; i < KINDS; i++) {
        made->budgets[i] = (budget){.remaining = OUTPUT_MOST, .updated = tl_clock_now(NULL)};
    }
    (void)pthread_mutex_init(&made->lock, NULL);
    made->patience.limit = settings->call_limit;
    tl_status status = start_process(made, error);
    if (status != TL_OK) {
        tl_twin_process_close(made);
        return status;
    }
    *process = made;
    return TL_OK;
}

/* ---- state ---- */

const tl_role *tl_twin_process_role(const tl_twin_process *process) {
    return &process->role;
}

static void forbid_kill(tl_twin_process *process) {
    (void)pthread_mutex_lock(&process->lock);
    process->may_kill = false;
    (void)pthread_mutex_unlock(&process->lock);
}

bool tl_twin_process_reap(tl_twin_process *process) {
    (void)pthread_mutex_lock(&process->lock);
    bool ended = tl_role_watch(&process->role);
    process->may_kill = process->may_kill && !ended;
    (void)pthread_mutex_unlock(&process->lock);
    return ended;
}

void tl_twin_process_kill(tl_twin_process *process) {
    forbid_kill(process);
    tl_role_kill(&process->role);
}

void tl_twin_process_let_go(tl_twin_process *process) {
    forbid_kill(process);
    if (!process->role.has_ended) {
        process->role = (tl_role){.is_forked = process->role.is_forked, .has_ended = true, .code = -1};
    }
    tl_twin_process_flush(process);
}

bool tl_twin_process_was_killed(tl_twin_process *process, char text[TL_TWIN_KILLED_TEXT]) {
    (void)pthread_mutex_lock(&process->lock);
    (void)snprintf(text, TL_TWIN_KILLED_TEXT, "%s", process->killed);
    (void)pthread_mutex_unlock(&process->lock);
    return text[0] != '\0';
}

bool tl_twin_process_refusal_may_be_cause(tl_twin_process *process) {
    (void)pthread_mutex_lock(&process->lock);
    bool may_be = tl_fmu_refusals_may_be_cause(&process->refusals, process->settings.calls);
    (void)pthread_mutex_unlock(&process->lock);
    return may_be;
}

void tl_twin_process_report(tl_twin_process *process, tl_fmu_refusals_listener *on_event, void *context) {
    const char *text = NULL;
    while ((text = next_refusal(process, &process->reported)) != NULL) {
        on_event(context, text);
    }
}

/* The watch thread first, because the output thread logs its last finding. */
static void stop_threads(tl_twin_process *process) {
    if (process->has_watch_thread) {
        signal_end(process, STOP);
        (void)pthread_join(process->watch_thread, NULL);
    }
    if (process->has_output_thread) {
        __atomic_store_n(&process->output_stops, true, __ATOMIC_RELEASE);
        signal_end(process, WAKE);
        (void)pthread_join(process->output_thread, NULL);
    }
}

void tl_twin_process_close(tl_twin_process *process) {
    if (process == NULL) {
        return;
    }
    tl_twin_process_kill(process);
    stop_threads(process);
    tl_twin_process_flush(process);
    for (int i = 0; i < RELAYS; i++) {
        if (process->relays[i].pass != NULL) {
            tl_relay_close(&process->relays[i]);
        }
    }
    if (process->dropped != 0) {
        char text[128];
        (void)snprintf(text, sizeof text, "%llu lines of FMU output were not logged",
                       (unsigned long long)process->dropped);
        (void)tl_log_foreign(TL_LOG_WARNING, text, OUTPUT_PATIENCE);
    }
    for (int i = 0; i < ENDS; i++) {
        close_end(process, i);
    }
    (void)pthread_mutex_destroy(&process->lock);
    tl_block_close(&process->job);
    tl_private_folder_remove(&process->folder);
    free(process);
}
