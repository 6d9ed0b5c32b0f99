/* A dialogue: one request of a guest, asked of a plant, and what is answered.
 *
 * Purpose: between a guest who is slow and a plant that must not wait for it. Replies are taken as they come and kept as text until the guest
 *          takes them; with too much of that no more are taken.
 * Course:  begin; follow whenever the plant's socket has something to say, until `has_ended`. Once `status` is set, the answer can begin: a change
 *          is decided by its first step behind validation, so that a refusal has its own status, everything else at its end.
 * Bound:   a body of TL_CONTROL_MOST bytes and an answer of TL_DIALOGUE_MOST.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_SERVE_DIALOGUE_H
#define TL_FIRMWARE_SERVE_DIALOGUE_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/serve/http_request.h"

/* Bytes of an answer, and of one line of it: each byte of a text may take six, as \u0007 does, or four as \x07 whose backslash is escaped. */
enum { TL_DIALOGUE_MOST = 512 * 1024, TL_ANSWER_LINE = 16 * 1024 };

/* A zeroed one is none. */
typedef struct tl_dialogue {
    tl_http_request request;
    bool is_asked; /* `socket` is the plant's */
    int socket;    /* of a plant */
    char *body;    /* so far */
    size_t body_size;
    char *text; /* of the answer, so far: lines, or a configuration */
    size_t size;
    size_t taken;          /* of that, by the guest */
    tl_http_status status; /* 0: not decided yet */
    bool is_text;          /* the answer is a configuration; else lines */
    bool has_ended;        /* nothing comes behind `text` */
    uint64_t version;      /* of a configuration, or of the end of a change */
    char hash[TL_SHA256_TEXT];
    const char *result; /* the word of the end; NULL: it is not known */
} tl_dialogue;

/* More of the body. False: memory is out, or it is more than was said. */
bool tl_dialogue_add_body(tl_dialogue *dialogue, const char *bytes, size_t size);

/* Asks the plant whose socket is in `folder`/NAME. If nobody is there, that is the answer. */
void tl_dialogue_begin(tl_dialogue *dialogue, const char *folder);

/* The plants in `folder`, as an answer. */
void tl_dialogue_list_plants(tl_dialogue *dialogue, const char *folder);

/* Takes what the plant says; `room` is for a configuration, of TL_CONTROL_MOST + 1 bytes. */
void tl_dialogue_follow(tl_dialogue *dialogue, char *room);

/* Whether there is something to follow, and room for it. */
bool tl_dialogue_listens(const tl_dialogue *dialogue);

/* The answer is this one line, whatever there was: an "end" with this result. */
void tl_dialogue_refuse(tl_dialogue *dialogue, tl_http_status status, tl_control_result result, const char *sentence);

/* Of the answer, as much as is there and fits. */
size_t tl_dialogue_take(tl_dialogue *dialogue, char *to, size_t room);

/* Frees, hangs up, and leaves none. None is allowed. */
void tl_dialogue_close(tl_dialogue *dialogue);

/* A reply of the control socket as a JSON object in one line, with the newline. Its members have the words of control.h; "reply" says which kind it is.
 * Texts are cleaned (text.h): the line is valid UTF-8. Returns the length; 0 if memory is out. */
size_t tl_answer_line(const tl_control_reply *reply, char line[TL_ANSWER_LINE]);

/* The HTTP status of a request that ended with this tl_control_result. */
tl_http_status tl_answer_status(uint32_t result);

#endif
