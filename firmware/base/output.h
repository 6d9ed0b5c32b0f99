/* Standard output: a result that is written whole or fails, and the progress of long work on standard error.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_BASE_OUTPUT_H
#define TL_FIRMWARE_BASE_OUTPUT_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/status.h"

/* ---- Where a verb prints its result: standard output, kept from the FMUs.
 *
 * Purpose: some vendors' FMUs print banners to standard output, which would spoil a JSON object or a CSV file. While an
 *          FMU may be loaded, what others print there goes to standard error; ours goes to the real one.
 * Thread:  call once, before FMUs are loaded.
 */

/* The real standard output. From now on file descriptor 1 is standard error. Falls back to stdout. */
FILE *tl_output_claim(void);

/* Once all is printed: `status`, or TL_TRY_AGAIN (said on the log) where that was TL_OK but not everything could be
 * written. */
tl_status tl_output_finish(FILE *output, tl_status status);

/* ---- Progress of long work: one line on a terminal, redrawn a few times a second; nothing in a pipe.
 *
 * Thread: one thread.
 */

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
