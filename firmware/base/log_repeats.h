/* Repeated log lines: logs the first lines of each kind, then counts.
 *
 * Purpose: a signal that becomes good and bad many times per second would fill the log. Lines that
 *          differ only in numbers are of one kind. The first TL_LOG_REPEATS_FIRST lines of a kind
 *          are logged. Later ones are counted, until none has come for a minute. The last one is
 *          logged with the count when none has come for a minute, after an hour, or at the end. So
 *          the last line of each kind is always logged, and in the order of the last ones.
 * Limits:  TL_LOG_REPEATS_KINDS kinds are remembered. A further one replaces the kind that was
 *          silent for the longest time. A line has at most TL_LOG_REPEATS_LINE − 1 bytes.
 * Units:   `now` in ns on CLOCK_MONOTONIC.
 * Thread:  plain data of one thread; may wait for stderr.
 */
#ifndef TL_FIRMWARE_BASE_LOG_REPEATS_H
#define TL_FIRMWARE_BASE_LOG_REPEATS_H

#include <stdint.h>

#include "firmware/base/log.h"
#include "master/base/simtime.h"

enum { TL_LOG_REPEATS_KINDS = 32, TL_LOG_REPEATS_FIRST = 2, TL_LOG_REPEATS_LINE = 288 };

/* Fields are private. */
typedef struct tl_log_kind {
    uint64_t hash;    /* 0: free */
    uint32_t lines;   /* logged ones, up to TL_LOG_REPEATS_FIRST */
    uint32_t repeats; /* not logged */
    tl_time since;    /* first of these */
    tl_time last;
    tl_log_level level;
    char line[TL_LOG_REPEATS_LINE]; /* the last one */
} tl_log_kind;

/* Initialise it with zeros. */
typedef struct tl_log_repeats {
    tl_log_kind kinds[TL_LOG_REPEATS_KINDS];
} tl_log_repeats;

/* Logs a line, or counts it. */
void tl_log_repeats_add(tl_log_repeats *self, tl_log_level level, const char *line, tl_time now);

/* Logs the counts that are due. Call it regularly. */
void tl_log_repeats_poll(tl_log_repeats *self, tl_time now);

/* Logs all counts. */
void tl_log_repeats_end(tl_log_repeats *self);

#endif
