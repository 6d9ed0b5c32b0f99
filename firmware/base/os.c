/* Operating system: see os.h. */
#include "firmware/base/os.h"

#include <assert.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <locale.h>
#include <malloc.h>
#include <netinet/in.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "master/base/text.h"

/* ---- c locale ---- */

static pthread_once_t once = PTHREAD_ONCE_INIT;
static locale_t ours;

/* newlocale() returns a constant of the C library for "C", so it cannot fail, and nothing leaks if
 * the second call does. */
static void make(void) {
    locale_t plain = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    locale_t with_utf8 = newlocale(LC_CTYPE_MASK, "C.UTF-8", plain);
    ours = with_utf8 != (locale_t)0 ? with_utf8 : plain;
}

void tl_locale_use(void) {
    (void)pthread_once(&once, make);
    (void)uselocale(ours);
}

/* ---- clock ---- */

tl_time tl_clock_now(void *context) {
    (void)context;
    struct timespec now;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    return (tl_time)now.tv_sec * TL_SECOND + now.tv_nsec;
}

void tl_clock_sleep_until(tl_time instant) {
    struct timespec until = {.tv_sec = (time_t)(instant / TL_SECOND), .tv_nsec = (long)(instant % TL_SECOND)};
    (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
}

/* ---- heap ---- */

size_t tl_heap_used(void) {
    struct mallinfo2 heap = mallinfo2();
    return heap.uordblks + heap.hblkhd;
}

void *tl_array_grown(void *array, size_t count, size_t size) {
    return (count & (count - 1)) == 0 ? realloc(array, (count == 0 ? 1 : 2 * count) * size) : array;
}

/* ---- shortages ---- */

static const int codes[] = {EMFILE, ENFILE, ENOMEM, ENOSPC, EDQUOT};

enum { CODES = sizeof codes / sizeof codes[0] };

bool tl_shortage_is(int code) {
    for (size_t i = 0; i < CODES; i++) {
        if (code == codes[i]) {
            return true;
        }
    }
    return false;
}

bool tl_shortage_is_reported(const char *sentence) {
    for (size_t i = 0; i < CODES; i++) {
        if (strstr(sentence, strerror(codes[i])) != NULL) {
            return true;
        }
    }
    return false;
}

/* ---- bytes of an open file ---- */

ssize_t tl_file_bytes_read(int file, char *bytes, size_t room) {
    size_t size = 0;
    while (size < room) {
        ssize_t got = read(file, bytes + size, room - size);
        if (got < 0 && errno != EINTR) {
            return -1;
        }
        if (got == 0) {
            break;
        }
        size += got > 0 ? (size_t)got : 0;
    }
    return (ssize_t)size;
}

char *tl_file_text_take(int file, size_t most, size_t *size) {
    if (file < 0) {
        return NULL;
    }
    char *text = malloc(most + 1);
    ssize_t got = text == NULL ? -1 : tl_file_bytes_read(file, text, most + 1);
    bool is_whole = got >= 0 && (size_t)got <= most;
    int code = got < 0 ? errno : EFBIG;
    (void)close(file);
    if (!is_whole) {
        free(text);
        errno = code;
        return NULL;
    }
    text[got] = '\0';
    *size = (size_t)got;
    return text;
}

bool tl_file_bytes_write(int file, const void *bytes, size_t size) {
    const char *rest = bytes;
    while (size > 0) {
        ssize_t written = write(file, rest, size);
        if (written < 0 && errno != EINTR) {
            return false;
        }
        rest += written > 0 ? written : 0;
        size -= written > 0 ? (size_t)written : 0;
    }
    return true;
}

/* ---- new file ---- */

bool tl_new_file_would_replace(const char *path, const char *other) {
    struct stat first;
    struct stat second;
    return strcmp(path, other) == 0 || (stat(path, &first) == 0 && stat(other, &second) == 0 &&
                                        first.st_dev == second.st_dev && first.st_ino == second.st_ino);
}

/* Resolves the final path and its mode: that of an existing file, or the default of a new one. */
static tl_status resolve_path(const char *given, char path[PATH_MAX], mode_t *mode, tl_error *error) {
    struct stat file;
    if (given[0] == '\0') {
        return tl_fail(error, TL_BAD_USAGE, "the name of the file is empty: give one, for example report.html");
    }
    if (strcmp(given, "-") == 0) {
        return tl_fail(error, TL_BAD_USAGE,
                       "\"-\": standard output is not possible here: give the name of a file, for example report.html");
    }
    if (realpath(given, path) != NULL && stat(path, &file) == 0) {
        *mode = file.st_mode & 0777;
        return S_ISREG(file.st_mode)
                   ? TL_OK
                   : tl_fail(error, TL_BAD_DATA,
                             "%.300s: not written, because it exists and is not a regular file: give another name",
                             given);
    }
    if (lstat(given, &file) == 0) {
        return tl_fail(error, TL_BAD_DATA,
                       "%.300s: not written, because it is a symbolic link to a missing file: give another name",
                       given);
    }
    mode_t mask = umask(0);
    (void)umask(mask);
    *mode = 0666 & ~mask;
    return snprintf(path, PATH_MAX, "%s", given) < PATH_MAX
               ? TL_OK
               : tl_fail(error, TL_TRY_AGAIN, "%.300s…: the name is too long: give a shorter one", given);
}

tl_status tl_new_file_open(const char *path, tl_new_file *new_file, tl_error *error) {
    mode_t mode = 0;
    *new_file = (tl_new_file){0};
    tl_status status = resolve_path(path, new_file->path, &mode, error);
    if (status != TL_OK) {
        return status;
    }
    bool fits = snprintf(new_file->name, PATH_MAX, "%s.new-XXXXXX", new_file->path) < PATH_MAX;
    int opened = fits ? mkostemp(new_file->name, O_CLOEXEC) : -1;
    if (opened < 0) {
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be written: %s%s", path,
                       strerror(fits ? errno : ENAMETOOLONG),
                       errno == ENOENT ? ": create its folder, or give another name" : "");
    }
    (void)fchmod(opened, mode);
    new_file->file = fdopen(opened, "w");
    if (new_file->file == NULL) {
        status = tl_fail(error, TL_TRY_AGAIN, "%.300s: cannot be written: %s", path, strerror(errno));
        (void)close(opened);
        (void)unlink(new_file->name);
    }
    return status;
}

void tl_folder_sync(const char *path) {
    char folder[PATH_MAX];
    (void)snprintf(folder, sizeof folder, "%s", path);
    int opened = open(dirname(folder), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (opened >= 0) {
        (void)fsync(opened);
        (void)close(opened);
    }
}

tl_status tl_new_file_keep(tl_new_file *new_file, tl_error *error) {
    FILE *file = new_file->file;
    bool failed = ferror(file) != 0;
    errno = failed ? EIO : 0; /* error of an earlier write, if no later call fails */
    failed = fflush(file) != 0 || failed;
    failed = fsync(fileno(file)) != 0 || failed;
    failed = fclose(file) != 0 || failed;
    int cause = errno;
    new_file->file = NULL;
    if (failed) {
        (void)unlink(new_file->name);
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: not written completely, and removed: %s", new_file->path,
                       strerror(cause));
    }
    if (rename(new_file->name, new_file->path) != 0) {
        cause = errno;
        (void)unlink(new_file->name);
        return tl_fail(error, TL_TRY_AGAIN, "%.300s: the new file cannot be renamed to this name: %s", new_file->path,
                       strerror(cause));
    }
    tl_folder_sync(new_file->path);
    return TL_OK;
}

void tl_new_file_discard(tl_new_file *new_file) {
    if (new_file->file != NULL) {
        (void)fclose(new_file->file);
        (void)unlink(new_file->name);
    }
    new_file->file = NULL;
}

/* ---- listening ---- */

int tl_tcp_listen(const struct sockaddr *address, size_t size, int backlog, uint16_t *port) {
    struct sockaddr_in6 own = {.sin6_port = 0};
    socklen_t own_size = sizeof own;
    int on = 1;
    int made = socket(address->sa_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (made < 0 || setsockopt(made, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
        setsockopt(made, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on) != 0 || bind(made, address, (socklen_t)size) != 0 ||
        listen(made, backlog) != 0 || getsockname(made, (struct sockaddr *)&own, &own_size) != 0) {
        int cause = errno;
        if (made >= 0) {
            (void)close(made);
        }
        errno = cause;
        return -1;
    }
    *port = ntohs(own.sin6_port); /* at the same offset as the IPv4 port */
    return made;
}

/* ---- other case ---- */

const char *tl_other_case(const char *path, char text[TL_OTHER_CASE_TEXT]) {
    const char *slash = strrchr(path, '/');
    const char *name = slash != NULL ? slash + 1 : path;
    char folder[PATH_MAX];
    bool fits = (size_t)snprintf(folder, sizeof folder, "%s", path) < sizeof folder;
    DIR *entries = fits && access(path, F_OK) != 0 ? opendir(dirname(folder)) : NULL;
    char nearest[NAME_MAX + 1] = "";
    tl_nearest near = {.text = name};
    text[0] = '\0';
    for (const struct dirent *entry = NULL; entries != NULL && (entry = readdir(entries)) != NULL;) {
        if (strcasecmp(entry->d_name, name) == 0) {
            (void)snprintf(text, TL_OTHER_CASE_TEXT, "; did you mean %s? (upper and lower case differ)", entry->d_name);
            break;
        }
        const char *before = near.best;
        tl_nearest_offer(&near, entry->d_name);
        if (near.best != before) { /* the entry does not last */
            (void)snprintf(nearest, sizeof nearest, "%s", entry->d_name);
            near.best = nearest;
        }
    }
    if (text[0] == '\0' && nearest[0] != '\0') {
        (void)snprintf(text, TL_OTHER_CASE_TEXT, "; did you mean %s?", nearest);
    }
    if (entries != NULL) {
        (void)closedir(entries);
    }
    return text;
}

/* ---- latest value ---- */

void tl_words_store(void *shared, const void *from, size_t bytes) {
    uint64_t *words = shared;
    for (size_t at = 0; at < bytes; at += sizeof *words) {
        uint64_t word = 0;
        memcpy(&word, (const char *)from + at, bytes - at < sizeof word ? bytes - at : sizeof word);
        __atomic_store_n(&words[at / sizeof word], word, __ATOMIC_RELEASE);
    }
}

void tl_words_load(void *to, const void *shared, size_t bytes) {
    const uint64_t *words = shared;
    for (size_t at = 0; at < bytes; at += sizeof *words) {
        uint64_t word = __atomic_load_n(&words[at / sizeof word], __ATOMIC_ACQUIRE);
        memcpy((char *)to + at, &word, bytes - at < sizeof word ? bytes - at : sizeof word);
    }
}

void tl_latest_publish(tl_latest *latest, const void *data, size_t size) {
    assert(size <= sizeof latest->words);
    uint64_t writing = __atomic_load_n(&latest->sequence, __ATOMIC_RELAXED) | 1U; /* already odd if a writer died */
    __atomic_store_n(&latest->sequence, writing, __ATOMIC_SEQ_CST);
    tl_words_store(latest->words, data, size);
    __atomic_store_n(&latest->sequence, writing + 1, __ATOMIC_SEQ_CST);
}

bool tl_latest_read(const tl_latest *latest, void *data, size_t size) {
    for (int search = 0; search < TL_LATEST_TRIES; search++) {
        uint64_t before = __atomic_load_n(&latest->sequence, __ATOMIC_SEQ_CST);
        tl_words_load(data, latest->words, size);
        if (before % 2 == 0 && before == __atomic_load_n(&latest->sequence, __ATOMIC_SEQ_CST)) {
            return true;
        }
    }
    return false;
}

/* ---- side thread ---- */

int tl_side_thread_start(pthread_t *thread, size_t stack, void *(*run)(void *context), void *context) {
    const struct sched_param ordinary = {.sched_priority = 0};
    pthread_attr_t attributes;
    sigset_t all;
    sigset_t before;
    int failure = pthread_attr_init(&attributes);
    if (failure != 0) {
        return failure;
    }
    if (stack > 0) {
        (void)pthread_attr_setstacksize(&attributes, stack);
    }
    (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    (void)pthread_attr_setschedpolicy(&attributes, SCHED_OTHER);
    (void)pthread_attr_setschedparam(&attributes, &ordinary);
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before); /* inherited by the thread */
    failure = pthread_create(thread, &attributes, run, context);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    (void)pthread_attr_destroy(&attributes);
    return failure;
}
