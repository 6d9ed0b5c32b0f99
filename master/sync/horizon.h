/* The horizon: how far a candidate is simulated, what is unknown along it, and who matters when.
 *
 * Purpose: T_D of each pair and T_P (4.2), the unknowns of a static or dynamic search (eq. 4.3, 4.4), and from the same
 *          paths Γ_k and C_k (eq. 4.5 to 4.13).
 * Unknowns: of one adjusted variable after the other; of each variable in order of time. Static: one each. Dynamic:
 *          T_P − T_D + 1 each, with the T_D of that variable; what comes later cannot reach an output any more, and the
 *          last one is held.
 * Thread:  plain data after tl_horizon_init(). Memory: the arena.
 */
#ifndef TL_MASTER_SYNC_HORIZON_H
#define TL_MASTER_SYNC_HORIZON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/signal.h"
#include "master/graph/graph.h"

enum { TL_MAX_UNKNOWNS = 256 };

/* A path that is not there. */
#define TL_NEVER UINT32_MAX

typedef struct tl_horizon {
    uint32_t distance;   /* T_D: the smallest of all pairs; 0 where nothing is adjusted */
    uint32_t prediction; /* T_P */
    size_t variables;
    size_t count;                              /* unknowns of all variables */
    size_t offset[TL_MAX_ADJUST];              /* of a variable's first unknown */
    uint32_t length[TL_MAX_ADJUST];            /* its unknowns */
    uint32_t longest;                          /* of these; 1: nothing changes along the horizon */
    uint32_t variable_distance[TL_MAX_ADJUST]; /* its T_D: to the nearest matched output */
    uint32_t match_distance[TL_MAX_MATCH]; /* T_D of a matched output: from the nearest variable; TL_NEVER: weight 0 */
    size_t nodes;                          /* components and the plant, the plant last */
    uint32_t *reach;                       /* Γ_k of each node */
    uint32_t *from_adjust; /* [variable · nodes + k]: c̃ from the variable's component to k; TL_NEVER */
    uint32_t
        *from_signal;  /* [signal · nodes + k]: steps from a plant signal's value to an input of k: 0 for k itself */
    uint32_t *nearest; /* c̃ from the nearest adjusted variable to each node; TL_NEVER */
    uint32_t *longer;  /* C_k: how much longer the way through k is than the shortest; TL_NEVER: k is on none */
} tl_horizon;

/* What the paths of a plan give; the ports are those of its adjust and match entries (none of them NULL). Problems (no
 * path, a prediction that is too short, too many unknowns) go to the report; false when memory is out. */
bool tl_horizon_init(tl_horizon *horizon, tl_arena *arena, const tl_graph *graph, const tl_port *const *adjusted,
                     const tl_port *const *matched, tl_report *report);

/* The value of a variable at `depth` (0 … T_P − 1) of a candidate. */
double tl_horizon_value(const tl_horizon *horizon, const double *u, size_t variable, uint32_t depth);

/* All unknowns of each variable at one value. */
void tl_horizon_hold(const tl_horizon *horizon, const double *values, double *u);

/* A dynamic sequence one step later: the first of each variable falls out, the last is repeated. In place. */
void tl_horizon_shift(const tl_horizon *horizon, double *u);

/* Executions of node k that an evaluation needs from the second on, of the `reach` there are in all: those that another u can
 * have reached (eq. 4.7, and 4.13 where `reach` is Γ_k). */
uint32_t tl_horizon_next_need(const tl_horizon *horizon, size_t node, uint32_t reach);

#endif
