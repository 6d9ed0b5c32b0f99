/* Saved-state test: see saved_states.h. */
#include "firmware/live/saved_states.h"

#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/identity.h"
#include "firmware/base/json.h"
#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "firmware/process/private_folder.h"

/* One FMU call may take a minute in it. */
static const tl_time LIMIT = 300 * TL_SECOND;

/* When the log reports the test, and when a twin process that only waits is started. No sample is
 * lost, because the sample memory keeps 10 s and hang_s. */
static const tl_time REPORT_AFTER = 3 * TL_SECOND;
static const tl_time BRIEF = 10 * TL_SECOND;

/* ---- identity of the FMUs ---- */

/* The key contains all that the result depends on: file contents, program version, step and
 * rollback methods. */
static void make_key(const tl_config *config, const char *digest, char key[TL_SHA256_TEXT]) {
    char format[TL_IDENTITY_TEXT];
    char text[TL_SHA256_TEXT + TL_IDENTITY_TEXT + TL_IDENTITY_FILES + 32];
    tl_identity_format(format);
    int length = snprintf(text, sizeof text, "%s %s %lld ", digest, format, (long long)config->step);
    for (size_t i = 0; i < config->component_count && (size_t)length < sizeof text; i++) {
        text[length++] = (char)('0' + config->components[i].rollback);
    }
    tl_sha256(text, (size_t)length, key);
}

/* The key stays "" if a file cannot be read. */
static void identify_files(tl_saved_states *states) {
    const tl_config *config = states->config;
    int descriptors[TL_IDENTITY_FILES] = {0};
    char digest[TL_SHA256_TEXT];
    const size_t count =
        config->component_count < TL_IDENTITY_FILES ? config->component_count : (size_t)TL_IDENTITY_FILES;
    for (size_t i = 0; i < count; i++) {
        char path[PATH_MAX];
        bool is_named = tl_config_fmu_path(config, config->components[i].fmu, path, sizeof path);
        descriptors[i] = is_named ? open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK) : -1;
    }
    tl_identity_open_files(descriptors, count, digest);
    if (digest[0] != '\0') {
        states->number = tl_identity_number_of_open_files(descriptors, count);
        make_key(config, digest, states->key);
    }
    for (size_t i = 0; i < count; i++) {
        if (descriptors[i] >= 0) {
            (void)close(descriptors[i]);
        }
    }
}

/* ---- saved result ---- */

/* Returns false if there is no result for these FMUs. */
static bool load_result(tl_saved_states *states) {
    tl_json_reader reader = tl_json_file_read(states->path);
    bool is_known = strcmp(tl_json_text(&reader, "of"), states->key) == 0;
    (void)snprintf(states->why, sizeof states->why, "%s", tl_json_text(&reader, "why"));
    is_known = is_known && reader.right;
    tl_json_reader_free(&reader);
    return is_known;
}

/* If the result cannot be saved, the next start tests again. The restart record in the same folder
 * reports an unusable folder. */
static void save_result(const tl_saved_states *states) {
    tl_json_writer json;
    tl_error ignored;
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "of", states->key);
    tl_json_add_text(&json, "why", states->why);
    (void)tl_json_file_write(&json, states->path, &ignored);
    tl_json_writer_free(&json);
}

/* ---- test ---- */

static void begin_trial(tl_saved_states *states) {
    tl_error error;
    const tl_worker_settings worker = {
        .plant = states->config->name,
        .job = {.kind = TL_WORKER_STATES,
                .text = {[TL_WORKER_PATH] = states->config->path, [TL_WORKER_CANDIDATE] = states->config->text},
                .memory_limit = states->memory_limit,
                .unconfined = states->unconfined},
        .limit = LIMIT,
        .run_role = states->run_role,
    };
    states->is_due = tl_worker_start(&states->worker, &worker, &error) == TL_OK;
    states->begun = tl_clock_now(NULL);
}

/* Without an answer no result is saved: the run will report the error of the FMUs. */
static void end_trial(tl_saved_states *states, tl_worker_state state) {
    bool is_known = state == TL_WORKER_DONE && tl_worker_read_reason(states->worker.result.bytes, states->why);
    if (states->worker.is_late) {
        (void)snprintf(states->why, sizeof states->why, "the test of the saved states did not end within %.0f s",
                       tl_seconds(LIMIT));
        is_known = true;
    }
    if (is_known) {
        save_result(states);
    }
    states->files = is_known && states->why[0] != '\0' ? states->number : 0;
    states->is_due = false;
    tl_worker_close(&states->worker);
}

static void report_wait(tl_saved_states *states) {
    if (!states->is_reported) {
        tl_log(
            TL_LOG_NOTICE,
            "saved states: testing, once for these FMU files, if another process can load the states that they save; "
            "the twin starts after that, within %.0f s; the plant is read meanwhile",
            tl_seconds(LIMIT));
    }
    states->is_reported = true;
}

tl_wait tl_saved_states_check(tl_saved_states *states) {
    if (states->is_due && !states->worker.is_started) {
        begin_trial(states);
    }
    if (!states->is_due) {
        return TL_WAIT_OVER;
    }
    tl_worker_state state = tl_worker_poll(&states->worker);
    if (state != TL_WORKER_RUNNING) {
        end_trial(states, state);
        return TL_WAIT_OVER;
    }
    tl_time elapsed = tl_clock_now(NULL) - states->begun;
    if (elapsed >= REPORT_AFTER) {
        report_wait(states);
    }
    return elapsed < BRIEF ? TL_WAIT_BRIEF : TL_WAIT_LONG;
}

void tl_saved_states_stop(tl_saved_states *states) {
    if (states->worker.is_started) {
        tl_worker_close(&states->worker);
        tl_private_folder_sweep("twin"); /* the killed worker could not remove its folders */
    }
    states->is_due = false;
}

void tl_saved_states_open(const char *folder, tl_saved_states *states) {
    if (folder == NULL || states->config->record_resume == 0 ||
        snprintf(states->path, PATH_MAX, "%s/states.json", folder) >= PATH_MAX) {
        return;
    }
    identify_files(states);
    if (states->key[0] != '\0') {
        states->is_due = !load_result(states);
        states->files = !states->is_due && states->why[0] != '\0' ? states->number : 0;
    }
}
