/* twinlock push: see push_verb.h. */
#include "firmware/push/push_verb.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/file_bytes.h"
#include "firmware/base/log.h"
#include "firmware/base/sha256.h"
#include "firmware/control/control_words.h"
#include "firmware/control/last_word.h"
#include "firmware/push/push_follow.h"
#include "firmware/push/push_lines.h"
#include "firmware/push/push_link.h"

enum { PATH = 1024, TOKEN = 256, TOKEN_DIGITS = 64 };

/* One run of the program. */
typedef struct push {
    const tl_push_options *options;
    tl_push_link *link;
    tl_push_lines lines;
    tl_error error;
    char text[TL_CONTROL_MOST + 1]; /* of the configuration */
    size_t size;
    bool has_hung_up; /* the box, before its answer had an end */
} push;

/* ---- files ---- */

static tl_status read_file(const char *path, char *text, size_t most, size_t *size, tl_error *error) {
    int file = open(path, O_RDONLY | O_CLOEXEC);
    ssize_t got = file < 0 ? -1 : tl_file_bytes_read(file, text, most + 1);
    int cause = errno;
    if (file >= 0) {
        (void)close(file);
    }
    if (got < 0) {
        return tl_fail(error, TL_BAD_DATA, "%.300s: cannot be read: %s", path, strerror(cause));
    }
    *size = (size_t)got;
    if (*size > most || *size == 0) {
        return tl_fail(error, TL_BAD_DATA, "%.300s: found %s, expected 1 to %zu bytes", path,
                       *size == 0 ? "nothing" : "more", most);
    }
    return TL_OK;
}

/* From its file, or the environment: never from the command line, which every user of this machine can read. */
static tl_status read_token(const tl_push_options *options, char token[TOKEN], tl_error *error) {
    const char *word = getenv("TWINLOCK_TOKEN");
    size_t size = 0;
    if (options->token_file != NULL) {
        tl_status status = read_file(options->token_file, token, TOKEN - 2, &size, error);
        if (status != TL_OK) {
            return status;
        }
        token[size] = '\0';
    } else if (word != NULL && strlen(word) < TOKEN) {
        memcpy(token, word, strlen(word) + 1);
    } else {
        return tl_fail(
            error, TL_BAD_USAGE,
            "a token is missing: give --token-file FILE, or set TWINLOCK_TOKEN; `twinlock token add` on the box makes one");
    }
    token[strcspn(token, " \t\r\n")] = '\0';
    bool is_one = strlen(token) == TOKEN_DIGITS && strspn(token, "0123456789abcdef") == TOKEN_DIGITS;
    return is_one ? TL_OK
                  : tl_fail(error, TL_BAD_USAGE,
                            "that is no token: expected the 64 digits that `twinlock token add` has shown");
}

/* ---- the end ---- */

/* Of an answer that has come to its end. */
static int code_of(const push *self, long status) {
    tl_control_result result = TL_CONTROL_FAILED;
    if (tl_control_result_of(self->lines.result, &result) && result != TL_CONTROL_FAILED) {
        return tl_control_exit_code(result);
    }
    switch (status) {
    case 200:
        return self->lines.result[0] == '\0' ? 0 : tl_exit_code(TL_TRY_AGAIN);
    case 404:
    case 503:
    case 504:
        return tl_exit_code(TL_PLANT_DOWN);
    case 413:
        return tl_exit_code(TL_BAD_DATA);
    case 400:
    case 405:
    case 421:
        return tl_exit_code(TL_BAD_USAGE);
    default:
        return tl_exit_code(TL_TRY_AGAIN);
    }
}

/* Of one that has not. */
static int code_without(tl_push_outcome outcome) {
    switch (outcome) {
    case TL_PUSH_WRONG:
        return tl_exit_code(TL_BAD_USAGE);
    case TL_PUSH_STRANGER:
        return TL_CONTROL_NOT_PERMITTED;
    case TL_PUSH_NOBODY:
    case TL_PUSH_HUNG_UP:
        return tl_exit_code(TL_PLANT_DOWN);
    case TL_PUSH_OK:
    case TL_PUSH_BROKEN:
        break;
    }
    return tl_exit_code(TL_TRY_AGAIN);
}

/* ---- asking ---- */

static void tell(void *context, long status, const char *bytes, size_t size) {
    push *self = context;
    (void)status;
    tl_push_lines_take(&self->lines, bytes, size);
}

/* The text of a configuration; a refusal is told, since standard output is for the text. */
static void print_text(void *context, long status, const char *bytes, size_t size) {
    if (status == 200) {
        (void)fwrite(bytes, 1, size, stdout);
    } else {
        tell(context, status, bytes, size);
    }
}

static void tell_refusal(void *context, long status, const char *bytes, size_t size) {
    if (status != 200) {
        tell(context, status, bytes, size);
    }
}

/* `key` and what it says, behind what there is: "?a=1", "&why=a%20seal". */
static void add_query(char path[PATH], const char *key, const char *value) {
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-._";
    size_t used = strlen(path);
    used += (size_t)snprintf(path + used, PATH - used, "%c%s=", strchr(path, '?') == NULL ? '?' : '&', key);
    for (const char *letter = value; *letter != '\0' && used + 4 < PATH; letter++) {
        bool is_plain = strchr(plain, *letter) != NULL;
        used += (size_t)snprintf(path + used, PATH - used, is_plain ? "%c" : "%%%02X", (unsigned char)*letter);
    }
}

static void add_flag(char path[PATH], const char *key, bool is_set) {
    if (is_set) {
        add_query(path, key, "1");
    }
}

/* How a change is to be made. */
static void add_options(char path[PATH], const tl_push_options *options) {
    char number[32];
    add_flag(path, "check", options->check);
    add_flag(path, "restart", options->restart);
    add_flag(path, "accept_worse", options->accept_worse);
    add_flag(path, "confirm", options->needs_confirm);
    add_flag(path, "wait", options->wait);
    if (options->probation_s != 0) {
        (void)snprintf(number, sizeof number, "%u", (unsigned)options->probation_s);
        add_query(path, "probation", number);
    }
    if (options->shadow_s != 0) {
        (void)snprintf(number, sizeof number, "%u", (unsigned)options->shadow_s);
        add_query(path, "shadow", number);
    }
    if (options->require_lock > 0.0) {
        (void)snprintf(number, sizeof number, "%.6f", options->require_lock);
        add_query(path, "require_lock", number);
    }
    if (options->action == TL_PUSH_RETURN && options->version != 0) {
        (void)snprintf(number, sizeof number, "%llu", (unsigned long long)options->version);
        add_query(path, "version", number);
    }
    if (options->why != NULL) {
        add_query(path, "why", options->why);
    }
}

/* The exit code. Whatever came is told, also what came before a connection broke. */
static int ask(push *self, tl_push_request *request) {
    request->context = self;
    tl_push_outcome outcome = tl_push_link_ask(self->link, request, &self->error);
    self->has_hung_up = outcome == TL_PUSH_HUNG_UP;
    if (outcome != TL_PUSH_OK) {
        tl_log(TL_LOG_ERROR, "%s", self->error.text);
        return code_without(outcome);
    }
    if (self->lines.is_broken) {
        tl_log(TL_LOG_ERROR, "what the box answers is none of twinlock's answers (status %ld)", request->status);
        return tl_exit_code(TL_TRY_AGAIN);
    }
    return code_of(self, request->status);
}

/* A change that somebody waits for, over the restart that it may take. `hash`: of what is to be active; "": the box has said that. */
static int change(push *self, tl_push_request *request, const char *hash) {
    static const char goes_on[] =
        "if the box has taken the change, it goes on there: --state shows how it is, and --cancel ends it, or returns "
        "from it";
    char wanted[TL_PUSH_HASH];
    tl_last_word_set(goes_on);
    int code = ask(self, request);
    if (self->has_hung_up) {
        tl_log(TL_LOG_NOTICE, "%s", goes_on);
    }
    (void)snprintf(wanted, sizeof wanted, "%s", hash[0] != '\0' ? hash : self->lines.hash);
    bool is_due = self->options->wait && wanted[0] != '\0' && tl_push_follow_is_due(&self->lines);
    code = is_due ? tl_push_follow(self->link, &self->lines, wanted) : code;
    tl_last_word_set(NULL);
    return code;
}

/* ---- what is to be done ---- */

static int ask_plainly(push *self) {
    static const struct {
        const char *method;
        const char *path;
    } rows[] = {
        [TL_PUSH_STATE] = {"GET", ""},
        [TL_PUSH_VERSIONS] = {"GET", "/versions"},
        [TL_PUSH_GET] = {"GET", "/configuration"},
        [TL_PUSH_CONFIRM] = {"POST", "/confirm"},
        [TL_PUSH_CANCEL] = {"DELETE", "/change"},
        [TL_PUSH_RETURN] = {"POST", "/return"},
    };
    char path[PATH];
    const tl_push_options *options = self->options;
    tl_push_request request = {.method = rows[options->action].method,
                               .path = path,
                               .take = options->action == TL_PUSH_GET ? print_text : tell,
                               .can_last = options->action >= TL_PUSH_CONFIRM};
    (void)snprintf(path, sizeof path, "%s", rows[options->action].path);
    if (options->action == TL_PUSH_GET && options->version != 0) {
        (void)snprintf(path, sizeof path, "/versions/%llu", (unsigned long long)options->version);
    }
    if (options->action >= TL_PUSH_CONFIRM) {
        add_options(path, options);
    }
    return options->action == TL_PUSH_RETURN ? change(self, &request, "") : ask(self, &request);
}

/* The tag of what the change is made from: of a file, or of what is active now. */
static int find_base(push *self, char tag[TL_PUSH_TAG]) {
    char hash[TL_SHA256_TEXT];
    size_t size = 0;
    const char *base = self->options->base;
    if (base == NULL) {
        tl_push_request request = {.method = "GET", .path = "/configuration", .take = tell_refusal};
        int code = ask(self, &request);
        (void)snprintf(tag, TL_PUSH_TAG, "%s", request.tag);
        return code;
    }
    if (read_file(base, self->text, TL_CONTROL_MOST, &size, &self->error) != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", self->error.text);
        return tl_exit_code(TL_BAD_DATA);
    }
    tl_sha256(self->text, size, hash);
    (void)snprintf(tag, TL_PUSH_TAG, "\"%s\"", hash);
    return 0;
}

static int give_configuration(push *self) {
    char path[PATH] = "/configuration";
    char hash[TL_SHA256_TEXT];
    char tag[TL_PUSH_TAG];
    int code = find_base(self, tag);
    if (code != 0) {
        return code;
    }
    if (read_file(self->options->config, self->text, TL_CONTROL_MOST, &self->size, &self->error) != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", self->error.text);
        return tl_exit_code(TL_BAD_DATA);
    }
    add_options(path, self->options);
    tl_push_request request = {.method = "PUT",
                               .path = path,
                               .match = tag,
                               .body = self->text,
                               .size = self->size,
                               .can_last = true,
                               .take = tell};
    tl_sha256(self->text, self->size, hash);
    code = change(self, &request, hash);
    if (code == 0 && self->lines.result[0] == '\0') {
        tl_log(TL_LOG_ERROR, "the box did not say how it ended: look at it by --state");
        code = tl_exit_code(TL_TRY_AGAIN);
    }
    return code;
}

static int run(push *self, const char *token) {
    const tl_push_options *options = self->options;
    tl_push_outcome outcome = tl_push_link_open(options->url, options->pin, token, &self->link, &self->error);
    if (outcome != TL_PUSH_OK) {
        tl_log(TL_LOG_ERROR, "%s", self->error.text);
        return code_without(outcome);
    }
    FILE *file = options->action == TL_PUSH_GET ? stderr : stdout;
    tl_push_lines_begin(&self->lines, file, options->json, options->config);
    return options->action == TL_PUSH_CONFIGURATION ? give_configuration(self) : ask_plainly(self);
}

int tl_push_verb_run(const tl_push_options *options) {
    char token[TOKEN];
    push *self = calloc(1, sizeof *self);
    if (self == NULL) {
        tl_log(TL_LOG_ERROR, "out of memory");
        return tl_exit_code(TL_TRY_AGAIN);
    }
    self->options = options;
    tl_status status = read_token(options, token, &self->error);
    int code = tl_exit_code(status);
    if (status == TL_OK) {
        code = run(self, token);
        tl_push_link_close(self->link);
    } else {
        tl_log(TL_LOG_ERROR, "%s", self->error.text);
    }
    explicit_bzero(token, sizeof token);
    free(self);
    if ((fflush(stdout) != 0 || ferror(stdout) != 0) && code == 0) {
        tl_log(TL_LOG_ERROR, "standard output: %s", strerror(errno));
        code = tl_exit_code(TL_TRY_AGAIN);
    }
    return code;
}
