/* Plant I/O driver: SocketCAN (classic CAN and CAN FD), which only listens.
 *
 * Purpose: takes the frames with the configured ids from one interface and posts the signals in them. The kernel filters:
 *          a frame with another id does not wake anybody.
 * Listens: nothing in this driver can send: its objects need no symbol that could (tests/check/symbols.py). The
 *          controller itself still acknowledges what it receives, unless the interface was set up with `listen-only on`.
 * Link:    up while the interface is there and up, whether frames come or not: how old a value may be is judged above.
 *          Down where the interface is absent, down, removed, or bus-off; it is looked for with back-off (from 0.1 s,
 *          doubling, to at most 2 s).
 * Told:    by link(), once: error warning, error passive, error active again; frames too short for their signals. At
 *          most once a second, with their number: frames that the kernel had no room for, that the controller lost, and
 *          errors on the bus.
 * Bound:   a poll waits at most 50 ms for a frame and takes at most 512 of them.
 * Stamp:   when the kernel received the frame, on CLOCK_MONOTONIC whatever happens to the wall clock (can_link.h).
 * Source:  Linux kernel documentation, networking/can.
 */
#ifndef TL_BOARD_CAN_CAN_H
#define TL_BOARD_CAN_CAN_H

#include "board/can/can_codec.h"
#include "board/io/plant_access.h"
#include "board/io/plant_io.h"

enum { TL_CAN_INTERFACE = 15 }; /* characters that an interface's name has at most */

typedef struct tl_can_settings {
    const char *interface; /* "can0" */
    const tl_can_channel *channels;
    size_t channel_count;
} tl_can_settings;

extern const tl_plant_io_driver tl_can_driver;
extern const tl_plant_access tl_can_access;

/* Copies what it needs of `settings`. Opens no socket yet. Errors: TL_BAD_DATA for a setting out of its range, or bits
 * beyond the frame; TL_TRY_AGAIN where a resource is missing. */
tl_status tl_can_open(const tl_can_settings *settings, tl_plant_io **io, tl_error *error);

#endif
