/* Versions on disk: see versions.h. */
#include "firmware/retune/versions.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"

/* ---- version files ---- */

enum {
    HASH = TL_SHA256_TEXT - 1,
    DIGITS = 15, /* most digits of a number */
    LOCK_KEY = 32,
    TOLERANCES = 64 * TL_MAX_MATCH,
    LONGEST_NAME = 128 /* in the folder, including the suffix of a temporary file */
};

static const uint64_t LAST_NUMBER = 999999999999999; /* with DIGITS digits */

/* ---- names ---- */

/* Kinds of files in the folder. */
typedef enum file_kind {
    FILE_FOREIGN,
    FILE_RECORD,   /* of a version; sets its number */
    FILE_TEXT,     /* of a version; sets its hash */
    FILE_TEMPORARY /* temporary file that a power cut left */
} file_kind;

static bool is_hash(const char *text) {
    return strspn(text, "0123456789abcdef") == HASH;
}

static file_kind kind_of(const char *name, uint64_t *number, char hash[TL_SHA256_TEXT]) {
    size_t digits = strspn(name, "0123456789");
    if (strstr(name, ".json.new-") != NULL) {
        return FILE_TEMPORARY;
    }
    if (digits > 0 && digits <= DIGITS && name[0] != '0' && strcmp(name + digits, ".record.json") == 0) {
        *number = strtoull(name, NULL, 10);
        return FILE_RECORD;
    }
    if (is_hash(name) && strcmp(name + HASH, ".json") == 0) {
        (void)snprintf(hash, TL_SHA256_TEXT, "%.*s", (int)HASH, name);
        return FILE_TEXT;
    }
    return FILE_FOREIGN;
}

/* tl_versions_open() has checked that the path fits. */
static void path_of(const tl_versions *versions, const char *name, char path[PATH_MAX]) {
    int length = snprintf(path, PATH_MAX, "%s/%s.json", versions->folder, name);
    path[length < PATH_MAX ? length : 0] = '\0';
}

static void record_path(const tl_versions *versions, uint64_t number, char path[PATH_MAX]) {
    char name[40];
    (void)snprintf(name, sizeof name, "%" PRIu64 ".record", number);
    path_of(versions, name, path);
}

/* ---- words ---- */

const char *const tl_version_results[TL_VERSION_RESULTS] = {
    [TL_VERSION_CANDIDATE] = "candidate", [TL_VERSION_ACTIVE] = "active",        [TL_VERSION_PROBATION] = "probation",
    [TL_VERSION_KEPT] = "kept",           [TL_VERSION_ROLLED_BACK] = "returned", [TL_VERSION_REFUSED] = "refused"};

/* ---- small files ---- */

/* Writes the members of a JSON file to `writer`, or reads them from `reader` if `writer` is NULL.
 */
typedef struct members {
    tl_json_writer *writer;
    tl_json_reader *reader;
} members;

static void exchange_count(const members *file, const char *key, uint64_t *count) {
    if (file->writer != NULL) {
        tl_json_add_count(file->writer, key, *count);
    } else {
        *count = tl_json_count(file->reader, key);
    }
}

static void exchange_text(const members *file, const char *key, char *text, size_t size) {
    if (file->writer != NULL) {
        tl_json_add_text(file->writer, key, text);
    } else {
        tl_text_for_people(tl_json_text(file->reader, key), text, size);
    }
}

/* Writes or reads one of `count` names. If the name that was read is unknown, sets reader->right to
 * false and returns 0. */
static size_t exchange_name(const members *file, const char *key, size_t code, const char *const names[],
                            size_t count) {
    if (file->writer != NULL) {
        tl_json_add_text(file->writer, key, names[code]);
        return code;
    }
    const char *text = tl_json_text(file->reader, key);
    for (size_t i = 0; i < count; i++) {
        if (strcmp(names[i], text) == 0) {
            return i;
        }
    }
    file->reader->right = false;
    return 0;
}

/* All members of a file, in their order. */
typedef void exchange_content(const members *file, void *content);

static tl_status write_content(const char *path, exchange_content *exchange, void *content, tl_error *error) {
    tl_json_writer writer;
    tl_json_writer_begin(&writer);
    exchange(&(members){.writer = &writer}, content);
    tl_status status = tl_json_file_write(&writer, path, error);
    tl_json_writer_free(&writer);
    return status;
}

/* Returns false if the file cannot be read, or if a member is missing or has the wrong type. */
static bool read_content(const char *path, exchange_content *exchange, void *content) {
    tl_json_reader reader = tl_json_file_read(path);
    exchange(&(members){.reader = &reader}, content);
    bool right = reader.right;
    tl_json_reader_free(&reader);
    return right;
}

/* Bytes of a version in addition to its text: its record, and active.json. */
enum { OVERHEAD = 16 * 1024 };

tl_status tl_versions_check_room(const tl_versions *versions, size_t size, tl_error *error) {
    char path[PATH_MAX];
    tl_new_file file;
    path_of(versions, "room", path);
    if (tl_new_file_open(path, &file, error) != TL_OK) {
        return TL_TRY_AGAIN;
    }
    int code = posix_fallocate(fileno(file.file), 0, (off_t)(size + OVERHEAD));
    tl_new_file_discard(&file);
    return code == 0 ? TL_OK
                     : tl_fail(error, TL_TRY_AGAIN, "%.300s: a version of %zu bytes cannot be saved: %s", path, size,
                               strerror(code));
}

/* ---- a record ---- */

static void exchange_record(const members *file, void *content) {
    tl_version *version = content;
    exchange_count(file, "version", &version->number);
    exchange_count(file, "parent", &version->parent);
    exchange_text(file, "hash", version->hash, sizeof version->hash);
    exchange_count(file, "bytes", &version->size);
    version->origin = (tl_change_origin)exchange_name(file, "origin", version->origin, tl_change_origins, TL_ORIGINS);
    version->right = (tl_change_right)exchange_name(file, "right", version->right, tl_change_rights, TL_RIGHTS);
    version->kind = (tl_change_kind)exchange_name(file, "kind", version->kind, tl_change_kinds, TL_CHANGE_KINDS);
    version->result =
        (tl_version_result)exchange_name(file, "result", version->result, tl_version_results, TL_VERSION_RESULTS);
    exchange_text(file, "reason", version->reason, sizeof version->reason);
    exchange_text(file, "who", version->who, sizeof version->who);
    exchange_text(file, "why", version->why, sizeof version->why);
    exchange_text(file, "at", version->at, sizeof version->at);
    exchange_text(file, "boot", version->boot, sizeof version->boot);
    exchange_count(file, "boottime_ms", &version->boottime_ms);
}

static tl_status write_record(const tl_versions *versions, const tl_version *version, tl_error *error) {
    char path[PATH_MAX];
    tl_version copy = *version;
    record_path(versions, version->number, path);
    return write_content(path, exchange_record, &copy, error);
}

/* ---- a text ---- */

/* Reads the text with this size and hash; the caller calls free(). Returns NULL and sets `error` if
 * it is missing or damaged. */
static char *read_version_text(const tl_versions *versions, const char *hash, uint64_t size, tl_error *error) {
    char path[PATH_MAX];
    char found[TL_SHA256_TEXT] = "";
    size_t got = 0;
    path_of(versions, hash, path);
    char *text = tl_file_text_take(open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK), (size_t)size, &got);
    if (text == NULL && errno != EFBIG) {
        (void)tl_fail(error, TL_BAD_DATA, "%.300s: %s", path, strerror(errno));
        return NULL;
    }
    if (text != NULL) {
        tl_sha256(text, got, found);
    }
    if (got != size || strcmp(found, hash) != 0) {
        (void)tl_fail(error, TL_BAD_DATA, "%.300s: damaged: its content does not have the hash that is its name", path);
        free(text);
        return NULL;
    }
    return text;
}

static tl_status write_version_text(const tl_versions *versions, const char *hash, const char *text, size_t size,
                                    tl_error *error) {
    char path[PATH_MAX];
    tl_new_file file;
    char *there = read_version_text(versions, hash, size, error);
    free(there);
    if (there != NULL) {
        return TL_OK;
    }
    path_of(versions, hash, path);
    if (tl_new_file_open(path, &file, error) != TL_OK) {
        return TL_TRY_AGAIN;
    }
    (void)fwrite(text, 1, size, file.file);
    return tl_new_file_keep(&file, error);
}

/* ---- active.json ---- */

/* Writes "1*0.5 2*1 ": tolerance and weight of each output, exactly, up to the last output with a
 * weight. */
static void write_tolerances(const tl_lock_tolerances *tolerances, char text[TOLERANCES]) {
    size_t length = 0;
    size_t count = TL_MAX_MATCH;
    while (count > 0 && !(tolerances->match[count - 1].weight > 0.0)) {
        count--;
    }
    text[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        length += (size_t)snprintf(text + length, TOLERANCES - length, "%.17g*%.17g ", tolerances->match[i].tolerance,
                                   tolerances->match[i].weight);
    }
}

/* Returns false if the text is invalid. */
static bool parse_tolerances(const char *text, tl_lock_tolerances *tolerances) {
    char *at = NULL;
    memset(tolerances, 0, sizeof *tolerances);
    for (size_t i = 0; i < TL_MAX_MATCH && text[0] != '\0'; i++, text = at + 1) {
        struct tl_lock_measure *measure = &tolerances->match[i];
        measure->tolerance = strtod(text, &at);
        measure->weight = at[0] == '*' ? strtod(at + 1, &at) : -1.0;
        if (at[0] != ' ') {
            return false;
        }
    }
    return text[0] == '\0' && tl_lock_tolerances_is_sound(tolerances);
}

static void exchange_tolerances(const members *file, tl_lock_tolerances *tolerances) {
    char text[TOLERANCES];
    if (file->writer != NULL) {
        write_tolerances(tolerances, text);
    }
    exchange_text(file, "yardstick", text, sizeof text);
    if (file->reader != NULL && !parse_tolerances(text, tolerances)) {
        file->reader->right = false;
    }
}

static void exchange_terms(const members *file, tl_probation_terms *terms) {
    uint64_t given = terms->given_s;
    exchange_count(file, "given_s", &given);
    terms->given_s = given < UINT32_MAX ? (uint32_t)given : UINT32_MAX;
    if (file->writer != NULL) {
        tl_json_add_number(file->writer, "require_lock", terms->require_lock);
        tl_json_add_truth(file->writer, "must_confirm", terms->must_confirm);
    } else {
        terms->require_lock = tl_json_number(file->reader, "require_lock");
        terms->must_confirm = tl_json_truth(file->reader, "must_confirm");
    }
}

static void exchange_locks(const members *file, const char *kind, uint64_t counts[TL_LOCK_STATES]) {
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        char key[LOCK_KEY];
        (void)snprintf(key, sizeof key, "%s_%s", kind, tl_lock_state_name((tl_lock_state)i));
        if (file->writer != NULL || tl_json_has(file->reader, key)) { /* an older release had other states */
            exchange_count(file, key, &counts[i]);
        }
    }
}

static void exchange_probation(const members *file, tl_version_probation *probation) {
    tl_probation_account *account = &probation->account;
    exchange_count(file, "probation", &probation->version);
    exchange_count(file, "return_to", &probation->return_to);
    exchange_terms(file, &account->terms);
    exchange_count(file, "left_ms", &account->left_ms);
    exchange_count(file, "before_steps", &account->before_steps);
    exchange_count(file, "before_misses", &account->before_misses);
    exchange_count(file, "steps", &account->steps);
    exchange_count(file, "misses", &account->misses);
    exchange_count(file, "skipped", &account->skipped);
    exchange_locks(file, "lock", account->lock.steps);
    if (file->reader != NULL &&
        !tl_json_has(file->reader, "yardstick")) { /* the file was written by an older release */
        return;
    }
    exchange_locks(file, "lock_before", account->lock_before.steps);
    exchange_tolerances(file, &account->tolerances);
    exchange_text(file, "widened", account->widened, sizeof account->widened);
}

static void exchange_active(const members *file, void *content) {
    tl_versions *versions = content;
    exchange_count(file, "active", &versions->active);
    exchange_text(file, "taken", versions->file_hash, sizeof versions->file_hash);
    exchange_count(file, "settled", &versions->result_version);
    versions->last_result = (tl_version_result)exchange_name(file, "settled_as", versions->last_result,
                                                             tl_version_results, TL_VERSION_RESULTS);
    exchange_text(file, "settled_because", versions->last_reason, sizeof versions->last_reason);
    exchange_probation(file, &versions->probation);
}

static tl_status write_active(const tl_versions *versions, tl_error *error) {
    char path[PATH_MAX];
    tl_versions copy = *versions;
    path_of(versions, "active", path);
    return write_content(path, exchange_active, &copy, error);
}

/* Checks that the numbers can come from this program. */
static bool is_active_sound(const tl_versions *versions) {
    const uint64_t above = 1000000000000;
    return (versions->file_hash[0] == '\0' || is_hash(versions->file_hash)) && versions->active < above &&
           versions->result_version < above &&
           (versions->probation.version == 0 || versions->probation.version == versions->active);
}

/* Returns false and leaves `versions` unchanged if the file is damaged. A missing file is not an
 * error. */
static bool read_active(tl_versions *versions) {
    char path[PATH_MAX];
    tl_versions found = *versions;
    path_of(versions, "active", path);
    if (access(path, F_OK) != 0 && errno == ENOENT) {
        return true;
    }
    bool right = read_content(path, exchange_active, &found) && is_active_sound(&found);
    if (right) {
        *versions = found;
    }
    return right;
}

/* ---- the list ---- */

const tl_version *tl_versions_get(const tl_versions *versions, uint64_t number) {
    for (size_t i = 0; i < versions->count; i++) {
        if (versions->list[i].number == number) {
            return &versions->list[i];
        }
    }
    return NULL;
}

const tl_version *tl_versions_active(const tl_versions *versions) {
    static const tl_version none = {.number = 0};
    const tl_version *active = tl_versions_get(versions, versions->active);
    return active != NULL ? active : &none;
}

const tl_version *tl_versions_of_hash(const tl_versions *versions, const char *hash) {
    for (size_t i = versions->count; i > 0; i--) {
        if (strcmp(versions->list[i - 1].hash, hash) == 0) {
            return &versions->list[i - 1];
        }
    }
    return NULL;
}

static bool was_good(const tl_version *version) {
    return version != NULL && (version->result == TL_VERSION_KEPT || version->result == TL_VERSION_ACTIVE);
}

const tl_version *tl_versions_commissioned(const tl_versions *versions) {
    for (size_t i = versions->count; i > 0; i--) {
        const tl_version *version = &versions->list[i - 1];
        bool is_limited = version->origin == TL_ORIGIN_NETWORK || version->origin == TL_ORIGIN_LIMITED;
        if (was_good(version) && (!is_limited || version->right >= TL_RIGHT_COMMISSION)) {
            return version;
        }
    }
    return NULL;
}

/* Reserves memory for one more version. Returns false if memory is out. */
static bool reserve_entry(tl_versions *versions) {
    if (versions->count < versions->room) {
        return true;
    }
    size_t room = versions->room + TL_VERSIONS_MOST + 1;
    tl_version *list = realloc(versions->list, room * sizeof *list);
    if (list != NULL) {
        versions->list = list;
        versions->room = room;
    }
    return list != NULL;
}

tl_status tl_versions_read(const tl_versions *versions, uint64_t number, char **text, tl_error *error) {
    tl_error cause;
    const tl_version *version = tl_versions_get(versions, number);
    *text = NULL;
    if (version == NULL) {
        return tl_fail(error, TL_BAD_DATA, "there is no version %" PRIu64, number);
    }
    *text = read_version_text(versions, version->hash, version->size, &cause);
    return *text != NULL ? TL_OK
                         : tl_fail(error, TL_BAD_DATA, "version %" PRIu64 " cannot be read: %s", number, cause.text);
}

tl_status tl_versions_repair(const tl_versions *versions, uint64_t number, const char *text, size_t size,
                             tl_error *error) {
    const tl_version *version = tl_versions_get(versions, number);
    char hash[TL_SHA256_TEXT];
    tl_sha256(text, size, hash);
    if (version == NULL || version->size != size || strcmp(version->hash, hash) != 0) {
        return tl_fail(error, TL_BAD_DATA, "the text is not that of version %" PRIu64, number);
    }
    return write_version_text(versions, hash, text, size, error);
}

/* ---- opening ---- */

static tl_status make_folder(const char *state, tl_versions *versions, tl_error *error) {
    int length = snprintf(versions->folder, sizeof versions->folder, "%s/versions", state);
    if (length + LONGEST_NAME >= (int)sizeof versions->folder) {
        return tl_fail(error, TL_BAD_DATA, "%.100s…: the path of the folder of versions is too long", state);
    }
    if (mkdir(versions->folder, 0750) == 0) {
        tl_folder_sync(versions->folder);
    } else if (errno != EEXIST) {
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: the folder of versions cannot be created: %s", versions->folder,
                       strerror(errno));
    }
    if (access(versions->folder, R_OK | W_OK | X_OK) != 0) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "%.300s: the folder of versions must be readable and writable for this user", versions->folder);
    }
    return TL_OK;
}

/* Returns false if memory is out. */
static bool read_record(tl_versions *versions, uint64_t number, bool *damaged) {
    char path[PATH_MAX];
    tl_version version = {.number = 0};
    record_path(versions, number, path);
    bool right = read_content(path, exchange_record, &version) && version.number == number && version.parent < number &&
                 is_hash(version.hash) && version.size <= TL_VERSIONS_BYTES && version.right >= TL_RIGHT_RETUNE;
    versions->newest = number > versions->newest ? number : versions->newest;
    if (!right) {
        tl_log(TL_LOG_WARNING, "%s: damaged: version %" PRIu64 " cannot be restored any more", path, number);
        *damaged = true;
        return true;
    }
    if (!reserve_entry(versions)) {
        return false;
    }
    versions->list[versions->count++] = version;
    return true;
}

static int by_number(const void *left, const void *right) {
    const tl_version *a = left;
    const tl_version *b = right;
    return (a->number > b->number) - (a->number < b->number);
}

/* Reads the records and removes temporary files that a power cut left. With `are_read`, removes
 * texts without a record: the power failed between both. */
static tl_status scan_folder(tl_versions *versions, bool are_read, bool *damaged, tl_error *error) {
    char path[PATH_MAX + NAME_MAX + 2];
    char hash[TL_SHA256_TEXT];
    uint64_t number = 0;
    bool has_memory = true;
    DIR *folder = opendir(versions->folder);
    if (folder == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be read: %s", versions->folder, strerror(errno));
    }
    for (struct dirent *entry = readdir(folder); entry != NULL && has_memory; entry = readdir(folder)) {
        file_kind kind = kind_of(entry->d_name, &number, hash);
        if (kind == FILE_RECORD && !are_read) {
            has_memory = read_record(versions, number, damaged);
        } else if (kind == FILE_TEMPORARY ||
                   (kind == FILE_TEXT && are_read && tl_versions_of_hash(versions, hash) == NULL)) {
            (void)snprintf(path, sizeof path, "%s/%s", versions->folder, entry->d_name);
            (void)unlink(path);
        }
    }
    (void)closedir(folder);
    return has_memory ? TL_OK
                      : tl_fail(error, TL_TRY_AGAIN, "%.300s: not enough memory for its versions", versions->folder);
}

/* Writes a version's result to its record. If that fails, the next process that opens the folder
 * retries it, because active.json contains it too. */
static void set_result(const tl_versions *versions, tl_version *version, tl_version_result result, const char *reason) {
    tl_error error;
    if (version->result == result && strcmp(version->reason, reason) == 0) {
        return;
    }
    version->result = result;
    (void)snprintf(version->reason, sizeof version->reason, "%s", reason);
    if (write_record(versions, version, &error) != TL_OK) {
        tl_log(TL_LOG_WARNING, "version %" PRIu64 ": its result cannot be saved: %s", version->number, error.text);
    }
}

/* Corrects records that disagree with active.json. */
static void mend_records(const tl_versions *versions) {
    for (size_t i = 0; i < versions->count; i++) {
        tl_version *version = &versions->list[i];
        bool is_active = version->number == versions->active;
        if (version->number == versions->result_version) {
            set_result(versions, version, versions->last_result, versions->last_reason);
        }
        if (is_active && versions->probation.version != 0) {
            set_result(versions, version, TL_VERSION_PROBATION, "");
        } else if (is_active && !was_good(version)) {
            set_result(versions, version, TL_VERSION_ACTIVE, "");
        } else if (!is_active && version->result == TL_VERSION_PROBATION) {
            set_result(versions, version, TL_VERSION_ROLLED_BACK, "reason not known");
        }
    }
}

static bool is_of_file(const tl_version *version) {
    return version->origin == TL_ORIGIN_START || version->origin == TL_ORIGIN_RELOAD;
}

/* If active.json is damaged: the newest version that was kept is active, and the newest version of
 * the configuration file was read last. */
static void guess_active(tl_versions *versions) {
    for (size_t i = 0; i < versions->count; i++) {
        const tl_version *version = &versions->list[i];
        if (was_good(version)) {
            versions->active = version->number;
        }
        if (is_of_file(version)) {
            memcpy(versions->file_hash, version->hash, sizeof versions->file_hash);
        }
    }
    tl_log(TL_LOG_WARNING, "%s/active.json: damaged; the newest good version becomes active: %" PRIu64,
           versions->folder, versions->active);
}

tl_status tl_versions_open(const char *state, tl_versions *versions, tl_error *error) {
    bool damaged = false;
    *versions = (tl_versions){.count = 0};
    tl_status status = make_folder(state, versions, error);
    if (status == TL_OK) {
        status = scan_folder(versions, false, &damaged, error);
    }
    if (status != TL_OK) {
        tl_versions_close(versions);
        return status;
    }
    if (versions->count > 1) {
        qsort(versions->list, versions->count, sizeof *versions->list, by_number);
    }
    if (!read_active(versions)) {
        guess_active(versions);
    }
    versions->newest = versions->active > versions->newest ? versions->active : versions->newest;
    versions->newest = versions->result_version > versions->newest ? versions->result_version : versions->newest;
    if (!damaged) {
        tl_error ignored;
        (void)scan_folder(versions, true, &damaged, &ignored);
    }
    mend_records(versions);
    return TL_OK;
}

void tl_versions_close(tl_versions *versions) {
    free(versions->list);
    *versions = (tl_versions){.count = 0};
}

/* ---- room ---- */

static bool is_needed(const tl_versions *versions, size_t index) {
    uint64_t number = versions->list[index].number;
    const tl_version *commissioned = tl_versions_commissioned(versions);
    return index == 0 || index + 1 == versions->count || number == versions->active ||
           number == versions->probation.return_to || (commissioned != NULL && number == commissioned->number) ||
           number == tl_versions_active(versions)->parent;
}

/* The record first: a text without a record is removed when the folder is opened. */
static void remove_version(tl_versions *versions, size_t index) {
    char path[PATH_MAX];
    char hash[TL_SHA256_TEXT];
    memcpy(hash, versions->list[index].hash, sizeof hash);
    record_path(versions, versions->list[index].number, path);
    (void)unlink(path);
    versions->count--;
    memmove(&versions->list[index], &versions->list[index + 1], (versions->count - index) * sizeof *versions->list);
    if (tl_versions_of_hash(versions, hash) == NULL) {
        path_of(versions, hash, path);
        (void)unlink(path);
    }
}

static uint64_t count_bytes(const tl_versions *versions) {
    uint64_t bytes = 0;
    for (size_t i = 0; i < versions->count; i++) {
        bytes += versions->list[i].size;
    }
    return bytes;
}

static void make_room(tl_versions *versions) {
    size_t index = 0;
    while (index < versions->count &&
           (versions->count > TL_VERSIONS_MOST || count_bytes(versions) > TL_VERSIONS_BYTES)) {
        if (is_needed(versions, index)) {
            index++;
        } else {
            remove_version(versions, index);
        }
    }
}

/* ---- a new one ---- */

static uint64_t since_boot_ms(void) {
    struct timespec now = {0, 0};
    (void)clock_gettime(CLOCK_BOOTTIME, &now);
    return 1000 * (uint64_t)now.tv_sec + (uint64_t)now.tv_nsec / 1000000;
}

static tl_version new_version(const tl_versions *versions, const tl_version_candidate *candidate) {
    tl_version version = {
        .number = versions->newest + 1,
        .parent = versions->active,
        .size = candidate->size,
        .origin = candidate->origin,
        .right = candidate->right,
        .kind = candidate->kind,
        .result = TL_VERSION_CANDIDATE,
        .boottime_ms = since_boot_ms(),
    };
    tl_sha256(candidate->text, candidate->size, version.hash);
    tl_text_for_people(candidate->who, version.who, sizeof version.who);
    tl_text_for_people(candidate->why, version.why, sizeof version.why);
    tl_utc_text(tl_utc_now(), version.at);
    tl_identity_boot(version.boot);
    return version;
}

tl_status tl_versions_add(tl_versions *versions, const tl_version_candidate *candidate, uint64_t *number,
                          tl_error *error) {
    char path[PATH_MAX];
    if (candidate->size > TL_VERSIONS_BYTES || !reserve_entry(versions)) {
        return tl_fail(error, TL_TRY_AGAIN, "the configuration cannot be saved: not enough memory for %zu bytes",
                       candidate->size);
    }
    if (versions->newest >= LAST_NUMBER) {
        return tl_fail(error, TL_BAD_DATA, "%.300s: a record has the largest possible number: remove this record",
                       versions->folder);
    }
    const tl_version version = new_version(versions, candidate);
    path_of(versions, version.hash, path);
    bool is_new = access(path, F_OK) != 0; /* else it may belong to a damaged record */
    tl_status status = write_version_text(versions, version.hash, candidate->text, candidate->size, error);
    if (status == TL_OK) {
        status = write_record(versions, &version, error);
    }
    if (status != TL_OK) {
        if (is_new && tl_versions_of_hash(versions, version.hash) == NULL) {
            (void)unlink(path);
        }
        return status;
    }
    versions->list[versions->count++] = version;
    versions->newest = version.number;
    *number = version.number;
    make_room(versions);
    return TL_OK;
}

/* ---- which one is active ---- */

#define NO_PROBATION "no version is on probation"

/* The configuration file counts as read, whatever its result. It is tried again only if it changes.
 * An older version that becomes active again does not count, because the file has other contents
 * now. */
static void mark_as_read(tl_versions *versions, uint64_t number) {
    const tl_version *version = tl_versions_get(versions, number);
    if (version != NULL && is_of_file(version) && version->result == TL_VERSION_CANDIDATE) {
        memcpy(versions->file_hash, version->hash, sizeof versions->file_hash);
    }
}

/* Saves a version's result in active.json, so that both change together. The reason may come from
 * an untrusted client, or be truncated within a character. */
static void note_result(tl_versions *versions, uint64_t number, tl_version_result result, const char *reason) {
    versions->result_version = number;
    versions->last_result = result;
    tl_text_for_people(reason, versions->last_reason, sizeof versions->last_reason);
}

/* Replaces the state on disk first. If the disk rejects it, nothing changes. */
static tl_status save_state(tl_versions *versions, const tl_versions *next, tl_error *error) {
    tl_status status = write_active(next, error);
    if (status == TL_OK) {
        *versions = *next;
        mend_records(versions);
    }
    return status;
}

tl_status tl_versions_refuse(tl_versions *versions, uint64_t number, const char *reason, tl_error *error) {
    tl_versions next = *versions;
    mark_as_read(&next, number);
    note_result(&next, number, TL_VERSION_REFUSED, reason);
    return save_state(versions, &next, error);
}

tl_status tl_versions_activate(tl_versions *versions, uint64_t number, const tl_probation_account *account,
                               tl_error *error) {
    tl_versions next = *versions;
    /* a rollback has the same target as the probation in progress */
    uint64_t return_to = versions->probation.version != 0 ? versions->probation.return_to : versions->active;
    char reason[TL_VERSION_WHY];
    if (versions->result_version == number) {
        note_result(&next, 0, TL_VERSION_CANDIDATE, ""); /* its previous result no longer counts */
    }
    if (versions->probation.version != 0 && versions->probation.version != number) {
        (void)snprintf(reason, sizeof reason, "replaced by version %" PRIu64, number);
        note_result(&next, versions->probation.version, TL_VERSION_ROLLED_BACK, reason);
    }
    next.active = number;
    next.probation = (tl_version_probation){.version = 0};
    if (account != NULL && return_to != 0 && return_to != number) {
        next.probation = (tl_version_probation){number, return_to, *account};
    }
    mark_as_read(&next, number);
    return save_state(versions, &next, error);
}

tl_status tl_versions_save_probation(tl_versions *versions, const tl_probation_account *account, tl_error *error) {
    tl_versions next = *versions;
    next.probation.account = *account;
    return versions->probation.version != 0 ? save_state(versions, &next, error)
                                            : tl_fail(error, TL_BAD_DATA, NO_PROBATION);
}

tl_status tl_versions_end_probation(tl_versions *versions, tl_version_result result, const char *reason,
                                    tl_error *error) {
    tl_versions next = *versions;
    note_result(&next, versions->probation.version, result, reason);
    next.active = result == TL_VERSION_ROLLED_BACK ? versions->probation.return_to : versions->active;
    next.probation = (tl_version_probation){.version = 0};
    return versions->probation.version != 0 ? save_state(versions, &next, error)
                                            : tl_fail(error, TL_BAD_DATA, NO_PROBATION);
}

/* ---- choosing ---- */

/* The file is the active version, so it counts as read. Its text is rewritten if it is damaged on
 * disk. */
static void choose_same(tl_versions *versions, const char *file, size_t size) {
    tl_error error;
    tl_versions next = *versions;
    const tl_version *active = tl_versions_active(versions);
    memcpy(next.file_hash, active->hash, sizeof next.file_hash);
    if (write_version_text(versions, active->hash, file, size, &error) != TL_OK ||
        (strcmp(versions->file_hash, next.file_hash) != 0 && save_state(versions, &next, &error) != TL_OK)) {
        tl_log(TL_LOG_WARNING, "%s", error.text);
    }
}

/* Returns the parent, or else the newest older version that was kept; 0: none. */
static uint64_t good_before(const tl_versions *versions, uint64_t number) {
    const tl_version *version = tl_versions_get(versions, number);
    uint64_t best = 0;
    if (version != NULL && was_good(tl_versions_get(versions, version->parent))) {
        return version->parent;
    }
    for (size_t i = 0; i < versions->count && versions->list[i].number < number; i++) {
        best = was_good(&versions->list[i]) ? versions->list[i].number : best;
    }
    return best;
}

/* Selects the active version, or the next older one that can be read. Returns false if there is
 * none. */
static bool choose_version(tl_versions *versions, tl_version_choice *choice) {
    tl_error error;
    uint64_t number = versions->active;
    while (number != 0 && tl_versions_read(versions, number, &choice->text, &error) != TL_OK) {
        tl_log(TL_LOG_WARNING, "%s", error.text);
        number = good_before(versions, number);
    }
    choice->number = number;
    if (number == 0) {
        return false;
    }
    choice->size = (size_t)tl_versions_get(versions, number)->size;
    if (number != versions->active) {
        tl_log(TL_LOG_WARNING, "version %" PRIu64 " is used instead", number);
        if (tl_versions_activate(versions, number, NULL, &error) != TL_OK) {
            tl_log(TL_LOG_WARNING, "%s", error.text);
        }
    }
    return true;
}

/* No version can be read: the file becomes the first version again. */
static void use_file(tl_versions *versions) {
    tl_versions next = *versions;
    tl_error error;
    next.active = 0;
    next.probation = (tl_version_probation){.version = 0};
    tl_log(TL_LOG_WARNING, "no version can be read: the configuration file is used instead");
    if (save_state(versions, &next, &error) != TL_OK) {
        tl_log(TL_LOG_WARNING, "%s", error.text);
    }
}

tl_status tl_versions_choose(tl_versions *versions, const char *file, size_t size, tl_version_choice *choice,
                             tl_error *error) {
    const tl_version *active = tl_versions_active(versions);
    char hash[TL_SHA256_TEXT] = "";
    *choice = (tl_version_choice){.size = size};
    if (file != NULL) {
        tl_sha256(file, size, hash);
    }
    if (file != NULL && strcmp(hash, active->hash) == 0) {
        choice->number = active->number;
        choose_same(versions, file, size);
        return TL_OK;
    }
    bool is_changed = file != NULL && versions->active != 0 && strcmp(hash, versions->file_hash) != 0;
    if (is_changed) {
        tl_log(TL_LOG_NOTICE, "the configuration file has changed since it was read last: validating it");
    }
    choice->is_candidate = is_changed || (file != NULL && versions->active == 0);
    if (choice->is_candidate || choose_version(versions, choice)) {
        return TL_OK;
    }
    if (file == NULL) {
        return tl_fail(error, TL_BAD_DATA,
                       "there is no configuration: neither its file nor a version of it can be read");
    }
    use_file(versions);
    choice->is_candidate = true;
    return TL_OK;
}

/* ---- refusals ---- */

static void refusal_path(const tl_refused_changes *refusals, uint64_t number, char path[PATH_MAX]) {
    int length =
        snprintf(path, PATH_MAX, "%s/refused-%u.json", refusals->folder, (unsigned)(number % TL_REFUSED_CHANGES_MOST));
    path[length < PATH_MAX ? length : 0] = '\0';
}

/* A refusal, with result and reason apart; clients read them as one text. */
typedef struct refusal_file {
    tl_control_version refusal;
    char result[16], reason[TL_VERSION_WHY];
} refusal_file;

static void exchange_refusal(const members *file, void *given) {
    refusal_file *content = given;
    tl_control_version *refusal = &content->refusal;
    exchange_count(file, "number", &refusal->version);
    exchange_text(file, "hash", refusal->hash, sizeof refusal->hash);
    exchange_text(file, "origin", refusal->origin, sizeof refusal->origin);
    exchange_text(file, "result", content->result, sizeof content->result);
    exchange_text(file, "reason", content->reason, sizeof content->reason);
    exchange_text(file, "who", refusal->who, sizeof refusal->who);
    exchange_text(file, "why", refusal->why, sizeof refusal->why);
    exchange_text(file, "at", refusal->at, sizeof refusal->at);
    (void)snprintf(refusal->result, sizeof refusal->result, "%s: %.*s", content->result,
                   (int)sizeof refusal->result - 24, content->reason);
}

static int refusal_by_number(const void *left, const void *right) {
    const tl_control_version *a = left;
    const tl_control_version *b = right;
    return (a->version > b->version) - (a->version < b->version);
}

void tl_refused_changes_open(tl_refused_changes *refusals, const tl_versions *versions) {
    *refusals = (tl_refused_changes){.count = 0};
    (void)snprintf(refusals->folder, sizeof refusals->folder, "%s", versions->folder);
    for (uint64_t i = 0; i < TL_REFUSED_CHANGES_MOST; i++) {
        char path[PATH_MAX];
        refusal_file content;
        memset(&content, 0, sizeof content);
        refusal_path(refusals, i, path);
        if (read_content(path, exchange_refusal, &content) && content.refusal.version % TL_REFUSED_CHANGES_MOST == i) {
            refusals->list[refusals->count++] = content.refusal;
        }
    }
    qsort(refusals->list, refusals->count, sizeof refusals->list[0], refusal_by_number);
}

tl_status tl_refused_changes_add(tl_refused_changes *refusals, const tl_control_request *request, const char *result,
                                 const char *reason, tl_error *error) {
    char path[PATH_MAX];
    refusal_file content;
    tl_control_version *list = refusals->list;
    tl_control_version *refusal = &content.refusal;
    memset(&content, 0, sizeof content);
    refusal->version = refusals->count == 0 ? 1 : list[refusals->count - 1].version + 1;
    memcpy(refusal->hash, request->hash, sizeof refusal->hash);
    (void)snprintf(refusal->origin, sizeof refusal->origin, "%s", tl_change_origins[request->origin]);
    (void)snprintf(content.result, sizeof content.result, "%s", result);
    tl_text_for_people(reason, content.reason, sizeof content.reason);
    tl_text_for_people(request->who, refusal->who, sizeof refusal->who);
    tl_text_for_people(request->why, refusal->why, sizeof refusal->why);
    tl_utc_text(tl_utc_now(), refusal->at);
    refusal_path(refusals, refusal->version, path);
    tl_status status = write_content(path, exchange_refusal, &content, error);
    if (refusals->count == TL_REFUSED_CHANGES_MOST) {
        memmove(&list[0], &list[1], (TL_REFUSED_CHANGES_MOST - 1) * sizeof list[0]);
        refusals->count--;
    }
    list[refusals->count++] = *refusal;
    return status;
}
