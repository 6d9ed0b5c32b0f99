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
static const tl_time REQUEST_LIMIT = 2 * TL_SECOND;

typedef struct client_slot {
    tl_control_peer peer; /* −1: none */
    tl_time connected_at;
} client_slot;

struct tl_config_manager {
    int socket; /* the listening socket */
    tl_versions versions;
    tl_refused_changes refusals;
    tl_activation activation;
    client_slot clients[TL_CONTROL_CLIENTS];
    client_slot *listener; /* receives the replies of the change in progress; NULL: no client */
    client_slot *
        waiter; /* waits for the result of the version on probation during a change to another candidate; NULL: no client */
    uint64_t awaited;           /* number of that version */
    tl_time worked_at;          /* time of the last work */
    tl_control_request request; /* the current request, */
    char text[TL_CONTROL_MOST + 1];
    size_t size; /* and its candidate */
};

/* ---- replies of a change ---- */

static void close_client(tl_config_manager *self, client_slot *client) {
    tl_control_close(&client->peer);
    self->listener = self->listener == client ? NULL : self->listener;
    self->waiter = self->waiter == client ? NULL : self->waiter;
}

static void send_reply(void *context, const tl_control_reply *reply) {
    tl_config_manager *self = context;
    client_slot *client = self->listener;
    if (client == NULL) {
        return;
    }
    (void)tl_control_send(&client->peer, reply, NULL);
    if (reply->kind == TL_CONTROL_END || client->peer.socket < 0) {
        close_client(self, client);
    }
}

static void finish_request(tl_config_manager *self, client_slot *client, tl_control_result result, const char *text) {
    const tl_version *active = tl_versions_active(&self->versions);
    tl_control_finish(&client->peer, result, active->number, active->hash, text);
    close_client(self, client);
}

/* ---- queries ---- */

static void send_state(tl_config_manager *self, client_slot *client) {
    const tl_version *active = tl_versions_active(&self->versions);
    tl_activation_view view = {.step_s = 0.0};
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_STATE);
    const tl_activation_settings *settings = &self->activation.settings;
    settings->host->read_view(settings->host->context, &view);
    tl_control_state *state = &reply.as.state;
    (void)snprintf(state->plant, sizeof state->plant, "%s", settings->plant);
    memcpy(state->hash, active->hash, sizeof state->hash);
    state->version = active->number;
    state->step = (uint32_t)self->activation.step;
    state->left_s = tl_activation_remaining_s(&self->activation);
    tl_activation_view_write(&view, state);
    (void)tl_control_send(&client->peer, &reply, NULL);
    finish_request(self, client, TL_CONTROL_DONE, "");
}

static void describe_version(const tl_config_manager *self, const tl_version *version, tl_control_version *entry) {
    memset(entry, 0, sizeof *entry);
    entry->version = version->number;
    entry->parent = version->parent;
    entry->is_active = version->number == self->versions.active ? 1 : 0;
    memcpy(entry->hash, version->hash, sizeof entry->hash);
    (void)snprintf(entry->kind, sizeof entry->kind, "%s", tl_change_kinds[version->kind]);
    (void)snprintf(entry->origin, sizeof entry->origin, "%s", tl_change_origins[version->origin]);
    (void)snprintf(entry->right, sizeof entry->right, "%s", tl_change_rights[version->right]);
    (void)snprintf(entry->who, sizeof entry->who, "%s", version->who);
    (void)snprintf(entry->why, sizeof entry->why, "%s", version->why);
    (void)snprintf(entry->at, sizeof entry->at, "%s", version->at);
    (void)snprintf(entry->result, sizeof entry->result, "%s%s%.*s", tl_version_results[version->result],
                   version->reason[0] == '\0' ? "" : ": ", (int)sizeof entry->result - 24, version->reason);
}

static void list_versions(tl_config_manager *self, client_slot *client) {
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_VERSION);
    for (size_t i = self->versions.count; i > 0; i--) {
        describe_version(self, &self->versions.list[i - 1], &reply.as.version);
        (void)tl_control_send(&client->peer, &reply, NULL);
    }
    for (size_t i = self->refusals.count; i > 0; i--) {
        reply.as.version = self->refusals.list[i - 1];
        reply.as.version.version = 0; /* a refusal is not a version */
        (void)tl_control_send(&client->peer, &reply, NULL);
    }
    finish_request(self, client, TL_CONTROL_DONE, "");
}

static void read_version(tl_config_manager *self, client_slot *client) {
    tl_control_reply reply = tl_control_new_reply(TL_CONTROL_CONFIGURATION);
    tl_error error;
    char *text = NULL;
    const tl_version *version =
        tl_versions_get(&self->versions, self->request.version == 0 ? self->versions.active : self->request.version);
    if (version == NULL) {
        finish_request(self, client, TL_CONTROL_ABSENT, "there is no such version: --versions lists the saved ones");
    } else if (tl_versions_read(&self->versions, version->number, &text, &error) != TL_OK) {
        finish_request(self, client, TL_CONTROL_FAILED, error.text);
    } else {
        describe_version(self, version, &reply.as.version);
        reply.more = (uint32_t)version->size;
        (void)tl_control_send(&client->peer, &reply, text);
        finish_request(self, client, TL_CONTROL_DONE, "");
    }
    free(text);
}

/* ---- changes ---- */

static void start_change(tl_config_manager *self, client_slot *client, const char *text, size_t size) {
    if (tl_activation_is_busy(&self->activation)) {
        finish_request(self, client, TL_CONTROL_BUSY,
                       "another change is in progress: retry later; --state shows its step, --rollback cancels it");
        return;
    }
    if (self->listener != NULL) { /* waits for the version on probation */
        self->waiter = self->listener;
        self->awaited = self->versions.active;
    }
    self->listener = client;
    tl_activation_start(&self->activation, &self->request, text, size);
}

static void take_candidate(tl_config_manager *self, client_slot *client) {
    start_change(self, client, self->text, self->size);
}

/* If the other candidate failed, the client that waits for the version on probation receives the
 * replies again. */
static void poll_waiter(tl_config_manager *self) {
    client_slot *client = self->waiter;
    const tl_version *version = tl_versions_get(&self->versions, self->awaited);
    if (client == NULL) {
        return;
    }
    if (self->versions.active != self->awaited) {
        bool is_returned = version != NULL && version->result == TL_VERSION_ROLLED_BACK;
        finish_request(self, client, TL_CONTROL_UNDONE, is_returned ? version->reason : "replaced by another version");
    } else if (self->versions.probation.version != self->awaited) {
        finish_request(self, client, TL_CONTROL_DONE, version == NULL ? "the version is kept" : version->reason);
    } else if (self->listener == NULL && !tl_activation_is_busy(&self->activation)) {
        self->listener = client;
        self->waiter = NULL;
    }
}

static void confirm_version(tl_config_manager *self, client_slot *client) {
    bool is_done = false;
    if (self->request.right < TL_RIGHT_COMMISSION && tl_activation_was_lost_before(&self->activation)) {
        finish_request(self, client, TL_CONTROL_FORBIDDEN,
                       "by the previous version's tolerances, the lock is lost: confirming needs the right commission");
    } else if (!tl_activation_confirm(&self->activation, self->request.who, &is_done)) {
        finish_request(self, client, TL_CONTROL_ABSENT, "no version is on probation");
    } else if (is_done) {
        finish_request(self, client, TL_CONTROL_DONE, "the version is kept");
    } else {
        finish_request(self, client, TL_CONTROL_FAILED,
                       "the decision cannot be saved, so the probation continues: see the log of the run");
    }
}

/* Cancels a change in progress, or rolls back a version on probation. An older version is a
 * candidate like any other. */
static void roll_back(tl_config_manager *self, client_slot *client) {
    tl_control_request *request = &self->request;
    uint64_t number = request->version != 0 ? request->version : tl_versions_active(&self->versions)->parent;
    const tl_version *version = tl_versions_get(&self->versions, number);
    tl_error error;
    char *text = NULL;
    if ((request->flags & TL_CONTROL_ONLY_PENDING) != 0 && tl_activation_is_idle(&self->activation)) {
        finish_request(self, client, TL_CONTROL_ABSENT, "no change is in progress, and no version is on probation");
    } else if (request->version == 0 && tl_activation_is_busy(&self->activation)) {
        bool is_done = tl_activation_cancel(&self->activation, request->who);
        finish_request(self, client, is_done ? TL_CONTROL_DONE : TL_CONTROL_BUSY,
                       is_done ? "the change in progress is cancelled; nothing was changed"
                               : "the change is being activated and cannot be cancelled now: try again");
    } else if (self->activation.step == TL_CONTROL_PROBATION &&
               (request->version == 0 || request->version == self->versions.probation.return_to)) {
        if (self->listener != NULL) { /* waits for that version */
            finish_request(self, self->listener, TL_CONTROL_UNDONE, "another client requested a rollback");
        }
        self->listener = client;
        tl_activation_roll_back(&self->activation, request->who);
    } else if (version == NULL) {
        finish_request(self, client, TL_CONTROL_ABSENT,
                       request->version != 0 ? "there is no such version: --versions lists the saved ones"
                                             : "the active version is the first: there is no version before it");
    } else if (tl_versions_read(&self->versions, number, &text, &error) != TL_OK) {
        finish_request(self, client, TL_CONTROL_FAILED, error.text);
    } else {
        memcpy(request->hash, version->hash, sizeof request->hash);
        start_change(self, client, text, (size_t)version->size);
    }
    free(text);
}

static void answer_request(tl_config_manager *self, client_slot *client) {
    static const struct {
        void (*answer_request)(tl_config_manager *self, client_slot *client);
        bool changes;
    } verbs[TL_CONTROL_VERBS] = {
        [TL_CONTROL_SHOW] = {send_state, false},     [TL_CONTROL_READ] = {read_version, false},
        [TL_CONTROL_APPLY] = {take_candidate, true}, [TL_CONTROL_VERSIONS] = {list_versions, false},
        [TL_CONTROL_ROLL_BACK] = {roll_back, true},  [TL_CONTROL_CONFIRM] = {confirm_version, true},
    };
    if (verbs[self->request.verb].changes && self->request.right < TL_RIGHT_RETUNE) {
        finish_request(self, client, TL_CONTROL_FORBIDDEN, "this request needs the right retune");
    } else {
        verbs[self->request.verb].answer_request(self, client);
    }
}

/* ---- clients ---- */

static void poll_client(tl_config_manager *self, client_slot *client, tl_time now) {
    switch (tl_control_receive(&client->peer, &self->request, self->text, &self->size)) {
    case TL_CONTROL_REQUEST:
        answer_request(self, client);
        break;
    case TL_CONTROL_GARBAGE:
    case TL_CONTROL_CLOSED:
        close_client(self, client);
        break;
    case TL_CONTROL_NOTHING:
        if (!client->peer.has_asked && now - client->connected_at > REQUEST_LIMIT) {
            close_client(self, client);
        }
        break;
    }
}

/* poll() ignores entries without a client. If all entries are used, further clients wait in the
 * listener's queue. */
static void wait_for_work(tl_config_manager *self) {
    struct pollfd waited[TL_CONTROL_CLIENTS + 1];
    bool is_full = true;
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        waited[i] = (struct pollfd){.fd = self->clients[i].peer.socket, .events = POLLIN};
        is_full = is_full && waited[i].fd >= 0;
    }
    waited[TL_CONTROL_CLIENTS] = (struct pollfd){.fd = is_full ? -1 : self->socket, .events = POLLIN};
    (void)poll(waited, TL_CONTROL_CLIENTS + 1, (int)(TL_CONFIG_MANAGER_POLL / (TL_SECOND / 1000)));
}

bool tl_config_manager_work(tl_config_manager *manager) {
    bool has_connection = true;
    bool is_busy = false;
    wait_for_work(manager);
    tl_time now = tl_clock_now(NULL);
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        client_slot *client = &manager->clients[i];
        if (client->peer.socket < 0 && has_connection) {
            has_connection = tl_control_accept(manager->socket, &client->peer);
            client->connected_at = now;
        }
        if (client->peer.socket >= 0) {
            is_busy = true;
            poll_client(manager, client, now);
        }
    }
    tl_activation_poll(&manager->activation);
    poll_waiter(manager);
    if (is_busy || !tl_activation_is_idle(&manager->activation)) {
        manager->worked_at = now;
    }
    return now - manager->worked_at < IDLE;
}

/* ---- start and end ---- */

tl_status tl_config_manager_open(int socket, const char *state, const tl_activation_settings *settings,
                                 tl_config_manager **manager, tl_error *error) {
    tl_activation_settings own = *settings;
    tl_config_manager *opened = calloc(1, sizeof *opened);
    *manager = NULL;
    if (opened == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    tl_status status = tl_versions_open(state, &opened->versions, error);
    if (status != TL_OK) {
        free(opened);
        return status;
    }
    tl_refused_changes_open(&opened->refusals, &opened->versions);
    opened->socket = socket;
    opened->worked_at = tl_clock_now(NULL);
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        opened->clients[i].peer.socket = -1;
    }
    own.versions = &opened->versions;
    own.refusals = &opened->refusals;
    own.reply = send_reply;
    own.listener = opened;
    tl_activation_begin(&opened->activation, &own);
    *manager = opened;
    return TL_OK;
}

void tl_config_manager_close(tl_config_manager *manager) {
    if (manager == NULL) {
        return;
    }
    for (size_t i = 0; i < TL_CONTROL_CLIENTS; i++) {
        tl_control_close(&manager->clients[i].peer);
    }
    tl_activation_end(&manager->activation);
    tl_versions_close(&manager->versions);
    free(manager);
}
