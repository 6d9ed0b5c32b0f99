/* A relay: what another process prints into a pipe, as lines that can be shown.
 *
 * Purpose: nothing that an FMU prints can command the terminal, forge a line's end or turn its direction (text.h).
 * Lines:   whole ones. One that is longer than TL_RELAY_LINE bytes comes in pieces, each as a line; no piece ends within a UTF-8 character.
 * Bounds:  a drain reads at most TL_RELAY_DRAIN bytes, so that who never stops printing does not keep it. There is no limit per second:
 *          what is not read stays in the pipe, and who prints waits.
 * Owner:   the caller places a relay; the descriptor is the relay's.
 * Thread:  any may drain; a line is passed on by whoever does, one at a time.
 */
#ifndef TL_FIRMWARE_BASE_RELAY_H
#define TL_FIRMWARE_BASE_RELAY_H

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>

enum {
    TL_RELAY_LINE = 4096,
    TL_RELAY_DRAIN = 256 * 1024,
    TL_RELAY_CLEAN = 4 * TL_RELAY_LINE + 1 /* a line as it is passed on, with its NUL */
};

/* One clean line, without its newline. It must not call the relay. */
typedef void tl_relay_line(void *context, const char *line);

/* Fields are private. */
typedef struct tl_relay {
    pthread_mutex_t lock;
    int descriptor;
    tl_relay_line *pass;
    void *context;
    size_t used;
    char line[TL_RELAY_LINE]; /* as it came */
} tl_relay;

/* `descriptor`: the reading end of a pipe; it becomes non-blocking. `pass` NULL: lines are read and dropped. */
void tl_relay_open(tl_relay *relay, int descriptor, tl_relay_line *pass, void *context);

/* Reads what is there, without waiting. False: nobody has the other end any more, and all is read. */
bool tl_relay_drain(tl_relay *relay);

/* Passes on a last line without an end, and closes. What is still in the pipe is lost: drain before. */
void tl_relay_close(tl_relay *relay);

#endif
