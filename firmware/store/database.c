/* SQLite: opening, building, verifying and closing a database; hostile content: see database.h. */
#include "firmware/store/database.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/store/database_schema.h"
#include "firmware/store/database_sql.h"

/* ---- database guard ---- */

/* A statement of ours takes some thousand turns of SQLite's machine, and one over a long run some million. */
enum { TURNS_AT_ONCE = 1000 * 1000, MOST_TIMES = 50 };

static __thread int times; /* that the turns of the statement under way were counted */

/* ---- What a statement may take ----------------------------------------------------------------------------------- */

static int begin_statement(unsigned event, void *context, void *statement, void *text) {
    (void)event;
    (void)context;
    (void)statement;
    (void)text;
    times = 0;
    return 0;
}

static int count_turns(void *context) {
    (void)context;
    return ++times > MOST_TIMES;
}

/* For a new connection, before the first SQL on it. A statement that is ended then fails with SQLITE_INTERRUPT. */
static void tl_database_guard(sqlite3 *database) {
    static const int off[] = {SQLITE_DBCONFIG_TRUSTED_SCHEMA, SQLITE_DBCONFIG_ENABLE_TRIGGER,
                              SQLITE_DBCONFIG_ENABLE_VIEW, SQLITE_DBCONFIG_ENABLE_LOAD_EXTENSION};
    static const struct {
        int what;
        int most;
    } limits[] = {
        {SQLITE_LIMIT_LENGTH, TL_DATABASE_LONGEST},
        {SQLITE_LIMIT_SQL_LENGTH, 64 * 1024},
        {SQLITE_LIMIT_COLUMN, 64},
        {SQLITE_LIMIT_EXPR_DEPTH, 64},
        {SQLITE_LIMIT_COMPOUND_SELECT, 4},
        {SQLITE_LIMIT_FUNCTION_ARG, 16},
        {SQLITE_LIMIT_ATTACHED, 0},
        {SQLITE_LIMIT_TRIGGER_DEPTH, 1},
        {SQLITE_LIMIT_VARIABLE_NUMBER, 64},
    };
    (void)sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, NULL);
    for (size_t i = 0; i < sizeof off / sizeof off[0]; i++) {
        (void)sqlite3_db_config(database, off[i], 0, NULL);
    }
    for (size_t i = 0; i < sizeof limits / sizeof limits[0]; i++) {
        (void)sqlite3_limit(database, limits[i].what, limits[i].most);
    }
    (void)sqlite3_trace_v2(database, SQLITE_TRACE_STMT, begin_statement, NULL);
    sqlite3_progress_handler(database, TURNS_AT_ONCE, count_turns, NULL);
}

/* ---- Damage ------------------------------------------------------------------------------------------------------ */

static bool is_small(sqlite3 *database) {
    sqlite3_file *file = NULL;
    sqlite3_int64 size = 0;
    return sqlite3_file_control(database, "main", SQLITE_FCNTL_FILE_POINTER, &file) == SQLITE_OK && file != NULL &&
           file->pMethods != NULL && file->pMethods->xFileSize(file, &size) == SQLITE_OK &&
           size <= TL_DATABASE_DIAGNOSED;
}

void tl_database_diagnose(sqlite3 *database, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    if (!is_small(database) ||
        sqlite3_prepare_v2(database, "PRAGMA quick_check(1)", -1, &statement, NULL) != SQLITE_OK) {
        return;
    }
    const char *found = sqlite3_step(statement) == SQLITE_ROW ? (const char *)sqlite3_column_text(statement, 0) : NULL;
    if (found != NULL && strcmp(found, "ok") != 0) {
        size_t length = strlen(error->text);
        (void)snprintf(error->text + length, sizeof error->text - length, " (SQLite finds: %.*s)",
                       (int)strcspn(found, "\n"), found);
    }
    (void)sqlite3_finalize(statement);
}

/* ---- The schema -------------------------------------------------------------------------------------------------- */

/* What the file would have SQLite run for it. */
static tl_status check_code(sqlite3 *database, tl_error *error) {
    static const char sql[] = "SELECT type, name FROM sqlite_schema"
                              " WHERE type = 'trigger' OR (type = 'table' AND rootpage IS NOT NULL AND rootpage < 1)";
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(database, sql, &statement, error);
    int code = status == TL_OK ? sqlite3_step(statement) : SQLITE_DONE;
    if (code == SQLITE_ROW) {
        status = tl_database_damaged(
            database, error, "it has the %s \"%.60s\", and twinlock makes none",
            strcmp((const char *)sqlite3_column_text(statement, 0), "trigger") == 0 ? "trigger" : "virtual table",
            (const char *)sqlite3_column_text(statement, 1));
    } else if (code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* Rows come in the order of the key without being sorted, so it must be the one we know. */
static tl_status check_key(sqlite3 *database, sqlite3_stmt *statement, const tl_database_key *key, tl_error *error) {
    char found[64] = "";
    int code = SQLITE_ROW;
    (void)sqlite3_bind_text(statement, 1, key->table, -1, SQLITE_STATIC);
    while ((code = sqlite3_step(statement)) == SQLITE_ROW) {
        size_t length = strlen(found);
        (void)snprintf(found + length, sizeof found - length, "%s%s", length == 0 ? "" : ", ",
                       (const char *)sqlite3_column_text(statement, 0));
    }
    (void)sqlite3_reset(statement);
    if (code != SQLITE_DONE) {
        return tl_database_fail(database, code, error);
    }
    return strcmp(found, key->columns) == 0
               ? TL_OK
               : tl_database_damaged(database, error, "its table %s has not the key that twinlock gives it",
                                     key->table);
}

/* Is it there at all? Not what is only called so, such as a view. */
static tl_status find_table(sqlite3 *database, const char *name, bool *found, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status =
        tl_database_prepare(database, "SELECT type = 'table' FROM sqlite_schema WHERE name = ?1", &statement, error);
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_bind_text(statement, 1, name, -1, SQLITE_STATIC);
    int code = sqlite3_step(statement);
    *found = code == SQLITE_ROW;
    if (code == SQLITE_ROW && sqlite3_column_int(statement, 0) != 1) {
        status = tl_database_damaged(database, error, "%s is no table", name);
    } else if (code != SQLITE_ROW && code != SQLITE_DONE) {
        status = tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* Are the tables what they are called? Tables that are not there yet are no damage; they are missed by who needs them.
 * Errors: TL_BAD_DATA for triggers, virtual tables, and tables of ours that are none or have another key. */
static tl_status tl_database_check_schema(sqlite3 *database, tl_error *error) {
    static const char sql[] = "SELECT name FROM pragma_table_xinfo(?1) WHERE pk > 0 ORDER BY pk";
    sqlite3_stmt *statement = NULL;
    tl_status status = check_code(database, error);
    if (status == TL_OK) {
        status = tl_database_prepare(database, sql, &statement, error);
    }
    for (const tl_database_key *key = tl_database_keys; status == TL_OK && key->table != NULL; key++) {
        bool there = false;
        status = find_table(database, key->table, &there, error);
        if (status == TL_OK && there) {
            status = check_key(database, statement, key, error);
        }
    }
    (void)sqlite3_finalize(statement);
    return status;
}

/* ---- Opening, making and recognising a twinlock database.
 *
 * Recognising: SQLite's header has 100 bytes at the front of the file: the magic text, and big-endian at byte 60
 *              user_version, at 68 application_id. They are read through SQLite's own file handle before any SQL runs,
 *              so no lock is taken, no journal is rolled back and no -wal file appears beside somebody else's file.
 *              (A file descriptor of our own would drop SQLite's POSIX locks when it is closed.)
 * Making:      under a name that nobody has, then renamed, so that a power cut leaves a whole database or none, and
 *              the header is always in the file itself, not in its write-ahead log. The renaming replaces nothing.
 * Formats:     only one is read. SQL reads user_version again: another program's may still be in the write-ahead log. */

enum { HEADER = 100, VERSION_AT = 60, APPLICATION_AT = 68, JOURNAL = sizeof "-journal" };

static uint32_t big_endian(const unsigned char *bytes) {
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | (uint32_t)bytes[3];
}

static tl_status check_version(const char *path, int64_t version, tl_error *error) {
    if (version == TL_DATABASE_VERSION) {
        return TL_OK;
    }
    return tl_database_refuse(
        TL_DATABASE_OTHER, error, TL_BAD_DATA,
        "%s: the database has format %lld (this program reads and writes format %d only): use the "
        "version of twinlock that wrote it, or move the file away",
        path, (long long)version, TL_DATABASE_VERSION);
}

static tl_status judge_header(const unsigned char header[HEADER], int64_t size, const char *path, tl_error *error) {
    bool is_sqlite = memcmp(header, "SQLite format 3", 16) == 0;
    bool is_ours = is_sqlite && big_endian(header + APPLICATION_AT) == TL_DATABASE_APPLICATION;
    if (size < HEADER && is_ours) {
        return tl_database_refuse(TL_DATABASE_DAMAGED, error, TL_BAD_DATA,
                                  "%s: is damaged: of its header there are only %lld bytes", path, (long long)size);
    }
    if (size < HEADER) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: is not a twinlock database: it has only %lld bytes", path, (long long)size);
    }
    if (!is_sqlite) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: is not a twinlock database, nor any SQLite database", path);
    }
    if (!is_ours) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: is a SQLite database of another program, not of twinlock", path);
    }
    return check_version(path, big_endian(header + VERSION_AT), error);
}

tl_status tl_database_recognise(sqlite3 *database, const char *path, tl_error *error) {
    sqlite3_file *file = NULL;
    sqlite3_int64 size = 0;
    unsigned char header[HEADER] = {0};
    int code = sqlite3_file_control(database, "main", SQLITE_FCNTL_FILE_POINTER, &file);
    if (code != SQLITE_OK || file == NULL || file->pMethods == NULL ||
        file->pMethods->xFileSize(file, &size) != SQLITE_OK) {
        return tl_database_refuse(TL_DATABASE_LATER, error, TL_TRY_AGAIN, "%s: cannot be read", path);
    }
    code = size == 0 ? SQLITE_OK : file->pMethods->xRead(file, header, HEADER, 0);
    if (code != SQLITE_OK && code != SQLITE_IOERR_SHORT_READ) { /* what is not there reads as zeros */
        return tl_database_refuse(TL_DATABASE_DENIED, error, TL_TRY_AGAIN, "%s: cannot be read (%s)", path,
                                  sqlite3_errstr(code));
    }
    return judge_header(header, size, path, error);
}

/* SQLite does not know the name of what it could not open. */
static tl_status open_connection(const char *name, int flags, sqlite3 **database, tl_error *error) {
    char why[TL_ERROR_TEXT];
    int code = sqlite3_open_v2(name, database, flags | SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE, NULL);
    if (code == SQLITE_OK) {
        tl_database_guard(*database);
        return TL_OK;
    }
    tl_database_text(*database, code, why, sizeof why);
    tl_status status = tl_fail(error, tl_database_fail(*database, code, NULL), "%s: %s", name, why);
    (void)sqlite3_close(*database);
    *database = NULL;
    return status;
}

/* "file:PATH?immutable=1", every byte that means something in a URI written as %XX. */
static char *immutable_uri(const char *path) {
    static const char plain[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~/";
    char *uri = malloc(strlen(path) * 3 + sizeof "file:?immutable=1");
    if (uri == NULL) {
        return NULL;
    }
    char *end = uri + sprintf(uri, "file:");
    for (const char *c = path; *c != '\0'; c++) {
        end += sprintf(end, strchr(plain, *c) != NULL ? "%c" : "%%%02X", (unsigned)(unsigned char)*c);
    }
    (void)sprintf(end, "?immutable=1");
    return uri;
}

/* A database on a read-only medium, without a -wal file: nothing can be missing and nothing can change. */
static tl_status open_immutable(const char *path, sqlite3 **database, tl_error *error) {
    char *uri = immutable_uri(path);
    if (uri == NULL) {
        return tl_database_refuse(TL_DATABASE_LATER, error, TL_TRY_AGAIN, "%s: out of memory", path);
    }
    tl_status status = open_connection(uri, SQLITE_OPEN_READONLY | SQLITE_OPEN_URI, database, error);
    free(uri);
    return status;
}

static bool has_wal(const char *path) {
    char name[PATH_MAX];
    struct stat status;
    int length = snprintf(name, sizeof name, "%s-wal", path);
    return length > 0 && length < PATH_MAX && stat(name, &status) == 0 && status.st_size > 0;
}

/* The first SQL: with -wal and -shm files where that is possible, without where it must and can be: not if it is to be written. */
static tl_status first_read(const char *path, bool write, sqlite3 **database, tl_error *error) {
    static const char question[] = "SELECT 1 FROM sqlite_schema LIMIT 1";
    int code = sqlite3_exec(*database, question, NULL, NULL, NULL);
    if (!write && ((code & 0xFF) == SQLITE_CANTOPEN || (code & 0xFF) == SQLITE_READONLY) && !has_wal(path)) {
        (void)sqlite3_close(*database);
        *database = NULL;
        tl_status status = open_immutable(path, database, error);
        if (status != TL_OK) {
            return status;
        }
        code = sqlite3_exec(*database, question, NULL, NULL, NULL);
    }
    return code == SQLITE_OK ? TL_OK : tl_database_fail(*database, code, error);
}

/* The format as SQL sees it. */
static tl_status check_current_version(sqlite3 *database, const char *path, tl_error *error) {
    sqlite3_stmt *statement = NULL;
    tl_status status = tl_database_prepare(database, "PRAGMA user_version", &statement, error);
    if (status == TL_OK) {
        int code = sqlite3_step(statement);
        status = code == SQLITE_ROW ? check_version(path, sqlite3_column_int64(statement, 0), error)
                                    : tl_database_fail(database, code, error);
    }
    (void)sqlite3_finalize(statement);
    return status;
}

tl_status tl_database_open(const char *path, bool write, sqlite3 **database, tl_error *error) {
    static const char both[] = "PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0; PRAGMA temp_store = MEMORY;";
    struct stat file;
    *database = NULL;
    if (stat(path, &file) != 0) {
        int number = errno;
        tl_status status = number == ENOENT || number == ENOTDIR ? TL_BAD_DATA : TL_TRY_AGAIN;
        const char *why = strerror(number);
        char other[TL_OTHER_CASE_TEXT];
        return tl_database_refuse(tl_database_fault_of_errno(number), error, status, "%s: %s%s", path, why,
                                  tl_other_case(path, other));
    }
    if (!S_ISREG(file.st_mode)) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA, "%s: is no ordinary file", path);
    }
    /* Readers too: the last one to close then removes -wal and -shm. SQLite falls back to reading where the file
     * or the medium permits no more. */
    tl_status status = open_connection(path, SQLITE_OPEN_READWRITE, database, error);
    if (status != TL_OK) {
        return status;
    }
    (void)sqlite3_busy_timeout(*database, 2000);
    status = tl_database_recognise(*database, path, error); /* before any SQL */
    if (status == TL_OK && write && sqlite3_db_readonly(*database, "main") == 1) {
        status = tl_database_refuse(TL_DATABASE_DENIED, error, TL_TRY_AGAIN,
                                    "%s: may not be written: check its permissions and its medium", path);
    }
    if (status == TL_OK) {
        status = first_read(path, write, database, error);
    }
    if (status == TL_OK) {
        status = tl_database_execute(*database, both, error);
    }
    if (status == TL_OK) {
        status = check_current_version(*database, path, error);
    }
    if (status == TL_OK) {
        status = tl_database_check_schema(*database, error);
    }
    if (status == TL_OK && !write) {
        status = tl_database_execute(*database, "PRAGMA query_only = ON", error);
    }
    if (status != TL_OK) {
        (void)sqlite3_close(*database);
        *database = NULL;
    }
    return status;
}

static tl_status execute_all(sqlite3 *database, const char *const *statements, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; statements[i] != NULL && status == TL_OK; i++) {
        status = tl_database_execute(database, statements[i], error);
    }
    return status;
}

static tl_status build(const char *name, tl_error *error) {
    char header[256];
    sqlite3 *database = NULL;
    (void)snprintf(header, sizeof header,
                   "PRAGMA auto_vacuum = INCREMENTAL; PRAGMA synchronous = FULL; PRAGMA temp_store = MEMORY; BEGIN;"
                   "PRAGMA application_id = %d; PRAGMA user_version = %d;",
                   TL_DATABASE_APPLICATION, TL_DATABASE_VERSION);
    tl_status status = open_connection(name, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, &database, error);
    if (status != TL_OK) {
        return status;
    }
    status = tl_database_execute(database, header, error);
    if (status == TL_OK) {
        status = execute_all(database, tl_database_schema, error);
    }
    if (status == TL_OK) {
        status = tl_database_execute(database, "COMMIT; PRAGMA journal_mode = WAL", error);
    }
    (void)sqlite3_close(database);
    if (status == TL_BAD_DATA) { /* what is not there yet cannot be bad */
        tl_database_set_fault(TL_DATABASE_LATER);
        status = TL_TRY_AGAIN;
    }
    return status;
}

/* What SQLite leaves beside a database, and how it begins: a log, its index, a journal that was not finished or was. */
typedef struct leftover {
    const char *end;
    size_t length;
    const char *starts[2];
} leftover;

static const leftover leftovers[] = {
    {"-wal", 4, {"\x37\x7f\x06\x82", "\x37\x7f\x06\x83"}},
    {"-shm", 4, {"\x18\xe2\x2d\x00", "\x00\x2d\xe2\x18"}},
    {"-journal", 8, {"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7", "\0\0\0\0\0\0\0\0"}},
};

/* Is it SQLite's, or empty, or not there? An empty one says nothing, and SQLite leaves such too. */
static bool may_be_removed(const char *name, const leftover *kind) {
    char start[8] = {0};
    struct stat file;
    if (lstat(name, &file) != 0) {
        return true;
    }
    int opened = S_ISREG(file.st_mode) ? open(name, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK) : -1;
    if (opened < 0) {
        return false;
    }
    ssize_t length = read(opened, start, kind->length);
    (void)close(opened);
    return length == 0 || ((size_t)length == kind->length && (memcmp(start, kind->starts[0], kind->length) == 0 ||
                                                              memcmp(start, kind->starts[1], kind->length) == 0));
}

/* The log of a database that was removed would be played into the new one. */
static tl_status remove_leftovers(const char *path, tl_error *error) {
    char names[sizeof leftovers / sizeof leftovers[0]][PATH_MAX];
    for (size_t i = 0; i < sizeof leftovers / sizeof leftovers[0]; i++) {
        if (snprintf(names[i], PATH_MAX, "%s%s", path, leftovers[i].end) >= PATH_MAX) {
            return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", path);
        }
        if (!may_be_removed(names[i], &leftovers[i])) {
            return tl_database_refuse(
                TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                "%s: cannot be made: %s is there and not SQLite's, which needs that name: move it away", path,
                names[i]);
        }
    }
    for (size_t i = 0; i < sizeof leftovers / sizeof leftovers[0]; i++) {
        (void)unlink(names[i]);
    }
    return TL_OK;
}

static void sync_folder(const char *path) {
    char copy[PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s", path);
    int folder = open(dirname(copy), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder >= 0) {
        (void)fsync(folder);
        (void)close(folder);
    }
}

/* An empty file beside `path` that nobody had before; its name goes to `name`. */
static tl_status take_name(const char *path, char name[PATH_MAX], tl_error *error) {
    for (int i = 0;; i++) {
        if (snprintf(name, PATH_MAX, "%s.new-%ld-%d", path, (long)getpid(), i) + JOURNAL >= PATH_MAX) {
            return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", path);
        }
        int file = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0640);
        if (file >= 0) {
            (void)close(file);
            return TL_OK;
        }
        if (errno != EEXIST) {
            return tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN, "%s: cannot be made: %s",
                                      path, strerror(errno));
        }
    }
}

static void remove_unfinished(const char *name) {
    char beside[PATH_MAX];
    for (size_t i = 0; i < sizeof leftovers / sizeof leftovers[0]; i++) {
        (void)snprintf(beside, sizeof beside, "%s%s", name, leftovers[i].end);
        (void)unlink(beside);
    }
    (void)unlink(name);
}

/* Gives what was built its name, unless there is something by now. A file system that cannot do both at once (NFS) can make a
 * second name. */
static bool put_in_place(const char *built, const char *path) {
    if (renameat2(AT_FDCWD, built, AT_FDCWD, path, RENAME_NOREPLACE) == 0) {
        return true;
    }
    return (errno == EINVAL || errno == ENOSYS) && link(built, path) == 0 && unlink(built) == 0;
}

tl_status tl_database_create(const char *path, tl_error *error) {
    char name[PATH_MAX];
    tl_status status = remove_leftovers(path, error);
    if (status == TL_OK) {
        status = take_name(path, name, error);
    }
    if (status != TL_OK) {
        return status;
    }
    status = build(name, error);
    if (status == TL_OK && !put_in_place(name, path)) {
        status = tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN, "%s: cannot be made: %s",
                                    path, strerror(errno));
    }
    if (status != TL_OK) {
        remove_unfinished(name);
        return status;
    }
    sync_folder(path);
    return TL_OK;
}

/* ---- Where it is ------------------------------------------------------------------------------------------------- */

/* Of a path at which there is nothing: is there a folder to make it in? */
static tl_status check_folder(const char *path, tl_error *error) {
    char copy[PATH_MAX];
    struct stat folder;
    if (snprintf(copy, sizeof copy, "%s", path) >= PATH_MAX) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_TRY_AGAIN, "%.200s…: the name is too long", path);
    }
    if (stat(dirname(copy), &folder) != 0) {
        return tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN,
                                  "%s: cannot be made: its folder: %s", path, strerror(errno));
    }
    return TL_OK;
}

/* The name that it will have once it is there: whoever looks for it then must find the same one. Its folder is there. */
static void place_new(const char *given, char path[PATH_MAX]) {
    char copy[PATH_MAX];
    char folder[PATH_MAX];
    const char *slash = strrchr(given, '/');
    const char *name = slash == NULL ? given : slash + 1;
    (void)snprintf(copy, sizeof copy, "%s", given);
    if (realpath(dirname(copy), folder) == NULL ||
        snprintf(path, PATH_MAX, "%s/%s", strcmp(folder, "/") == 0 ? "" : folder, name) >= PATH_MAX) {
        (void)snprintf(path, PATH_MAX, "%s", given);
    }
}

tl_status tl_database_place(const char *given, char path[PATH_MAX], tl_error *error) {
    struct stat file;
    if (given[0] == '\0') {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_USAGE,
                                  "the name of the database is empty: give a file, for example run.db");
    }
    if (realpath(given, path) != NULL) {
        bool regular = stat(path, &file) == 0 && S_ISREG(file.st_mode);
        return regular ? TL_OK
                       : tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                            "%s: is no ordinary file, and left as it is", given);
    }
    if (errno != ENOENT) {
        return tl_database_refuse(tl_database_fault_of_errno(errno), error, TL_TRY_AGAIN,
                                  "%.200s: cannot be opened: %s", given, strerror(errno));
    }
    if (lstat(given, &file) == 0) {
        return tl_database_refuse(TL_DATABASE_FOREIGN, error, TL_BAD_DATA,
                                  "%s: is a symbolic link to a file that is not there, and left as it is", given);
    }
    tl_status status = check_folder(given, error);
    path[0] = '\0';
    if (status == TL_OK) {
        place_new(given, path);
    }
    return status;
}
