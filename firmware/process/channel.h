/* Channel between an FMU process and its parent: messages of fixed sizes in shared memory, and the
 * protocol of these messages.
 *
 * Thread:  one thread on each side.
 */
#ifndef TL_FIRMWARE_PROCESS_CHANNEL_H
#define TL_FIRMWARE_PROCESS_CHANNEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- Protocol between the program and a process that it has started with a role: all messages.
 *
 * Purpose: defines the messages: which side sends them, in which phase, and their exact sizes. A
 *          side that sends anything else is broken or hostile: the other side reports the message
 *          and accepts no further one. If the child did it, the parent kills the child.
 * Phases:  each side has its own phase, which determines what it may send. A message advances the
 *          phase of its sender, as listed below. READY and BUILT also advance the parent's phase.
 *          So the parent may send ticks as soon as the child has built the twin.
 * Sizes:   the code that opens a channel sets the sizes of the messages (twin_role.h); both sides
 *          must use the same sizes.
 * Thread:  pure functions.
 */

typedef enum tl_side {
    TL_PARENT, /* owns files, plant connection and terminal */
    TL_CHILD,  /* FMU process */
    TL_SIDES
} tl_side;

typedef enum tl_phase {
    TL_STARTING, /* the child confines itself */
    TL_BUILDING, /* the child loads FMUs */
    TL_STEPPING,
    TL_ENDING /* this side sends nothing more; the parent may still send TL_MESSAGE_END */
} tl_phase;

typedef enum tl_message {
    /* From the parent. "STEPPING, then ENDING": allowed in STEPPING, and begins ENDING. */
    TL_MESSAGE_TICK,   /* a sample of the plant; STEPPING */
    TL_MESSAGE_FINISH, /* the last tick; STEPPING, then ENDING */
    TL_MESSAGE_SEEN,   /* answer to SHOWN: result of the reader process (read_back.h); STEPPING */
    TL_MESSAGE_END,    /* request to end as soon as possible; no bytes; any phase, then ENDING */
    /* From the child. */
    TL_MESSAGE_READY,  /* how the child is confined (confine.h); STARTING, then BUILDING */
    TL_MESSAGE_BUILT,  /* the twin is built, its tl_account is in the child's block; BUILDING, then STEPPING */
    TL_MESSAGE_RESULT, /* result of a step; STEPPING */
    TL_MESSAGE_SHOWN,  /* requests a reader process (read_back.h), or shows progress (explainer); no bytes; STEPPING */
    TL_MESSAGE_ENDED,  /* why the child ends; any phase except ENDING, then ENDING */
    TL_MESSAGES
} tl_message;

/* Bytes of each message; 0 for TL_MESSAGE_END and TL_MESSAGE_SHOWN. */
typedef struct tl_protocol_sizes {
    uint32_t bytes[TL_MESSAGES];
} tl_protocol_sizes;

/* Phases of both sides, as one side knows them. Zeroed: both are STARTING. */
typedef struct tl_protocol_phases {
    tl_phase of[TL_SIDES];
} tl_protocol_phases;

/* Checks whether `sender` may send a message of this `type` and `length` (bytes) now; both are
 * untrusted. Errors: TL_FMU_FAILED if not; the text names the message and the cause. */
tl_status tl_protocol_check(const tl_protocol_sizes *sizes, const tl_protocol_phases *phases, tl_side sender,
                            uint32_t type, uint32_t length, tl_error *error);

/* Advances the phases after an allowed message was sent or received. */
void tl_protocol_continue(tl_protocol_phases *phases, tl_message type);

/* Returns the size of the longest message of a side, bytes. */
uint32_t tl_protocol_longest(const tl_protocol_sizes *sizes, tl_side sender);

/* ---- Channel: exchanges these messages between two processes through two rings in shared memory.
 *
 * Purpose: each side writes only its own block: the slots of its messages, the number sent, and the
 *          number received from the other side. A message costs one copy on each side. No system
 *          call is needed while neither side sleeps.
 * Waking:  a waiting side announces for how many messages, or free slots, it waits. The other side
 *          wakes the waiting side when there are that many. If the other side is about to sleep
 *          too, it wakes the waiting side for a single message or slot. So large batches cost few
 *          wake-ups, and the two sides never both sleep with work pending. To receive each message
 *          at once, wait for 1. All messages except ticks and results are urgent: they wake the
 *          waiting side at once, because the sender may send no further message.
 * Trust:   the other side's block is untrusted. Counters are checked against the ring size. A
 *          slot's type and length are read once and validated before the payload is copied. The
 *          first fault breaks the channel, and `fault` is the reason. Then no message can be sent,
 *          and receiving or waiting returns TL_CHANNEL_BROKEN.
 * Owner:   the caller owns the channel and the blocks, which must stay mapped. A block is used for
 *          one channel only and must be zeroed before.
 * Thread:  one thread of each side; any other thread for tl_channel_nudge().
 */

enum { TL_CHANNEL_DEPTH = 1024 }; /* slots per ring */

/* Must be the same on both sides. */
typedef struct tl_channel_settings {
    tl_protocol_sizes sizes;
    size_t extra[TL_SIDES]; /* additional bytes in the block of each side, for the caller; 0: none */
} tl_channel_settings;

typedef enum tl_channel_event {
    TL_CHANNEL_NOTHING,   /* no message, or not enough before the timeout */
    TL_CHANNEL_SOMETHING, /* a message was received, or a condition of the wait is met */
    TL_CHANNEL_NUDGED,    /* tl_channel_nudge() was called, or a signal arrived */
    TL_CHANNEL_BROKEN
} tl_channel_event;

struct tl_channel_control;

/* Fields are private, except `fault`. */
typedef struct tl_channel {
    tl_error fault; /* fault of the other side; TL_OK: none */
    tl_channel_settings settings;
    tl_side side;
    struct tl_channel_control *own;
    const struct tl_channel_control *other;
    uint8_t *own_slots;
    const uint8_t *other_slots;
    size_t own_stride; /* bytes per slot */
    size_t other_stride;
    uint32_t offered;      /* number of messages that this side has written so far */
    uint32_t urgent;       /* messages up to this number must wake the other side at once */
    uint32_t taken;        /* number of messages that this side has received so far */
    uint32_t other_taken;  /* number that the other side has received, as read last */
    uint32_t other_pushed; /* number that the other side has sent, as read last */
    uint32_t woken;        /* sleep counter of the other side when this side last woke it */
    tl_protocol_phases phases;
    uint32_t nudges; /* number of nudges, by any thread */
    uint32_t heeded; /* number of nudges that were handled */
    bool sleeps;
} tl_channel;

/* Returns the size of a side's block, bytes; a multiple of 4096. */
size_t tl_channel_bytes(const tl_channel_settings *settings, tl_side side);

/* Opens a channel for `side`. `blocks`: mapped memory of both sides, each of tl_channel_bytes();
 * page-aligned. The other side's block may be read-only. */
void tl_channel_open(const tl_channel_settings *settings, tl_side side, void *const blocks[TL_SIDES],
                     tl_channel *channel);

/* Returns a pointer to the additional bytes in the block of `side`, aligned to 64 bytes; only that
 * side may write them. NULL if `extra` is 0. */
void *tl_channel_extra(const tl_channel_settings *settings, tl_side side, void *block);

/* Writes a message into the ring. `payload` has the size of its type; NULL if that is 0. The
 * protocol must allow the message (asserted). Returns false if the ring is full or the channel is
 * broken. The other side sees the message only after tl_channel_push(), _show() or _wait(). */
bool tl_channel_offer(tl_channel *channel, tl_message type, const void *payload);

/* Publishes written messages without waking the other side. The other side finds them at its next
 * tl_channel_take(), even if this process has ended by then. This is cheaper than
 * tl_channel_push(), but call tl_channel_push() or tl_channel_wait() regularly. */
void tl_channel_show(tl_channel *channel);

/* Publishes how many messages this side has written and received, and wakes the other side if it
 * waits for them. */
void tl_channel_push(tl_channel *channel);

/* Reads the next message without blocking. Returns SOMETHING (*type and `payload` are set), NOTHING
 * or BROKEN. `payload` must have the size of the other side's longest message. */
tl_channel_event tl_channel_take(tl_channel *channel, tl_message *type, void *payload);

/* Pushes, then sleeps until `messages` can be received or `room` slots are free. 0 disables a
 * condition; at least one must be above 0, and both are at most TL_CHANNEL_DEPTH. Returns:
 * SOMETHING: a condition is met, or partly met while the other side sleeps, or an urgent message
 *            has arrived.
 * NOTHING:   the instant `until` (CLOCK_MONOTONIC, ns) has passed; there may be some messages or
 *            slots, but too few.
 * NUDGED:    tl_channel_nudge() was called, or a signal arrived.
 * BROKEN:    the channel is broken. */
tl_channel_event tl_channel_wait(tl_channel *channel, uint32_t messages, uint32_t room, tl_time until);

/* Makes the present or next tl_channel_wait() of this side return TL_CHANNEL_NUDGED. If the thread
 * sleeps there, waits until the thread has noticed. Any other thread of this side may call it while
 * the channel is open; signal handlers must not. */
void tl_channel_nudge(tl_channel *channel);

#endif
