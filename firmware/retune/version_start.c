/* Version of a run: see version_start.h. */
#include "firmware/retune/version_start.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/retune/activation.h"
#include "firmware/retune/versions.h"
#include "firmware/retune/worker.h"

static const tl_time VALIDATION_LIMIT = 20 * TL_SECOND;
static const tl_time POLL_PAUSE = TL_SECOND / 100;

typedef struct starting_run {
    const tl_version_start *start;
    tl_versions versions;
    tl_version_choice choice;
    char *file;      /* NULL: it cannot be read, */
    char fault[128]; /* and this is the reason */
    size_t file_size;
    tl_verdict verdict;
} starting_run;

static void read_file(starting_run *self) {
    self->file =
        tl_file_text_take(open(self->start->path, O_RDONLY | O_CLOEXEC | O_NOCTTY), TL_CONTROL_MOST, &self->file_size);
    if (self->file == NULL && errno != EFBIG) {
        (void)snprintf(self->fault, sizeof self->fault, "%s", strerror(errno));
    } else if (self->file == NULL || self->file_size == 0) {
        (void)snprintf(self->fault, sizeof self->fault, "expected a configuration of 1 to %d bytes",
                       (int)TL_CONTROL_MOST);
        free(self->file);
        self->file = NULL;
    }
}

/* ---- validating ---- */

/* Returns false if there is no verdict. */
static bool run_validator(starting_run *self, const char *active_text) {
    char *kept = NULL; /* text of the version that a probation would return to, if there is one */
    tl_worker worker;
    tl_error error;
    if (self->versions.probation.version != 0) {
        (void)tl_versions_read(&self->versions, self->versions.probation.return_to, &kept, &error);
    }
    const tl_worker_settings settings = {
        .plant = self->start->path,
        .job = {.kind = TL_WORKER_VALIDATOR,
                .text = {[TL_WORKER_PATH] = self->start->path,
                         [TL_WORKER_CANDIDATE] = self->file,
                         [TL_WORKER_ACTIVE] = active_text,
                         [TL_WORKER_KEPT] = kept}},
        .limit = VALIDATION_LIMIT,
        .run_role = self->start->run_role,
    };
    tl_status status = tl_worker_start(&worker, &settings, &error);
    free(kept);
    if (status != TL_OK) {
        return false;
    }
    tl_worker_state state = tl_worker_poll(&worker);
    for (; state == TL_WORKER_RUNNING; state = tl_worker_poll(&worker)) {
        tl_clock_sleep_until(tl_clock_now(NULL) + POLL_PAUSE);
    }
    bool is_known = state == TL_WORKER_DONE && tl_verdict_take(worker.result.bytes, &self->verdict);
    tl_worker_close(&worker);
    return is_known;
}

/* Validates the changed file. If it is invalid, the active version runs, so there must be one. */
static bool is_file_valid(starting_run *self, const char *active_text) {
    if (strlen(self->file) != self->file_size || !run_validator(self, active_text)) {
        tl_log(TL_LOG_ERROR, "%s: the file could not be validated (expected a JSON text)", self->start->path);
        return false;
    }
    bool is_valid = self->verdict.is_valid != 0;
    for (uint32_t i = 0; !is_valid && i < self->verdict.problems && i < TL_VERDICT_PROBLEMS; i++) {
        tl_control_log_problem(self->start->path, &self->verdict.problem[i]);
    }
    return is_valid;
}

/* ---- activating the file ---- */

/* The active version runs, as if the file had not changed. */
static tl_status fall_back(starting_run *self, tl_error *error) {
    tl_status status = tl_versions_choose(&self->versions, NULL, 0, &self->choice, error);
    if (status == TL_OK) {
        tl_log(TL_LOG_ERROR, "%s: rejected, so the run uses the active version %llu: correct the file",
               self->start->path, (unsigned long long)self->choice.number);
    }
    return status;
}

static tl_status add_file(starting_run *self, tl_error *error) {
    uint64_t number = 0;
    char *active_text = NULL;
    bool is_first = self->versions.active == 0;
    self->verdict.kind = TL_CHANGE_RESTART;
    if (!is_first && tl_versions_read(&self->versions, self->versions.active, &active_text, error) != TL_OK) {
        tl_log(TL_LOG_WARNING, "%s", error->text);
        active_text = NULL;
    }
    bool is_accepted = is_first || is_file_valid(self, active_text == NULL ? "" : active_text);
    free(active_text);
    const tl_version_candidate answer_code = {
        .text = self->file,
        .size = self->file_size,
        .who = "the file",
        .why = "",
        .origin = TL_ORIGIN_START,
        .right = TL_RIGHT_COMMISSION,
        .kind = (tl_change_kind)self->verdict.kind,
    };
    tl_status status = tl_versions_add(&self->versions, &answer_code, &number, error);
    if (status == TL_OK && is_accepted) {
        const tl_probation_terms terms = {.given_s = TL_ACTIVATION_PROBATION_S,
                                          .require_lock = TL_ACTIVATION_LOCK_PERCENT};
        tl_probation probation;
        tl_probation_begin(&probation, &terms, &(tl_run_status){.ticks = 0}, NULL);
        probation.account.tolerances = self->verdict.tolerances;
        (void)snprintf(probation.account.widened, TL_PROBATION_WIDENED, "%s", self->verdict.widened);
        status = tl_versions_activate(&self->versions, number, is_first ? NULL : &probation.account, error);
    } else if (status == TL_OK) {
        status = tl_versions_refuse(&self->versions, number, "the configuration file is invalid", error);
    }
    if (status != TL_OK) { /* a full disk must not prevent the run */
        tl_log(TL_LOG_ERROR, "%s: the configuration of this run is not saved as a version", error->text);
    }
    return is_accepted ? TL_OK : fall_back(self, error);
}

/* `keeps`: the versions can be saved, so a changed file becomes a version. */
static tl_status choose_text(starting_run *self, bool keeps, tl_error *error) {
    const tl_version_probation *probation = &self->versions.probation;
    bool is_readable = self->file != NULL;
    tl_status status = tl_versions_choose(&self->versions, self->file, self->file_size, &self->choice, error);
    if (status != TL_OK) {
        return is_readable ? status : tl_fail(error, TL_BAD_DATA, "%s: %s", self->start->path, self->fault);
    }
    if (!is_readable) {
        tl_log(TL_LOG_WARNING, "%s: %s", self->start->path, self->fault);
    }
    status = self->choice.is_candidate && keeps ? add_file(self, error) : TL_OK;
    if (probation->version != 0) {
        tl_log(TL_LOG_NOTICE, "version %llu is on probation for %llu s more; %s",
               (unsigned long long)probation->version, (unsigned long long)((probation->account.left_ms + 999) / 1000),
               probation->account.terms.must_confirm ? "it will be rolled back unless it is confirmed"
                                                     : "it will be kept if it stays in lock");
    }
    return status;
}

/* ---- naming the version ---- */

/* Returns the newest version with this hash, or NULL. */
static const tl_version *find_newest(const tl_versions *versions, const char *hash) {
    const tl_version *found = NULL;
    for (size_t i = 0; i < versions->count; i++) {
        found = strcmp(versions->list[i].hash, hash) == 0 ? &versions->list[i] : found;
    }
    return found;
}

/* The active version runs, unless the disk has rejected the file's version. */
static void write_running(const starting_run *self, const char *text, char running[TL_VERSION_RUNNING]) {
    const tl_version *active = tl_versions_active(&self->versions);
    char hash[TL_SHA256_TEXT];
    char version[64] = "";
    tl_sha256(text, self->choice.size, hash);
    if (strcmp(hash, active->hash) == 0) {
        (void)snprintf(version, sizeof version, "version %llu of ", (unsigned long long)active->number);
    }
    int length =
        snprintf(running, TL_VERSION_RUNNING, "configuration %.12s runs: %s%.100s", hash, version, self->start->path);
    if (self->file == NULL || text == self->file) {
        return;
    }
    tl_sha256(self->file, self->file_size, hash);
    const tl_version *other = find_newest(&self->versions, hash);
    length +=
        snprintf(running + length, (size_t)(TL_VERSION_RUNNING - length), "; the file is another one, %.12s", hash);
    if (other != NULL) {
        (void)snprintf(running + length, (size_t)(TL_VERSION_RUNNING - length), ", version %llu, %s%s%.150s",
                       (unsigned long long)other->number, tl_version_results[other->result],
                       other->reason[0] != '\0' ? ": " : "", other->reason);
    }
}

tl_status tl_version_start_choose(const tl_version_start *start, char **text, size_t *size,
                                  char running[TL_VERSION_RUNNING], tl_error *error) {
    static starting_run self; /* too large for the stack */
    self = (starting_run){.start = start};
    (void)mkdir(start->state, 0777); /* like the supervisor later; a failure is reported by tl_versions_open() */
    bool keeps = tl_versions_open(start->state, &self.versions, error) == TL_OK;
    if (!keeps) {
        tl_log(TL_LOG_ERROR, "%s: so the run starts with %s, not with the active version", error->text, start->path);
    }
    read_file(&self);
    tl_status status = choose_text(&self, keeps, error);
    *text = self.choice.text != NULL ? self.choice.text : self.file;
    *size = self.choice.size;
    if (status == TL_OK) {
        write_running(&self, *text, running);
    }
    tl_versions_close(&self.versions);
    if (self.file != *text || status != TL_OK) {
        free(self.file);
        *text = status == TL_OK ? *text : NULL;
    }
    return status;
}

bool tl_version_start_failed(const tl_version_start *start, const char *reason) {
    tl_versions versions;
    tl_error error;
    tl_status status = tl_versions_open(start->state, &versions, &error);
    bool is_on_probation = status == TL_OK && versions.probation.version != 0;
    if (is_on_probation) {
        status = tl_versions_end_probation(&versions, TL_VERSION_ROLLED_BACK, reason, &error);
    }
    if (status != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    tl_versions_close(&versions);
    return is_on_probation && status == TL_OK;
}
