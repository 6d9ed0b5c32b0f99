/* Lines: see push_lines.h. */
#include "firmware/push/push_lines.h"

#include <string.h>

#include "firmware/control/control_words.h"
#include "firmware/text/clean_text.h"
#include "firmware/text/json_reader.h"
#include "firmware/text/json_writer.h"

enum { CLEAN = 2048, HASH_SHOWN = 12 };

/* A member as a terminal may have it. */
typedef struct clean {
    char text[CLEAN];
} clean;

static clean text_of(tl_json_reader *json, const char *key) {
    clean copy = {""};
    const char *text = tl_json_text(json, key);
    (void)tl_clean_text(text, strlen(text), copy.text, sizeof copy.text);
    return copy;
}

static unsigned long long count_of(tl_json_reader *json, const char *key) {
    return tl_json_count(json, key);
}

/* ---- one line of each kind ---- */

static void tell_step(tl_push_lines *lines, tl_json_reader *json) {
    clean step = text_of(json, "step");
    clean text = text_of(json, "text");
    unsigned long long left = count_of(json, "left_s");
    (void)fprintf(lines->file, "%s", step.text);
    if (left > 0 && strcmp(step.text, "probation") == 0) { /* also told by what comes before another one's end */
        (void)fprintf(lines->file, ", %llu s left", left);
    }
    (void)fprintf(lines->file, "%s%s\n", text.text[0] != '\0' ? ": " : "", text.text);
}

static void tell_more(tl_push_lines *lines, tl_json_reader *json) {
    unsigned long long more = count_of(json, "more");
    if (more > 0) {
        (void)fprintf(lines->file, "  and %llu more\n", more);
    }
}

static void tell_change(tl_push_lines *lines, tl_json_reader *json) {
    clean path = text_of(json, "path");
    clean before = text_of(json, "before");
    clean after = text_of(json, "after");
    clean kind = text_of(json, "kind");
    clean right = text_of(json, "right");
    (void)fprintf(lines->file, "  %s: %s → %s (%s%s)\n", path.text, before.text[0] != '\0' ? before.text : "nothing",
                  after.text[0] != '\0' ? after.text : "nothing", kind.text, tl_control_right_note(right.text));
    tell_more(lines, json);
}

/* "motor.json:7: synchronise.margin: found -1, …", as compilers do. */
static void tell_problem(tl_push_lines *lines, tl_json_reader *json) {
    clean path = text_of(json, "path");
    clean text = text_of(json, "text");
    unsigned long long line = count_of(json, "line");
    (void)fprintf(lines->file, "%s:", lines->config != NULL ? lines->config : "configuration");
    if (line > 0) {
        (void)fprintf(lines->file, "%llu:", line);
    }
    (void)fprintf(lines->file, " %s%s%s\n", path.text, path.text[0] != '\0' ? ": " : "", text.text);
    tell_more(lines, json);
}

static void tell_state(tl_push_lines *lines, tl_json_reader *json) {
    clean plant = text_of(json, "plant");
    clean lock = text_of(json, "lock");
    clean step = text_of(json, "step");
    clean hash = text_of(json, "hash");
    clean line = text_of(json, "line");
    unsigned long long left = count_of(json, "left_s");
    (void)fprintf(lines->file, "%s: %s, version %llu (%.*s…)", plant.text,
                  lock.text[0] != '\0' ? lock.text : "nothing runs", count_of(json, "version"), (int)HASH_SHOWN,
                  hash.text);
    if (strcmp(step.text, "idle") != 0) {
        (void)fprintf(lines->file, ", %s", step.text);
    }
    if (left > 0) {
        (void)fprintf(lines->file, " with %llu s left", left);
    }
    (void)fprintf(lines->file, "\n%s%s", line.text, line.text[0] != '\0' ? "\n" : "");
}

static void tell_version(tl_push_lines *lines, tl_json_reader *json) {
    clean hash = text_of(json, "hash");
    clean at = text_of(json, "at");
    clean who = text_of(json, "who");
    clean why = text_of(json, "why");
    clean result = text_of(json, "result");
    char number[24] = "-"; /* of what never was a version */
    if (count_of(json, "version") != 0) {
        (void)snprintf(number, sizeof number, "%llu", count_of(json, "version"));
    }
    (void)fprintf(lines->file, "%c %4s  %.*s  %-24s  %-12s  %s%s%s\n", tl_json_truth(json, "is_active") ? '*' : ' ',
                  number, (int)HASH_SHOWN, hash.text, at.text, who.text, result.text, why.text[0] != '\0' ? ": " : "",
                  why.text);
}

static void tell_end(tl_push_lines *lines, tl_json_reader *json) {
    clean result = text_of(json, "result");
    clean text = text_of(json, "text");
    unsigned long long version = count_of(json, "version");
    (void)fprintf(lines->file, "%s", result.text);
    if (version > 0) {
        (void)fprintf(lines->file, " (version %llu is active)", version);
    }
    (void)fprintf(lines->file, "%s%s\n", text.text[0] != '\0' ? ": " : "", text.text);
}

static const struct {
    const char *reply;
    void (*tell)(tl_push_lines *lines, tl_json_reader *json);
} TELLERS[] = {
    {"step", tell_step},   {"change", tell_change},   {"problem", tell_problem},
    {"state", tell_state}, {"version", tell_version}, {"end", tell_end},
};

/* ---- lines ---- */

static void copy(tl_json_reader *json, const char *key, char *to, size_t room) {
    clean text = text_of(json, key);
    (void)snprintf(to, room, "%.*s", (int)room - 1, text.text);
}

static void note_state(tl_push_lines *lines, tl_json_reader *json) {
    tl_push_state *state = &lines->state;
    copy(json, "hash", state->hash, sizeof state->hash);
    copy(json, "step", state->step, sizeof state->step);
    state->version = count_of(json, "version");
    state->left_s = count_of(json, "left_s");
    state->runs = tl_json_text(json, "lock")[0] != '\0';
}

static void note_version(tl_push_lines *lines, tl_json_reader *json) {
    clean result = text_of(json, "result");
    const char *colon = strstr(result.text, ": ");
    if (lines->wanted != 0 && count_of(json, "version") == lines->wanted) {
        (void)snprintf(lines->version_result, sizeof lines->version_result, "%.*s",
                       (int)sizeof lines->version_result - 1, colon != NULL ? colon + 2 : result.text);
    }
}

static void note(tl_push_lines *lines, tl_json_reader *json, const char *reply) {
    if (strcmp(reply, "end") == 0) {
        copy(json, "result", lines->result, sizeof lines->result);
        copy(json, "hash", lines->hash, sizeof lines->hash);
        lines->version = count_of(json, "version");
    } else if (strcmp(reply, "step") == 0) {
        copy(json, "step", lines->step, sizeof lines->step);
    } else if (strcmp(reply, "state") == 0) {
        note_state(lines, json);
    } else if (strcmp(reply, "version") == 0) {
        note_version(lines, json);
    }
}

/* What is of a later version and not known here is passed over; what is no object ends it all. */
static void tell_line(tl_push_lines *lines) {
    tl_json_reader json = tl_json_reader_of(lines->line, lines->used);
    lines->is_broken = !json.right;
    const char *reply = json.right ? tl_json_text(&json, "reply") : "";
    note(lines, &json, reply);
    if (lines->file == NULL) {
        tl_json_reader_free(&json);
        return;
    }
    if (lines->as_json && !lines->is_broken) {
        (void)fprintf(lines->file, "%.*s\n", (int)lines->used, lines->line);
    }
    for (size_t i = 0; i < sizeof TELLERS / sizeof TELLERS[0] && !lines->as_json; i++) {
        if (strcmp(reply, TELLERS[i].reply) == 0) {
            TELLERS[i].tell(lines, &json);
        }
    }
    tl_json_reader_free(&json);
    (void)fflush(lines->file);
}

void tl_push_lines_begin(tl_push_lines *lines, FILE *file, bool as_json, const char *config) {
    lines->file = file;
    lines->as_json = as_json;
    lines->config = config;
    lines->result[0] = '\0';
    lines->hash[0] = '\0';
    lines->version = 0;
    lines->step[0] = '\0';
    lines->state = (tl_push_state){.hash = ""};
    lines->wanted = 0;
    lines->version_result[0] = '\0';
    lines->used = 0;
    lines->is_broken = false;
}

void tl_push_lines_take(tl_push_lines *lines, const char *bytes, size_t size) {
    for (size_t i = 0; i < size && !lines->is_broken; i++) {
        if (bytes[i] == '\n') {
            tell_line(lines);
            lines->used = 0;
        } else if (lines->used == sizeof lines->line) {
            lines->is_broken = true;
        } else {
            lines->line[lines->used] = bytes[i];
            lines->used++;
        }
    }
}

/* ---- what is told in place of the box ---- */

static void tell_made(tl_push_lines *lines, tl_json_writer *json) {
    char line[4 * TL_PUSH_SENTENCE];
    size_t length = tl_json_writer_line(json, line, sizeof line);
    tl_json_writer_free(json);
    tl_push_lines_take(lines, line, length);
    tl_push_lines_take(lines, "\n", 1);
}

void tl_push_lines_say(tl_push_lines *lines, const char *step, unsigned long long left_s, const char *text) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "reply", "step");
    tl_json_add_text(&json, "step", step);
    tl_json_add_count(&json, "left_s", left_s);
    tl_json_add_text(&json, "text", text);
    tell_made(lines, &json);
}

void tl_push_lines_end(tl_push_lines *lines, const char *result, const tl_push_state *now, const char *text) {
    tl_json_writer json;
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "reply", "end");
    tl_json_add_text(&json, "result", result);
    tl_json_add_count(&json, "version", now->version);
    tl_json_add_text(&json, "hash", now->hash);
    tl_json_add_text(&json, "text", text);
    tell_made(lines, &json);
}
