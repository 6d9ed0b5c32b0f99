/* What a run says, for people to read.
 *
 * Thread: one.
 */
#ifndef TL_FIRMWARE_RETUNE_TALK_PAGE_H
#define TL_FIRMWARE_RETUNE_TALK_PAGE_H

#include <stdio.h>

#include "firmware/retune/control_wire.h"

typedef struct tl_talk_page {
    FILE *output;        /* problems, and an end that is none, go to the log instead */
    const char *subject; /* what a problem is in: the name of the file */
} tl_talk_page;

void tl_talk_page_print(const tl_talk_page *page, const tl_control_reply *reply);

#endif
