/* One writer per database: a lock file beside it, "FILE-writer".
 *
 * Purpose: two programs that record into one database would remove each other's runs, and neither could tell a run that
 *          is being written from one that was killed. The lock ends with the process, however that ends.
 * Thread:  take and release from one thread.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_LOCK_H
#define TL_FIRMWARE_STORE_DATABASE_LOCK_H

#include <limits.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

typedef struct tl_database_lock {
    int file;
    char path[PATH_MAX];
} tl_database_lock;

/* Waits for at most `patience`. TL_TRY_AGAIN if another recorder has it, of this process or another, or if the
 * file cannot be made; TL_BAD_DATA if its name is that of a file which is no lock. Says the fault (database_fault.h). */
tl_status tl_database_lock_take(const char *database, tl_time patience, tl_database_lock *lock, tl_error *error);

void tl_database_lock_release(tl_database_lock *lock);

#endif
