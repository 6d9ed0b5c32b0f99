/* A channel between two of our processes: calls and answers of fixed sizes in shared memory, and the protocol of the process with FMUs.
 *
 * Thread:  one on each side.
 */
#ifndef TL_FIRMWARE_PROCESS_CHANNEL_H
#define TL_FIRMWARE_PROCESS_CHANNEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/simtime.h"
#include "master/base/status.h"

/* ---- The protocol between the program and a process that it has started with a role: every message there is.
 *
 * Purpose: which messages exist, who may send each, in which phase, and of exactly how many bytes. Who sends anything else is broken or
 *          hostile: the receiver says what it was, and there is no second message from it. A child is killed then.
 * Phases:  each side has its own, which says what it may send. It goes on by what that side sends itself, and the parent's also by what
 *          the child has told: a tick may be sent as soon as the twin is built.
 * Sizes:   those of messages whose types are of other rooms are filled in by who opens a channel, the same on both sides.
 * Thread:  pure.
 */

typedef enum tl_side {
    TL_PARENT, /* holds files, plant, terminal */
    TL_CHILD,  /* holds FMUs */
    TL_SIDES
} tl_side;

typedef enum tl_phase {
    TL_STARTING, /* the child confines itself */
    TL_BUILDING, /* it loads FMUs */
    TL_STEPPING,
    TL_ENDING /* nothing more comes of this side; of the parent: but TL_MESSAGE_END */
} tl_phase;

typedef enum tl_message {
    /* from the parent */
    TL_MESSAGE_TICK,   /* a sample of the plant; STEPPING */
    TL_MESSAGE_FINISH, /* as a tick, the last one; STEPPING, then ENDING */
    TL_MESSAGE_SEEN,   /* how another process has ended that was to look at what was shown; STEPPING */
    TL_MESSAGE_END,    /* end as soon as you can; no bytes; always, then ENDING */
    /* from the child */
    TL_MESSAGE_READY,  /* how it is confined; STARTING, then BUILDING */
    TL_MESSAGE_BUILT,  /* the account is in its block; BUILDING, then STEPPING */
    TL_MESSAGE_RESULT, /* of a step; STEPPING */
    TL_MESSAGE_SHOWN,  /* something for another process of its kind (read_back.h); no bytes; STEPPING */
    TL_MESSAGE_ENDED,  /* why it ends; always, then ENDING */
    TL_MESSAGES
} tl_message;

/* The bytes of each message. Those of TL_MESSAGE_END and TL_MESSAGE_SHOWN are 0. */
typedef struct tl_protocol_sizes {
    uint32_t bytes[TL_MESSAGES];
} tl_protocol_sizes;

/* The phases of both sides, as one of them knows them. A zeroed one: both are STARTING. */
typedef struct tl_protocol_phases {
    tl_phase of[TL_SIDES];
} tl_protocol_phases;

/* TL_OK, or TL_FMU_FAILED and which message was not allowed, and why: of `type` and `length`, which nobody has checked, from `sender`. */
tl_status tl_protocol_check(const tl_protocol_sizes *sizes, const tl_protocol_phases *phases, tl_side sender,
                            uint32_t type, uint32_t length, tl_error *error);

/* A message was sent, or received, that is allowed. */
void tl_protocol_go_on(tl_protocol_phases *phases, tl_message type);

/* The bytes of the longest message of a side. */
uint32_t tl_protocol_longest(const tl_protocol_sizes *sizes, tl_side sender);

/* ---- A channel: the messages of channel.h between two processes, by two rings in shared memory.
 *
 * Purpose: each side writes its own block only: the slots of what it sends, how many it has sent, how many it has taken of the other's. So
 *          a message costs a copy on each side and, as long as nobody sleeps, no system call.
 * Waking:  who waits says for how many messages, or for how much room. It is woken when there are that many, or if there are any and the
 *          other goes to sleep itself: large batches cost few wake-ups, and yet the two never sleep with something to do. Who wants
 *          each message at once wants 1. All messages but ticks and results wake at once: none may come after them.
 * Trust:   what is in the other's block is hostile. Counters are held against the depth, a slot's type and length are read once and
 *          checked before its payload is copied out. The first fault ends it: all calls then say TL_CHANNEL_BROKEN, and `fault` why.
 * Owner:   the caller places a channel, and the blocks, which must stay; it does not own them. A block is used for one channel in its
 *          life, and begins as zeros.
 * Thread:  one thread of each side, but for tl_channel_nudge().
 */

enum { TL_CHANNEL_DEPTH = 1024 }; /* slots of each ring */

/* The same on both sides. */
typedef struct tl_channel_settings {
    tl_protocol_sizes sizes;
    size_t extra[TL_SIDES]; /* bytes for others in the block of each side */
} tl_channel_settings;

typedef enum tl_channel_news {
    TL_CHANNEL_NOTHING, /* no message is there; the time is over */
    TL_CHANNEL_SOMETHING,
    TL_CHANNEL_NUDGED, /* somebody wants this thread, or a signal came */
    TL_CHANNEL_BROKEN
} tl_channel_news;

struct tl_channel_control;

/* Private but for `fault`. */
typedef struct tl_channel {
    tl_error fault; /* what the other did; TL_OK: nothing */
    tl_channel_settings settings;
    tl_side side;
    struct tl_channel_control *own;
    const struct tl_channel_control *other;
    uint8_t *own_slots;
    const uint8_t *other_slots;
    size_t own_stride; /* bytes from slot to slot */
    size_t other_stride;
    uint32_t offered;      /* messages ever */
    uint32_t urgent;       /* those up to this one are not kept for a batch */
    uint32_t taken;        /* of the other's */
    uint32_t other_taken;  /* as seen last */
    uint32_t other_pushed; /* as seen last */
    uint32_t woken;        /* the sleep of the other's that we have ended */
    tl_protocol_phases phases;
    uint32_t nudges; /* by any thread */
    uint32_t heeded; /* of these */
    bool sleeps;
} tl_channel;

/* What the block of a side must hold. */
size_t tl_channel_bytes(const tl_channel_settings *settings, tl_side side);

/* `blocks`: both sides' memory as mapped here, each of tl_channel_bytes(), at the beginning of a page. */
void tl_channel_open(const tl_channel_settings *settings, tl_side side, void *const blocks[TL_SIDES],
                     tl_channel *channel);

/* The bytes for others in a side's block, aligned to 64; only that side may write them. NULL where there are none. */
void *tl_channel_extra(const tl_channel_settings *settings, tl_side side, void *block);

/* The payload has the bytes of its type; NULL where it has none. False: the ring is full, or the channel is broken. It must be allowed by the
 * protocol. The other sees it after tl_channel_push(). */
bool tl_channel_offer(tl_channel *channel, tl_message type, const void *payload);

/* Shows the other what was offered; it finds that when it looks, even if we are gone by then. Cheaper than to push: push, or wait, now
 * and then. */
void tl_channel_show(tl_channel *channel);

/* The same, and what was taken, and wakes it if that is what it waits for. */
void tl_channel_push(tl_channel *channel);

/* The next message: SOMETHING, NOTHING or BROKEN. `payload` takes the longest message of the other's. */
tl_channel_news tl_channel_take(tl_channel *channel, tl_message *type, void *payload);

/* Pushes, and sleeps until `messages` of the other's are there, or there is room for `room` of ours (0: does not count; at least one does; at
 * most TL_CHANNEL_DEPTH), or some of what counts is and the other sleeps: SOMETHING. Or until the instant `until` (CLOCK_MONOTONIC, ns):
 * NOTHING, though fewer than wanted may be there. Or NUDGED, or BROKEN. */
tl_channel_news tl_channel_wait(tl_channel *channel, uint32_t messages, uint32_t room, tl_time until);

/* The thread that waits, or does so next, comes back. Any thread of this side but that one, while the channel is open; no signal handler. */
void tl_channel_nudge(tl_channel *channel);

#endif
