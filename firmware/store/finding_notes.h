/* Notes on findings: a user acknowledges one, accepts its level as normal, or begins to learn
 * again; `twinlock explain` stores its answer.
 *
 * Purpose: all change the database, also while a run writes it. The recorder keeps these notes. It
 *          reads which findings count as normal, and that what was learnt is gone.
 * Errors:  those of database.h; TL_BAD_DATA if there is no such finding; TL_TRY_AGAIN if another
 *          program locks the database for 5 s.
 * Thread:  any; one at a time for each database.
 */
#ifndef TL_FIRMWARE_STORE_FINDING_NOTES_H
#define TL_FIRMWARE_STORE_FINDING_NOTES_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/status.h"

/* Acknowledges a finding. `who`: name of the user. `note`: a remark; NULL: none. `accepts`: its
 * level counts as normal from now on; fails with TL_BAD_DATA if the finding is normal already, or
 * is a frozen signal, which has no level. */
tl_status tl_finding_notes_write(const char *path, int64_t finding, const char *who, const char *note, bool accepts,
                                 tl_error *error);

/* Stores the answer of `twinlock explain`, and the time. */
tl_status tl_finding_notes_explain(const char *path, int64_t finding, const char *text, tl_error *error);

/* Removes what was learnt. Open findings become "normal", because the present state is learnt. */
tl_status tl_finding_notes_forget(const char *path, tl_error *error);

#endif
