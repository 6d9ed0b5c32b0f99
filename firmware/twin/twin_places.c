/* The places that FMUs may read: see twin_places.h. */
#include "firmware/twin/twin_places.h"

#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool is_known(const tl_twin_places *places, const char *path) {
    size_t i = 0;
    while (i < places->count && strcmp(places->path[i], path) != 0) {
        i++;
    }
    return i < places->count;
}

/* What exists, is not everything, and is there once. */
static void add(tl_twin_places *places, const char *path) {
    char *found = places->count < TL_TWIN_PLACES ? realpath(path, NULL) : NULL;
    if (found != NULL && strcmp(found, "/") != 0 && !is_known(places, found)) {
        places->path[places->count++] = found;
    } else {
        free(found);
    }
}

/* Relative names of the configuration start at its folder. */
static void add_file(tl_twin_places *places, const tl_config *config, const char *file) {
    char path[PATH_MAX];
    if (file[0] != '\0' && tl_config_file_path(config, file, path, sizeof path)) {
        add(places, path);
    }
}

/* The library itself, and beside it what comes with it (as Python's modules do), if that is a folder for libraries. */
static void add_library(tl_twin_places *places, const char *path) {
    char copy[PATH_MAX];
    (void)snprintf(copy, sizeof copy, "%s", path);
    const char *folder = dirname(copy);
    const char *name = strrchr(folder, '/');
    add(places, name != NULL && strncmp(name, "/lib", strlen("/lib")) == 0 ? folder : path);
}

static void add_component(tl_twin_places *places, const tl_assembly *assembly, size_t index) {
    const tl_config *config = &assembly->config;
    const tl_config_component *component = &config->components[index];
    for (size_t i = 0; i < component->library_count; i++) {
        const char *library = assembly->files[index].libraries[i];
        if (library != NULL && strchr(library, '/') != NULL) {
            add_library(places, library);
        }
    }
    for (size_t i = 0; i < component->read_count; i++) {
        add_file(places, config, component->reads[i].name);
    }
    for (size_t i = 0; i < component->set_count; i++) {
        const tl_plan_set *set = &component->set[i];
        if (set->value.type == TL_STRING && strchr(set->value.text, '/') != NULL) {
            add(places, set->value.text);
        }
    }
}

/* What nobody means who writes a list of folders for libraries: all, a folder of all others such as "/home", a home, or what a home lies in. */
static bool is_too_wide(const char *folder) {
    const char *home = getenv(TL_TWIN_PLACES_HOME);
    char *real_home = home != NULL && home[0] == '/' ? realpath(home, NULL) : NULL;
    size_t length = strlen(folder);
    bool holds_home = real_home != NULL && strncmp(real_home, folder, length) == 0 &&
                      (real_home[length] == '\0' || real_home[length] == '/');
    free(real_home);
    return holds_home || strrchr(folder, '/') == folder;
}

/* What a folder in a variable stands for is added. True: those behind it are not looked at. */
typedef bool add_one(tl_twin_places *places, const char *folder);

/* An absolute name, since the process has a current folder of its own. */
static bool add_folder(tl_twin_places *places, const char *folder) {
    char *found = folder[0] == '/' ? realpath(folder, NULL) : NULL;
    if (found != NULL && !is_too_wide(found)) {
        add(places, found);
    }
    free(found);
    return false;
}

/* Of an installation of Python, or an environment, only what it loads: all else there may be anybody's, as in ~ for ~/bin/python3. */
static bool add_installation(tl_twin_places *places, const char *prefix) {
    static const char *const parts[] = {"pyvenv.cfg", "lib", "lib64", "lib32"};
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++) {
        char path[PATH_MAX];
        if (snprintf(path, sizeof path, "%s/%s", prefix, parts[i]) < (int)sizeof path) {
            (void)add_folder(places, path);
        }
    }
    return false;
}

/* Python's packages are those of the python3 that is first in PATH: beside it those of an environment, and where it leads to those of the
 * installation that the environment was made from. */
static bool add_python(tl_twin_places *places, const char *folder) {
    char path[PATH_MAX];
    bool fits = snprintf(path, sizeof path, "%s/python3", folder) < (int)sizeof path;
    char *program = fits ? realpath(path, NULL) : NULL;
    if (program == NULL) {
        return false;
    }
    (void)add_installation(places, dirname(dirname(path)));
    (void)add_installation(places, dirname(dirname(program)));
    free(program);
    return true;
}

/* The folders in a variable, with colons between them. */
static void add_variable(tl_twin_places *places, const char *name, add_one *add_each) {
    const char *list = getenv(name);
    char *copy = list != NULL ? strdup(list) : NULL;
    char *rest = NULL;
    char *folder = copy != NULL ? strtok_r(copy, ":", &rest) : NULL;
    while (folder != NULL && !add_each(places, folder)) {
        folder = strtok_r(NULL, ":", &rest);
    }
    free(copy);
}

void tl_twin_places_find(const tl_assembly *assembly, tl_twin_places *places) {
    static const struct {
        const char *name;
        add_one *add;
    } variables[] = {
        {"LD_LIBRARY_PATH", add_folder},  {"PYTHONPATH", add_folder}, {"LOCPATH", add_folder},
        {"PYTHONHOME", add_installation}, {"PATH", add_python},       {"PYTHONUSERBASE", add_installation},
    };
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        add_component(places, assembly, i);
    }
    for (size_t i = 0; i < sizeof variables / sizeof variables[0]; i++) {
        add_variable(places, variables[i].name, variables[i].add);
    }
}

void tl_twin_places_free(tl_twin_places *places) {
    for (size_t i = 0; i < places->count; i++) {
        free(places->path[i]);
    }
    *places = (tl_twin_places){.count = 0};
}
