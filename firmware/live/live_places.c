/* What io and the recorder give up: see live_places.h. */
#include "firmware/live/live_places.h"

#include <arpa/inet.h>
#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/process/confine.h"

/* Which boot this is; then where names of hosts are looked up, and what a box has that manages its network. */
static const char *const common[] = {"/proc/sys/kernel/random/boot_id",
                                     "/etc",
                                     "/run/systemd/resolve",
                                     "/run/resolvconf",
                                     "/run/NetworkManager",
                                     "/run/connman",
                                     "/run/nscd"};

enum { DOMAIN_PORT = 53 };

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

static void add_common(places *list, bool with_names) {
    for (size_t i = 0; i < (with_names ? COMMON : 1); i++) {
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

/* `settings`: what differs. */
static tl_status confine(tl_confine_settings settings, const places *read, const places *write, tl_error *error) {
    tl_confine_facts facts;
    settings.read = (const char *const *)read->path;
    settings.read_count = read->count;
    settings.write = (const char *const *)write->path;
    settings.write_count = write->count;
    settings.start_socket = -1;
    settings.whole_process = true;
    settings.lives_on = true;
    return tl_confine(&settings, &facts, NULL, error);
}

static bool is_address(const char *host) {
    unsigned char address[sizeof(struct in6_addr)];
    return inet_pton(AF_INET, host, address) == 1 || inet_pton(AF_INET6, host, address) == 1;
}

static unsigned driver_of(const tl_config_source *source) {
    switch (source->kind) {
    case TL_SOURCE_MODBUS_TCP:
        return TL_CONFINE_TCP | (is_address(source->host) ? 0U : (unsigned)TL_CONFINE_NAMES);
    case TL_SOURCE_MODBUS_RTU:
        return TL_CONFINE_SERIAL;
    case TL_SOURCE_CAN:
        return TL_CONFINE_CAN;
    case TL_SOURCE_GPIO:
        return TL_CONFINE_GPIO;
    case TL_SOURCE_CSV:
        break;
    }
    return TL_CONFINE_CSV;
}

/* Adds a source's drivers and port, of which `ports` has room for. */
static void add_driver(tl_confine_settings *settings, uint16_t *ports, const tl_config_source *source) {
    settings->drivers |= driver_of(source);
    if (source->kind == TL_SOURCE_MODBUS_TCP) {
        ports[settings->port_count++] = source->port;
    }
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

tl_status tl_live_places_confine_io(const tl_config *config, unsigned kinds, tl_error *error) {
    places read = {.path = NULL};
    places write = {.path = NULL};
    uint16_t *ports = calloc(config->source_count + 1, sizeof *ports);
    tl_confine_settings settings = {.ports = ports};
    tl_status status = make_places(&read, COMMON + config->source_count * PER_SOURCE, error);
    if (status == TL_OK) {
        status = make_places(&write, 1 + config->source_count * PER_SOURCE, error);
    }
    if (ports == NULL) {
        status = tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    } else if (status == TL_OK) {
        for (size_t i = 0; i < config->source_count; i++) {
            if ((kinds & 1U << config->sources[i].kind) != 0) {
                add_source(&read, &write, config, &config->sources[i]);
                add_driver(&settings, ports, &config->sources[i]);
            }
        }
        const bool with_names = (settings.drivers & TL_CONFINE_NAMES) != 0;
        add_common(&read, with_names);
        if (with_names) { /* an answer that is too long for a datagram */
            ports[settings.port_count++] = DOMAIN_PORT;
        }
        status = confine(settings, &read, &write, error);
    }
    free(ports);
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
        add_common(&read, true);
        add_folders(&write, database);
        for (size_t i = 0; i < config->component_count; i++) {
            char path[PATH_MAX];
            if (tl_config_fmu_path(config, config->components[i].fmu, path, sizeof path)) {
                add(&read, path);
            }
        }
        status = confine((tl_confine_settings){.keeps_files = true}, &read, &write, error);
    }
    free_places(&read);
    free_places(&write);
    return status;
}
