/* HTTP request: parses path, query and headers into a control request.
 *
 * Thread:  the server's.
 */
#ifndef TL_FIRMWARE_SERVE_HTTP_REQUEST_H
#define TL_FIRMWARE_SERVE_HTTP_REQUEST_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/retune/control.h"

/* Bytes, with the NUL: of a request target (path and query), and of the reason for a refusal. */
enum { TL_HTTP_TARGET = 1024, TL_HTTP_SENTENCE = 256 };

/* The statuses that this server sends. */
typedef enum tl_http_status {
    TL_HTTP_OK = 200,
    TL_HTTP_BAD_REQUEST = 400,
    TL_HTTP_UNAUTHORISED = 401,
    TL_HTTP_FORBIDDEN = 403,
    TL_HTTP_NOT_FOUND = 404,
    TL_HTTP_WRONG_METHOD = 405,
    TL_HTTP_CONFLICT = 409,
    TL_HTTP_LENGTH_REQUIRED = 411,
    TL_HTTP_CHANGED = 412, /* If-Match does not name the active configuration */
    TL_HTTP_TOO_LARGE = 413,
    TL_HTTP_TARGET_TOO_LONG = 414,
    TL_HTTP_MISDIRECTED = 421,    /* Host is not a name of this server */
    TL_HTTP_INVALID = 422,        /* the configuration is invalid */
    TL_HTTP_MATCH_REQUIRED = 428, /* If-Match is missing */
    TL_HTTP_TOO_MANY = 429,
    TL_HTTP_FAILED = 500,
    TL_HTTP_UNAVAILABLE = 503,
    TL_HTTP_TIMEOUT = 504
} tl_http_status;

/* Parts of the HTTP request, as text. A header that is missing is NULL. */
typedef struct tl_http_words {
    const char *method;
    const char *target; /* "/api/v1/plants/motor?x=1", not decoded */
    const char *if_match;
    const char *content_length;
    const char *content_encoding;
    const char *transfer_encoding;
} tl_http_words;

typedef struct tl_http_request {
    bool wants_plants;           /* true: asks for the list of all plants; false: `control` is the request */
    bool is_change;              /* the request may change something, so the audit logs it */
    char plant[TL_CONTROL_NAME]; /* "motor" */
    size_t body;                 /* bytes of the body, as its header announces; 0: no body */
    tl_control_request control;  /* request for the plant: all fields but `right` and `who` */
} tl_http_request;

/* Parses a request. Returns TL_HTTP_OK, or the status of a refusal, with the reason in `sentence`.
 */
tl_http_status tl_http_request_read(const tl_http_words *words, tl_http_request *request,
                                    char sentence[TL_HTTP_SENTENCE]);

#endif
