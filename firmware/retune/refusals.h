/* Candidates of which nothing came: refused, or cancelled. Kept beside the versions, which they never were.
 *
 * Purpose: who looks at the versions later sees also what was tried and by whom, and why it is not there. Their texts are not kept.
 * Files:   refused-0.json … in STATE/versions/, one for each, replaced whole; the oldest is replaced by the next. config/SPEC.md, "Versions", has the keys.
 * Bound:   the newest TL_REFUSALS_MOST. They take no room of a version, however many come.
 * Errors:  what is damaged is passed over. A disk that refuses costs the record of a refusal, and nothing else.
 * Thread:  one thread; one process at a time has the folder open.
 */
#ifndef TL_FIRMWARE_RETUNE_REFUSALS_H
#define TL_FIRMWARE_RETUNE_REFUSALS_H

#include "firmware/retune/control.h"
#include "firmware/retune/versions.h"

enum { TL_REFUSALS_MOST = 20 };

typedef struct tl_refusals {
    size_t count;
    tl_control_version list[TL_REFUSALS_MOST]; /* the oldest first; `version` counts up from 1 */
    char folder[PATH_MAX];
} tl_refusals;

/* Reads what is in the folder of versions that are open. */
void tl_refusals_open(tl_refusals *refusals, const tl_versions *versions);

/* Keeps another one. `result`: "refused" or "cancelled"; `reason`: of that. Texts are cut and made fit to be shown. TL_TRY_AGAIN: the disk refuses, and it
 * is known only until the folder is opened anew. */
tl_status tl_refusals_add(tl_refusals *refusals, const tl_control_request *request, const char *result,
                          const char *reason, tl_error *error);

#endif
