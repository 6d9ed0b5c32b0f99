/* Dialogue: forwards one request of a client to a plant, and buffers the answer.
 *
 * Purpose: a client may be slow, but the plant must not wait. Replies are received when they
 *          arrive, and buffered as text until the client has read them. If the buffer is full, no
 *          more are received.
 * Use:     call tl_dialogue_begin(), then tl_dialogue_follow() whenever the plant's socket is
 *          readable, until `has_ended`. The HTTP answer can start when `status` is set.
 * Status:  a change whose candidate passes the validation gets TL_HTTP_OK; the "end" line then has
 *          its result. A change that is refused earlier, and any other request, gets the status of
 *          its result.
 * Bound:   a body of TL_CONTROL_MOST bytes and a buffered answer of TL_DIALOGUE_MOST.
 * Memory:  tl_dialogue_close() frees all.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_SERVE_DIALOGUE_H
#define TL_FIRMWARE_SERVE_DIALOGUE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/serve/http_request.h"

/* Bytes of an answer, and of one line of it. In JSON, one byte of a text may need six (\u0007)
 * or five bytes (\\x07: a cleaned byte, with its backslash escaped). */
enum { TL_DIALOGUE_MOST = 512 * 1024, TL_ANSWER_LINE = 16 * 1024 };

/* Zeroed: not started. */
typedef struct tl_dialogue {
    tl_http_request request;
    bool is_asked; /* `socket` is connected to the plant */
    int socket;    /* of a plant */
    char *body;    /* received so far */
    size_t body_size;
    char *text; /* of the answer, received so far: lines, or a configuration */
    size_t size;
    size_t taken;          /* bytes of `text` that the client has read */
    tl_http_status status; /* 0: not decided yet */
    bool is_text;          /* the answer is a configuration; else lines */
    bool has_ended;        /* `text` is complete */
    uint64_t version;      /* of a configuration, or of the end of a change */
    char hash[TL_SHA256_TEXT];
    const char *result; /* name of the result; NULL: unknown */
} tl_dialogue;

/* Appends to the body. Returns false if memory is out, or if the body is longer than announced. */
bool tl_dialogue_add_body(tl_dialogue *dialogue, const char *bytes, size_t size);

/* Sends the request to the plant whose socket is in `folder`/NAME. If the plant cannot be reached,
 * the answer says so. */
void tl_dialogue_begin(tl_dialogue *dialogue, const char *folder);

/* Answers with the list of plants in `folder`. */
void tl_dialogue_list_plants(tl_dialogue *dialogue, const char *folder);

/* Receives the plant's replies. `room`: a buffer for a configuration, of TL_CONTROL_MOST + 1 bytes.
 */
void tl_dialogue_follow(tl_dialogue *dialogue, char *room);

/* Returns true if the plant may send more replies and the buffer has space for them. */
bool tl_dialogue_can_receive(const tl_dialogue *dialogue);

/* Ends the dialogue with an "end" line that has this result. If `status` is not set yet, that line
 * replaces the buffered answer. */
void tl_dialogue_refuse(tl_dialogue *dialogue, tl_http_status status, tl_control_result result, const char *sentence);

/* Moves as much of the answer as is available and fits to `to`. Returns its length. */
size_t tl_dialogue_take(tl_dialogue *dialogue, char *to, size_t room);

/* Frees all memory and closes the socket. A dialogue that was not started is allowed. */
void tl_dialogue_close(tl_dialogue *dialogue);

/* Writes a reply of the control socket as a JSON object in one line, with the newline. Members have
 * the names of control.h; "reply" is its kind. Texts are cleaned (text.h), so the line is valid
 * UTF-8. Returns the length; 0 if memory is out. */
size_t tl_answer_line(const tl_control_reply *reply, char line[TL_ANSWER_LINE]);

/* Returns the HTTP status of a request that ended with this tl_control_result. */
tl_http_status tl_answer_status(uint32_t result);

#endif
