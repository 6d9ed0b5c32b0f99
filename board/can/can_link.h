/* The socket of a CAN interface: its frames, their clock, and what is wrong with the bus.
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

/* ---- The kernel's receive stamps, which tell the wall clock, as CLOCK_MONOTONIC. Private to the CAN driver.
 *
 * Purpose: a frame's age is what the wall clock says, as long as that makes sense. The wall clock may be set between
 *          the reception of a frame and its reading; but it was received after the queue had last been empty (or after
 *          the frame before it), and before now. So a stamp that leaves this interval is converted as the clock stood
 *          before, and where that leaves it too, is moved to the nearer end.
 * Bound:   with a clock that is set, a stamp is wrong by no more than that interval; it never goes back.
 * Thread:  one; no clock is asked here.
 */

/* Zeroed is a beginning. */
typedef struct tl_can_clock {
    tl_time floor; /* CLOCK_MONOTONIC: nothing that comes was received before */
    tl_time ahead; /* wall clock − CLOCK_MONOTONIC, when the queue was last empty */
    bool known;    /* `ahead` is */
} tl_can_clock;

/* The queue is empty: now, by both clocks. */
void tl_can_clock_empty(tl_can_clock *clock, tl_time monotonic, tl_time wall);

/* The stamp of a frame that the kernel received at `received` (wall clock; 0: it does not say), read now. */
tl_time tl_can_clock_stamp(tl_can_clock *clock, tl_time received, tl_time monotonic, tl_time wall);

/* ---- What an error frame of a CAN controller means. Private to the CAN driver.
 *
 * Purpose: from the bits of the kernel's error frames to the few things that a listener can tell.
 * Source:  linux/can/error.h; ISO 11898-1, fault confinement.
 */

/* The controller's state. */
typedef enum tl_can_health { TL_CAN_SAME, TL_CAN_ACTIVE, TL_CAN_WARNING, TL_CAN_PASSIVE, TL_CAN_BUS_OFF } tl_can_health;

typedef struct tl_can_fault {
    tl_can_health health;  /* TL_CAN_SAME: this frame does not tell */
    bool overflow;         /* the controller had no room for a frame */
    const char *bus_error; /* what is wrong on the bus, in words; NULL: nothing */
} tl_can_fault;

/* The classes of errors that are asked for: a value of CAN_RAW_ERR_FILTER. */
extern const uint32_t tl_can_fault_classes;

/* `classes`: the id of the error frame, with or without its flags. */
tl_can_fault tl_can_fault_of(uint32_t classes, const uint8_t data[8]);

/* What a state means and what to do about it; TL_CAN_SAME has no text. */
const char *tl_can_health_text(tl_can_health health);

/* ---- The socket below the CAN driver, and the one place that knows the kernel's interface. Private to the driver.
 *
 * Purpose: opens a raw CAN socket that gets only the wanted ids and error frames, waits for frames, takes them.
 * Listens: a raw CAN socket cannot be shut down for sending. So there is nothing here that sends, and a check holds the
 *          object file to the symbols that it needs (tests/check/symbols.py).
 * Owner:   one thread makes, opens, receives, closes, releases; tl_can_link_interrupt() is for any other.
 */

typedef struct tl_can_link {
    char interface[16];
    int socket;        /* −1: not open */
    tl_wake wake;      /* of a thread that awaits */
    uint32_t overflow; /* the kernel's count of frames without room, as last seen */
    tl_can_clock clock;
    tl_time monotonic, wall; /* when the queue was looked at last */
} tl_can_link;

typedef struct tl_can_frame {
    uint32_t id;
    bool extended;
    uint8_t length;
    uint8_t data[TL_CAN_BYTES]; /* 0 behind the length */
    tl_time stamp;              /* CLOCK_MONOTONIC */
    tl_can_fault fault;         /* of an error frame */
    uint32_t lost;              /* frames that the kernel had no room for since the one before */
} tl_can_frame;

typedef enum tl_can_arrival {
    TL_CAN_NOTHING, /* the queue is empty */
    TL_CAN_DATA,
    TL_CAN_ERROR,
    TL_CAN_OTHER, /* a frame that is neither */
    TL_CAN_DOWN,  /* the interface was set down; the socket stays good */
    TL_CAN_LOST   /* it was removed, or the socket failed: errno says why; close it */
} tl_can_arrival;

/* false where a resource is missing; errno says which. Opens nothing. */
bool tl_can_link_make(tl_can_link *link, const char *interface);

/* Opens the socket for these ids. Else false, and `cause` says why and what to do. */
bool tl_can_link_open(tl_can_link *link, const tl_can_map *map, char *cause, size_t cause_size);

/* Of an open link; false where there is no such interface any more. */
bool tl_can_link_state(const tl_can_link *link, tl_can_state *state);

/* Waits at most `timeout_ms` for a frame; without a socket, for an interruption only. false: interrupted, which is
 * noticed with this. */
bool tl_can_link_await(const tl_can_link *link, int timeout_ms);

/* The next frame that has come, without waiting. */
tl_can_arrival tl_can_link_receive(tl_can_link *link, tl_can_frame *frame);

void tl_can_link_close(tl_can_link *link);

/* Any thread: ends the waiting of the thread that awaits, or else its next one. */
void tl_can_link_interrupt(const tl_can_link *link);

void tl_can_link_release(tl_can_link *link);

#endif
