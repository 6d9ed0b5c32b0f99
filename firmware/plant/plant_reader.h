/* Plant readers: threads that poll the sources, and the detection of repeated readings.
 *
 * Thread: each section says which.
 */
#ifndef TL_FIRMWARE_PLANT_PLANT_READER_H
#define TL_FIRMWARE_PLANT_PLANT_READER_H

#include <stdbool.h>
#include <stdint.h>

#include "board/io/plant_io.h"
#include "firmware/plant/sample_buffer.h"
#include "firmware/process/heartbeat.h"
#include "master/base/signal.h"

/* ---- Detects repeated readings: a poll reads a value again that its device has not updated.
 *
 * Purpose: a register is often polled more often than its device writes it. Conditions, lines and
 *          statistics count readings, so repeated ones must not count: a median of three would
 *          contain the same reading three times.
 * Rule:    a good reading with the value of the last new one is a repetition if it comes within the
 *          time in which the device writes no new value (`within`). If a device really writes the
 *          same value twice in this time, the second reading is dropped too, because the two cases
 *          cannot be distinguished. A line to the next different value then starts at the first
 *          reading.
 * Thread:  plain data; the thread of the source.
 */

/* State of one channel. Private; zeroed: nothing was read. */
typedef struct tl_repeated_reading {
    tl_reading last; /* last reading that was not a repetition */
    bool has_last;
} tl_repeated_reading;

/* Returns true if the reading repeats the last new one. `within`: time after that one in which the
 * device writes no new value, ns; 0: each reading is new. */
bool tl_repeated_reading_is(tl_repeated_reading *self, tl_time within, const tl_reading *reading);

/* ---- Plant readers: one thread per source that polls its driver and posts into the sample buffers
 * of its signals.
 *
 * Purpose: live plant I/O. A dead device blocks neither the other devices nor the start-up.
 * Events:  `on_link` receives the driver's reports, in the thread of the source. `source`: its
 *          name. `good`: false if a person should act, because the link is down or a part of it
 *          fails. `text`: a sentence, valid during the call.
 * Clock:   CLOCK_MONOTONIC. A source is polled once per period; poll_phase.h computes the instants.
 * Owner:   the readers own the `io` of each source from the start, and close it.
 * Thread:  start and stop from one thread. Stop interrupts the drivers, so it returns within 0.2 s,
 *          unless a driver is resolving a host name. The threads block all signals and use ordinary
 *          scheduling, independent of the caller.
 */

typedef struct tl_plant_source {
    const char *name;                 /* as configured */
    const tl_plant_io_driver *driver; /* not owned */
    tl_plant_io *io;                  /* opened by the caller; owned by the readers from the start */
    size_t signals[TL_MAX_SIGNALS];   /* channel → index of the signal's sample buffer */
    size_t signal_count;
    tl_time repeats[TL_MAX_SIGNALS]; /* channel → `within` of tl_repeated_reading_is(), ns */
    tl_time period;                  /* ns between polls, > 0 */
    /* Returns t_start of the run, ns, so that polls end before its ticks; 0: not known yet. Called
     * in the thread of the source, with the readers' `context`. NULL: polls are not aligned to
     * ticks (poll_phase.h). */
    tl_time (*run_start)(void *context);
    tl_thread_heartbeat *heartbeat; /* of its thread, set at each poll and reading; NULL: none */
} tl_plant_source;

typedef struct tl_plant_readers tl_plant_readers;

/* Starts one thread per source. `sources`, `buffers` and what they point to must outlive stop.
 * Errors: TL_TRY_AGAIN; then every `io` is closed. */
tl_status tl_plant_readers_start(const tl_plant_source *sources, size_t count, const tl_sample_buffer *buffers,
                                 void (*on_link)(void *context, const char *source, bool good, const char *text),
                                 void *context, tl_plant_readers **readers, tl_error *error);

/* Stops the threads, closes each `io` and frees the readers. */
void tl_plant_readers_stop(tl_plant_readers *readers);

#endif
