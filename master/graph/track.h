/* The track of the candidate walked last, so that the next one touches only what it changes.
 *
 * Purpose: of a long chain only one component differs from the candidate before at each step of the horizon; looking up all
 *          others in their caches would make an execution the dearer the longer the chain is. The track keeps, for each
 *          step, all values and where each component stood. A component is looked at only where its inputs or its place
 *          differ from the track; everything else is as it was.
 * Method:  a component that changes its outputs wakes those that read them, for the next step; one that finds its way
 *          back to its old place sleeps again. What differs is written into the track, which is then that of the present
 *          candidate. Results are those of stepping every component, to the bit.
 * Use:     candidates are walked through the track, not through the exchange below it; only commits go there at once.
 * Thread:  the twin's. Memory: the arena, at start-up: T_P + 1 times the values of the exchange.
 */
#ifndef TL_MASTER_GRAPH_TRACK_H
#define TL_MASTER_GRAPH_TRACK_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/graph/exchange.h"

typedef struct tl_track tl_track;

/* For an exchange whose values are placed, after tl_exchange_save_executions(); NULL when memory is out. Where nothing is
 * saved by sequences there is nothing to track: every component steps. */
tl_track *tl_track_create(tl_arena *arena, tl_exchange *exchange, const tl_graph *graph, uint32_t prediction);

/* As tl_exchange_begin(), _rewind() and _try(); the adjusted inputs are set before every step of a candidate. */
tl_status tl_track_begin(tl_track *track, tl_error *error);
tl_status tl_track_rewind(tl_track *track, tl_error *error);
tl_status tl_track_try(tl_track *track, int64_t step, uint32_t depth, tl_error *error);

#endif
