/* An emulated plant on a CAN bus: frames with the values of signals.
 *
 * Purpose: what `twinlock plant` lets a live CAN source hear. This is the plant's side and so it sends; the driver
 *          (board/can/can.h) cannot. Both share the codec's arithmetic, which is held against cantools.
 * Frames:  one for each id, and for each state of the multiplexors that a signal asks for; a signal that is in several
 *          of them is in all. A frame is sent with each row that brings a value for it, once all of its signals have
 *          had one; bits of no signal are 0.
 * Safety:  an interface with hardware behind it may be the bus of a real plant: it is refused unless that is asked for.
 * Bound:   nothing waits: a frame that the interface does not take is dropped and counted. One that was removed is
 *          looked for with each row.
 * Thread:  one at a time.
 */
#ifndef TL_FIRMWARE_CLI_PLANT_BUS_H
#define TL_FIRMWARE_CLI_PLANT_BUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/can/can.h"
#include "master/base/status.h"

typedef struct tl_plant_bus_settings {
    const char *interface;
    bool real; /* hardware is allowed */
    const tl_can_channel *channels;
    size_t channel_count; /* at most TL_MAX_SIGNALS */
} tl_plant_bus_settings;

typedef struct tl_plant_bus_counts {
    uint64_t sent;
    uint64_t dropped;
} tl_plant_bus_counts;

/* A frame that is sent, without the socket: for tests of what is in it. */
typedef struct tl_plant_bus_frame {
    uint32_t id;
    bool extended;
    bool fd;
    uint8_t bytes;
    uint8_t data[TL_CAN_BYTES];
    bool members[TL_MAX_SIGNALS]; /* channels that are in it */
} tl_plant_bus_frame;

typedef struct tl_plant_bus tl_plant_bus;

/* The frames for these channels, with the multiplexors' bits; returns their number. Room for one per channel. */
size_t tl_plant_bus_plan(const tl_can_channel *channels, size_t count, tl_plant_bus_frame *frames);

/* Copies what it needs. Errors: TL_BAD_USAGE for hardware that is not allowed; TL_TRY_AGAIN where there is no such
 * interface, it cannot take CAN FD though a frame needs it, or a resource is missing. */
tl_status tl_plant_bus_open(const tl_plant_bus_settings *settings, tl_plant_bus **bus, tl_error *error);

/* One row: a value per channel, those marked in `present`. */
void tl_plant_bus_row(tl_plant_bus *bus, const double *values, const bool *present);

tl_plant_bus_counts tl_plant_bus_count(const tl_plant_bus *bus);

void tl_plant_bus_close(tl_plant_bus *bus);

#endif
