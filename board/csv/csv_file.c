/* Files of a recording: see csv_file.h. */
#include "board/csv/csv_file.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "board/csv/csv_table.h"

/* Bytes that are read at once. Two of them, a unit of UTF-16, become at most three of UTF-8; four,
 * if they complete a pair that began in the bytes before. */
enum { CHUNK = 16 * 1024, LONGEST = 3 * CHUNK / 2 + 1 };

typedef enum encoding { UNKNOWN, BYTES, UTF_16_LITTLE, UTF_16_BIG } encoding;

struct tl_csv_file {
    int descriptor; /* of a FIFO */
    gzFile regular; /* NULL: a FIFO */
    encoding encoding;
    uint32_t high;     /* first half of a surrogate pair whose second half was not read yet; 0: none */
    size_t begin, end; /* of the bytes that are not returned yet */
    unsigned char bytes[LONGEST];
};

/* ---- UTF-16 ---- */

static void put_point(tl_csv_file *file, uint32_t point) {
    static const unsigned char first[] = {0, 0xC0, 0xE0, 0xF0};
    const int more = point < 0x80 ? 0 : point < 0x800 ? 1 : point < 0x10000 ? 2 : 3;
    file->bytes[file->end++] = (unsigned char)(first[more] | (point >> (6 * more)));
    for (int i = more - 1; i >= 0; i--) {
        file->bytes[file->end++] = (unsigned char)(0x80 | ((point >> (6 * i)) & 0x3F));
    }
}

/* Joins the halves of a pair. An unpaired second half becomes '?', an unpaired first half is
 * dropped. */
static void decode(tl_csv_file *file, const unsigned char *raw, size_t size) {
    for (size_t i = 0; i + 1 < size; i += 2) {
        const size_t low = file->encoding == UTF_16_BIG ? 1 : 0;
        const uint32_t unit = (uint32_t)raw[i + 1 - low] << 8 | raw[i + low];
        const bool is_first = (unit & 0xFC00) == 0xD800;
        const bool is_second = (unit & 0xFC00) == 0xDC00;
        if (!is_first) {
            put_point(file, !is_second        ? unit
                            : file->high == 0 ? '?'
                                              : 0x10000 + ((file->high & 0x3FF) << 10 | (unit & 0x3FF)));
        }
        file->high = is_first ? unit : 0;
    }
}

/* ---- files ---- */

tl_status tl_csv_file_open(const char *path, tl_csv_file **file, tl_error *error) {
    if (tl_csv_is_device(path)) {
        return tl_fail(error, TL_BAD_DATA, "%s: this is a device (expected a file or a FIFO)", path);
    }
    const int descriptor = open(path, O_RDONLY | O_CLOEXEC);
    if (descriptor < 0) {
        const bool is_short = errno == EMFILE || errno == ENFILE || errno == ENOMEM;
        return tl_fail(error, is_short ? TL_TRY_AGAIN : TL_BAD_DATA, "%s: cannot be opened: %s", path, strerror(errno));
    }
    struct stat about;
    const bool is_regular = fstat(descriptor, &about) == 0 && S_ISREG(about.st_mode) != 0;
    tl_csv_file *opened = calloc(1, sizeof *opened);
    if (opened != NULL) {
        opened->descriptor = descriptor;
        opened->regular = is_regular ? gzdopen(descriptor, "rb") : NULL;
    }
    if (opened == NULL || (is_regular && opened->regular == NULL)) {
        free(opened);
        (void)close(descriptor);
        return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", path);
    }
    *file = opened;
    return TL_OK;
}

/* Reads without decoding UTF-16. Regular files have fewer than CHUNK bytes only at their end. */
static tl_status read_bytes(tl_csv_file *file, const char *path, unsigned char raw[CHUNK], size_t *count,
                            tl_error *error) {
    int problem = Z_OK;
    ssize_t size = -1;
    do {
        errno = 0;
        size = file->regular != NULL ? gzread(file->regular, raw, CHUNK) : read(file->descriptor, raw, CHUNK);
    } while (size < 0 && errno == EINTR);
    if (size <= 0 && file->regular != NULL) {
        (void)gzerror(file->regular, &problem);
    }
    if (problem == Z_DATA_ERROR || problem == Z_BUF_ERROR) {
        return tl_fail(error, TL_BAD_DATA, "%s: its compressed data is %s: compress or copy it again", path,
                       problem == Z_DATA_ERROR ? "damaged" : "incomplete");
    }
    if (size < 0 || problem != Z_OK) {
        return tl_fail(error, TL_BAD_DATA, "%s: cannot be read: %s", path, strerror(errno));
    }
    *count = (size_t)size;
    return TL_OK;
}

static tl_status fill(tl_csv_file *file, const char *path, tl_error *error) {
    unsigned char raw[CHUNK];
    size_t count = 0;
    size_t mark = 0;
    const tl_status status = read_bytes(file, path, raw, &count, error);
    if (status == TL_OK && file->encoding == UNKNOWN) {
        const bool has_mark = file->regular != NULL && count >= 2 && (raw[0] ^ raw[1]) == 1 && raw[0] >= 0xFE;
        mark = has_mark ? 2 : 0;
        file->encoding = !has_mark ? BYTES : raw[0] == 0xFE ? UTF_16_BIG : UTF_16_LITTLE;
    }
    file->begin = 0;
    file->end = 0;
    if (status == TL_OK && file->encoding == BYTES) {
        memcpy(file->bytes, raw, count);
        file->end = count;
    } else if (status == TL_OK) {
        decode(file, raw + mark, count - mark);
    }
    return status;
}

tl_status tl_csv_file_read(tl_csv_file *file, const char *path, char *bytes, size_t room, size_t *count,
                           tl_error *error) {
    const tl_status status = file->begin < file->end ? TL_OK : fill(file, path, error);
    *count = status == TL_OK ? file->end - file->begin : 0;
    *count = *count < room ? *count : room;
    memcpy(bytes, file->bytes + file->begin, *count);
    file->begin += *count;
    return status;
}

bool tl_csv_file_is_regular(const tl_csv_file *file) {
    return file->regular != NULL;
}

const char *tl_csv_file_form(const tl_csv_file *file) {
    const bool is_wide = file->encoding == UTF_16_LITTLE || file->encoding == UTF_16_BIG;
    const bool is_compressed = file->regular != NULL && gzdirect(file->regular) == 0;
    return is_compressed ? (is_wide ? "gzip, UTF-16" : "gzip") : is_wide ? "UTF-16" : "";
}

void tl_csv_file_close(tl_csv_file *file) {
    if (file != NULL && file->regular != NULL) {
        (void)gzclose_r(file->regular);
    } else if (file != NULL) {
        (void)close(file->descriptor);
    }
    free(file);
}

/* ---- folders ---- */

static int is_shown(const struct dirent *entry) {
    return entry->d_name[0] != '.';
}

tl_status tl_csv_file_list(const char *path, char ***paths, size_t *count, tl_error *error) {
    struct dirent **entries = NULL;
    const int found = scandir(path, &entries, is_shown, versionsort); /* < 0: no folder */
    if (found == 0) {
        free(entries);
        return tl_fail(error, TL_BAD_DATA, "%s: the directory has no files (expected those of a recording)", path);
    }
    *count = found > 0 ? (size_t)found : 1;
    *paths = calloc(*count, sizeof **paths);
    bool is_whole = *paths != NULL;
    for (size_t i = 0; i < *count; i++) {
        char *joined = NULL;
        const char *name = found > 0 ? entries[i]->d_name : "";
        is_whole = is_whole && asprintf(&joined, "%s%s%s", path, found > 0 ? "/" : "", name) > 0;
        if (is_whole) {
            (*paths)[i] = joined;
        }
        free(found > 0 ? entries[i] : NULL);
    }
    free(entries);
    return is_whole ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory", path);
}

void tl_csv_file_list_free(char **paths, size_t count) {
    for (size_t i = 0; paths != NULL && i < count; i++) {
        free(paths[i]);
    }
    free(paths);
}
