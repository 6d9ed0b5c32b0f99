/* Shim VFS: it handles calls that change a file, and passes all others to the VFS below.
 *
 * For a power cut, a list per file name has each change since the last sync with the bytes before
 * it. After the cut all changes are undone, the last one first. Then a random part of them is redone
 * in their order: these had reached the disk. */
#include "tests/support/faulty_vfs.h"

#include <assert.h>
#include <fcntl.h>
#include <pthread.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

/* One write (after != NULL) or truncation since the last sync. */
typedef struct change {
    struct change *earlier;
    int64_t offset; /* of the write; a truncation's new size */
    int64_t size;   /* of the file before it */
    size_t before_count;
    size_t after_count;
    unsigned char *before;
    unsigned char *after;
} change;

/* Exists also after the file is closed, because closing does not sync. */
typedef struct named_file {
    struct named_file *next;
    char *name;
    change *changes; /* the last one first */
} named_file;

typedef struct shim_file {
    sqlite3_file base;
    named_file *named; /* NULL: has no name, or no power cut is armed */
    sqlite3_file *real;
} shim_file;

static sqlite3_vfs *below;
static sqlite3_vfs shim;
static sqlite3_io_methods methods;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER; /* protects the following variables */
static named_file *named_files;
static bool armed;
static bool without_power;
static bool reading_only;
static int refusal;
static bool refusing_once;
static uint64_t writes_left;
static uint64_t refusals;
static uint64_t writes;
static uint64_t locked;
static int64_t delay;

/* ---- Faults ---- */

/* Returns the code with which an operation fails, or SQLITE_OK. `counts`: it is a write. */
static int fault(bool counts) {
    (void)pthread_mutex_lock(&lock);
    int code = SQLITE_OK;
    if (without_power) {
        code = SQLITE_IOERR_WRITE;
    } else if (refusal != SQLITE_OK && writes_left == 0) {
        code = refusal;
        refusal = refusing_once ? SQLITE_OK : refusal;
    } else if (refusal != SQLITE_OK && counts) {
        writes_left--;
    }
    refusals += code != SQLITE_OK ? 1 : 0;
    writes += counts && code == SQLITE_OK ? 1 : 0;
    struct timespec pause = {.tv_sec = (time_t)(delay / 1000000000), .tv_nsec = (long)(delay % 1000000000)};
    (void)pthread_mutex_unlock(&lock);
    if (counts && (pause.tv_sec > 0 || pause.tv_nsec > 0)) {
        (void)nanosleep(&pause, NULL);
    }
    return code;
}

static bool is_without_power(void) {
    (void)pthread_mutex_lock(&lock);
    bool off = without_power;
    (void)pthread_mutex_unlock(&lock);
    return off;
}

void tl_faulty_vfs_refuse(int code, uint64_t after) {
    (void)pthread_mutex_lock(&lock);
    refusal = code;
    refusing_once = false;
    writes_left = after;
    (void)pthread_mutex_unlock(&lock);
}

void tl_faulty_vfs_refuse_once(int code) {
    (void)pthread_mutex_lock(&lock);
    refusal = code;
    refusing_once = true;
    writes_left = 0;
    (void)pthread_mutex_unlock(&lock);
}

void tl_faulty_vfs_read_only(bool on) {
    (void)pthread_mutex_lock(&lock);
    reading_only = on;
    (void)pthread_mutex_unlock(&lock);
}

static uint64_t read_counter(const uint64_t *counter) {
    (void)pthread_mutex_lock(&lock);
    uint64_t value = *counter;
    (void)pthread_mutex_unlock(&lock);
    return value;
}

uint64_t tl_faulty_vfs_refusals(void) {
    return read_counter(&refusals);
}

uint64_t tl_faulty_vfs_writes(void) {
    return read_counter(&writes);
}

uint64_t tl_faulty_vfs_locked(void) {
    return read_counter(&locked);
}

static void count_one(uint64_t *counter) {
    (void)pthread_mutex_lock(&lock);
    (*counter)++;
    (void)pthread_mutex_unlock(&lock);
}

void tl_faulty_vfs_slow(int64_t nanoseconds) {
    (void)pthread_mutex_lock(&lock);
    delay = nanoseconds;
    (void)pthread_mutex_unlock(&lock);
}

/* ---- Changes since the last sync ---- */

static void *get_memory(size_t size) {
    void *memory = calloc(1, size == 0 ? 1 : size);
    if (memory == NULL) {
        abort();
    }
    return memory;
}

static void forget_changes(named_file *file) {
    while (file->changes != NULL) {
        change *last = file->changes;
        file->changes = last->earlier;
        free(last->before);
        free(last->after);
        free(last);
    }
}

/* Returns the entry of a file, and creates it if it does not exist. */
static named_file *find_file(const char *name) {
    (void)pthread_mutex_lock(&lock);
    named_file *file = named_files;
    while (file != NULL && strcmp(file->name, name) != 0) {
        file = file->next;
    }
    if (file == NULL) {
        file = get_memory(sizeof *file);
        file->name = strdup(name);
        file->next = named_files;
        named_files = file;
    }
    (void)pthread_mutex_unlock(&lock);
    return file;
}

/* Saves at most `count` bytes at `offset` before they are changed. */
static void remember(shim_file *file, int64_t offset, size_t count, const void *after, size_t after_count) {
    sqlite3_int64 size = 0;
    if (file->named == NULL || file->real->pMethods->xFileSize(file->real, &size) != SQLITE_OK) {
        return;
    }
    change *made = get_memory(sizeof *made);
    int64_t there = size > offset ? size - offset : 0;
    made->offset = offset;
    made->size = size;
    made->before_count = (size_t)there < count ? (size_t)there : count;
    made->before = get_memory(made->before_count);
    if (made->before_count > 0) {
        (void)file->real->pMethods->xRead(file->real, made->before, (int)made->before_count, offset);
    }
    if (after != NULL) {
        made->after = get_memory(after_count);
        made->after_count = after_count;
        memcpy(made->after, after, after_count);
    }
    (void)pthread_mutex_lock(&lock);
    made->earlier = file->named->changes;
    file->named->changes = made;
    (void)pthread_mutex_unlock(&lock);
}

void tl_faulty_vfs_arm_power_cut(void) {
    (void)pthread_mutex_lock(&lock);
    armed = true;
    (void)pthread_mutex_unlock(&lock);
}

void tl_faulty_vfs_cut_power(void) {
    (void)pthread_mutex_lock(&lock);
    without_power = true;
    (void)pthread_mutex_unlock(&lock);
}

static void write_at(int descriptor, const unsigned char *bytes, size_t count, int64_t offset) {
    if (pwrite(descriptor, bytes, count, (off_t)offset) != (ssize_t)count) {
        abort();
    }
}

static void undo(int descriptor, const change *made) {
    write_at(descriptor, made->before, made->before_count, made->offset);
    if (ftruncate(descriptor, (off_t)made->size) != 0) {
        abort();
    }
}

static void redo(int descriptor, const change *made) {
    if (made->after != NULL) {
        write_at(descriptor, made->after, made->after_count, made->offset);
    } else if (ftruncate(descriptor, (off_t)made->offset) != 0) {
        abort();
    }
}

/* A linear congruential generator (Knuth's MMIX constants): repeatable on every machine. */
static bool toss(uint64_t *state) {
    *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (*state >> 63) != 0;
}

/* From the first change to the last. */
static void redo_some(int descriptor, const change *last, uint64_t *state) {
    size_t count = 0;
    for (const change *made = last; made != NULL; made = made->earlier) {
        count++;
    }
    const change **in_order = get_memory(count * sizeof(const change *));
    for (const change *made = last; made != NULL; made = made->earlier) {
        in_order[--count] = made;
    }
    for (const change *made = last; made != NULL; made = made->earlier, count++) {
        if (toss(state)) {
            redo(descriptor, in_order[count]);
        }
    }
    free(in_order);
}

void tl_faulty_vfs_restore_power(uint64_t seed) {
    uint64_t state = seed;
    while (named_files != NULL) {
        named_file *file = named_files;
        int descriptor = open(file->name, O_RDWR | O_CLOEXEC);
        if (descriptor >= 0 && without_power) {
            for (const change *made = file->changes; made != NULL; made = made->earlier) {
                undo(descriptor, made);
            }
            redo_some(descriptor, file->changes, &state);
        }
        if (descriptor >= 0) {
            (void)close(descriptor);
        }
        named_files = file->next;
        forget_changes(file);
        free(file->name);
        free(file);
    }
    armed = false;
    without_power = false;
}

/* ---- Files ---- */

static shim_file *shim_of(sqlite3_file *file) {
    return (shim_file *)file;
}

static int shim_close(sqlite3_file *file) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods == NULL ? SQLITE_OK : real->pMethods->xClose(real);
}

static int shim_read(sqlite3_file *file, void *bytes, int count, sqlite3_int64 offset) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xRead(real, bytes, count, offset);
}

static int shim_write(sqlite3_file *file, const void *bytes, int count, sqlite3_int64 offset) {
    sqlite3_file *real = shim_of(file)->real;
    int code = fault(true);
    int possible = code == SQLITE_OK ? count : is_without_power() ? 0 : count / 2;
    if (possible > 0) {
        remember(shim_of(file), offset, (size_t)possible, bytes, (size_t)possible);
        int written = real->pMethods->xWrite(real, bytes, possible, offset);
        code = code == SQLITE_OK ? written : code;
    }
    return code;
}

static int shim_truncate(sqlite3_file *file, sqlite3_int64 size) {
    sqlite3_file *real = shim_of(file)->real;
    sqlite3_int64 before = 0;
    int code = fault(false);
    if (code != SQLITE_OK) {
        return code;
    }
    if (real->pMethods->xFileSize(real, &before) == SQLITE_OK && before > size) {
        remember(shim_of(file), size, (size_t)(before - size), NULL, 0);
    }
    return real->pMethods->xTruncate(real, size);
}

static int shim_sync(sqlite3_file *file, int flags) {
    sqlite3_file *real = shim_of(file)->real;
    int code = fault(false);
    if (code == SQLITE_OK && shim_of(file)->named != NULL) {
        (void)pthread_mutex_lock(&lock);
        forget_changes(shim_of(file)->named);
        (void)pthread_mutex_unlock(&lock);
    }
    return code == SQLITE_OK ? real->pMethods->xSync(real, flags) : code;
}

static int shim_file_size(sqlite3_file *file, sqlite3_int64 *size) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xFileSize(real, size);
}

static int shim_lock(sqlite3_file *file, int level) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xLock(real, level);
}

static int shim_unlock(sqlite3_file *file, int level) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xUnlock(real, level);
}

static int shim_check_reserved(sqlite3_file *file, int *reserved) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xCheckReservedLock(real, reserved);
}

static int shim_control(sqlite3_file *file, int operation, void *argument) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xFileControl(real, operation, argument);
}

static int shim_sector_size(sqlite3_file *file) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xSectorSize(real);
}

/* A write does not change other bytes of its sector, but it may be torn. */
static int shim_characteristics(sqlite3_file *file) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xDeviceCharacteristics(real) & SQLITE_IOCAP_POWERSAFE_OVERWRITE;
}

static int shim_shm_map(sqlite3_file *file, int page, int size, int extend, void volatile **memory) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xShmMap(real, page, size, extend, memory);
}

static int shim_shm_lock(sqlite3_file *file, int offset, int count, int flags) {
    sqlite3_file *real = shim_of(file)->real;
    int code = real->pMethods->xShmLock(real, offset, count, flags);
    if (code == SQLITE_BUSY) {
        count_one(&locked);
    }
    return code;
}

static void shim_shm_barrier(sqlite3_file *file) {
    sqlite3_file *real = shim_of(file)->real;
    real->pMethods->xShmBarrier(real);
}

static int shim_shm_unmap(sqlite3_file *file, int remove) {
    sqlite3_file *real = shim_of(file)->real;
    return real->pMethods->xShmUnmap(real, remove);
}

/* ---- The VFS ---- */

static int shim_open(sqlite3_vfs *vfs, const char *name, sqlite3_file *file, int flags, int *flags_out) {
    shim_file *opened = shim_of(file);
    (void)vfs;
    memset(opened, 0, sizeof *opened);
    opened->real = (sqlite3_file *)(opened + 1);
    (void)pthread_mutex_lock(&lock);
    bool read_only = reading_only;
    (void)pthread_mutex_unlock(&lock);
    if (read_only && (flags & SQLITE_OPEN_CREATE) != 0) {
        return SQLITE_CANTOPEN;
    }
    flags = read_only ? (flags & ~SQLITE_OPEN_READWRITE) | SQLITE_OPEN_READONLY : flags;
    int code = below->xOpen(below, name, opened->real, flags, flags_out);
    if (opened->real->pMethods != NULL) {
        opened->base.pMethods = &methods;
        opened->named = name != NULL && armed ? find_file(name) : NULL;
    }
    return code;
}

static int shim_delete(sqlite3_vfs *vfs, const char *name, int sync) {
    (void)vfs;
    if (is_without_power()) {
        return SQLITE_IOERR_DELETE;
    }
    if (armed) {
        named_file *file = find_file(name);
        (void)pthread_mutex_lock(&lock);
        forget_changes(file);
        (void)pthread_mutex_unlock(&lock);
    }
    return below->xDelete(below, name, sync);
}

void tl_faulty_vfs_install(void) {
    if (below != NULL) {
        return;
    }
    below = sqlite3_vfs_find(NULL);
    assert(below != NULL);
    shim = *below;
    shim.szOsFile = (int)sizeof(shim_file) + below->szOsFile;
    shim.zName = "faulty";
    shim.pNext = NULL;
    shim.xOpen = shim_open;
    shim.xDelete = shim_delete;
    methods = (sqlite3_io_methods){.iVersion = 2,
                                   .xClose = shim_close,
                                   .xRead = shim_read,
                                   .xWrite = shim_write,
                                   .xTruncate = shim_truncate,
                                   .xSync = shim_sync,
                                   .xFileSize = shim_file_size,
                                   .xLock = shim_lock,
                                   .xUnlock = shim_unlock,
                                   .xCheckReservedLock = shim_check_reserved,
                                   .xFileControl = shim_control,
                                   .xSectorSize = shim_sector_size,
                                   .xDeviceCharacteristics = shim_characteristics,
                                   .xShmMap = shim_shm_map,
                                   .xShmLock = shim_shm_lock,
                                   .xShmBarrier = shim_shm_barrier,
                                   .xShmUnmap = shim_shm_unmap};
    if (sqlite3_vfs_register(&shim, 1) != SQLITE_OK) {
        abort();
    }
}
