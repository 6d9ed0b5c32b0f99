/* The operating system in small pieces: locale, clock, memory, files, threads, shortages.
 *
 * Thread:  as each part says.
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

/* ---- The C locale for a thread of ours, whatever the process has.
 *
 * Purpose: an FMU, or a library that it loads, may call setlocale(): with a decimal comma every strtod() and printf() of the
 *          process would read and write other numbers from then on. A thread that has called this keeps a locale of its
 *          own: numbers with a point, English messages. Characters are UTF-8 where the system has C.UTF-8, for the scripts of
 *          FMUs that are written in Python. What an FMU computes in such a thread is the same too.
 * Use:     first thing in main() and in each thread of ours; again after every time that an FMU could have called uselocale().
 *          Costs no more than storing a pointer. The locale lives as long as the process.
 * Thread:  any; says nothing about other threads.
 */

void tl_locale_use(void);

/* ---- The clock of the appliance: CLOCK_MONOTONIC in nanoseconds.
 *
 * Purpose: the one place that reads it, in the shape tl_budget wants; and the absolute sleep of everything periodic.
 * Thread:  any.
 */

/* `context` is not used. */
tl_time tl_clock_now(void *context);

/* Sleeps until the instant, or until a signal comes. */
void tl_clock_sleep_until(tl_time instant);

/* ---- How much memory of this process is allocated.
 *
 * Purpose: what an FMU's saved state takes, it seldom says; what the heap grows by when one is made, does.
 * Limits:  what is allocated by malloc() and its like, in any thread. An FMU with an allocator of its own is not seen.
 * Thread:  any.
 */

/* Bytes, the allocator's own among them. */
size_t tl_heap_used(void);

/* Room for one more element behind `count`, each of `size` bytes: the array grows whenever `count` is 0 or a power of two. NULL: memory is out, and
 * the array stays as it is. */
void *tl_array_grown(void *array, size_t count, size_t size);

/* ---- Whether something failed only because something ran out: descriptors, memory, space on a disk.
 *
 * Purpose: such a failure says nothing about the file that was to be opened. Another time it may work: TL_TRY_AGAIN, not TL_BAD_DATA,
 *          so that who starts the program tries again.
 * Thread:  any.
 */

/* `code` as errno has it. */
bool tl_shortage_is(int code);

/* The same for a sentence of the C library's in which such a code was put into words: what dlerror() says. */
bool tl_shortage_is_told(const char *sentence);

/* ---- The bytes of a file that is open, in one call, whatever interrupts it.
 *
 * Thread: any thread.
 */

/* Reads until `bytes` has so many, or the file has no more. Returns how many there are; −1 with errno where reading failed. */
ssize_t tl_file_bytes_read(int file, char *bytes, size_t room);

/* All of an open file, with a NUL behind it: the caller's to free(). Closes the file. NULL with errno: it cannot be read, or has more than `most` bytes
 * (EFBIG). A file of −1 gives NULL, and errno stays. */
char *tl_file_text_take(int file, size_t most, size_t *size);

/* Writes all of them. False, with errno: it cannot. */
bool tl_file_bytes_write(int file, const void *bytes, size_t size);

/* ---- A file that appears whole or not at all.
 *
 * Purpose: it is written as FILE.new- and six characters, and takes its name at the end. What had the name stays until then, and
 *          stays for good where the command is interrupted or the disk is full.
 * Rules:   those of `--db`: an ordinary file is replaced, a link to one is followed; a device, a FIFO, a folder and a link
 *          that leads nowhere are left as they are. A replaced file's permissions are kept.
 * Thread:  one thread.
 */

typedef struct tl_new_file {
    FILE *file;          /* to write to */
    char path[PATH_MAX]; /* what it will be called */
    char name[PATH_MAX]; /* what it is called until then */
} tl_new_file;

/* Errors: TL_BAD_USAGE (no name), TL_BAD_DATA (there is something that must not be replaced), TL_TRY_AGAIN. */
tl_status tl_new_file_open(const char *path, tl_new_file *new_file, tl_error *error);

/* Gives it its name; content and name survive a power cut from here on. TL_TRY_AGAIN where not everything could be written; it is discarded then. */
tl_status tl_new_file_keep(tl_new_file *new_file, tl_error *error);

/* Synchronises the folder of this path, so that a name in it survives a power cut. Not every file system can; that is no error. */
void tl_keep_name(const char *path);

/* The same name, or one file by two names: what is made would take the other's place. */
bool tl_new_file_is(const char *path, const char *other);

/* A zeroed one is allowed. */
void tl_new_file_discard(tl_new_file *new_file);

/* ---- A TCP socket that listens.
 *
 * Thread:  any.
 */

/* Listens at an address, without blocking. *port: the one it has, also if 0 was asked for. Returns the socket; −1 and errno if it failed. */
struct sockaddr;
int tl_tcp_listen(const struct sockaddr *address, size_t size, int backlog, uint16_t *port);

/* ---- A file that is not there, but is with other letters' case.
 *
 * Purpose: who comes from a system that takes Config.json and config.json for one file is told which of them is there.
 * Thread:  any; reads a folder, so not the cycle's.
 */

enum { TL_OTHER_CASE_TEXT = 320 };

/* The end of a sentence that says that `path` cannot be opened: "; there is Config.json beside it, with other letters' case". Empty if
 * the file is there, or none that differs only so. ASCII letters count. Returns `text`. */
const char *tl_other_case(const char *path, char text[TL_OTHER_CASE_TEXT]);

/* ---- A latest-value register: the newest copy of a small struct, from one writer to any readers, wait-free for the writer.
 *
 * Purpose: the cycle shows what it does; the status line and, later, the server look.
 * Bound:   read tries TL_LATEST_TRIES times while the writer overtakes it, then says so.
 */

enum { TL_LATEST_WORDS = 256, TL_LATEST_TRIES = 8 };

/* A zeroed register holds zeroes. Fields are private. */
typedef struct tl_latest {
    uint64_t sequence; /* odd while written */
    uint64_t words[TL_LATEST_WORDS];
} tl_latest;

/* `size` is at most 8·TL_LATEST_WORDS, and the same at every call. */
void tl_latest_publish(tl_latest *latest, const void *data, size_t size);
bool tl_latest_read(const tl_latest *latest, void *data, size_t size);

/* Copies word by word, since another process may write or read `shared` meanwhile; it begins at a word, and has room for whole ones. Accesses keep
 * their order, so that a number that is odd during a write tells a reader what to skip. */
void tl_words_store(void *shared, const void *from, size_t bytes);
void tl_words_load(void *to, const void *shared, size_t bytes);

/* ---- A thread beside the cycle: it runs under ordinary scheduling, and takes no signals, whoever starts it.
 *
 * Purpose: the one way to start a thread that only reads, writes or waits. A thread inherits priority and signal mask from
 *          its starter, which may be the real-time cycle; this one does not.
 * Stack:   in bytes; with mlockall() all of it is real memory. 0: as the system has it.
 * Thread:  any. Errors: 0, or errno: EAGAIN if a resource is missing.
 */

/* Runs `run` with `context`; the caller joins *thread. */
int tl_side_thread_start(pthread_t *thread, size_t stack, void *(*run)(void *context), void *context);

#endif
