/* Progress of long work: see progress.h. */
#include "firmware/base/progress.h"

#include <inttypes.h>
#include <stdio.h>
#include <unistd.h>

#include "firmware/base/clock.h"
#include "firmware/base/log.h"
#include "master/base/simtime.h"

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
