/* Emulated plant on a CAN bus: sends frames with the values of its signals (channels).
 *
 * Purpose: `twinlock plant` sends the frames that a live CAN source reads. The driver
 *          (board/can/can.h) cannot send. Both use the same codec, tested against cantools.
 * Frames:  each id has one frame. A multiplexed id has one frame for each state of its multiplexors
 *          that a signal requires. A signal can be in several frames. Bits that belong to no signal
 *          are 0.
 * Rows:    a row has the values of the signals at one instant; some may be absent. A frame is sent
 *          if the row has a new value for one of its signals, and each of them has had a value.
 * Safety:  an interface with hardware may be the bus of a real plant. It is rejected unless the
 *          settings permit hardware.
 * Bound:   no call waits. A frame that the interface does not accept is dropped and counted. After
 *          the interface was removed, each frame first tries to open the socket again.
 * Thread:  one thread at a time.
 */
#ifndef TL_FIRMWARE_CLI_PLANT_BUS_H
#define TL_FIRMWARE_CLI_PLANT_BUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/can/can.h"
#include "master/base/status.h"

typedef struct tl_plant_bus_settings {
    const char *interface; /* name, for example "vcan0" */
    bool real;             /* permits an interface with hardware */
    const tl_can_channel *channels;
    size_t channel_count; /* at most TL_MAX_SIGNALS */
} tl_plant_bus_settings;

/* Numbers of frames. */
typedef struct tl_plant_bus_counts {
    uint64_t sent;
    uint64_t dropped;
} tl_plant_bus_counts;

/* A frame to be sent, without the socket, so that tests can check its content. */
typedef struct tl_plant_bus_frame {
    uint32_t id;
    bool extended; /* 29-bit id */
    bool fd;       /* CAN FD */
    uint8_t bytes; /* length of the payload */
    uint8_t data[TL_CAN_BYTES];
    bool members[TL_MAX_SIGNALS]; /* by channel: its signal is in this frame */
} tl_plant_bus_frame;

typedef struct tl_plant_bus tl_plant_bus;

/* Computes the frames for these channels, with the bits of the multiplexors already set. `frames`
 * has room for `count` entries. Returns the number of frames. */
size_t tl_plant_bus_plan(const tl_can_channel *channels, size_t count, tl_plant_bus_frame *frames);

/* Opens the bus; copies the settings. Errors: TL_BAD_USAGE if the interface has hardware and that
 * is not permitted; TL_TRY_AGAIN if there is no such interface, if it does not support CAN FD and a
 * frame needs it, or if a resource is missing. */
tl_status tl_plant_bus_open(const tl_plant_bus_settings *settings, tl_plant_bus **bus, tl_error *error);

/* Sends the frames of one row. `values`: one per channel, in its unit. `present` marks the channels
 * with a new value and must not be NULL. Frames that cannot be sent are only counted. */
void tl_plant_bus_row(tl_plant_bus *bus, const double *values, const bool *present);

/* Returns the counts of frames since open(). */
tl_plant_bus_counts tl_plant_bus_count(const tl_plant_bus *bus);

/* Closes the socket and frees the bus. */
void tl_plant_bus_close(tl_plant_bus *bus);

#endif
