/* twinlock reload: a changed configuration for a running plant's twin, by its control socket. */
#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <pwd.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/file_bytes.h"
#include "firmware/base/log.h"
#include "firmware/control/control_client.h"
#include "firmware/control/control_words.h"
#include "firmware/text/clean_text.h"
#include "firmware/text/output.h"
#include "firmware/verbs/verbs.h"

/* An activator has to be begun first, perhaps, on a loaded box; a trial says nothing while FMUs are loaded. */
static const tl_time PATIENCE = 200 * TL_SECOND;

/* On probation nothing is said for as long as it lasts. */
static const tl_time PATIENCE_ON_PROBATION = (tl_time)(8 * 24 * 3600) * TL_SECOND;

typedef struct reload {
    const tl_options *options;
    FILE *output;
    char path[PATH_MAX]; /* of the socket */
    char text[TL_CONTROL_MOST + 1];
    size_t size;
    tl_control_request request;
    bool ended;
    tl_status status; /* of what came of it */
} reload;

/* ---- what is asked ---- */

/* /etc/twinlock/motor.json is the plant "motor". */
static tl_status find_socket(reload *self, tl_error *error) {
    char copy[PATH_MAX];
    const char *given = self->options->control;
    int length = 0;
    if (given != NULL) {
        length = snprintf(self->path, sizeof self->path, "%s", given);
    } else {
        (void)snprintf(copy, sizeof copy, "%s", self->options->subject);
        char *name = basename(copy);
        size_t end = strlen(name);
        if (end > strlen(".json") && strcmp(name + end - strlen(".json"), ".json") == 0) {
            name[end - strlen(".json")] = '\0';
        }
        length = snprintf(self->path, sizeof self->path, "%s/%s/%s", TL_CONTROL_FOLDER, name, TL_CONTROL_SOCKET);
    }
    return length > 0 && (size_t)length < sizeof self->path
               ? TL_OK
               : tl_fail(error, TL_BAD_USAGE, "the name of the control socket is too long; give --control");
}

static tl_status read_file(reload *self, tl_error *error) {
    const char *path = self->options->subject;
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY);
    ssize_t size = file < 0 ? -1 : tl_file_bytes_read(file, self->text, sizeof self->text);
    int code = errno;
    if (file >= 0) {
        (void)close(file);
    }
    if (size < 0) {
        return tl_fail(error, TL_BAD_DATA, "%s: %s", path, strerror(code));
    }
    if (size == 0 || size > TL_CONTROL_MOST) {
        return tl_fail(error, TL_BAD_DATA, "%s: a configuration has 1 to %d bytes", path, (int)TL_CONTROL_MOST);
    }
    self->size = (size_t)size;
    return TL_OK;
}

static tl_control_verb verb_of(const tl_options *options) {
    return options->confirm    ? TL_CONTROL_CONFIRM
           : options->rollback ? TL_CONTROL_RETURN
           : options->versions ? TL_CONTROL_VERSIONS
           : options->show     ? TL_CONTROL_SHOW
                               : TL_CONTROL_TAKE;
}

static void fill_request(reload *self) {
    const tl_options *options = self->options;
    tl_control_request *request = &self->request;
    char room[1024];
    struct passwd about;
    struct passwd *user = NULL;
    memset(request, 0, sizeof *request);
    request->verb = (uint32_t)verb_of(options);
    request->right = TL_CONTROL_MAY_COMMISSION;
    request->origin = TL_CONTROL_BY_RELOAD;
    request->flags = (options->only_check ? TL_CONTROL_ONLY_CHECK : 0U) |
                     (options->restart ? TL_CONTROL_MAY_RESTART : 0U) |
                     (options->until_confirmed ? TL_CONTROL_BY_PERSON : 0U) | (options->wait ? TL_CONTROL_WAIT : 0U);
    request->probation_s = (uint32_t)options->probation_s;
    request->require_lock = options->keep_lock > 0.0 ? options->keep_lock : -1.0;
    request->version = options->version;
    if (getpwuid_r(geteuid(), &about, room, sizeof room, &user) == 0 && user != NULL) {
        (void)snprintf(request->who, sizeof request->who, "%s", user->pw_name);
    } else {
        (void)snprintf(request->who, sizeof request->who, "user %lu", (unsigned long)geteuid());
    }
    if (options->why != NULL) {
        (void)tl_clean_text(options->why, strlen(options->why), request->why, sizeof request->why);
    }
}

/* ---- what is answered ---- */

static void print_state(const tl_control_state *state, FILE *output) {
    (void)fprintf(output, "%s: %s\n", state->plant, state->lock[0] == '\0' ? "no twin runs" : state->lock);
    (void)fprintf(output, "  configuration %.12s, version %llu\n", state->hash, (unsigned long long)state->version);
    if (state->step == TL_CONTROL_PROBATION) {
        (void)fprintf(output, "  on probation, %u s are left\n", state->left_s);
    } else if (state->step != TL_CONTROL_IDLE) {
        (void)fprintf(output, "  a change is under way: %s\n", tl_control_step_name((tl_control_step)state->step));
    }
    (void)fprintf(output, "  %llu ticks of %g s: %llu steps, %llu made up, %llu deadlines missed, %.1f %% in lock\n",
                  (unsigned long long)state->ticks, state->step_s, (unsigned long long)state->steps,
                  (unsigned long long)state->skipped, (unsigned long long)state->deadline_misses, state->in_lock);
    if (state->line[0] != '\0') {
        (void)fprintf(output, "  %s\n", state->line);
    }
}

static void print_version(const tl_control_version *version, FILE *output) {
    (void)fprintf(output, "%c%4llu  %.12s  %s  by %s, %s, %s", version->is_active != 0 ? '*' : ' ',
                  (unsigned long long)version->version, version->hash, version->at, version->who, version->origin,
                  version->kind);
    (void)fprintf(output, "\n       %s%s%s\n", version->result, version->why[0] == '\0' ? "" : "; ", version->why);
}

static void print_change(const tl_control_reply *reply, FILE *output) {
    const tl_control_change *change = &reply->as.change;
    (void)fprintf(output, "            %s: %s → %s (%s)\n", change->path,
                  change->before[0] == '\0' ? "nothing" : change->before,
                  change->after[0] == '\0' ? "nothing" : change->after, change->kind);
    if (reply->more > 0) {
        (void)fprintf(output, "            and %u more\n", reply->more);
    }
}

static void print_problem(const reload *self, const tl_control_reply *reply) {
    const tl_control_problem *problem = &reply->as.problem;
    const char *separator = problem->path[0] == '\0' ? "" : ": ";
    if (problem->line != 0) {
        tl_log(TL_LOG_ERROR, "%s: line %u: %s%s%s", self->options->subject, problem->line, problem->path, separator,
               problem->text);
    } else {
        tl_log(TL_LOG_ERROR, "%s: %s%s%s", self->options->subject, problem->path, separator, problem->text);
    }
    if (reply->more > 0) {
        tl_log(TL_LOG_ERROR, "%s: and %u more", self->options->subject, reply->more);
    }
}

static tl_status status_of(tl_control_result result) {
    switch (result) {
    case TL_CONTROL_DONE:
    case TL_CONTROL_SAME:
        return TL_OK;
    case TL_CONTROL_UNDONE:
        return TL_NOT_LOCKED;
    case TL_CONTROL_CHANGED:
    case TL_CONTROL_BUSY:
    case TL_CONTROL_FAILED:
        return TL_TRY_AGAIN;
    case TL_CONTROL_BAD:
    case TL_CONTROL_FORBIDDEN:
    case TL_CONTROL_INVALID:
    case TL_CONTROL_RESTART:
    case TL_CONTROL_ABSENT:
    case TL_CONTROL_RESULTS:
        break;
    }
    return TL_BAD_DATA;
}

/* Of a rollback it is what was wanted. */
static void take_end(reload *self, const tl_control_end *end) {
    tl_control_result result = (tl_control_result)end->result;
    self->ended = true;
    self->status = status_of(result);
    if (self->status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s: %s", tl_control_result_name(result), end->text);
    } else if (end->text[0] != '\0') {
        (void)fprintf(self->output, "%s\n", end->text);
    }
}

static void print_reply(reload *self, const tl_control_reply *reply) {
    switch ((tl_control_kind)reply->kind) {
    case TL_CONTROL_STATE:
        print_state(&reply->as.state, self->output);
        break;
    case TL_CONTROL_VERSION:
        print_version(&reply->as.version, self->output);
        break;
    case TL_CONTROL_CHANGE:
        print_change(reply, self->output);
        break;
    case TL_CONTROL_PROBLEM:
        print_problem(self, reply);
        break;
    case TL_CONTROL_STEP:
        (void)fprintf(self->output, "%-10s  %s\n", tl_control_step_name((tl_control_step)reply->as.progress.step),
                      reply->as.progress.text);
        break;
    case TL_CONTROL_END:
        take_end(self, &reply->as.end);
        break;
    case TL_CONTROL_CONFIGURATION:
    case TL_CONTROL_KINDS:
        break;
    }
    (void)fflush(self->output);
}

static tl_status hear(reload *self, int socket, tl_error *error) {
    tl_time patience = PATIENCE;
    while (!self->ended) {
        tl_control_reply reply;
        tl_status status = tl_control_next(socket, patience, &reply, self->text, error);
        if (status != TL_OK) {
            return status;
        }
        print_reply(self, &reply);
        bool waits = reply.kind == TL_CONTROL_STEP && reply.as.progress.step == TL_CONTROL_PROBATION;
        patience = waits ? PATIENCE_ON_PROBATION : PATIENCE;
    }
    return TL_OK;
}

int tl_verb_reload(const tl_options *options) {
    static reload self; /* it is large */
    tl_error error;
    int socket = -1;
    self = (reload){.options = options, .output = tl_output_claim()};
    tl_status status = find_socket(&self, &error);
    fill_request(&self);
    bool takes = self.request.verb == TL_CONTROL_TAKE;
    if (status == TL_OK && takes) {
        status = read_file(&self, &error);
    }
    if (status == TL_OK) {
        status = tl_control_connect(self.path, &socket, &error);
    }
    if (status == TL_OK) {
        status = tl_control_ask(socket, &self.request, takes ? self.text : NULL, self.size, &error);
    }
    if (status == TL_OK) {
        status = hear(&self, socket, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    if (socket >= 0) {
        (void)close(socket);
    }
    return tl_exit_code(tl_output_finish(self.output, status == TL_OK ? self.status : status));
}
