/* Ticks to be followed, packed one after the other: what the plant showed, and the u that was committed.
 *
 * Purpose: in an image (past.h) and for who makes one. A tick of two signals takes a thirtieth of what a tl_past_tick takes.
 * Format:  whether the tick has u, and whether the FMUs began anew before its step (a byte), the signals (recorder_entry.h) with stamps
 *          relative to t_start, u; private to program and machine. It may lie anywhere.
 * Trust:   tl_past_tick_is_sound() judges packed bytes; the others believe them.
 * Owner:   the memory of a row is its own until tl_past_ticks_free().
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_TWIN_PAST_TICKS_H
#define TL_FIRMWARE_TWIN_PAST_TICKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/store/history.h"
#include "firmware/store/recorder_entry.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

/* What a time in ns is nearer to 0 than: sums of two are in range. */
#define TL_PAST_FAR (INT64_MAX / 4)

typedef struct tl_past_tick {
    tl_sample sample;        /* signals that the shape does not have: no link */
    bool has_u;              /* false for the first ticks of a run */
    bool resets;             /* before its step the FMUs began anew (TL_FLAG_RESET) */
    double u[TL_MAX_ADJUST]; /* zeros if it has none */
} tl_past_tick;

size_t tl_past_tick_bytes(const tl_recorder_shape *shape);

/* Numbers are finite, times below TL_PAST_FAR, qualities exist. */
bool tl_past_tick_is_sound(const tl_recorder_shape *shape, const unsigned char *bytes);

/* `start` is added to the stamps; tick and instant are set to 0. */
void tl_past_tick_unpack(const tl_recorder_shape *shape, const unsigned char *bytes, tl_time start, tl_past_tick *tick);

/* ---- a row of them, for who makes one ---- */

/* A zeroed row with its shape is empty. */
typedef struct tl_past_ticks {
    tl_recorder_shape shape;
    int64_t first;
    size_t count;
    size_t capacity;
    unsigned char *bytes; /* count · tl_past_tick_bytes() of them are used */
} tl_past_ticks;

/* Forgets what is in it. The next one to be added is `first`. */
void tl_past_ticks_begin(tl_past_ticks *ticks, int64_t first);
void tl_past_ticks_free(tl_past_ticks *ticks);

/* The next tick. `u` NULL: none (yet). False: memory is out. Stamps count from t_start. */
bool tl_past_ticks_add(tl_past_ticks *ticks, const tl_sample *sample, const double *u);

/* Begins anew: the recorded ticks of a run from `from` on, up to a hole, at most `most` of them; u if the run has as many as the shape. Errors:
 * those of history.h. */
tl_status tl_past_ticks_read(tl_past_ticks *ticks, tl_history *history, const tl_history_run *run, int64_t from,
                             int64_t most, tl_error *error);

/* The u of a tick that was added; of others it is ignored. */
void tl_past_ticks_set_u(tl_past_ticks *ticks, int64_t tick, const double *u);

/* Before its step the FMUs began anew: of a tick that was added and has u; of others it is ignored. */
void tl_past_ticks_set_reset(tl_past_ticks *ticks, int64_t tick);

/* Leaves out those before `first`, which is one of them, or the next. */
void tl_past_ticks_cut(tl_past_ticks *ticks, int64_t first);

/* The last one that can be followed from the first one on: the first few need no u, but from the first that has it each must. The
 * first − 1: none can. */
int64_t tl_past_ticks_last(const tl_past_ticks *ticks);

#endif
