/* Standard output and progress: see output.h. */
#include "firmware/base/output.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <string.h>
#include <unistd.h>

#include "firmware/base/log.h"
#include "firmware/base/os.h"
#include "master/base/simtime.h"

/* ---- output ---- */

FILE *tl_output_claim(void) {
    int original = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
    FILE *output = original < 0 ? NULL : fdopen(original, "w");
    if (output == NULL) {
        return stdout;
    }
    (void)dup2(STDERR_FILENO, STDOUT_FILENO);
    return output;
}

tl_status tl_output_finish(FILE *output, tl_status status) {
    bool failed = ferror(output) != 0;
    failed = fflush(output) != 0 || failed;
    if (!failed || (status != TL_OK && status != TL_NOT_LOCKED)) {
        return status;
    }
    tl_log(TL_LOG_ERROR, "the result could not be written to standard output: %s", strerror(errno));
    return TL_TRY_AGAIN;
}

/* ---- progress ---- */

static const tl_time REDRAW = TL_SECOND / 5;

void tl_progress_begin(tl_progress *progress, const char *what, int64_t total) {
    *progress = (tl_progress){.what = what, .total = total, .shown = isatty(STDERR_FILENO) == 1};
    progress->drawn = tl_clock_now(NULL);
}

void tl_progress_update(tl_progress *progress, int64_t done) {
    if (!progress->shown) {
        return;
    }
    tl_time now = tl_clock_now(NULL);
    if (now - progress->drawn < REDRAW) {
        return;
    }
    progress->drawn = now;
    char line[TL_LOG_TEXT];
    if (progress->total > 0) {
        (void)snprintf(line, sizeof line, "%s %3.0f %%", progress->what,
                       100.0 * (double)done / (double)progress->total);
    } else {
        (void)snprintf(line, sizeof line, "%s %" PRId64, progress->what, done);
    }
    tl_log_status(line);
}

void tl_progress_end(tl_progress *progress) {
    if (progress->shown) {
        tl_log_status(NULL);
    }
}
