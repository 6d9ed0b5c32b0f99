/* Plant input: from posted readings to one quality-flagged sample per tick.
 *
 * Purpose: the one place where a value of the plant is judged: finite, in range, fresh. Live sources
 *          (plant_reader.h) and recordings (recording.h) both post into its mailboxes, so replay judges as live does.
 * Conditioned: a signal's readings are, before anything is looked up among them, each once as it comes.
 * Between: two readings a signal is what its look says (plant_input.c).
 * Memory:  the mailboxes' is of whoever sets this up (sample_buffer.h); another process may write it, which is not trusted.
 * Thread:  one, the cycle's; readings are posted by one thread per signal (sample_buffer.h). Wait-free.
 */
#ifndef TL_FIRMWARE_PLANT_PLANT_INPUT_H
#define TL_FIRMWARE_PLANT_PLANT_INPUT_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/plant/sample_buffer.h"
#include "master/base/signal.h"

/* Where a signal is looked up in a sample of the instant t. */
typedef struct tl_plant_look {
    tl_time back;       /* ≥ 0: at t − back, */
    bool next;          /* and where no reading lies there: the next one that is there by t, else the newest before.
                     Otherwise the newest at or before, and where there is none yet, the next */
    tl_between between; /* what the signal is there, where no reading lies there and the next one is there by t */
    tl_time span;       /* of a mean: from t − back on so long, > 0 */
    bool
        shows; /* instead: the newest reading of another signal, as it came; one that was rejected since the tick before goes before others, as TL_OUTLIER */
    size_t shown; /* that signal */
} tl_plant_look;

/* Readings no further than this from an instant are of it: 1 us. A clock that counts in other units, or is read a little later, is off by less. */
#define TL_PLANT_ALIKE ((tl_time)1000)

typedef struct tl_plant_limits {
    double minimum; /* −infinity: none */
    double maximum; /* +infinity: none */
    tl_time stale;  /* ns after which a reading is stale; 0: never */
    tl_type type;   /* an Integer or Boolean that is not one is out of range */
} tl_plant_limits;

/* 73 years: the difference of two stamps of samples is a tl_time, whoever has made them. */
#define TL_PLANT_FARTHEST (INT64_MAX / 4)

/* The readings of one signal, conditioned each once as it comes. Of the cycle's thread. */
typedef struct tl_reading_stream tl_reading_stream;

/* Set up by tl_live_plant_set_limits() and tl_sample_buffers_open(). */
typedef struct tl_plant_input {
    size_t count;
    tl_plant_limits limits[TL_MAX_SIGNALS];
    tl_plant_look looks[TL_MAX_SIGNALS];
    tl_condition conditions[TL_MAX_SIGNALS];
    tl_sample_buffer buffers[TL_MAX_SIGNALS];
    tl_reading_stream *streams[TL_MAX_SIGNALS]; /* NULL: nothing is done to its readings */
} tl_plant_input;

/* Once limits, conditions and mailboxes are set. False: there is not enough memory; to be closed even then. */
bool tl_plant_input_open(tl_plant_input *input);

/* Frees what it has opened. A zeroed one is allowed. */
void tl_plant_input_close(tl_plant_input *input);

/* Every signal's newest reading is good, whatever its value. */
bool tl_plant_input_is_complete(const tl_plant_input *input);

/* The sample of `tick` at `instant`, both of the cycle. The value of a signal whose quality is not good is what
 * was read (0 where nothing or no number was). One that lies between two readings has the stamp of where it is looked up, a mean that of the middle of its span. Where several things are wrong with a value, the worst counts. How old one is
 * counts from where it is looked up. A stamp that is further from there than TL_PLANT_FARTHEST is nobody's: there was no reading. */
void tl_plant_input_take(const tl_plant_input *input, int64_t tick, tl_time instant, tl_sample *sample);

#endif
