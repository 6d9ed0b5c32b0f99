/* The account of restarts: how often the twin was started, why, and whether that is a loop.
 *
 * Purpose: what outlives the supervisor and a reset of the box. Kept in FOLDER/supervisor.json, which each change replaces as a
 *          whole; without a folder it lasts as long as the supervisor.
 * Loop:    only an end of the twin's own process counts as a failure. A power cut, a reset of the box or a killed supervisor does not.
 *          TL_RESTARTS_FORGIVEN of life forgive one failure; TL_RESTARTS_MOST failures are a loop, and the supervisor goes into safe hold.
 *          No clock is needed: a box may start without one.
 * Retries: from safe hold the twin is tried again after TL_RESTARTS_HOLD, and each time after twice as long, at most TL_RESTARTS_HOLD_MOST;
 *          also at each start of the supervisor. An orderly end of the supervisor forgets failures and retries.
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
    uint64_t starts;   /* of the twin, all that were ever counted here, */
    uint64_t restarts; /* and those of them after a failure */
    unsigned failures; /* not forgiven; at most TL_RESTARTS_MOST */
    unsigned tries;    /* retries from safe hold since the twin last lived long enough to be forgiven all */
    bool interrupted;  /* the supervisor before this one did not end in order */
    char reason[TL_RESTARTS_REASON]; /* why the twin starts: "the box was reset by its watchdog" */
    uint64_t unreadable; /* number of FMU files whose saved state has ended the process that loaded it; 0: none */
    /* private */
    char path[PATH_MAX]; /* "": nowhere */
    char boot[TL_IDENTITY_TEXT];
    int lock;        /* the folder, held; -1: none */
    tl_time healthy; /* since one was forgiven */
    bool unwritten;  /* said so */
} tl_restarts;

/* What a twin is told at its start. */
typedef struct tl_start {
    uint64_t starts, restarts; /* of tl_restarts, as the next three */
    uint64_t unreadable;
    unsigned tries;
    char reason[TL_RESTARTS_REASON];
    unsigned failures; /* of the twin, */
    unsigned missing;  /* and starts in a row that got no process */
    bool again;        /* after a failure */
    bool hold;         /* safe hold, */
    tl_time hold_time; /* and for how long, until the twin is tried again */
    bool waits;        /* or only until the run's twin may begin: then this is no start of the account */
} tl_start;

/* Reads what is kept, and finds out why there is a start: at best an orderly end before. `watchdog`: the box was reset by its
 * watchdog. A file that is damaged is told on the log, and counting begins anew; so is a folder that can only be read, in which nothing is kept. Errors: TL_BAD_DATA where the folder cannot be
 * used, TL_TRY_AGAIN where another supervisor has it; nothing is changed then. */
tl_status tl_restarts_open(const char *folder, bool watchdog, tl_restarts *restarts, tl_error *error);

/* A start of the twin; `again`: after a failure. */
void tl_restarts_begin(tl_restarts *restarts, bool again);

/* No process could be started: takes the newest start back, with its `again`; the next start keeps that. */
void tl_restarts_undo(tl_restarts *restarts, bool again);

/* The twin's process has ended without being asked to. */
void tl_restarts_fail(tl_restarts *restarts, const char *reason);

/* These files' saved states are not to be loaded any more; kept with the next start. 0: nothing is noted. */
void tl_restarts_note_unreadable(tl_restarts *restarts, uint64_t files);

/* There is a start for this reason, which is no failure. */
void tl_restarts_excuse(tl_restarts *restarts, const char *reason);

/* It has been alive for so long, since this was last called. */
void tl_restarts_live(tl_restarts *restarts, tl_time passed);

bool tl_restarts_is_loop(const tl_restarts *restarts);

/* The twin is tried again although it is a loop; kept with the next start. */
void tl_restarts_retry(tl_restarts *restarts);

/* How long safe hold lasts until the next retry, of which the first comes after `first`. */
tl_time tl_restarts_hold_time(const tl_restarts *restarts, tl_time first);

/* The supervisor ends orderly. */
void tl_restarts_end(tl_restarts *restarts);

/* Lets go of the folder. */
void tl_restarts_close(tl_restarts *restarts);

#endif
