/* An FMU's own libraries: see own_copies.h. */
#include "firmware/fmu/own_copies.h"

#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <link.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/fmu/elf_file.h"
#include "firmware/fmu/elf_names.h"

/* A library of the FMU. */
typedef struct own_library {
    char *path;
    const char *name; /* the end of the path */
    uint8_t *bytes;   /* the file, shared: what is changed here is changed there */
    size_t size;
    tl_elf_file file;
} own_library;

/* One FMU. */
typedef struct making {
    const char *folder;
    const char *label;
    tl_error *error;
    char **folders; /* the FMU's, then those in it */
    size_t folder_count;
    own_library *libraries; /* the binary first */
    size_t library_count;
    tl_elf_rename *renames;
    size_t rename_count;
} making;

static bool is_below(const char *path, const char *folder) {
    size_t length = strlen(folder);
    return strncmp(path, folder, length) == 0 && path[length] == '/';
}

/* `path`: of a library, or the folder for all of them. */
static tl_status fail_system(const making *work, const char *path, const char *doing, int code) {
    const char *shown = is_below(path, work->folder) ? path + strlen(work->folder) + 1 : "in its folder";
    return tl_fail(work->error, TL_TRY_AGAIN,
                   "%s: its library %.120s cannot be %s: %s; free memory, descriptors or disk and try again",
                   work->label, shown, doing, strerror(code));
}

static tl_status fail_memory(const making *work) {
    return tl_fail(work->error, TL_TRY_AGAIN, "%s: out of memory; free some and try again", work->label);
}

/* One more element of an array that has `count`. NULL: no memory; the array stays. */
static void *grow(void *array, size_t count, size_t size) {
    return (count & (count - 1)) == 0 ? realloc(array, (count == 0 ? 1 : 2 * count) * size) : array;
}

/* ---- Folders of FMUs ----------------------------------------------------------------------------------- */

typedef struct fmu_folder {
    struct fmu_folder *next;
    char path[];
} fmu_folder;

/* Of all FMUs that the process has had. */
static fmu_folder *folders;

static bool remember(const char *path) {
    size_t size = strlen(path) + 1;
    fmu_folder *folder = malloc(sizeof *folder + size);
    if (folder == NULL) {
        return false;
    }
    memcpy(folder->path, path, size);
    folder->next = folders;
    folders = folder;
    return true;
}

static bool is_of_an_fmu(const char *path) {
    for (const fmu_folder *folder = folders; folder != NULL; folder = folder->next) {
        if (is_below(path, folder->path)) {
            return true;
        }
    }
    return false;
}

/* ---- Libraries of this one ------------------------------------------------------------------------------ */

static tl_status map_file(const making *work, int file, own_library *library) {
    struct stat about;
    if (fstat(file, &about) != 0 || !S_ISREG(about.st_mode) || about.st_size <= 0) {
        return TL_OK;
    }
    library->size = (size_t)about.st_size;
    void *bytes = mmap(NULL, library->size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (bytes == MAP_FAILED) {
        return fail_system(work, library->path, "read", errno);
    }
    library->bytes = bytes;
    return TL_OK;
}

static void forget_library(own_library *library) {
    if (library->bytes != NULL) {
        (void)munmap(library->bytes, library->size);
    }
    free(library->path);
}

/* A file that is no library of the binary's kind is left out. */
static tl_status add_library(making *work, const char *path) {
    own_library *grown = grow(work->libraries, work->library_count, sizeof *grown);
    if (grown == NULL) {
        return fail_memory(work);
    }
    work->libraries = grown;
    own_library *added = &grown[work->library_count];
    *added = (own_library){.path = strdup(path)};
    if (added->path == NULL) {
        return fail_memory(work);
    }
    added->name = strrchr(added->path, '/') + 1;
    int file = open(path, O_RDWR | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) {
        tl_status status = fail_system(work, path, "opened", errno);
        free(added->path);
        return status;
    }
    tl_status status = map_file(work, file, added);
    (void)close(file);
    const tl_elf_file *binary = &grown[0].file;
    if (status == TL_OK && added->bytes != NULL && tl_elf_open(&added->file, added->bytes, added->size) &&
        (work->library_count == 0 ||
         (added->file.machine == binary->machine && added->file.is_wide == binary->is_wide &&
          added->file.is_big == binary->is_big))) {
        work->library_count++;
    } else {
        forget_library(added);
    }
    return status;
}

static tl_status add_folder(making *work, const char *path) {
    char **grown = grow(work->folders, work->folder_count, sizeof *grown);
    if (grown == NULL) {
        return fail_memory(work);
    }
    work->folders = grown;
    grown[work->folder_count] = strdup(path);
    if (grown[work->folder_count] == NULL) {
        return fail_memory(work);
    }
    work->folder_count++;
    return TL_OK;
}

/* A folder is for later. Links are not followed. */
static tl_status add_entry(making *work, const char *folder, const char *name) {
    char path[PATH_MAX];
    struct stat about;
    if (strcmp(name, ".") == 0 || strcmp(name, "..") == 0) {
        return TL_OK;
    }
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path) {
        return fail_system(work, folder, "found", ENAMETOOLONG);
    }
    if (lstat(path, &about) != 0) {
        return fail_system(work, path, "found", errno);
    }
    if (S_ISDIR(about.st_mode)) {
        return add_folder(work, path);
    }
    bool is_other = strstr(name, ".so") != NULL && strcmp(path, work->libraries[0].path) != 0;
    return is_other && S_ISREG(about.st_mode) ? add_library(work, path) : TL_OK;
}

static tl_status look_into(making *work, const char *folder) {
    DIR *entries = opendir(folder);
    if (entries == NULL) {
        return fail_system(work, folder, "found", errno);
    }
    tl_status status = TL_OK;
    errno = 0;
    for (const struct dirent *entry = readdir(entries); entry != NULL && status == TL_OK;) {
        status = add_entry(work, folder, entry->d_name);
        errno = 0;
        entry = readdir(entries);
    }
    int code = errno;
    (void)closedir(entries);
    return status == TL_OK && code != 0 ? fail_system(work, folder, "found", code) : status;
}

/* All of the folder, wherever they are: an FMU may have some among its resources. */
static tl_status find_libraries(making *work, const char *binary) {
    tl_status status = add_library(work, binary);
    if (status != TL_OK || work->library_count == 0) {
        return status;
    }
    status = add_folder(work, work->folder);
    for (size_t i = 0; i < work->folder_count && status == TL_OK; i++) {
        status = look_into(work, work->folders[i]);
    }
    return status;
}

static const own_library *library_called(const making *work, const char *name) {
    for (size_t i = 0; i < work->library_count; i++) {
        if (strcmp(work->libraries[i].name, name) == 0) {
            return &work->libraries[i];
        }
    }
    return NULL;
}

/* ---- Names ---------------------------------------------------------------------------------------------- */

/* What the loader has by this name, or NULL. Nothing is loaded. */
static void *find_loaded(const char *name) {
    void *found = dlopen(name, RTLD_LAZY | RTLD_NOLOAD);
    (void)dlerror();
    return found;
}

/* The loader would take another FMU's library. */
static bool is_taken(const char *name) {
    struct link_map *map = NULL;
    void *found = find_loaded(name);
    if (found == NULL) {
        return false;
    }
    bool taken = dlinfo(found, RTLD_DI_LINKMAP, &map) == 0 && map != NULL && is_of_an_fmu(map->l_name);
    (void)dlclose(found);
    return taken;
}

/* One of those that are one for the whole process. */
static bool is_of_the_system(const char *name) {
    static const char *const known[] = {"libc.so",        "libm.so",        "libdl.so",     "librt.so",
                                        "libpthread.so",  "ld-linux",       "libgcc_s.so",  "libstdc++.so",
                                        "libgfortran.so", "libquadmath.so", "libatomic.so", "libgomp.so"};
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++) {
        if (strncmp(name, known[i], strlen(known[i])) == 0) {
            return true;
        }
    }
    return false;
}

static bool is_renamed(const making *work, const char *name) {
    for (size_t i = 0; i < work->rename_count; i++) {
        if (strcmp(work->renames[i].old_name, name) == 0 || strcmp(work->renames[i].new_name, name) == 0) {
            return true;
        }
    }
    return false;
}

/* Nobody has it: neither this FMU nor the loader. */
static bool is_free(const making *work, const char *name) {
    void *found = find_loaded(name);
    if (found != NULL) {
        (void)dlclose(found);
    }
    return found == NULL && library_called(work, name) == NULL && !is_renamed(work, name);
}

/* In place of its first characters a number that no library of the process has had: libtable.so becomes 001table.so. False: none is free. */
static bool find_name(const making *work, const char *name, char found[TL_ELF_LIBRARY]) {
    static const char digits[] = "0123456789abcdefghijklmnopqrstuvwxyz";
    enum { BASE = sizeof digits - 1, WIDTH = 3, MOST = BASE * BASE * BASE };
    static unsigned number;
    size_t length = strlen(name);
    size_t width = length < WIDTH ? length : WIDTH;
    (void)snprintf(found, TL_ELF_LIBRARY, "%s", name);
    for (unsigned tries = 0; tries < MOST; tries++) {
        number = (number + 1) % MOST;
        unsigned rest = number;
        for (size_t i = width; i > 0; i--) {
            found[i - 1] = digits[rest % BASE];
            rest /= BASE;
        }
        if (is_free(work, found)) {
            return true;
        }
    }
    return false;
}

static tl_status add_rename(making *work, const char *name) {
    tl_elf_rename *grown = grow(work->renames, work->rename_count, sizeof *grown);
    if (grown == NULL) {
        return fail_memory(work);
    }
    work->renames = grown;
    tl_elf_rename *added = &grown[work->rename_count];
    (void)snprintf(added->old_name, sizeof added->old_name, "%s", name);
    if (!find_name(work, name, added->new_name)) {
        return tl_fail(
            work->error, TL_BAD_DATA,
            "%s: another FMU has a library %.120s too, and no name is left for a copy; rename it in one of them",
            work->label, name);
    }
    work->rename_count++;
    return TL_OK;
}

/* One library's names. */
typedef struct looking {
    making *work;
    const tl_elf_file *file;
    tl_status status;
} looking;

/* It is not in the FMU, so there is nothing to make a copy of. */
static void warn_of_strange(const looking *look, const char *name) {
    tl_log(
        TL_LOG_WARNING,
        "%s needs %.120s, which is not in it: it gets that of another FMU, and both share its variables; export it with that library",
        look->work->label, name);
}

/* What it needs and would get from another FMU, of which it has one beside it. A name with a slash is a path, and so it is its own. */
static bool look_at(void *context, tl_elf_reference reference) {
    looking *look = context;
    const char *name = reference.kind == TL_ELF_NEEDED ? tl_elf_text(look->file, reference.offset) : NULL;
    if (name == NULL || name[0] == '\0' || strchr(name, '/') != NULL || is_renamed(look->work, name) ||
        is_of_the_system(name) || !is_taken(name)) {
        return true;
    }
    if (library_called(look->work, name) == NULL) {
        warn_of_strange(look, name);
        return true;
    }
    look->status = add_rename(look->work, name);
    return look->status == TL_OK;
}

static tl_status find_renames(making *work) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < work->library_count && status == TL_OK; i++) {
        looking look = {work, &work->libraries[i].file, TL_OK};
        tl_elf_visit(look.file, look_at, &look);
        status = look.status;
    }
    return status;
}

/* ---- Changing ------------------------------------------------------------------------------------------- */

static tl_status change_library(const making *work, own_library *library) {
    switch (tl_elf_rename_libraries(&library->file, work->renames, work->rename_count)) {
    case TL_ELF_NO_MEMORY:
        return fail_memory(work);
    case TL_ELF_CONFLICT:
        return tl_fail(
            work->error, TL_BAD_DATA,
            "%s: its libraries have names that another FMU's have, such as %.80s, and in %.80s another name is part of one of "
            "them, so that no copy can be made; rename the libraries of one of the FMUs",
            work->label, work->renames[0].old_name, library->name);
    case TL_ELF_DONE:
        break;
    }
    (void)tl_elf_part_unique(&library->file);
    return TL_OK;
}

static int write_all(int file, const uint8_t *bytes, size_t size) {
    for (size_t done = 0; done < size;) {
        ssize_t now = write(file, bytes + done, size - done);
        if (now < 0 && errno != EINTR) {
            return errno;
        }
        done += now > 0 ? (size_t)now : 0;
    }
    return 0;
}

/* Beside it, by its new name. */
static tl_status write_copy(const making *work, const own_library *library, const char *name) {
    char path[PATH_MAX];
    int length = snprintf(path, sizeof path, "%.*s%s", (int)(library->name - library->path), library->path, name);
    int file = length < (int)sizeof path
                   ? open(path, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, S_IRUSR | S_IWUSR | S_IXUSR)
                   : -1;
    int code = file < 0 ? errno : write_all(file, library->bytes, library->size);
    if (file >= 0 && close(file) != 0 && code == 0) {
        code = errno;
    }
    return code == 0 ? TL_OK : fail_system(work, library->path, "copied", code);
}

static tl_status change_all(making *work) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < work->library_count && status == TL_OK; i++) {
        status = change_library(work, &work->libraries[i]);
    }
    for (size_t i = 0; i < work->library_count && status == TL_OK; i++) {
        for (size_t k = 0; k < work->rename_count && status == TL_OK; k++) {
            if (strcmp(work->renames[k].old_name, work->libraries[i].name) == 0) {
                status = write_copy(work, &work->libraries[i], work->renames[k].new_name);
            }
        }
    }
    return status;
}

/* ---- What cannot be seen -------------------------------------------------------------------------------- */

/* Another FMU has had a library in the same place. */
static bool others_have(const making *work, const own_library *library) {
    char path[PATH_MAX];
    for (const fmu_folder *folder = folders; folder != NULL; folder = folder->next) {
        int length = snprintf(path, sizeof path, "%s%s", folder->path, library->path + strlen(work->folder));
        if (length < (int)sizeof path && access(path, F_OK) == 0) {
            return true;
        }
    }
    return false;
}

/* The binary itself does not count, as nobody opens it by a bare name. */
static void warn_of_opening(const making *work) {
    bool opens = false;
    for (size_t i = 0; i < work->library_count && !opens; i++) {
        opens = tl_elf_opens_libraries(&work->libraries[i].file);
    }
    for (size_t i = 1; i < work->library_count && opens; i++) {
        const own_library *library = &work->libraries[i];
        if (others_have(work, library)) {
            tl_log(
                TL_LOG_WARNING,
                "%s can open libraries while it runs (dlopen), and has a %.120s as another FMU has: if it opens that by its bare name, "
                "both share its variables",
                work->label, library->name);
            return;
        }
    }
}

/* ---- All of it ------------------------------------------------------------------------------------------ */

static tl_status make_copies(making *work, const char *binary) {
    tl_status status = find_libraries(work, binary);
    if (status == TL_OK) {
        status = find_renames(work);
    }
    if (status == TL_OK) {
        status = change_all(work);
    }
    if (status == TL_OK) {
        warn_of_opening(work);
    }
    return status;
}

tl_status tl_own_copies_make(const char *folder, const char *binary, const char *label, tl_error *error) {
    making work = {.folder = folder, .label = label, .error = error};
    tl_status status = folders == NULL ? TL_OK : make_copies(&work, binary);
    for (size_t i = 0; i < work.library_count; i++) {
        forget_library(&work.libraries[i]);
    }
    for (size_t i = 0; i < work.folder_count; i++) {
        free(work.folders[i]);
    }
    free(work.folders);
    free(work.libraries);
    free(work.renames);
    if (status == TL_OK && !remember(folder)) {
        return tl_fail(error, TL_TRY_AGAIN, "%s: out of memory; free some and try again", label);
    }
    return status;
}
