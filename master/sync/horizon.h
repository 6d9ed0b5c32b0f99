/* Horizon: how many steps a candidate simulates, its unknowns, and which components take part in
 *          which step.
 *
 * Purpose: computes, from the paths of the graph: T_D of each pair of an adjusted variable and a
 *          matched output, and T_P (thesis 4.2); the unknowns of a static or dynamic search (eq.
 *          4.3, 4.4); Γ_k and C_k (eq. 4.5 to 4.13).
 * Unknowns: ordered by adjusted variable, then by time. Static: one per variable. Dynamic: T_P −
 *           T_D + 1 per variable, with the T_D of that variable. The last one applies to the rest
 *           of the horizon, because later values cannot reach an output within it.
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

/* There is no path. */
#define TL_NEVER UINT32_MAX

typedef struct tl_horizon {
    uint32_t distance;              /* T_D, macro steps: the smallest of all pairs; 0 if nothing is adjusted */
    uint32_t prediction;            /* T_P, macro steps */
    size_t variables;               /* number of adjusted variables */
    size_t count;                   /* unknowns of all variables */
    size_t offset[TL_MAX_ADJUST];   /* first unknown of a variable */
    uint32_t length[TL_MAX_ADJUST]; /* number of unknowns of a variable */
    uint32_t longest;               /* the largest `length`; 1: u is constant over the horizon */
    uint32_t variable_distance[TL_MAX_ADJUST]; /* T_D of a variable: to the nearest matched output */
    uint32_t match_distance[TL_MAX_MATCH]; /* T_D of a matched output: from the nearest variable; TL_NEVER: weight 0 */
    size_t nodes;                          /* components and the plant; the plant is the last */
    uint32_t *reach;                       /* Γ_k of each node */
    uint32_t *
        from_adjust; /* [variable · nodes + k]: path length c̃ (steps) from the variable's component to k; TL_NEVER: no path */
    uint32_t *from_signal; /* [signal · nodes + k]: steps from a plant signal to k; 0 if k reads the signal itself */
    uint32_t *nearest; /* path length c̃ (steps) from the nearest adjusted variable to each node; TL_NEVER: no path */
    uint32_t *longer;  /* C_k: extra length of the path through k over the shortest path; TL_NEVER: k is on no path */
} tl_horizon;

/* Computes the horizon from the paths of the graph. `adjusted`, `matched`: the ports of the plan's
 * adjust and match entries, none of them NULL. Reports a missing path, a T_P that is too short, or
 * too many unknowns. Returns false if memory is out. */
bool tl_horizon_init(tl_horizon *horizon, tl_arena *arena, const tl_graph *graph, const tl_port *const *adjusted,
                     const tl_port *const *matched, tl_report *report);

/* Returns the value of a variable at macro step `depth` (0 … T_P − 1) of a candidate with the
 * unknowns `u`. */
double tl_horizon_value(const tl_horizon *horizon, const double *u, size_t variable, uint32_t depth);

/* Sets all unknowns of each variable to one value. */
void tl_horizon_hold(const tl_horizon *horizon, const double *values, double *u);

/* Shifts a dynamic sequence by one step in place: drops the first unknown of each variable and
 * repeats the last. */
void tl_horizon_shift(const tl_horizon *horizon, double *u);

/* Executions of node k that each evaluation after the first needs: only those that another u can
 * have reached (eq. 4.7). `reach`: executions that the first evaluation needs. If `reach` is Γ_k,
 * the result is that of eq. 4.13. */
uint32_t tl_horizon_next_need(const tl_horizon *horizon, size_t node, uint32_t reach);

#endif
