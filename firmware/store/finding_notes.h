/* Notes on findings: a user acknowledges a finding, accepts its level as normal, or removes what
 * the change detector has learnt; `twinlock explain` stores its answer.
 *
 * Purpose: the functions change the database, also while a run writes it. The recorder does not
 *          overwrite these notes. It reads which findings are normal, and whether what was learnt
 *          was removed.
 * Errors:  those of database.h; TL_BAD_DATA if there is no such finding; TL_TRY_AGAIN if another
 *          program locks the database for 5 s.
 * Thread:  any; one at a time for each database.
 */
#ifndef TL_FIRMWARE_STORE_FINDING_NOTES_H
#define TL_FIRMWARE_STORE_FINDING_NOTES_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/status.h"

/* Acknowledges a finding; replaces an earlier note. `who`: name of the user. `note`: a remark;
 * NULL: none. `accepts`: the level of the finding counts as normal from now on; this fails with
 * TL_BAD_DATA if the finding is normal already, or is a frozen signal, which has no level. */
tl_status tl_finding_notes_write(const char *path, int64_t finding, const char *who, const char *note, bool accepts,
                                 tl_error *error);

/* Stores the answer of `twinlock explain` (`text`), and the present time. */
tl_status tl_finding_notes_explain(const char *path, int64_t finding, const char *text, tl_error *error);

/* Removes what was learnt. Open findings become "normal": the detector learns the present state. */
tl_status tl_finding_notes_forget(const char *path, tl_error *error);

#endif
