/* Socket of a CAN interface: frames, their time stamps, and errors of the bus.
 *
 * Thread:  the one that reads the source.
 */
#ifndef TL_BOARD_CAN_CAN_LINK_H
#define TL_BOARD_CAN_CAN_LINK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "board/can/can_codec.h"
#include "board/can/can_interface.h"
#include "board/io/wake.h"
#include "master/base/simtime.h"

/* ---- Converts the kernel's receive stamps from the wall clock to CLOCK_MONOTONIC. Private to the
 * CAN driver.
 *
 * Purpose: the wall clock may be set between the reception of a frame and its reading. But the
 *          frame was received after the queue was last empty (or after the frame before it) and
 *          before now. A stamp outside of this interval is converted with the earlier offset of the
 *          clocks; if it is still outside, it is moved to the nearer end.
 * Bound:   after a change of the clock, a stamp is wrong by at most that interval. Stamps never
 *          decrease.
 * Thread:  one; reads no clock itself.
 */

/* Starts as zeros. */
typedef struct tl_can_clock {
    tl_time floor; /* CLOCK_MONOTONIC: later frames are received after this time */
    tl_time ahead; /* wall clock − CLOCK_MONOTONIC when the queue was last empty */
    bool known;    /* `ahead` is valid */
} tl_can_clock;

/* The queue is empty at this time, by both clocks. */
void tl_can_clock_empty(tl_can_clock *clock, tl_time monotonic, tl_time wall);

/* The stamp of a frame received at `received` (wall clock; 0: unknown) and read now. */
tl_time tl_can_clock_stamp(tl_can_clock *clock, tl_time received, tl_time monotonic, tl_time wall);

/* ---- Decoding of a CAN controller's error frames. Private to the CAN driver.
 *
 * Purpose: reduces the bits of the kernel's error frames to what a listener can report.
 * Source:  linux/can/error.h; ISO 11898-1, fault confinement.
 */

/* State of the controller. */
typedef enum tl_can_health { TL_CAN_SAME, TL_CAN_ACTIVE, TL_CAN_WARNING, TL_CAN_PASSIVE, TL_CAN_BUS_OFF } tl_can_health;

typedef struct tl_can_fault {
    tl_can_health health;  /* TL_CAN_SAME: not in this frame */
    bool overflow;         /* the controller had no room for a frame */
    const char *bus_error; /* description of the error on the bus; NULL: none */
} tl_can_fault;

/* Error classes to request: a value of CAN_RAW_ERR_FILTER. */
extern const uint32_t tl_can_fault_classes;

/* `classes`: id of the error frame, with or without flags. */
tl_can_fault tl_can_fault_of(uint32_t classes, const uint8_t data[8]);

/* Describes a state and the remedy; TL_CAN_SAME has no text. */
const char *tl_can_health_text(tl_can_health health);

/* ---- CAN socket: the only part that uses the kernel's interface. Private to the driver.
 *
 * Purpose: opens a raw CAN socket that receives only the wanted ids and error frames, waits for
 *          frames, and reads them.
 * Listens: a raw CAN socket cannot be shut down for sending. So this part uses no symbol that
 *          sends, and tests/check/symbols.py checks the object file.
 * Owner:   one thread makes, opens, receives, closes, releases; any thread may call
 *          tl_can_link_interrupt().
 */

typedef struct tl_can_link {
    char interface[16];
    int socket;        /* −1: not open */
    tl_wake wake;      /* of the waiting thread */
    uint32_t overflow; /* the kernel's last count of dropped frames */
    tl_can_clock clock;
    tl_time monotonic, wall; /* when the queue was last read */
} tl_can_link;

typedef struct tl_can_frame {
    uint32_t id;
    bool extended;
    uint8_t length;
    uint8_t data[TL_CAN_BYTES]; /* 0 beyond the length */
    tl_time stamp;              /* CLOCK_MONOTONIC */
    tl_can_fault fault;         /* of an error frame */
    uint32_t lost;              /* frames dropped by the kernel since the frame before */
} tl_can_frame;

typedef enum tl_can_arrival {
    TL_CAN_NOTHING, /* the queue is empty */
    TL_CAN_DATA,
    TL_CAN_ERROR,
    TL_CAN_OTHER, /* another kind of frame */
    TL_CAN_DOWN,  /* the interface was set down; the socket stays usable */
    TL_CAN_LOST   /* the interface was removed or the socket failed, see errno: close it */
} tl_can_arrival;

/* Returns false with errno if a resource is missing. Opens nothing. */
bool tl_can_link_make(tl_can_link *link, const char *interface);

/* Opens the socket for these ids. Otherwise returns false, and `cause` has the reason and the
 * remedy. */
bool tl_can_link_open(tl_can_link *link, const tl_can_map *map, char *cause, size_t cause_size);

/* State of an open link; false if the interface does not exist any more. */
bool tl_can_link_state(const tl_can_link *link, tl_can_state *state);

/* Waits at most `timeout_ms` for a frame; without a socket only for an interruption. Returns false
 * if interrupted, and clears the interruption. */
bool tl_can_link_await(const tl_can_link *link, int timeout_ms);

/* Reads the next frame without waiting. */
tl_can_arrival tl_can_link_receive(tl_can_link *link, tl_can_frame *frame);

void tl_can_link_close(tl_can_link *link);

/* From any thread: ends the present or the next wait. */
void tl_can_link_interrupt(const tl_can_link *link);

void tl_can_link_release(tl_can_link *link);

#endif
