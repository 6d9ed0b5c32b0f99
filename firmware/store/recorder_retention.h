/* Retention: keeps a database, its write-ahead log included, within a size on disk.
 *
 * Purpose: before each batch, remove the oldest until the batch fits; after each commit, keep the log short.
 * Order:   the oldest runs first, from their oldest tick on, each in small transactions so that the writer keeps up; then
 *          the oldest ticks of the run that is being written. Its row, configuration and signals stay; its events too,
 *          unless they alone break the bound: then all but the newest TL_RETENTION_EVENTS go.
 * Room:    the file may fill the bound but for four times the log's limit: the log itself, a batch in it, one
 *          retention step in it, and a reserve.
 * Errors:  SQLite result codes.
 * Thread:  the connection's.
 */
#ifndef TL_FIRMWARE_STORE_RECORDER_RETENTION_H
#define TL_FIRMWARE_STORE_RECORDER_RETENTION_H

#include <sqlite3.h>
#include <stddef.h>
#include <stdint.h>

enum {
    TL_RETENTION_LEAST_BYTES = 1000000, /* smallest bound */
    TL_RETENTION_EVENTS = 1000
};

typedef struct tl_recorder_retention {
    sqlite3 *database;
    int64_t run;            /* being written; 0: none yet */
    int64_t max_bytes;      /* 0: no bound */
    int64_t log_limit;      /* bytes of the log after which it is written back */
    int log_frames;         /* pages in the log after the last commit */
    unsigned writings_back; /* of the log into the file, so far */
    int64_t page_size;
    sqlite3_stmt *page_count;
    sqlite3_stmt *free_count;
} tl_recorder_retention;

/* Bytes of the log after which it is written back. */
size_t tl_recorder_retention_log(int64_t max_bytes);

/* `max_bytes` is 0 or at least TL_RETENTION_LEAST_BYTES. */
int tl_recorder_retention_open(tl_recorder_retention *retention, sqlite3 *database, int64_t max_bytes);

void tl_recorder_retention_close(tl_recorder_retention *retention);

/* Bytes of ring that one batch may hold so that the promise holds. */
size_t tl_recorder_retention_batch(const tl_recorder_retention *retention);

/* Between transactions: room for a batch of `bytes`. SQLITE_BUSY where a reader keeps the log from being written back
 * and another batch would break the bound. */
int tl_recorder_retention_make_room(tl_recorder_retention *retention, size_t bytes);

/* After a commit: writes the log back when it is long enough. */
int tl_recorder_retention_tidy(tl_recorder_retention *retention);

#endif
