/* The socket below the CAN driver, and the one place that knows the kernel's interface. Private to the driver.
 *
 * Purpose: opens a raw CAN socket that gets only the wanted ids and error frames, waits for frames, takes them.
 * Listens: a raw CAN socket cannot be shut down for sending. So there is nothing here that sends, and a check holds the
 *          object file to the symbols that it needs (tests/check/symbols.py).
 * Owner:   one thread makes, opens, receives, closes, releases; tl_can_link_interrupt() is for any other.
 */
#ifndef TL_BOARD_CAN_CAN_LINK_H
#define TL_BOARD_CAN_CAN_LINK_H

#include <stddef.h>

#include "board/can/can_clock.h"
#include "board/can/can_codec.h"
#include "board/can/can_fault.h"
#include "board/can/can_interface.h"
#include "board/can/can_map.h"
#include "board/io/wake.h"

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
