/* Unpacks a ZIP file into a folder. The path of an entry is validated first. Then its folders are
 * opened one by one from the root's descriptor without following links. So neither a name nor a
 * link from an earlier entry can lead outside of the folder. */
#include "firmware/fmu/fmu_archive.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#include "firmware/base/os.h"
#include "firmware/base/text.h"

enum { BUFFER = 64 * 1024, NAME_SHOWN = 120, LINK_PATH = 2 * TL_FMU_ENTRY_PATH + 2 };

typedef struct unpacking {
    const char *label;
    zip_t *zip;
    uint64_t file_bytes;
    uint64_t written; /* bytes of all entries so far */
    int root;         /* descriptor of the target folder */
    char *buffer;     /* of BUFFER bytes */
    tl_error *error;
} unpacking;

/* ---- Paths ----------------------------------------------------------------------------------- */

static tl_status reject_entry(const unpacking *work, const char *name, const char *reason) {
    char shown[NAME_SHOWN + 1];
    (void)tl_clean_text(name, strlen(name), shown, sizeof shown);
    return tl_fail(work->error, TL_BAD_DATA,
                   "%s: entry \"%s\" is rejected: %s; the FMU is damaged or malicious: export it again", work->label,
                   shown, reason);
}

/* Returns why a path is rejected; NULL: it is valid. */
static const char *path_fault(const char *name) {
    size_t length = strlen(name);
    if (length == 0 || length > TL_FMU_ENTRY_PATH) {
        return length == 0 ? "it has no name" : "its path is longer than 1024 bytes";
    }
    if (name[0] == '/' || name[0] == '\\' || name[1] == ':') {
        return "its path is absolute";
    }
    for (const char *c = name; *c != '\0'; c++) {
        if ((unsigned char)*c < ' ' || *c == '\x7f') {
            return "there are control characters in its name";
        }
    }
    return NULL;
}

/* Yields `name` with slashes, without "." and empty parts. It ends with a slash if it is a folder.
 */
static tl_status safe_path(const unpacking *work, const char *name, char path[TL_FMU_ENTRY_PATH + 2]) {
    const char *fault = path_fault(name);
    if (fault != NULL) {
        return reject_entry(work, name, fault);
    }
    char copy[TL_FMU_ENTRY_PATH + 1];
    char *rest = NULL;
    size_t end = 0;
    int depth = 0;
    (void)snprintf(copy, sizeof copy, "%s", name);
    const char *last = copy + strlen(copy) - 1;
    last -= *last == '.' && last != copy ? 1 : 0; /* "a/." means the folder a */
    bool is_folder = strchr("/\\", *last) != NULL;
    for (const char *part = strtok_r(copy, "/\\", &rest); part != NULL; part = strtok_r(NULL, "/\\", &rest)) {
        size_t length = strlen(part);
        if (strcmp(part, ".") == 0) {
            continue;
        }
        if (strcmp(part, "..") == 0) {
            return reject_entry(work, name, "its path leaves the FMU (\"..\")");
        }
        if (length > NAME_MAX || depth == TL_FMU_ENTRY_DEPTH) {
            return reject_entry(work, name,
                                length > NAME_MAX ? "a part of its path is longer than 255 bytes"
                                                  : "it is in more than 64 nested folders");
        }
        memcpy(path + end, part, length);
        end += length;
        path[end++] = '/';
        depth++;
    }
    path[is_folder || end == 0 ? end : end - 1] = '\0';
    return TL_OK;
}

/* ---- One entry ------------------------------------------------------------------------------- */

static tl_status fail_system(const unpacking *work, const char *path, const char *doing, int code) {
    if (code == EEXIST || code == ENOTDIR || code == ELOOP || code == EISDIR) {
        return reject_entry(work, path, "another entry has the same name");
    }
    return tl_fail(work->error, TL_TRY_AGAIN, "%s: entry \"%.*s\" cannot be %s: %s; %s", work->label, NAME_SHOWN, path,
                   doing, strerror(code),
                   code == EMFILE || code == ENFILE ? "raise the limit of open files (ulimit -n)"
                                                    : "free space, or set TMPDIR to a folder with more");
}

/* Creates all folders of a validated path and opens the last one. *last: the remaining file name;
 * "" if the path is a folder. Returns a descriptor or −errno. */
static int open_folders(int root, const char *path, const char **last) {
    int folder = dup(root);
    const char *slash = strchr(path, '/');
    while (folder >= 0 && slash != NULL) {
        char name[NAME_MAX + 1];
        size_t length = (size_t)(slash - path);
        memcpy(name, path, length);
        name[length] = '\0';
        int inner = -1;
        if (mkdirat(folder, name, 0700) == 0 || errno == EEXIST) {
            inner = openat(folder, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
        }
        int code = errno;
        (void)close(folder);
        errno = code;
        folder = inner;
        path = slash + 1;
        slash = strchr(path, '/');
    }
    *last = path;
    return folder >= 0 ? folder : -errno;
}

static tl_status count_bytes(unpacking *work, const char *path, uint64_t entry, uint64_t more) {
    work->written += more;
    if (entry > TL_FMU_ENTRY_BYTES) {
        return reject_entry(work, path, "it unpacks to more than 512 MiB");
    }
    if (work->written > TL_FMU_TOTAL_BYTES) {
        return reject_entry(work, path, "with it, the FMU unpacks to more than 1 GiB");
    }
    if (work->written > TL_FMU_RATIO_FROM_BYTES && work->written / TL_FMU_RATIO > work->file_bytes) {
        return reject_entry(work, path,
                            "with it, the FMU unpacks to more than 200 times its size, as compression bombs do");
    }
    return TL_OK;
}

/* These errors are not the fault of the archive: libzip opens the file again, which may fail. */
static tl_status zip_status(int code) {
    return code == ZIP_ER_MEMORY || code == ZIP_ER_OPEN || code == ZIP_ER_READ ? TL_TRY_AGAIN : TL_BAD_DATA;
}

static tl_status fail_zip(const unpacking *work, const char *path, zip_error_t *problem) {
    tl_status status = zip_status(zip_error_code_zip(problem));
    return tl_fail(work->error, status, "%s: entry \"%.*s\" cannot be unpacked: %s; copy or export the FMU again",
                   work->label, NAME_SHOWN, path, zip_error_strerror(problem));
}

/* Reads all of a short entry as a text. Returns false if it is longer, or cannot be read. */
static bool read_short(const unpacking *work, zip_uint64_t index, char *text, size_t size) {
    zip_file_t *entry = zip_fopen_index(work->zip, index, 0);
    zip_int64_t got = entry != NULL ? zip_fread(entry, text, size) : -1;
    if (entry != NULL) {
        (void)zip_fclose(entry);
    }
    if (got <= 0 || (size_t)got >= size) {
        return false;
    }
    text[got] = '\0';
    return strlen(text) == (size_t)got;
}

static tl_status copy_entry(unpacking *work, zip_uint64_t index, const char *path, int file) {
    zip_file_t *entry = zip_fopen_index(work->zip, index, 0);
    if (entry == NULL) {
        return fail_zip(work, path, zip_get_error(work->zip));
    }
    tl_status status = TL_OK;
    uint64_t bytes = 0;
    zip_int64_t got = 0;
    do {
        got = zip_fread(entry, work->buffer, BUFFER);
        if (got > 0) {
            bytes += (uint64_t)got;
            status = count_bytes(work, path, bytes, (uint64_t)got);
            if (status == TL_OK && !tl_file_bytes_write(file, work->buffer, (size_t)got)) {
                status = fail_system(work, path, "written", errno);
            }
        } else if (got < 0) {
            status = fail_zip(work, path, zip_file_get_error(entry));
        }
    } while (got > 0 && status == TL_OK);
    (void)zip_fclose(entry);
    return status;
}

static bool begins_with(const char *text, const char *prefix) {
    return strncmp(text, prefix, strlen(prefix)) == 0;
}

static bool is_skipped(const char *path) {
    return begins_with(path, "documentation/") || begins_with(path, "sources/") || begins_with(path, "binaries/win") ||
           begins_with(path, "binaries/darwin");
}

/* Creates the file or folder of a validated path. */
static tl_status write_entry(unpacking *work, zip_uint64_t index, const char *path, mode_t mode) {
    const char *name;
    int folder = open_folders(work->root, path, &name);
    if (folder < 0) {
        return fail_system(work, path, "created", -folder);
    }
    tl_status status = TL_OK;
    if (name[0] != '\0' && !is_skipped(path)) {
        int file = openat(folder, name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, mode);
        if (file < 0) {
            status = fail_system(work, path, "created", errno);
        } else {
            status = copy_entry(work, index, path, file);
            if (close(file) != 0 && status == TL_OK) {
                status = fail_system(work, path, "written", errno);
            }
        }
    }
    (void)close(folder);
    return status;
}

/* Returns 0 if the archive was made on a system without Unix modes. */
static uint32_t unix_mode_of(const unpacking *work, zip_uint64_t index) {
    zip_uint8_t system = 0;
    zip_uint32_t attributes = 0;
    (void)zip_file_get_external_attributes(work->zip, index, 0, &system, &attributes);
    return attributes >> 16;
}

static bool is_link(const unpacking *work, zip_uint64_t index) {
    return (unix_mode_of(work, index) & (uint32_t)S_IFMT) == (uint32_t)S_IFLNK;
}

/* Resolves the target of a link at `path` within the archive: "a/b/link" and "../c" give "a/c". No
 * folder of the archive is a link, so this is exact. Returns why it is rejected, or NULL. */
static const char *resolve_link(const char *path, const char *target, char result[LINK_PATH]) {
    char copy[TL_FMU_ENTRY_PATH + 1];
    char *rest = NULL;
    if (target[0] == '/') {
        return "it is a symbolic link to an absolute path";
    }
    const char *name = strrchr(path, '/');
    size_t end = name != NULL ? (size_t)(name - path) : 0; /* of the folder, without a slash */
    memcpy(result, path, end);
    (void)snprintf(copy, sizeof copy, "%s", target);
    for (const char *part = strtok_r(copy, "/", &rest); part != NULL; part = strtok_r(NULL, "/", &rest)) {
        if (strcmp(part, "..") == 0 && end == 0) {
            return "it is a symbolic link that leads out of the FMU";
        }
        if (strcmp(part, "..") == 0) {
            while (end > 0 && result[--end] != '/') {
            }
        } else if (strcmp(part, ".") != 0) {
            end += (size_t)snprintf(result + end, LINK_PATH - end, "%s%s", end > 0 ? "/" : "", part);
        }
    }
    result[end] = '\0';
    return NULL;
}

/* Follows symbolic links from *index to the entry whose content they stand for. Such links are
 * usual between the versions of a library. Only names of the archive are looked up. */
static tl_status follow_links(const unpacking *work, const char *path, zip_uint64_t *index) {
    char from[LINK_PATH];
    char to[LINK_PATH];
    char target[TL_FMU_ENTRY_PATH + 1];
    const char *fault = NULL;
    (void)snprintf(from, sizeof from, "%s", path);
    for (int links = 0; is_link(work, *index) && fault == NULL; links++) {
        zip_int64_t found = -1;
        if (links == TL_FMU_LINKS || !read_short(work, *index, target, sizeof target)) {
            fault = "it is a symbolic link that cannot be followed";
        } else {
            fault = resolve_link(from, target, to);
        }
        if (fault == NULL) {
            found = zip_name_locate(work->zip, to, 0);
            fault = found < 0 ? "it is a symbolic link to no file of the FMU; pack it without links (zip -r, not -ry)"
                              : NULL;
        }
        if (fault == NULL) {
            *index = (zip_uint64_t)found;
            memcpy(from, to, sizeof from);
            fault = strlen(from) > TL_FMU_ENTRY_PATH ? "it is a symbolic link to a path longer than 1024 bytes" : NULL;
        }
    }
    return fault != NULL ? reject_entry(work, path, fault) : TL_OK;
}

/* Rejects an entry if its Unix mode is neither that of a file nor of a folder; other systems leave
 * the mode 0. Also rejects it if it is encrypted or if FMI does not allow its compression. *mode:
 * for open(). */
static tl_status check_entry(const unpacking *work, zip_uint64_t index, const char *name, mode_t *mode) {
    zip_stat_t facts;
    const char *fault = NULL;
    uint32_t unix_mode = unix_mode_of(work, index);
    uint32_t kind = unix_mode & (uint32_t)S_IFMT;
    *mode = (unix_mode & 0111U) != 0 ? 0700 : 0600;
    zip_stat_init(&facts);
    if (zip_stat_index(work->zip, index, 0, &facts) != 0) {
        return fail_zip(work, name, zip_get_error(work->zip));
    }
    if (kind != 0 && kind != (uint32_t)S_IFREG && kind != (uint32_t)S_IFDIR) {
        fault = "it is neither a file nor a folder";
    } else if ((facts.valid & ZIP_STAT_ENCRYPTION_METHOD) != 0 && facts.encryption_method != ZIP_EM_NONE) {
        fault = "it is encrypted";
    } else if ((facts.valid & ZIP_STAT_COMP_METHOD) != 0 && facts.comp_method != ZIP_CM_STORE &&
               facts.comp_method != ZIP_CM_DEFLATE) {
        fault = "its compression is neither \"stored\" nor \"deflated\", as FMI requires";
    }
    return fault != NULL ? reject_entry(work, name, fault) : TL_OK;
}

static tl_status unpack_entry(unpacking *work, zip_uint64_t index) {
    char path[TL_FMU_ENTRY_PATH + 2] = "";
    mode_t mode = 0600;
    const char *name = zip_get_name(work->zip, index, 0);
    if (name == NULL) {
        return fail_zip(work, "?", zip_get_error(work->zip));
    }
    tl_status status = safe_path(work, name, path);
    if (status == TL_OK && !is_skipped(path)) {
        status = follow_links(work, path, &index);
    }
    if (status == TL_OK && !(is_skipped(path) && is_link(work, index))) {
        status = check_entry(work, index, name, &mode);
    }
    return status == TL_OK ? write_entry(work, index, path, mode) : status;
}

/* ---- The archive ----------------------------------------------------------------------------- */

static tl_status unpack_all(unpacking *work) {
    zip_int64_t count = zip_get_num_entries(work->zip, 0);
    if (count > TL_FMU_ENTRIES) {
        return tl_fail(work->error, TL_BAD_DATA,
                       "%s: the archive has %lld entries, more than the limit of %d: this is not an FMU", work->label,
                       (long long)count, (int)TL_FMU_ENTRIES);
    }
    work->buffer = malloc(BUFFER);
    if (work->buffer == NULL) {
        return tl_fail(work->error, TL_TRY_AGAIN, "%s: not enough memory; free memory and try again", work->label);
    }
    tl_status status = TL_OK;
    for (zip_int64_t i = 0; i < count && status == TL_OK; i++) {
        status = unpack_entry(work, (zip_uint64_t)i);
    }
    free(work->buffer);
    return status;
}

/* Opens a regular file for reading. `opened` is duplicated, because its owner may need it again. */
static tl_status open_file(const char *path, int opened, unpacking *work, int *file) {
    struct stat status;
    *file = opened >= 0 ? fcntl(opened, F_DUPFD_CLOEXEC, 0) : open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (*file < 0) {
        int code = errno;
        return tl_fail(work->error, tl_shortage_is(code) ? TL_TRY_AGAIN : TL_BAD_DATA, "%s: cannot be opened: %s",
                       work->label, strerror(code));
    }
    const char *fault = NULL;
    if (fstat(*file, &status) != 0 || !S_ISREG(status.st_mode)) {
        fault = "is not a file; give the .fmu file itself, not an unpacked one";
    } else if (status.st_size > TL_FMU_FILE_BYTES) {
        fault = "is larger than 1 GiB: this is not an FMU";
    }
    if (fault != NULL) {
        (void)close(*file);
        return tl_fail(work->error, TL_BAD_DATA, "%s: %s", work->label, fault);
    }
    work->file_bytes = (uint64_t)status.st_size;
    return TL_OK;
}

static tl_status open_zip(const char *path, int opened, unpacking *work) {
    int file = -1;
    tl_status status = open_file(path, opened, work, &file);
    if (status != TL_OK) {
        return status;
    }
    int code = ZIP_ER_OK;
    work->zip = zip_fdopen(file, 0, &code);
    if (work->zip == NULL) {
        zip_error_t problem;
        zip_error_init_with_code(&problem, code);
        status = zip_status(code);
        (void)tl_fail(work->error, status,
                      status == TL_BAD_DATA ? "%s: not a readable ZIP archive: %s; copy or export the FMU again"
                                            : "%s: cannot be read: %s; free memory or descriptors and try again",
                      work->label, zip_error_strerror(&problem));
        zip_error_fini(&problem);
        (void)close(file);
        return status;
    }
    return TL_OK; /* libzip owns the descriptor now */
}

tl_status tl_fmu_archive_unpack(const char *path, int opened, const char *label, tl_private_folder *folder,
                                tl_error *error) {
    unpacking work = {.label = label, .error = error};
    *folder = (tl_private_folder){.descriptor = -1};
    tl_status status = open_zip(path, opened, &work);
    if (status != TL_OK) {
        return status;
    }
    tl_error cause;
    status = tl_private_folder_make("fmu", 0, folder, &cause);
    if (status == TL_OK) {
        work.root = folder->descriptor;
        status = unpack_all(&work);
    } else {
        (void)tl_fail(error, status, "%s: %s", label, cause.text);
    }
    zip_discard(work.zip);
    if (status != TL_OK) {
        tl_private_folder_remove(folder);
    }
    return status;
}
