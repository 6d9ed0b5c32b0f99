/* The stage: two places for a twin, and which of them has the twin that the run is of.
 *
 * Purpose: another configuration than a running twin can take needs another twin. That one runs beside it first, over the same mail, as a *shadow*: it is
 *          seen by nobody but who compares it. At a flip the two change places between two ticks: the run's twin computes all ticks before `tick` and ends
 *          its run, the shadow all from `tick` on, as a new run. What was the run's is the shadow then, and a flip back is the same.
 * Order:   the activator orders (tl_live_order), with the candidate beside it; the supervisor begins the shadow, and announces flips on the stage; each
 *          twin looks at it at the start of a tick, and says in its pulse what it has done (tl_live_twin_pulse.flipped). Nobody sends, nobody waits.
 * Tick:    so far ahead that both see it before it has come, and the shadow finds a tick with time to spare in which it saves itself: its run begins with
 *          that checkpoint. A twin that sees a flip after its tick does its part at its next tick, and records a warning.
 * Death:   the supervisor flips once the run's twin has ended its part, or is dead. A shadow that has died by then is begun again as the run's twin.
 * Trust:   the stage is the supervisor's word. An order is bounded by who reads it; the supervisor reads no candidate.
 * Thread:  plain data; one writer, any readers.
 */
#ifndef TL_FIRMWARE_TWIN_HANDOVER_H
#define TL_FIRMWARE_TWIN_HANDOVER_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/base/identity.h"
#include "firmware/base/os.h"
#include "firmware/config/config.h"
#include "master/base/simtime.h"

enum { TL_TWIN_SLOTS = 2, TL_HANDOVER_WHY = 192 };

/* The reason with which a twin ends its run at a flip, and goes on as a shadow. */
#define TL_LIVE_TAKEN_OVER "another configuration has taken over"

/* The reason with which it ends if the run ends for another one. */
#define TL_LIVE_BEGUN_ANEW "another configuration: the run begins anew"

/* ---- the supervisor writes ---- */

typedef enum tl_live_shadow { TL_LIVE_SHADOW_NONE, TL_LIVE_SHADOW_LIVES, TL_LIVE_SHADOW_ENDED } tl_live_shadow;

/* Zeroed at first: the run's twin is in place 0, and nothing was announced. */
typedef struct tl_handover {
    uint32_t place;            /* whose twin is the run's */
    uint32_t order;            /* number of the newest order that was looked at, */
    uint32_t shadow;           /* and what came of it: tl_live_shadow, of the twin in the other place */
    char why[TL_HANDOVER_WHY]; /* it has ended, or could not be begun; written before `shadow` */
    uint32_t handovers;        /* number of the newest flip that was announced: written last; 0: none. */
    uint32_t to;               /* The place whose twin is the run's by it, */
    int64_t tick;              /* from this tick on */
    uint32_t again;            /* 1: all end, and another run begins, with another configuration */
    tl_latest failure;         /* why a twin of the run has ended last: a text of TL_HANDOVER_WHY bytes */
} tl_handover;

/* The newest flip. False: there is none other than `seen`. One relaxed load if there is none. */
static inline bool tl_handover_look(const tl_handover *stage, uint32_t seen, uint32_t *number, uint32_t *to,
                                    int64_t *tick) {
    if (__atomic_load_n(&stage->handovers, __ATOMIC_RELAXED) == seen) {
        return false;
    }
    *number = __atomic_load_n(&stage->handovers, __ATOMIC_ACQUIRE);
    *to = __atomic_load_n(&stage->to, __ATOMIC_RELAXED);
    *tick = __atomic_load_n(&stage->tick, __ATOMIC_RELAXED);
    return *to < TL_TWIN_SLOTS;
}

/* How far ahead a flip is announced: ns. */
static inline tl_time tl_handover_ahead(tl_time step) {
    const tl_time least = TL_SECOND / 4;
    return 5 * step > least ? 5 * step : least;
}

/* ---- the activator writes ---- */

typedef enum tl_live_verb {
    TL_LIVE_NO_SHADOW, /* what is in the other place shall end */
    TL_LIVE_SHADOW,    /* a twin of the candidate shall be there */
    TL_LIVE_HAND_OVER, /* the shadow shall be the run's */
    TL_LIVE_VERBS
} tl_live_verb;

/* What has to be known of a configuration to make room for its twin; found by a process that has read it, and bounded by who takes it. */
typedef struct tl_live_needs {
    uint32_t match, adjust, components; /* components: without the plant */
    uint32_t unconfined;                /* 1: FMUs may do what the user can */
    uint64_t unpacked_bytes;            /* of all FMU files, at most (twin_process.h) */
    uint32_t signals;                   /* of the plant, second look-ups among them */
} tl_live_needs;

/* A new one has a new number, written last. */
typedef struct tl_live_order {
    uint32_t number;
    uint32_t verb; /* tl_live_verb */
    tl_live_needs needs;
} tl_live_order;

/* In a block of its own. Written before the order that is of it, and not again before that is obeyed. */
typedef struct tl_live_candidate {
    uint32_t size;             /* bytes of the text */
    char hash[TL_SHA256_TEXT]; /* of it */
    char text[TL_CONFIG_MAX_BYTES + 1];
} tl_live_candidate;

#endif
