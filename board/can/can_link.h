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
 * Purpose: the wall clock may be set after the kernel stamped a frame and before the driver reads
 *          it. Then a conversion with the present offset of the clocks is wrong.
 * Check:   a frame was received in a known interval. The interval starts when the queue was last
 *          empty (or with the frame before), and ends now. If the converted stamp is outside, it is
 *          converted again, with the offset at the time when the queue was last empty. If this
 *          result is outside too, the stamp is the nearer end of the interval.
 * Bound:   after the wall clock was set, a stamp is wrong by at most the length of that interval.
 *          Stamps never decrease.
 * Thread:  one; reads no clock itself.
 */

/* Starts as zeros. */
typedef struct tl_can_clock {
    tl_time floor; /* start of the interval, CLOCK_MONOTONIC, ns */
    tl_time ahead; /* wall clock − CLOCK_MONOTONIC when the queue was last empty, ns */
    bool known;    /* `ahead` is valid */
} tl_can_clock;

/* Records that the queue is empty at this time, by both clocks. */
void tl_can_clock_empty(tl_can_clock *clock, tl_time monotonic, tl_time wall);

/* Returns the stamp of a frame, CLOCK_MONOTONIC. `received`: the kernel's stamp, wall clock; 0:
 * unknown. `monotonic`, `wall`: the present time by both clocks. */
tl_time tl_can_clock_stamp(tl_can_clock *clock, tl_time received, tl_time monotonic, tl_time wall);

/* ---- Decoding of a CAN controller's error frames. Private to the CAN driver.
 *
 * Purpose: converts the bits of the kernel's error frames to the problems that a program which only
 *          listens can have.
 * Source:  linux/can/error.h; ISO 11898-1, fault confinement.
 */

/* Error state of the CAN controller. The state of the interface (up, running) is tl_can_state. */
typedef enum tl_can_health { TL_CAN_SAME, TL_CAN_ACTIVE, TL_CAN_WARNING, TL_CAN_PASSIVE, TL_CAN_BUS_OFF } tl_can_health;

typedef struct tl_can_fault {
    tl_can_health health;  /* TL_CAN_SAME: this frame does not report the state */
    bool overflow;         /* the controller had no room for a frame */
    const char *bus_error; /* description of the error on the bus; NULL: none */
} tl_can_fault;

/* Error classes to request from the kernel: the value for the option CAN_RAW_ERR_FILTER. */
extern const uint32_t tl_can_fault_classes;

/* Decodes an error frame. `classes`: its id, with or without flags. */
tl_can_fault tl_can_fault_of(uint32_t classes, const uint8_t data[8]);

/* Describes a state and the remedy; TL_CAN_SAME has no text. */
const char *tl_can_health_text(tl_can_health health);

/* ---- CAN socket: the only part that uses the kernel's interface. Private to the driver.
 *
 * Purpose: opens a raw CAN socket that receives only the wanted ids and error frames, waits for
 *          frames, and reads them.
 * Listens: this part calls no function that sends; tests/check/symbols.py checks this in the object
 *          file. shutdown() cannot disable sending on a raw CAN socket.
 * Thread:  one thread calls all functions; any thread may call tl_can_link_interrupt().
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
    tl_time stamp;              /* CLOCK_MONOTONIC, ns */
    tl_can_fault fault;         /* only with TL_CAN_ERROR */
    uint32_t lost;              /* number of frames that the kernel dropped since the frame before */
} tl_can_frame;

typedef enum tl_can_arrival {
    TL_CAN_NOTHING, /* the queue is empty */
    TL_CAN_DATA,
    TL_CAN_ERROR,
    TL_CAN_OTHER, /* another kind of frame, which is not used */
    TL_CAN_DOWN,  /* the interface was set down; the socket stays usable */
    TL_CAN_LOST   /* the interface was removed or the socket failed, see errno: close it */
} tl_can_arrival;

/* Initialises a link; opens no socket. Returns false with errno if a resource is missing. */
bool tl_can_link_make(tl_can_link *link, const char *interface);

/* Opens the socket for the ids of `map`, at most CAN_RAW_FILTER_MAX (512). Returns false if this
 * fails; then `cause` has the reason, and the remedy if it is known. */
bool tl_can_link_open(tl_can_link *link, const tl_can_map *map, char *cause, size_t cause_size);

/* Reads the state of the interface; the link must be open. Returns false if the interface does not
 * exist any more. */
bool tl_can_link_state(const tl_can_link *link, tl_can_state *state);

/* Waits at most `timeout_ms` for a frame; without a socket only for an interruption. After an
 * interruption, clears it and returns false. */
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
