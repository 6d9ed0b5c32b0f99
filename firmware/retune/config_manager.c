/* Config manager: see config_manager.h. */
#include "firmware/retune/config_manager.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/os.h"
#include "firmware/retune/control.h"

/* Time without work before it ends: as long as a user needs for the next command. */
static const tl_time IDLE = 10 * TL_SECOND;

/* A client that connects must send its request in this time. */
static const tl_time PATIENCE = 2 * TL_SECOND;

typedef struct visitor {
    tl_control_peer peer; /* −1: none */
    tl_time came;
} visitor;

struct tl_config_manager {
    int socket; /* the listening socket */
    tl_versions versions;
    tl_refusals refusals;
    tl_activation activation;
    visitor clients[TL_CONTROL_CLIENTS];
    visitor *listener; /* receives the replies of the change in progress; NULL: no client */
    visitor *
        waiter; /* waits for the result of the version on probation during a change to another candidate; NULL: no client */
    uint64_t awaited;           /* number of that version */
    tl_time busy;               /* time of the last work */
    tl_control_request request; /* the current request, */
    char text[TL_CONTROL_MOST + 1];
    size_t size; /* and its candidate */
};

/* ---- replies of a change ---- */

static void hang_up(tl_config_manager *self, visitor *who) {
    tl_control_close(&who->peer);
    self->listener = self->listener == who ? NULL : self->listener;
    self->waiter = self->waiter == who ? NULL : self->waiter;
}

static void say(void *context, const tl_control_reply *reply) {
    tl_config_manager *self = context;
    visitor *who = self->listener;
    if (who == NULL) {
        return;
    }
    (void)tl_control_send(&who->peer, reply, NULL);
    if (reply->kind == TL_CONTROL_END || who->peer.socket < 0) {
        hang_up(self, who);
    }
}

static void finish(tl_config_manager *self, visitor *who, tl_control_result result, const char *text) {
    const tl_version *active = tl_versions_active(&self->versions);
    tl_control_finish(&who->peer, result, active->number, active->hash, text);
    hang_up(self, who);
}

/* ---- queries ---- */

static void show(tl_config_manager *self, visitor *who) {
    const tl_version *active = tl_versions_active(&self->versions);
    tl_activation_view view = {.step_s = 0.0};
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_STATE);
    const tl_activation_settings *settings = &self->activation.settings;
    settings->host->look(settings->host->context, &view);
    tl_control_state *state = &reply.as.state;
    (void)snprintf(state->plant, sizeof state->plant, "%s", settings->plant);
    memcpy(state->hash, active->hash, sizeof state->hash);
    state->version = active->number;
    state->step = (uint32_t)self->activation.step;
    state->left_s = tl_activation_left_s(&self->activation);
    const char *lock = view.holds                 ? "hold"
                       : !view.figures.twin_alive ? ""
                                                  : tl_lock_state_name(view.figures.lock.state);
    (void)snprintf(state->lock, sizeof state->lock, "%s", lock);
    state->step_s = view.step_s;
    state->ticks = view.figures.ticks;
    state->steps = view.figures.steps;
    state->skipped = view.figures.skipped;
    state->deadline_misses = view.figures.deadline_misses;
    state->in_lock = tl_lock_tally_percent(&view.figures.lock);
    (void)snprintf(state->line, sizeof state->line, "%s", view.line);
    (void)tl_control_send(&who->peer, &reply, NULL);
    finish(self, who, TL_CONTROL_DONE, "");
}

static void describe(const tl_config_manager *self, const tl_version *version, tl_control_version *told) {
    memset(told, 0, sizeof *told);
    told->version = version->number;
    told->parent = version->parent;
    told->is_active = version->number == self->versions.active ? 1 : 0;
    memcpy(told->hash, version->hash, sizeof told->hash);
    (void)snprintf(told->kind, sizeof told->kind, "%s", tl_change_kinds[version->kind]);
    (void)snprintf(told->origin, sizeof told->origin, "%s", tl_change_origins[version->origin]);
    (void)snprintf(told->right, sizeof told->right, "%s", tl_change_rights[version->right]);
    (void)snprintf(told->who, sizeof told->who, "%s", version->who);
    (void)snprintf(told->why, sizeof told->why, "%s", version->why);
    (void)snprintf(told->at, sizeof told->at, "%s", version->at);
    (void)snprintf(told->result, sizeof told->result, "%s%s%.*s", tl_version_results[version->result],
                   version->reason[0] == '\0' ? "" : ": ", (int)sizeof told->result - 24, version->reason);
}

static void list_versions(tl_config_manager *self, visitor *who) {
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_VERSION);
    for (size_t i = self->versions.count; i > 0; i--) {
        describe(self, &self->versions.list[i - 1], &reply.as.version);
        (void)tl_control_send(&who->peer, &reply, NULL);
    }
    for (size_t i = self->refusals.count; i > 0; i--) {
        reply.as.version = self->refusals.list[i - 1];
        reply.as.version.version = 0; /* a refusal is not a version */
        (void)tl_control_send(&who->peer, &reply, NULL);
    }
    finish(self, who, TL_CONTROL_DONE, "");
}

static void read_version(tl_config_manager *self, visitor *who) {
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_CONFIGURATION);
    tl_error error;
    char *text = NULL;
    const tl_version *version =
        tl_versions_get(&self->versions, self->request.version == 0 ? self->versions.active : self->request.version);
    if (version == NULL) {
        finish(self, who, TL_CONTROL_ABSENT, "there is no such version");
    } else if (tl_versions_read(&self->versions, version->number, &text, &error) != TL_OK) {
        finish(self, who, TL_CONTROL_FAILED, error.text);
    } else {
        describe(self, version, &reply.as.version);
        reply.more = (uint32_t)version->size;
        (void)tl_control_send(&who->peer, &reply, text);
        finish(self, who, TL_CONTROL_DONE, "");
    }
    free(text);
}

/* ---- changes ---- */

static void take_text(tl_config_manager *self, visitor *who, const char *text, size_t size) {
    if (tl_activation_is_busy(&self->activation)) {
        finish(self, who, TL_CONTROL_BUSY,
               "another change is under way: try again when it is done; --state shows its step, --rollback cancels it");
        return;
    }
    if (self->listener != NULL) { /* waits for the version on probation */
        self->waiter = self->listener;
        self->awaited = self->versions.active;
    }
    self->listener = who;
    tl_activation_take(&self->activation, &self->request, text, size);
}

static void take(tl_config_manager *self, visitor *who) {
    take_text(self, who, self->text, self->size);
}

/* If the other candidate failed, the client that waits for the version on probation receives the
 * replies again. */
static void look_at_waiter(tl_config_manager *self) {
    visitor *who = self->waiter;
    const tl_version *version = tl_versions_get(&self->versions, self->awaited);
    if (who == NULL) {
        return;
    }
    if (self->versions.active != self->awaited) {
        bool is_returned = version != NULL && version->result == TL_VERSION_RETURNED;
        finish(self, who, TL_CONTROL_UNDONE, is_returned ? version->reason : "another version took its place");
    } else if (self->versions.probation.version != self->awaited) {
        finish(self, who, TL_CONTROL_DONE, version == NULL ? "it is kept" : version->reason);
    } else if (self->listener == NULL && !tl_activation_is_busy(&self->activation)) {
        self->listener = who;
        self->waiter = NULL;
    }
}

static void confirm(tl_config_manager *self, visitor *who) {
    bool is_done = false;
    if (self->request.right < TL_RIGHT_COMMISSION && tl_activation_is_lost_before(&self->activation)) {
        finish(
            self, who, TL_CONTROL_FORBIDDEN,
            "by the tolerances of the version before, the lock is lost: to confirm it takes the right to commission");
    } else if (!tl_activation_confirm(&self->activation, self->request.who, &is_done)) {
        finish(self, who, TL_CONTROL_ABSENT, "no version is on probation");
    } else if (is_done) {
        finish(self, who, TL_CONTROL_DONE, "it is kept");
    } else {
        finish(self, who, TL_CONTROL_FAILED, "that cannot be written down: it is on probation still; the log says why");
    }
}

/* Cancels a change in progress, or rolls back a version on probation. An older version is a
 * candidate like any other. */
static void bring_back(tl_config_manager *self, visitor *who) {
    tl_control_request *request = &self->request;
    uint64_t number = request->version != 0 ? request->version : tl_versions_active(&self->versions)->parent;
    const tl_version *version = tl_versions_get(&self->versions, number);
    tl_error error;
    char *text = NULL;
    if ((request->flags & TL_CONTROL_ONLY_PENDING) != 0 && tl_activation_is_idle(&self->activation)) {
        finish(self, who, TL_CONTROL_ABSENT, "no change is under way, and none is on probation");
    } else if (request->version == 0 && tl_activation_is_busy(&self->activation)) {
        bool is_done = tl_activation_cancel(&self->activation, request->who);
        finish(self, who, is_done ? TL_CONTROL_DONE : TL_CONTROL_BUSY,
               is_done ? "the change that was under way is cancelled; nothing was changed"
                       : "a change is being made just now, and cannot be cancelled: try again");
    } else if (self->activation.step == TL_CONTROL_PROBATION &&
               (request->version == 0 || request->version == self->versions.probation.return_to)) {
        if (self->listener != NULL) { /* waits for that version */
            finish(self, self->listener, TL_CONTROL_UNDONE, "the version before was asked for");
        }
        self->listener = who;
        tl_activation_refuse(&self->activation, request->who);
    } else if (version == NULL) {
        finish(self, who, TL_CONTROL_ABSENT,
               request->version != 0 ? "there is no such version to return to; --versions lists those that are kept"
                                     : "the active version is the first: there is none before it to return to");
    } else if (tl_versions_read(&self->versions, number, &text, &error) != TL_OK) {
        finish(self, who, TL_CONTROL_FAILED, error.text);
    } else {
        memcpy(request->hash, version->hash, sizeof request->hash);
        take_text(self, who, text, (size_t)version->size);
    }
    free(text);
}

static void answer(tl_config_manager *self, visitor *who) {
    static const struct {
        void (*answer)(tl_config_manager *self, visitor *who);
        bool changes;
    } verbs[TL_CONTROL_VERBS] = {
        [TL_CONTROL_SHOW] = {show, false},        [TL_CONTROL_READ] = {read_version, false},
        [TL_CONTROL_TAKE] = {take, true},         [TL_CONTROL_VERSIONS] = {list_versions, false},
        [TL_CONTROL_RETURN] = {bring_back, true}, [TL_CONTROL_CONFIRM] = {confirm, true},
    };
    if (verbs[self->request.verb].changes && self->request.right < TL_RIGHT_RETUNE) {
        finish(self, who, TL_CONTROL_FORBIDDEN, "that takes the right to retune");
    } else {
        verbs[self->request.verb].answer(self, who);
    }
}

/* ---- clients ---- */

static void look_at_client(tl_config_manager *self, visitor *who, tl_time now) {
    switch (tl_control_receive(&who->peer, &self->request, self->text, &self->size)) {
    case TL_CONTROL_ASKED:
        answer(self, who);
        break;
    case TL_CONTROL_GARBAGE:
    case TL_CONTROL_GONE:
        hang_up(self, who);
        break;
    case TL_CONTROL_NOTHING:
        if (!who->peer.has_asked && now - who->came > PATIENCE) {
            hang_up(self, who);
        }
        break;
    }
}

/* poll() ignores entries without a client. If all entries are used, further clients wait in the
 * listener's queue. */
static void wait_for_something(tl_config_manager *self) {
    struct pollfd waited[TL_CONTROL_CLIENTS + 1];
    bool is_full = true;
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        waited[i] = (struct pollfd){.fd = self->clients[i].peer.socket, .events = POLLIN};
        is_full = is_full && waited[i].fd >= 0;
    }
    waited[TL_CONTROL_CLIENTS] = (struct pollfd){.fd = is_full ? -1 : self->socket, .events = POLLIN};
    (void)poll(waited, TL_CONTROL_CLIENTS + 1, (int)(TL_CONFIG_MANAGER_LOOK / (TL_SECOND / 1000)));
}

bool tl_config_manager_work(tl_config_manager *activator) {
    bool is_knocked = true;
    bool is_busy = false;
    wait_for_something(activator);
    tl_time now = tl_clock_now(NULL);
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        visitor *who = &activator->clients[i];
        if (who->peer.socket < 0 && is_knocked) {
            is_knocked = tl_control_accept(activator->socket, &who->peer);
            who->came = now;
        }
        if (who->peer.socket >= 0) {
            is_busy = true;
            look_at_client(activator, who, now);
        }
    }
    tl_activation_look(&activator->activation);
    look_at_waiter(activator);
    if (is_busy || !tl_activation_is_idle(&activator->activation)) {
        activator->busy = now;
    }
    return now - activator->busy < IDLE;
}

/* ---- start and end ---- */

tl_status tl_config_manager_open(int socket, const char *state, const tl_activation_settings *settings,
                                 tl_config_manager **activator, tl_error *error) {
    tl_activation_settings own = *settings;
    tl_config_manager *made = calloc(1, sizeof *made);
    *activator = NULL;
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    tl_status status = tl_versions_open(state, &made->versions, error);
    if (status != TL_OK) {
        free(made);
        return status;
    }
    tl_refusals_open(&made->refusals, &made->versions);
    made->socket = socket;
    made->busy = tl_clock_now(NULL);
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        made->clients[i].peer.socket = -1;
    }
    own.versions = &made->versions;
    own.refusals = &made->refusals;
    own.say = say;
    own.listener = made;
    tl_activation_begin(&made->activation, &own);
    *activator = made;
    return TL_OK;
}

void tl_config_manager_close(tl_config_manager *activator) {
    if (activator == NULL) {
        return;
    }
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        tl_control_close(&activator->clients[i].peer);
    }
    tl_activation_end(&activator->activation);
    tl_versions_close(&activator->versions);
    free(activator);
}
