/* What a run says, for people to read.
 *
 * Thread: one.
 */
#ifndef TL_FIRMWARE_RETUNE_TALK_PAGE_H
#define TL_FIRMWARE_RETUNE_TALK_PAGE_H

#include <stdbool.h>
#include <stdio.h>

#include "firmware/control/control_wire.h"

typedef struct tl_talk_page {
    FILE *output;
    const char *subject; /* what a problem is in: the name of the file */
    bool logs;           /* what is wrong goes to the log, else to `output`, too */
} tl_talk_page;

void tl_talk_page_print(const tl_talk_page *page, const tl_control_reply *reply);

#endif
