/* The protocol between the program and a process that it has started with a role: every message there is.
 *
 * Purpose: which messages exist, who may send each, in which phase, and of exactly how many bytes. Who sends anything else is broken or
 *          hostile: the receiver says what it was, and there is no second message from it. A child is killed then.
 * Phases:  each side has its own, which says what it may send. It goes on by what that side sends itself, and the parent's also by what
 *          the child has told: a tick may be sent as soon as the twin is built.
 * Sizes:   those of messages whose types are of other rooms are filled in by who opens a channel, the same on both sides.
 * Thread:  pure.
 */
#ifndef TL_FIRMWARE_PROCESS_PROTOCOL_H
#define TL_FIRMWARE_PROCESS_PROTOCOL_H

#include <stdint.h>

#include "master/base/status.h"

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

#endif
