/* The account of restarts: see restarts.h. */
#include "firmware/live/restarts.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"

enum { FILE_BYTES = 4096, TRIES_COUNTED = 1000 };

/* ---- the file ---- */

/* What the supervisor before this one left. */
typedef struct kept {
    uint64_t starts, restarts, failures;
    bool running; /* it did not end in order */
    uint64_t unreadable, tries;
    char boot[TL_IDENTITY_TEXT];
} kept;

static bool understand(const char *text, size_t size, kept *before) {
    tl_json_reader reader = tl_json_reader_of(text, size);
    before->starts = tl_json_count(&reader, "starts");
    before->restarts = tl_json_count(&reader, "restarts");
    before->failures = tl_json_count(&reader, "failures");
    before->running = tl_json_truth(&reader, "running");
    (void)snprintf(before->boot, sizeof before->boot, "%s", tl_json_text(&reader, "boot"));
    if (tl_json_has(&reader, "unreadable")) { /* as text: a number in JSON holds 53 bits only */
        before->unreadable = strtoull(tl_json_text(&reader, "unreadable"), NULL, 16);
    }
    if (tl_json_has(&reader, "tries")) {
        before->tries = tl_json_count(&reader, "tries");
    }
    bool right = reader.right;
    tl_json_reader_free(&reader);
    return right;
}

/* False where there is none, or none that can be understood. */
static bool read_kept(const char *path, kept *before) {
    char text[FILE_BYTES];
    FILE *file = fopen(path, "r");
    *before = (kept){0};
    if (file == NULL) {
        return false;
    }
    size_t size = fread(text, 1, FILE_BYTES, file);
    (void)fclose(file);
    bool right = understand(text, size, before);
    if (!right) {
        tl_log(TL_LOG_WARNING, "%s: is damaged; restarts are counted anew", path);
        *before = (kept){0};
    }
    return right;
}

/* The same length always, so that one can be written over another. */
enum { ACCOUNT_BYTES = 256 };

static int write_account(const tl_restarts *restarts, bool running, char text[ACCOUNT_BYTES + 1]) {
    int length = snprintf(text, ACCOUNT_BYTES + 1,
                          "{\"starts\": %" PRIu64 ", \"restarts\": %" PRIu64
                          ", \"failures\": %u, \"running\": %s, \"boot\": \"%s\", \"unreadable\": \"%" PRIx64
                          "\", \"tries\": %u}",
                          restarts->starts, restarts->restarts, restarts->failures, running ? "true" : "false",
                          restarts->boot, restarts->unreadable, restarts->tries);
    memset(text + length, ' ', (size_t)(ACCOUNT_BYTES - 1 - length));
    text[ACCOUNT_BYTES - 1] = '\n';
    return ACCOUNT_BYTES;
}

/* On a full disk: over the bytes that are there, which takes no room. Not whole if the power fails just now, so it is for an end only. */
static bool write_over(const tl_restarts *restarts, bool running) {
    char text[ACCOUNT_BYTES + 1];
    int length = write_account(restarts, running, text);
    int file = open(restarts->path, O_WRONLY | O_CLOEXEC | O_NOFOLLOW);
    bool is_written = file >= 0 && write(file, text, (size_t)length) == length && fdatasync(file) == 0;
    if (file >= 0) {
        (void)close(file);
    }
    return is_written;
}

static tl_status write_file(const tl_restarts *restarts, bool running, tl_error *error) {
    tl_new_file file;
    tl_status status = tl_new_file_open(restarts->path, &file, error);
    if (status != TL_OK) {
        return status;
    }
    char text[ACCOUNT_BYTES + 1];
    int length = write_account(restarts, running, text);
    (void)fwrite(text, 1, (size_t)length, file.file);
    return tl_new_file_keep(&file, error);
}

/* A full disk does not keep anybody from going on; it is told once. */
static void keep(tl_restarts *restarts, bool running) {
    tl_error error;
    if (restarts->path[0] == '\0') {
        return;
    }
    bool failed = write_file(restarts, running, &error) != TL_OK;
    failed = failed && (running || !write_over(restarts, running));
    if (failed && !restarts->unwritten) {
        tl_log(TL_LOG_WARNING, "restarts are not kept: %s", error.text);
    }
    restarts->unwritten = failed;
}

/* ---- the account ---- */

/* A disk that can only be read, as after a fault of it, keeps no twin from its plant. */
static bool is_read_only(const char *folder) {
    bool is = access(folder, W_OK | X_OK) != 0 && errno == EROFS;
    if (is) {
        tl_log(TL_LOG_ERROR,
               "--state %.300s: the file system can only be read: restarts are not kept, and no change is taken",
               folder);
    }
    return is;
}

static tl_status set_folder(const char *folder, tl_restarts *restarts, tl_error *error) {
    struct stat about;
    if (mkdir(folder, 0755) != 0 && errno != EEXIST) {
        return tl_fail(error, TL_BAD_DATA, "--state %.300s: cannot be made: %s", folder, strerror(errno));
    }
    if (stat(folder, &about) != 0 || !S_ISDIR(about.st_mode) ||
        (access(folder, W_OK | X_OK) != 0 && !is_read_only(folder))) {
        return tl_fail(error, TL_BAD_DATA, "--state %.300s: expected a folder that this user may write into", folder);
    }
    restarts->lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (restarts->lock >= 0 && flock(restarts->lock, LOCK_EX | LOCK_NB) != 0) {
        tl_restarts_close(restarts);
        return tl_fail(error, TL_TRY_AGAIN,
                       "--state %.300s: another supervisor has it: give each twin a folder of its own", folder);
    }
    int length = snprintf(restarts->path, sizeof restarts->path, "%s/supervisor.json", folder);
    return length < (int)sizeof restarts->path ? TL_OK
                                               : tl_fail(error, TL_BAD_DATA, "--state %.100s…: is too long", folder);
}

tl_status tl_restarts_open(const char *folder, bool watchdog, tl_restarts *restarts, tl_error *error) {
    kept before;
    *restarts = (tl_restarts){.reason = "it was told to", .lock = -1};
    tl_identity_boot(restarts->boot);
    if (folder == NULL) {
        return TL_OK;
    }
    tl_status status = set_folder(folder, restarts, error);
    if (status == TL_OK && read_kept(restarts->path, &before)) {
        restarts->starts = before.starts;
        restarts->restarts = before.restarts;
        restarts->unreadable = before.unreadable;
        restarts->failures = (unsigned)(before.failures < TL_RESTARTS_MOST ? before.failures : TL_RESTARTS_MOST);
        restarts->tries = (unsigned)(before.tries < TRIES_COUNTED ? before.tries : TRIES_COUNTED);
        restarts->interrupted = before.running;
        if (before.running) {
            bool is_same_boot = restarts->boot[0] != '\0' && strcmp(restarts->boot, before.boot) == 0;
            tl_restarts_excuse(restarts, is_same_boot ? "the supervisor was killed"
                                         : watchdog   ? "the box was reset by its watchdog"
                                                      : "the box was reset, or lost its power");
        }
    }
    return status;
}

void tl_restarts_begin(tl_restarts *restarts, bool again) {
    restarts->starts++;
    restarts->restarts += again ? 1 : 0;
    restarts->healthy = 0;
    keep(restarts, true);
}

void tl_restarts_undo(tl_restarts *restarts, bool again) {
    restarts->starts--;
    restarts->restarts -= again ? 1 : 0;
}

void tl_restarts_excuse(tl_restarts *restarts, const char *reason) {
    (void)snprintf(restarts->reason, sizeof restarts->reason, "%s", reason);
}

void tl_restarts_fail(tl_restarts *restarts, const char *reason) {
    restarts->failures += restarts->failures < TL_RESTARTS_MOST ? 1 : 0;
    tl_restarts_excuse(restarts, reason);
}

void tl_restarts_note_unreadable(tl_restarts *restarts, uint64_t files) {
    restarts->unreadable = files != 0 ? files : restarts->unreadable;
}

void tl_restarts_live(tl_restarts *restarts, tl_time passed) {
    restarts->healthy += passed;
    if (restarts->healthy >= TL_RESTARTS_FORGIVEN) {
        restarts->healthy = 0;
        if (restarts->failures > 0 || restarts->tries > 0) {
            restarts->failures -= restarts->failures > 0 ? 1 : 0;
            restarts->tries = restarts->failures == 0 ? 0 : restarts->tries;
            keep(restarts, true);
        }
    }
}

bool tl_restarts_is_loop(const tl_restarts *restarts) {
    return restarts->failures >= TL_RESTARTS_MOST;
}

void tl_restarts_retry(tl_restarts *restarts) {
    restarts->tries += restarts->tries < TRIES_COUNTED ? 1 : 0;
}

tl_time tl_restarts_hold_time(const tl_restarts *restarts, tl_time first) {
    tl_time time = first;
    for (unsigned i = 0; i < restarts->tries && time < TL_RESTARTS_HOLD_MOST; i++) {
        time *= 2;
    }
    return time < TL_RESTARTS_HOLD_MOST ? time : TL_RESTARTS_HOLD_MOST;
}

void tl_restarts_end(tl_restarts *restarts) {
    restarts->failures = 0;
    restarts->tries = 0;
    keep(restarts, false);
}

void tl_restarts_close(tl_restarts *restarts) {
    if (restarts->lock >= 0) {
        (void)close(restarts->lock);
        restarts->lock = -1;
    }
}
