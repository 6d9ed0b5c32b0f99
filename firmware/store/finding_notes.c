/* Notes on findings: see finding_notes.h. */
#include "firmware/store/finding_notes.h"

#include <sqlite3.h>
#include <stdbool.h>
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

/* Fails if the finding does not exist, or (`accepts`) cannot be accepted as normal. */
static tl_status check_finding(sqlite3 *database, const char *path, int64_t finding, bool accepts, tl_error *error) {
    sqlite3_stmt *row = NULL;
    tl_status status = tl_database_prepare(
        database, "SELECT kind = 'freeze', state = 'normal' FROM findings WHERE finding = ?1", &row, error);
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_int64(row, 1, finding);
    int code = sqlite3_step(row);
    if (code != SQLITE_ROW && code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    } else if (code == SQLITE_DONE) {
        status = tl_fail(error, TL_BAD_DATA, "%s: contains no finding %lld: `twinlock show` lists them", path,
                         (long long)finding);
    } else if (accepts && sqlite3_column_int(row, 0) != 0) {
        status = tl_fail(error, TL_BAD_DATA, "%s: finding %lld is a frozen signal, which has no level", path,
                         (long long)finding);
    } else if (accepts && sqlite3_column_int(row, 1) != 0) {
        status = tl_fail(error, TL_BAD_DATA, "%s: finding %lld is normal already", path, (long long)finding);
    }
    (void)sqlite3_finalize(row);
    return status;
}

/* Writes the row of a finding: ?2 is the present time, then `values`. */
static tl_status update_finding(const char *path, int64_t finding, bool accepts, const char *sql,
                                const char *const values[2], tl_error *error) {
    sqlite3 *database = NULL;
    sqlite3_stmt *statement = NULL;
    char now[TL_UTC_TEXT];
    tl_utc_text(tl_utc_now(), now);
    tl_status status = open_beside_recorder(path, &database, error);
    status = status == TL_OK ? check_finding(database, path, finding, accepts, error) : status;
    status = status == TL_OK ? tl_database_prepare(database, sql, &statement, error) : status;
    if (status == TL_OK) {
        (void)sqlite3_bind_int64(statement, 1, finding);
        (void)sqlite3_bind_text(statement, 2, now, -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(statement, 3, values[0], -1, SQLITE_STATIC);
        (void)sqlite3_bind_text(statement, 4, values[1], -1, SQLITE_STATIC);
        int code = sqlite3_step(statement);
        status = code == SQLITE_DONE ? TL_OK : tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    (void)sqlite3_close(database);
    return status;
}

#define ACKNOWLEDGE "UPDATE findings SET acknowledged_at = ?2, acknowledged_by = ?3, note = ?4"

tl_status tl_finding_notes_write(const char *path, int64_t finding, const char *who, const char *note, bool accepts,
                                 tl_error *error) {
    const char *sql = accepts ? ACKNOWLEDGE ", state = 'normal' WHERE finding = ?1" : ACKNOWLEDGE " WHERE finding = ?1";
    return update_finding(path, finding, accepts, sql, (const char *const[2]){who, note}, error);
}

tl_status tl_finding_notes_explain(const char *path, int64_t finding, const char *text, tl_error *error) {
    return update_finding(path, finding, false,
                          "UPDATE findings SET explained_at = ?2, explanation = ?3 WHERE finding = ?1",
                          (const char *const[2]){text, NULL}, error);
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
