/* One writer per database: a lock file beside it, "FILE-writer".
 *
 * Purpose: two programs that record into one database would remove each other's runs, and neither could tell a run that
 *          is being written from one that was killed. The lock ends with the process, however that ends.
 * Thread:  take and release from one thread.
 */
#ifndef TL_FIRMWARE_RECORD_RECORDER_LOCK_H
#define TL_FIRMWARE_RECORD_RECORDER_LOCK_H

#include <limits.h>

#include "master/base/status.h"

typedef struct tl_recorder_lock {
    int file;
    char path[PATH_MAX];
} tl_recorder_lock;

/* Waits for at most 2 s. TL_TRY_AGAIN where another recorder has it, of this process or another, or where the
 * file cannot be made; TL_BAD_DATA where its name is that of a file which is no lock. */
tl_status tl_recorder_lock_take(const char *database, tl_recorder_lock *lock, tl_error *error);

void tl_recorder_lock_release(tl_recorder_lock *lock);

#endif
