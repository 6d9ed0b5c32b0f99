/* The way to a box: HTTPS by libcurl, to the one whose key is known and to no other.
 *
 * Purpose: the certificate of a box is its own, so it is compared with a pin. That is done in a connection of its own, by which nothing is sent; from then
 *          on libcurl takes that key only. A token never goes to anybody else.
 * Errors:  TL_PUSH_NOBODY: nobody is there; TL_PUSH_STRANGER: another box; TL_PUSH_HUNG_UP: it has ended the connection; TL_PUSH_BROKEN: something else is wrong with that. `error` says all.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_PUSH_PUSH_LINK_H
#define TL_FIRMWARE_PUSH_PUSH_LINK_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/status.h"

typedef struct tl_push_link tl_push_link;

typedef enum tl_push_outcome {
    TL_PUSH_OK,
    TL_PUSH_WRONG,
    TL_PUSH_NOBODY,
    TL_PUSH_STRANGER,
    TL_PUSH_HUNG_UP,
    TL_PUSH_BROKEN
} tl_push_outcome;

enum { TL_PUSH_TAG = 80 };

/* What is sent, and where the answer goes. */
typedef struct tl_push_request {
    const char *method;
    const char *path;  /* behind the plant: "/configuration?check=1" */
    const char *match; /* the header If-Match; NULL: none */
    const char *body;  /* NULL: none */
    size_t size;
    bool can_last;                                                            /* for as long as it takes */
    void (*take)(void *context, long status, const char *bytes, size_t size); /* a piece of the answer */
    void *context;
    long status;           /* that came */
    char tag[TL_PUSH_TAG]; /* the header ETag that came, with its quotes; "": none */
} tl_push_request;

/* `url` is that of a plant, https://192.0.2.7:8443/motor; `pin` may be NULL. TL_PUSH_WRONG: it is none. Texts live as long as it does. */
tl_push_outcome tl_push_link_open(const char *url, const char *pin, const char *token, tl_push_link **link,
                                  tl_error *error);

tl_push_outcome tl_push_link_ask(tl_push_link *link, tl_push_request *request, tl_error *error);

/* NULL is allowed. */
void tl_push_link_close(tl_push_link *link);

#endif
