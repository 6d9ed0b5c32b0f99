/* Dialogue: forwards one HTTP request to a plant's control socket, and buffers the answer.
 *
 * Purpose: a client may be slow, but the plant must not wait. The plant's replies are received when
 *          they arrive, and buffered as text until the client has read them. While the buffer has
 *          no space, no replies are received.
 * Use:     call tl_dialogue_begin(), then tl_dialogue_follow() whenever the plant's socket is
 *          readable, until `has_ended`. The HTTP answer can start when `status` is set.
 * Status:  a change gets TL_HTTP_OK as soon as its candidate has passed the validation; the result
 *          of the change is then only in the "end" line. A change that is refused earlier, and any
 *          other request, gets the status of its result (tl_answer_status()).
 * Bound:   at most TL_CONTROL_MOST bytes of a body and TL_DIALOGUE_MOST bytes of a buffered answer.
 * Memory:  tl_dialogue_close() frees all.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_SERVE_DIALOGUE_H
#define TL_FIRMWARE_SERVE_DIALOGUE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/serve/http_request.h"

/* Bytes of a buffered answer, and of one of its lines with the NUL. In JSON, one byte of a text may
 * need six bytes (\u0007), or five (\\x07: a cleaned byte, with its backslash escaped). */
enum { TL_DIALOGUE_MOST = 512 * 1024, TL_ANSWER_LINE = 16 * 1024 };

/* Zeroed: not started. */
typedef struct tl_dialogue {
    tl_http_request request;
    bool is_asked; /* `socket` is connected to the plant */
    int socket;    /* control socket of the plant */
    char *body;    /* body of the request, as received so far */
    size_t body_size;
    char *text; /* buffered answer: lines, or a configuration */
    size_t size;
    size_t taken;              /* bytes of `text` that the client has read */
    tl_http_status status;     /* 0: not decided yet */
    bool is_text;              /* the answer is a configuration; else lines */
    bool has_ended;            /* `text` is complete */
    uint64_t version;          /* number of the configuration that was read, or of the active one after a change */
    char hash[TL_SHA256_TEXT]; /* SHA-256 of the same configuration */
    const char *result;        /* name of the tl_control_result; NULL: unknown */
} tl_dialogue;

/* Appends bytes to the body. Returns false if memory is out, or if the body would become longer
 * than `request.body`. */
bool tl_dialogue_add_body(tl_dialogue *dialogue, const char *bytes, size_t size);

/* Sends the request and its body to the plant `request.plant`, whose socket is in `folder`/PLANT;
 * frees the body. If the plant cannot be reached, the dialogue ends with an error. */
void tl_dialogue_begin(tl_dialogue *dialogue, const char *folder);

/* Answers with the plants that have a socket in `folder`: one JSON line with at most 256 names. */
void tl_dialogue_list_plants(tl_dialogue *dialogue, const char *folder);

/* Receives the replies that have arrived, without waiting. `room`: a buffer for a configuration, of
 * TL_CONTROL_MOST + 1 bytes. */
void tl_dialogue_follow(tl_dialogue *dialogue, char *room);

/* Returns true if the plant may send more replies and the buffer has space for them. */
bool tl_dialogue_can_receive(const tl_dialogue *dialogue);

/* Ends the dialogue with an "end" line that has `result` and `sentence`. If the dialogue has no
 * status yet, it gets `status`, and the line replaces what is buffered. */
void tl_dialogue_refuse(tl_dialogue *dialogue, tl_http_status status, tl_control_result result, const char *sentence);

/* Moves up to `room` bytes of the buffered answer to `to`. Returns their number; 0: none. */
size_t tl_dialogue_take(tl_dialogue *dialogue, char *to, size_t room);

/* Frees all memory and closes the socket. A dialogue that was not started is allowed. */
void tl_dialogue_close(tl_dialogue *dialogue);

/* Writes a reply of the control socket as a JSON object in one line, with a newline and a NUL.
 * Members have the names of control.h; the member "reply" has the kind. Texts are cleaned (text.h),
 * so the line is valid UTF-8. Returns the length without the NUL; 0 if memory is out. */
size_t tl_answer_line(const tl_control_reply *reply, char line[TL_ANSWER_LINE]);

/* Returns the HTTP status of a request that ended with this tl_control_result. */
tl_http_status tl_answer_status(uint32_t result);

#endif
