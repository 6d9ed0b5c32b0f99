/* Interface of a plant driver.
 *
 * Purpose: a driver reads one device (one Modbus server, one CSV stream) and posts readings. It
 *          only listens: no driver has a function that writes to the plant.
 * Life:    open → poll … poll → finish → close, all from one thread that firmware owns
 *          (plant_reader.h). open() is the driver's own function, for example tl_modbus_open(). Any
 *          thread may call interrupt(): a waiting poll, or else the next one, returns soon.
 * Waiting: open() never waits for a device. While a device is absent or fails, poll() posts
 *          TL_NO_LINK for each of its channels, and retries with increasing pauses. So a returning
 *          device is read again.
 * Values:  a driver converts to the signal's unit (value = raw·scale + offset) and posts TL_GOOD,
 *          TL_NOT_A_NUMBER or TL_NO_LINK; the caller checks range and age.
 * Clock:   stamps are CLOCK_MONOTONIC nanoseconds.
 */
#ifndef TL_BOARD_IO_PLANT_IO_H
#define TL_BOARD_IO_PLANT_IO_H

#include <stdbool.h>
#include <stddef.h>

#include "master/base/signal.h"
#include "master/base/status.h"

/* Receives readings and reports during poll() and finish(). Pointers are valid during the call.
 * `channel` is the index of the signal in the driver's settings. */
typedef struct tl_plant_io_sink {
    void (*post)(void *context, size_t channel, const tl_reading *reading);
    /* Reports that the link went up or down; `text` names the device and the cause. If only a part
     * of the device recovers, link() is called once more, with the same `up` as before. */
    void (*link)(void *context, bool up, const char *text);
    /* Reports a problem of a part of the device while the link is up. Examples: one unit answers
     * with an exception; a row is malformed. If part_failed is NULL, the driver calls link() with
     * `up` true. */
    void (*part_failed)(void *context, const char *text);
    void *context;
} tl_plant_io_sink;

typedef struct tl_plant_io tl_plant_io;

typedef struct tl_plant_io_driver {
    const char *name; /* "modbus", "csv" */

    /* Reads the device once and posts the readings. Each driver documents how long a poll may wait
     * for its device. */
    void (*poll)(tl_plant_io *io, const tl_plant_io_sink *sink);

    /* From any thread: a waiting poll returns soon; if none waits, the next poll returns at once.
     */
    void (*interrupt)(tl_plant_io *io);

    /* After the last poll, in the same thread: posts or reports what is still pending. NULL if the
     * driver has nothing pending. */
    void (*finish)(tl_plant_io *io, const tl_plant_io_sink *sink);

    /* Closes the device and frees the driver; no other thread may use it any more. */
    void (*close)(tl_plant_io *io);
} tl_plant_io_driver;

#endif
