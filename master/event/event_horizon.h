/* Event horizon: its plan, its strokes, and its search.
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
#include "master/sync/record.h"
#include "master/sync/synchroniser.h"

/* ---- Checks of the plan of an event horizon (plan.h), and its sizes in macro steps.
 *
 * Purpose: names, types and numbers of `horizon.event`, which need no FMU.
 * Thread:  plain data.
 */

/* Reports all parts of a plan that cannot be used with its event horizon. */
void tl_event_plan_check(const tl_plan *plan, tl_report *report);

/* Number of the plant's samples to keep, because a search may take as long as a stroke. */
size_t tl_event_plan_window(const tl_plan *plan);

/* ---- Event horizon: matches the twin around an event of the plant, not in every step (eq. 5.4,
 * 5.5).
 *
 * Purpose: if only an event is measured (a cylinder has reached its end), one step contains no
 *          information about u: its effect shows at the end of the stroke. A stroke lasts from the
 *          start signal to the plant's event. The twin runs with the u found last, and its state is
 *          saved at the start of the stroke. After the event, each candidate starts from that state
 *          and runs over the whole stroke. J is summed over the window T_F: half of it before the
 *          event, half after it. So an event that is too early costs as much as one that is too
 *          late. The best candidate is continued to the present instant and becomes the twin. Steps
 *          committed meanwhile are not changed.
 * Phases:  waiting for the start; in the stroke; waiting for the end of the window (lag only);
 *          searching; continuing the best candidate.
 * Hold:    in mode hold the search starts before the window is complete, and uses the newest sample
 *          in place of later ones. If the plant's signal returns within the window, the stroke is
 *          searched again at the end of the window.
 * Time:    a search may take many cycles. In each cycle the live step comes first; then candidates
 *          run for as many macro steps as fit the budget. Between cycles the FMUs are those of the
 *          live twin. A search is abandoned if the next stroke starts, or if the samples of its
 *          stroke are overwritten. Then the best u so far is used, without its state, if it is
 *          better than nominal.
 * First:   the u in use is the first candidate. The live twin has already simulated it, except for
 *          the part of the window that is still in the future.
 * Skipped: a stroke is not searched if it exceeds the configured limit, or if one of its edges
 *          falls into a gap of the measurements.
 * Limits:  one Real variable without a connection; modes lag and hold; a Boolean output matches the
 *          end signal.
 * Thread:  the twin's. Memory: the arena, at start-up; it owns five states of each FMU.
 */

typedef struct tl_event_horizon tl_event_horizon;

/* Macro steps of the longest candidate: the longest stroke plus T_F/2. */
uint32_t tl_event_horizon_steps(const tl_event_horizon *self);

/* For a checked plan and a complete synchroniser. NULL if memory is out. */
tl_event_horizon *tl_event_horizon_create(tl_arena *arena, tl_synchroniser *synchroniser, const tl_plan *plan);

/* Frees the states of one component, before it is freed; and the memory of solvers. NULL is
 * allowed. */
void tl_event_horizon_forget(tl_event_horizon *self, size_t component);
void tl_event_horizon_end(tl_event_horizon *self);

/* As tl_synchroniser_step(), for the step that ends at the newest sample. `budget` NULL: a missed
 * tick, without a search. */
tl_status tl_event_horizon_step(tl_event_horizon *self, int64_t step, const tl_budget *budget, tl_record *record,
                                tl_error *error);

/* Commits a step with this u of an earlier run, without a search; u is in use from now on. */
tl_status tl_event_horizon_follow(tl_event_horizon *self, int64_t step, double u, tl_record *record, tl_error *error);

/* After a reset of all FMUs: uses nominal and abandons a stroke or search. Returns whether there
 * was one. */
bool tl_event_horizon_reset(tl_event_horizon *self);

/* Abandons a stroke or search, as loading an archive does. */
void tl_event_horizon_abandon(tl_event_horizon *self);

/* Applies a tuning after tl_synchroniser_retune(). Before the first step (`begun` is false) u is
 * nominal. A search in progress restarts. */
void tl_event_horizon_retune(tl_event_horizon *self, const tl_tuning *tuning, bool begun);

/* Archives the u in use. A stroke in progress is lost when loading. */
void tl_event_horizon_archive(tl_event_horizon *self, tl_archive *archive);

#endif
