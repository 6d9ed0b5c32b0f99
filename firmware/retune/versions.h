/* Saves the versions of a plant's configuration, and refused changes, on disk.
 *
 * Thread:  one thread.
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

/* ---- Versions of a plant's configuration, and the number of the active one, in STATE/versions/.
 *
 * Purpose: saves each configuration that became active, with user, time, reason and result. Also
 *          saves each changed configuration file, even if the start of a run refuses it. Any saved
 *          version can become active again. A refused candidate of a client is no version, but is
 *          in the list of refused changes (below).
 * Files:   HASH.json: a text, byte for byte, named by its SHA-256. NUMBER.record.json: the record
 *          of a version. active.json: the active version, the probation in progress, the result of
 *          the last probation, and the hash of the configuration file that was processed last.
 *          docs/reference/files.md, "versions/", lists the keys.
 * Power:   each file is replaced as a whole: write, fsync, rename, and fsync of the folder. A
 *          change takes effect when active.json is replaced. So a power cut leaves the state before
 *          or the state after a change. When the folder is opened, the results in the records are
 *          corrected from active.json.
 * Time:    a probation is saved with its remaining time, not its end. No decision depends on a
 *          date.
 * Bound:   TL_VERSIONS_MOST versions and TL_VERSIONS_BYTES of texts; the oldest are removed first.
 *          These are never removed: the oldest, the newest and the active version; the parent of
 *          the active one; the target of a rollback; the newest commissioned version
 *          (tl_versions_commissioned()).
 * Errors:  TL_TRY_AGAIN if the disk rejects a write; TL_BAD_DATA if a file is damaged or missing.
 *          After an error, nothing has changed in memory or on disk.
 * Memory:  tl_versions_open() allocates the list; tl_versions_close() frees it.
 * Thread:  one thread; only one process at a time may have the folder open.
 */

/* Maximum number of versions, and of bytes of all texts; sizes of `who` and of a reason, bytes. */
enum { TL_VERSIONS_MOST = 50, TL_VERSIONS_BYTES = 16 * 1024 * 1024, TL_VERSION_WHO = 64, TL_VERSION_WHY = 256 };

/* Result of a version. */
typedef enum tl_version_result {
    TL_VERSION_CANDIDATE,   /* added to the list, neither activated nor refused yet */
    TL_VERSION_ACTIVE,      /* activated without a probation */
    TL_VERSION_PROBATION,   /* active, on probation */
    TL_VERSION_KEPT,        /* kept after a probation */
    TL_VERSION_ROLLED_BACK, /* probation failed, was cancelled or was replaced by another version */
    TL_VERSION_REFUSED,     /* an invalid configuration file; never activated */
    TL_VERSION_RESULTS
} tl_version_result;

/* Names: "candidate", "active", "probation", "kept", "returned" (ROLLED_BACK), "refused". */
extern const char *const tl_version_results[TL_VERSION_RESULTS];

typedef struct tl_version {
    uint64_t number; /* counts up from 1; never reused */
    uint64_t parent; /* the version that was active when this one was added; 0: none */
    char hash[TL_SHA256_TEXT];
    uint64_t size; /* bytes of its text */
    tl_change_origin origin;
    tl_change_right right; /* right that the change needed; for a file that a start has read: TL_RIGHT_COMMISSION */
    tl_change_kind kind;   /* kind of the change from the parent; TL_CHANGE_RESTART for the first version */
    tl_version_result result;
    char who[TL_VERSION_WHO];    /* name of the user */
    char why[TL_VERSION_WHY];    /* the user's reason for the change */
    char reason[TL_VERSION_WHY]; /* why it has this result: "in lock in 71 % of the steps (required 95 %)" */
    char at[TL_UTC_TEXT];        /* when it was added (UTC); for display only */
    char boot[TL_IDENTITY_TEXT]; /* boot ID of the kernel when it was added */
    uint64_t boottime_ms;        /* time from that boot until it was added */
} tl_version;

/* The probation in progress. */
typedef struct tl_version_probation {
    uint64_t version;             /* the version on probation, which is the active one; 0: no probation */
    uint64_t return_to;           /* target of a rollback */
    tl_probation_account account; /* progress, as saved last */
} tl_version_probation;

typedef struct tl_versions {
    tl_version *list; /* ascending by number */
    size_t count;
    uint64_t active; /* number of the active version; 0: no version was activated yet */
    tl_version_probation probation;
    char file_hash[TL_SHA256_TEXT]; /* hash of the configuration file that was activated or refused last; "": none */
    /* private */
    size_t room;                      /* capacity of the list */
    uint64_t newest;                  /* the highest number used so far */
    uint64_t result_version;          /* the version whose result was set last; 0: none */
    tl_version_result last_result;    /* that result */
    char last_reason[TL_VERSION_WHY]; /* and its reason */
    char folder[PATH_MAX];
} tl_versions;

/* Opens the folder versions/ in the folder `state`; makes versions/ if it is missing. `state` must
 * exist. Reads all records. After a power cut, corrects the results and removes incomplete files.
 * Logs and skips damaged records. If active.json is damaged, the newest good version becomes
 * active. */
tl_status tl_versions_open(const char *state, tl_versions *versions, tl_error *error);

/* Frees the list. A zeroed struct is allowed. */
void tl_versions_close(tl_versions *versions);

/* ---- reading ---- */

/* Returns the version with this number, or NULL. The pointer is valid until a version is added. */
const tl_version *tl_versions_get(const tl_versions *versions, uint64_t number);

/* Returns the active version, never NULL: if none is active, the number is 0 and the texts are
 * empty. */
const tl_version *tl_versions_active(const tl_versions *versions);

/* Returns the newest version with this hash, or NULL. */
const tl_version *tl_versions_of_hash(const tl_versions *versions, const char *hash);

/* Returns the newest commissioned version, or NULL. Commissioned: the version was kept after a
 * probation, or activated without one; and it was sent on the box without `--right`, or its change
 * needed the right `commission`. With the right `retune`, a tolerance may be widened only within
 * limits relative to this version (worker.h). */
const tl_version *tl_versions_commissioned(const tl_versions *versions);

/* Reads the text of a version, with a final NUL; the caller calls free(). Checks its hash and size.
 * Errors: TL_BAD_DATA. */
tl_status tl_versions_read(const tl_versions *versions, uint64_t number, char **text, tl_error *error);

/* ---- writing ---- */

/* A version to add. */
typedef struct tl_version_candidate {
    const char *text;
    size_t size;           /* bytes of the text */
    const char *who, *why; /* truncated and cleaned when saved */
    tl_change_origin origin;
    tl_change_right right;
    tl_change_kind kind;
} tl_version_candidate;

/* Checks whether the disk has space for a version with a text of `size` bytes: allocates the space
 * and frees it again. Reserves nothing. */
tl_status tl_versions_check_room(const tl_versions *versions, size_t size, tl_error *error);

/* Adds a candidate and sets *number to its number. Its parent is the active version. Old versions
 * are removed if there are too many. */
tl_status tl_versions_add(tl_versions *versions, const tl_version_candidate *candidate, uint64_t *number,
                          tl_error *error);

/* Records that a candidate in the list is refused, with the reason. If the candidate is the
 * configuration file, marks the file as processed: the file is a candidate again only after its
 * next change. */
tl_status tl_versions_refuse(tl_versions *versions, uint64_t number, const char *reason, tl_error *error);

/* Activates a version of the list, on probation with `account`; NULL: without a probation. A
 * probation in progress ends as rolled back, and the new version inherits the target of its
 * rollback. The new version has no probation if it is that target, or if no version was active
 * before. If the new version is the configuration file, marks the file as processed. */
tl_status tl_versions_activate(tl_versions *versions, uint64_t number, const tl_probation_account *account,
                               tl_error *error);

/* Rewrites the text of a version whose file is damaged or missing. Returns TL_BAD_DATA if `text`
 * does not have the hash of the version. */
tl_status tl_versions_repair(const tl_versions *versions, uint64_t number, const char *text, size_t size,
                             tl_error *error);

/* Saves the progress of the probation. The config manager calls it every 10 s and at its end. Fails
 * with TL_BAD_DATA if no version is on probation. */
tl_status tl_versions_save_probation(tl_versions *versions, const tl_probation_account *account, tl_error *error);

/* Ends the probation. TL_VERSION_KEPT: the active version stays. TL_VERSION_ROLLED_BACK: the target
 * of the rollback becomes active again. Fails with TL_BAD_DATA if there is no probation. */
tl_status tl_versions_end_probation(tl_versions *versions, tl_version_result result, const char *reason,
                                    tl_error *error);

/* ---- at the start ---- */

/* The text that a run should use: that of a version, or the configuration file. */
typedef struct tl_version_choice {
    char *text;        /* text of the version, with a final NUL; the caller calls free(). NULL: use the file */
    size_t size;       /* bytes of that text or of the file */
    uint64_t number;   /* number of the version; 0: use the file, which is not a version yet */
    bool is_candidate; /* the caller must validate the file and add it with TL_ORIGIN_START */
} tl_version_choice;

/* Selects the text to run. The file as a candidate: if it differs from the active version and has
 * changed since it was processed, or if no version is active. Else the active version; if that is
 * damaged, activates an older version that can be read, and if there is none, selects the file as a
 * candidate. Both cases are logged. `file`: text of the file, `size` bytes; NULL: it cannot be
 * read. Returns TL_BAD_DATA if there is no text at all. */
tl_status tl_versions_choose(tl_versions *versions, const char *file, size_t size, tl_version_choice *choice,
                             tl_error *error);

/* ---- Refused and cancelled changes, saved in the same folder. They never become versions.
 *
 * Purpose: a list of versions also shows which user tried a change, and why it was refused. The
 *          texts are not saved.
 * Files:   refused-0.json … refused-19.json in STATE/versions/, one for each refusal, replaced as a
 *          whole. A new refusal replaces the oldest. docs/reference/files.md lists the keys.
 * Bound:   the newest TL_REFUSED_CHANGES_MOST (20). No version is removed for them.
 * Errors:  damaged files are skipped. If the disk rejects a write, only that refusal is lost.
 * Thread:  one thread.
 */

enum { TL_REFUSED_CHANGES_MOST = 20 };

typedef struct tl_refused_changes {
    size_t count;
    tl_control_version list[TL_REFUSED_CHANGES_MOST]; /* oldest first; `version`: number of the refusal */
    char folder[PATH_MAX];
} tl_refused_changes;

/* Reads the refusals in the folder of opened versions. */
void tl_refused_changes_open(tl_refused_changes *refusals, const tl_versions *versions);

/* Adds a refusal to the list and saves it. `result`: "refused" or "cancelled"; `reason`: why. Texts
 * are truncated and cleaned. Returns TL_TRY_AGAIN if the disk rejects the write; then the refusal
 * stays in the list until this process ends. */
tl_status tl_refused_changes_add(tl_refused_changes *refusals, const tl_control_request *request, const char *result,
                                 const char *reason, tl_error *error);

#endif
