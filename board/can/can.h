/* Plant driver for SocketCAN (classic CAN and CAN FD); it only listens.
 *
 * Purpose: receives the frames with the configured ids from one interface and posts their signals.
 *          The kernel filters, so other frames do not wake the driver.
 * Listens: no object of this driver uses a symbol that can send (tests/check/symbols.py). The CAN
 *          controller still acknowledges frames, unless the interface is configured with
 *          `listen-only on`.
 * Link:    up while the interface is up and on the bus, with or without frames. The reader checks
 *          the age of values. Down if the interface is absent, down, removed, bus-off or without a
 *          carrier. Then the driver retries with back-off (from 0.1 s, doubling, to at most 2 s).
 * Reports: the start and the end of the controller's states error warning and error passive, and of
 *          frames too short for their signals. At most once per second, with a count: frames that
 *          the kernel dropped, overflows of the controller, bus errors. While the link is up, the
 *          sink's part_failed() gets the start of a problem and link() gets its end. While the link
 *          is down, link() gets both (plant_io.h).
 * Bound:   a poll waits at most 50 ms for a frame and receives at most 512 frames.
 * Stamp:   time of reception by the kernel, on CLOCK_MONOTONIC, independent of changes of the wall
 *          clock (can_link.h).
 * Source:  Linux kernel documentation, networking/can.
 */
#ifndef TL_BOARD_CAN_CAN_H
#define TL_BOARD_CAN_CAN_H

#include "board/can/can_codec.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

enum { TL_CAN_INTERFACE = 15 }; /* bytes of the longest interface name, without the NUL */

typedef struct tl_can_settings {
    const char *interface; /* "can0" */
    const tl_can_channel *channels;
    size_t channel_count;
} tl_can_settings;

extern const tl_plant_io_driver tl_can_driver;
extern const tl_plant_access tl_can_access;

/* Creates a driver for one interface. Copies the settings; opens no socket yet. The caller closes
 * it by tl_can_driver.close(). Errors: TL_BAD_DATA if a setting is out of range or a signal has
 * bits beyond its frame; TL_TRY_AGAIN if memory or a descriptor is missing. */
tl_status tl_can_open(const tl_can_settings *settings, tl_plant_io **io, tl_error *error);

#endif
