/* Handover between two twin slots: defines which slot has the live twin and when the two twins
 * swap.
 *
 * Purpose: a configuration that the running twin cannot apply needs a second twin. It first runs as
 *          a *shadow* beside the live twin, on the same sample buffers; its results are only
 *          compared. A handover swaps the two between two ticks: the live twin computes all ticks
 *          before `tick` and ends its run; the shadow computes all ticks from `tick` on, as a new
 *          run. The former live twin becomes the shadow. A second handover swaps them back in the
 *          same way.
 * Order:   the config manager writes an order (tl_live_order) and the candidate configuration. The
 *          supervisor starts the shadow and announces handovers in this block. Each twin reads the
 *          block at the start of a tick, and publishes in its status block what it has done
 *          (tl_live_twin_status.handed_over). No process sends a message or waits.
 * Tick:    the handover tick is far enough ahead that both twins see it in time, and that the
 *          shadow finds a tick with time to save a checkpoint, with which its run begins. A twin
 *          that sees a handover after its tick does its part at its next tick, and records a
 *          warning.
 * Death:   the supervisor completes a handover when the live twin has done its part or is dead. If
 *          the shadow is dead by then, it is started again as the live twin.
 * Trust:   the handover block comes from the supervisor and is trusted. The supervisor validates an
 *          order; it never reads a candidate.
 * Memory:  shared memory; plain data.
 * Thread:  one writer, any readers.
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

/* End reason of a run at a handover; the twin continues as a shadow. */
#define TL_LIVE_HANDED_OVER "handover to another configuration"

/* End reason of a run if a new run with another configuration replaces it. */
#define TL_LIVE_RESTARTED "restarted with another configuration"

/* ---- the supervisor writes ---- */

typedef enum tl_live_shadow { TL_LIVE_SHADOW_NONE, TL_LIVE_SHADOW_RUNS, TL_LIVE_SHADOW_ENDED } tl_live_shadow;

/* Zeroed at first: the live twin is in slot 0, no handover was announced. */
typedef struct tl_handover {
    uint32_t slot_index;       /* slot of the live twin, 0 or 1 */
    uint32_t order;            /* number of the newest order that was processed */
    uint32_t shadow;           /* tl_live_shadow: state of the twin in the other slot after that order */
    char why[TL_HANDOVER_WHY]; /* why the shadow ended or could not start; written before `shadow` */
    uint32_t handovers;        /* number of the newest announced handover; written last; 0: none */
    uint32_t to;               /* slot of the live twin after that handover */
    int64_t tick;              /* first tick of that twin as the live one */
    uint32_t again;            /* 1: all twins end, and a new run begins with another configuration */
    tl_latest failure;         /* why the last live twin ended: a text of TL_HANDOVER_WHY bytes */
} tl_handover;

/* Reads the newest announced handover. `seen`: number of the newest one that the caller knows.
 * Returns false if there is no newer one, or if `to` is not a slot. */
static inline bool tl_handover_read(const tl_handover *handover_block, uint32_t seen, uint32_t *number, uint32_t *to,
                                    int64_t *tick) {
    if (__atomic_load_n(&handover_block->handovers, __ATOMIC_RELAXED) == seen) {
        return false;
    }
    *number = __atomic_load_n(&handover_block->handovers, __ATOMIC_ACQUIRE);
    *to = __atomic_load_n(&handover_block->to, __ATOMIC_RELAXED);
    *tick = __atomic_load_n(&handover_block->tick, __ATOMIC_RELAXED);
    return *to < TL_TWIN_SLOTS;
}

/* Returns how long before its tick a handover is announced, ns: 5 steps, at least 0.25 s. `step`:
 * T_S, ns. */
static inline tl_time tl_handover_ahead(tl_time step) {
    const tl_time least = TL_SECOND / 4;
    return 5 * step > least ? 5 * step : least;
}

/* ---- the config manager writes ---- */

typedef enum tl_live_verb {
    TL_LIVE_NO_SHADOW, /* terminate the twin in the other slot */
    TL_LIVE_SHADOW,    /* start a twin with the candidate configuration in the other slot */
    TL_LIVE_HAND_OVER, /* make the shadow the live twin */
    TL_LIVE_VERBS
} tl_live_verb;

/* Sizes of a configuration, to allocate memory for its twin. A worker that has parsed the
 * configuration computes them; they are untrusted, so the reader must check their bounds. */
typedef struct tl_live_needs {
    uint32_t match, adjust, components; /* numbers of matched outputs, adjusted variables, FMU components */
    uint32_t unconfined;                /* 1: FMUs run without confinement, with the user's rights */
    uint64_t unpacked_bytes;            /* upper limit for all FMU files together (twin_process.h) */
    uint32_t signals;                   /* signals of the plant, including further look-ups (tl_config_use_lookups()) */
} tl_live_needs;

/* Order to the supervisor. A new order has a new number, which is written last. */
typedef struct tl_live_order {
    uint32_t number;
    uint32_t verb; /* tl_live_verb */
    tl_live_needs needs;
} tl_live_order;

/* Candidate configuration, in a block of its own. Written before its order, and not changed until
 * that order is processed. */
typedef struct tl_live_candidate {
    uint32_t size;             /* bytes of the text, without its NUL */
    char hash[TL_SHA256_TEXT]; /* SHA-256 of the text */
    char text[TL_CONFIG_MAX_BYTES + 1];
} tl_live_candidate;

#endif
