/* A client's dialogue with a plant, over restarts, and what is printed of it: see talk.h. */
#include "firmware/retune/talk.h"

#include <libgen.h>
#include <pwd.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"

/* ---- talk page ---- */

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
    char number[24] = "-"; /* of what never was a version */
    if (version->version != 0) {
        (void)snprintf(number, sizeof number, "%llu", (unsigned long long)version->version);
    }
    (void)fprintf(output, "%c%4s  %.12s  %s  by %s, %s%s%s", version->is_active != 0 ? '*' : ' ', number, version->hash,
                  version->at, version->who, version->origin, version->kind[0] == '\0' ? "" : ", ", version->kind);
    (void)fprintf(output, "\n       %s%s%s\n", version->result, version->why[0] == '\0' ? "" : "; ", version->why);
}

static void print_change(const tl_control_reply *reply, FILE *output) {
    const tl_control_change *change = &reply->as.change;
    (void)fprintf(output, "            %s: %s → %s (%s%s)\n", change->path,
                  change->before[0] == '\0' ? "nothing" : change->before,
                  change->after[0] == '\0' ? "nothing" : change->after, change->kind,
                  tl_control_right_note(change->right));
    if (reply->more > 0) {
        (void)fprintf(output, "            and %u more\n", reply->more);
    }
}

static void print_problem(const tl_talk_page *page, const tl_control_reply *reply) {
    const tl_control_problem *problem = &reply->as.problem;
    const char *separator = problem->path[0] == '\0' ? "" : ": ";
    char line[32] = "";
    if (problem->line != 0) {
        (void)snprintf(line, sizeof line, "line %u: ", problem->line);
    }
    tl_log(TL_LOG_ERROR, "%s: %s%s%s%s", page->subject, line, problem->path, separator, problem->text);
    if (reply->more > 0) {
        tl_log(TL_LOG_ERROR, "%s: and %u more", page->subject, reply->more);
    }
}

static void print_end(const tl_control_end *end, FILE *output) {
    tl_control_result result = (tl_control_result)end->result;
    if (result != TL_CONTROL_DONE && result != TL_CONTROL_SAME) {
        tl_log(TL_LOG_ERROR, "%s: %s", tl_control_result_name(result), end->text);
    } else if (end->text[0] != '\0') {
        (void)fprintf(output, "%s\n", end->text);
    }
}

void tl_talk_page_print(const tl_talk_page *page, const tl_control_reply *reply) {
    FILE *output = page->output;
    switch ((tl_control_kind)reply->kind) {
    case TL_CONTROL_STATE:
        print_state(&reply->as.state, output);
        break;
    case TL_CONTROL_VERSION:
        print_version(&reply->as.version, output);
        break;
    case TL_CONTROL_CHANGE:
        print_change(reply, output);
        break;
    case TL_CONTROL_PROBLEM:
        print_problem(page, reply);
        break;
    case TL_CONTROL_STEP:
        (void)fprintf(output, "%-10s  %s\n", tl_control_step_name((tl_control_step)reply->as.progress.step),
                      reply->as.progress.text);
        break;
    case TL_CONTROL_END:
        print_end(&reply->as.end, output);
        break;
    case TL_CONTROL_CONFIGURATION:
    case TL_CONTROL_KINDS:
        break;
    }
    (void)fflush(output);
}

/* ---- talk ---- */

/* An activator has to be begun first, perhaps, on a loaded box; and a disk may be slow. */
static const tl_time PATIENCE = 200 * TL_SECOND;

/* On probation nothing is said for as long as it lasts. */
static const tl_time PATIENCE_ON_PROBATION = (tl_time)(8 * 24 * 3600) * TL_SECOND;

/* A run that begins anew loads its FMUs before it can be asked; and its answer takes no time then. */
static const tl_time COMING_BACK = 60 * TL_SECOND;
static const tl_time ANSWER = 5 * TL_SECOND;

/* ---- beginning ---- */

tl_status tl_talk_find(const char *subject, const char *given, char path[PATH_MAX], tl_error *error) {
    char copy[PATH_MAX];
    int length = 0;
    if (given == NULL && strcmp(subject, TL_TALK_INPUT) == 0) {
        return tl_fail(error, TL_BAD_USAGE, "standard input names no run (expected --control SOCKET)");
    }
    if (given != NULL) {
        length = snprintf(path, PATH_MAX, "%s", given);
    } else {
        (void)snprintf(copy, sizeof copy, "%s", subject);
        char *name = basename(copy);
        size_t end = strlen(name);
        if (end > strlen(".json") && strcmp(name + end - strlen(".json"), ".json") == 0) {
            name[end - strlen(".json")] = '\0';
        }
        length = snprintf(path, PATH_MAX, "%s/%s/%s", TL_CONTROL_FOLDER, name, TL_CONTROL_SOCKET);
    }
    return length > 0 && length < PATH_MAX
               ? TL_OK
               : tl_fail(error, TL_BAD_USAGE, "the name of the control socket is too long; give --control");
}

void tl_talk_name(uid_t user, char who[TL_CONTROL_NAME]) {
    char room[1024];
    struct passwd about;
    struct passwd *found = NULL;
    if (getpwuid_r(user, &about, room, sizeof room, &found) == 0 && found != NULL) {
        (void)snprintf(who, TL_CONTROL_NAME, "%s", found->pw_name);
    } else {
        (void)snprintf(who, TL_CONTROL_NAME, "user %lu", (unsigned long)user);
    }
}

tl_status tl_talk_open(tl_talk *talk, const tl_talk_settings *settings, tl_error *error) {
    *talk = (tl_talk){.settings = *settings, .socket = -1, .result = TL_CONTROL_FAILED};
    return tl_control_connect(settings->path, &talk->socket, error);
}

tl_status tl_talk_ask(tl_talk *talk, const tl_control_request *request, const char *text, size_t size,
                      tl_error *error) {
    talk->request = *request;
    talk->heard = tl_clock_now(NULL);
    if (text != NULL) {
        tl_sha256(text, size, talk->hash);
    }
    return tl_control_ask(talk->socket, request, text, size, error);
}

static void hang_up(tl_talk *self) {
    if (self->socket >= 0) {
        (void)close(self->socket);
    }
    self->socket = -1;
}

void tl_talk_close(tl_talk *talk) {
    hang_up(talk);
}

/* ---- telling ---- */

static void tell(const tl_talk *self, const tl_control_reply *reply) {
    self->settings.hear(self->settings.context, reply);
}

static void tell_step(const tl_talk *self, tl_control_step step, uint32_t left_s, const char *text) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = TL_CONTROL_STEP;
    reply.as.progress.step = (uint32_t)step;
    reply.as.progress.left_s = left_s;
    (void)snprintf(reply.as.progress.text, sizeof reply.as.progress.text, "%s", text);
    tell(self, &reply);
}

static void tell_end(tl_talk *self, tl_control_result result, const tl_control_state *state, const char *text) {
    tl_control_reply reply;
    memset(&reply, 0, sizeof reply);
    reply.kind = TL_CONTROL_END;
    reply.as.end.result = (uint32_t)result;
    reply.as.end.version = state->version;
    memcpy(reply.as.end.hash, state->hash, sizeof reply.as.end.hash);
    (void)snprintf(reply.as.end.text, sizeof reply.as.end.text, "%s", text);
    self->ended = true;
    self->result = result;
    tell(self, &reply);
}

/* ---- while the connection lasts ---- */

static bool waits(const tl_talk *self) {
    return (self->request.flags & TL_CONTROL_WAIT) != 0;
}

static void note_step(tl_talk *self, tl_control_step step) {
    self->is_tried = step == TL_CONTROL_PROBATION;
    if (step == TL_CONTROL_ACTIVATE) {
        self->is_active = true;
    } else if (step == TL_CONTROL_KEPT || step == TL_CONTROL_RETURNED) {
        self->is_active = false;
    }
}

static void follow(tl_talk *self) {
    hang_up(self);
    self->follows = true;
    self->is_tried = false;
    self->heard = tl_clock_now(NULL);
}

/* Done, and nothing was told of what came of it: the run begins anew with it. */
static void take_end(tl_talk *self, const tl_control_reply *reply) {
    const tl_control_end *end = &reply->as.end;
    if (waits(self) && self->is_active && end->result == TL_CONTROL_DONE) {
        memcpy(self->hash, end->hash, sizeof self->hash);
        self->version = end->version;
        tell_step(self, TL_CONTROL_ACTIVATE, 0, end->text);
        follow(self);
        return;
    }
    self->ended = true;
    self->result = (tl_control_result)end->result;
    hang_up(self);
    tell(self, reply);
}

static tl_status fail_to_hear(tl_talk *self, tl_status status, tl_error *error) {
    tl_time silence = tl_clock_now(NULL) - self->heard;
    tl_time patience = self->is_tried ? PATIENCE_ON_PROBATION : PATIENCE + (tl_time)self->request.shadow_s * TL_SECOND;
    bool is_known = self->hash[0] != '\0';
    if (status == TL_TRY_AGAIN && silence < patience) {
        return TL_OK;
    }
    if (status == TL_PLANT_DOWN && waits(self) && self->is_active && is_known) {
        tell_step(self, self->is_tried ? TL_CONTROL_PROBATION : TL_CONTROL_ACTIVATE, 0, TL_TALK_WAITS);
        follow(self);
        return TL_OK;
    }
    hang_up(self);
    if (status == TL_PLANT_DOWN && self->request.verb != TL_CONTROL_SHOW) {
        return tl_fail(
            error, status,
            "the plant's twin has hung up before it said what came of it: `twinlock reload --state` shows what "
            "is active now, `--versions` what came of each");
    }
    return status;
}

static tl_status listen(tl_talk *self, tl_time time, tl_error *error) {
    tl_control_reply reply;
    tl_status status = tl_control_next(self->socket, time, &reply, NULL, error);
    if (status != TL_OK) {
        return fail_to_hear(self, status, error);
    }
    self->heard = tl_clock_now(NULL);
    if (reply.kind == TL_CONTROL_END) {
        take_end(self, &reply);
        return TL_OK;
    }
    if (reply.kind == TL_CONTROL_STEP) {
        note_step(self, (tl_control_step)reply.as.progress.step);
    }
    tell(self, &reply);
    return TL_OK;
}

/* ---- over a restart ---- */

/* One question to the run that is there now. `number`: of the version wanted. False: nobody answers. */
static bool inquire(const tl_talk *self, tl_control_verb verb, uint64_t number, tl_control_reply *found) {
    tl_control_request request;
    tl_control_reply reply = {.kind = TL_CONTROL_KINDS};
    tl_error error;
    int socket = -1;
    bool is_found = false;
    memset(&request, 0, sizeof request);
    request.verb = (uint32_t)verb;
    memcpy(request.who, self->request.who, sizeof request.who);
    tl_status status = tl_control_connect(self->settings.path, &socket, &error);
    if (status != TL_OK) {
        return false;
    }
    status = tl_control_ask(socket, &request, NULL, 0, &error);
    while (status == TL_OK && reply.kind != TL_CONTROL_END) {
        status = tl_control_next(socket, ANSWER, &reply, NULL, &error);
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

/* What came of it, as the versions say: "kept: in lock for …"; "" if they do not. */
static void ask_result(const tl_talk *self, char text[TL_CONTROL_WHY]) {
    tl_control_reply reply;
    text[0] = '\0';
    if (self->version != 0 && inquire(self, TL_CONTROL_VERSIONS, self->version, &reply)) {
        (void)snprintf(text, TL_CONTROL_WHY, "%s", reply.as.version.result);
    }
}

static const char *behind_colon(const char *text) {
    const char *colon = strstr(text, ": ");
    return colon != NULL ? colon + strlen(": ") : text;
}

static void end_following(tl_talk *self, const tl_control_state *state, bool is_kept) {
    char result[TL_CONTROL_WHY];
    char text[TL_CONTROL_TEXT];
    ask_result(self, result);
    const char *why = behind_colon(result);
    self->follows = false;
    if (is_kept) {
        (void)snprintf(text, sizeof text, "version %llu is kept", (unsigned long long)state->version);
        tell_step(self, TL_CONTROL_KEPT, 0, why);
        tell_end(self, TL_CONTROL_DONE, state, text);
    } else {
        tell_step(self, TL_CONTROL_RETURNED, 0, why);
        tell_end(self, TL_CONTROL_UNDONE, state, why[0] != '\0' ? why : "another version is active");
    }
}

static void take_state(tl_talk *self, const tl_control_state *state) {
    char text[TL_CONTROL_TEXT];
    bool is_ours = strcmp(state->hash, self->hash) == 0;
    self->heard = tl_clock_now(NULL);
    self->version = is_ours ? state->version : self->version;
    if (!is_ours) {
        end_following(self, state, false);
    } else if (state->step == TL_CONTROL_IDLE) {
        end_following(self, state, true);
    } else if (state->step == TL_CONTROL_PROBATION && state->lock[0] != '\0' && !self->is_tried) {
        self->is_tried = true;
        (void)snprintf(text, sizeof text, "%u s are left", state->left_s);
        tell_step(self, TL_CONTROL_PROBATION, state->left_s, text);
    }
}

static tl_status ask_next_run(tl_talk *self, tl_time time, tl_error *error) {
    tl_control_reply reply;
    const struct timespec pause = {.tv_sec = (time_t)(time / TL_SECOND), .tv_nsec = (long)(time % TL_SECOND)};
    (void)nanosleep(&pause, NULL);
    if (inquire(self, TL_CONTROL_SHOW, 0, &reply)) {
        take_state(self, &reply.as.state);
    } else if (tl_clock_now(NULL) - self->heard > COMING_BACK) {
        return tl_fail(
            error, TL_PLANT_DOWN,
            "the run has not come back for 60 s: its log says why; once it runs, `twinlock reload --versions` shows "
            "what came of the change");
    }
    return TL_OK;
}

tl_status tl_talk_look(tl_talk *talk, tl_time time, tl_error *error) {
    return talk->follows ? ask_next_run(talk, time, error) : listen(talk, time, error);
}
