/* Twin slots: see twin_slots.h. */
#include "firmware/live/twin_slots.h"

#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "firmware/config/drivers.h"
#include "firmware/fmu/fmu_archive.h"
#include "firmware/process/confine.h"
#include "firmware/store/record_queue.h"

/* ---- configuration ---- */

void tl_twin_slot_unload(tl_twin_slot *slot) {
    tl_block_close(slot->queue);
    free(slot->copy);
    slot->copy = NULL;
    slot->text = NULL;
    slot->hash[0] = '\0';
}

static tl_status make_queue(tl_twin_slot *slot, const tl_record_queue_settings *settings, tl_error *error) {
    slot->queue_settings = *settings;
    return tl_block_make("twinlock records", tl_record_queue_bytes(settings), TL_BLOCK_SPARSE, slot->queue, error);
}

tl_status tl_twin_slot_load(tl_twin_slot *slot, const tl_config *config, bool unconfined, tl_error *error) {
    const tl_record_queue_settings settings = tl_live_twin_queue(config);
    slot->text = config->text;
    memcpy(slot->hash, config->hash, sizeof slot->hash);
    slot->fmus = tl_twin_fmus_of(config);
    slot->unconfined = unconfined;
    slot->live_status->first = slot->live_status->number + 1;
    return make_queue(slot, &settings, error);
}

/* ---- candidate ---- */

static bool read_at(const tl_block *block, size_t at, void *bytes, size_t size) {
    return pread(block->descriptor, bytes, size, (off_t)at) == (ssize_t)size;
}

/* Reads without mapping, because a mapping would be locked in memory. */
static tl_status copy_text(tl_twin_slot *slot, const tl_block *candidate, tl_error *error) {
    uint32_t size = 0;
    char hash[TL_SHA256_TEXT] = "";
    char found[TL_SHA256_TEXT];
    if (!read_at(candidate, offsetof(tl_live_candidate, size), &size, sizeof size) || size == 0 ||
        size > TL_CONFIG_MAX_BYTES || !read_at(candidate, offsetof(tl_live_candidate, hash), hash, sizeof hash - 1)) {
        return tl_fail(error, TL_BAD_DATA, "candidate: its text has %u bytes (expected 1 … %d)", (unsigned)size,
                       (int)TL_CONFIG_MAX_BYTES);
    }
    slot->copy = malloc((size_t)size + 1);
    if (slot->copy == NULL || !read_at(candidate, offsetof(tl_live_candidate, text), slot->copy, size)) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the candidate");
    }
    slot->copy[size] = '\0';
    tl_sha256(slot->copy, size, found);
    if (strlen(slot->copy) != size || strcmp(found, hash) != 0) {
        return tl_fail(error, TL_BAD_DATA, "candidate: its text does not match its hash");
    }
    slot->text = slot->copy;
    memcpy(slot->hash, found, sizeof slot->hash);
    return TL_OK;
}

static tl_status check_needs(const tl_live_needs *needs, tl_error *error) {
    bool fits = needs->match <= TL_MAX_MATCH && needs->adjust <= TL_MAX_ADJUST &&
                needs->components < TL_RECORDER_COMPONENTS && needs->unconfined <= 1 && needs->signals >= 1 &&
                needs->signals <= TL_MAX_SIGNALS &&
                needs->unpacked_bytes <= needs->components * (uint64_t)TL_FMU_TOTAL_BYTES;
    return fits ? TL_OK
                : tl_fail(error, TL_BAD_DATA,
                          "candidate: impossible sizes: match %u, adjust %u, components %u, signals %u",
                          (unsigned)needs->match, (unsigned)needs->adjust, (unsigned)needs->components,
                          (unsigned)needs->signals);
}

tl_status tl_twin_slot_load_candidate(tl_twin_slot *slot, const tl_block *candidate, const tl_live_needs *needs,
                                      tl_time step, tl_error *error) {
    const tl_recorder_shape shape = {.plant = needs->signals,
                                     .match = needs->match,
                                     .adjust = needs->adjust,
                                     .components = (size_t)needs->components + 1};
    tl_twin_slot_unload(slot);
    tl_status status = check_needs(needs, error);
    if (status == TL_OK) {
        status = copy_text(slot, candidate, error);
    }
    if (status == TL_OK) {
        const tl_record_queue_settings settings = tl_live_queue_of_shape(&shape, step);
        status = make_queue(slot, &settings, error);
    }
    if (status != TL_OK) {
        tl_twin_slot_unload(slot);
        return status;
    }
    slot->fmus = (tl_twin_fmus){.count = needs->components, .unpacked_bytes = needs->unpacked_bytes};
    slot->unconfined = needs->unconfined != 0;
    uint32_t number = slot->live_status->number; /* kept: it identifies answers */
    memset(slot->live_status, 0, sizeof *slot->live_status);
    slot->live_status->number = number;
    slot->live_status->first = number + 1;
    return TL_OK;
}

/* ---- unread data ---- */

uint64_t tl_twin_slot_count_remaining(const tl_twin_slot *slot, const tl_record_queue_taken *taken) {
    tl_block queue = {.descriptor = -1};
    tl_error error;
    uint64_t count = 0;
    if (slot->queue->size != 0 &&
        tl_block_take(tl_block_reader(slot->queue), slot->queue->size, TL_BLOCK_WE_WRITE, &queue, &error) == TL_OK) {
        count = tl_record_queue_count_remaining(&slot->queue_settings, queue.bytes, taken);
    }
    tl_block_close(&queue);
    return count;
}

/* ---- confinement ---- */

/* The boot id; then the files for name look-up, and those of network managers. */
static const char *const common[] = {"/proc/sys/kernel/random/boot_id",
                                     "/etc",
                                     "/run/systemd/resolve",
                                     "/run/resolvconf",
                                     "/run/NetworkManager",
                                     "/run/connman",
                                     "/run/nscd"};

enum { DOMAIN_PORT = 53, COMMON = sizeof common / sizeof common[0] };

/* Paths; the list owns the texts. */
typedef struct path_list {
    char **path;
    size_t count;
    bool failed; /* memory was out */
} path_list;

static void free_paths(path_list *list) {
    for (size_t i = 0; i < list->count; i++) {
        free(list->path[i]);
    }
    free(list->path);
}

/* Returns false if the path does not exist. */
static bool add_path(path_list *list, const char *path) {
    char *found = realpath(path, NULL);
    list->failed = list->failed || (found == NULL && errno == ENOMEM);
    if (found == NULL) {
        return list->failed;
    }
    char **grown = realloc(list->path, (list->count + 1) * sizeof *grown);
    if (grown == NULL) {
        list->failed = true;
        free(found);
        return true;
    }
    list->path = grown;
    list->path[list->count++] = found;
    return true;
}

static void add_common(path_list *list, bool with_names) {
    for (size_t i = 0; i < (with_names ? COMMON : 1); i++) {
        (void)add_path(list, common[i]);
    }
}

/* Adds the folder of a file that may be created or replaced later: that folder, or its nearest
 * existing parent. */
static void add_folder(path_list *list, const char *file) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s", file);
    char *folder = dirname(path);
    while (!add_path(list, folder) && strcmp(folder, "/") != 0 && strcmp(folder, ".") != 0) {
        folder = dirname(folder);
    }
}

/* Also adds the folder to which a link points now. */
static void add_folders(path_list *list, const char *file) {
    char *found = realpath(file, NULL);
    add_folder(list, file);
    if (found != NULL) {
        add_folder(list, found);
    }
    free(found);
}

/* `settings`: the fields that differ between io and recorder. Frees both lists. */
static tl_status confine_process(tl_confine_settings settings, path_list *read, path_list *write, tl_error *error) {
    tl_confine_facts facts;
    settings.read = (const char *const *)read->path;
    settings.read_count = read->count;
    settings.write = (const char *const *)write->path;
    settings.write_count = write->count;
    settings.start_socket = -1;
    settings.whole_process = true;
    settings.only_denies = true;
    tl_status status = read->failed || write->failed
                           ? tl_fail(error, TL_TRY_AGAIN, "not enough memory for the paths that a process may open")
                           : tl_confine(&settings, &facts, NULL, error);
    free_paths(read);
    free_paths(write);
    return status;
}

/* Adds the files, devices and ports of one source and of its driver. */
static void add_source(tl_confine_settings *settings, uint16_t *ports, path_list *read, path_list *write,
                       const tl_config *config, const tl_config_source *source) {
    const tl_plant_access *access = source->driver->access;
    tl_source_reach reach = {.read = NULL};
    char path[PATH_MAX];
    if (source->driver->reach != NULL) {
        source->driver->reach(source, &reach);
    }
    if (reach.read != NULL && tl_config_file_path(config, reach.read, path, sizeof path)) {
        add_folders(read, path);
    }
    if (reach.write != NULL && tl_config_file_path(config, reach.write, path, sizeof path)) {
        add_folders(write, path);
    }
    if (access->read != NULL) {
        (void)add_path(read, access->read);
    }
    if (access->write != NULL) {
        (void)add_path(write, access->write);
    }
    if (reach.port != 0) {
        ports[settings->port_count++] = reach.port;
    }
    settings->plant = access;
    settings->names = settings->names || reach.names;
}

tl_status tl_twin_slots_confine_io(const tl_config *config, unsigned kind, tl_error *error) {
    path_list read = {.path = NULL};
    path_list write = {.path = NULL};
    uint16_t *ports = calloc(config->source_count + 1, sizeof *ports);
    tl_confine_settings settings = {.ports = ports};
    if (ports == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    for (size_t i = 0; i < config->source_count; i++) {
        if (kind == tl_driver_bit(config->sources[i].driver)) {
            add_source(&settings, ports, &read, &write, config, &config->sources[i]);
        }
    }
    add_common(&read, settings.names);
    if (settings.names) { /* DNS by TCP, for long answers */
        ports[settings.port_count++] = DOMAIN_PORT;
    }
    tl_status status = confine_process(settings, &read, &write, error);
    free(ports);
    return status;
}

tl_status tl_twin_slots_confine_recorder(const tl_config *config, const char *database, tl_error *error) {
    path_list read = {.path = NULL};
    path_list write = {.path = NULL};
    add_common(&read, true);
    add_folders(&write, database);
    for (size_t i = 0; i < config->component_count; i++) {
        char path[PATH_MAX];
        if (tl_config_fmu_path(config, config->components[i].fmu, path, sizeof path)) {
            (void)add_path(&read, path);
        }
    }
    return confine_process((tl_confine_settings){.keeps_files = true}, &read, &write, error);
}
