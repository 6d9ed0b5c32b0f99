/* The versions: see versions.h. */
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

#include "firmware/base/json_text.h"
#include "firmware/base/log.h"
#include "firmware/retune/versions_parts.h"

enum { LONGEST_NAME = 128 }; /* in the folder, with what a new file adds to it */

static const uint64_t LAST_NUMBER = 999999999999999; /* of TL_VERSION_DIGITS */

/* ---- the list ---- */

static tl_version *find(const tl_versions *versions, uint64_t number) {
    for (size_t i = 0; i < versions->count; i++) {
        if (versions->list[i].number == number) {
            return &versions->list[i];
        }
    }
    return NULL;
}

const tl_version *tl_versions_get(const tl_versions *versions, uint64_t number) {
    return find(versions, number);
}

static bool is_commissioned(const tl_version *version) {
    bool is_good = version->result == TL_VERSION_KEPT || version->result == TL_VERSION_ACTIVE;
    bool is_limited = version->origin == TL_VERSION_BY_NETWORK || version->origin == TL_VERSION_BY_LIMITED;
    return is_good && (!is_limited || version->right >= TL_CHANGE_BY_COMMISSION);
}

const tl_version *tl_versions_commissioned(const tl_versions *versions) {
    size_t i = versions->count;
    while (i > 0 && !is_commissioned(&versions->list[i - 1])) {
        i--;
    }
    return i == 0 ? NULL : &versions->list[i - 1];
}

/* Room for one more. */
static bool grow(tl_versions *versions) {
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

static bool has_text(const tl_versions *versions, const char *hash) {
    for (size_t i = 0; i < versions->count; i++) {
        if (strcmp(versions->list[i].hash, hash) == 0) {
            return true;
        }
    }
    return false;
}

/* ---- opening ---- */

/* So that the folder itself survives a power cut. Not every file system can. */
static void keep_folder(const char *path) {
    int folder = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder >= 0) {
        (void)fsync(folder);
        (void)close(folder);
    }
}

static tl_status make_folder(const char *state, tl_versions *versions, tl_error *error) {
    struct stat about;
    int length = snprintf(versions->folder, sizeof versions->folder, "%s/versions", state);
    if (length + LONGEST_NAME >= (int)sizeof versions->folder) {
        return tl_fail(error, TL_BAD_DATA, "the folder of versions, %.100s…: its name is too long", state);
    }
    if (mkdir(versions->folder, 0750) == 0) {
        keep_folder(state);
    } else if (errno != EEXIST) {
        return tl_fail(error, TL_TRY_AGAIN, "the folder of versions, %.300s: cannot be made: %s", versions->folder,
                       strerror(errno));
    }
    if (stat(versions->folder, &about) != 0 || !S_ISDIR(about.st_mode) ||
        access(versions->folder, R_OK | W_OK | X_OK) != 0) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "the folder of versions, %.300s: expected a folder that this user may read and write",
                       versions->folder);
    }
    return TL_OK;
}

/* False where memory is out. */
static bool read_record(tl_versions *versions, uint64_t number, bool *damaged) {
    char path[PATH_MAX];
    tl_version version;
    versions->newest = number > versions->newest ? number : versions->newest;
    if (!tl_version_read_record(versions, number, &version)) {
        tl_version_record_path(versions, number, path);
        tl_log(TL_LOG_WARNING, "%s: is damaged: version %" PRIu64 " cannot be brought back", path, number);
        *damaged = true;
        return true;
    }
    if (!grow(versions)) {
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

/* Reads the records, and removes what a power cut left unfinished. */
static tl_status read_records(tl_versions *versions, bool *damaged, tl_error *error) {
    char path[PATH_MAX + NAME_MAX + 2];
    char hash[TL_SHA256_TEXT];
    uint64_t number = 0;
    bool enough = true;
    DIR *folder = opendir(versions->folder);
    if (folder == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be read: %s", versions->folder, strerror(errno));
    }
    for (struct dirent *entry = readdir(folder); entry != NULL && enough; entry = readdir(folder)) {
        tl_version_file file = tl_version_file_of(entry->d_name, &number, hash);
        if (file == TL_VERSION_FILE_RECORD) {
            enough = read_record(versions, number, damaged);
        } else if (file == TL_VERSION_FILE_LEFT) {
            (void)snprintf(path, sizeof path, "%s/%s", versions->folder, entry->d_name);
            (void)unlink(path);
        }
    }
    (void)closedir(folder);
    if (!enough) {
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: not enough memory for its versions", versions->folder);
    }
    if (versions->count > 1) {
        qsort(versions->list, versions->count, sizeof *versions->list, by_number);
    }
    return TL_OK;
}

/* Texts that no version has: a power cut was faster than the record. */
static void remove_orphans(const tl_versions *versions) {
    char path[PATH_MAX];
    char hash[TL_SHA256_TEXT];
    uint64_t number = 0;
    DIR *folder = opendir(versions->folder);
    for (struct dirent *entry = folder != NULL ? readdir(folder) : NULL; entry != NULL; entry = readdir(folder)) {
        if (tl_version_file_of(entry->d_name, &number, hash) == TL_VERSION_FILE_TEXT && !has_text(versions, hash)) {
            tl_version_text_path(versions, hash, path);
            (void)unlink(path);
        }
    }
    if (folder != NULL) {
        (void)closedir(folder);
    }
}

/* Says what came of a version. If that cannot be written, the next one that opens the folder does it: it is in active.json too. */
static void set_result(tl_versions *versions, uint64_t number, tl_version_result result, const char *reason) {
    tl_error error;
    tl_version *version = find(versions, number);
    if (version == NULL || (version->result == result && strcmp(version->reason, reason) == 0)) {
        return;
    }
    version->result = result;
    (void)snprintf(version->reason, sizeof version->reason, "%s", reason);
    if (tl_version_write_record(versions, version, &error) != TL_OK) {
        tl_log(TL_LOG_WARNING, "what came of version %" PRIu64 " is not kept: %s", number, error.text);
    }
}

/* What active.json says holds. */
static void mend(tl_versions *versions) {
    if (versions->settled != 0) {
        set_result(versions, versions->settled, versions->how, versions->because);
    }
    for (size_t i = 0; i < versions->count; i++) {
        const tl_version *version = &versions->list[i];
        bool is_active = version->number == versions->active;
        if (is_active && versions->probation.version != 0) {
            set_result(versions, version->number, TL_VERSION_PROBATION, "");
        } else if (is_active && version->result != TL_VERSION_KEPT && version->result != TL_VERSION_ACTIVE) {
            set_result(versions, version->number, TL_VERSION_ACTIVE, "");
        } else if (!is_active && version->result == TL_VERSION_PROBATION) {
            set_result(versions, version->number, TL_VERSION_RETURNED, "it is not known why");
        }
    }
}

static bool is_of_file(const tl_version *version) {
    return version->origin == TL_VERSION_BY_START || version->origin == TL_VERSION_BY_RELOAD;
}

/* The newest that was good, if nobody knows which one was active; and the newest of the file on the box. */
static void guess_active(tl_versions *versions) {
    for (size_t i = 0; i < versions->count; i++) {
        const tl_version *version = &versions->list[i];
        if (version->result == TL_VERSION_KEPT || version->result == TL_VERSION_ACTIVE) {
            versions->active = version->number;
        }
        if (is_of_file(version)) {
            memcpy(versions->taken, version->hash, sizeof versions->taken);
        }
    }
    tl_log(TL_LOG_WARNING,
           "%s/active.json: is damaged; of the versions that are known to be good, the newest is number %" PRIu64,
           versions->folder, versions->active);
}

tl_status tl_versions_open(const char *state, tl_versions *versions, tl_error *error) {
    bool damaged = false;
    *versions = (tl_versions){.count = 0};
    tl_status status = make_folder(state, versions, error);
    if (status == TL_OK) {
        status = read_records(versions, &damaged, error);
    }
    if (status != TL_OK) {
        tl_versions_close(versions);
        return status;
    }
    if (tl_version_read_active(versions) == TL_VERSION_DAMAGED) {
        guess_active(versions);
    }
    versions->newest = versions->active > versions->newest ? versions->active : versions->newest;
    versions->newest = versions->settled > versions->newest ? versions->settled : versions->newest;
    if (!damaged) {
        remove_orphans(versions);
    }
    mend(versions);
    return TL_OK;
}

void tl_versions_close(tl_versions *versions) {
    free(versions->list);
    *versions = (tl_versions){.count = 0};
}

/* ---- room ---- */

static bool is_needed(const tl_versions *versions, size_t index) {
    uint64_t number = versions->list[index].number;
    const tl_version *active = tl_versions_get(versions, versions->active);
    const tl_version *commissioned = tl_versions_commissioned(versions);
    return index == 0 || index + 1 == versions->count || number == versions->active ||
           number == versions->probation.return_to || (commissioned != NULL && number == commissioned->number) ||
           (active != NULL && number == active->parent);
}

/* Its record first: a text without one is removed when the folder is opened. */
static void remove_version(tl_versions *versions, size_t index) {
    char path[PATH_MAX];
    char hash[TL_SHA256_TEXT];
    memcpy(hash, versions->list[index].hash, sizeof hash);
    tl_version_record_path(versions, versions->list[index].number, path);
    (void)unlink(path);
    versions->count--;
    memmove(&versions->list[index], &versions->list[index + 1], (versions->count - index) * sizeof *versions->list);
    if (!has_text(versions, hash)) {
        tl_version_text_path(versions, hash, path);
        (void)unlink(path);
    }
}

static uint64_t bytes_of(const tl_versions *versions) {
    uint64_t bytes = 0;
    for (size_t i = 0; i < versions->count; i++) {
        bytes += versions->list[i].size;
    }
    return bytes;
}

static void make_room(tl_versions *versions) {
    size_t index = 0;
    while (index < versions->count && (versions->count > TL_VERSIONS_MOST || bytes_of(versions) > TL_VERSIONS_BYTES)) {
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

static tl_version version_of(const tl_versions *versions, const tl_version_news *news) {
    tl_version version = {
        .number = versions->newest + 1,
        .parent = versions->active,
        .size = news->size,
        .origin = news->origin,
        .right = news->right,
        .kind = news->kind,
        .result = TL_VERSION_CANDIDATE,
        .boottime_ms = since_boot_ms(),
    };
    tl_sha256(news->text, news->size, version.hash);
    tl_text_for_people(news->who, version.who, sizeof version.who);
    tl_text_for_people(news->why, version.why, sizeof version.why);
    tl_utc_text(tl_utc_now(), version.at);
    tl_identity_boot(version.boot);
    return version;
}

tl_status tl_versions_add(tl_versions *versions, const tl_version_news *news, uint64_t *number, tl_error *error) {
    char path[PATH_MAX];
    bool made = false;
    if (news->size > TL_VERSIONS_BYTES || !grow(versions)) {
        return tl_fail(error, TL_TRY_AGAIN, "the configuration is not kept: not enough memory for its %zu bytes",
                       news->size);
    }
    if (versions->newest >= LAST_NUMBER) {
        return tl_fail(error, TL_BAD_DATA,
                       "%.300s: there is a record with the last number that a version can have: remove it",
                       versions->folder);
    }
    const tl_version version = version_of(versions, news);
    tl_status status = tl_version_write_text(versions, version.hash, news->text, news->size, &made, error);
    if (status == TL_OK) {
        status = tl_version_write_record(versions, &version, error);
    }
    if (status != TL_OK) {
        if (made && !has_text(versions, version.hash)) {
            tl_version_text_path(versions, version.hash, path);
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

static tl_status absent(uint64_t number, tl_error *error) {
    return tl_fail(error, TL_BAD_DATA, "there is no version %" PRIu64, number);
}

/* The file on the box is taken, whatever comes of it: it is not tried again unless it is changed. An old version that is brought back is not what
 * the file is now. */
static void take(tl_versions *versions, const tl_version *version) {
    if (is_of_file(version) && version->result == TL_VERSION_CANDIDATE) {
        memcpy(versions->taken, version->hash, sizeof versions->taken);
    }
}

/* What came of a version, told with active.json: both at once, or neither. A reason may be a stranger's, or cut within a character. */
static void note(tl_versions *versions, uint64_t number, tl_version_result result, const char *reason) {
    versions->settled = number;
    versions->how = result;
    tl_text_for_people(reason, versions->because, sizeof versions->because);
}

static void end_probation(tl_versions *versions, tl_version_result result, const char *reason) {
    note(versions, versions->probation.version, result, reason);
    versions->probation = (tl_version_probation){.version = 0};
}

tl_status tl_version_put(tl_versions *versions, const tl_versions *next, tl_error *error) {
    tl_status status = tl_version_write_active(next, error);
    if (status == TL_OK) {
        *versions = *next;
        mend(versions);
    }
    return status;
}

tl_status tl_versions_refuse(tl_versions *versions, uint64_t number, const char *reason, tl_error *error) {
    tl_versions next = *versions;
    const tl_version *version = tl_versions_get(versions, number);
    if (version == NULL) {
        return absent(number, error);
    }
    if (number == versions->active) {
        return tl_fail(error, TL_BAD_DATA, "version %" PRIu64 " is active: it can be returned from, not refused",
                       number);
    }
    take(&next, version);
    note(&next, number, TL_VERSION_REFUSED, reason);
    return tl_version_put(versions, &next, error);
}

/* What is returned to if the next one is no good: what a probation that is under way would have returned to. */
static uint64_t last_good(const tl_versions *versions) {
    return versions->probation.version != 0 ? versions->probation.return_to : versions->active;
}

tl_status tl_versions_activate(tl_versions *versions, uint64_t number, const tl_probation_account *account,
                               tl_error *error) {
    tl_versions next = *versions;
    const tl_version *version = tl_versions_get(versions, number);
    uint64_t return_to = last_good(versions);
    char reason[TL_VERSION_WHY];
    if (version == NULL) {
        return absent(number, error);
    }
    if (versions->settled == number) {
        note(&next, 0, TL_VERSION_CANDIDATE, ""); /* another life of it begins */
    }
    if (versions->probation.version != 0 && versions->probation.version != number) {
        (void)snprintf(reason, sizeof reason, "version %" PRIu64 " took its place", number);
        end_probation(&next, TL_VERSION_RETURNED, reason);
    }
    next.active = number;
    next.probation = (tl_version_probation){.version = 0};
    if (account != NULL && return_to != 0 && return_to != number) {
        next.probation = (tl_version_probation){number, return_to, *account};
    }
    take(&next, version);
    return tl_version_put(versions, &next, error);
}

static tl_status need_probation(const tl_versions *versions, tl_error *error) {
    return versions->probation.version != 0 ? TL_OK : tl_fail(error, TL_BAD_DATA, "no version is on probation");
}

tl_status tl_versions_pass(tl_versions *versions, const tl_probation_account *account, tl_error *error) {
    tl_versions next = *versions;
    tl_status status = need_probation(versions, error);
    next.probation.account = *account;
    return status == TL_OK ? tl_version_put(versions, &next, error) : status;
}

tl_status tl_versions_keep(tl_versions *versions, const char *reason, tl_error *error) {
    tl_versions next = *versions;
    tl_status status = need_probation(versions, error);
    end_probation(&next, TL_VERSION_KEPT, reason);
    return status == TL_OK ? tl_version_put(versions, &next, error) : status;
}

tl_status tl_versions_return(tl_versions *versions, const char *reason, tl_error *error) {
    tl_versions next = *versions;
    tl_status status = need_probation(versions, error);
    next.active = versions->probation.return_to;
    end_probation(&next, TL_VERSION_RETURNED, reason);
    return status == TL_OK ? tl_version_put(versions, &next, error) : status;
}
