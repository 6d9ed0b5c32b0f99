/* One measurement, conditioned before it is matched: outliers out, median, low-pass.
 *
 * Purpose: what is matched is what the plant does, not what one bad message or the noise of a sensor says. Order: gate,
 *          then median, then low-pass. The delay of what comes out is declared, so that it can be paired with the y of
 *          the instant it belongs to (it is a part of Δo, eq. 4.15).
 * Gate:    a good sample further than `gate` from the last accepted one is an outlier: its quality becomes TL_OUTLIER.
 *          The third in a row that agree with each other (within the gate) is a new level, not an outlier: the filters
 *          start anew with these three, and nothing of the old level is in what they give.
 *          Samples that are not good neither make nor break the row. The very first good one is accepted unseen.
 * Median:  of the samples there are until all have come; of an even number the newer of the two in the middle, so that
 *          it is always a value that was measured, and the same for −x as for x.
 * Low-pass: y ← y + a·(x − y), a = 1 − exp(−T_S/τ), exact for an x that is held between samples. It starts at the
 *          first x. It lags a ramp by (1 − a)/a samples, which is about τ/T_S − 1/2; declared is the nearest whole number.
 * Quality: a sample that is not good (or is gated) is no input to the filters; what they gave last is held, with the
 *          sample's own quality; 0 before they gave anything. After a gap of more than TL_CONDITIONER_GAP such samples
 *          the filters start anew at the next good one, which is accepted wherever it is.
 * Anew:    an output belongs to an instant `delay` ticks earlier. Of instants before the filters started anew they know
 *          nothing, so until the tick start + delay the output before, with its quality, goes on. (From tick 0 on there is
 *          no such instant, and the filters are heard at once.) So a new level comes out at its third sample, or `delay`
 *          ticks after its first where that is later, never before its instant.
 * Units:   of the plant's signal.
 * Thread:  the twin's. Memory: the arena, at start-up.
 */
#ifndef TL_MASTER_MEASURE_CONDITIONER_H
#define TL_MASTER_MEASURE_CONDITIONER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "master/base/archive.h"
#include "master/base/arena.h"
#include "master/base/signal.h"
#include "master/base/simtime.h"
#include "master/plan/plan.h"

enum { TL_CONDITIONER_GAP = 10 };

typedef struct tl_conditioner tl_conditioner;

/* NULL when memory is out. The condition is one that tl_plan_check() has nothing against; it is copied. `step` is T_S in
 * ns, > 0; `window` is how many ticks, the newest included, may be asked for; 0 counts as 1. */
tl_conditioner *tl_conditioner_create(tl_arena *arena, const tl_plan_condition *condition, tl_time step, size_t window);

/* Whether a plan asks for any conditioning at all. */
bool tl_conditioner_is_needed(const tl_plan_condition *condition);

/* The measurement of the next tick (the first call is tick 0). A good value is finite; what another value is does not
 * matter. Bound: O(median). */
void tl_conditioner_push(tl_conditioner *conditioner, int64_t tick, double value, tl_quality quality);

/* What came out at `tick` ≥ 0; a tick after the newest gives the newest. Ticks older than the window must not be asked
 * for. 0 and TL_NO_LINK before the first push. */
double tl_conditioner_value(const tl_conditioner *conditioner, int64_t tick, tl_quality *quality);

/* All that it has learned. */
void tl_conditioner_archive(tl_conditioner *conditioner, tl_archive *archive);

#endif
