/* Control socket: see control.h. */
#include "firmware/retune/control.h"

#include <errno.h>
#include <libgen.h>
#include <linux/magic.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/text.h"
#include "firmware/process/block.h"

/* ---- names ---- */

/* A text that a process with FMUs may have written. */
static void add_cleaned(tl_json_writer *json, const char *key, const char *text, size_t room) {
    char clean[4 * sizeof((tl_control_state *)0)->line];
    (void)tl_clean_text(text, strnlen(text, room), clean, sizeof clean);
    tl_json_add_text(json, key, clean);
}

void tl_control_add_figures(tl_json_writer *json, const tl_control_state *state) {
    add_cleaned(json, "lock", state->lock, sizeof state->lock);
    tl_json_add_number(json, "step_s", state->step_s);
    tl_json_add_count(json, "ticks", state->ticks);
    tl_json_add_count(json, "steps", state->steps);
    tl_json_add_count(json, "skipped", state->skipped);
    tl_json_add_count(json, "deadline_misses", state->deadline_misses);
    tl_json_add_number(json, "in_lock", state->in_lock);
    add_cleaned(json, "line", state->line, sizeof state->line);
}

const char *tl_control_step_name(tl_control_step step) {
    static const char *const names[TL_CONTROL_STEPS] = {
        [TL_CONTROL_IDLE] = "idle",       [TL_CONTROL_AUTHORISE] = "authorise", [TL_CONTROL_VALIDATE] = "validate",
        [TL_CONTROL_TRY] = "try",         [TL_CONTROL_PREDICT] = "predict",     [TL_CONTROL_SHADOW] = "shadow",
        [TL_CONTROL_COMPARE] = "compare", [TL_CONTROL_ACTIVATE] = "activate",   [TL_CONTROL_PROBATION] = "probation",
        [TL_CONTROL_KEPT] = "kept",       [TL_CONTROL_RETURNED] = "returned",
    };
    return names[step];
}

/* Names, and statuses whose exit codes are used (sysexits.h). */
static const struct {
    const char *name;
    tl_status status;
} results[TL_CONTROL_RESULTS] = {
    [TL_CONTROL_DONE] = {"done", TL_OK},
    [TL_CONTROL_SAME] = {"same", TL_OK},
    [TL_CONTROL_BAD] = {"bad request", TL_BAD_USAGE},
    [TL_CONTROL_FORBIDDEN] = {"forbidden", TL_OK}, /* its exit code is TL_CONTROL_NOT_PERMITTED */
    [TL_CONTROL_CHANGED] = {"changed", TL_TRY_AGAIN},
    [TL_CONTROL_INVALID] = {"invalid", TL_BAD_DATA},
    [TL_CONTROL_RESTART] = {"needs a restart", TL_BAD_USAGE},
    [TL_CONTROL_BUSY] = {"busy", TL_TRY_AGAIN},
    [TL_CONTROL_ABSENT] = {"absent", TL_PLANT_DOWN},
    [TL_CONTROL_FAILED] = {"failed", TL_TRY_AGAIN},
    [TL_CONTROL_UNDONE] = {"undone", TL_NOT_LOCKED},
    [TL_CONTROL_CANCELLED] = {"cancelled", TL_TRY_AGAIN},
};

const char *tl_control_result_name(tl_control_result result) {
    return results[result].name;
}

int tl_control_exit_code(tl_control_result result) {
    return result == TL_CONTROL_FORBIDDEN ? TL_CONTROL_NOT_PERMITTED : tl_exit_code(results[result].status);
}

tl_control_reply tl_control_new_reply(tl_control_kind kind) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = (uint32_t)kind;
    return reply;
}

tl_control_reply tl_control_new_end(tl_control_result result, uint64_t version, const char *hash, const char *text) {
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_END);
    reply.as.end.result = (uint32_t)result;
    reply.as.end.version = version;
    (void)snprintf(reply.as.end.hash, sizeof reply.as.end.hash, "%s", hash);
    (void)snprintf(reply.as.end.text, sizeof reply.as.end.text, "%s", text);
    return reply;
}

void tl_control_log_problem(const char *subject, const tl_control_problem *problem) {
    char line[32] = "";
    if (problem->line != 0) {
        (void)snprintf(line, sizeof line, "line %u: ", problem->line);
    }
    tl_log(TL_LOG_ERROR, "%s: %s%s%s%s", subject, line, problem->path, problem->path[0] == '\0' ? "" : ": ",
           problem->text);
}

/* ---- control packet ---- */

bool tl_control_packet_send(int socket, const void *bytes, size_t size, const char *text, size_t length) {
    tl_block block = {.descriptor = -1};
    if (text != NULL && tl_block_make_of("twinlock configuration", text, length, &block, NULL) != TL_OK) {
        errno = ENOMEM;
        return false;
    }
    bool is_sent = tl_packet_send(socket, bytes, size, block.descriptor);
    int code = errno;
    tl_block_close(&block);
    errno = code;
    return is_sent;
}

/* ---- receiving ---- */

/* Copies only from memory: any other file could be slow to read, or terminate the reader by a
 * signal. */
static bool copy_text(int descriptor, char *text, size_t *length) {
    struct stat about;
    struct statfs system;
    bool is_memory = fstat(descriptor, &about) == 0 && S_ISREG(about.st_mode) && fstatfs(descriptor, &system) == 0 &&
                     (unsigned long)system.f_type == TMPFS_MAGIC && about.st_size > 0 &&
                     about.st_size <= TL_CONTROL_MOST;
    ssize_t got = is_memory ? pread(descriptor, text, (size_t)about.st_size, 0) : -1;
    *length = is_memory && got == about.st_size ? (size_t)got : 0;
    text[*length] = '\0';
    return *length != 0;
}

/* Receives a packet; ASKED if it has exactly `size` bytes. `text`: gets the memory that came with
 * it, with a final NUL; it has TL_CONTROL_MOST + 1 bytes. NULL: no memory is accepted. *length:
 * bytes of the text; 0: there is none. */
static tl_control_event tl_control_packet_take(int socket, void *bytes, size_t size, char *text, size_t *length) {
    int found = -1;
    *length = 0;
    ssize_t got = tl_packet_take(socket, bytes, size, &found);
    if (got < 0 && errno != EBADMSG) {
        bool is_later = errno == EAGAIN || errno == EINTR;
        return is_later ? TL_CONTROL_NOTHING : TL_CONTROL_CLOSED;
    }
    bool is_whole = got == (ssize_t)size;
    if (found >= 0) {
        is_whole = is_whole && text != NULL && copy_text(found, text, length);
        (void)close(found);
    }
    return got == 0 ? TL_CONTROL_CLOSED : is_whole ? TL_CONTROL_REQUEST : TL_CONTROL_GARBAGE;
}

/* ---- control server ---- */

/* Connections in the queue of the listening socket. */
enum { WAITING = 16 };

/* ---- the socket ---- */

/* Only the last folder of the path is made. Access to its parent decides which users can enter it.
 */
static void make_folder(const char *path) {
    char folder[sizeof((struct sockaddr_un *)NULL)->sun_path];
    (void)snprintf(folder, sizeof folder, "%s", path);
    (void)mkdir(dirname(folder), S_IRWXU | S_IRWXG);
}

/* The socket of a process that has ended would block bind(). A socket that answers, or is too busy
 * to answer, belongs to another process. */
static void remove_stale_socket(const char *path) {
    struct stat about;
    int probe = -1;
    tl_error error;
    bool is_socket = lstat(path, &about) == 0 && S_ISSOCK(about.st_mode);
    if (is_socket && tl_control_connect(path, &probe, &error) == TL_PLANT_DOWN) {
        (void)unlink(path);
    }
    if (probe >= 0) {
        (void)close(probe);
    }
}

tl_status tl_control_listen(const char *path, int *listener, tl_error *error) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    *listener = -1;
    if (strlen(path) >= sizeof address.sun_path) {
        return tl_fail(error, TL_BAD_USAGE, "%s: too long for a socket, at most %zu bytes: use a shorter --control",
                       path, sizeof address.sun_path - 1);
    }
    memcpy(address.sun_path, path, strlen(path) + 1);
    int created = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    make_folder(path);
    remove_stale_socket(path);
    if (created < 0 || bind(created, (const struct sockaddr *)&address, sizeof address) != 0 ||
        chmod(path, S_IRUSR | S_IWUSR | S_IRGRP | S_IWGRP) != 0 || listen(created, WAITING) != 0) {
        int code = errno;
        if (created >= 0) {
            (void)close(created);
        }
        return tl_fail(error, TL_TRY_AGAIN, "%s: the control socket cannot be created: %s", path, strerror(code));
    }
    *listener = created;
    return TL_OK;
}

bool tl_control_has_connection(int listener) {
    struct pollfd waited = {.fd = listener, .events = POLLIN};
    return listener >= 0 && poll(&waited, 1, 0) > 0;
}

bool tl_control_accept(int listener, tl_control_peer *peer) {
    *peer = (tl_control_peer){.socket = accept4(listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK)};
    return peer->socket >= 0;
}

/* ---- requests ---- */

/* A text is valid only if cleaning does not change it. So an untrusted text cannot control a
 * terminal, or forge a line of a log. */
static bool is_clean(const char *text, size_t room) {
    char clean[TL_CONTROL_WHY];
    size_t length = strnlen(text, room);
    return length < room && tl_clean_text(text, length, clean, sizeof clean) == length &&
           memcmp(clean, text, length) == 0;
}

static bool is_sound(const tl_control_request *request) {
    return request->protocol == TL_CONTROL_PROTOCOL && request->verb < TL_CONTROL_VERBS &&
           request->right <= TL_RIGHT_COMMISSION && request->origin <= TL_ORIGIN_LIMITED &&
           request->flags <= TL_CONTROL_FLAGS && isfinite(request->require_lock) && request->require_lock <= 100.0 &&
           tl_identity_is_sound(request->hash) && tl_identity_is_sound(request->if_match) &&
           is_clean(request->who, sizeof request->who) && is_clean(request->why, sizeof request->why);
}

static const char OTHER_VERSION[] = "the request is invalid: client and run must have the same version of twinlock";

/* Returns the fault of a request, or NULL. */
static const char *fault_of(const tl_control_request *request, const char *text, size_t size) {
    char hash[TL_SHA256_TEXT] = "";
    if (!is_sound(request)) {
        return OTHER_VERSION;
    }
    if ((request->verb == TL_CONTROL_APPLY) != (size != 0)) {
        return "the request has no configuration, or has one that it must not have";
    }
    if (size != 0) {
        tl_sha256(text, size, hash);
    }
    return strcmp(hash, request->hash) != 0 ? "the configuration does not have the hash of the request: send it again"
                                            : NULL;
}

tl_control_event tl_control_receive(tl_control_peer *peer, tl_control_request *request, char *text, size_t *size) {
    const char *fault = OTHER_VERSION;
    switch (tl_control_packet_take(peer->socket, request, sizeof *request, text, size)) {
    case TL_CONTROL_NOTHING:
        return TL_CONTROL_NOTHING;
    case TL_CONTROL_CLOSED:
        tl_control_close(peer);
        return TL_CONTROL_CLOSED;
    case TL_CONTROL_REQUEST:
        fault = peer->has_asked ? "a connection permits one request only" : fault_of(request, text, *size);
        break;
    case TL_CONTROL_GARBAGE:
        break;
    }
    if (fault != NULL) {
        tl_control_finish(peer, TL_CONTROL_BAD, 0, "", fault);
        return TL_CONTROL_CLOSED;
    }
    peer->has_asked = true;
    return TL_CONTROL_REQUEST;
}

/* ---- replies ---- */

/* A client that does not read its replies is closed, because the server must not wait. */
bool tl_control_send(tl_control_peer *peer, const tl_control_reply *reply, const char *text) {
    if (peer->socket >= 0 && !tl_control_packet_send(peer->socket, reply, sizeof *reply, text, reply->more)) {
        tl_control_close(peer);
    }
    return peer->socket >= 0;
}

void tl_control_finish(tl_control_peer *peer, tl_control_result result, uint64_t version, const char *hash,
                       const char *text) {
    const tl_control_reply reply = tl_control_new_end(result, version, hash, text);
    (void)tl_control_send(peer, &reply, NULL);
    tl_control_close(peer);
}

void tl_control_close(tl_control_peer *peer) {
    if (peer->socket >= 0) {
        (void)close(peer->socket);
    }
    peer->socket = -1;
}

/* ---- control client ---- */

static tl_status fail_to_connect(const char *path, tl_error *error) {
    switch (errno) {
    case EACCES:
    case EPERM:
        return tl_fail(error, TL_PLANT_DOWN,
                       "%s: permission denied; for a service, become a member of the group twinlock-control: sudo "
                       "adduser $USER twinlock-control, then log in again",
                       path);
    case EAGAIN:
        return tl_fail(error, TL_TRY_AGAIN, "%s: too many clients are connected: try again", path);
    case ENOENT:
    case ECONNREFUSED:
        return tl_fail(
            error, TL_PLANT_DOWN,
            "%s: no run answers: it is restarting, is not running, or was started without --control; start it, or "
            "give its --control",
            path);
    default:
        return tl_fail(error, TL_PLANT_DOWN, "%s: %s", path, strerror(errno));
    }
}

tl_status tl_control_connect(const char *path, int *socket_, tl_error *error) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path) {
        return tl_fail(error, TL_PLANT_DOWN, "%s: too long for a socket", path);
    }
    memcpy(address.sun_path, path, strlen(path) + 1);
    *socket_ = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (*socket_ < 0) {
        return tl_fail(error, TL_TRY_AGAIN, "cannot open a socket: %s", strerror(errno));
    }
    if (connect(*socket_, (const struct sockaddr *)&address, sizeof address) != 0) {
        tl_status status = fail_to_connect(path, error);
        (void)close(*socket_);
        *socket_ = -1;
        return status;
    }
    return TL_OK;
}

tl_status tl_control_ask(int socket_, const tl_control_request *request, const char *text, size_t size,
                         tl_error *error) {
    tl_control_request whole = *request;
    whole.protocol = TL_CONTROL_PROTOCOL;
    whole.hash[0] = '\0';
    if (text != NULL) {
        tl_sha256(text, size, whole.hash);
    }
    if (!tl_control_packet_send(socket_, &whole, sizeof whole, text, size)) {
        return tl_fail(error, TL_TRY_AGAIN, "the request cannot be sent to the run: %s", strerror(errno));
    }
    return TL_OK;
}

/* ---- receiving replies ---- */

/* All texts in replies. */
#define TEXT(kind, member)                                                                                             \
    { kind, offsetof(tl_control_reply, as.member), sizeof((tl_control_reply *)NULL)->as.member }

static const struct {
    tl_control_kind kind;
    size_t at, room;
} texts[] = {
    TEXT(TL_CONTROL_STATE, state.plant),      TEXT(TL_CONTROL_STATE, state.hash),
    TEXT(TL_CONTROL_STATE, state.lock),       TEXT(TL_CONTROL_STATE, state.line),
    TEXT(TL_CONTROL_VERSION, version.hash),   TEXT(TL_CONTROL_VERSION, version.kind),
    TEXT(TL_CONTROL_VERSION, version.origin), TEXT(TL_CONTROL_VERSION, version.right),
    TEXT(TL_CONTROL_VERSION, version.who),    TEXT(TL_CONTROL_VERSION, version.why),
    TEXT(TL_CONTROL_VERSION, version.at),     TEXT(TL_CONTROL_VERSION, version.result),
    TEXT(TL_CONTROL_CHANGE, change.path),     TEXT(TL_CONTROL_CHANGE, change.before),
    TEXT(TL_CONTROL_CHANGE, change.after),    TEXT(TL_CONTROL_CHANGE, change.kind),
    TEXT(TL_CONTROL_CHANGE, change.right),    TEXT(TL_CONTROL_PROBLEM, problem.path),
    TEXT(TL_CONTROL_PROBLEM, problem.text),   TEXT(TL_CONTROL_STEP, progress.text),
    TEXT(TL_CONTROL_END, end.hash),           TEXT(TL_CONTROL_END, end.text),
};

/* Terminates all texts of a reply. Returns false if the reply is invalid. */
static bool is_sound_reply(tl_control_reply *reply) {
    uint32_t kind = reply->kind == TL_CONTROL_CONFIGURATION ? TL_CONTROL_VERSION : reply->kind;
    for (size_t i = 0; i < sizeof texts / sizeof texts[0]; i++) {
        if (texts[i].kind == kind) {
            ((char *)reply)[texts[i].at + texts[i].room - 1] = '\0';
        }
    }
    return kind < TL_CONTROL_KINDS && (kind != TL_CONTROL_STATE || reply->as.state.step < TL_CONTROL_STEPS) &&
           (kind != TL_CONTROL_STEP || reply->as.progress.step < TL_CONTROL_STEPS) &&
           (kind != TL_CONTROL_END || reply->as.end.result < TL_CONTROL_RESULTS);
}

tl_status tl_control_next(int socket_, tl_time time, tl_control_reply *reply, char *text, tl_error *error) {
    size_t length = 0;
    tl_control_event arrival = TL_CONTROL_NOTHING;
    struct pollfd waited = {.fd = socket_, .events = POLLIN};
    tl_time most = 1000 * TL_SECOND; /* the caller calls again */
    if (poll(&waited, 1, (int)(((time < most ? time : most) + 999999) / 1000000)) > 0) {
        arrival = tl_control_packet_take(socket_, reply, sizeof *reply, text, &length);
    }
    if (arrival == TL_CONTROL_NOTHING) {
        return tl_fail(error, TL_TRY_AGAIN, "the run does not answer");
    }
    if (arrival == TL_CONTROL_CLOSED) {
        return tl_fail(error, TL_PLANT_DOWN,
                       "the run closed the connection: it ended, or too many clients are connected");
    }
    bool is_text = reply->kind == TL_CONTROL_CONFIGURATION;
    if (arrival == TL_CONTROL_GARBAGE || !is_sound_reply(reply) || is_text != (length != 0) ||
        (is_text && reply->more != length)) {
        return tl_fail(error, TL_BAD_DATA,
                       "the run's reply is invalid: client and run must have the same version of twinlock");
    }
    return TL_OK;
}
