/* A plant without a twin, for tests of clients. It runs until SIGTERM:
 * control_plant SOCKET CONFIGURATION
 *
 * It uses the product's server side of a control socket and keeps versions. A word in the text of a
 * candidate selects its result: "invalid", "commission", "restart", "busy", "fails", "returns",
 * "silent" (no reply after the first step), "dies" (closes the socket there), "waits" (2 s of
 * probation). It prints each request as a line. */
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/process/interrupt.h"
#include "firmware/retune/control.h"

enum { VERSIONS = 8, TURN_MS = 20 };

typedef struct version {
    tl_control_version about;
    char *text;
    size_t size;
} version;

typedef struct client {
    tl_control_peer peer;
    bool is_there;
    bool waits; /* until the probation ends */
    bool returns;
} client;

static version versions[VERSIONS];
static size_t count;
static size_t active;
static bool is_on_probation;
static tl_time probation_ends;
static client clients[TL_CONTROL_CLIENTS];
static char room[TL_CONTROL_MOST + 1];

/* ---- replies ---- */

static tl_control_reply reply_of(tl_control_kind kind) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = kind;
    return reply;
}

static void say_step(tl_control_peer *peer, tl_control_step step, const char *text) {
    tl_control_reply reply = reply_of(TL_CONTROL_STEP);
    reply.as.progress.step = step;
    (void)snprintf(reply.as.progress.text, sizeof reply.as.progress.text, "%s", text);
    (void)tl_control_send(peer, &reply, NULL);
}

static void say_problem(tl_control_peer *peer, uint32_t line, const char *path, const char *text) {
    tl_control_reply reply = reply_of(TL_CONTROL_PROBLEM);
    reply.as.problem.line = line;
    (void)snprintf(reply.as.problem.path, sizeof reply.as.problem.path, "%s", path);
    (void)snprintf(reply.as.problem.text, sizeof reply.as.problem.text, "%s", text);
    (void)tl_control_send(peer, &reply, NULL);
}

static void say_change(tl_control_peer *peer) {
    tl_control_reply reply = reply_of(TL_CONTROL_CHANGE);
    (void)snprintf(reply.as.change.path, sizeof reply.as.change.path, "synchronise.match[0].tolerance");
    (void)snprintf(reply.as.change.before, sizeof reply.as.change.before, "1");
    (void)snprintf(reply.as.change.after, sizeof reply.as.change.after, "2");
    (void)snprintf(reply.as.change.kind, sizeof reply.as.change.kind, "in place");
    (void)snprintf(reply.as.change.right, sizeof reply.as.change.right, "retune");
    (void)tl_control_send(peer, &reply, NULL);
}

static void finish(tl_control_peer *peer, tl_control_result result, const char *text) {
    const tl_control_version *about = &versions[active].about;
    tl_control_finish(peer, result, about->version, about->hash, text);
}

/* ---- versions ---- */

static void keep(const char *text, size_t size, const tl_control_request *request) {
    if (count == VERSIONS) {
        free(versions[0].text);
        memmove(&versions[0], &versions[1], (VERSIONS - 1) * sizeof versions[0]);
        count--;
        active -= active > 0 ? 1 : 0;
    }
    version *made = &versions[count];
    *made = (version){.size = size, .text = malloc(size)};
    if (made->text == NULL) {
        abort();
    }
    memcpy(made->text, text, size);
    tl_sha256(text, size, made->about.hash);
    made->about.version = count == 0 ? 1 : versions[count - 1].about.version + 1;
    made->about.parent = count == 0 ? 0 : versions[active].about.version;
    (void)snprintf(made->about.kind, sizeof made->about.kind, "in place");
    (void)snprintf(made->about.who, sizeof made->about.who, "%s", request == NULL ? "" : request->who);
    (void)snprintf(made->about.why, sizeof made->about.why, "%s", request == NULL ? "" : request->why);
    active = count;
    count++;
}

/* Returns the index of a version, or `count` if it does not exist. */
static size_t find(uint64_t number) {
    size_t place = 0;
    while (place < count && versions[place].about.version != number) {
        place++;
    }
    return place;
}

/* ---- requests ---- */

static void show(tl_control_peer *peer) {
    tl_control_reply reply = reply_of(TL_CONTROL_STATE);
    tl_control_state *state = &reply.as.state;
    (void)snprintf(state->plant, sizeof state->plant, "motor");
    (void)snprintf(state->hash, sizeof state->hash, "%s", versions[active].about.hash);
    (void)snprintf(state->lock, sizeof state->lock, "locked");
    (void)snprintf(state->line, sizeof state->line, "locked, \x1b[31mred\x1b[0m and \xff");
    state->version = versions[active].about.version;
    state->step = is_on_probation ? TL_CONTROL_PROBATION : TL_CONTROL_IDLE;
    state->step_s = 0.01;
    state->ticks = UINT64_C(4000000000);
    state->in_lock = 99.5;
    (void)tl_control_send(peer, &reply, NULL);
    finish(peer, TL_CONTROL_DONE, "");
}

static void read_one(tl_control_peer *peer, const tl_control_request *request) {
    size_t place = request->version == 0 ? active : find(request->version);
    tl_control_reply reply = reply_of(TL_CONTROL_CONFIGURATION);
    if (place == count) {
        finish(peer, TL_CONTROL_ABSENT, "version not found");
        return;
    }
    reply.as.version = versions[place].about;
    reply.more = (uint32_t)versions[place].size;
    if (tl_control_send(peer, &reply, versions[place].text)) {
        finish(peer, TL_CONTROL_DONE, "");
    }
}

static void list(tl_control_peer *peer) {
    for (size_t i = count; i-- > 0;) {
        tl_control_reply reply = reply_of(TL_CONTROL_VERSION);
        reply.as.version = versions[i].about;
        reply.as.version.is_active = i == active;
        (void)tl_control_send(peer, &reply, NULL);
    }
    finish(peer, TL_CONTROL_DONE, "");
}

static void bring_back(tl_control_peer *peer, const tl_control_request *request) {
    if ((request->flags & TL_CONTROL_ONLY_PENDING) != 0 && !is_on_probation) {
        finish(peer, TL_CONTROL_ABSENT, "no change");
        return;
    }
    size_t place = request->version != 0 ? find(request->version) : active > 0 ? active - 1 : count;
    if (place == count) {
        finish(peer, TL_CONTROL_ABSENT, "version not found");
        return;
    }
    say_step(peer, TL_CONTROL_ACTIVATE, "the version before");
    active = place;
    is_on_probation = is_on_probation && (request->flags & TL_CONTROL_ONLY_PENDING) == 0;
    finish(peer, TL_CONTROL_DONE, "active");
}

static void confirm(tl_control_peer *peer) {
    bool was = is_on_probation;
    is_on_probation = false;
    finish(peer, was ? TL_CONTROL_DONE : TL_CONTROL_ABSENT, was ? "kept" : "no probation");
}

/* ---- candidates ---- */

static bool says(const char *word) {
    return strstr(room, word) != NULL;
}

/* True if the candidate needs no further reply. */
static bool refuse(tl_control_peer *peer, const tl_control_request *request) {
    if (request->if_match[0] != '\0' && strcmp(request->if_match, versions[active].about.hash) != 0) {
        finish(peer, TL_CONTROL_CHANGED, "If-Match does not match");
    } else if (says("busy")) {
        finish(peer, TL_CONTROL_BUSY, "busy");
    } else if (says("commission") && request->right < TL_RIGHT_COMMISSION) {
        finish(peer, TL_CONTROL_FORBIDDEN, "sources.plc.host: commission");
    } else if (says("invalid")) {
        say_problem(peer, 7, "synchronise.margin", "-1 is not above 0");
        say_problem(peer, 9, "synchronise.match[0].tolerance", "\"\x1b[2J\" is text");
        finish(peer, TL_CONTROL_INVALID, "two problems");
    } else if (says("restart") && (request->flags & TL_CONTROL_MAY_RESTART) == 0) {
        say_change(peer);
        finish(peer, TL_CONTROL_RESTART, "step_s");
    } else if (strcmp(request->hash, versions[active].about.hash) == 0) {
        finish(peer, TL_CONTROL_SAME, "no change");
    } else if (says("dies")) {
        tl_control_close(peer);
    } else {
        return says("silent");
    }
    return true;
}

static void take(client *asks, const tl_control_request *request, size_t size) {
    tl_control_peer *peer = &asks->peer;
    say_step(peer, TL_CONTROL_AUTHORISE, "");
    say_step(peer, TL_CONTROL_VALIDATE, "");
    if (refuse(peer, request)) {
        return;
    }
    say_change(peer);
    say_step(peer, TL_CONTROL_TRY, "motor, load");
    if (says("fails") || (request->flags & TL_CONTROL_ONLY_CHECK) != 0) {
        finish(peer, says("fails") ? TL_CONTROL_FAILED : TL_CONTROL_DONE, says("fails") ? "an FMU failed" : "valid");
        return;
    }
    say_step(peer, TL_CONTROL_ACTIVATE, "in place");
    keep(room, size, request);
    is_on_probation = true;
    asks->waits = (request->flags & TL_CONTROL_WAIT) != 0;
    asks->returns = says("returns");
    probation_ends = tl_clock_now(NULL) + (says("waits") ? 2 * TL_SECOND : TL_SECOND / 10);
    if (asks->waits) {
        say_step(peer, TL_CONTROL_PROBATION, "");
    } else {
        finish(peer, TL_CONTROL_DONE, "active");
    }
}

static void end_probation(client *asks) {
    if (asks->returns) {
        say_step(&asks->peer, TL_CONTROL_RETURNED, "");
        active -= active > 0 ? 1 : 0;
    } else {
        say_step(&asks->peer, TL_CONTROL_KEPT, "");
    }
    asks->waits = false;
    is_on_probation = false;
    finish(&asks->peer, asks->returns ? TL_CONTROL_UNDONE : TL_CONTROL_DONE,
           asks->returns ? "lock 71 %, required 95 %" : "kept");
}

/* ---- the loop ---- */

static void answer(client *asks, const tl_control_request *request, size_t size) {
    (void)printf("verb=%u right=%u flags=%u probation=%u shadow=%u lock=%g version=%llu who=%s why=%s\n", request->verb,
                 request->right, request->flags, request->probation_s, request->shadow_s, request->require_lock,
                 (unsigned long long)request->version, request->who, request->why);
    (void)fflush(stdout);
    switch ((tl_control_verb)request->verb) {
    case TL_CONTROL_SHOW:
        show(&asks->peer);
        break;
    case TL_CONTROL_READ:
        read_one(&asks->peer, request);
        break;
    case TL_CONTROL_VERSIONS:
        list(&asks->peer);
        break;
    case TL_CONTROL_APPLY:
        take(asks, request, size);
        break;
    case TL_CONTROL_CONFIRM:
        confirm(&asks->peer);
        break;
    case TL_CONTROL_ROLL_BACK:
    case TL_CONTROL_VERBS:
        bring_back(&asks->peer, request);
        break;
    }
}

static void look_at(client *asks) {
    tl_control_request request;
    size_t size = 0;
    if (asks->waits && tl_clock_now(NULL) >= probation_ends) {
        end_probation(asks);
    } else if (tl_control_receive(&asks->peer, &request, room, &size) == TL_CONTROL_REQUEST) {
        answer(asks, &request, size);
    }
    asks->is_there = asks->peer.socket >= 0;
}

static void let_in(int listener) {
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        if (!clients[i].is_there) {
            clients[i] = (client){.peer = {.socket = -1}};
            clients[i].is_there = tl_control_accept(listener, &clients[i].peer);
        }
    }
}

static size_t read_file(const char *path) {
    FILE *file = fopen(path, "re");
    size_t size = file == NULL ? 0 : fread(room, 1, TL_CONTROL_MOST, file);
    if (file != NULL) {
        (void)fclose(file);
    }
    return size;
}

int main(int argc, char **argv) {
    tl_error error = {TL_OK, ""};
    int listener = -1;
    size_t size = argc == 3 ? read_file(argv[2]) : 0;
    if (size == 0 || tl_control_listen(argv[1], &listener, &error) != TL_OK) {
        (void)fprintf(stderr, "control_plant: needs SOCKET and CONFIGURATION: %s\n", error.text);
        return 2;
    }
    tl_interrupt_install();
    keep(room, size, NULL);
    (void)puts("ready");
    (void)fflush(stdout);
    while (tl_interrupt_requested() == NULL) {
        struct pollfd waited = {.fd = listener, .events = POLLIN};
        (void)poll(&waited, 1, TURN_MS);
        let_in(listener);
        for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
            if (clients[i].is_there) {
                look_at(&clients[i]);
            }
        }
    }
    for (size_t i = 0; i < count; i++) {
        free(versions[i].text);
    }
    return 0;
}
