/* The track of the candidate walked last, so that the next one touches only what it changes.
 *
 * Purpose: of a long chain only one component differs from the candidate before at each step of the horizon; looking up all
 *          others in their caches would make an execution the dearer the longer the chain is. The track keeps, for each
 *          step, all values and where each component stood. A component is looked at only where its inputs or its place
 *          differ from the track; everything else is as it was.
 * Method:  a component that changes its outputs wakes those that read them, for the next step; one that finds its way
 *          back to its old place sleeps again. What differs is written into the track, which is then that of the present
 *          candidate. Results are those of stepping every component, to the bit.
 * Thread:  the twin's. Memory: the arena, at start-up: T_P + 1 times the values of the exchange.
 */
#ifndef TL_MASTER_GRAPH_TRACK_H
#define TL_MASTER_GRAPH_TRACK_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/graph/exchange.h"

/* For an exchange whose values are placed and whose components have their caches; NULL when memory is out. */
tl_track *tl_track_create(tl_arena *arena, tl_exchange *exchange, const tl_graph *graph, uint32_t prediction);

/* Nothing is known of the horizon that begins now. */
void tl_track_forget(tl_track *track);

/* A candidate begins, at the committed values. */
void tl_track_begin(tl_track *track);

/* A candidate's macro step with its adjusted inputs set. As tl_exchange_try(), for the exchange. */
tl_status tl_track_step(tl_track *track, int64_t step, uint32_t depth, tl_error *error);

#endif
