/* Loads an FMU: combines archive, description, guard and binary. */
#include "firmware/fmu/fmu_store.h"

#include <errno.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/os.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/fmu/fmu_binary.h"
#include "firmware/fmu/model_description.h"
#include "firmware/fmu/rollback_method.h"
#include "firmware/rollback/fmu_libc.h"

/* Length of a path in errors; only its end is shown. */
enum { LABEL = 120 };

/* ---- Resources ------------------------------------------------------------------------------- */

/* file:/// URI of an absolute path; all but unreserved characters (RFC 3986) and slashes are
 * percent-encoded. Returns NULL if memory is out. */
static const char *file_uri(tl_arena *arena, const char *path) {
    static const char unreserved[] = "/-._~ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789";
    static const char scheme[] = "file://";
    char *uri = tl_arena_take(arena, sizeof scheme + 3 * strlen(path), 1);
    if (uri == NULL) {
        return NULL;
    }
    char *end = uri + snprintf(uri, sizeof scheme, "%s", scheme);
    for (const char *c = path; *c != '\0'; c++) {
        end += snprintf(end, 4, strchr(unreserved, *c) != NULL ? "%c" : "%%%02X", (unsigned)(unsigned char)*c);
    }
    return uri;
}

static tl_status make_resources(tl_fmu *fmu, const char *label, tl_error *error) {
    char path[PATH_MAX + sizeof "/resources"];
    struct stat status;
    (void)snprintf(path, sizeof path, "%s/resources", fmu->folder.path);
    if (mkdir(path, 0700) != 0 && errno != EEXIST) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "%s: the folder for resources cannot be created: %s; free space or set TMPDIR", label,
                       strerror(errno));
    }
    if (stat(path, &status) != 0 || !S_ISDIR(status.st_mode)) {
        return tl_fail(error, TL_BAD_DATA, "%s: its entry \"resources\" is a file, not a folder; export the FMU again",
                       label);
    }
    fmu->resources = file_uri(&fmu->arena, path);
    if (fmu->resources == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory; free memory and try again", label);
    }
    return TL_OK;
}

/* PythonFMU's binary imports the module named in the first line of this file. */
static tl_status read_module(tl_fmu *fmu, const char *label, tl_error *error) {
    char path[PATH_MAX + sizeof "/resources/slavemodule.txt"];
    (void)snprintf(path, sizeof path, "%s/resources/slavemodule.txt", fmu->folder.path);
    FILE *file = fopen(path, "re");
    if (file == NULL) {
        return tl_shortage_is(errno)
                   ? tl_fail(
                         error, TL_TRY_AGAIN,
                         "%s: resources/slavemodule.txt cannot be opened: %s; free memory or descriptors and try again",
                         label, strerror(errno))
                   : TL_OK;
    }
    if (fgets(fmu->module, sizeof fmu->module, file) != NULL) {
        fmu->module[strcspn(fmu->module, "\r\n")] = '\0';
    }
    (void)fclose(file);
    return TL_OK;
}

/* ---- Loading --------------------------------------------------------------------------------- */

static tl_status open_memory(tl_fmu *fmu, tl_error *error) {
    if (fmu->module[0] != '\0') {
        fmu->guard.memory = tl_fmu_memory_of_python(error);
        return fmu->guard.memory != NULL ? TL_OK : TL_TRY_AGAIN;
    }
    fmu->guard.memory = &fmu->guard.own_memory;
    return tl_fmu_memory_open(fmu->folder.path, fmu->guard.memory, error);
}

/* Sets up the wanted rollback methods, as far as the description allows. The first possible method
 * is used first: own states, memory, replay. */
static tl_status open_rollback(tl_fmu *fmu, tl_rollback wanted, tl_error *error) {
    bool is_auto = wanted == TL_ROLLBACK_AUTO;
    bool by_memory = (is_auto || wanted == TL_ROLLBACK_MEMORY) && tl_fmu_libc_serves();
    fmu->has_state = (is_auto || wanted == TL_ROLLBACK_STATE) && fmu->model.capabilities.can_get_and_set_state;
    fmu->guard.is_free = wanted == TL_ROLLBACK_NONE;
    fmu->guard.most = TL_REPLAY_STEPS;
    fmu->guard.may_replay = is_auto || wanted == TL_ROLLBACK_REPLAY;
    fmu->guard.by_replay = fmu->guard.may_replay && !fmu->has_state && !by_memory;
    fmu->guard.by_memory = by_memory && !fmu->has_state;
    return by_memory ? open_memory(fmu, error) : TL_OK;
}

bool tl_fmu_is_in_python(const tl_fmu *fmu) {
    return fmu->module[0] != '\0';
}

bool tl_fmu_can_share_memory(const tl_fmu *fmu) {
    return fmu->guard.memory != NULL;
}

void tl_fmu_share_memory(tl_fmu *fmu, bool is_shared) {
    tl_fmu_guard *guard = &fmu->guard;
    guard->memory = is_shared ? guard->memory : NULL;
    guard->by_memory = is_shared;
    fmu->has_state = fmu->has_state && !is_shared;
    guard->by_replay = guard->may_replay && !is_shared && !fmu->has_state;
    tl_rollback_method_choose(guard);
}

void tl_fmu_set_replay_steps(tl_fmu *fmu, uint32_t steps) {
    fmu->guard.most = steps;
    fmu->guard.functions.replay.most = fmu->guard.by_replay ? steps : 0;
}

void tl_fmu_prepare(void) {
    if (tl_fmu_libc_serves()) {
        tl_fmu_written_begin();
    }
}

size_t tl_fmu_used(void) {
    return tl_fmu_libc_used();
}

tl_rollback tl_fmu_rollback(const tl_fmu *fmu) {
    return fmu->guard.by_memory   ? TL_ROLLBACK_MEMORY
           : fmu->guard.by_replay ? TL_ROLLBACK_REPLAY
           : fmu->has_state       ? TL_ROLLBACK_STATE
                                  : TL_ROLLBACK_NONE;
}

bool tl_fmu_inputs_are_repeated(const tl_fmu *fmu) {
    return fmu->guard.sets_inputs;
}

const tl_fmi2_times *tl_fmu_measured_times(const tl_fmu *fmu) {
    return fmu->guard.is_by_choice ? &fmu->guard.times : NULL;
}

static tl_status load(const char *path, int opened, tl_rollback wanted, const char *label, tl_fmu *fmu,
                      tl_error *error) {
    char description[PATH_MAX + sizeof "/modelDescription.xml"];
    fmu->path = tl_arena_text(&fmu->arena, path);
    if (fmu->path == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory; free memory and try again", label);
    }
    tl_status status = tl_fmu_archive_unpack(path, opened, label, &fmu->folder, error);
    if (status == TL_OK) {
        (void)snprintf(description, sizeof description, "%s/modelDescription.xml", fmu->folder.path);
        status = tl_model_description_read(description, label, &fmu->arena, &fmu->model, error);
    }
    if (status == TL_OK) {
        status = make_resources(fmu, label, error);
    }
    if (status == TL_OK) {
        status = read_module(fmu, label, error);
    }
    if (status != TL_OK) {
        return status;
    }
    tl_fmu_guard_open(&fmu->guard, fmu->model.name, fmu->model.generation_tool);
    status = open_rollback(fmu, wanted, error);
    return status != TL_OK ? status : tl_fmu_binary_open(fmu->folder.path, &fmu->model, label, &fmu->guard, error);
}

tl_status tl_fmu_load(const char *path, int opened, tl_rollback rollback, tl_fmu *fmu, tl_error *error) {
    size_t length = strlen(path);
    const char *label = length > LABEL ? path + length - LABEL : path;
    while (((unsigned char)*label & 0xC0U) == 0x80U) {
        label++; /* skips to the start of a UTF-8 character */
    }
    *fmu = (tl_fmu){.path = NULL};
    tl_arena_init(&fmu->arena);
    tl_status status = load(path, opened, rollback, label, fmu, error);
    if (status != TL_OK) {
        tl_fmu_unload(fmu);
        return status;
    }
    tl_arena_seal(&fmu->arena);
    return TL_OK;
}

void tl_fmu_unload(tl_fmu *fmu) {
    tl_fmu_guard_close(&fmu->guard);
    tl_private_folder_remove(&fmu->folder);
    tl_arena_release(&fmu->arena);
    *fmu = (tl_fmu){0};
}
