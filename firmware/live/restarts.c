/* Restart record: see restarts.h. */
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

enum { TRIES_COUNTED = 1000 };

/* ---- the file ---- */

static unsigned at_most(uint64_t count, unsigned most) {
    return count < most ? (unsigned)count : most;
}

/* Loads the record of the previous supervisor; no change if there is no valid file. */
static void read_account(tl_restarts *restarts, bool watchdog) {
    tl_json_reader reader = tl_json_file_read(restarts->path);
    tl_restarts kept = *restarts;
    kept.starts = tl_json_count(&reader, "starts");
    kept.restarts = tl_json_count(&reader, "restarts");
    kept.failures = at_most(tl_json_count(&reader, "failures"), TL_RESTARTS_MOST);
    if (tl_json_has(&reader, "tries")) { /* older versions do not write these two */
        kept.tries = at_most(tl_json_count(&reader, "tries"), TRIES_COUNTED);
    }
    if (tl_json_has(&reader, "unreadable")) { /* as text, because a JSON number has only 53 bits */
        kept.unreadable = strtoull(tl_json_text(&reader, "unreadable"), NULL, 16);
    }
    kept.interrupted = tl_json_truth(&reader, "running");
    bool is_same_boot = kept.boot[0] != '\0' && strcmp(kept.boot, tl_json_text(&reader, "boot")) == 0;
    if (kept.interrupted) {
        tl_restarts_excuse(&kept, is_same_boot ? "the supervisor was killed"
                                  : watchdog   ? "the box was reset by its watchdog"
                                               : "the box was reset, or lost its power");
    }
    if (reader.right) {
        *restarts = kept;
    } else if (access(restarts->path, F_OK) == 0) {
        tl_log(TL_LOG_WARNING, "%s: is damaged; the count of restarts begins at 0 again", restarts->path);
    }
    tl_json_reader_free(&reader);
}

/* Fixed length, so that one record can overwrite another in place. */
enum { ACCOUNT_BYTES = 256 };

static void print_account(const tl_restarts *restarts, bool running, char text[ACCOUNT_BYTES + 1]) {
    int length = snprintf(text, ACCOUNT_BYTES + 1,
                          "{\"starts\": %" PRIu64 ", \"restarts\": %" PRIu64
                          ", \"failures\": %u, \"running\": %s, \"boot\": \"%s\", \"unreadable\": \"%" PRIx64
                          "\", \"tries\": %u}",
                          restarts->starts, restarts->restarts, restarts->failures, running ? "true" : "false",
                          restarts->boot, restarts->unreadable, restarts->tries);
    memset(text + length, ' ', (size_t)(ACCOUNT_BYTES - 1 - length));
    text[ACCOUNT_BYTES - 1] = '\n';
}

/* Overwrites the file in place, because a full disk has no space for a new one. A power failure may
 * damage the file, so this is only for the end. */
static bool write_over(const char *path, const char *text) {
    int file = open(path, O_WRONLY | O_CLOEXEC | O_NOFOLLOW);
    bool is_written = file >= 0 && tl_file_bytes_write(file, text, ACCOUNT_BYTES) && fdatasync(file) == 0;
    if (file >= 0) {
        (void)close(file);
    }
    return is_written;
}

static tl_status write_file(const char *path, const char *text, tl_error *error) {
    tl_new_file file;
    tl_status status = tl_new_file_open(path, &file, error);
    if (status != TL_OK) {
        return status;
    }
    (void)fwrite(text, 1, ACCOUNT_BYTES, file.file);
    return tl_new_file_keep(&file, error);
}

/* A full disk must not stop the run; it is logged once. */
static void save_account(tl_restarts *restarts, bool running) {
    char text[ACCOUNT_BYTES + 1];
    tl_error error;
    if (restarts->path[0] == '\0') {
        return;
    }
    print_account(restarts, running, text);
    bool failed = write_file(restarts->path, text, &error) != TL_OK;
    failed = failed && (running || !write_over(restarts->path, text));
    if (failed && !restarts->unwritten) {
        tl_log(TL_LOG_WARNING, "the count of restarts is not saved: %s", error.text);
    }
    restarts->unwritten = failed;
}

/* ---- record ---- */

/* A disk that became read-only, for example after a fault, must not prevent the run. */
static bool is_read_only(const char *folder) {
    bool is = access(folder, W_OK | X_OK) != 0 && errno == EROFS;
    if (is) {
        tl_log(TL_LOG_ERROR,
               "--state %.300s: the file system is read-only: the count of restarts is not saved, and changes of the "
               "configuration are rejected",
               folder);
    }
    return is;
}

static tl_status set_folder(const char *folder, tl_restarts *restarts, tl_error *error) {
    struct stat about;
    if (mkdir(folder, 0755) != 0 && errno != EEXIST) {
        return tl_fail(error, TL_BAD_DATA, "--state %.300s: cannot be created: %s", folder, strerror(errno));
    }
    if (stat(folder, &about) != 0 || !S_ISDIR(about.st_mode) ||
        (access(folder, W_OK | X_OK) != 0 && !is_read_only(folder))) {
        return tl_fail(error, TL_BAD_DATA, "--state %.300s: expected a folder to which this user may write", folder);
    }
    restarts->lock = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (restarts->lock >= 0 && flock(restarts->lock, LOCK_EX | LOCK_NB) != 0) {
        tl_restarts_close(restarts);
        return tl_fail(error, TL_TRY_AGAIN,
                       "--state %.300s: in use by another supervisor: use a separate folder for each twin", folder);
    }
    int length = snprintf(restarts->path, sizeof restarts->path, "%s/supervisor.json", folder);
    return length < (int)sizeof restarts->path
               ? TL_OK
               : tl_fail(error, TL_BAD_DATA, "--state %.100s…: the path is too long; shorten it", folder);
}

tl_status tl_restarts_open(const char *folder, bool watchdog, tl_restarts *restarts, tl_error *error) {
    *restarts = (tl_restarts){.lock = -1};
    tl_identity_boot(restarts->boot);
    tl_status status = folder == NULL ? TL_OK : set_folder(folder, restarts, error);
    if (status == TL_OK && folder != NULL) {
        read_account(restarts, watchdog);
    }
    return status;
}

void tl_restarts_begin(tl_restarts *restarts, bool again) {
    restarts->starts++;
    restarts->restarts += again ? 1 : 0;
    restarts->healthy = 0;
    save_account(restarts, true);
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
            save_account(restarts, true);
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
    save_account(restarts, false);
}

void tl_restarts_close(tl_restarts *restarts) {
    if (restarts->lock >= 0) {
        (void)close(restarts->lock);
        restarts->lock = -1;
    }
}
