/* Plant readers: one thread per source that polls its driver and posts into the mailboxes of its signals.
 *
 * Purpose: live plant I/O. One dead device stops neither the others nor start-up.
 * Events:  link changes go to `on_link` (from the source's own thread), as the driver says them. A driver that can
 *          never go on is told as a link that is down; its signals are posted as TL_NO_LINK once, and it ends.
 * Clock:   a source is polled at start + i·period (CLOCK_MONOTONIC); instants that a slow poll has missed are left out.
 * Thread:  start and stop from one thread; stop returns within 0.2 s (drivers are interrupted), but for a driver that
 *          just resolves a name. The threads take no signals and run under ordinary scheduling, whoever starts them.
 */
#ifndef TL_FIRMWARE_PLANT_PLANT_READER_H
#define TL_FIRMWARE_PLANT_PLANT_READER_H

#include "board/io/plant_io.h"
#include "firmware/plant/mailbox.h"
#include "firmware/process/heartbeat.h"

typedef struct tl_plant_source {
    const char *name;                 /* as configured */
    const tl_plant_io_driver *driver; /* not owned */
    tl_plant_io *io;                  /* owned by the reader from start on: closed by stop */
    const size_t *signals;            /* channel → index of the signal's mailbox */
    size_t signal_count;
    const tl_time *repeats; /* channel → ns in which an equal value is no new reading (repeated_reading.h); NULL: 0 */
    tl_time period;         /* ns between polls, > 0 */
    tl_heart *heart;        /* of its thread, which beats at each poll and reading; NULL: nobody listens */
} tl_plant_source;

typedef struct tl_plant_readers tl_plant_readers;

/* Starts one thread per source. `sources`, `mailboxes` and what they point to must outlive stop. On failure (TL_TRY_AGAIN)
 * everything is closed. */
tl_status tl_plant_readers_start(const tl_plant_source *sources, size_t count, const tl_mailbox *mailboxes,
                                 void (*on_link)(void *context, const char *source, bool up, const char *text),
                                 void *context, tl_plant_readers **readers, tl_error *error);

/* true once every source has ended by itself (end of its file, or it can never go on). */
bool tl_plant_readers_finished(const tl_plant_readers *readers);

void tl_plant_readers_stop(tl_plant_readers *readers);

#endif
