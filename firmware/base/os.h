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

/* ---- C locale for a thread of ours, whatever the locale of the process is.
 *
 * Purpose: an FMU or its libraries may call setlocale(). Then every strtod() and printf() of the
 *          process might expect or write a decimal comma. After this call the thread has its own
 *          locale: decimal points and English messages. Characters are UTF-8 if the system has
 *          C.UTF-8, because Python FMUs need it. FMUs that run in the thread use this locale too.
 * Use:     call it first in main() and in each of our threads, and again whenever an FMU could have
 *          called uselocale(). It only stores a pointer. The locale lives as long as the process.
 * Thread:  any; affects only the calling thread.
 */

void tl_locale_use(void);

/* ---- Clock: CLOCK_MONOTONIC in nanoseconds.
 *
 * Purpose: reads the clock, with the signature that tl_budget needs. Also the sleep function of all
 *          periodic code.
 * Thread:  any.
 */

/* Returns the time, ns. `context` is not used. */
tl_time tl_clock_now(void *context);

/* Sleeps until the instant, or until a signal arrives. */
void tl_clock_sleep_until(tl_time instant);

/* ---- Allocated memory of this process.
 *
 * Purpose: measures the size of an FMU's saved state by the growth of the heap, because an FMU
 *          seldom reports it.
 * Limits:  counts malloc() and similar functions, in all threads. An FMU's own allocator is not
 *          counted.
 * Thread:  any.
 */

/* Returns the number of allocated bytes, including the allocator's own overhead. */
size_t tl_heap_used(void);

/* Returns the array with room for one more element after `count`, each of `size` bytes. It is
 * reallocated if `count` is 0 or a power of two. Returns NULL if memory is out; then the array is
 * unchanged. */
void *tl_array_grown(void *array, size_t count, size_t size);

/* ---- Shortages: whether an operation failed only because descriptors, memory or disk space ran
 * out.
 *
 * Purpose: the opened or written file is not the cause of such a failure, and the shortage may end.
 *          The failure is reported as TL_TRY_AGAIN, not TL_BAD_DATA, so that the caller retries.
 * Thread:  any.
 */

/* Returns true if `code`, an errno value, is a shortage. */
bool tl_shortage_is(int code);

/* The same for a message of the C library that contains the text of such a code, for example from
 * dlerror(). */
bool tl_shortage_is_reported(const char *sentence);

/* ---- Bytes of an open file, read or written completely despite interruptions by signals.
 *
 * Thread: any.
 */

/* Reads until `room` bytes are read or the file ends. Returns the number of bytes, or −1 with errno
 * on an error. */
ssize_t tl_file_bytes_read(int file, char *bytes, size_t room);

/* Reads all of an open file, adds a NUL, and closes the file. The caller frees the text. Returns
 * NULL with errno if the file cannot be read or has more than `most` bytes (EFBIG). If `file` is
 * −1, returns NULL and leaves errno unchanged. */
char *tl_file_text_take(int file, size_t most, size_t *size);

/* Writes all bytes. Returns false with errno on an error. */
bool tl_file_bytes_write(int file, const void *bytes, size_t size);

/* ---- New file: appears completely or not at all.
 *
 * Purpose: the file is written as FILE.new- plus six characters and renamed at the end. Until then
 *          an existing FILE stays; it also stays if the command is interrupted or the disk is full.
 * Rules:   an ordinary file is replaced, also through a link. A device, a FIFO, a folder and a
 *          broken link are rejected. The permissions of a replaced file are kept. The option `--db`
 *          has the same rules.
 * Thread:  one thread.
 */

typedef struct tl_new_file {
    FILE *file;          /* to write to */
    char path[PATH_MAX]; /* final name */
    char name[PATH_MAX]; /* temporary name */
} tl_new_file;

/* Creates the temporary file. Errors: TL_BAD_USAGE (no name), TL_BAD_DATA (something exists that
 * must not be replaced), TL_TRY_AGAIN. */
tl_status tl_new_file_open(const char *path, tl_new_file *new_file, tl_error *error);

/* Closes the file and renames it. After that its content and name survive a power failure. Errors:
 * TL_TRY_AGAIN if not everything could be written; then the file is discarded. */
tl_status tl_new_file_keep(tl_new_file *new_file, tl_error *error);

/* Synchronises the folder of this path, so that a new name in it survives a power failure. Not all
 * file systems support this; that is no error. */
void tl_folder_sync(const char *path);

/* Returns true if both names are equal or refer to the same file, so that a new file at `path`
 * would replace `other`. */
bool tl_new_file_would_replace(const char *path, const char *other);

/* Deletes the temporary file. A zeroed struct is allowed. */
void tl_new_file_discard(tl_new_file *new_file);

/* ---- Listening TCP socket.
 *
 * Thread:  any.
 */

/* Listens at an address with a non-blocking socket. Sets *port to its port, also if 0 was
 * requested. Returns the socket, or −1 with errno. */
struct sockaddr;
int tl_tcp_listen(const struct sockaddr *address, size_t size, int backlog, uint16_t *port);

/* ---- A missing file whose name exists in other letter case.
 *
 * Purpose: helps users of systems that do not distinguish Config.json from config.json.
 * Thread:  any but the real-time cycle, because it reads a folder.
 */

enum { TL_OTHER_CASE_TEXT = 320 };

/* Returns `text`, the end of an error message about `path`: "; did you mean Config.json? (upper and
 * lower case differ)". `text` is empty if the file exists, or if its folder has no such name. Only
 * the case of ASCII letters is ignored. */
const char *tl_other_case(const char *path, char text[TL_OTHER_CASE_TEXT]);

/* ---- Latest value: shares the newest copy of a small struct between one writer and any number of
 * readers. Wait-free for the writer.
 *
 * Purpose: the real-time cycle publishes its state, and the status line reads it.
 * Bound:   a read is repeated up to TL_LATEST_TRIES times while the writer changes the value, then
 *          it fails.
 */

enum { TL_LATEST_WORDS = 1024, TL_LATEST_TRIES = 8 };

/* Zeroed: the value is all zeros. Fields are private. */
typedef struct tl_latest {
    uint64_t sequence; /* odd during a write */
    uint64_t words[TL_LATEST_WORDS];
} tl_latest;

/* `size` is at most 8·TL_LATEST_WORDS and the same in all calls of the writer. A reader may read
 * more bytes, which are 0. tl_latest_read() returns false if no consistent value could be read. */
void tl_latest_publish(tl_latest *latest, const void *data, size_t size);
bool tl_latest_read(const tl_latest *latest, void *data, size_t size);

/* Copy in units of 64 bits, because another process may access `shared` at the same time. `shared`
 * must be aligned to 64 bits and have room for whole units. No access is moved before an earlier
 * one, so that readers can detect a write by an odd sequence number. */
void tl_words_store(void *shared, const void *from, size_t bytes);
void tl_words_load(void *to, const void *shared, size_t bytes);

/* ---- Side thread: runs under ordinary scheduling and receives no signals, whichever thread starts
 * it.
 *
 * Purpose: every thread that only reads, writes or waits is started by this function. A thread
 *          normally inherits priority and signal mask from the thread that starts it, which may be
 *          the real-time cycle. A side thread does not.
 * Stack:   in bytes; mlockall() makes all of it resident. 0: the system's default.
 * Thread:  any.
 */

/* Starts a thread that calls `run` with `context`; the caller joins *thread. Returns 0, or an errno
 * value: EAGAIN if a resource is missing. */
int tl_side_thread_start(pthread_t *thread, size_t stack, void *(*run)(void *context), void *context);

#endif
