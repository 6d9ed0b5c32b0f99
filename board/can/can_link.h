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
 * Purpose: the wall clock may be set after a frame was received and before it is read. Then
 *          the converted stamp is wrong.
 * Check:   a frame was received in a known interval: it starts when the queue was last empty (or
 *          with the frame before), and ends now. If the converted stamp is outside, it is converted
 *          again, with the offset that the clocks had when the queue was last empty. If it is still
 *          outside, the nearer end of the interval is used.
 * Bound:   after a change of the clock, a stamp is wrong by at most the length of that interval.
 *          Stamps never decrease.
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

/* Error state of the CAN controller. The state of the interface (up, running) is tl_can_state. */
typedef enum tl_can_health { TL_CAN_SAME, TL_CAN_ACTIVE, TL_CAN_WARNING, TL_CAN_PASSIVE, TL_CAN_BUS_OFF } tl_can_health;

typedef struct tl_can_fault {
    tl_can_health health;  /* TL_CAN_SAME: this frame does not report it */
    bool overflow;         /* the controller had no room for a frame */
    const char *bus_error; /* description of the error on the bus; NULL: none */
} tl_can_fault;

/* Error classes to request from the kernel: the value for the option CAN_RAW_ERR_FILTER. */
extern const uint32_t tl_can_fault_classes;

/* `classes`: id of the error frame, with or without flags. */
tl_can_fault tl_can_fault_of(uint32_t classes, const uint8_t data[8]);

/* Describes a state and the remedy; TL_CAN_SAME has no text. */
const char *tl_can_health_text(tl_can_health health);

/* ---- CAN socket: the only part that uses the kernel's interface. Private to the driver.
 *
 * Purpose: opens a raw CAN socket that receives only the wanted ids and error frames, waits for
 *          frames, and reads them.
 * Listens: shutdown() cannot disable sending on a raw CAN socket. Instead this part calls no
 *          function that sends; tests/check/symbols.py checks this in the object file.
 * Owner:   one thread makes, opens, receives, closes, releases; any thread may call
 *          tl_can_link_interrupt().
 */

typedef struct tl_can_link {
    char interface[16];
    int socket;        /* −1: not open */
    tl_wake wake;      /* of the waiting thread */
    uint32_t overflow; /* the kernel's last count of dropped frames */
    tl_can_clock clock;
    tl_time monotonic, wall; /* when the queue was last read, by both clocks */
} tl_can_link;

typedef struct tl_can_frame {
    uint32_t id;
    bool extended;
    uint8_t length;
    uint8_t data[TL_CAN_BYTES]; /* 0 beyond the length */
    tl_time stamp;              /* CLOCK_MONOTONIC */
    tl_can_fault fault;         /* of an error frame */
    uint32_t lost;              /* number of frames that the kernel dropped since the frame before */
} tl_can_frame;

typedef enum tl_can_arrival {
    TL_CAN_NOTHING, /* the queue is empty */
    TL_CAN_DATA,
    TL_CAN_ERROR,
    TL_CAN_OTHER, /* another kind of frame */
    TL_CAN_DOWN,  /* the interface was set down; the socket stays usable */
    TL_CAN_LOST   /* the interface was removed or the socket failed, see errno: close it */
} tl_can_arrival;

/* Initialises a link; opens no socket. Returns false with errno if a resource is missing. */
bool tl_can_link_make(tl_can_link *link, const char *interface);

/* Opens the socket for the ids of `map`. Returns false if this fails; then `cause` has the reason
 * and the remedy. */
bool tl_can_link_open(tl_can_link *link, const tl_can_map *map, char *cause, size_t cause_size);

/* State of an open link; false if the interface does not exist any more. */
bool tl_can_link_state(const tl_can_link *link, tl_can_state *state);

/* Waits at most `timeout_ms` for a frame; without a socket only for an interruption. Returns false
 * if interrupted, and clears the interruption. */
bool tl_can_link_await(tl_can_link *link, int timeout_ms);

/* Reads the next frame without waiting. */
tl_can_arrival tl_can_link_receive(tl_can_link *link, tl_can_frame *frame);

/* Closes the socket. The link can be opened again. */
void tl_can_link_close(tl_can_link *link);

/* From any thread: ends the present or the next wait. */
void tl_can_link_interrupt(tl_can_link *link);

/* Closes the socket and frees what tl_can_link_make() has created. */
void tl_can_link_release(tl_can_link *link);

#endif
