/* The horizon of an event: its plan, the strokes that are tried, and the search.
 *
 * Thread:  the one that steps the twin.
 */
#ifndef TL_MASTER_EVENT_EVENT_HORIZON_H
#define TL_MASTER_EVENT_EVENT_HORIZON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/status.h"
#include "master/plan/plan.h"
#include "master/sync/lock.h"
#include "master/sync/record.h"

/* ---- The plan of an event horizon (plan.h): what goes with one, and its sizes in macro steps.
 *
 * Purpose: names, types and numbers of `horizon.event`, which need no FMU.
 * Thread:  plain data.
 */

/* Reports what in a plan does not go with the event horizon that it has. */
void tl_event_plan_check(const tl_plan *plan, tl_report *report);

/* How many samples of the plant must be kept: a search may last as long as a stroke. */
size_t tl_event_plan_window(const tl_plan *plan);

/* ---- The event horizon: a twin that is matched around an event of the plant, not in every step (eq. 5.4, 5.5).
 *
 * Purpose: where the only thing measured is that something has happened (a cylinder has reached its end), one step tells
 *          nothing of u: what it does shows at the end of the stroke. So the twin runs with the u that was found last. At the
 *          start of a stroke its state is kept; around the plant's event it goes back there in candidates, is run over the
 *          whole stroke with each, and J is summed over T_F, half of it before the event and half after: to come too early
 *          costs as much as to come too late. The best candidate, led on to the present instant, becomes the twin.
 *          What was committed meanwhile stays as it was: history is not rewritten.
 * Phases:  waiting for the start; in the stroke; waiting for the window to be complete (lag) or not (hold, where the
 *          newest sample stands for later ones: a plant whose signal goes back within the window is searched again at its
 *          end); searching; leading the winner on.
 * Time:    a search may last many cycles. In each, the live step comes first, and candidates are led on by as many macro
 *          steps as the budget has time for; between cycles the FMUs are those of the live twin. A search that has not
 *          ended when the next stroke begins, or when the samples of its stroke are overwritten, is abandoned: the best u
 *          so far is used if it is better than nominal, without its state.
 * First:   the u in force is the first candidate; what the twin did with it is known already, and costs only what of the
 *          window lies ahead.
 * Doubt:   a stroke that lasts too long, or whose edges fall into a gap of the measurements, is not searched.
 * Limits:  one Real variable that nothing is connected to; modes lag and hold; the end signal is matched by a Boolean output.
 * Thread:  the twin's. Memory: the arena, at start-up; five states of each FMU are its own.
 */

typedef struct tl_event_horizon tl_event_horizon;

/* Macro steps of the longest candidate: the longest stroke, and T_F/2. */
uint32_t tl_event_horizon_steps(const tl_event_horizon *self);

/* For a checked plan, over a lock that is complete. NULL when memory is out. */
tl_event_horizon *tl_event_horizon_create(tl_arena *arena, tl_lock *lock, const tl_plan *plan);

/* Gives back the states kept of one component, before it is freed; and what is kept of solvers. NULL is allowed. */
void tl_event_horizon_forget(tl_event_horizon *self, size_t component);
void tl_event_horizon_end(tl_event_horizon *self);

/* As tl_lock_step(), for the step that ends at the newest sample; `budget` NULL: a step that is made up, without a
 * search. */
tl_status tl_event_horizon_step(tl_event_horizon *self, int64_t step, const tl_budget *budget, tl_record *record,
                                tl_error *error);

/* A step that is not searched, with this u in force from now on, which an earlier run has committed. */
tl_status tl_event_horizon_follow(tl_event_horizon *self, int64_t step, double u, tl_record *record, tl_error *error);

/* All FMUs have begun anew: nominal is in force, and a stroke or search under way is given up, which is whether there was one. */
bool tl_event_horizon_begin_anew(tl_event_horizon *self);

/* What tl_event_horizon_archive() does not keep is forgotten, as if it had been loaded: a stroke or search under way. */
void tl_event_horizon_go_on(tl_event_horizon *self);

/* As tl_lock_retune(), which comes before it. Before anything has `begun` u is nominal. A search under way begins again. */
void tl_event_horizon_retune(tl_event_horizon *self, const tl_tuning *tuning, bool begun);

/* The u in force. A stroke that was under way is not known when it is loaded. */
void tl_event_horizon_archive(tl_event_horizon *self, tl_archive *archive);

#endif
