/* Progress of long work: one line on a terminal, redrawn a few times a second; nothing in a pipe.
 *
 * Thread: one thread.
 */
#ifndef TL_FIRMWARE_BASE_PROGRESS_H
#define TL_FIRMWARE_BASE_PROGRESS_H

#include <stdbool.h>
#include <stdint.h>

typedef struct tl_progress {
    const char *what;
    int64_t total; /* 0: not known */
    bool shown;    /* stderr is a terminal */
    int64_t drawn; /* when last, ns of CLOCK_MONOTONIC */
} tl_progress;

void tl_progress_begin(tl_progress *progress, const char *what, int64_t total);
void tl_progress_update(tl_progress *progress, int64_t done);

/* Wipes the line. */
void tl_progress_end(tl_progress *progress);

#endif
