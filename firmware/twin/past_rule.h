/* The rule by which a run is gone on with, wherever it was found.
 *
 * Rule:    the newest run that got anywhere, if it did not end by itself or with an error, if its last tick is at most `record.resume_s` ago,
 *          and if there is anything left to do of its duration.
 * Result:  false, and why, in words for an event.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_TWIN_PAST_RULE_H
#define TL_FIRMWARE_TWIN_PAST_RULE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "master/base/status.h"

enum {
    TL_PAST_WHY = 160,
    TL_PAST_FRUITLESS = 3 /* restarts in a row that got no further than the run they went on with, at most */
};

/* Says why, and is false. */
bool tl_past_refuse(char why[TL_PAST_WHY], const char *format, ...) TL_PRINTF(2, 3);

/* Of a run that ended with `reason`; NULL: it did not. A run that came to its end, or failed, is not gone on with: it would come to the same
 * end. */
bool tl_past_was_interrupted(int64_t run, const char *reason, char why[TL_PAST_WHY]);

/* `gap`, ns, is how long ago its last tick was. */
bool tl_past_is_recent(int64_t run, const tl_config *config, tl_time gap, char why[TL_PAST_WHY]);

/* Whether the run, as it is asked for now, has anything left to do. */
bool tl_past_is_under_way(int64_t run, const tl_config *config, int64_t last, tl_time gap, uint32_t lead,
                          char why[TL_PAST_WHY]);

/* Ticks that can be followed in the time for it, if one execution takes so many ns and there are so many components; 0 ns: it is not known. */
int64_t tl_past_most_followed(tl_time execution, size_t components);

#endif
