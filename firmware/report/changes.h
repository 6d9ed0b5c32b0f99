/* Formats findings (detected lasting changes, finding.h) as JSON and as sentences, for replays and
 * databases.
 *
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_CHANGES_H
#define TL_FIRMWARE_REPORT_CHANGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/json.h"
#include "firmware/monitor/finding.h"
#include "firmware/store/run_types.h"

/* Returns true if the finding is open. Other states: gone, or accepted as normal. */
bool tl_changes_is_open(const tl_run_finding *row);

/* Returns the number of findings with this state: "open", "gone" or "normal". */
size_t tl_changes_count(const tl_run_changes *changes, const char *state);

/* Returns false if there is no finding and less than 4 % of the learning time has passed. */
bool tl_changes_are_known(const tl_run_changes *changes);

/* Opens an object in the current array and adds the finding. The caller may add keys, and must
 * close the object. `started`: t_start, ms since 1970 UTC; 0: a replay, so there are no calendar
 * times. */
void tl_changes_add_finding(tl_json_writer *json, const tl_run_finding *row, int64_t started);

/* Adds the state of the change detector as the object "detection". */
void tl_changes_add_detection(tl_json_writer *json, const tl_run_detection *detection);

/* Writes the verdict, for example "2 lasting changes are open, 1 is gone", "no lasting change in 3
 * d, after 1 d of learning" or "learning: 3 h of 1 d; nothing can be said yet". */
void tl_changes_write_verdict(const tl_run_detection *detection, size_t open, size_t gone, char text[TL_FINDING_TEXT]);

/* Writes the sentence of a finding, and its cause ("": unknown). `now`: present time, s since
 * t_start. Both are "" if the row is invalid. `started` as above. */
void tl_changes_write_finding(const tl_run_finding *row, double now, int64_t started, char text[TL_FINDING_TEXT],
                              char cause[TL_FINDING_TEXT]);

#endif
