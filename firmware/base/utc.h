/* UTC as people and databases write it: "2026-11-21T10:02:03.456Z".
 *
 * Purpose: one format for every stamp that leaves the process. Inside, times are monotonic nanoseconds
 *          (master/base/simtime.h); the wall clock is only ever a stamp.
 * Thread:  any; no lock, no allocation.
 */
#ifndef TL_FIRMWARE_BASE_UTC_H
#define TL_FIRMWARE_BASE_UTC_H

#include <stdbool.h>
#include <stdint.h>

enum { TL_UTC_TEXT = 25 }; /* bytes, the zero at the end included */

/* Milliseconds since 1970-01-01T00:00:00Z. Wait-free. */
int64_t tl_utc_now(void);

/* Years 0 … 9999; a time outside is written as the nearest inside. */
void tl_utc_text(int64_t milliseconds, char text[TL_UTC_TEXT]);

/* "2026-11-21", "2026-11-21T10:02", "… 10:02:03", "….456"; 'T' or one blank between, an optional 'Z' at the end.
 * False where it is none of these. */
bool tl_utc_parse(const char *text, int64_t *milliseconds);

#endif
