/* Client of a control socket: see control_client.h. */
#include "firmware/retune/control_client.h"

#include <pwd.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"

/* The supervisor may have to start a config manager first, on a loaded box; and a disk may be slow.
 */
static const tl_time REPLY_LIMIT = 200 * TL_SECOND;

/* During a probation no replies come. */
static const tl_time PROBATION_LIMIT = (tl_time)(8 * 24 * 3600) * TL_SECOND;

/* A run that restarts loads its FMUs before it answers; then it answers at once. */
static const tl_time RESTART_LIMIT = 60 * TL_SECOND;
static const tl_time QUERY_LIMIT = 5 * TL_SECOND;

enum { MOST_VERSIONS = 64 }; /* more than a run saves */

typedef struct session {
    const tl_control_client_settings *settings;
    const tl_control_request *request;
    tl_control_result result;
    bool has_ended;            /* TL_CONTROL_END was printed */
    bool on_probation;         /* the change is on probation */
    bool is_active;            /* the step `activate` was printed, and no later step with its result */
    bool is_following;         /* the run restarts, and the next run is queried */
    int socket;                /* −1: not connected */
    char hash[TL_SHA256_TEXT]; /* of the configuration that the change activates */
    uint64_t version;          /* its number; 0: unknown */
    tl_time last_reply;        /* time of the last reply, or of the last answer of a run */
    size_t replacements;       /* of --versions: versions that replaced their parent, or its descendant */
    struct {
        uint64_t parent, by;
    } replaced[MOST_VERSIONS];
} session;

/* ---- output ---- */

static void print_state(const tl_control_state *state, FILE *output) {
    (void)fprintf(output, "%s: %s\n", state->plant, state->lock[0] == '\0' ? "no twin runs" : state->lock);
    (void)fprintf(output, "  configuration %.12s, version %llu\n", state->hash, (unsigned long long)state->version);
    if (state->step == TL_CONTROL_PROBATION) {
        (void)fprintf(output, "  on probation, %u s remain\n", state->left_s);
    } else if (state->step != TL_CONTROL_IDLE) {
        (void)fprintf(output, "  change in progress: %s\n", tl_control_step_name((tl_control_step)state->step));
    }
    (void)fprintf(output, "  %llu ticks of %g s: %llu steps, %llu caught up, %llu deadlines missed, %.1f %% in lock\n",
                  (unsigned long long)state->ticks, state->step_s, (unsigned long long)state->steps,
                  (unsigned long long)state->skipped, (unsigned long long)state->deadline_misses, state->in_lock);
    if (state->line[0] != '\0') {
        (void)fprintf(output, "  %s\n", state->line);
    }
}

/* Versions come newest first. Returns the version that replaced this one; 0: none. */
static uint64_t note_version(session *self, const tl_control_version *version) {
    uint64_t by = 0;
    for (size_t i = 0; i < self->replacements; i++) {
        by = by == 0 && self->replaced[i].parent == version->version ? self->replaced[i].by : by;
    }
    bool was_active =
        version->is_active != 0 || strncmp(version->result, "kept", 4) == 0 || strcmp(version->result, "active") == 0;
    uint64_t successor = was_active ? version->version : by; /* of a version that was rolled back: its replacement */
    if (successor != 0 && version->parent != 0 && self->replacements < MOST_VERSIONS) {
        self->replaced[self->replacements].parent = version->parent;
        self->replaced[self->replacements++].by = successor;
    }
    return was_active && version->is_active == 0 ? by : 0;
}

static void print_version(session *self, const tl_control_version *version) {
    FILE *output = self->settings->output;
    char replaced[48] = "";
    uint64_t by = note_version(self, version);
    char number[24] = "-"; /* for a refused candidate */
    if (by != 0) {
        (void)snprintf(replaced, sizeof replaced, "replaced by %llu, was ", (unsigned long long)by);
    }
    if (version->version != 0) {
        (void)snprintf(number, sizeof number, "%llu", (unsigned long long)version->version);
    }
    (void)fprintf(output, "%c%4s  %.12s  %s  by %s, %s%s%s", version->is_active != 0 ? '*' : ' ', number, version->hash,
                  version->at, version->who, version->origin, version->kind[0] == '\0' ? "" : ", ", version->kind);
    (void)fprintf(output, "\n       %s%s%s%s\n", replaced, version->result, version->why[0] == '\0' ? "" : "; ",
                  version->why);
}

static void print_change(const tl_control_reply *reply, FILE *output) {
    const tl_control_change *change = &reply->as.change;
    const char *note = strcmp(change->right, "commission") == 0   ? ", needs the right commission"
                       : strcmp(change->right, "on the box") == 0 ? ", on the box only"
                                                                  : "";
    (void)fprintf(output, "            %s: %s → %s (%s%s)\n", change->path,
                  change->before[0] == '\0' ? "nothing" : change->before,
                  change->after[0] == '\0' ? "nothing" : change->after, change->kind, note);
    if (reply->more > 0) {
        (void)fprintf(output, "            and %u more\n", reply->more);
    }
}

static void print_step(const session *self, tl_control_step step, const char *text) {
    (void)fprintf(self->settings->output, "%-10s  %s\n", tl_control_step_name(step), text);
    (void)fflush(self->settings->output);
}

static void end_session(session *self, tl_control_result result, const char *text) {
    self->has_ended = true;
    self->result = result;
    if (result != TL_CONTROL_DONE && result != TL_CONTROL_SAME) {
        tl_log(TL_LOG_ERROR, "%s: %s", tl_control_result_name(result), text);
    } else if (text[0] != '\0') {
        (void)fprintf(self->settings->output, "%s\n", text);
    }
}

static void print_reply(session *self, const tl_control_reply *reply) {
    FILE *output = self->settings->output;
    switch ((tl_control_kind)reply->kind) {
    case TL_CONTROL_STATE:
        print_state(&reply->as.state, output);
        break;
    case TL_CONTROL_VERSION:
        print_version(self, &reply->as.version);
        break;
    case TL_CONTROL_CHANGE:
        print_change(reply, output);
        break;
    case TL_CONTROL_PROBLEM:
        tl_control_log_problem(self->settings->subject, &reply->as.problem);
        if (reply->more > 0) {
            tl_log(TL_LOG_ERROR, "%s: and %u more", self->settings->subject, reply->more);
        }
        break;
    case TL_CONTROL_STEP:
        print_step(self, (tl_control_step)reply->as.progress.step, reply->as.progress.text);
        break;
    case TL_CONTROL_END:
    case TL_CONTROL_CONFIGURATION:
    case TL_CONTROL_KINDS:
        break;
    }
    (void)fflush(output);
}

/* ---- names ---- */

tl_status tl_control_client_find(const char *subject, const char *given, char path[PATH_MAX], tl_error *error) {
    const char *slash = strrchr(subject, '/');
    const char *name = slash == NULL ? subject : slash + 1;
    size_t size = strlen(name);
    size_t end = strlen(".json");
    if (given == NULL && strcmp(subject, TL_CONTROL_CLIENT_INPUT) == 0) {
        return tl_fail(error, TL_BAD_USAGE, "standard input names no run (expected --control SOCKET)");
    }
    size -= size > end && strcmp(name + size - end, ".json") == 0 ? end : 0;
    int length = given != NULL
                     ? snprintf(path, PATH_MAX, "%s", given)
                     : snprintf(path, PATH_MAX, "%s/%.*s/%s", TL_CONTROL_FOLDER, (int)size, name, TL_CONTROL_SOCKET);
    return length > 0 && length < PATH_MAX
               ? TL_OK
               : tl_fail(error, TL_BAD_USAGE, "the path of the control socket is too long: use --control SOCKET");
}

void tl_control_client_name(uid_t user, char who[TL_CONTROL_NAME]) {
    char room[1024];
    struct passwd about;
    struct passwd *found = NULL;
    if (getpwuid_r(user, &about, room, sizeof room, &found) == 0 && found != NULL) {
        (void)snprintf(who, TL_CONTROL_NAME, "%s", found->pw_name);
    } else {
        (void)snprintf(who, TL_CONTROL_NAME, "user %lu", (unsigned long)user);
    }
}

/* ---- while connected ---- */

static void close_session(session *self) {
    if (self->socket >= 0) {
        (void)close(self->socket);
    }
    self->socket = -1;
}

static bool waits_for_result(const session *self) {
    return (self->request->flags & TL_CONTROL_WAIT) != 0;
}

static void note_step(session *self, tl_control_step step) {
    self->on_probation = step == TL_CONTROL_PROBATION;
    if (step == TL_CONTROL_ACTIVATE) {
        self->is_active = true;
    } else if (step == TL_CONTROL_KEPT || step == TL_CONTROL_RETURNED) {
        self->is_active = false;
    }
}

static void follow_restart(session *self) {
    close_session(self);
    self->is_following = true;
    self->on_probation = false;
    self->last_reply = tl_clock_now(NULL);
}

/* TL_CONTROL_DONE after the step `activate`, without a result of the probation: the run restarts
 * with the change. */
static void handle_end(session *self, const tl_control_reply *reply) {
    const tl_control_end *end = &reply->as.end;
    if (waits_for_result(self) && self->is_active && end->result == TL_CONTROL_DONE) {
        memcpy(self->hash, end->hash, sizeof self->hash);
        self->version = end->version;
        print_step(self, TL_CONTROL_ACTIVATE, end->text);
        follow_restart(self);
        return;
    }
    close_session(self);
    end_session(self, (tl_control_result)end->result, end->text);
}

static tl_status handle_silence(session *self, tl_status status, tl_error *error) {
    tl_time silence = tl_clock_now(NULL) - self->last_reply;
    tl_time limit = self->on_probation ? PROBATION_LIMIT : REPLY_LIMIT + (tl_time)self->request->shadow_s * TL_SECOND;
    bool is_known = self->hash[0] != '\0';
    if (status == TL_TRY_AGAIN && silence < limit) {
        return TL_OK;
    }
    if (status == TL_PLANT_DOWN && waits_for_result(self) && self->is_active && is_known) {
        print_step(self, self->on_probation ? TL_CONTROL_PROBATION : TL_CONTROL_ACTIVATE,
                   "the run closed the connection before it reported the result: waiting for the run, at most 60 s");
        follow_restart(self);
        return TL_OK;
    }
    close_session(self);
    if (status == TL_PLANT_DOWN && self->request->verb != TL_CONTROL_SHOW) {
        return tl_fail(
            error, status,
            "the run closed the connection before it reported the result: `twinlock reload --state` shows the active "
            "version, `--versions` the results");
    }
    return status;
}

static tl_status receive_reply(session *self, tl_error *error) {
    tl_control_reply reply;
    tl_status status = tl_control_next(self->socket, TL_SECOND, &reply, NULL, error);
    if (status != TL_OK) {
        return handle_silence(self, status, error);
    }
    self->last_reply = tl_clock_now(NULL);
    if (reply.kind == TL_CONTROL_END) {
        handle_end(self, &reply);
        return TL_OK;
    }
    if (reply.kind == TL_CONTROL_STEP) {
        note_step(self, (tl_control_step)reply.as.progress.step);
    }
    print_reply(self, &reply);
    return TL_OK;
}

/* ---- across a restart ---- */

/* Sends one query to the current run. `number`: of the version that is wanted. Returns false if
 * there is no answer. */
static bool query_run(const session *self, tl_control_verb verb, uint64_t number, tl_control_reply *found) {
    tl_control_request request;
    tl_control_reply reply = {.kind = TL_CONTROL_KINDS};
    tl_error error;
    int socket = -1;
    bool is_found = false;
    memset(&request, 0, sizeof request);
    request.verb = (uint32_t)verb;
    memcpy(request.who, self->request->who, sizeof request.who);
    tl_status status = tl_control_connect(self->settings->path, &socket, &error);
    if (status != TL_OK) {
        return false;
    }
    status = tl_control_ask(socket, &request, NULL, 0, &error);
    while (status == TL_OK && reply.kind != TL_CONTROL_END) {
        status = tl_control_next(socket, QUERY_LIMIT, &reply, NULL, &error);
        bool is_it =
            reply.kind == TL_CONTROL_STATE || (reply.kind == TL_CONTROL_VERSION && reply.as.version.version == number);
        if (status == TL_OK && is_it) {
            *found = reply;
            is_found = true;
        }
    }
    (void)close(socket);
    return is_found;
}

/* The new run's state shows whether the change was kept; its list of versions contains the reason.
 */
static void report_result(session *self, const tl_control_state *state, bool is_kept) {
    char text[TL_CONTROL_TEXT];
    tl_control_reply reply = {.kind = TL_CONTROL_KINDS};
    const char *why = "";
    if (self->version != 0 && query_run(self, TL_CONTROL_VERSIONS, self->version, &reply)) {
        const char *colon = strstr(reply.as.version.result, ": "); /* "kept: in lock for …" */
        why = colon != NULL ? colon + strlen(": ") : reply.as.version.result;
    }
    self->is_following = false;
    print_step(self, is_kept ? TL_CONTROL_KEPT : TL_CONTROL_RETURNED, why);
    (void)snprintf(text, sizeof text, "version %llu is kept", (unsigned long long)state->version);
    end_session(self, is_kept ? TL_CONTROL_DONE : TL_CONTROL_UNDONE,
                is_kept          ? text
                : why[0] != '\0' ? why
                                 : "another version is active");
}

static void handle_state(session *self, const tl_control_state *state) {
    char text[TL_CONTROL_TEXT];
    bool is_ours = strcmp(state->hash, self->hash) == 0;
    self->last_reply = tl_clock_now(NULL);
    self->version = is_ours ? state->version : self->version;
    if (!is_ours || state->step == TL_CONTROL_IDLE) {
        report_result(self, state, is_ours);
    } else if (state->step == TL_CONTROL_PROBATION && state->lock[0] != '\0' && !self->on_probation) {
        self->on_probation = true;
        (void)snprintf(text, sizeof text, "%u s remain", state->left_s);
        print_step(self, TL_CONTROL_PROBATION, text);
    }
}

static tl_status poll_next_run(session *self, tl_error *error) {
    tl_control_reply reply;
    tl_clock_sleep_until(tl_clock_now(NULL) + TL_SECOND);
    if (query_run(self, TL_CONTROL_SHOW, 0, &reply)) {
        handle_state(self, &reply.as.state);
    } else if (tl_clock_now(NULL) - self->last_reply > RESTART_LIMIT) {
        return tl_fail(
            error, TL_PLANT_DOWN,
            "the run has not restarted within 60 s: see its log; when it runs, `twinlock reload --versions` shows the "
            "result of the change");
    }
    return TL_OK;
}

/* ---- Ctrl-C ends the client, but not the change ---- */

static void print_hint(int signal_) {
    static const char hint[] =
        "\nthe change continues in the run: `twinlock reload --state` shows its step, `twinlock reload --rollback` "
        "cancels it or rolls it back\n";
    (void)!write(STDERR_FILENO, hint, sizeof hint - 1);
    (void)signal(signal_, SIG_DFL);
    (void)raise(signal_); /* terminates the process with this signal, when the handler returns */
}

/* An ignored signal stays ignored. */
static void set_handler(int signal_, void (*handler)(int)) {
    if (signal(signal_, handler) == SIG_IGN) {
        (void)signal(signal_, SIG_IGN);
    }
}

static void set_handlers(void (*handler)(int)) {
    set_handler(SIGINT, handler);
    set_handler(SIGTERM, handler);
}

/* ---- request ---- */

tl_status tl_control_client_run(const tl_control_client_settings *settings, const tl_control_request *request,
                                const char *text, size_t size, tl_control_result *result, tl_error *error) {
    session self = {.settings = settings, .request = request, .socket = -1, .last_reply = tl_clock_now(NULL)};
    tl_status status = tl_control_connect(settings->path, &self.socket, error);
    if (status == TL_OK) {
        if (text != NULL) {
            tl_sha256(text, size, self.hash);
        }
        status = tl_control_ask(self.socket, request, text, size, error);
    }
    if (status == TL_OK && (request->verb == TL_CONTROL_APPLY || request->verb == TL_CONTROL_ROLL_BACK)) {
        set_handlers(print_hint);
    }
    while (status == TL_OK && !self.has_ended) {
        status = self.is_following ? poll_next_run(&self, error) : receive_reply(&self, error);
    }
    set_handlers(SIG_DFL);
    close_session(&self);
    *result = self.result;
    return status;
}
