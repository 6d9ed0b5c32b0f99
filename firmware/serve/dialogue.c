/* Dialogue: see dialogue.h. */
#include "firmware/serve/dialogue.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/json.h"
#include "firmware/base/text.h"
#include "firmware/retune/control.h"
#include "firmware/serve/address.h"

/* ---- reply as a line ---- */

enum { PLANTS = 256, CLEAN = 4 * TL_CONTROL_TEXT };

static void add_text(tl_json_writer *json, const char *key, const char *text) {
    char clean[CLEAN];
    (void)tl_clean_text(text, strlen(text), clean, sizeof clean);
    tl_json_add_text(json, key, clean);
}

static void add_state(tl_json_writer *json, const tl_control_state *state) {
    add_text(json, "plant", state->plant);
    add_text(json, "hash", state->hash);
    tl_json_add_count(json, "version", state->version);
    add_text(json, "step", tl_control_step_name((tl_control_step)state->step));
    tl_json_add_count(json, "left_s", state->left_s);
    tl_control_add_figures(json, state);
}

static void add_version(tl_json_writer *json, const tl_control_version *version) {
    tl_json_add_count(json, "version", version->version);
    tl_json_add_count(json, "parent", version->parent);
    tl_json_add_truth(json, "is_active", version->is_active != 0);
    add_text(json, "hash", version->hash);
    add_text(json, "kind", version->kind);
    add_text(json, "origin", version->origin);
    add_text(json, "right", version->right);
    add_text(json, "who", version->who);
    add_text(json, "why", version->why);
    add_text(json, "at", version->at);
    add_text(json, "result", version->result);
}

static void add_change(tl_json_writer *json, const tl_control_change *change, uint32_t more) {
    add_text(json, "path", change->path);
    add_text(json, "before", change->before);
    add_text(json, "after", change->after);
    add_text(json, "kind", change->kind);
    add_text(json, "right", change->right);
    tl_json_add_count(json, "more", more);
}

static const char *const KINDS[TL_CONTROL_KINDS] = {
    [TL_CONTROL_STATE] = "state",   [TL_CONTROL_VERSION] = "version", [TL_CONTROL_CONFIGURATION] = "version",
    [TL_CONTROL_CHANGE] = "change", [TL_CONTROL_PROBLEM] = "problem", [TL_CONTROL_STEP] = "step",
    [TL_CONTROL_END] = "end",
};

static void add_reply(tl_json_writer *json, const tl_control_reply *reply) {
    tl_json_add_text(json, "reply", KINDS[reply->kind]);
    switch ((tl_control_kind)reply->kind) {
    case TL_CONTROL_STATE:
        add_state(json, &reply->as.state);
        break;
    case TL_CONTROL_VERSION:
    case TL_CONTROL_CONFIGURATION:
        add_version(json, &reply->as.version);
        break;
    case TL_CONTROL_CHANGE:
        add_change(json, &reply->as.change, reply->more);
        break;
    case TL_CONTROL_PROBLEM:
        tl_json_add_count(json, "line", reply->as.problem.line);
        add_text(json, "path", reply->as.problem.path);
        add_text(json, "text", reply->as.problem.text);
        tl_json_add_count(json, "more", reply->more);
        break;
    case TL_CONTROL_STEP:
        add_text(json, "step", tl_control_step_name((tl_control_step)reply->as.progress.step));
        tl_json_add_count(json, "left_s", reply->as.progress.left_s);
        add_text(json, "text", reply->as.progress.text);
        break;
    case TL_CONTROL_END:
    case TL_CONTROL_KINDS:
        add_text(json, "result", tl_control_result_name((tl_control_result)reply->as.end.result));
        tl_json_add_count(json, "version", reply->as.end.version);
        add_text(json, "hash", reply->as.end.hash);
        add_text(json, "text", reply->as.end.text);
        break;
    }
}

size_t tl_answer_line(const tl_control_reply *reply, char line[TL_ANSWER_LINE]) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    add_reply(&json, reply);
    size_t length = tl_json_writer_line(&json, line, TL_ANSWER_LINE - 1);
    tl_json_writer_free(&json);
    if (length > 0) {
        line[length] = '\n';
        line[length + 1] = '\0';
        length++;
    }
    return length;
}

tl_http_status tl_answer_status(uint32_t result) {
    static const tl_http_status statuses[TL_CONTROL_RESULTS] = {
        [TL_CONTROL_DONE] = TL_HTTP_OK,          [TL_CONTROL_SAME] = TL_HTTP_OK,
        [TL_CONTROL_BAD] = TL_HTTP_BAD_REQUEST,  [TL_CONTROL_FORBIDDEN] = TL_HTTP_FORBIDDEN,
        [TL_CONTROL_CHANGED] = TL_HTTP_CHANGED,  [TL_CONTROL_INVALID] = TL_HTTP_INVALID,
        [TL_CONTROL_RESTART] = TL_HTTP_CONFLICT, [TL_CONTROL_BUSY] = TL_HTTP_CONFLICT,
        [TL_CONTROL_ABSENT] = TL_HTTP_NOT_FOUND, [TL_CONTROL_FAILED] = TL_HTTP_FAILED,
        [TL_CONTROL_UNDONE] = TL_HTTP_CONFLICT,  [TL_CONTROL_CANCELLED] = TL_HTTP_CONFLICT,
    };
    return statuses[result];
}

/* ---- text ---- */

static bool append(tl_dialogue *dialogue, const char *text, size_t size) {
    if (size > TL_DIALOGUE_MOST - dialogue->size) {
        return false;
    }
    char *grown = size > 0 ? realloc(dialogue->text, dialogue->size + size) : NULL;
    if (grown == NULL) {
        return false;
    }
    memcpy(grown + dialogue->size, text, size);
    dialogue->text = grown;
    dialogue->size += size;
    return true;
}

static void close_socket(tl_dialogue *dialogue) {
    if (dialogue->is_asked) {
        (void)close(dialogue->socket);
    }
    dialogue->is_asked = false;
    dialogue->has_ended = true;
}

void tl_dialogue_refuse(tl_dialogue *dialogue, tl_http_status status, tl_control_result result, const char *sentence) {
    char line[TL_ANSWER_LINE];
    tl_control_reply reply = {.kind = TL_CONTROL_END, .as.end.result = result};
    (void)snprintf(reply.as.end.text, sizeof reply.as.end.text, "%s", sentence);
    close_socket(dialogue);
    dialogue->result = tl_control_result_name(result);
    dialogue->is_text = false;
    if (dialogue->status == 0) {
        dialogue->size = 0;
        dialogue->status = status;
    }
    (void)append(dialogue, line, tl_answer_line(&reply, line));
}

bool tl_dialogue_add_body(tl_dialogue *dialogue, const char *bytes, size_t size) {
    size_t whole = dialogue->request.body;
    if (dialogue->body == NULL) {
        dialogue->body = malloc(whole);
    }
    if (dialogue->body == NULL || size > whole - dialogue->body_size) {
        return false;
    }
    memcpy(dialogue->body + dialogue->body_size, bytes, size);
    dialogue->body_size += size;
    return true;
}

size_t tl_dialogue_take(tl_dialogue *dialogue, char *to, size_t room) {
    size_t left = dialogue->size - dialogue->taken;
    size_t now = left < room ? left : room;
    if (now > 0) {
        memcpy(to, dialogue->text + dialogue->taken, now);
        dialogue->taken += now;
    }
    if (dialogue->taken == dialogue->size) { /* the buffer is empty: reuse it */
        dialogue->taken = 0;
        dialogue->size = 0;
    }
    return now;
}

void tl_dialogue_close(tl_dialogue *dialogue) {
    close_socket(dialogue);
    free(dialogue->body);
    free(dialogue->text);
    *dialogue = (tl_dialogue){.socket = -1};
}

/* ---- request ---- */

/* Distinguishes a plant that does not exist from a plant that does not answer now. */
static void refuse_plant(tl_dialogue *dialogue, const char *path, tl_status status) {
    struct stat about;
    char sentence[TL_HTTP_SENTENCE];
    const char *plant = dialogue->request.plant;
    if (status == TL_TRY_AGAIN) {
        (void)snprintf(sentence, sizeof sentence, "%s: too many clients at once: try again", plant);
        tl_dialogue_refuse(dialogue, TL_HTTP_UNAVAILABLE, TL_CONTROL_BUSY, sentence);
    } else if (stat(path, &about) != 0 && errno == ENOENT) {
        (void)snprintf(sentence, sizeof sentence, "there is no plant %s with a control socket on this box", plant);
        tl_dialogue_refuse(dialogue, TL_HTTP_NOT_FOUND, TL_CONTROL_ABSENT, sentence);
    } else {
        (void)snprintf(sentence, sizeof sentence,
                       "%s: the twin does not run, or this server has no access to its control socket", plant);
        tl_dialogue_refuse(dialogue, TL_HTTP_UNAVAILABLE, TL_CONTROL_FAILED, sentence);
    }
}

void tl_dialogue_begin(tl_dialogue *dialogue, const char *folder) {
    char path[PATH_MAX];
    tl_error error;
    const tl_control_request *control = &dialogue->request.control;
    if (snprintf(path, sizeof path, "%s/%s/%s", folder, dialogue->request.plant, TL_CONTROL_SOCKET) >= PATH_MAX) {
        path[0] = '\0';
    }
    tl_status status = tl_control_connect(path, &dialogue->socket, &error);
    dialogue->is_asked = status == TL_OK;
    if (status == TL_OK) {
        status = tl_control_ask(dialogue->socket, control, dialogue->body, dialogue->body_size, &error);
    }
    free(dialogue->body);
    dialogue->body = NULL;
    if (status != TL_OK) {
        refuse_plant(dialogue, path, status);
    }
}

/* ---- plants ---- */

static int by_name(const void *one, const void *other) {
    return strcmp(one, other);
}

/* Finds the plants that have a socket, sorted by name. */
static size_t find_plants(const char *folder, char (*plants)[TL_CONTROL_NAME]) {
    size_t count = 0;
    char path[PATH_MAX];
    struct stat about;
    DIR *opened = opendir(folder);
    const struct dirent *entry = NULL;
    while (opened != NULL && count < PLANTS && (entry = readdir(opened)) != NULL) {
        bool is_good = tl_plain_name(entry->d_name);
        if (is_good && snprintf(path, sizeof path, "%s/%s/%s", folder, entry->d_name, TL_CONTROL_SOCKET) < PATH_MAX &&
            stat(path, &about) == 0 && S_ISSOCK(about.st_mode)) {
            memcpy(plants[count], entry->d_name, strlen(entry->d_name) + 1);
            count++;
        }
    }
    if (opened != NULL) {
        (void)closedir(opened);
    }
    qsort(plants, count, TL_CONTROL_NAME, by_name);
    return count;
}

void tl_dialogue_list_plants(tl_dialogue *dialogue, const char *folder) {
    char plants[PLANTS][TL_CONTROL_NAME];
    char line[PLANTS * (TL_CONTROL_NAME + 4)];
    tl_json_writer json;
    size_t count = find_plants(folder, plants);
    tl_json_writer_begin(&json);
    tl_json_open_array(&json, "plants");
    for (size_t i = 0; i < count; i++) {
        tl_json_add_text(&json, NULL, plants[i]);
    }
    tl_json_close(&json);
    size_t length = tl_json_writer_line(&json, line, sizeof line);
    tl_json_writer_free(&json);
    bool is_whole = length > 0 && append(dialogue, line, length) && append(dialogue, "\n", 1);
    dialogue->status = is_whole ? TL_HTTP_OK : TL_HTTP_UNAVAILABLE;
    dialogue->has_ended = true;
}

/* ---- replies ---- */

static void append_line(tl_dialogue *dialogue, const tl_control_reply *reply) {
    char line[TL_ANSWER_LINE];
    (void)append(dialogue, line, tl_answer_line(reply, line));
}

/* The answer of a successful query has no "end" line. A change has one. */
static void handle_end(tl_dialogue *dialogue, const tl_control_reply *reply) {
    const tl_control_end *end = &reply->as.end;
    tl_http_status status = tl_answer_status(end->result);
    bool is_query = !dialogue->request.is_change;
    if (is_query && status != TL_HTTP_OK) {
        tl_dialogue_refuse(dialogue, status, (tl_control_result)end->result, end->text);
        return;
    }
    if (!is_query) {
        append_line(dialogue, reply);
        dialogue->version = end->version;
        memcpy(dialogue->hash, end->hash, sizeof dialogue->hash);
    }
    dialogue->result = tl_control_result_name((tl_control_result)end->result);
    dialogue->status = dialogue->status == 0 ? status : dialogue->status;
    close_socket(dialogue);
}

static void handle_reply(tl_dialogue *dialogue, const tl_control_reply *reply, const char *text) {
    if (reply->kind == TL_CONTROL_END) {
        handle_end(dialogue, reply);
    } else if (reply->kind == TL_CONTROL_CONFIGURATION && dialogue->request.control.verb == TL_CONTROL_READ) {
        dialogue->is_text = append(dialogue, text, reply->more);
        dialogue->version = reply->as.version.version;
        memcpy(dialogue->hash, reply->as.version.hash, sizeof dialogue->hash);
    } else {
        append_line(dialogue, reply);
        bool starts = dialogue->request.is_change && reply->kind == TL_CONTROL_STEP &&
                      reply->as.progress.step > TL_CONTROL_VALIDATE;
        dialogue->status = dialogue->status == 0 && starts ? TL_HTTP_OK : dialogue->status;
    }
}

/* There is always space for a line; also for a configuration, because the answer then contains
 * nothing else. */
bool tl_dialogue_can_receive(const tl_dialogue *dialogue) {
    return dialogue->is_asked && dialogue->size <= TL_DIALOGUE_MOST - TL_CONTROL_MOST;
}

void tl_dialogue_follow(tl_dialogue *dialogue, char *room) {
    tl_control_reply reply;
    tl_error error;
    while (tl_dialogue_can_receive(dialogue)) {
        tl_status status = tl_control_next(dialogue->socket, 0, &reply, room, &error);
        if (status == TL_TRY_AGAIN) {
            return;
        }
        if (status != TL_OK) {
            tl_dialogue_refuse(dialogue, TL_HTTP_UNAVAILABLE, TL_CONTROL_FAILED, error.text);
            return;
        }
        handle_reply(dialogue, &reply, room);
    }
}
