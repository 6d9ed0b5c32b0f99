/* Relay: reads the output of another process from a pipe and forwards it line by line, with control
 * characters escaped.
 *
 * Purpose: output of an FMU must not control the terminal, fake a line end, or change the text
 *          direction (text.h).
 * Lines:   only complete lines are forwarded. A line longer than TL_RELAY_LINE bytes is forwarded
 *          in parts, each as a line; no UTF-8 character is split.
 * Bounds:  one call reads about TL_RELAY_DRAIN bytes at most, so that a process that never stops
 *          printing cannot block the caller. There is no limit per second: unread output stays in
 *          the pipe, and the printing process waits.
 * Owner:   the caller owns the struct; the relay owns the descriptor and closes it.
 * Thread:  any thread may call tl_relay_drain(); a mutex serialises the calls. `pass` runs in the
 *          calling thread, with the mutex locked. Open and close the relay while no other thread
 *          uses it.
 */
#ifndef TL_FIRMWARE_BASE_RELAY_H
#define TL_FIRMWARE_BASE_RELAY_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>

enum {
    TL_RELAY_LINE = 4096,                  /* bytes of the longest line that is not divided */
    TL_RELAY_DRAIN = 256 * 1024,           /* bytes after which one tl_relay_drain() ends */
    TL_RELAY_CLEAN = 4 * TL_RELAY_LINE + 1 /* bytes of a clean line, including its NUL */
};

/* Receives one line without its newline, with control characters escaped. `line` is valid during
 * the call only. The function must not call tl_relay_*(). */
typedef void tl_relay_line(void *context, const char *line);

/* Fields are private. */
typedef struct tl_relay {
    pthread_mutex_t lock;
    int descriptor;
    tl_relay_line *pass;
    void *context;
    size_t used;              /* bytes of `line` */
    char line[TL_RELAY_LINE]; /* the line that is still incomplete */
} tl_relay;

/* Opens a relay. `descriptor`: read end of a pipe; it becomes non-blocking. `pass` receives the
 * lines, with `context`; NULL: lines are read and dropped. */
void tl_relay_open(tl_relay *relay, int descriptor, tl_relay_line *pass, void *context);

/* Reads and forwards the available output without blocking. Returns false if all was read and no
 * process has the write end open any more, or if reading failed. */
bool tl_relay_drain(tl_relay *relay);

/* Forwards a last incomplete line and closes the pipe. Unread output is lost, so call
 * tl_relay_drain() first. */
void tl_relay_close(tl_relay *relay);

#endif
