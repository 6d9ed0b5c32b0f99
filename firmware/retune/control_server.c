/* Answering: see control_server.h. */
#include "firmware/retune/control_server.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "firmware/base/clean_text.h"
#include "firmware/retune/control_packet.h"

/* Connections that nobody has accepted yet. */
enum { WAITING = 16 };

/* ---- the socket ---- */

/* A dead one is in the way of bind(); one that answers is somebody else's. */
static bool is_living(const struct sockaddr_un *address) {
    int probe = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    bool is = probe >= 0 && (connect(probe, (const struct sockaddr *)address, sizeof *address) == 0 || errno == EAGAIN);
    if (probe >= 0) {
        (void)close(probe);
    }
    return is;
}

/* The last folder of its name; whoever may enter the one above decides who may enter this. */
static void make_folder(const char *path) {
    char folder[sizeof((struct sockaddr_un *)NULL)->sun_path];
    (void)snprintf(folder, sizeof folder, "%s", path);
    char *end = strrchr(folder, '/');
    if (end != NULL && end != folder) {
        *end = '\0';
        (void)mkdir(folder, S_IRWXU | S_IRWXG);
    }
}

static void remove_dead(const struct sockaddr_un *address) {
    struct stat about;
    if (lstat(address->sun_path, &about) == 0 && S_ISSOCK(about.st_mode) && !is_living(address)) {
        (void)unlink(address->sun_path);
    }
}

tl_status tl_control_listen(const char *path, int *listener, tl_error *error) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    *listener = -1;
    if (strlen(path) >= sizeof address.sun_path) {
        return tl_fail(error, TL_BAD_USAGE, "%s: no socket can have so long a name; give --control a shorter one",
                       path);
    }
    memcpy(address.sun_path, path, strlen(path) + 1);
    int made = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    make_folder(path);
    remove_dead(&address);
    if (made < 0 || bind(made, (const struct sockaddr *)&address, sizeof address) != 0 ||
        chmod(path, S_IRUSR | S_IWUSR | S_IRGRP | S_IWGRP) != 0 || listen(made, WAITING) != 0) {
        int code = errno;
        if (made >= 0) {
            (void)close(made);
        }
        return tl_fail(error, TL_TRY_AGAIN, "the control socket %s cannot be made: %s", path, strerror(code));
    }
    *listener = made;
    return TL_OK;
}

bool tl_control_is_knocked_at(int listener) {
    struct pollfd waited = {.fd = listener, .events = POLLIN};
    return listener >= 0 && poll(&waited, 1, 0) > 0;
}

bool tl_control_accept(int listener, tl_control_peer *peer) {
    struct ucred who = {0};
    socklen_t size = sizeof who;
    *peer = (tl_control_peer){.socket = accept4(listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK)};
    if (peer->socket < 0) {
        return false;
    }
    if (getsockopt(peer->socket, SOL_SOCKET, SO_PEERCRED, &who, &size) != 0) {
        tl_control_close(peer);
        return false;
    }
    peer->user = who.uid;
    peer->process = who.pid;
    return true;
}

/* ---- requests ---- */

/* Its bytes are as they are shown: a stranger's words cannot command a terminal, nor forge a line of a log. */
static bool is_clean(const char *text, size_t room) {
    char clean[TL_CONTROL_WHY];
    size_t length = strnlen(text, room);
    return length < room && tl_clean_text(text, length, clean, sizeof clean) == length &&
           memcmp(clean, text, length) == 0;
}

static bool is_hash(const char text[TL_SHA256_TEXT]) {
    return text[0] == '\0' || (strnlen(text, TL_SHA256_TEXT) == TL_SHA256_TEXT - 1 &&
                               strspn(text, "0123456789abcdef") == TL_SHA256_TEXT - 1);
}

static bool is_sound(const tl_control_request *request) {
    return request->protocol == TL_CONTROL_PROTOCOL && request->verb < TL_CONTROL_VERBS &&
           request->right < TL_CONTROL_RIGHTS && request->origin < TL_CONTROL_ORIGINS &&
           request->flags <= TL_CONTROL_FLAGS && isfinite(request->require_lock) && request->require_lock <= 100.0 &&
           is_hash(request->hash) && is_hash(request->if_match) && is_clean(request->who, sizeof request->who) &&
           is_clean(request->why, sizeof request->why);
}

/* What is wrong with what came, or NULL. */
static const char *fault_of(const tl_control_request *request, const char *text, size_t size) {
    char hash[TL_SHA256_TEXT] = "";
    if (!is_sound(request)) {
        return "the request is none: twinlock is of another version there";
    }
    if ((request->verb == TL_CONTROL_TAKE) != (size != 0)) {
        return "the request comes without a configuration, or with one that nobody asked for";
    }
    if (size != 0) {
        tl_sha256(text, size, hash);
    }
    return strcmp(hash, request->hash) != 0 ? "the configuration is not the one that was sent" : NULL;
}

tl_control_news tl_control_receive(tl_control_peer *peer, tl_control_request *request, char *text, size_t *size) {
    switch (tl_control_packet_take(peer->socket, request, sizeof *request, text, size)) {
    case TL_CONTROL_NONE:
        return TL_CONTROL_NOTHING;
    case TL_CONTROL_CLOSED:
        tl_control_close(peer);
        return TL_CONTROL_GONE;
    case TL_CONTROL_GARBAGE:
        tl_control_finish(peer, TL_CONTROL_BAD, 0, "", "the request is none: twinlock is of another version there");
        return TL_CONTROL_GONE;
    case TL_CONTROL_PACKET:
        break;
    }
    const char *fault = peer->has_asked ? "one request for each connection" : fault_of(request, text, *size);
    if (fault != NULL) {
        tl_control_finish(peer, TL_CONTROL_BAD, 0, "", fault);
        return TL_CONTROL_GONE;
    }
    peer->has_asked = true;
    return TL_CONTROL_ASKED;
}

/* ---- replies ---- */

/* Nobody waits for a client that does not take what we say. */
bool tl_control_send(tl_control_peer *peer, const tl_control_reply *reply) {
    if (peer->socket >= 0 && !tl_control_packet_send(peer->socket, reply, sizeof *reply, NULL, 0)) {
        tl_control_close(peer);
    }
    return peer->socket >= 0;
}

bool tl_control_send_text(tl_control_peer *peer, const tl_control_version *version, const char *text, size_t size) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = TL_CONTROL_CONFIGURATION;
    reply.more = (uint32_t)size;
    reply.as.version = *version;
    if (peer->socket >= 0 && !tl_control_packet_send(peer->socket, &reply, sizeof reply, text, size)) {
        tl_control_close(peer);
    }
    return peer->socket >= 0;
}

void tl_control_finish(tl_control_peer *peer, tl_control_result result, uint64_t version, const char *hash,
                       const char *text) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = TL_CONTROL_END;
    reply.as.end.result = result;
    reply.as.end.version = version;
    (void)snprintf(reply.as.end.hash, sizeof reply.as.end.hash, "%s", hash);
    (void)snprintf(reply.as.end.text, sizeof reply.as.end.text, "%s", text);
    (void)tl_control_send(peer, &reply);
    tl_control_close(peer);
}

void tl_control_close(tl_control_peer *peer) {
    if (peer->socket >= 0) {
        (void)close(peer->socket);
    }
    peer->socket = -1;
}
