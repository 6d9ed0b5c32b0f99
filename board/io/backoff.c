/* Waits that double: see backoff.h. */
#include "board/io/backoff.h"

void tl_backoff_fail(tl_backoff *backoff, tl_time now) {
    tl_time next = backoff->pause > 0 ? 2 * backoff->pause : TL_BACKOFF_FIRST;
    backoff->pause = next < TL_BACKOFF_LAST ? next : TL_BACKOFF_LAST;
    backoff->due = now + backoff->pause;
}

void tl_backoff_reset(tl_backoff *backoff) {
    *backoff = (tl_backoff){.pause = 0};
}

bool tl_backoff_is_on(const tl_backoff *backoff) {
    return backoff->pause > 0;
}

bool tl_backoff_is_due(const tl_backoff *backoff, tl_time now) {
    return backoff->pause == 0 || now >= backoff->due;
}
