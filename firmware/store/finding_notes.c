/* What a user does with findings: see finding_notes.h. */
#include "firmware/store/finding_notes.h"

#include <sqlite3.h>
#include <stddef.h>

#include "firmware/base/text.h"
#include "firmware/store/database.h"

enum { PATIENCE_MS = 5000 };

/* Only the recorder writes the log back, so that it recognises its file. */
static tl_status open_beside_recorder(const char *path, sqlite3 **database, tl_error *error) {
    tl_status status = tl_database_open(path, true, database, error);
    if (status == TL_OK) {
        (void)sqlite3_busy_timeout(*database, PATIENCE_MS);
        (void)sqlite3_wal_autocheckpoint(*database, 0);
    }
    return status;
}

tl_status tl_finding_notes_acknowledge(const char *path, int64_t finding, const char *who, const char *note,
                                       tl_error *error) {
    static const char sql[] = "UPDATE findings SET acknowledged_at = ?2, acknowledged_by = ?3, note = ?4"
                              " WHERE finding = ?1";
    sqlite3 *database = NULL;
    sqlite3_stmt *statement = NULL;
    char now[TL_UTC_TEXT];
    tl_utc_text(tl_utc_now(), now);
    tl_status status = open_beside_recorder(path, &database, error);
    status = status == TL_OK ? tl_database_prepare(database, sql, &statement, error) : status;
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, finding);
        (void)sqlite3_bind_text(statement, 2, now, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(statement, 3, who, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(statement, 4, note, -1, SQLITE_STATIC);
        int code = sqlite3_step(statement);
        status = code == SQLITE_DONE ? TL_OK : tl_database_fail(database, code, error);
    }
    if (status == TL_OK && sqlite3_changes(database) == 0) {
        status = tl_fail(error, TL_BAD_DATA, "%s: contains no finding %lld: `twinlock show` lists them", path,
                         (long long)finding);
    }
    (void)sqlite3_finalize(statement);
    (void)sqlite3_close(database);
    return status;
}

tl_status tl_finding_notes_forget(const char *path, tl_error *error) {
    sqlite3 *database = NULL;
    tl_status status = open_beside_recorder(path, &database, error);
    if (status == TL_OK) {
        status = tl_database_execute(database,
                                     "BEGIN IMMEDIATE;"
                                     " INSERT OR REPLACE INTO learned (id, run, at, state, learnt_s, needed_s,"
                                     " watched_s, sha256, bytes) VALUES (1, 0, '', 'removed', 0, 0, 0, '', x'');"
                                     " UPDATE findings SET state = 'normal' WHERE state = 'open'; COMMIT",
                                     error);
    }
    (void)sqlite3_close(database);
    return status;
}
