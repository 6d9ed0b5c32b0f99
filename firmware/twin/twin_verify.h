/* What is left of a tick is for looking whether the FMUs still come back to where they were; and what was found, as a sentence.
 *
 * Purpose: the live cycle and a replay ask the twin the same (tl_twin_verify()), and tell the same.
 * Thread:  that of the FMUs.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_VERIFY_H
#define TL_FIRMWARE_TWIN_TWIN_VERIFY_H

#include <stdbool.h>

#include "master/base/status.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

enum { TL_TWIN_FINDING_TEXT = 400 };

/* What was found. */
typedef struct tl_twin_look_news {
    bool found;                      /* false: nothing, and the rest means nothing */
    bool mended;                     /* it is no harm any more */
    const char *component;           /* of the twin's, or of the account's */
    char text[TL_TWIN_FINDING_TEXT]; /* a sentence */
} tl_twin_look_news;

/* Between two ticks, until `until` on the monotonic clock; TL_TIME_NEVER: there is time enough. Does not wait, and logs nothing. Errors: those of
 * tl_twin_verify(). */
tl_status tl_twin_look(tl_twin *twin, tl_time until, tl_twin_look_news *news, tl_error *error);

/* The newest finding of a run that has ended. False: there is none. */
bool tl_twin_look_at_account(const tl_account *account, tl_twin_look_news *news);

enum { TL_TWIN_NO_WAY_BACK_TEXT = 320 };

/* A sentence: why it runs free from `step` on, of T_S = `size`. */
void tl_twin_tell_no_way_back(const tl_twin *twin, int64_t step, tl_time size, char text[TL_TWIN_NO_WAY_BACK_TEXT]);

#endif
