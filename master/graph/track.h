/* Track of the last candidate, so that the next one only executes what differs.
 *
 * Purpose: in a long chain of components, two candidates often differ in only one component per
 *          step of the horizon. Looking up all others in their caches would cost time in proportion
 *          to the length of the chain. The track holds, for each step, all values and the position
 *          of each component: its node in the tree of its sequence cache (sequence_cache.h). A
 *          component is executed or looked up only if its inputs or its position differ from the
 *          track.
 * Method:  a component whose outputs change activates the components that read them, for the next
 *          step. A component that returns to its position on the track becomes inactive.
 *          Differences are written into the track, so that it becomes the track of the present
 *          candidate. If an output is not finite, the inputs that it feeds keep their last values
 *          (exchange.h). These may differ from the track, so their components become active too.
 *          Results are the same, to the bit, as if every component executed every step.
 * Use:     candidates run through the track, not through the exchange below it; only commits use
 *          the exchange directly.
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

/* Call after tl_exchange_init() and tl_exchange_save_executions(). If the components have no
 * sequence caches, nothing is tracked, and every component steps. `prediction`: T_P. Returns NULL
 * if memory is out. */
tl_track *tl_track_create(tl_arena *arena, tl_exchange *exchange, const tl_graph *graph, uint32_t prediction);

/* As tl_exchange_begin(), _rewind() and _try(). Set the adjusted inputs before every step of a
 * candidate. */
tl_status tl_track_begin(tl_track *track, tl_error *error);
tl_status tl_track_rewind(tl_track *track, tl_error *error);
tl_status tl_track_try(tl_track *track, int64_t step, uint32_t depth, tl_error *error);

#endif
