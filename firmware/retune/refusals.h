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

#include "firmware/retune/versions.h"

enum { TL_REFUSALS_MOST = 20, TL_REFUSAL_WORD = 16 };

typedef struct tl_refused {
    uint64_t number;              /* counts up from 1 */
    char hash[TL_SHA256_TEXT];    /* of its text */
    char origin[TL_REFUSAL_WORD]; /* by which way it came: "reload", "limited", … */
    char result[TL_REFUSAL_WORD]; /* "refused", "cancelled" */
    char who[TL_VERSION_WHO];
    char why[TL_VERSION_WHY];    /* somebody has sent it */
    char reason[TL_VERSION_WHY]; /* of the result */
    char at[TL_UTC_TEXT];        /* when; for people */
} tl_refused;

typedef struct tl_refusals {
    size_t count;
    tl_refused list[TL_REFUSALS_MOST]; /* the oldest first */
    char folder[PATH_MAX];
} tl_refusals;

/* Reads what is in the folder of versions that are open. */
void tl_refusals_open(tl_refusals *refusals, const tl_versions *versions);

/* Keeps another one: its hash, and texts, which are cut and made fit to be shown; number and time are found here. TL_TRY_AGAIN: the disk refuses, and it is
 * known only until the folder is opened anew. */
tl_status tl_refusals_add(tl_refusals *refusals, const tl_refused *news, tl_error *error);

#endif
