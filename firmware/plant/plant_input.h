/* Plant input: makes one sample with qualities per tick from the posted readings.
 *
 * Purpose:     the only code that checks single readings: finite, in range, fresh. frozen.h marks
 *              signals that repeat one value. Live sources (plant_reader.h) and recordings
 *              (recording.h) both post into its sample buffers, so that a replay checks as a live
 *              run does.
 * Conditioned: if a signal has a condition, each of its readings is conditioned once
 *              (conditioner.h). Look-ups then use the outputs.
 * Between:     tl_plant_lookup defines the value between two readings (plant_input.c).
 * Memory:      the caller owns the memory of the sample buffers (sample_buffer.h). It is untrusted,
 *              because another process may write it.
 * Thread:      the thread of the cycle. Each sample buffer has one writer, which may be another
 *              thread (sample_buffer.h). Wait-free.
 */
#ifndef TL_FIRMWARE_PLANT_PLANT_INPUT_H
#define TL_FIRMWARE_PLANT_PLANT_INPUT_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/plant/sample_buffer.h"
#include "master/base/signal.h"

/* How a signal is looked up in a sample of the instant t.
 * next:  only for TL_BETWEEN_LAST, if no reading has the stamp t − back. If true, the look-up uses
 *        the next reading after t − back; if that has not come by t, the newest one before. If
 *        false, it uses the newest one before; if there is none, the next one after.
 * shows: if true, the result is the newest reading of signal `shown`, before conditioning. If
 *        readings were rejected since the last tick, it is the last of these, as TL_OUTLIER. */
typedef struct tl_plant_lookup {
    tl_time back;       /* ns, ≥ 0: looked up at t − back */
    bool next;          /* with TL_BETWEEN_LAST: prefers the next reading, as described above */
    tl_between between; /* LINE, MEAN: if the next reading has not come by t, the newest one before is used */
    tl_time span;       /* of a mean: it starts at t − back and lasts this time, ns, > 0 */
    bool shows;         /* uses another signal, as described above */
    size_t shown;       /* index of that signal */
} tl_plant_lookup;

/* Two instants that differ by at most this count as equal: 1 µs. It covers the rounding of other
 * clocks and small delays in reading them. */
#define TL_PLANT_ALIKE ((tl_time)1000)

typedef struct tl_plant_limits {
    double minimum; /* −infinity: none */
    double maximum; /* +infinity: none */
    double below;   /* ≥ 0: a value at most this far below the minimum is moved to the minimum */
    double above;   /* the same for the maximum */
    uint64_t items; /* bit k: minimum + k is permitted, other values are out of range; 0: all are permitted */
    tl_time stale;  /* ns; older readings are stale; 0: readings are never stale */
    tl_type type;   /* a value that is not a valid Integer or Boolean is out of range */
} tl_plant_limits;

/* Largest distance of a stamp from its sample: 73 years, so that the difference of any two stamps
 * fits into tl_time. */
#define TL_PLANT_FARTHEST (INT64_MAX / 4)

/* The conditioned readings of one signal; used only by the thread of the cycle. */
typedef struct tl_reading_stream tl_reading_stream;

/* Set by tl_live_plant_set_limits(), tl_sample_buffers_open() and tl_plant_input_open(). */
typedef struct tl_plant_input {
    size_t count; /* number of signals, with further look-ups of the same ones (tl_config_use_lookups()) */
    tl_plant_limits limits[TL_MAX_SIGNALS];
    tl_plant_lookup looks[TL_MAX_SIGNALS];
    tl_condition conditions[TL_MAX_SIGNALS];
    tl_sample_buffer buffers[TL_MAX_SIGNALS];
    tl_reading_stream *streams[TL_MAX_SIGNALS]; /* NULL: its readings are not conditioned */
} tl_plant_input;

/* Allocates the streams. Call it after limits, conditions and sample buffers are set. Returns false
 * if memory is out; call tl_plant_input_close() even then. */
bool tl_plant_input_open(tl_plant_input *input);

/* Frees what tl_plant_input_open() allocated. A zeroed input is allowed. */
void tl_plant_input_close(tl_plant_input *input);

/* Returns true if the newest reading of every signal is good. Does not check values. */
bool tl_plant_input_is_complete(const tl_plant_input *input);

/* Returns false if the value is out of range; then nothing is changed. Moves a value that is
 * slightly beyond a limit to this limit. *moved: it was moved. */
bool tl_plant_limits_apply(const tl_plant_limits *limits, double *value, bool *moved);

/* Makes the sample of `tick` at `instant` (ns, clock of the cycle). If the quality is not good, the
 * value is the one that was read; 0 if there is no reading or no number. An interpolated value has
 * the stamp of its look-up (t − back), a mean that of the middle of its span. If several faults
 * apply, the highest tl_quality is set. A reading's age is the time from its stamp to the look-up.
 * A stamp further than TL_PLANT_FARTHEST from the look-up is invalid, and counts as no reading. */
void tl_plant_input_take(const tl_plant_input *input, int64_t tick, tl_time instant, tl_sample *sample);

#endif
