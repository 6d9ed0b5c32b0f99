/* Answers: see answer.h. */
#include "firmware/serve/answer.h"

#include <string.h>

#include "firmware/base/json.h"
#include "firmware/base/text.h"
#include "firmware/retune/control.h"

enum { CLEAN = 4 * TL_CONTROL_TEXT };

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
    add_text(json, "lock", state->lock);
    tl_json_add_number(json, "step_s", state->step_s);
    tl_json_add_count(json, "ticks", state->ticks);
    tl_json_add_count(json, "steps", state->steps);
    tl_json_add_count(json, "skipped", state->skipped);
    tl_json_add_count(json, "deadline_misses", state->deadline_misses);
    tl_json_add_number(json, "in_lock", state->in_lock);
    add_text(json, "line", state->line);
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

size_t tl_answer_refusal(tl_control_result result, const char *sentence, char line[TL_ANSWER_LINE]) {
    tl_control_reply reply = {.kind = TL_CONTROL_END, .as.end.result = result};
    size_t length = strnlen(sentence, sizeof reply.as.end.text - 1);
    memcpy(reply.as.end.text, sentence, length);
    return tl_answer_line(&reply, line);
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

bool tl_answer_is_under_way(const tl_control_reply *reply) {
    return reply->kind == TL_CONTROL_STEP && reply->as.progress.step > TL_CONTROL_VALIDATE;
}
