/* Asking: see control_client.h. */
#include "firmware/retune/control_client.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "firmware/retune/control_packet.h"

static tl_status fail_to_connect(const char *path, tl_error *error) {
    switch (errno) {
    case EACCES:
    case EPERM:
        return tl_fail(error, TL_PLANT_DOWN, "%s: you may not ask this plant; members of its group may", path);
    case EAGAIN:
        return tl_fail(error, TL_TRY_AGAIN, "%s: too many others ask this plant; try again", path);
    case ENOENT:
    case ECONNREFUSED:
        return tl_fail(
            error, TL_PLANT_DOWN,
            "%s: no twin answers there: it restarts just now, does not run, or was started without --control", path);
    default:
        return tl_fail(error, TL_PLANT_DOWN, "%s: %s", path, strerror(errno));
    }
}

tl_status tl_control_connect(const char *path, int *socket_, tl_error *error) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path) {
        return tl_fail(error, TL_PLANT_DOWN, "%s: no socket has so long a name", path);
    }
    memcpy(address.sun_path, path, strlen(path) + 1);
    *socket_ = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (*socket_ < 0) {
        return tl_fail(error, TL_TRY_AGAIN, "no socket: %s", strerror(errno));
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
        return tl_fail(error, TL_TRY_AGAIN, "the plant's twin does not take the request: %s", strerror(errno));
    }
    return TL_OK;
}

/* ---- what comes back ---- */

static void end_text(char *text, size_t room) {
    text[room - 1] = '\0';
}

#define END_TEXT(text) end_text(text, sizeof(text))

static void end_version(tl_control_version *version) {
    END_TEXT(version->hash);
    END_TEXT(version->kind);
    END_TEXT(version->origin);
    END_TEXT(version->right);
    END_TEXT(version->who);
    END_TEXT(version->why);
    END_TEXT(version->at);
    END_TEXT(version->result);
}

/* False: there is no such reply. All texts end afterwards. */
static bool is_sound(tl_control_reply *reply) {
    switch (reply->kind) {
    case TL_CONTROL_STATE:
        END_TEXT(reply->as.state.plant);
        END_TEXT(reply->as.state.hash);
        END_TEXT(reply->as.state.lock);
        END_TEXT(reply->as.state.line);
        return reply->as.state.step < TL_CONTROL_STEPS;
    case TL_CONTROL_VERSION:
    case TL_CONTROL_CONFIGURATION:
        end_version(&reply->as.version);
        return true;
    case TL_CONTROL_CHANGE:
        END_TEXT(reply->as.change.path);
        END_TEXT(reply->as.change.before);
        END_TEXT(reply->as.change.after);
        END_TEXT(reply->as.change.kind);
        END_TEXT(reply->as.change.right);
        return true;
    case TL_CONTROL_PROBLEM:
        END_TEXT(reply->as.problem.path);
        END_TEXT(reply->as.problem.text);
        return true;
    case TL_CONTROL_STEP:
        END_TEXT(reply->as.progress.text);
        return reply->as.progress.step < TL_CONTROL_STEPS;
    case TL_CONTROL_END:
        END_TEXT(reply->as.end.hash);
        END_TEXT(reply->as.end.text);
        return reply->as.end.result < TL_CONTROL_RESULTS;
    default:
        return false;
    }
}

static bool wait_for(int socket_, tl_time time) {
    struct pollfd waited = {.fd = socket_, .events = POLLIN};
    int most = time > (tl_time)1000000 * 1000000 ? 1000000 : (int)((time + 999999) / 1000000);
    return poll(&waited, 1, most) > 0;
}

tl_status tl_control_next(int socket_, tl_time time, tl_control_reply *reply, char *text, tl_error *error) {
    size_t length = 0;
    tl_control_arrival arrival = TL_CONTROL_NONE;
    if (wait_for(socket_, time)) {
        arrival = tl_control_packet_take(socket_, reply, sizeof *reply, text, &length);
    }
    if (arrival == TL_CONTROL_NONE) {
        return tl_fail(error, TL_TRY_AGAIN, "the plant's twin does not answer");
    }
    if (arrival == TL_CONTROL_CLOSED) {
        return tl_fail(error, TL_PLANT_DOWN, "the plant's twin has hung up: it ended, or too many others ask");
    }
    bool is_text = reply->kind == TL_CONTROL_CONFIGURATION;
    if (arrival == TL_CONTROL_GARBAGE || !is_sound(reply) || is_text != (length != 0) ||
        (is_text && reply->more != length)) {
        return tl_fail(error, TL_BAD_DATA, "the plant's twin answers what is no answer: it is of another version");
    }
    return TL_OK;
}
