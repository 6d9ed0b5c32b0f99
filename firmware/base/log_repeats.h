/* Repeated log lines: logs the first lines of each kind, then counts.
 *
 * Purpose: a signal that becomes good and bad many times per second would fill the log. Lines that
 *          differ only in numbers are of one kind. The first TL_LOG_REPEATS_FIRST lines of a kind
 *          are logged, later lines are counted. The last counted line is logged with the count: one
 *          minute after that line, one hour after the first counted line, or at the end. So each
 *          kind's last line is always logged. After a minute without lines, a kind starts again.
 * Order:   counts that are due together are logged in the order of their last lines.
 * Limits:  TL_LOG_REPEATS_KINDS kinds are remembered. A further kind replaces the one that was
 *          silent for the longest time, whose count is logged first. A counted line has at most
 *          TL_LOG_REPEATS_LINE − 1 bytes.
 * Units:   `now` in ns on CLOCK_MONOTONIC.
 * Thread:  one thread; may wait for stderr.
 */
#ifndef TL_FIRMWARE_BASE_LOG_REPEATS_H
#define TL_FIRMWARE_BASE_LOG_REPEATS_H

#include <stdint.h>

#include "firmware/base/log.h"
#include "master/base/simtime.h"

enum { TL_LOG_REPEATS_KINDS = 32, TL_LOG_REPEATS_FIRST = 2, TL_LOG_REPEATS_LINE = 288 };

/* Fields are private. */
typedef struct tl_log_kind {
    uint64_t hash;    /* 0: free entry */
    uint32_t lines;   /* number of logged lines, up to TL_LOG_REPEATS_FIRST */
    uint32_t repeats; /* number of counted lines */
    tl_time since;    /* instant of the first counted line */
    tl_time last;     /* instant of the last line */
    tl_log_level level;
    char line[TL_LOG_REPEATS_LINE]; /* the last counted line */
} tl_log_kind;

/* Initialise it with zeros. */
typedef struct tl_log_repeats {
    tl_log_kind kinds[TL_LOG_REPEATS_KINDS];
} tl_log_repeats;

/* Logs a line, or counts it. */
void tl_log_repeats_add(tl_log_repeats *self, tl_log_level level, const char *line, tl_time now);

/* Logs the counts that are due. Call it every few seconds. */
void tl_log_repeats_poll(tl_log_repeats *self, tl_time now);

/* Logs all counts. */
void tl_log_repeats_end(tl_log_repeats *self);

#endif
