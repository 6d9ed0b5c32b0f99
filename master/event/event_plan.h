/* The plan of an event horizon (plan.h): what goes with one, and its sizes in macro steps.
 *
 * Purpose: names, types and numbers of `horizon.event`, which need no FMU.
 * Thread:  plain data.
 */
#ifndef TL_MASTER_EVENT_EVENT_PLAN_H
#define TL_MASTER_EVENT_EVENT_PLAN_H

#include <stddef.h>
#include <stdint.h>

#include "master/base/status.h"
#include "master/plan/plan.h"

/* Reports what in a plan does not go with the event horizon that it has. */
void tl_event_plan_check(const tl_plan *plan, tl_report *report);

/* T_F/2, at least 1; and the longest stroke. */
size_t tl_event_plan_half(const tl_plan *plan);
size_t tl_event_plan_longest(const tl_plan *plan);

/* How many samples of the plant must be kept: a search may last as long as a stroke. */
size_t tl_event_plan_window(const tl_plan *plan);

/* Index of the signal of an edge; SIZE_MAX: it is none of the plan's. */
size_t tl_event_plan_signal(const tl_plan *plan, const tl_plan_edge *edge);

#endif
