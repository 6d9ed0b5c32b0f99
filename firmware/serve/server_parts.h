/* What the sources behind server.h share. */
#ifndef TL_FIRMWARE_SERVE_SERVER_PARTS_H
#define TL_FIRMWARE_SERVE_SERVER_PARTS_H

#include <sys/stat.h>

#include <microhttpd.h>

#include "firmware/base/log.h"
#include "firmware/serve/dialogue.h"
#include "firmware/serve/guests.h"
#include "firmware/serve/server.h"
#include "firmware/serve/token_delays.h"
#include "firmware/serve/tokens.h"

/* The connection of a guest, who has the same place in `guests`. */
typedef struct tl_visit {
    int place;
    int socket;
    struct MHD_Connection *connection;
    tl_address address;
    char from[TL_ADDRESS_TEXT];
    char local[TL_ADDRESS_TEXT];
    char target[TL_HTTP_TARGET + 1]; /* cut behind what is too long anyway */
    size_t target_length;            /* before it was cut */
    char token[TL_TOKEN_NAME];       /* whose it is; "": not seen yet */
    bool has_begun;                  /* the request was judged, and asked if it was good */
    bool is_suspended;               /* until there is something to answer with */
    tl_dialogue dialogue;
} tl_visit;

struct tl_server {
    tl_server_settings settings;
    struct MHD_Daemon *daemon;
    tl_guests guests;
    tl_visit visits[TL_GUESTS];
    int arriving; /* the place of the connection that is being added */
    tl_token_delays token_delays;
    tl_tokens tokens;
    struct stat tokens_seen; /* of the file when it was read */
    tl_log_limiter says;     /* of what strangers can cause */
    char room[TL_CONTROL_MOST + 1];
};

/* How long a guest has for what it is about. */
#define TL_VISIT_GREETING (10 * TL_SECOND)
#define TL_VISIT_UPLOAD (30 * TL_SECOND)
#define TL_VISIT_TAKING (30 * TL_SECOND)
#define TL_VISIT_REST (30 * TL_SECOND)
#define TL_VISIT_QUESTION (10 * TL_SECOND)
#define TL_VISIT_CHANGE (60 * TL_SECOND)

/* From now on it has so long. */
void tl_visit_allow(tl_server *server, const tl_visit *visit, tl_time time);

/* visit_judge.c: whether a request may be asked. TL_HTTP_OK, or the refusal is the answer of the visit's dialogue. `method` and `protocol` are
 * libmicrohttpd's own texts, in its buffer. */
tl_http_status tl_visit_judge(tl_server *server, tl_visit *visit, struct MHD_Connection *connection, const char *method,
                              const char *protocol);

/* visit_audit.c: an entry for a request that may change something. */
void tl_visit_audit(const tl_visit *visit);

/* http_service.c: libmicrohttpd, and what it calls. */
tl_status tl_http_service_start(tl_server *server, tl_error *error);

/* Wakes a connection that was suspended. */
void tl_visit_resume(tl_visit *visit);

#endif
