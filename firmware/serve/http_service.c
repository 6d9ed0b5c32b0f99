/* HTTP and TLS, by libmicrohttpd: see server_parts.h.
 *
 * Nothing that it calls waits. A request is answered at once, or its connection is suspended until the plant has said enough. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/clock.h"
#include "firmware/retune/control_client.h"
#include "firmware/serve/answer.h"
#include "firmware/serve/server_parts.h"

enum { PIECE = 16 * 1024, CONNECTION_MEMORY = 16 * 1024, LENGTH = 32, LARGE_BODY = 1024 * 1024 };

/* TLS 1.3, and TLS 1.2 with AEAD ciphers and ECDHE. */
static const char PRIORITIES[] =
    "SECURE128:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2:-KX-ALL:+ECDHE-ECDSA:+ECDHE-RSA:-MAC-ALL:+AEAD:"
    "%SERVER_PRECEDENCE";

void tl_visit_allow(tl_server *server, const tl_visit *visit, tl_time time) {
    server->guests.rows[visit->place].deadline = time == TL_TIME_NEVER ? TL_TIME_NEVER : tl_clock_now(NULL) + time;
}

static tl_visit *visit_of(struct MHD_Connection *connection) {
    return MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context;
}

static void suspend(tl_visit *visit) {
    visit->is_suspended = true;
    MHD_suspend_connection(visit->connection);
}

void tl_visit_resume(tl_visit *visit) {
    visit->is_suspended = false;
    MHD_resume_connection(visit->connection);
}

/* ---- the answer ---- */

/* The next piece of an answer whose end is not known yet. */
static ssize_t give_piece(void *context, uint64_t position, char *to, size_t room) {
    tl_visit *visit = context;
    (void)position;
    size_t now = tl_dialogue_take(&visit->dialogue, to, room);
    if (now == 0 && visit->dialogue.has_ended) {
        return MHD_CONTENT_READER_END_OF_STREAM;
    }
    if (now == 0) {
        suspend(visit);
    }
    return (ssize_t)now;
}

static void add_header(struct MHD_Response *response, const char *name, const char *value) {
    (void)MHD_add_response_header(response, name, value);
}

static void add_headers(struct MHD_Response *response, const tl_visit *visit) {
    const tl_dialogue *dialogue = &visit->dialogue;
    char text[TL_SHA256_TEXT + LENGTH];
    bool is_whole = dialogue->is_text || (dialogue->request.wants_plants && dialogue->status == TL_HTTP_OK);
    add_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, is_whole ? "application/json" : "application/x-ndjson");
    add_header(response, MHD_HTTP_HEADER_CACHE_CONTROL, "no-store");
    add_header(response, "X-Content-Type-Options", "nosniff");
    if (dialogue->is_text) {
        (void)snprintf(text, sizeof text, "\"%s\"", dialogue->hash);
        add_header(response, MHD_HTTP_HEADER_ETAG, text);
        (void)snprintf(text, sizeof text, "%llu", (unsigned long long)dialogue->version);
        add_header(response, "Twinlock-Version", text);
    }
    if (dialogue->status == TL_HTTP_BAD_REQUEST) { /* what follows on the connection may not be a request */
        add_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
    }
    if (dialogue->status == TL_HTTP_UNAUTHORISED) {
        add_header(response, MHD_HTTP_HEADER_WWW_AUTHENTICATE, "Bearer realm=\"twinlock\"");
    }
}

static enum MHD_Result answer(tl_server *server, tl_visit *visit) {
    tl_dialogue *dialogue = &visit->dialogue;
    struct MHD_Response *response =
        dialogue->has_ended ? MHD_create_response_from_buffer(dialogue->size, dialogue->text, MHD_RESPMEM_PERSISTENT)
                            : MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, PIECE, give_piece, visit, NULL);
    if (response == NULL) {
        return MHD_NO;
    }
    add_headers(response, visit);
    if (dialogue->status == TL_HTTP_TOO_MANY) {
        char text[LENGTH];
        tl_time left = tl_token_delays_left(&server->token_delays, &visit->address, tl_clock_now(NULL));
        (void)snprintf(text, sizeof text, "%d", 1 + (int)(left / TL_SECOND));
        add_header(response, MHD_HTTP_HEADER_RETRY_AFTER, text);
    }
    tl_visit_allow(server, visit, TL_VISIT_TAKING);
    enum MHD_Result result = MHD_queue_response(visit->connection, dialogue->status, response);
    MHD_destroy_response(response);
    return result;
}

/* ---- the request ---- */

static bool has_large_body(struct MHD_Connection *connection) {
    const char *length = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, MHD_HTTP_HEADER_CONTENT_LENGTH);
    return (length != NULL && strtoull(length, NULL, 10) > LARGE_BODY) ||
           MHD_lookup_connection_value(connection, MHD_HEADER_KIND, MHD_HTTP_HEADER_TRANSFER_ENCODING) != NULL;
}

/* Judges the request by its head. The body of a refused request is read and dropped before the answer: closing a
 * connection with unread bytes resets it, and the client may lose the answer. Before a large body the server answers
 * at once and closes. A refused request gets no more time. */
static enum MHD_Result take_head(tl_server *server, tl_visit *visit, struct MHD_Connection *connection,
                                 const char *method, const char *protocol) {
    tl_dialogue_close(&visit->dialogue);
    visit->connection = connection;
    visit->token[0] = '\0';
    visit->has_begun = tl_visit_judge(server, visit, connection, method, protocol) != TL_HTTP_OK;
    if (!visit->has_begun) {
        tl_visit_allow(server, visit, TL_VISIT_UPLOAD);
        return MHD_YES;
    }
    return has_large_body(connection) ? answer(server, visit) : MHD_YES;
}

static void ask(tl_server *server, tl_visit *visit) {
    tl_dialogue *dialogue = &visit->dialogue;
    visit->has_begun = true;
    if (dialogue->request.wants_plants) {
        tl_dialogue_list_plants(dialogue, server->settings.folder);
    } else if (dialogue->body_size != dialogue->request.body) {
        tl_dialogue_refuse(dialogue, TL_HTTP_BAD_REQUEST, TL_CONTROL_BAD,
                           "the body is not as long as Content-Length says");
    } else {
        tl_dialogue_begin(dialogue, server->settings.folder);
        tl_visit_allow(server, visit, dialogue->request.is_change ? TL_VISIT_CHANGE : TL_VISIT_QUESTION);
    }
}

/* Called when the head is there, for pieces of the body, at its end, and when the connection was resumed. */
// NOLINTNEXTLINE(readability-function-size): its parameters are libmicrohttpd's
static enum MHD_Result serve(void *context, struct MHD_Connection *connection, const char *url, const char *method,
                             const char *protocol, const char *data, size_t *size, void **state) {
    tl_server *server = context;
    tl_visit *visit = visit_of(connection);
    (void)url;
    if (*state == NULL) {
        *state = visit;
        return take_head(server, visit, connection, method, protocol);
    }
    if (*size > 0) {
        bool is_kept = visit->has_begun || tl_dialogue_add_body(&visit->dialogue, data, *size);
        *size = 0;
        return is_kept ? MHD_YES : MHD_NO;
    }
    if (!visit->has_begun) {
        ask(server, visit);
    }
    if (visit->dialogue.status == 0) {
        suspend(visit);
        return MHD_YES;
    }
    return answer(server, visit);
}

/* ---- beginning and end ---- */

/* The request's line, before anything of it is decoded. */
static void *keep_target(void *context, const char *target, struct MHD_Connection *connection) {
    tl_visit *visit = visit_of(connection);
    (void)context;
    visit->target_length = strlen(target);
    (void)snprintf(visit->target, sizeof visit->target, "%s", target);
    return NULL;
}

static void complete(void *context, struct MHD_Connection *connection, void **state,
                     enum MHD_RequestTerminationCode code) {
    tl_visit *visit = visit_of(connection);
    (void)code;
    if (*state != NULL) {
        tl_visit_audit(visit);
    }
    tl_dialogue_close(&visit->dialogue);
    tl_visit_allow(context, visit, TL_VISIT_REST);
}

static void come_or_go(void *context, struct MHD_Connection *connection, void **place,
                       enum MHD_ConnectionNotificationCode code) {
    tl_server *server = context;
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
        *place = &server->visits[server->arriving];
        return;
    }
    tl_visit *visit = *place;
    (void)connection;
    tl_dialogue_close(&visit->dialogue);
    tl_guests_leave(&server->guests, visit->place);
}

/* Nothing is decoded for us: http_query.h does, and says if it cannot be. */
static size_t keep_escapes(void *context, struct MHD_Connection *connection, char *text) {
    (void)context;
    (void)connection;
    return strlen(text);
}

/* What libmicrohttpd tells of strangers' mistakes is of no use to who runs the box. */
static void say_nothing(void *context, const char *format, va_list arguments) {
    (void)context;
    (void)format;
    (void)arguments;
}

tl_status tl_http_service_start(tl_server *server, tl_error *error) {
    const tl_certificate *certificate = server->settings.certificate;
    server->daemon = MHD_start_daemon(
        MHD_USE_TLS | MHD_USE_EPOLL | MHD_USE_NO_LISTEN_SOCKET | MHD_ALLOW_SUSPEND_RESUME, 0, NULL, NULL, serve, server,
        MHD_OPTION_EXTERNAL_LOGGER, say_nothing, NULL, MHD_OPTION_HTTPS_MEM_CERT, certificate->chain,
        MHD_OPTION_HTTPS_MEM_KEY, certificate->key, MHD_OPTION_HTTPS_PRIORITIES, PRIORITIES,
        MHD_OPTION_CONNECTION_LIMIT, (unsigned)TL_GUESTS, MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)CONNECTION_MEMORY,
        MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_NOTIFY_COMPLETED, complete, server, MHD_OPTION_NOTIFY_CONNECTION,
        come_or_go, server, MHD_OPTION_URI_LOG_CALLBACK, keep_target, server, MHD_OPTION_UNESCAPE_CALLBACK,
        keep_escapes, NULL, MHD_OPTION_SIGPIPE_HANDLED_BY_APP, 1, MHD_OPTION_END);
    return server->daemon != NULL
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN,
                         "HTTPS cannot be begun: memory or descriptors are missing, or the certificate is "
                         "none that GnuTLS takes");
}
