/* A process with FMUs: see twin_process.h. */
#include "firmware/twin/twin_process.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/fmu/fmu_archive.h"
#include "firmware/process/confine.h"
#include "firmware/process/private_folder.h"
#include "firmware/twin/twin_places.h"
#include "firmware/twin/twin_wire.h"

static const uint64_t MIB = UINT64_C(1024) * 1024;

enum { FILES = TL_FMU_ENTRIES, PROCESSES = 1 << 22 };

struct tl_twin_process {
    tl_twin_process_settings settings;
    tl_private_folder folder;
    uint32_t user; /* of its own; 0: ours */
    tl_block job;
    tl_role role;
    tl_twin_warden *warden;
};

/* ---- its ends ---- */

typedef struct pipes {
    int output[2];
    int page[2];
    int start[2];
    int nothing;
} pipes;

static void close_one(int *descriptor) {
    if (*descriptor >= 0) {
        (void)close(*descriptor);
    }
    *descriptor = -1;
}

static void close_pair(int pair[2]) {
    close_one(&pair[0]);
    close_one(&pair[1]);
}

static tl_status open_pipes(pipes *made, bool page, tl_error *error) {
    *made = (pipes){{-1, -1}, {-1, -1}, {-1, -1}, -1};
    made->nothing = open("/dev/null", O_RDWR | O_CLOEXEC);
    bool all = made->nothing >= 0 && pipe2(made->output, O_CLOEXEC) == 0 &&
               (!page || pipe2(made->page, O_CLOEXEC) == 0) &&
               socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, made->start) == 0;
    return all ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "no pipes for the process of the FMUs: %s", strerror(errno));
}

static void close_pipes(pipes *made) {
    close_pair(made->output);
    close_pair(made->page);
    close_pair(made->start);
    close_one(&made->nothing);
}

/* ---- what it may ---- */

/* See fmu_archive.h. */
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

/* Another user can go through all folders on the way to this one. */
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

/* There is nothing to unpack and nobody who writes if it holds; and it is to be there where no folder can be made. */
static bool needs_folder(const tl_twin_process *process) {
    return !process->settings.job->holds;
}

/* Started as root, it gets a user that nobody else has: numbers that systemd leaves to nobody, and one process at a time for each that we have. Numbers
 * of processes are below PROCESSES. Where that user could
 * not come to its folder, it stays root without root's capabilities. */
static uint32_t private_user(const tl_twin_process *process) {
    const char *folder = getenv("TMPDIR");
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    bool is_open = !needs_folder(process) || is_open_to_others(folder == NULL || folder[0] == '\0' ? "/tmp" : folder);
    return geteuid() == 0 && facts.user && is_open
               ? 0x70000000U + process->settings.which * PROCESSES + (uint32_t)getpid()
               : 0;
}

/* Bytes. */
static uint64_t memory_limit(const tl_twin_process *process) {
    return process->settings.memory_limit != 0 ? process->settings.memory_limit : tl_confine_fair_memory();
}

static tl_status make_job(tl_twin_process *process, tl_error *error) {
    tl_twin_job job = *process->settings.job;
    job.folder = process->folder.path;
    job.memory = memory_limit(process);
    job.user = process->user;
    job.file_bytes = TL_FMU_ENTRY_BYTES; /* which may be unpacked; the warden looks at what they write together */
    return tl_twin_job_make(&job, &process->job, error);
}

/* Root of a container may have numbers of users only for some, and no right to give a folder away. Then it stays who it is. */
static tl_status make_folder(tl_twin_process *process, tl_error *error) {
    process->user = process->settings.job->unconfined ? 0 : private_user(process);
    if (!needs_folder(process)) {
        return TL_OK;
    }
    if (process->user != 0 && tl_private_folder_make("twin", process->user, &process->folder, error) != TL_OK) {
        process->user = 0;
    }
    return process->user != 0 ? TL_OK : tl_private_folder_make("twin", 0, &process->folder, error);
}

/* ---- start ---- */

enum { VARIABLE = PATH_MAX + 32 };

/* What is added to the environment of the process. */
typedef struct surroundings {
    char temporary[VARIABLE];
    char home[VARIABLE];
    char packages[VARIABLE];
    char users_home[VARIABLE];
    const char *variables[TL_ROLE_VARIABLES];
    size_t count;
} surroundings;

/* Where a user's own packages of Python lie, if there are any and nobody has said it otherwise. */
static bool find_packages(char variable[VARIABLE]) {
    const char *home = getenv("HOME");
    int length = snprintf(variable, VARIABLE, "PYTHONUSERBASE=%s/.local", home != NULL ? home : "");
    return home != NULL && home[0] == '/' && length < VARIABLE && getenv("PYTHONUSERBASE") == NULL &&
           access(strchr(variable, '/'), F_OK) == 0;
}

/* Confined, its home is its own folder: libraries that look there for settings find none, and need no list of users. Python keeps
 * nothing that it has compiled: its folder is gone at the end, and where no Landlock holds it may rename no file. */
static void surround(const tl_twin_process *process, surroundings *made) {
    made->count = 0;
    if (!needs_folder(process)) {
        return;
    }
    (void)snprintf(made->temporary, sizeof made->temporary, "TMPDIR=%s", process->folder.path);
    made->variables[made->count++] = made->temporary;
    if (process->settings.job->unconfined) {
        return;
    }
    (void)snprintf(made->home, sizeof made->home, "HOME=%s", process->folder.path);
    made->variables[made->count++] = made->home;
    made->variables[made->count++] = "PYTHONDONTWRITEBYTECODE=1";
    const char *home = getenv("HOME");
    if (home != NULL &&
        snprintf(made->users_home, sizeof made->users_home, TL_TWIN_PLACES_HOME "=%s", home) < VARIABLE) {
        made->variables[made->count++] = made->users_home;
    }
    if (find_packages(made->packages)) {
        made->variables[made->count++] = made->packages;
    }
}

/* What programs look for that is nobody's secret: languages, places of libraries and Python, numbers of threads, licences; and what tests and
 * emulators of whole programs need. */
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

/* In place of an execution, where there is none. */
static int run_forked(const char *title, void *context) {
    const tl_twin_process *process = context;
    (void)title;
    return tl_twin_role_run(process->settings.tasks);
}

static tl_status execute(tl_twin_process *process, const pipes *ends, tl_error *error) {
    surroundings around;
    surround(process, &around);
    tl_role_settings settings = {
        .title = process->settings.title,
        .variables = around.variables,
        .variable_count = around.count,
        .inherits = process->settings.job->unconfined ? NULL : inherited,
        .fallback = run_forked,
        .context = process,
    };
    memcpy(settings.descriptors, process->settings.given, sizeof settings.descriptors);
    settings.descriptors[0] = ends->nothing;
    const int output = process->settings.is_silent ? ends->nothing : ends->output[1];
    settings.descriptors[TL_TWIN_OUTPUT] = output;
    settings.descriptors[TL_TWIN_OUTPUT + 1] = output;
    settings.descriptors[TL_TWIN_JOB] = process->job.descriptor;
    settings.descriptors[TL_TWIN_START_SOCKET] = ends->start[1];
    if (process->settings.job->task == TL_TASK_CHECK) {
        settings.descriptors[TL_TWIN_PAGE] = process->settings.page != NULL ? ends->page[1] : ends->nothing;
    }
    return tl_role_start(&settings, &process->role, error);
}

static tl_status start_warden(tl_twin_process *process, pipes *ends, tl_error *error) {
    const tl_twin_process_settings *given = &process->settings;
    const tl_twin_warden_settings settings = {
        .process = process->role.pid,
        .output = ends->output[0],
        .page = ends->page[0],
        .start = ends->start[0],
        .page_file = given->page,
        .calls = given->calls,
        .channel = given->channel,
        .is_silent = given->is_silent,
        .passes_signals = given->passes_signals,
        .call_limit = given->call_limit,
        .bounds = {.folder = needs_folder(process) ? process->folder.path : NULL,
                   .bytes = TL_TWIN_FOLDER_MIB * MIB + given->fmus.unpacked_bytes,
                   .files = FILES * (given->fmus.count + 1),
                   .threads = TL_TWIN_THREADS,
                   .memory = memory_limit(process)},
        .hear = given->hear,
        .context = given->context,
    };
    ends->output[0] = -1;
    ends->page[0] = -1;
    ends->start[0] = -1;
    return tl_twin_warden_start(&settings, &process->warden, error);
}

static tl_status start(tl_twin_process *process, pipes *ends, tl_error *error) {
    tl_status status = make_folder(process, error);
    if (status == TL_OK) {
        status = make_job(process, error);
    }
    if (status == TL_OK) {
        status = open_pipes(ends, process->settings.page != NULL, error);
    }
    if (status == TL_OK) {
        status = execute(process, ends, error);
    }
    return status == TL_OK ? start_warden(process, ends, error) : status;
}

tl_status tl_twin_process_start(const tl_twin_process_settings *settings, tl_twin_process **process, tl_error *error) {
    tl_twin_process *made = calloc(1, sizeof *made);
    pipes ends = {{-1, -1}, {-1, -1}, {-1, -1}, -1};
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the process of the FMUs");
    }
    made->settings = *settings;
    tl_status status = start(made, &ends, error);
    close_pipes(&ends);
    if (status != TL_OK) {
        tl_twin_process_close(made);
        return status;
    }
    *process = made;
    return TL_OK;
}

/* ---- watching ---- */

pid_t tl_twin_process_id(const tl_twin_process *process) {
    return process->role.pid;
}

const tl_role *tl_twin_process_role(const tl_twin_process *process) {
    return &process->role;
}

bool tl_twin_process_reap(tl_twin_process *process) {
    return tl_twin_warden_reap(process->warden, &process->role);
}

void tl_twin_process_kill(tl_twin_process *process) {
    tl_twin_warden_kill(process->warden, &process->role);
}

void tl_twin_process_let_go(tl_twin_process *process) {
    tl_twin_warden_let_go(process->warden);
    if (!process->role.has_ended) {
        process->role = (tl_role){.is_forked = process->role.is_forked, .has_ended = true, .code = -1};
    }
    tl_twin_warden_flush(process->warden);
}

bool tl_twin_process_was_killed(const tl_twin_process *process, char text[TL_TWIN_WARDEN_TEXT]) {
    return tl_twin_warden_has_killed(process->warden, text);
}

bool tl_twin_process_was_refused(const tl_twin_process *process) {
    return tl_twin_warden_has_refused(process->warden);
}

void tl_twin_process_tell(const tl_twin_process *process, tl_fmu_refusals_listener *hear, void *context) {
    tl_twin_warden_tell(process->warden, hear, context);
}

void tl_twin_process_flush(const tl_twin_process *process) {
    tl_twin_warden_flush(process->warden);
}

void tl_twin_process_close(tl_twin_process *process) {
    if (process == NULL) {
        return;
    }
    if (process->warden != NULL) {
        tl_twin_warden_kill(process->warden, &process->role);
    } else {
        tl_role_kill(&process->role);
    }
    tl_twin_warden_stop(process->warden);
    tl_block_close(&process->job);
    tl_private_folder_remove(&process->folder);
    free(process);
}
