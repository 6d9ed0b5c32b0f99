/* What comes of a change behind the restart that it took: asked of the run that comes next, until it is kept or returned from.
 *
 * Purpose: the end and the new start of a run end the answer that has told of the change.
 * Waiting: for as long as the probation lasts; 60 s at most if nobody answers.
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_PUSH_PUSH_FOLLOW_H
#define TL_FIRMWARE_PUSH_PUSH_FOLLOW_H

#include "firmware/push/push_lines.h"
#include "firmware/push/push_link.h"

/* Whether an answer has ended before it said what came of a change that is active. */
bool tl_push_follow_is_due(const tl_push_lines *lines);

/* Tells how it goes on with the configuration of that hash, in lines like those of the box. The exit code. */
int tl_push_follow(tl_push_link *link, tl_push_lines *lines, const char *hash);

#endif
