/* The answering end of a control socket.
 *
 * Purpose: the socket itself, and connections of which each asks once.
 * Trust:   who asks is who the kernel says; what is asked has exactly its size, numbers that exist, texts that end. A candidate is copied out of
 *          memory (no file that could be slow, or change), and has the hash that the request names.
 * Waiting: never. A client that does not take its replies is given up.
 * Thread:  one; the listening socket may be handed to another process.
 */
#ifndef TL_FIRMWARE_RETUNE_CONTROL_SERVER_H
#define TL_FIRMWARE_RETUNE_CONTROL_SERVER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "firmware/retune/control_wire.h"
#include "master/base/status.h"

enum { TL_CONTROL_CLIENTS = 16 }; /* at a time; others wait in the socket's queue */

/* Binds `path` and listens, in a folder that is made if it is missing. What is left of a dead socket is replaced, a living one is not. Mode 0660, and the
 * folder's 0770: who may ask is who may enter there, and he is believed the rights that he claims.
 * Errors: TL_TRY_AGAIN. */
tl_status tl_control_listen(const char *path, int *listener, tl_error *error);

/* True: somebody waits to be accepted. */
bool tl_control_is_knocked_at(int listener);

/* A connection. A zeroed one with socket −1 is none. */
typedef struct tl_control_peer {
    int socket;
    uid_t user;
    pid_t process;
    bool has_asked;
} tl_control_peer;

typedef enum tl_control_news {
    TL_CONTROL_NOTHING,
    TL_CONTROL_ASKED, /* the request is there, and the candidate of a TAKE */
    TL_CONTROL_GONE   /* it is closed: by the other end, or since what it said was none, or nobody took what we said */
} tl_control_news;

/* The next one that waits; false: nobody does. */
bool tl_control_accept(int listener, tl_control_peer *peer);

/* Looks for its request. *size > 0: it came with so many bytes, which are in `text`, of TL_CONTROL_MOST + 1 bytes, with a NUL behind them: of a TAKE always,
 * of others never. A bad request is answered with TL_CONTROL_BAD. */
tl_control_news tl_control_receive(tl_control_peer *peer, tl_control_request *request, char *text, size_t *size);

/* Says something; all its bytes go out, so they are zeroed at first. False: the peer is gone, and closed. */
bool tl_control_send(tl_control_peer *peer, const tl_control_reply *reply);

/* Says a version, and its text. */
bool tl_control_send_text(tl_control_peer *peer, const tl_control_version *version, const char *text, size_t size);

/* Says the last thing, and closes. None is allowed. */
void tl_control_finish(tl_control_peer *peer, tl_control_result result, uint64_t version, const char *hash,
                       const char *text);
void tl_control_close(tl_control_peer *peer);

#endif
