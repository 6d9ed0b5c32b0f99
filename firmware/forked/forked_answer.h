/* What an FMU is asked, unpacked from a message, called, and answered in it.
 *
 * Purpose: the FMU's side of forked_calls.h: what stands where in a message is the same for both.
 * Trust:   the message comes from the twin, and an FMU may write into it all the same: it harms itself. Counts are bounded.
 * Thread:  the only one of the FMU's process.
 */
#ifndef TL_FIRMWARE_FORKED_FORKED_ANSWER_H
#define TL_FIRMWARE_FORKED_FORKED_ANSWER_H

#include "firmware/forked/forked_block.h"
#include "master/fmi/fmi2.h"

/* Texts that one call sets. */
enum { TL_FORKED_STRINGS = 1024 };

/* What to instantiate it with, and to call. */
typedef struct tl_forked_fmu {
    const tl_fmi2 *functions;
    const fmi2CallbackFunctions *callbacks;
} tl_forked_fmu;

typedef struct tl_forked_answers {
    tl_forked_fmu fmu;
    fmi2Component instances[TL_FORKED_INSTANCES];
} tl_forked_answers;

void tl_forked_answer(tl_forked_answers *answers, tl_forked_message *message);

/* Texts in a message, one after the other, each with its end. */
typedef struct tl_forked_texts {
    const char *at;
    const char *end;
} tl_forked_texts;

tl_forked_texts tl_forked_texts_of(tl_forked_message *message);

/* The next one; "" if there is none. */
const char *tl_forked_texts_next(tl_forked_texts *texts);

#endif
