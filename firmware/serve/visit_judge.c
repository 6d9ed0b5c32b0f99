/* Whether a request may be asked: see server_parts.h. In this order, so that a stranger learns nothing: the form of its head, its Host, its
 * delay, its token, what it asks for, whether it may. Nothing of a body has been read by then. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "firmware/base/clock.h"
#include "firmware/retune/control_words.h"
#include "firmware/serve/server_parts.h"

static const char SCHEME[] = "Bearer ";

static const char *header(struct MHD_Connection *connection, const char *name) {
    return MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
}

static tl_http_status refuse(tl_visit *visit, tl_http_status status, tl_control_result result, const char *sentence) {
    tl_dialogue_refuse(&visit->dialogue, status, result, sentence);
    return status;
}

/* ---- the form of the head ---- */

/* Two headers of one of these names give a request two meanings. */
static const char *const SINGLE_HEADERS[] = {
    MHD_HTTP_HEADER_HOST,           MHD_HTTP_HEADER_AUTHORIZATION,    MHD_HTTP_HEADER_IF_MATCH,
    MHD_HTTP_HEADER_CONTENT_LENGTH, MHD_HTTP_HEADER_CONTENT_ENCODING, MHD_HTTP_HEADER_TRANSFER_ENCODING,
};

static const char NAME_LETTERS[] = "!#$%&'*+-.^_`|~0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";

typedef struct head_check {
    const char *end; /* of the part that was checked */
    unsigned seen;   /* a bit for each of SINGLE_HEADERS */
    bool is_good;
} head_check;

/* Whether a part of the head begins where the part before it ends.
 * libmicrohttpd refuses NUL, folded lines and a bare LF from 0.9.77 on; older versions accept them.
 * The old ones split the head in place: they overwrite CR and LF with one zero each. A NUL in a text,
 * a line without CR, and a line that was moved to unfold it change the distance of two parts.
 * Undetected remain NUL LF as the end of a line, and lines before a request that are empty or begin
 * with NUL. They do not change where the request or its body ends. */
static bool has_no_gap(const head_check *check, const char *part) {
    return MHD_VERSION >= 0x00097701 || part == check->end;
}

static bool has_control_character(const char *value) {
    while (*value == '\t' || ((unsigned char)*value >= ' ' && *value != 0x7F)) {
        value++;
    }
    return *value != '\0';
}

static enum MHD_Result check_header(void *context, enum MHD_ValueKind kind, const char *name, const char *value) {
    head_check *check = context;
    (void)kind;
    check->is_good = has_no_gap(check, name) && name[0] != '\0' && name[strspn(name, NAME_LETTERS)] == '\0' &&
                     !has_control_character(value);
    for (size_t i = 0; i < sizeof SINGLE_HEADERS / sizeof SINGLE_HEADERS[0]; i++) {
        unsigned bit = strcasecmp(name, SINGLE_HEADERS[i]) == 0 ? 1U << i : 0U;
        check->is_good = check->is_good && (check->seen & bit) == 0;
        check->seen |= bit;
    }
    check->end = value + strlen(value) + strlen("\r\n");
    return check->is_good ? MHD_YES : MHD_NO;
}

static bool is_well_formed(const tl_visit *visit, struct MHD_Connection *connection, const char *method,
                           const char *protocol) {
    size_t size = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE)->header_size;
    head_check check = {.end = method + strlen(method) + strlen(" ") + visit->target_length + strlen(" ")};
    check.is_good = has_no_gap(&check, protocol);
    if (!check.is_good) {
        return false;
    }
    check.end = protocol + strlen(protocol) + strlen("\r\n");
    (void)MHD_get_connection_values(connection, MHD_HEADER_KIND, check_header, &check);
    check.end += strlen("\r\n");
    return check.is_good && has_no_gap(&check, method + size);
}

/* ---- tokens ---- */

static bool is_unchanged(const struct stat *one, const struct stat *other) {
    return one->st_ino == other->st_ino && one->st_dev == other->st_dev && one->st_size == other->st_size &&
           one->st_mtim.tv_sec == other->st_mtim.tv_sec && one->st_mtim.tv_nsec == other->st_mtim.tv_nsec;
}

/* `twinlock token` puts another file in the place of the one that was read. */
static void renew_tokens(tl_server *server) {
    struct stat about;
    tl_error error;
    memset(&about, 0, sizeof about);
    (void)stat(server->settings.tokens, &about);
    if (is_unchanged(&about, &server->tokens_seen)) {
        return;
    }
    server->tokens_seen = about;
    if (tl_tokens_read(server->settings.tokens, &server->tokens, &error) != TL_OK) {
        tl_log_limited(&server->says, TL_LOG_WARNING, "nobody may do anything by the network: %s", error.text);
    }
}

static tl_http_status refuse_token(tl_server *server, tl_visit *visit, const char *why) {
    tl_token_delays_add(&server->token_delays, &visit->address, tl_clock_now(NULL));
    tl_log_limited(&server->says, TL_LOG_WARNING, "a wrong token from %s", visit->from);
    return refuse(visit, TL_HTTP_UNAUTHORISED, TL_CONTROL_FORBIDDEN, why);
}

static tl_http_status judge_token(tl_server *server, tl_visit *visit, const char *word, tl_control_right *right) {
    if (tl_token_delays_left(&server->token_delays, &visit->address, tl_clock_now(NULL)) > 0) {
        return refuse(visit, TL_HTTP_TOO_MANY, TL_CONTROL_BUSY, "too many wrong tokens came from your address: wait");
    }
    if (word == NULL) {
        return refuse(visit, TL_HTTP_UNAUTHORISED, TL_CONTROL_FORBIDDEN,
                      "a token is missing: Authorization: Bearer TOKEN; `twinlock token add` makes one on the box");
    }
    if (strncasecmp(word, SCHEME, strlen(SCHEME)) != 0) {
        return refuse_token(server, visit, "Authorization is no Bearer token");
    }
    renew_tokens(server);
    const tl_token *token = tl_tokens_find(&server->tokens, word + strlen(SCHEME));
    if (token == NULL) {
        return refuse_token(server, visit, "no such token");
    }
    memcpy(visit->token, token->name, sizeof visit->token);
    server->guests.rows[visit->place].is_known = true;
    *right = token->role;
    return TL_HTTP_OK;
}

/* ---- the request ---- */

static tl_http_status judge_words(tl_visit *visit, struct MHD_Connection *connection, const char *method) {
    char sentence[TL_HTTP_SENTENCE] = "";
    const tl_http_words words = {
        .method = method,
        .target = visit->target,
        .if_match = header(connection, MHD_HTTP_HEADER_IF_MATCH),
        .content_length = header(connection, MHD_HTTP_HEADER_CONTENT_LENGTH),
        .content_encoding = header(connection, MHD_HTTP_HEADER_CONTENT_ENCODING),
        .transfer_encoding = header(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING),
    };
    tl_http_status status = tl_http_request_read(&words, &visit->dialogue.request, sentence);
    tl_control_result result = status == TL_HTTP_NOT_FOUND ? TL_CONTROL_ABSENT
                               : status == TL_HTTP_CHANGED ? TL_CONTROL_CHANGED
                                                           : TL_CONTROL_BAD;
    return status == TL_HTTP_OK ? status : refuse(visit, status, result, sentence);
}

static tl_http_status judge_right(tl_visit *visit, tl_control_right right) {
    tl_http_request *request = &visit->dialogue.request;
    request->control.right = right;
    (void)snprintf(request->control.who, sizeof request->control.who, "%s", visit->token);
    if (request->is_change && right < TL_CONTROL_MAY_RETUNE) {
        return refuse(visit, TL_HTTP_FORBIDDEN, TL_CONTROL_FORBIDDEN, "this token may read, and change nothing");
    }
    return TL_HTTP_OK;
}

tl_http_status tl_visit_judge(tl_server *server, tl_visit *visit, struct MHD_Connection *connection, const char *method,
                              const char *protocol) {
    tl_control_right right = TL_CONTROL_MAY_READ;
    if (!is_well_formed(visit, connection, method, protocol)) {
        return refuse(
            visit, TL_HTTP_BAD_REQUEST, TL_CONTROL_BAD,
            "request head: a header occurs twice, or a line is not \"Name: value\" without control characters "
            "and with CR LF behind it; repair the client");
    }
    if (!tl_host_names_know(server->settings.names, header(connection, MHD_HTTP_HEADER_HOST), visit->local)) {
        return refuse(visit, TL_HTTP_MISDIRECTED, TL_CONTROL_BAD,
                      "this server is not called so: use its address, or a name that `twinlock serve --host` has");
    }
    tl_http_status status = judge_token(server, visit, header(connection, MHD_HTTP_HEADER_AUTHORIZATION), &right);
    status = status == TL_HTTP_OK ? judge_words(visit, connection, method) : status;
    return status == TL_HTTP_OK ? judge_right(visit, right) : status;
}
