/* Standard output: writes a result and reports if it was not written completely. Also shows the
 * progress of long work on standard error.
 *
 * Thread:  the main thread.
 */
#ifndef TL_FIRMWARE_BASE_OUTPUT_H
#define TL_FIRMWARE_BASE_OUTPUT_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "master/base/status.h"

/* ---- Result of a verb on standard output, protected from the FMUs.
 *
 * Purpose: some vendors' FMUs print to standard output, which would corrupt a JSON object or a CSV
 *          file. After tl_output_claim(), output of FMUs goes to standard error, and the program's
 *          results go to the real standard output.
 * Thread:  call tl_output_claim() once, before FMUs are loaded.
 */

/* Returns the real standard output as a new stream, and redirects file descriptor 1 to standard
 * error. If no new stream can be opened, returns stdout and redirects nothing. */
FILE *tl_output_claim(void);

/* Flushes `output` and leaves it open. Call it after the last output. `status`: the result of the
 * verb so far. If a write to `output` has failed and `status` is TL_OK or TL_NOT_LOCKED, logs an
 * error and returns TL_TRY_AGAIN. Otherwise returns `status`. */
tl_status tl_output_finish(FILE *output, tl_status status);

/* ---- Progress of long work: one line on stderr, redrawn up to 5 times a second. Without a
 * terminal, nothing is shown.
 *
 * Thread: one thread.
 */

typedef struct tl_progress {
    const char *what; /* name of the work; must stay valid until the end */
    int64_t total;    /* units of work, for a percentage; 0: unknown */
    bool shown;       /* stderr is a terminal */
    int64_t drawn;    /* time of the last drawing, ns of CLOCK_MONOTONIC */
} tl_progress;

/* Initialises the progress; draws nothing yet. */
void tl_progress_begin(tl_progress *progress, const char *what, int64_t total);

/* Redraws the line at most every 0.2 s. `done`: units of work so far. */
void tl_progress_update(tl_progress *progress, int64_t done);

/* Removes the line. */
void tl_progress_end(tl_progress *progress);

#endif
