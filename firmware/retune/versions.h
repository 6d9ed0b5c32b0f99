/* The versions of a configuration on the disk.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_RETUNE_VERSIONS_H
#define TL_FIRMWARE_RETUNE_VERSIONS_H

#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/base/text.h"
#include "firmware/config/config_change.h"
#include "firmware/retune/control.h"
#include "firmware/retune/probation.h"
#include "master/base/status.h"

/* ---- The versions of a plant's configuration, and which of them is active: kept in STATE/versions/.
 *
 * Purpose: each configuration that was ever tried, with who, when, why and what came of it; any can be brought back.
 * Files:   HASH.json: a text, byte for byte, by its SHA-256. NUMBER.record.json: what is known of a version. active.json: which one is active, the
 *          probation that is under way, how the last one ended, and which file was taken last. config/SPEC.md, "Versions", has the keys.
 * Power:   each file is replaced whole, by write, fsync, rename and fsync of the folder, and active.json last. So a power cut leaves what was
 *          before or what is after. What active.json says holds: a record that does not say so yet is made to when the folder is opened.
 * Time:    of the probation is what is left of it; no date decides anything.
 * Bound:   the newest TL_VERSIONS_MOST, and TL_VERSIONS_BYTES of texts; never removed are the first, the active one, its parent, the one that is
 *          returned to, and the one that was commissioned last.
 * Errors:  TL_TRY_AGAIN where the disk refuses, TL_BAD_DATA where something is damaged or not there. In memory and on disk all is as before
 *          then.
 * Thread:  one thread; one process at a time has the folder open.
 */

enum { TL_VERSIONS_MOST = 50, TL_VERSIONS_BYTES = 16 * 1024 * 1024, TL_VERSION_WHO = 64, TL_VERSION_WHY = 256 };

/* What came of it. */
typedef enum tl_version_result {
    TL_VERSION_CANDIDATE, /* nothing yet */
    TL_VERSION_ACTIVE,    /* it was activated without a probation */
    TL_VERSION_PROBATION,
    TL_VERSION_KEPT,
    TL_VERSION_RETURNED, /* from it to the one before */
    TL_VERSION_REFUSED,  /* it was never active */
    TL_VERSION_RESULTS
} tl_version_result;

/* "candidate", "active", "probation", "kept", "returned", "refused". */
extern const char *const tl_version_results[TL_VERSION_RESULTS];

typedef struct tl_version {
    uint64_t number; /* counts up from 1, and is never given again */
    uint64_t parent; /* the one that was active when it came; 0: none */
    char hash[TL_SHA256_TEXT];
    uint64_t size; /* bytes of its text */
    tl_change_origin origin;
    tl_change_right right; /* it was taken with */
    tl_change_kind kind;   /* against its parent; TL_CHANGE_RESTART of the first */
    tl_version_result result;
    char who[TL_VERSION_WHO];
    char why[TL_VERSION_WHY];    /* somebody has changed it */
    char reason[TL_VERSION_WHY]; /* of the result: "in lock for 71 % of the steps, asked were 95 %" */
    char at[TL_UTC_TEXT];        /* when it came; for people */
    char boot[TL_IDENTITY_TEXT]; /* the kernel's boot id then, */
    uint64_t boottime_ms;        /* and the time since that boot */
} tl_version;

/* The probation that is under way. */
typedef struct tl_version_probation {
    uint64_t version; /* the active one; 0: there is none */
    uint64_t return_to;
    tl_probation_account account;
} tl_version_probation;

typedef struct tl_versions {
    tl_version *list; /* ascending by number; */
    size_t count;
    uint64_t active; /* number; 0: none was ever activated */
    tl_version_probation probation;
    char taken[TL_SHA256_TEXT]; /* of the file on the box that was taken last; "": none */
    /* private */
    size_t room;      /* of the list */
    uint64_t newest;  /* number that was ever given */
    uint64_t settled; /* the version whose probation ended last, 0: none; and how */
    tl_version_result how;
    char because[TL_VERSION_WHY];
    char folder[PATH_MAX];
} tl_versions;

/* Makes the folder if it is not there (`state` must be), reads what is in it, and mends what a power cut left. Damaged records are told
 * on the log and passed over. */
tl_status tl_versions_open(const char *state, tl_versions *versions, tl_error *error);

/* A zeroed one is allowed. */
void tl_versions_close(tl_versions *versions);

/* ---- looking ---- */

/* NULL: there is none. Valid until a version is added. */
const tl_version *tl_versions_get(const tl_versions *versions, uint64_t number);

/* Never NULL: if no version is active, its number is 0 and its texts are empty. */
const tl_version *tl_versions_active(const tl_versions *versions);

/* The newest with this hash. NULL: there is none. */
const tl_version *tl_versions_of_hash(const tl_versions *versions, const char *hash);

/* The version that was commissioned last: the newest that was kept (or active without a probation) and that came from the box itself or needed the right to
 * commission. NULL: there is none. How far `retune` may widen a tolerance is measured from it. */
const tl_version *tl_versions_commissioned(const tl_versions *versions);

/* Its text with a NUL behind it, the caller's to free(); it has the version's hash and size. */
tl_status tl_versions_read(const tl_versions *versions, uint64_t number, char **text, tl_error *error);

/* ---- changing ---- */

/* What is known of a candidate. */
typedef struct tl_version_news {
    const char *text;
    size_t size;
    const char *who, *why; /* cut, and made fit to be shown */
    tl_change_origin origin;
    tl_change_right right;
    tl_change_kind kind;
} tl_version_news;

/* Whether the disk takes a version of so many bytes now: found out by trying it. */
tl_status tl_versions_check_room(const tl_versions *versions, size_t size, tl_error *error);

/* A new version, whose parent is the active one; a candidate. */
tl_status tl_versions_add(tl_versions *versions, const tl_version_news *news, uint64_t *number, tl_error *error);

/* A candidate, which is in the list, is not activated, for this reason. If it was the file on the box, that counts as taken. */
tl_status tl_versions_refuse(tl_versions *versions, uint64_t number, const char *reason, tl_error *error);

/* From now on this version, which is in the list, is the active one, on probation from `account` on; NULL: without. One that was on probation until now is returned from by this; what it
 * would have returned to is then returned to by this one; and if it is this one, it needs no probation. If it was the file on the box, that counts as
 * taken. */
tl_status tl_versions_activate(tl_versions *versions, uint64_t number, const tl_probation_account *account,
                               tl_error *error);

/* The text of a version that is damaged or gone is written again; it must be that one. */
tl_status tl_versions_mend(const tl_versions *versions, uint64_t number, const char *text, size_t size,
                           tl_error *error);

/* The probation goes on: what it has come to. Every 10 s, and at each start. */
tl_status tl_versions_pass(tl_versions *versions, const tl_probation_account *account, tl_error *error);

/* The end of the probation: the active one is kept (TL_VERSION_KEPT), or the one before is the active one again (TL_VERSION_RETURNED). */
tl_status tl_versions_settle(tl_versions *versions, tl_version_result result, const char *reason, tl_error *error);

/* ---- at the start ---- */

typedef struct tl_version_choice {
    char *
        text; /* of the version that is to run, with a NUL behind it; the caller's to free(). NULL: the file is to run */
    size_t size;
    uint64_t number; /* of the version; 0: the file is none yet */
    bool
        is_candidate; /* the file was changed since it was taken last: it is to be added as TL_ORIGIN_START, and tried */
} tl_version_choice;

/* Which text is to run: the file's, if it is not the one that was taken last; else the active version's. If that is damaged or gone, its
 * parent's, and then the file's; that is said on the log. `file` NULL: it cannot be read. TL_BAD_DATA: there is no text at all. */
tl_status tl_versions_choose(tl_versions *versions, const char *file, size_t size, tl_version_choice *choice,
                             tl_error *error);

/* ---- Candidates of which nothing came: refused, or cancelled. Kept beside the versions, which they never were.
 *
 * Purpose: who looks at the versions later sees also what was tried and by whom, and why it is not there. Their texts are not kept.
 * Files:   refused-0.json … in STATE/versions/, one for each, replaced whole; the oldest is replaced by the next. config/SPEC.md, "Versions", has the keys.
 * Bound:   the newest TL_REFUSALS_MOST. They take no room of a version, however many come.
 * Errors:  what is damaged is passed over. A disk that refuses costs the record of a refusal, and nothing else.
 */

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
