/* The files of the versions: see versions_parts.h. */
#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/file_bytes.h"
#include "firmware/base/json_reader.h"
#include "firmware/base/json_writer.h"
#include "firmware/base/new_file.h"
#include "firmware/retune/versions_parts.h"

enum { SMALL_FILE = 16 * 1024, HASH = TL_SHA256_TEXT - 1, LOCK_KEY = 32, YARDSTICK = 64 * TL_MAX_MATCH };

/* ---- names ---- */

static bool is_hash(const char *text) {
    return strspn(text, "0123456789abcdef") == HASH;
}

tl_version_file tl_version_file_of(const char *name, uint64_t *number, char hash[TL_SHA256_TEXT]) {
    size_t digits = strspn(name, "0123456789");
    if (strstr(name, ".json.new-") != NULL) {
        return TL_VERSION_FILE_LEFT;
    }
    if (digits > 0 && digits <= TL_VERSION_DIGITS && name[0] != '0' && strcmp(name + digits, ".record.json") == 0) {
        *number = strtoull(name, NULL, 10);
        return TL_VERSION_FILE_RECORD;
    }
    if (is_hash(name) && strcmp(name + HASH, ".json") == 0) {
        (void)snprintf(hash, TL_SHA256_TEXT, "%s", name);
        return TL_VERSION_FILE_TEXT;
    }
    return TL_VERSION_FILE_FOREIGN;
}

/* There is room: tl_versions_open() has seen to it. */
static void path_of(const tl_versions *versions, const char *name, const char *end, char path[PATH_MAX]) {
    int length = snprintf(path, PATH_MAX, "%s/%s%s", versions->folder, name, end);
    path[length < PATH_MAX ? length : 0] = '\0';
}

void tl_version_record_path(const tl_versions *versions, uint64_t number, char path[PATH_MAX]) {
    char name[24];
    (void)snprintf(name, sizeof name, "%" PRIu64, number);
    path_of(versions, name, ".record.json", path);
}

void tl_version_text_path(const tl_versions *versions, const char *hash, char path[PATH_MAX]) {
    path_of(versions, hash, ".json", path);
}

/* ---- words ---- */

static const char *const origins[TL_VERSION_ORIGINS] = {[TL_VERSION_BY_START] = "start",
                                                        [TL_VERSION_BY_RELOAD] = "reload",
                                                        [TL_VERSION_BY_LIMITED] = "limited",
                                                        [TL_VERSION_BY_NETWORK] = "network",
                                                        [TL_VERSION_BY_HAND] = "hand"};
static const char *const results[TL_VERSION_RESULTS] = {
    [TL_VERSION_CANDIDATE] = "candidate", [TL_VERSION_ACTIVE] = "active",     [TL_VERSION_PROBATION] = "probation",
    [TL_VERSION_KEPT] = "kept",           [TL_VERSION_RETURNED] = "returned", [TL_VERSION_REFUSED] = "refused"};

const char *tl_version_origin_name(tl_version_origin origin) {
    return origins[origin];
}

const char *tl_version_result_name(tl_version_result result) {
    return results[result];
}

static const char *right_name(size_t right) {
    return tl_change_right_name((tl_change_right)right);
}

static const char *kind_name(size_t kind) {
    return tl_change_kind_name((tl_change_kind)kind);
}

static const char *origin_name(size_t origin) {
    return origins[origin];
}

static const char *result_name(size_t result) {
    return results[result];
}

/* Which of `count` names the member is; none: 0, and the reader is not right any more. */
static size_t read_word(tl_json_reader *reader, const char *key, const char *(*name)(size_t), size_t count) {
    const char *word = tl_json_text(reader, key);
    for (size_t i = 0; i < count; i++) {
        if (strcmp(name(i), word) == 0) {
            return i;
        }
    }
    reader->right = false;
    return 0;
}

static void read_text(tl_json_reader *reader, const char *key, char *text, size_t size) {
    (void)snprintf(text, size, "%s", tl_json_text(reader, key));
}

/* ---- small files ---- */

tl_status tl_version_write_object(const char *path, const tl_json_writer *writer, tl_error *error) {
    tl_new_file file;
    tl_status status = tl_new_file_open(path, &file, error);
    if (status != TL_OK) {
        return TL_TRY_AGAIN;
    }
    status = tl_json_writer_print(writer, file.file, error);
    if (status != TL_OK) {
        tl_new_file_discard(&file);
        return status;
    }
    return tl_new_file_keep(&file, error);
}

bool tl_version_read_object(const char *path, tl_json_reader *reader) {
    char text[SMALL_FILE];
    *reader = (tl_json_reader){NULL, false};
    FILE *file = fopen(path, "re");
    if (file == NULL) {
        return false;
    }
    size_t size = fread(text, 1, sizeof text, file);
    bool whole = ferror(file) == 0 && feof(file) != 0;
    (void)fclose(file);
    if (whole) {
        *reader = tl_json_reader_of(text, size);
    }
    return reader->right;
}

/* What a version takes beside its text: its record, and active.json. */
enum { BESIDE = 16 * 1024 };

tl_status tl_versions_check_room(const tl_versions *versions, size_t size, tl_error *error) {
    char path[PATH_MAX];
    tl_new_file file;
    path_of(versions, "room", ".json", path);
    if (tl_new_file_open(path, &file, error) != TL_OK) {
        return TL_TRY_AGAIN;
    }
    int code = posix_fallocate(fileno(file.file), 0, (off_t)(size + BESIDE));
    tl_new_file_discard(&file);
    return code == 0 ? TL_OK
                     : tl_fail(error, TL_TRY_AGAIN, "%.300s: a version of %zu bytes could not be kept: %s", path, size,
                               strerror(code));
}

/* ---- a record ---- */

tl_status tl_version_write_record(const tl_versions *versions, const tl_version *version, tl_error *error) {
    char path[PATH_MAX];
    tl_json_writer writer;
    tl_json_writer_begin(&writer);
    tl_json_add_count(&writer, "version", version->number);
    tl_json_add_count(&writer, "parent", version->parent);
    tl_json_add_text(&writer, "hash", version->hash);
    tl_json_add_count(&writer, "bytes", version->size);
    tl_json_add_text(&writer, "origin", origins[version->origin]);
    tl_json_add_text(&writer, "right", tl_change_right_name(version->right));
    tl_json_add_text(&writer, "kind", tl_change_kind_name(version->kind));
    tl_json_add_text(&writer, "result", results[version->result]);
    tl_json_add_text(&writer, "reason", version->reason);
    tl_json_add_text(&writer, "who", version->who);
    tl_json_add_text(&writer, "why", version->why);
    tl_json_add_text(&writer, "at", version->at);
    tl_json_add_text(&writer, "boot", version->boot);
    tl_json_add_count(&writer, "boottime_ms", version->boottime_ms);
    tl_version_record_path(versions, version->number, path);
    tl_status status = tl_version_write_object(path, &writer, error);
    tl_json_writer_free(&writer);
    return status;
}

static void understand_record(tl_json_reader *reader, tl_version *version) {
    *version = (tl_version){
        .number = tl_json_count(reader, "version"),
        .parent = tl_json_count(reader, "parent"),
        .size = tl_json_count(reader, "bytes"),
        .origin = (tl_version_origin)read_word(reader, "origin", origin_name, TL_VERSION_ORIGINS),
        .right = (tl_change_right)read_word(reader, "right", right_name, TL_CHANGE_RIGHTS),
        .kind = (tl_change_kind)read_word(reader, "kind", kind_name, TL_CHANGE_KINDS),
        .result = (tl_version_result)read_word(reader, "result", result_name, TL_VERSION_RESULTS),
        .boottime_ms = tl_json_count(reader, "boottime_ms"),
    };
    read_text(reader, "hash", version->hash, sizeof version->hash);
    read_text(reader, "reason", version->reason, sizeof version->reason);
    read_text(reader, "who", version->who, sizeof version->who);
    read_text(reader, "why", version->why, sizeof version->why);
    read_text(reader, "at", version->at, sizeof version->at);
    read_text(reader, "boot", version->boot, sizeof version->boot);
}

bool tl_version_read_record(const tl_versions *versions, uint64_t number, tl_version *version) {
    char path[PATH_MAX];
    tl_json_reader reader;
    tl_version_record_path(versions, number, path);
    bool right = tl_version_read_object(path, &reader);
    if (right) {
        understand_record(&reader, version);
        right = reader.right && version->number == number && version->parent < number && is_hash(version->hash) &&
                version->size <= TL_VERSIONS_BYTES;
    }
    tl_json_reader_free(&reader);
    return right;
}

/* ---- a text ---- */

tl_status tl_version_write_text(const tl_versions *versions, const char *hash, const char *text, size_t size,
                                bool *made, tl_error *error) {
    char path[PATH_MAX];
    tl_new_file file;
    char *there = tl_version_read_text(versions, hash, size, error);
    free(there);
    *made = there == NULL;
    if (there != NULL) {
        return TL_OK;
    }
    tl_version_text_path(versions, hash, path);
    if (tl_new_file_open(path, &file, error) != TL_OK) {
        return TL_TRY_AGAIN;
    }
    (void)fwrite(text, 1, size, file.file);
    return tl_new_file_keep(&file, error);
}

/* All of a file that has so many bytes, with a NUL behind them. */
static char *read_bytes(const char *path, size_t size) {
    int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    char *bytes = file >= 0 ? malloc(size + 1) : NULL;
    ssize_t got = bytes != NULL ? tl_file_bytes_read(file, bytes, size + 1) : -1;
    int cause = errno;
    if (file >= 0) {
        (void)close(file);
    }
    if (got < 0 || (size_t)got != size) {
        free(bytes);
        errno = got < 0 ? cause : 0;
        return NULL;
    }
    bytes[size] = '\0';
    return bytes;
}

char *tl_version_read_text(const tl_versions *versions, const char *hash, uint64_t size, tl_error *error) {
    char path[PATH_MAX];
    char found[TL_SHA256_TEXT] = "";
    tl_version_text_path(versions, hash, path);
    char *text = read_bytes(path, (size_t)size);
    if (text == NULL && errno != 0) {
        (void)tl_fail(error, TL_BAD_DATA, "%.300s: %s", path, strerror(errno));
        return NULL;
    }
    if (text != NULL) {
        tl_sha256(text, (size_t)size, found);
    }
    if (text == NULL || strcmp(found, hash) != 0) {
        (void)tl_fail(error, TL_BAD_DATA, "%.300s: is damaged: its bytes are not those that it is named after", path);
        free(text);
        return NULL;
    }
    return text;
}

/* ---- active.json ---- */

static void lock_key(const char *which, int state, char key[LOCK_KEY]) {
    (void)snprintf(key, LOCK_KEY, "%s_%s", which, tl_lock_state_name((tl_lock_state)state));
}

/* "1*0.5 2*1 ": tolerance and weight of each output, to the last bit; cut behind the last one that counts. */
static void write_yardstick(const tl_lock_yardstick *yardstick, char text[YARDSTICK]) {
    size_t length = 0;
    size_t count = TL_MAX_MATCH;
    while (count > 0 && !(yardstick->match[count - 1].weight > 0.0)) {
        count--;
    }
    text[0] = '\0';
    for (size_t i = 0; i < count; i++) {
        length += (size_t)snprintf(text + length, YARDSTICK - length, "%.17g*%.17g ", yardstick->match[i].tolerance,
                                   yardstick->match[i].weight);
    }
}

/* False: it is none. */
static bool understand_yardstick(const char *text, tl_lock_yardstick *yardstick) {
    char *at = NULL;
    memset(yardstick, 0, sizeof *yardstick);
    for (size_t i = 0; i < TL_MAX_MATCH && text[0] != '\0'; i++, text = at + 1) {
        struct tl_lock_measure *measure = &yardstick->match[i];
        measure->tolerance = strtod(text, &at);
        measure->weight = at[0] == '*' ? strtod(at + 1, &at) : -1.0;
        if (at[0] != ' ') {
            return false;
        }
    }
    return text[0] == '\0' && tl_lock_yardstick_is_sound(yardstick);
}

static void write_probation(tl_json_writer *writer, const tl_version_probation *probation) {
    const tl_probation_account *account = &probation->account;
    char key[LOCK_KEY];
    char yardstick[YARDSTICK];
    write_yardstick(&account->yardstick, yardstick);
    tl_json_add_count(writer, "probation", probation->version);
    tl_json_add_count(writer, "return_to", probation->return_to);
    tl_json_add_count(writer, "given_s", account->terms.given_s);
    tl_json_add_count(writer, "left_ms", account->left_ms);
    tl_json_add_number(writer, "require_lock", account->terms.require_lock);
    tl_json_add_truth(writer, "must_confirm", account->terms.must_confirm);
    tl_json_add_count(writer, "before_steps", account->before_steps);
    tl_json_add_count(writer, "before_misses", account->before_misses);
    tl_json_add_count(writer, "steps", account->steps);
    tl_json_add_count(writer, "misses", account->misses);
    tl_json_add_count(writer, "skipped", account->skipped);
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        lock_key("lock", i, key);
        tl_json_add_count(writer, key, account->lock[i]);
        lock_key("lock_before", i, key);
        tl_json_add_count(writer, key, account->lock_before[i]);
    }
    tl_json_add_text(writer, "yardstick", yardstick);
    tl_json_add_text(writer, "widened", account->widened);
}

tl_status tl_version_write_active(const tl_versions *versions, tl_error *error) {
    char path[PATH_MAX];
    tl_json_writer writer;
    tl_json_writer_begin(&writer);
    tl_json_add_count(&writer, "active", versions->active);
    tl_json_add_text(&writer, "taken", versions->taken);
    tl_json_add_count(&writer, "settled", versions->settled);
    tl_json_add_text(&writer, "settled_as", results[versions->how]);
    tl_json_add_text(&writer, "settled_because", versions->because);
    write_probation(&writer, &versions->probation);
    path_of(versions, "active", ".json", path);
    tl_status status = tl_version_write_object(path, &writer, error);
    tl_json_writer_free(&writer);
    return status;
}

/* An older program has not written it. */
static void understand_before(tl_json_reader *reader, tl_probation_account *account) {
    char key[LOCK_KEY];
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        lock_key("lock_before", i, key);
        account->lock_before[i] = tl_json_count(reader, key);
    }
    read_text(reader, "widened", account->widened, sizeof account->widened);
    reader->right = understand_yardstick(tl_json_text(reader, "yardstick"), &account->yardstick) && reader->right;
}

static void understand_probation(tl_json_reader *reader, tl_version_probation *probation) {
    tl_probation_account *account = &probation->account;
    char key[LOCK_KEY];
    uint64_t given = tl_json_count(reader, "given_s");
    *probation = (tl_version_probation){
        .version = tl_json_count(reader, "probation"),
        .return_to = tl_json_count(reader, "return_to"),
        .account = {.terms = {given < UINT32_MAX ? (uint32_t)given : UINT32_MAX, tl_json_number(reader, "require_lock"),
                              tl_json_truth(reader, "must_confirm")},
                    .before_steps = tl_json_count(reader, "before_steps"),
                    .before_misses = tl_json_count(reader, "before_misses"),
                    .left_ms = tl_json_count(reader, "left_ms"),
                    .steps = tl_json_count(reader, "steps"),
                    .misses = tl_json_count(reader, "misses"),
                    .skipped = tl_json_count(reader, "skipped")},
    };
    for (int i = 0; i < TL_LOCK_STATES; i++) {
        lock_key("lock", i, key);
        account->lock[i] = tl_json_count(reader, key);
    }
    if (tl_json_has(reader, "yardstick")) {
        understand_before(reader, account);
    }
}

/* One that this program may have given. */
static bool is_number(uint64_t number) {
    const uint64_t above = 1000000000000;
    return number < above;
}

static void understand_active(tl_json_reader *reader, tl_versions *versions) {
    versions->active = tl_json_count(reader, "active");
    versions->settled = tl_json_count(reader, "settled");
    versions->how = (tl_version_result)read_word(reader, "settled_as", result_name, TL_VERSION_RESULTS);
    read_text(reader, "settled_because", versions->because, sizeof versions->because);
    read_text(reader, "taken", versions->taken, sizeof versions->taken);
    understand_probation(reader, &versions->probation);
    reader->right = reader->right && (versions->taken[0] == '\0' || is_hash(versions->taken)) &&
                    is_number(versions->active) && is_number(versions->settled) &&
                    (versions->probation.version == 0 || versions->probation.version == versions->active);
}

tl_version_found tl_version_read_active(tl_versions *versions) {
    char path[PATH_MAX];
    tl_json_reader reader;
    tl_versions read = *versions;
    path_of(versions, "active", ".json", path);
    if (access(path, F_OK) != 0 && errno == ENOENT) {
        return TL_VERSION_NONE;
    }
    bool right = tl_version_read_object(path, &reader);
    if (right) {
        understand_active(&reader, &read);
        right = reader.right;
    }
    tl_json_reader_free(&reader);
    if (right) {
        *versions = read;
    }
    return right ? TL_VERSION_FOUND : TL_VERSION_DAMAGED;
}
