/* Whether a request may be asked: see server_parts.h. In this order, so that a stranger learns nothing: how it calls us, how often it was
 * wrong, its token, what it asks for, whether it may. Nothing of a body has been read by then. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "firmware/base/clock.h"
#include "firmware/control/control_words.h"
#include "firmware/serve/server_parts.h"

static const char SCHEME[] = "Bearer ";

static const char *header(struct MHD_Connection *connection, const char *name) {
    return MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
}

static tl_http_status refuse(tl_visit *visit, tl_http_status status, tl_control_result result, const char *sentence) {
    tl_dialogue_refuse(&visit->dialogue, status, result, sentence);
    return status;
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

tl_http_status tl_visit_judge(tl_server *server, tl_visit *visit, struct MHD_Connection *connection,
                              const char *method) {
    tl_control_right right = TL_CONTROL_MAY_READ;
    if (!tl_host_names_know(server->settings.names, header(connection, MHD_HTTP_HEADER_HOST), visit->local)) {
        return refuse(visit, TL_HTTP_MISDIRECTED, TL_CONTROL_BAD,
                      "this server is not called so: use its address, or a name that `twinlock serve --host` has");
    }
    tl_http_status status = judge_token(server, visit, header(connection, MHD_HTTP_HEADER_AUTHORIZATION), &right);
    status = status == TL_HTTP_OK ? judge_words(visit, connection, method) : status;
    return status == TL_HTTP_OK ? judge_right(visit, right) : status;
}
