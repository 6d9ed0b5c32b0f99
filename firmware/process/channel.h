/* A channel: the messages of protocol.h between two processes, by two rings in shared memory.
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
#ifndef TL_FIRMWARE_PROCESS_CHANNEL_H
#define TL_FIRMWARE_PROCESS_CHANNEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/protocol.h"
#include "master/base/simtime.h"
#include "master/base/status.h"

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
