/* What a plant answers, as JSON and as a status of HTTP.
 *
 * Purpose: a reply of the control socket is one object in one line; its members have the words of control.h. "reply" says what it is: "state",
 *          "version", "change", "problem", "step", "end".
 * Trust:   texts of a reply are cleaned (text.h): whatever they hold, the line is valid UTF-8 and one line.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_SERVE_ANSWER_H
#define TL_FIRMWARE_SERVE_ANSWER_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/retune/control.h"
#include "firmware/serve/http_request.h"

/* Each byte of a text may take six, as \u0007 does, or four as \x07 whose backslash is escaped. */
enum { TL_ANSWER_LINE = 16 * 1024 };

/* The object and a newline. Returns its length; 0: memory is out. */
size_t tl_answer_line(const tl_control_reply *reply, char line[TL_ANSWER_LINE]);

/* The same for what this server itself has to say: an "end" with this result. */
size_t tl_answer_refusal(tl_control_result result, const char *sentence, char line[TL_ANSWER_LINE]);

/* What a request is answered with if this is how it ended. */
tl_http_status tl_answer_status(uint32_t result);

/* A change has gone beyond what can be refused: with this the answer begins, whatever comes after. */
bool tl_answer_is_under_way(const tl_control_reply *reply);

#endif
