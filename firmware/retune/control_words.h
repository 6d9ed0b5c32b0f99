/* The words for what is said over a control socket, as people, JSON and versions have them.
 *
 * Thread: pure.
 */
#ifndef TL_FIRMWARE_RETUNE_CONTROL_WORDS_H
#define TL_FIRMWARE_RETUNE_CONTROL_WORDS_H

#include <stdbool.h>

#include "firmware/retune/control_wire.h"

/* "read", "retune", "commission". */
const char *tl_control_right_name(tl_control_right right);

/* False: there is no such right. */
bool tl_control_right_of(const char *name, tl_control_right *right);

/* "reload", "network", "limited". */
const char *tl_control_origin_name(tl_control_origin origin);

/* "authorise", "validate", …; "idle". */
const char *tl_control_step_name(tl_control_step step);

/* "done", "same", "bad request", "forbidden", …. */
const char *tl_control_result_name(tl_control_result result);

/* Behind the kind of a change, by the right that it takes (control_wire.h): ", takes the right to commission", ", on the box only"; "": no more than to retune. */
const char *tl_control_right_note(const char *right);

/* Beside the exit codes of a tl_status. */
enum { TL_CONTROL_NOT_PERMITTED = 77 };

/* The exit code of a program that has sent a request, such as `twinlock reload`. */
int tl_control_exit_code(tl_control_result result);

#endif
