/* The contract of a plant I/O driver.
 *
 * Purpose: a driver reads one device (one Modbus server, one CSV stream) and posts what it read. It only ever
 *          listens: no driver has a function that writes to the plant.
 * Life:    open → poll … poll → finish → close, all from one thread that firmware owns (plant_reader.h). interrupt() may
 *          be called from any other thread and makes a poll that waits, or else the next one, return soon.
 * Discipline: open() never waits for a device: a device that is absent, dies or returns is the business of
 *          poll(), which posts TL_NO_LINK for each of its channels, backs off by itself, and goes on.
 * Values:  a driver converts to the signal's own unit (value = raw·scale + offset) and posts TL_GOOD,
 *          TL_NOT_A_NUMBER or TL_NO_LINK; range and age are judged above it.
 * Clock:   stamps are CLOCK_MONOTONIC nanoseconds.
 */
#ifndef TL_BOARD_IO_PLANT_IO_H
#define TL_BOARD_IO_PLANT_IO_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/signal.h"
#include "master/base/status.h"

/* Where readings go. `channel` is the index the driver was given the signal at. */
typedef struct tl_plant_io_sink {
    void (*post)(void *context, size_t channel, const tl_reading *reading);
    /* Says that the link came up or went down; `text` names the device and the cause. Where it stays as it is
     * but a part of it is in trouble, or out of it again (one unit answers with an exception, a row is no row),
     * it is said once too, with `up` as it was. */
    void (*link)(void *context, bool up, const char *text);
    void *context;
} tl_plant_io_sink;

typedef struct tl_plant_io tl_plant_io;

typedef struct tl_plant_io_driver {
    const char *name; /* "modbus_tcp", "csv" */

    /* Reads everything once and posts it. Waits for the device at most for its own timeout; returns at once
     * where there is nothing to read. TL_OK also where the device is down; *finished is set where nothing can
     * come any more (end of a file). An error means that this driver can never go on. */
    tl_status (*poll)(tl_plant_io *io, const tl_plant_io_sink *sink, bool *finished, tl_error *error);

    /* From any thread: a poll that waits returns soon. Not lost where none waits: the next one returns at once. */
    void (*interrupt)(tl_plant_io *io);

    /* After the last poll, in its thread: says at once what was kept back to be told later. NULL: there is never anything. */
    void (*finish)(tl_plant_io *io, const tl_plant_io_sink *sink);

    void (*close)(tl_plant_io *io);
} tl_plant_io_driver;

#endif
