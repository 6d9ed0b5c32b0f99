/* Server: see server.h. */
#include "firmware/serve/server.h"

#include <errno.h>
#include <microhttpd.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/retune/control.h"
#include "firmware/serve/connections.h"
#include "firmware/serve/dialogue.h"
#include "firmware/serve/tokens.h"

/* ---- Data. */

/* A client connection. It has the same index in `connections`. */
typedef struct tl_client {
    int slot;
    int socket;
    struct MHD_Connection *connection;
    tl_address address;
    char from[TL_ADDRESS_TEXT];
    char local[TL_ADDRESS_TEXT];
    char target[TL_HTTP_TARGET + 1]; /* truncated; a longer target is refused anyway */
    size_t target_length;            /* before truncation */
    char token[TL_TOKEN_NAME];       /* name of its token; "": not known yet */
    bool has_begun;                  /* the request was checked; if it was good, it was sent to the plant */
    bool is_suspended;               /* until there is something to answer */
    tl_dialogue dialogue;
} tl_client;

struct tl_server {
    tl_server_settings settings;
    struct MHD_Daemon *daemon;
    tl_connections connections;
    tl_client clients[TL_CONNECTIONS];
    int new_slot; /* index of the connection that is being added */
    tl_token_delays token_delays;
    tl_tokens tokens;
    struct stat tokens_stat;    /* of the file when it was read */
    tl_log_limiter log_limiter; /* limits messages that untrusted clients can cause */
    char room[TL_CONTROL_MOST + 1];
};

/* Time limits of a connection. */
#define LIMIT_HEAD (10 * TL_SECOND)
#define LIMIT_BODY (30 * TL_SECOND)
#define LIMIT_ANSWER (30 * TL_SECOND)
#define LIMIT_IDLE (30 * TL_SECOND)
#define LIMIT_QUERY (10 * TL_SECOND)
#define LIMIT_CHANGE (60 * TL_SECOND)

/* ---- Audit: one line for each request that may change something, when its result is known. */

static const char *verb_of(const tl_control_request *control) {
    if (control->verb == TL_CONTROL_APPLY) {
        return (control->flags & TL_CONTROL_ONLY_CHECK) != 0 ? "check" : "change";
    }
    return control->verb == TL_CONTROL_CONFIRM ? "confirm" : "return";
}

static void log_audit(const tl_client *client) {
    const tl_http_request *request = &client->dialogue.request;
    const tl_control_request *control = &request->control;
    if (!request->is_change || client->token[0] == '\0') {
        return;
    }
    const char *result = client->dialogue.result;
    tl_log(TL_LOG_NOTICE, "audit: token=%s role=%s from=%s verb=%s plant=%s result=%s version=%llu%s%s", client->token,
           tl_change_rights[control->right], client->from, verb_of(control), request->plant,
           result != NULL ? result : "unknown: the client disconnected", (unsigned long long)client->dialogue.version,
           control->why[0] != '\0' ? " why=" : "", control->why);
}

/* ---- Access check of a request.
 *
 * Order: form of the head, Host, delay after wrong tokens, token, address and query, right. So a
 *        client without a token learns nothing about plants. The body has not been read yet.
 */

static const char SCHEME[] = "Bearer ";

static const char *header(struct MHD_Connection *connection, const char *name) {
    return MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
}

static tl_http_status refuse(tl_client *client, tl_http_status status, tl_control_result result, const char *sentence) {
    tl_dialogue_refuse(&client->dialogue, status, result, sentence);
    return status;
}

/* ---- the form of the head ---- */

/* Two headers with one of these names make a request ambiguous. */
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

/* Returns true if a part of the head begins at the end of the part before it.
 * libmicrohttpd refuses NUL, folded lines and a bare LF from 0.9.77 on; older versions accept them.
 * These older versions split the head in place: they replace each CR and each LF by a zero. So the
 * distance between two parts changes with a NUL in a text, with a line without CR, and with a line
 * that was moved to unfold it.
 * Not detected are NUL LF as the end of a line, and lines before a request that are empty or begin
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

static bool is_well_formed(const tl_client *client, struct MHD_Connection *connection, const char *method,
                           const char *protocol) {
    size_t size = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_REQUEST_HEADER_SIZE)->header_size;
    head_check check = {.end = method + strlen(method) + strlen(" ") + client->target_length + strlen(" ")};
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

/* `twinlock token` replaces the file. */
static void reload_tokens(tl_server *server) {
    struct stat about;
    tl_error error;
    memset(&about, 0, sizeof about);
    (void)stat(server->settings.tokens, &about);
    if (is_unchanged(&about, &server->tokens_stat)) {
        return;
    }
    server->tokens_stat = about;
    if (tl_tokens_read(server->settings.tokens, &server->tokens, &error) != TL_OK) {
        tl_log_limited(&server->log_limiter, TL_LOG_WARNING, "%s; all requests are refused until the file is valid",
                       error.text);
    }
}

static tl_http_status refuse_token(tl_server *server, tl_client *client, const char *why) {
    tl_token_delays_add(&server->token_delays, &client->address, tl_clock_now(NULL));
    tl_log_limited(&server->log_limiter, TL_LOG_WARNING, "a wrong token from %s", client->from);
    return refuse(client, TL_HTTP_UNAUTHORISED, TL_CONTROL_FORBIDDEN, why);
}

static tl_http_status check_token(tl_server *server, tl_client *client, const char *value, tl_change_right *right) {
    if (tl_token_delays_left(&server->token_delays, &client->address, tl_clock_now(NULL)) > 0) {
        return refuse(client, TL_HTTP_TOO_MANY, TL_CONTROL_BUSY,
                      "too many wrong tokens from your address: wait, see Retry-After");
    }
    if (value == NULL) {
        return refuse(
            client, TL_HTTP_UNAUTHORISED, TL_CONTROL_FORBIDDEN,
            "a token is missing: send Authorization: Bearer TOKEN; `twinlock token add` on the box creates one");
    }
    if (strncasecmp(value, SCHEME, strlen(SCHEME)) != 0) {
        return refuse_token(server, client, "Authorization: expected Bearer TOKEN");
    }
    reload_tokens(server);
    const tl_token *token = tl_tokens_find(&server->tokens, value + strlen(SCHEME));
    if (token == NULL) {
        return refuse_token(server, client, "no such token");
    }
    memcpy(client->token, token->name, sizeof client->token);
    server->connections.rows[client->slot].is_known = true;
    *right = token->role;
    return TL_HTTP_OK;
}

/* ---- the request ---- */

static tl_http_status check_request(tl_client *client, struct MHD_Connection *connection, const char *method) {
    char sentence[TL_HTTP_SENTENCE] = "";
    const tl_http_words words = {
        .method = method,
        .target = client->target,
        .if_match = header(connection, MHD_HTTP_HEADER_IF_MATCH),
        .content_length = header(connection, MHD_HTTP_HEADER_CONTENT_LENGTH),
        .content_encoding = header(connection, MHD_HTTP_HEADER_CONTENT_ENCODING),
        .transfer_encoding = header(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING),
    };
    tl_http_status status = tl_http_request_read(&words, &client->dialogue.request, sentence);
    tl_control_result result = status == TL_HTTP_NOT_FOUND ? TL_CONTROL_ABSENT
                               : status == TL_HTTP_CHANGED ? TL_CONTROL_CHANGED
                                                           : TL_CONTROL_BAD;
    return status == TL_HTTP_OK ? status : refuse(client, status, result, sentence);
}

static tl_http_status check_right(tl_client *client, tl_change_right right) {
    tl_http_request *request = &client->dialogue.request;
    request->control.right = right;
    (void)snprintf(request->control.who, sizeof request->control.who, "%s", client->token);
    if (request->is_change && right < TL_RIGHT_RETUNE) {
        return refuse(client, TL_HTTP_FORBIDDEN, TL_CONTROL_FORBIDDEN,
                      "this token has the role read: it cannot change anything");
    }
    return TL_HTTP_OK;
}

/* Checks whether a request may be processed. Returns TL_HTTP_OK, or the status of a refusal, which
 * becomes the answer of the dialogue. `method` and `protocol` must be the texts in libmicrohttpd's
 * own buffer. */
static tl_http_status check_access(tl_server *server, tl_client *client, struct MHD_Connection *connection,
                                   const char *method, const char *protocol) {
    tl_change_right right = TL_RIGHT_READ;
    if (!is_well_formed(client, connection, method, protocol)) {
        return refuse(
            client, TL_HTTP_BAD_REQUEST, TL_CONTROL_BAD,
            "request head: a header occurs twice, or a line is not \"Name: value\" without control characters "
            "and with CR LF at its end: correct the client");
    }
    if (!tl_host_names_know(server->settings.names, header(connection, MHD_HTTP_HEADER_HOST), client->local)) {
        return refuse(
            client, TL_HTTP_MISDIRECTED, TL_CONTROL_BAD,
            "Host is not a name of this server: use its address, or add the name with `twinlock serve --host`");
    }
    tl_http_status status = check_token(server, client, header(connection, MHD_HTTP_HEADER_AUTHORIZATION), &right);
    status = status == TL_HTTP_OK ? check_request(client, connection, method) : status;
    return status == TL_HTTP_OK ? check_right(client, right) : status;
}

/* ---- HTTP and TLS, by libmicrohttpd.
 *
 * No callback blocks. A request is answered at once, or its connection is suspended until the plant
 * has sent enough.
 */

enum { PIECE = 16 * 1024, CONNECTION_MEMORY = 16 * 1024, LENGTH = 32, LARGE_BODY = 1024 * 1024 };

/* TLS 1.3, and TLS 1.2 with AEAD ciphers and ECDHE. */
static const char PRIORITIES[] =
    "SECURE128:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2:-KX-ALL:+ECDHE-ECDSA:+ECDHE-RSA:-MAC-ALL:+AEAD:"
    "%SERVER_PRECEDENCE";

/* Sets the deadline of the connection, `time` from now. */
static void set_deadline(tl_server *server, const tl_client *client, tl_time time) {
    server->connections.rows[client->slot].deadline = time == TL_TIME_NEVER ? TL_TIME_NEVER : tl_clock_now(NULL) + time;
}

static tl_client *client_of(struct MHD_Connection *connection) {
    return MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT)->socket_context;
}

static void suspend_client(tl_client *client) {
    client->is_suspended = true;
    MHD_suspend_connection(client->connection);
}

static void resume_client(tl_client *client) {
    client->is_suspended = false;
    MHD_resume_connection(client->connection);
}

/* ---- the answer ---- */

/* Returns the next piece of an answer that is not complete yet. */
static ssize_t next_piece(void *context, uint64_t position, char *to, size_t room) {
    tl_client *client = context;
    (void)position;
    size_t now = tl_dialogue_take(&client->dialogue, to, room);
    if (now == 0 && client->dialogue.has_ended) {
        return MHD_CONTENT_READER_END_OF_STREAM;
    }
    if (now == 0) {
        suspend_client(client);
    }
    return (ssize_t)now;
}

static void add_header(struct MHD_Response *response, const char *name, const char *value) {
    (void)MHD_add_response_header(response, name, value);
}

static void add_headers(struct MHD_Response *response, const tl_client *client) {
    const tl_dialogue *dialogue = &client->dialogue;
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
    if (dialogue->status == TL_HTTP_BAD_REQUEST) { /* the following bytes on the connection may not be a request */
        add_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
    }
    if (dialogue->status == TL_HTTP_UNAUTHORISED) {
        add_header(response, MHD_HTTP_HEADER_WWW_AUTHENTICATE, "Bearer realm=\"twinlock\"");
    }
}

static enum MHD_Result answer(tl_server *server, tl_client *client) {
    tl_dialogue *dialogue = &client->dialogue;
    struct MHD_Response *response =
        dialogue->has_ended ? MHD_create_response_from_buffer(dialogue->size, dialogue->text, MHD_RESPMEM_PERSISTENT)
                            : MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, PIECE, next_piece, client, NULL);
    if (response == NULL) {
        return MHD_NO;
    }
    add_headers(response, client);
    if (dialogue->status == TL_HTTP_TOO_MANY) {
        char text[LENGTH];
        tl_time left = tl_token_delays_left(&server->token_delays, &client->address, tl_clock_now(NULL));
        (void)snprintf(text, sizeof text, "%d", 1 + (int)(left / TL_SECOND));
        add_header(response, MHD_HTTP_HEADER_RETRY_AFTER, text);
    }
    set_deadline(server, client, LIMIT_ANSWER);
    enum MHD_Result result = MHD_queue_response(client->connection, dialogue->status, response);
    MHD_destroy_response(response);
    return result;
}

/* ---- the request ---- */

static bool has_large_body(struct MHD_Connection *connection) {
    const char *length = header(connection, MHD_HTTP_HEADER_CONTENT_LENGTH);
    return (length != NULL && strtoull(length, NULL, 10) > LARGE_BODY) ||
           header(connection, MHD_HTTP_HEADER_TRANSFER_ENCODING) != NULL;
}

/* Checks the request by its head. The body of a refused request is read and dropped before the
 * answer. Closing a connection with unread bytes resets it, and the client may lose the answer.
 * Before a large body the server answers at once and closes. A refused request gets no more time.
 */
static enum MHD_Result check_head(tl_server *server, tl_client *client, struct MHD_Connection *connection,
                                  const char *method, const char *protocol) {
    tl_dialogue_close(&client->dialogue);
    client->connection = connection;
    client->token[0] = '\0';
    client->has_begun = check_access(server, client, connection, method, protocol) != TL_HTTP_OK;
    if (!client->has_begun) {
        set_deadline(server, client, LIMIT_BODY);
        return MHD_YES;
    }
    return has_large_body(connection) ? answer(server, client) : MHD_YES;
}

static void send_request(tl_server *server, tl_client *client) {
    tl_dialogue *dialogue = &client->dialogue;
    client->has_begun = true;
    if (dialogue->request.wants_plants) {
        tl_dialogue_list_plants(dialogue, server->settings.folder);
    } else if (dialogue->body_size != dialogue->request.body) {
        tl_dialogue_refuse(dialogue, TL_HTTP_BAD_REQUEST, TL_CONTROL_BAD,
                           "the length of the body differs from Content-Length");
    } else {
        tl_dialogue_begin(dialogue, server->settings.folder);
        set_deadline(server, client, dialogue->request.is_change ? LIMIT_CHANGE : LIMIT_QUERY);
    }
}

/* Called after the head, for each piece of the body, after the body, and after a resumed
 * connection. */
// NOLINTNEXTLINE(readability-function-size): its parameters are libmicrohttpd's
static enum MHD_Result serve(void *context, struct MHD_Connection *connection, const char *url, const char *method,
                             const char *protocol, const char *data, size_t *size, void **state) {
    tl_server *server = context;
    tl_client *client = client_of(connection);
    (void)url;
    if (*state == NULL) {
        *state = client;
        return check_head(server, client, connection, method, protocol);
    }
    if (*size > 0) {
        bool is_kept = client->has_begun || tl_dialogue_add_body(&client->dialogue, data, *size);
        *size = 0;
        return is_kept ? MHD_YES : MHD_NO;
    }
    if (!client->has_begun) {
        send_request(server, client);
    }
    if (client->dialogue.status == 0) {
        suspend_client(client);
        return MHD_YES;
    }
    return answer(server, client);
}

/* ---- start and end of requests and connections ---- */

/* The target of the request before decoding. */
static void *keep_target(void *context, const char *target, struct MHD_Connection *connection) {
    tl_client *client = client_of(connection);
    (void)context;
    client->target_length = strlen(target);
    (void)snprintf(client->target, sizeof client->target, "%s", target);
    return NULL;
}

static void on_complete(void *context, struct MHD_Connection *connection, void **state,
                        enum MHD_RequestTerminationCode code) {
    tl_client *client = client_of(connection);
    (void)code;
    if (*state != NULL) {
        log_audit(client);
    }
    tl_dialogue_close(&client->dialogue);
    set_deadline(context, client, LIMIT_IDLE);
}

static void on_connection(void *context, struct MHD_Connection *connection, void **slot,
                          enum MHD_ConnectionNotificationCode code) {
    tl_server *server = context;
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
        *slot = &server->clients[server->new_slot];
        return;
    }
    tl_client *client = *slot;
    (void)connection;
    tl_dialogue_close(&client->dialogue);
    tl_connections_leave(&server->connections, client->slot);
}

/* libmicrohttpd must not decode: http_request.c decodes, and reports faults. */
static size_t keep_escapes(void *context, struct MHD_Connection *connection, char *text) {
    (void)context;
    (void)connection;
    return strlen(text);
}

/* Messages of libmicrohttpd about clients' errors do not help the administrator. */
static void drop_message(void *context, const char *format, va_list arguments) {
    (void)context;
    (void)format;
    (void)arguments;
}

static tl_status tl_http_service_start(tl_server *server, tl_error *error) {
    const tl_certificate *certificate = server->settings.certificate;
    server->daemon = MHD_start_daemon(
        MHD_USE_TLS | MHD_USE_EPOLL | MHD_USE_NO_LISTEN_SOCKET | MHD_ALLOW_SUSPEND_RESUME, 0, NULL, NULL, serve, server,
        MHD_OPTION_EXTERNAL_LOGGER, drop_message, NULL, MHD_OPTION_HTTPS_MEM_CERT, certificate->chain,
        MHD_OPTION_HTTPS_MEM_KEY, certificate->key, MHD_OPTION_HTTPS_PRIORITIES, PRIORITIES,
        MHD_OPTION_CONNECTION_LIMIT, (unsigned)TL_CONNECTIONS, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        (size_t)CONNECTION_MEMORY, MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_NOTIFY_COMPLETED, on_complete, server,
        MHD_OPTION_NOTIFY_CONNECTION, on_connection, server, MHD_OPTION_URI_LOG_CALLBACK, keep_target, server,
        MHD_OPTION_UNESCAPE_CALLBACK, keep_escapes, NULL, MHD_OPTION_SIGPIPE_HANDLED_BY_APP, 1, MHD_OPTION_END);
    return server->daemon != NULL
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN,
                         "cannot start HTTPS: out of memory or descriptors, or GnuTLS rejects the certificate");
}

/* ---- server ---- */

/* Descriptors: the listener, libmicrohttpd's epoll; for each connection its plant's socket, and its
 *              own while it is suspended. */
enum { FIXED = 2, DESCRIPTORS = FIXED + 2 * TL_CONNECTIONS, AT_ONCE = 32, MESSAGES_A_SECOND = 5 };

/* ---- new connections ---- */

/* libmicrohttpd closes the connection within this call. */
static void close_client(tl_server *server, int slot) {
    tl_client *client = &server->clients[slot];
    (void)shutdown(client->socket, SHUT_RDWR);
    server->connections.rows[slot].deadline = TL_TIME_NEVER;
    if (client->is_suspended) {
        log_audit(client);
        tl_dialogue_close(&client->dialogue);
        client->dialogue.has_ended = true;
        client->dialogue.status = TL_HTTP_TIMEOUT;
        resume_client(client);
    }
    (void)MHD_run(server->daemon);
}

static int find_slot(tl_server *server, const tl_address *address, tl_time now) {
    int evicted = -1;
    int slot = tl_connections_admit(&server->connections, address, now, &evicted);
    if (slot < 0 && evicted >= 0) {
        close_client(server, evicted);
        slot = tl_connections_admit(&server->connections, address, now, &evicted);
    }
    return slot;
}

static void admit_client(tl_server *server, int socket, const struct sockaddr *from, socklen_t size) {
    tl_address address = tl_address_of(from);
    int slot = find_slot(server, &address, tl_clock_now(NULL));
    if (slot < 0) {
        (void)close(socket);
        return;
    }
    tl_client *client = &server->clients[slot];
    *client = (tl_client){.slot = slot, .socket = socket, .address = address, .dialogue = {.socket = -1}};
    struct sockaddr_storage local = {.ss_family = AF_UNSPEC};
    socklen_t local_size = sizeof local;
    tl_address_text(from, client->from);
    (void)getsockname(socket, (struct sockaddr *)&local, &local_size);
    tl_address_text((const struct sockaddr *)&local, client->local);
    server->new_slot = slot;
    if (MHD_add_connection(server->daemon, socket, from, size) != MHD_YES) {
        tl_connections_leave(&server->connections, slot);
        return;
    }
    set_deadline(server, client, LIMIT_HEAD);
}

static void accept_clients(tl_server *server) {
    struct sockaddr_storage from;
    for (int i = 0; i < AT_ONCE; i++) {
        socklen_t size = sizeof from;
        int socket = accept4(server->settings.listener, (struct sockaddr *)&from, &size, SOCK_CLOEXEC | SOCK_NONBLOCK);
        if (socket < 0) {
            return;
        }
        admit_client(server, socket, (const struct sockaddr *)&from, size);
    }
}

/* ---- waiting ---- */

static size_t list_descriptors(const tl_server *server, struct pollfd list[DESCRIPTORS]) {
    size_t count = FIXED;
    list[0] = (struct pollfd){.fd = server->settings.listener, .events = POLLIN};
    list[1] = (struct pollfd){.fd = MHD_get_daemon_info(server->daemon, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd,
                              .events = POLLIN};
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        const tl_client *client = &server->clients[i];
        if (!server->connections.rows[i].is_there) {
            continue;
        }
        if (tl_dialogue_can_receive(&client->dialogue)) {
            list[count++] = (struct pollfd){.fd = client->dialogue.socket, .events = POLLIN};
        }
        if (client->is_suspended) { /* libmicrohttpd does not poll it in this state */
            list[count++] = (struct pollfd){.fd = client->socket, .events = POLLRDHUP};
        }
    }
    return count;
}

/* Returns ms, at most `most`. */
static int wait_time(const tl_server *server, tl_time most) {
    MHD_UNSIGNED_LONG_LONG wanted = 0;
    tl_time least = most;
    tl_time next = tl_connections_next(&server->connections);
    tl_time left = next == TL_TIME_NEVER ? most : next - tl_clock_now(NULL);
    least = left < least ? left : least;
    if (MHD_get_timeout(server->daemon, &wanted) == MHD_YES && wanted < (MHD_UNSIGNED_LONG_LONG)(most / 1000000)) {
        least = (tl_time)wanted * 1000000 < least ? (tl_time)wanted * 1000000 : least;
    }
    return least > 0 ? (int)((least + 999999) / 1000000) : 0;
}

/* ---- connections ---- */

static bool has_disconnected(const tl_client *client) {
    struct pollfd one = {.fd = client->socket, .events = POLLRDHUP};
    return poll(&one, 1, 0) > 0 && (one.revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0;
}

static void poll_plant(tl_server *server, tl_client *client) {
    tl_dialogue *dialogue = &client->dialogue;
    tl_dialogue_follow(dialogue, server->room);
    if (!client->is_suspended) {
        return;
    }
    bool can_begin = dialogue->status != 0 && (dialogue->size > 0 || dialogue->has_ended);
    if (can_begin) {
        set_deadline(server, client, LIMIT_ANSWER);
        resume_client(client);
    } else if (dialogue->status != 0) { /* the client has read everything; the plant has no deadline */
        set_deadline(server, client, TL_TIME_NEVER);
    }
    if (client->is_suspended && has_disconnected(client)) {
        close_client(server, client->slot);
    }
}

/* If a plant does not answer in time, the client gets an answer with that reason. A client that
 * exceeds its time is closed. */
static void end_overdue(tl_server *server) {
    tl_time now = tl_clock_now(NULL);
    for (int i = 0; (i = tl_connections_overdue(&server->connections, i, now)) >= 0; i++) {
        tl_client *client = &server->clients[i];
        if (client->is_suspended && client->dialogue.status == 0) {
            tl_dialogue_refuse(&client->dialogue, TL_HTTP_TIMEOUT, TL_CONTROL_FAILED,
                               "the twin did not answer in time; it may still execute the request");
            set_deadline(server, client, LIMIT_ANSWER);
            resume_client(client);
        } else {
            close_client(server, i);
        }
    }
}

void tl_server_turn(tl_server *server, tl_time longest_wait) {
    struct pollfd list[DESCRIPTORS];
    size_t count = list_descriptors(server, list);
    if (poll(list, count, wait_time(server, longest_wait)) < 0 && errno != EINTR) {
        tl_log_limited(&server->log_limiter, TL_LOG_ERROR, "cannot wait for requests: %s", strerror(errno));
    }
    accept_clients(server);
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        if (server->connections.rows[i].is_there) {
            poll_plant(server, &server->clients[i]);
        }
    }
    end_overdue(server);
    (void)MHD_run(server->daemon);
}

/* ---- start and end of the server ---- */

tl_status tl_server_open(const tl_server_settings *settings, tl_server **server, tl_error *error) {
    *server = calloc(1, sizeof **server);
    if (*server == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "out of memory");
    }
    (*server)->settings = *settings;
    (*server)->log_limiter = (tl_log_limiter)TL_LOG_LIMITER(MESSAGES_A_SECOND);
    tl_status status = tl_http_service_start(*server, error);
    if (status != TL_OK) {
        free(*server);
        *server = NULL;
    }
    return status;
}

void tl_server_close(tl_server *server) {
    if (server == NULL) {
        return;
    }
    for (int i = 0; i < TL_CONNECTIONS; i++) {
        if (server->connections.rows[i].is_there) {
            close_client(server, i);
        }
    }
    MHD_stop_daemon(server->daemon);
    tl_log_limiter_end(&server->log_limiter);
    free(server);
}
