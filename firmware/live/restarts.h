/* Restart record: how often the twin was started, why, and whether it is in a restart loop.
 *
 * Purpose: the record must outlive the supervisor and a reset of the box. It is saved to
 *          FOLDER/supervisor.json; each change replaces the whole file. Without a folder it lasts
 *          as long as the supervisor.
 * Loop:    only an unexpected end of the twin's process counts as a failure. A power cut, a reset
 *          of the box or a killed supervisor does not count. TL_RESTARTS_FORGIVEN (120 s) of
 *          running time forgives one failure. TL_RESTARTS_MOST (5) failures that are not forgiven
 *          are a restart loop. Then safe hold follows. No wall clock is needed, because a box may
 *          start without one.
 * Retries: the twin is retried after TL_RESTARTS_HOLD (60 s) of safe hold. This time doubles with
 *          each retry, up to TL_RESTARTS_HOLD_MOST (1 h). Each start of the supervisor is a retry
 *          as well. An orderly end of the supervisor clears failures and retries.
 * Memory:  the caller owns the object.
 * Errors:  a failed write is logged once, and does not stop the caller.
 * Thread:  the supervisor's.
 */
#ifndef TL_FIRMWARE_LIVE_RESTARTS_H
#define TL_FIRMWARE_LIVE_RESTARTS_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

enum { TL_RESTARTS_MOST = 5, TL_RESTARTS_REASON = 192 };

#define TL_RESTARTS_FORGIVEN (120 * TL_SECOND)
#define TL_RESTARTS_HOLD (60 * TL_SECOND)
#define TL_RESTARTS_HOLD_MOST (3600 * TL_SECOND)

typedef struct tl_restarts {
    uint64_t starts;                 /* starts of the twin in all recorded runs */
    uint64_t restarts;               /* those of them that followed a failure */
    unsigned failures;               /* not forgiven; at most TL_RESTARTS_MOST */
    unsigned tries;                  /* retries from safe hold since all failures were forgiven */
    bool interrupted;                /* the previous supervisor did not end in an orderly way */
    char reason[TL_RESTARTS_REASON]; /* why the twin starts this time; "": no special reason */
    uint64_t unreadable;             /* identity number of the FMU files whose saved state ended a process; 0: none */
    /* private */
    char path[PATH_MAX]; /* of the file; "": not saved */
    char boot[TL_IDENTITY_TEXT];
    int lock;        /* the folder with its file lock; -1: none */
    tl_time healthy; /* running time since the start or the last forgiven failure, ns */
    bool unwritten;  /* a failed write was logged */
} tl_restarts;

/* Start information for a twin process. */
typedef struct tl_start {
    uint64_t starts, restarts; /* copied from tl_restarts, like the next three fields */
    uint64_t unreadable;
    unsigned tries;
    char reason[TL_RESTARTS_REASON];
    unsigned failures; /* of the twin, not forgiven */
    unsigned missing;  /* number of starts in a row that failed because the kernel provided no process for the twin */
    bool again;        /* this start counts as a restart */
    bool hold;         /* start in safe hold, without FMUs */
    tl_time hold_time; /* if `hold`: time in safe hold until the twin is retried, ns */
    bool waits;        /* safe hold lasts only until the first twin may start; not counted as a start */
} tl_start;

/* Loads the record from `folder` (NULL: nothing is loaded or saved) and sets `reason` to why the
 * twin starts. `watchdog`: true if the watchdog has reset the box. A damaged file is logged, and
 * all counts start at 0. A read-only file system is logged, and nothing is saved. Errors:
 * TL_BAD_DATA if the folder cannot be used; TL_TRY_AGAIN if another supervisor uses it. After an
 * error the file is unchanged. */
tl_status tl_restarts_open(const char *folder, bool watchdog, tl_restarts *restarts, tl_error *error);

/* Counts and saves a start of the twin; `again`: after a failure. */
void tl_restarts_begin(tl_restarts *restarts, bool again);

/* Undoes the counts of the last tl_restarts_begin(), because no process could be started. `again`:
 * as in that call. The file is corrected at the next start. */
void tl_restarts_undo(tl_restarts *restarts, bool again);

/* Counts a failure (the twin's process ended without being asked) and sets the reason of the next
 * start. */
void tl_restarts_fail(tl_restarts *restarts, const char *reason);

/* Sets the identity number of the FMU files whose saved states must not be loaded any more; 0: no
 * change. The next start saves it. */
void tl_restarts_note_unreadable(tl_restarts *restarts, uint64_t files);

/* Sets the reason of the next start. Does not count a failure. */
void tl_restarts_excuse(tl_restarts *restarts, const char *reason);

/* Adds running time of the twin; `passed`: ns since the last call. May forgive a failure. */
void tl_restarts_live(tl_restarts *restarts, tl_time passed);

bool tl_restarts_is_loop(const tl_restarts *restarts);

/* Counts a retry of the twin in a restart loop. The next start saves it. */
void tl_restarts_retry(tl_restarts *restarts);

/* Returns the time of safe hold until the next retry, ns. `first`: the time before the first retry,
 * ns; it doubles with each retry, up to TL_RESTARTS_HOLD_MOST. */
tl_time tl_restarts_hold_time(const tl_restarts *restarts, tl_time first);

/* Clears failures and retries, and saves an orderly end of the supervisor. */
void tl_restarts_end(tl_restarts *restarts);

/* Releases the folder. */
void tl_restarts_close(tl_restarts *restarts);

#endif
