/* What is saved, tried before a run: see saved_states.h. */
#include "firmware/tree/saved_states.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/identity.h"
#include "firmware/base/new_file.h"
#include "firmware/text/clean_text.h"
#include "firmware/text/json_reader.h"
#include "firmware/text/json_writer.h"
#include "firmware/twin/read_back.h"
#include "firmware/twin/twin_child.h"

static const tl_time CALL_LIMIT = 60 * TL_SECOND;

enum { FILE_BYTES = 2048 };

/* ---- of which FMUs ---- */

typedef struct tried_files {
    uint64_t number;
    char key[TL_SHA256_TEXT]; /* "": one cannot be read */
} tried_files;

/* What it depends on besides the files. */
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

static void identify(const tl_config *config, tried_files *files) {
    int descriptors[TL_IDENTITY_FILES] = {0};
    char digest[TL_SHA256_TEXT];
    const size_t count =
        config->component_count < TL_IDENTITY_FILES ? config->component_count : (size_t)TL_IDENTITY_FILES;
    *files = (tried_files){.key = ""};
    for (size_t i = 0; i < count; i++) {
        char path[PATH_MAX];
        bool is_named = tl_config_fmu_path(config, config->components[i].fmu, path, sizeof path);
        descriptors[i] = is_named ? open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK) : -1;
    }
    tl_identity_open_files(descriptors, count, digest);
    if (digest[0] != '\0') {
        files->number = tl_identity_number_of_open_files(descriptors, count);
        make_key(config, digest, files->key);
    }
    for (size_t i = 0; i < count; i++) {
        if (descriptors[i] >= 0) {
            (void)close(descriptors[i]);
        }
    }
}

/* ---- what is remembered ---- */

static bool name_file(const char *folder, char path[PATH_MAX]) {
    return snprintf(path, PATH_MAX, "%s/states.json", folder) < PATH_MAX;
}

/* False: nothing is, of these. */
static bool remember(const char *path, const char *key, char why[TL_SAVED_STATES_TEXT]) {
    char text[FILE_BYTES];
    FILE *file = fopen(path, "r");
    if (file == NULL) {
        return false;
    }
    size_t size = fread(text, 1, sizeof text, file);
    (void)fclose(file);
    tl_json_reader reader = tl_json_reader_of(text, size);
    bool is_known = strcmp(tl_json_text(&reader, "of"), key) == 0;
    (void)snprintf(why, TL_SAVED_STATES_TEXT, "%s", tl_json_text(&reader, "why"));
    is_known = is_known && reader.right;
    tl_json_reader_free(&reader);
    return is_known;
}

/* If it cannot be kept it is found out again: the account of restarts, which lies there as well, says what is wrong with the folder. */
static void keep(const char *folder, const char *path, const char *key, const char *why) {
    tl_new_file file;
    tl_json_writer json;
    tl_error ignored;
    (void)mkdir(folder, 0755);
    if (tl_new_file_open(path, &file, &ignored) != TL_OK) {
        return;
    }
    tl_json_writer_begin(&json);
    tl_json_add_text(&json, "of", key);
    tl_json_add_text(&json, "why", why);
    if (tl_json_writer_print(&json, file.file, &ignored) == TL_OK) {
        (void)tl_new_file_keep(&file, &ignored);
    } else {
        tl_new_file_discard(&file);
    }
    tl_json_writer_free(&json);
}

/* ---- trying ---- */

static tl_status take_page(const tl_saved_states_settings *settings, FILE *page) {
    tl_config config = *settings->config;
    tl_error error;
    tl_config_use_lookups(&config);
    const tl_twin_job order = {
        .task = TL_TASK_CHECK,
        .path = config.path,
        .text = config.text,
        .states_only = true,
        .reads_back = true,
        .unconfined = settings->unconfined,
    };
    const tl_twin_child_settings child_settings = {
        .job = &order,
        .config = &config,
        .page = page,
        .print_page = settings->tasks->print_page,
        .call_limit = CALL_LIMIT,
        .memory_limit = settings->memory_limit,
    };
    tl_twin_child *child = NULL;
    uint32_t warnings = 0;
    tl_status status = tl_twin_child_start(&child_settings, &child, &error);
    if (status == TL_OK && child != NULL) {
        status = tl_twin_child_check(child, &warnings, &error);
    }
    tl_twin_child_close(child);
    return status;
}

/* The page's only line. False: there is none, since the FMUs cannot even do this; nothing is remembered then. */
static bool try_them(const tl_saved_states_settings *settings, char why[TL_SAVED_STATES_TEXT]) {
    char *text = NULL;
    size_t size = 0;
    FILE *page = open_memstream(&text, &size);
    if (page == NULL) {
        return false;
    }
    tl_status status = take_page(settings, page);
    bool is_told = fclose(page) == 0 && status == TL_OK;
    if (is_told) {
        (void)tl_clean_text(text, strcspn(text, "\n"), why, TL_SAVED_STATES_TEXT);
    }
    free(text);
    return is_told;
}

void tl_saved_states_try(const tl_saved_states_settings *settings, tl_saved_states *found) {
    tried_files files;
    char path[PATH_MAX];
    *found = (tl_saved_states){.files = 0};
    if (settings->folder == NULL || settings->config->record_resume == 0 || !name_file(settings->folder, path)) {
        return;
    }
    identify(settings->config, &files);
    if (files.key[0] == '\0') {
        return;
    }
    bool is_known = remember(path, files.key, found->why);
    if (!is_known && try_them(settings, found->why)) {
        keep(settings->folder, path, files.key, found->why);
        is_known = true;
    }
    found->files = is_known && found->why[0] != '\0' ? files.number : 0;
}
