/* What io and the recorder give up: see live_places.h. */
#include "firmware/live/live_places.h"

#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/confine/confine.h"

/* Where names of hosts are looked up, and what a box has that manages its network; which boot this is. */
static const char *const common[] = {
    "/etc",      "/run/systemd/resolve",           "/run/resolvconf", "/run/NetworkManager", "/run/connman",
    "/run/nscd", "/proc/sys/kernel/random/boot_id"};

enum { COMMON = sizeof common / sizeof common[0], PER_FILE = 2, PER_SOURCE = PER_FILE + 1 };

/* Texts of ours. */
typedef struct places {
    char **path;
    size_t count;
} places;

static void free_places(places *list) {
    for (size_t i = 0; i < list->count; i++) {
        free(list->path[i]);
    }
    free(list->path);
}

/* Room for all that add() is called with. */
static tl_status make_places(places *list, size_t most, tl_error *error) {
    list->count = 0;
    list->path = calloc(most, sizeof *list->path);
    return list->path != NULL ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "not enough memory");
}

static void add(places *list, const char *path) {
    char *found = realpath(path, NULL);
    if (found != NULL) {
        list->path[list->count++] = found;
    }
}

static void add_common(places *list) {
    for (size_t i = 0; i < COMMON; i++) {
        add(list, common[i]);
    }
}

/* The folder of a file that may come later, or anew: that folder, or the nearest one above that is there. */
static void add_folder(places *list, const char *file) {
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s", file);
    size_t before = list->count;
    char *folder = dirname(path);
    add(list, folder);
    while (list->count == before && strcmp(folder, "/") != 0 && strcmp(folder, ".") != 0) {
        folder = dirname(folder);
        add(list, folder);
    }
}

/* Also where a link leads to now. */
static void add_folders(places *list, const char *file) {
    char *found = realpath(file, NULL);
    add_folder(list, file);
    if (found != NULL) {
        add_folder(list, found);
    }
    free(found);
}

static tl_status confine(const places *read, const places *write, bool is_recorder, tl_error *error) {
    tl_confine_facts facts;
    const tl_confine_settings settings = {
        .read = (const char *const *)read->path,
        .read_count = read->count,
        .write = (const char *const *)write->path,
        .write_count = write->count,
        .start_socket = -1,
        .whole_process = true,
        .lives_on = true,
        .may_connect = !is_recorder,
        .keeps_files = is_recorder,
    };
    return tl_confine(&settings, &facts, NULL, error);
}

/* A device that is unplugged and plugged in has a new entry in /dev, to which links of other places lead. */
static void add_source(places *read, places *write, const tl_config *config, const tl_config_source *source) {
    char path[PATH_MAX];
    if (source->kind == TL_SOURCE_CSV && tl_config_file_path(config, source->file, path, sizeof path)) {
        add_folders(read, path);
    }
    if (source->kind == TL_SOURCE_MODBUS_RTU && tl_config_file_path(config, source->line.device, path, sizeof path)) {
        add_folders(write, path);
    }
    if (source->kind == TL_SOURCE_MODBUS_RTU || source->kind == TL_SOURCE_GPIO) {
        add(write, "/dev");
    }
    if (source->kind == TL_SOURCE_GPIO) { /* where libgpiod looks whether a device is a chip */
        add(read, "/sys");
    }
}

tl_status tl_live_places_confine_io(const tl_config *config, tl_error *error) {
    places read = {.path = NULL};
    places write = {.path = NULL};
    tl_status status = make_places(&read, COMMON + config->source_count * PER_SOURCE, error);
    if (status == TL_OK) {
        status = make_places(&write, 1 + config->source_count * PER_SOURCE, error);
    }
    if (status == TL_OK) {
        add_common(&read);
        for (size_t i = 0; i < config->source_count; i++) {
            add_source(&read, &write, config, &config->sources[i]);
        }
        status = confine(&read, &write, false, error);
    }
    free_places(&read);
    free_places(&write);
    return status;
}

tl_status tl_live_places_confine_recorder(const tl_config *config, const char *database, tl_error *error) {
    places read = {.path = NULL};
    places write = {.path = NULL};
    tl_status status = make_places(&read, COMMON + config->component_count, error);
    if (status == TL_OK) {
        status = make_places(&write, PER_FILE, error);
    }
    if (status == TL_OK) {
        add_common(&read);
        add_folders(&write, database);
        for (size_t i = 0; i < config->component_count; i++) {
            char path[PATH_MAX];
            if (tl_config_fmu_path(config, config->components[i].fmu, path, sizeof path)) {
                add(&read, path);
            }
        }
        status = confine(&read, &write, true, error);
    }
    free_places(&read);
    free_places(&write);
    return status;
}
