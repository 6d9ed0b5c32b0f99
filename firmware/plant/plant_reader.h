/* Threads that read sources, and what they make of readings.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_PLANT_PLANT_READER_H
#define TL_FIRMWARE_PLANT_PLANT_READER_H

#include <stdbool.h>
#include <stdint.h>

#include "board/io/plant_io.h"
#include "firmware/plant/sample_buffer.h"
#include "firmware/process/heartbeat.h"
#include "master/base/signal.h"

/* ---- A reading that a poll has found again.
 *
 * Purpose: a register is often read more often than its device writes it. Conditions, lines and figures count readings, so what was only read again must not count: a
 *          median of three would hold the same one three times.
 * Rule:    a good reading with the value of the one before, and so soon after it that none was due, is that one again. So is the second of two equal values in a row that
 *          a device has really written, which nobody can tell: a line to the next other value begins at the first of them.
 * Thread:  plain data; the source's.
 */

/* Of one channel. Private; zeroed: nothing was read. */
typedef struct tl_repeated_reading {
    tl_reading last; /* that was a new one */
    bool has_last;
} tl_repeated_reading;

/* Whether it is the one before again. `within`: ns from that one on, in which no other is due; 0: each is a new one. */
bool tl_repeated_reading_is(tl_repeated_reading *self, tl_time within, const tl_reading *reading);

/* ---- Plant readers: one thread per source that polls its driver and posts into the mailboxes of its signals.
 *
 * Purpose: live plant I/O. One dead device stops neither the others nor start-up.
 * Events:  link changes go to `on_link` (from the source's own thread), as the driver says them. A driver that can
 *          never go on is told as a link that is down; its signals are posted as TL_NO_LINK once, and it ends.
 * Clock:   a source is polled at start + i·period (CLOCK_MONOTONIC); instants that a slow poll has missed are left out.
 * Thread:  start and stop from one thread; stop returns within 0.2 s (drivers are interrupted), but for a driver that
 *          just resolves a name. The threads take no signals and run under ordinary scheduling, whoever starts them.
 */

typedef struct tl_plant_source {
    const char *name;                 /* as configured */
    const tl_plant_io_driver *driver; /* not owned */
    tl_plant_io *io;                  /* owned by the reader from start on: closed by stop */
    size_t signals[TL_MAX_SIGNALS];   /* channel → index of the signal's mailbox */
    size_t signal_count;
    tl_time repeats[TL_MAX_SIGNALS]; /* channel → ns in which an equal value is no new reading */
    tl_time period;                  /* ns between polls, > 0 */
    tl_thread_heartbeat *heartbeat;  /* of its thread, which beats at each poll and reading; NULL: nobody listens */
} tl_plant_source;

typedef struct tl_plant_readers tl_plant_readers;

/* Starts one thread per source. `sources`, `buffers` and what they point to must outlive stop. On failure (TL_TRY_AGAIN)
 * everything is closed. */
tl_status tl_plant_readers_start(const tl_plant_source *sources, size_t count, const tl_sample_buffer *buffers,
                                 void (*on_link)(void *context, const char *source, bool up, const char *text),
                                 void *context, tl_plant_readers **readers, tl_error *error);

void tl_plant_readers_stop(tl_plant_readers *readers);

#endif
