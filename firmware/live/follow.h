/* Follow: writes the state of a live run as JSON lines, one a second (`run --follow`).
 *
 * Purpose: a script or a log collector needs no server. After the time, a line has the members of
 *          the state that the control socket serves (tl_control_add_figures()), then further ones.
 * Reader:  it may be slow or gone. No write waits: while an earlier line is not written completely,
 *          new lines are dropped and counted. If the reader is gone, no more lines are written. The
 *          run continues in both cases.
 * Trust:   the status of a twin is bounded and cleaned (live_host.h).
 * Thread:  that of the log relay.
 */
#ifndef TL_FIRMWARE_LIVE_FOLLOW_H
#define TL_FIRMWARE_LIVE_FOLLOW_H

#include <stddef.h>
#include <stdint.h>

#include "firmware/live/live_host.h"
#include "firmware/retune/activation.h"

enum { TL_FOLLOW_LINE = 32 * 1024 };

/* The caller sets `output`, and the twins, recorder, handover block and step of `host`. The rest is
 * private and zeroed. */
typedef struct tl_follow {
    int output; /* descriptor; -1: none, or its reader is gone */
    tl_live_host host;
    tl_time due;                 /* when the next line is due, CLOCK_MONOTONIC, ns */
    tl_activation_view views[2]; /* of the line before and of this line */
    uint64_t lines;              /* number of lines composed so far */
    uint64_t dropped;
    size_t length, written; /* bytes of `line`, and how many of them are written */
    char line[TL_FOLLOW_LINE];
} tl_follow;

/* Writes what is due, without waiting. Call it several times a second. */
void tl_follow_poll(tl_follow *follow);

#endif
