/* Operating system: small functions for locale, clock, memory, files, threads and shortages.
 *
 * Thread:  see each section.
 */
#ifndef TL_FIRMWARE_BASE_OS_H
#define TL_FIRMWARE_BASE_OS_H

#include <limits.h>
#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/types.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Locale of a thread: C locale, whatever the locale of the process is.
 *
 * Purpose: an FMU or its libraries may call setlocale(). Then every strtod() and printf() of the
 *          process might expect or write a decimal comma. After tl_locale_use() the thread has its
 *          own locale: decimal points and English messages. Characters are UTF-8 if the system has
 *          C.UTF-8, because Python FMUs need UTF-8. FMUs in this thread use this locale too.
 * Use:     call it first in main() and in each of our threads, and again whenever an FMU could have
 *          called uselocale(). The call only stores a pointer.
 * Thread:  any; affects only the calling thread.
 */

void tl_locale_use(void);

/* ---- Clock: CLOCK_MONOTONIC in nanoseconds.
 *
 * Purpose: reads the clock, with the signature that tl_budget needs, and sleeps on the same clock.
 * Thread:  any.
 */

/* Returns the time since an arbitrary instant, ns. `context` is not used. */
tl_time tl_clock_now(void *context);

/* Sleeps until `instant` (ns), or until a signal arrives. */
void tl_clock_sleep_until(tl_time instant);

/* ---- Allocated memory of this process.
 *
 * Purpose: measures the size of an FMU's saved state by the growth of the heap, because an FMU
 *          seldom reports this size.
 * Limits:  counts malloc() and similar functions, in all threads. Not counted: memory of an FMU's
 *          own allocator, and the heap that an FMU gets for rollback by memory (fmu_heap.h).
 * Thread:  any.
 */

/* Returns the number of allocated bytes, including the allocator's own overhead. */
size_t tl_heap_used(void);

/* Makes room for one more element in an array of `count` elements of `size` bytes each, and returns
 * the array. `array`: NULL if `count` is 0. Reallocates it only if `count` is 0 or a power of two.
 * Returns NULL if memory is out; then the array is unchanged. */
void *tl_array_grown(void *array, size_t count, size_t size);

/* ---- Shortages: detects that an operation failed only because descriptors, memory or disk space
 * ran out.
 *
 * Purpose: such a failure does not mean that the file is bad, and the shortage may end. So the
 *          caller reports TL_TRY_AGAIN, not TL_BAD_DATA.
 * Thread:  any.
 */

/* Returns true if `code`, an errno value, is a shortage. */
bool tl_shortage_is(int code);

/* Returns true if a message of the C library, for example from dlerror(), contains the text of an
 * errno value that is a shortage. */
bool tl_shortage_is_reported(const char *sentence);

/* ---- Bytes of an open file, read or written completely despite interruptions by signals.
 *
 * Thread: any.
 */

/* Reads until `room` bytes are read or the file ends. Returns the number of bytes, or −1 with errno
 * on an error. */
ssize_t tl_file_bytes_read(int file, char *bytes, size_t room);

/* Reads all of an open file, adds a NUL (not counted in *size), and always closes the file. The
 * caller frees the text. Returns NULL with errno if the file cannot be read or has more than `most`
 * bytes (EFBIG). If `file` is −1, returns NULL and leaves errno unchanged. */
char *tl_file_text_take(int file, size_t most, size_t *size);

/* Writes all bytes. Returns false with errno on an error. */
bool tl_file_bytes_write(int file, const void *bytes, size_t size);

/* ---- New file: appears completely or not at all.
 *
 * Purpose: the file is written as FILE.new- plus six characters and renamed to FILE at the end.
 *          Until then an existing FILE stays, also if the program is interrupted or the disk is
 *          full.
 * Rules:   a regular file is replaced, also through a link. A device, a FIFO, a folder and a broken
 *          link are rejected. The permissions of a replaced file are kept. The option `--db` has
 *          the same rules.
 * Thread:  one thread.
 */

typedef struct tl_new_file {
    FILE *file;          /* the caller writes to it; NULL: none */
    char path[PATH_MAX]; /* final name */
    char name[PATH_MAX]; /* temporary name */
} tl_new_file;

/* Creates the temporary file. Errors: TL_BAD_USAGE if `path` is "" or "-"; TL_BAD_DATA if something
 * exists there that must not be replaced; TL_TRY_AGAIN if the file cannot be created. */
tl_status tl_new_file_open(const char *path, tl_new_file *new_file, tl_error *error);

/* Closes the file and renames it. After that its content and name survive a power failure. Errors:
 * TL_TRY_AGAIN if it could not be written completely or renamed; then the new file is deleted. */
tl_status tl_new_file_keep(tl_new_file *new_file, tl_error *error);

/* Synchronises the folder of this path, so that a new name in it survives a power failure. Not all
 * file systems support this; that is no error. */
void tl_folder_sync(const char *path);

/* Returns true if both names are equal or refer to the same file: then a new file at `path` would
 * replace `other`. */
bool tl_new_file_would_replace(const char *path, const char *other);

/* Closes and deletes the temporary file. A zeroed struct is allowed. */
void tl_new_file_discard(tl_new_file *new_file);

/* ---- Listening TCP socket.
 *
 * Thread:  any.
 */

/* Listens at `address` (`size` bytes) with a non-blocking socket, close-on-exec. `backlog`: as for
 * listen(). Sets *port to the port, also if port 0 was requested. Returns the socket, or −1 with
 * errno. */
struct sockaddr;
int tl_tcp_listen(const struct sockaddr *address, size_t size, int backlog, uint16_t *port);

/* ---- A missing file whose name exists in other letter case.
 *
 * Purpose: helps users who are used to systems that do not distinguish Config.json from
 *          config.json.
 * Thread:  any except the real-time cycle, because the function reads a folder.
 */

enum { TL_OTHER_CASE_TEXT = 320 }; /* bytes of the text with its NUL */

/* Writes the end of an error message about `path` to `text`, and returns `text`: "; did you mean
 * Config.json? (upper and lower case differ)". `text` is "" if the file exists, or if its folder
 * has no such name. Only the case of ASCII letters is ignored. */
const char *tl_other_case(const char *path, char text[TL_OTHER_CASE_TEXT]);

/* ---- Latest value: shares the newest copy of a small struct between one writer and any number of
 * readers. Wait-free for the writer.
 *
 * Purpose: for example, the real-time cycle publishes its state, and the status line reads it. The
 *          value may lie in memory that several processes share.
 * Bound:   a read that meets a write is tried again, TL_LATEST_TRIES times in all; then it fails.
 */

enum { TL_LATEST_WORDS = 1024, TL_LATEST_TRIES = 8 };

/* Zeroed: the value is all zeros. Fields are private. */
typedef struct tl_latest {
    uint64_t sequence; /* odd during a write */
    uint64_t words[TL_LATEST_WORDS];
} tl_latest;

/* Write and read the value. `size`: bytes, at most 8·TL_LATEST_WORDS, and the same in all calls of
 * the writer. A reader may read more bytes than were written; the additional bytes are 0.
 * tl_latest_read() returns false if no consistent value could be read. */
void tl_latest_publish(tl_latest *latest, const void *data, size_t size);
bool tl_latest_read(const tl_latest *latest, void *data, size_t size);

/* Copy in units of 64 bits, because another process may access `shared` at the same time. `shared`
 * must be aligned to 64 bits and have room for whole units. Neither compiler nor processor changes
 * the order of these accesses, so readers can detect a write by a sequence number. */
void tl_words_store(void *shared, const void *from, size_t bytes);
void tl_words_load(void *to, const void *shared, size_t bytes);

/* ---- Side thread: a thread with ordinary scheduling that receives no signals.
 *
 * Purpose: use it for every thread that only reads, writes or waits. A thread normally inherits
 *          priority and signal mask from the thread that starts it, which may be the real-time
 *          cycle. A side thread does not.
 * Stack:   size in bytes; 0: the system's default. mlockall() makes the whole stack resident.
 * Thread:  any.
 */

/* Starts a thread that calls `run` with `context`; the caller joins *thread. Returns 0, or an errno
 * value: EAGAIN if a resource is missing. */
int tl_side_thread_start(pthread_t *thread, size_t stack, void *(*run)(void *context), void *context);

#endif
