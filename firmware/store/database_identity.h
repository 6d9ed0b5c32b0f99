/* Which files a database was in, for whoever is told of it later: another process, after the one that wrote has died.
 *
 * Purpose: a file that was removed, moved away or replaced meanwhile leaves its log, FILE-wal, behind, and SQLite would play that into whatever
 *          has the file's name by then. Who knows which two files belonged together can prevent that.
 * Memory:  plain data, zeroed: nothing is known, and then nothing is done.
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_STORE_DATABASE_IDENTITY_H
#define TL_FIRMWARE_STORE_DATABASE_IDENTITY_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/store/database_file.h"

/* One file, whatever it is called. */
typedef struct tl_database_inode {
    uint64_t device;
    uint64_t number; /* 0: none */
    int64_t born;    /* ns since 1970, since numbers are given again; 0: the file system does not say */
} tl_database_inode;

typedef struct tl_database_identity {
    tl_database_inode file;
    tl_database_inode log;
} tl_database_identity;

/* Of a database that is open. */
tl_database_identity tl_database_identify(const tl_database_file *file);

/* At this path there is another file now, or none. False also if that cannot be told, as in a folder that may not be entered. */
bool tl_database_is_gone(const char *path, const tl_database_identity *identity);

/* If it is gone and its log is still there: removes that, and the log's index, FILE-shm. Not while another recorder has the lock. The caller must
 * have none. */
void tl_database_remove_stray_log(const char *path, const tl_database_identity *identity);

#endif
