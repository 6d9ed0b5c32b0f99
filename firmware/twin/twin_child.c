/* The twin in a process of its own, from the other side: see twin_child.h. */
#include "firmware/twin/twin_child.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/process/interrupt.h"
#include "firmware/process/private_folder.h"
#include "firmware/process/role.h"
#include "firmware/twin/twin_warden.h"
#include "firmware/twin/twin_wire.h"

/* How long it sleeps at most before it looks whether the process is alive. */
static const tl_time LOOK = TL_SECOND / 10;

/* What is not a call of an FMU, such as to unpack one, may take so many times what a call may. */
enum { SILENT_CALLS = 10 };

static const uint64_t MIB = UINT64_C(1024) * 1024;

/* Threads of an honest FMU: an interpreter has a handful, a numeric library one for each processor. */
enum { THREADS = 1024, FILES = TL_FMU_ENTRIES };

struct tl_twin_child {
    tl_twin_child_settings settings;
    tl_private_folder folder;
    uint32_t user; /* of its own; 0: ours */
    tl_channel_settings wire;
    tl_block job;
    tl_block blocks[TL_SIDES];
    tl_channel channel;
    const tl_twin_extra *extra;
    tl_role role;
    tl_twin_warden *warden;
    tl_time silence; /* for how long it has neither said anything nor called an FMU */
    bool has_ended;  /* it has said its last word */
    bool stopping;
    tl_status last_status;
    tl_error last_error;
    int64_t least_step; /* that a record may be of */
    union {
        unsigned char packed[TL_TWIN_PACKED]; /* a result */
        tl_confine_facts facts;
        tl_twin_word word;
    } payload; /* of a message, copied */
};

/* ---- how it ended ---- */

/* What a process with FMUs has written is shown as it is only if it is text. */
static void copy_text(char *to, size_t size, const char *from) {
    size_t length = strnlen(from, size - 1);
    memcpy(to, from, length);
    to[length] = '\0';
    for (char *c = to; *c != '\0'; c++) {
        bool is_control = (unsigned char)*c < ' ' || *c == '\x7f' ||
                          ((unsigned char)*c == 0xC2U && (unsigned char)c[1] >= 0x80U && (unsigned char)c[1] < 0xA0U);
        *c = is_control ? ' ' : *c;
    }
}

static void describe_place(const tl_twin_child *child, char *text, size_t size) {
    tl_fmu_call call;
    if (tl_fmu_calls_look(&child->extra->calls, &call)) {
        (void)snprintf(text, size, "in %s of FMU %s", call.function, call.fmu);
    } else {
        (void)snprintf(text, size, "while no FMU was being called");
    }
}

/* It has ended, and should not have. */
static tl_status describe_end(tl_twin_child *child, tl_error *error) {
    char why[TL_TWIN_WARDEN_TEXT];
    char place[160];
    tl_twin_warden_flush(child->warden);
    if (tl_twin_warden_has_killed(child->warden, why)) {
        return tl_fail(error, TL_FMU_FAILED, "%s", why);
    }
    describe_place(child, place, sizeof place);
    if (child->role.signal == SIGSYS) {
        return tl_fail(error, TL_FMU_FAILED,
                       "the process of the FMUs was killed by the kernel %s: it reached for another process, or used "
                       "calls of another machine",
                       place);
    }
    if (child->role.signal != 0) {
        return tl_fail(error, TL_FMU_FAILED, "the process of the FMUs was ended by signal %d (%s), %s",
                       child->role.signal, strsignal(child->role.signal), place);
    }
    return tl_fail(error, TL_FMU_FAILED, "the process of the FMUs ended unannounced, with exit code %d, %s",
                   child->role.code, place);
}

/* Ends it: it has said what nobody says. */
static tl_status end_liar(tl_twin_child *child, const char *what, tl_error *error) {
    char place[160];
    describe_place(child, place, sizeof place);
    tl_twin_warden_kill(child->warden, &child->role);
    return tl_fail(error, TL_FMU_FAILED, "the process of the FMUs was killed, since its memory was destroyed %s: %s",
                   place, what);
}

/* ---- messages ---- */

/* Nobody interrupts it but us. */
static tl_status take_word(tl_twin_child *child, tl_message type) {
    unsigned told = (unsigned)child->payload.word.status;
    bool is_possible = told < TL_INTERRUPTED || (told == TL_INTERRUPTED && tl_interrupt_requested() != NULL);
    child->last_status = is_possible ? (tl_status)told : TL_FMU_FAILED;
    child->last_error.status = child->last_status;
    copy_text(child->last_error.text, sizeof child->last_error.text, child->extra->error);
    child->has_ended = type == TL_MESSAGE_ENDED;
    return TL_OK;
}

/* Sleeps until `wanted` messages are there, or for `longest`. False: the process has said nothing, and called no FMU, for so long that nothing will
 * come any more; it is killed. The warden looks at calls of FMUs, but whose memory is destroyed may have none. */
static bool rest(tl_twin_child *child, unsigned wanted, tl_time longest) {
    tl_fmu_call call;
    tl_time begun = tl_clock_now(NULL);
    (void)tl_channel_wait(&child->channel, wanted, 0, begun + longest);
    tl_time passed = tl_clock_now(NULL) - begun;
    passed = passed > TL_SECOND ? TL_SECOND : passed; /* who was stopped was not silent */
    child->silence = tl_fmu_calls_look(&child->extra->calls, &call) ? 0 : child->silence + passed;
    return child->settings.call_limit == 0 || child->silence < SILENT_CALLS * child->settings.call_limit;
}

static tl_status end_silent(tl_twin_child *child, tl_error *error) {
    tl_twin_warden_kill(child->warden, &child->role);
    return tl_fail(error, TL_FMU_FAILED, "the process of the FMUs was killed: for %.0f s it has done nothing",
                   tl_seconds(child->silence));
}

/* The next message, in child->payload. TL_OK, or TL_FMU_FAILED: the process is at its end. */
static tl_status next_message(tl_twin_child *child, unsigned wanted, tl_message *type, tl_error *error) {
    for (;;) {
        switch (tl_channel_take(&child->channel, type, &child->payload)) {
        case TL_CHANNEL_SOMETHING:
            child->silence = 0;
            return *type == TL_MESSAGE_RESULT || *type == TL_MESSAGE_READY ? TL_OK : take_word(child, *type);
        case TL_CHANNEL_BROKEN:
            return end_liar(child, child->channel.fault.text, error);
        case TL_CHANNEL_NOTHING:
        case TL_CHANNEL_NUDGED:
            break;
        }
        if (tl_interrupt_requested() != NULL) {
            tl_twin_child_stop(child);
        }
        /* What it has sent before its end is taken first. */
        if (child->role.has_ended) {
            return describe_end(child, error);
        }
        if (!tl_twin_warden_reap(child->warden, &child->role) && !rest(child, wanted, LOOK)) {
            return end_silent(child, error);
        }
    }
}

static tl_status expect(tl_twin_child *child, tl_message wanted, tl_error *error) {
    tl_message type = wanted;
    tl_status status = next_message(child, 1, &type, error);
    if (status == TL_OK && type != wanted) {
        status = end_liar(child, "a message came before its time", error);
    }
    return status;
}

/* Until then no FMU is loaded: what the process ends with is what it means, and why was said on the log. */
static tl_status expect_ready(tl_twin_child *child, tl_error *error) {
    tl_status status = expect(child, TL_MESSAGE_READY, error);
    bool ended = status != TL_OK && child->role.has_ended && child->role.signal == 0;
    if (ended && child->role.code == tl_exit_code(TL_TRY_AGAIN)) {
        return tl_fail(error, TL_TRY_AGAIN, "the process of the FMUs could not begin; try again");
    }
    return status;
}

/* ---- start ---- */

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

static tl_status make_blocks(tl_twin_child *child, tl_error *error) {
    static const tl_block_writer writers[TL_SIDES] = {
        [TL_PARENT] = TL_BLOCK_WE_WRITE, [TL_CHILD] = TL_BLOCK_THEY_WRITE};
    child->wire = tl_twin_wire(child->settings.config, child->settings.job->tells);
    tl_status status = TL_OK;
    for (tl_side side = TL_PARENT; side < TL_SIDES && status == TL_OK; side++) {
        status =
            tl_block_make("twinlock", tl_channel_bytes(&child->wire, side), writers[side], &child->blocks[side], error);
    }
    if (status == TL_OK) {
        void *const bytes[TL_SIDES] = {child->blocks[TL_PARENT].bytes, child->blocks[TL_CHILD].bytes};
        child->extra = tl_channel_extra(&child->wire, TL_CHILD, child->blocks[TL_CHILD].bytes);
        tl_channel_open(&child->wire, TL_PARENT, bytes, &child->channel);
    }
    return status;
}

/* What the archives of these FMUs may unpack to (fmu_archive.h). */
static uint64_t unpacked_bytes(const tl_config *config) {
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
    return sum;
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

/* Started as root, it gets a user that nobody else has: numbers that systemd leaves to nobody, and one process at a time. Where that user could
 * not come to its folder, it stays root without root's capabilities. */
static uint32_t private_user(void) {
    const char *folder = getenv("TMPDIR");
    tl_confine_facts facts;
    tl_confine_probe(&facts);
    bool possible =
        geteuid() == 0 && facts.user && is_open_to_others(folder == NULL || folder[0] == '\0' ? "/tmp" : folder);
    return possible ? 0x70000000U + (uint32_t)getpid() : 0;
}

/* Bytes. */
static uint64_t memory_limit(const tl_twin_child *child) {
    return child->settings.memory_limit != 0 ? child->settings.memory_limit : tl_confine_fair_memory();
}

static tl_status make_job(tl_twin_child *child, tl_error *error) {
    tl_twin_job job = *child->settings.job;
    job.folder = child->folder.path;
    job.memory = memory_limit(child);
    job.user = child->user;
    job.file_bytes = TL_FMU_ENTRY_BYTES; /* which may be unpacked; the warden looks at what they write together */
    return tl_twin_job_make(&job, &child->job, error);
}

/* In place of an execution, where there is none. */
static int run_forked(const char *title, void *context) {
    const tl_twin_child *child = context;
    (void)title;
    return tl_twin_role_run(child->settings.print_page);
}

enum { VARIABLE = PATH_MAX + 32 };

/* What is added to the environment of the process. */
typedef struct surroundings {
    char temporary[VARIABLE];
    char home[VARIABLE];
    char packages[VARIABLE];
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
static void surround(const tl_twin_child *child, surroundings *made) {
    made->count = 0;
    (void)snprintf(made->temporary, sizeof made->temporary, "TMPDIR=%s", child->folder.path);
    made->variables[made->count++] = made->temporary;
    if (child->settings.job->unconfined) {
        return;
    }
    (void)snprintf(made->home, sizeof made->home, "HOME=%s", child->folder.path);
    made->variables[made->count++] = made->home;
    made->variables[made->count++] = "PYTHONDONTWRITEBYTECODE=1";
    if (find_packages(made->packages)) {
        made->variables[made->count++] = made->packages;
    }
}

static tl_status start_process(tl_twin_child *child, const pipes *ends, tl_error *error) {
    char title[TL_ROLE_TITLE];
    surroundings around;
    surround(child, &around);
    (void)snprintf(title, sizeof title, "twin [%s]", child->settings.config->name);
    const tl_role_settings settings = {
        .title = title,
        .descriptors = {ends->nothing, ends->output[1], ends->output[1], ends->page[1], child->job.descriptor,
                        child->blocks[TL_PARENT].descriptor, child->blocks[TL_CHILD].descriptor, ends->start[1]},
        .variables = around.variables,
        .variable_count = around.count,
        .fallback = run_forked,
        .context = child,
    };
    return tl_role_start(&settings, &child->role, error);
}

/* The descriptor that tells of refused calls; -1: the kernel has none, or nothing is refused. Waits until the process has sent it, or its end of
 * the socket is closed. */
static int receive_listener(int socket) {
    char byte = 0;
    struct iovec content = {.iov_base = &byte, .iov_len = 1};
    union {
        struct cmsghdr aligned;
        char bytes[CMSG_SPACE(sizeof(int))];
    } control = {.bytes = {0}};
    struct msghdr message = {
        .msg_iov = &content, .msg_iovlen = 1, .msg_control = control.bytes, .msg_controllen = sizeof control};
    int listener = -1;
    ssize_t length = 0;
    do {
        length = recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
    } while (length < 0 && errno == EINTR);
    const struct cmsghdr *header = length > 0 ? CMSG_FIRSTHDR(&message) : NULL;
    if (header != NULL && header->cmsg_level == SOL_SOCKET && header->cmsg_type == SCM_RIGHTS &&
        header->cmsg_len == CMSG_LEN(sizeof listener)) {
        memcpy(&listener, CMSG_DATA(header), sizeof listener);
    }
    return listener;
}

static tl_status start_warden(tl_twin_child *child, pipes *ends, tl_error *error) {
    const tl_twin_warden_settings settings = {
        .process = child->role.pid,
        .output = ends->output[0],
        .page = ends->page[0],
        .page_file = child->settings.page,
        .calls = &child->extra->calls,
        .channel = &child->channel,
        .call_limit = child->settings.call_limit,
        .bounds = {.folder = child->folder.path,
                   .bytes = TL_TWIN_FOLDER_MIB * MIB + unpacked_bytes(child->settings.config),
                   .files = FILES * (child->settings.config->component_count + 1),
                   .threads = THREADS,
                   .memory = memory_limit(child)},
    };
    ends->output[0] = -1;
    ends->page[0] = -1;
    return tl_twin_warden_start(&settings, &child->warden, error);
}

/* What is not held is said once, at the start. */
static void say_confinement(const tl_twin_child *child) {
    char text[TL_CONFINE_TEXT];
    if (child->settings.job->unconfined) {
        tl_log(TL_LOG_WARNING, "unconfined: FMUs can do what this user can");
        return;
    }
    tl_confine_describe(&child->payload.facts, text);
    if (text[0] != '\0') {
        tl_log(TL_LOG_NOTICE, "%s", text);
    }
}

/* Root of a container may have numbers of users only for some, and no right to give a folder away. Then it stays who it is. */
static tl_status make_folder(tl_twin_child *child, tl_error *error) {
    child->user = child->settings.job->unconfined ? 0 : private_user();
    if (child->user != 0 && tl_private_folder_make("twin", child->user, &child->folder, error) != TL_OK) {
        child->user = 0;
    }
    return child->user != 0 ? TL_OK : tl_private_folder_make("twin", 0, &child->folder, error);
}

static tl_status start(tl_twin_child *child, pipes *ends, tl_error *error) {
    tl_status status = make_folder(child, error);
    if (status == TL_OK) {
        status = make_blocks(child, error);
    }
    if (status == TL_OK) {
        status = make_job(child, error);
    }
    if (status == TL_OK) {
        status = open_pipes(ends, child->settings.page != NULL, error);
    }
    if (status == TL_OK) {
        status = start_process(child, ends, error);
    }
    if (status == TL_OK) {
        status = start_warden(child, ends, error);
    }
    if (status != TL_OK) {
        return status;
    }
    close_one(&ends->output[1]);
    close_one(&ends->page[1]);
    close_one(&ends->start[1]);
    tl_twin_warden_listen_at(child->warden, receive_listener(ends->start[0]));
    status = expect_ready(child, error);
    if (status == TL_OK) {
        say_confinement(child);
    }
    return status;
}

tl_status tl_twin_child_start(const tl_twin_child_settings *settings, tl_twin_child **child, tl_error *error) {
    tl_twin_child *made = calloc(1, sizeof *made);
    pipes ends = {{-1, -1}, {-1, -1}, {-1, -1}, -1};
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the process of the FMUs");
    }
    made->settings = *settings;
    tl_status status = start(made, &ends, error);
    close_pipes(&ends);
    if (status != TL_OK) {
        tl_twin_child_close(made);
        return status;
    }
    *child = made;
    return TL_OK;
}

/* ---- work ---- */

static tl_status take_account(tl_twin_child *child, tl_account *account, tl_error *error) {
    *account = child->extra->account;
    bool fits = account->components == child->settings.config->component_count + 1 &&
                account->matches == child->settings.config->match_count &&
                account->adjusts == child->settings.config->adjust_count;
    return fits && tl_account_is_sound(account) ? TL_OK : end_liar(child, "its account is none", error);
}

tl_status tl_twin_child_build(tl_twin_child *child, tl_account *account, tl_error *error) {
    tl_status status = expect(child, TL_MESSAGE_BUILT, error);
    if (status != TL_OK) {
        return status;
    }
    tl_twin_warden_flush(child->warden);
    if (child->last_status != TL_OK) {
        *error = child->last_error;
        return child->last_status;
    }
    return take_account(child, account, error);
}

tl_status tl_twin_child_check(tl_twin_child *child, tl_error *error) {
    tl_status status = expect(child, TL_MESSAGE_BUILT, error);
    if (status == TL_OK) {
        status = expect(child, TL_MESSAGE_ENDED, error);
    }
    if (status != TL_OK) {
        return status;
    }
    tl_twin_warden_flush(child->warden);
    *error = child->last_error;
    return child->last_status;
}

void tl_twin_child_tell(tl_twin_child *child, tl_fmu_refusals_listener *hear, void *context) {
    tl_twin_warden_tell(child->warden, hear, context);
}

tl_status tl_twin_child_give(tl_twin_child *child, const tl_recording_tick *tick, bool last, tl_error *error) {
    if (child->stopping) {
        return TL_OK; /* it would be passed over */
    }
    unsigned char packed[TL_TWIN_PACKED];
    tl_twin_pack_tick(child->settings.config, tick, packed);
    if (!tl_channel_offer(&child->channel, last ? TL_MESSAGE_FINISH : TL_MESSAGE_TICK, packed)) {
        return end_liar(child, child->channel.fault.text, error);
    }
    return TL_OK;
}

void tl_twin_child_push(tl_twin_child *child) {
    tl_channel_push(&child->channel);
}

void tl_twin_child_stop(tl_twin_child *child) {
    if (!child->stopping) {
        child->stopping = true;
        while (!tl_channel_offer(&child->channel, TL_MESSAGE_END, NULL) && child->channel.fault.status == TL_OK &&
               !tl_twin_warden_reap(child->warden, &child->role)) {
            (void)tl_channel_wait(&child->channel, TL_CHANNEL_DEPTH, 1, tl_clock_now(NULL) + LOOK);
        }
        tl_channel_push(&child->channel);
    }
}

/* It has said its last word. Unasked it does so only if it can go on no more; else a run would look shorter than it was to be. */
static tl_status take_last_word(tl_twin_child *child, bool *stopped, tl_error *error) {
    *stopped = true;
    if (child->last_status != TL_OK) {
        *error = child->last_error;
        return child->last_status;
    }
    return child->stopping ? TL_OK : end_liar(child, "it ended before it was told to", error);
}

tl_status tl_twin_child_take(tl_twin_child *child, int64_t tick, unsigned wanted, tl_twin_result *result, bool *stopped,
                             tl_error *error) {
    tl_message type = TL_MESSAGE_RESULT;
    tl_status status = child->has_ended ? TL_OK : next_message(child, wanted, &type, error);
    if (status != TL_OK) {
        return status;
    }
    *stopped = false;
    if (child->has_ended) {
        return take_last_word(child, stopped, error);
    }
    if (type != TL_MESSAGE_RESULT) {
        return end_liar(child, "a message came before its time", error);
    }
    tl_twin_unpack_result(child->settings.config, child->settings.job->tells, child->payload.packed, result);
    if (!tl_twin_result_is_sound(result, child->settings.config, tick, child->least_step)) {
        result->tick = TL_TWIN_NO_TICK;
        return end_liar(child, "a result is none", error);
    }
    child->least_step = result->ready != 0 ? result->record.step + 1 : child->least_step;
    if (result->status != (int32_t)TL_OK) {
        copy_text(error->text, sizeof error->text, child->extra->error);
        error->status = (tl_status)result->status;
        if (error->text[0] == '\0') {
            return tl_fail(error, error->status, "a step failed, and the process of the FMUs does not say why");
        }
    }
    return (tl_status)result->status;
}

/* ---- end ---- */

/* What is computed still, and not taken any more, is passed over. */
static tl_status wait_for_last_word(tl_twin_child *child, tl_error *error) {
    tl_status status = TL_OK;
    tl_message type = TL_MESSAGE_RESULT;
    while (status == TL_OK && !child->has_ended) {
        status = next_message(child, 1, &type, error);
    }
    return status;
}

static tl_status wait_for_end(tl_twin_child *child, tl_error *error) {
    child->silence = 0;
    while (!tl_twin_warden_reap(child->warden, &child->role)) {
        if (!rest(child, TL_CHANNEL_DEPTH, LOOK / 20)) {
            return end_silent(child, error);
        }
    }
    return child->role.signal == 0 && child->role.code == 0 ? TL_OK : describe_end(child, error);
}

tl_status tl_twin_child_end(tl_twin_child *child, tl_account *account, tl_error *error) {
    if (child->role.has_ended) {
        return TL_OK; /* and it was told how */
    }
    tl_twin_child_stop(child);
    tl_status status = wait_for_last_word(child, error);
    if (status == TL_OK && account != NULL) {
        status = take_account(child, account, error);
    }
    return status;
}

bool tl_twin_child_was_refused(const tl_twin_child *child) {
    return tl_twin_warden_has_refused(child->warden);
}

bool tl_twin_child_is_gone(const tl_twin_child *child) {
    return child->role.has_ended;
}

tl_status tl_twin_child_wait(tl_twin_child *child, tl_error *error) {
    return child->role.has_ended ? TL_OK : wait_for_end(child, error);
}

void tl_twin_child_close(tl_twin_child *child) {
    if (child == NULL) {
        return;
    }
    if (child->warden != NULL) {
        tl_twin_warden_kill(child->warden, &child->role);
    } else {
        tl_role_kill(&child->role);
    }
    tl_twin_warden_stop(child->warden);
    tl_block_close(&child->job);
    tl_block_close(&child->blocks[TL_PARENT]);
    tl_block_close(&child->blocks[TL_CHILD]);
    tl_private_folder_remove(&child->folder);
    free(child);
}
