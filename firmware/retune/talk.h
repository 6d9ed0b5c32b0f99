/* A client's dialogue with a plant, over restarts, and what is printed of it.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_RETUNE_TALK_H
#define TL_FIRMWARE_RETUNE_TALK_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/types.h>

#include "firmware/retune/control.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- What a run says, for people to read.
 *
 * Thread: one.
 */

typedef struct tl_talk_page {
    FILE *output;        /* problems, and an end that is none, go to the log instead */
    const char *subject; /* what a problem is in: the name of the file */
} tl_talk_page;

void tl_talk_page_print(const tl_talk_page *page, const tl_control_reply *reply);

/* ---- A talk with a run: one request by its control socket, and all that comes of it, also if the run begins anew meanwhile.
 *
 * Purpose: `twinlock reload`.
 * Follows: a change that takes an end and a new start of the run ends the connection. Who waits (TL_CONTROL_WAIT) asks the run that comes next how it is,
 *          until the change is kept or returned from: told as steps and an end like any others.
 * Errors:  TL_PLANT_DOWN: nobody is there, or is no more; TL_TRY_AGAIN: no answer; TL_BAD_DATA: what is none.
 * Waiting: never for longer than it is told, and 5 s for an answer of a run that came back.
 * Thread:  one, one talk at a time.
 */

/* The subject that is standard input. */
#define TL_TALK_INPUT "-"

/* Told when the run hangs up before it has said what came of a change that is followed. */
#define TL_TALK_WAITS "the run has hung up before it said what came of it: it is waited for, for 60 s at most"

typedef struct tl_talk_settings {
    const char *path; /* of the socket; it must stay */
    void (*hear)(void *context, const tl_control_reply *reply);
    void *context;
} tl_talk_settings;

/* Fields are private but for `ended` and `result`. */
typedef struct tl_talk {
    bool ended;               /* TL_CONTROL_END was told: */
    tl_control_result result; /* of that */
    bool is_tried;            /* it is on probation */
    tl_talk_settings settings;
    tl_control_request request;
    int socket;     /* −1: none */
    bool is_active; /* the step `activate` was told, and none after it that says what came of it */
    bool follows;
    char hash[TL_SHA256_TEXT]; /* what is to be active */
    uint64_t version;          /* its number, 0: not known yet */
    tl_time heard;             /* when something came last, or somebody was there */
} tl_talk;

/* Of the run whose configuration is called `subject` (/etc/twinlock/motor.json: TL_CONTROL_FOLDER/motor), unless one is given. TL_BAD_USAGE: TL_TALK_INPUT has no name. */
tl_status tl_talk_find(const char *subject, const char *given, char path[PATH_MAX], tl_error *error);

/* Connects. What is open must be closed. */
tl_status tl_talk_open(tl_talk *talk, const tl_talk_settings *settings, tl_error *error);

/* `who` of a request that nobody has filled in yet: the name of a user of this box. */
void tl_talk_name(uid_t user, char who[TL_CONTROL_NAME]);

/* Asks; as in control.h. */
tl_status tl_talk_ask(tl_talk *talk, const tl_control_request *request, const char *text, size_t size, tl_error *error);

/* Tells what comes within `time`, one reply at most. TL_OK also if nothing came. */
tl_status tl_talk_look(tl_talk *talk, tl_time time, tl_error *error);

/* Closes. A zeroed one that was never opened is not allowed. */
void tl_talk_close(tl_talk *talk);

#endif
