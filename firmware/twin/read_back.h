/* The read-back: whether another process can make use of the states of a twin's FMUs, before a checkpoint is believed to hold them.
 *
 * Purpose: the process with the FMUs tells what master/twin/twin_read_back.h says into a block that it shares with others of its kind; whoever has started
 *          it starts another one, which reads one component after the other and says in the same block what came of it. If that process ends in the
 *          midst of one, the next one goes on behind it.
 * Trust:   both processes hold the same FMUs, and who has started them looks at nothing in the block: it says how a process has ended.
 * Thread:  that of the FMUs, in either process.
 */
#ifndef TL_FIRMWARE_TWIN_READ_BACK_H
#define TL_FIRMWARE_TWIN_READ_BACK_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"

enum {
    TL_READ_BACK_BYTES = 64 << 20, /* of the block, whose memory is there as far as it is used */
    TL_READ_BACK_TEXT = 512
};

typedef enum tl_read_back_finding {
    TL_READ_BACK_UNKNOWN, /* it was not tried, or not to its end */
    TL_READ_BACK_IS_EXACT,
    TL_READ_BACK_ENDS, /* the process that loads it, or keeps it for so long that it was killed */
    TL_READ_BACK_IS_REFUSED,
    TL_READ_BACK_IS_OTHER, /* loaded, and led by the same inputs, it gives something else */
    TL_READ_BACK_NOR_HERE  /* and so it does in the process that has saved it: that is no matter of bytes */
} tl_read_back_finding;

/* Of one component. */
typedef struct tl_read_back_component {
    tl_read_back_finding finding;
    char
        text[TL_READ_BACK_TEXT]; /* which, or why: a sentence about it, without its name; "": there is nothing to say */
} tl_read_back_component;

typedef struct tl_read_back_report {
    bool is_tried;
    bool is_exact; /* all of them are */
    size_t count;
    tl_read_back_component of[TL_RECORDER_COMPONENTS];
} tl_read_back_report;

/* Who starts another process, and returns when that has ended. TL_OK: as it should; else the error says how. */
typedef struct tl_read_back_host {
    tl_status (*ask)(void *context, tl_error *error);
    void *context;
    void *block; /* of TL_READ_BACK_BYTES */
} tl_read_back_host;

/* Of a twin that has begun, between two ticks, and is where it was afterwards; `host` may be NULL: nobody is asked. */
void tl_read_back_take(const tl_assembly *assembly, const tl_read_back_host *host, tl_read_back_report *report);

/* Another process cannot go on with such a state. */
bool tl_read_back_is_useless(tl_read_back_finding finding);

/* What a state does of which that was found, and nothing good: "ends the process that loads it". */
const char *tl_read_back_words(tl_read_back_finding finding);

/* In the other process, whose twin is built. Errors: the FMUs could not be initialised. */
tl_status tl_read_back_answer(const tl_assembly *assembly, void *block, tl_error *error);

#endif
