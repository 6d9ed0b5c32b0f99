/* Change detector: watches a run for lasting changes, and groups them into findings.
 *
 * Purpose:  reports what has changed, and since when. It watches two kinds of quantities.
 *           Corrections: Δu of each adjusted variable. Outputs: ŷ minus y of the older of the two
 *           released twins (master/sync/released_twin.h), for each matched or compared output.
 * Series:   block means of one quantity (change_series.h). Each quantity has four series: with
 *           blocks of 10, 30 and 120 steps, and of 3000 steps or the longest recurring cycle
 *           (`cycle_s`) if that is longer. Short blocks date large changes early; long blocks find
 *           small changes.
 * Alarms:   `false_alarms_per_year` of the configuration is divided equally among all series.
 * Start:    after each start and reset of the FMUs, the first ten releases are left out. If they
 *           last longer than a tenth of the learning time, only this tenth is left out, but at
 *           least one release. One release is left out after a gap in the readings.
 * Finding:  one for each lasting change. Changes of several quantities are one finding if they
 *           begin at about the same time, or if one makes the other move: a correction moves all
 *           outputs of the released twin, and a matched output moves corrections. The finding is
 *           named after the correction; without one, after the output. It is gone when the series
 *           from which its size was computed is normal again.
 * Levels:   if a quantity returns to the level of one of its last eight findings, that finding
 *           opens again, for example when a product recurs. If it was gone for at most the learning
 *           time, it keeps its onset. Otherwise it has a new onset, and is reported like a new
 *           finding. A change to another level is another finding.
 * Cause:    two released twins run at the onset. Both were begun before it, so they have used no
 *           later measurement. An output is *off* if its mean error, while one of these twins is
 *           recorded, exceeds three deviations. If one output is off, the cause is its sensor, or
 *           an input that acts on it alone. If several are off, it is the plant. If none is off, or
 *           if there is only one output, the cause is unknown.
 * Frozen:   a signal with the quality TL_FROZEN is a finding, too.
 * Limits:   a correction outside the user's limits is a finding of its own, also while learning. It
 *           is gone when the correction is within them again (limit_window.h), or when the limits
 *           are removed. If the correction is outside again within ten windows, that is the same
 *           finding.
 * Stored:   about 30 kB for each quantity, so that a restarted process continues. A series that has
 *           learnt fewer than 32 blocks starts again.
 * Learning: a series needs at least 256 blocks, so series with long blocks report later.
 * Memory:   malloc() at the creation, about 130 kB for each quantity.
 * Thread:   one at a time.
 */
#ifndef TL_FIRMWARE_MONITOR_CHANGE_DETECTOR_H
#define TL_FIRMWARE_MONITOR_CHANGE_DETECTOR_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/config/config.h"
#include "firmware/monitor/finding.h"
#include "master/base/signal.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

typedef struct tl_change_detector tl_change_detector;

typedef enum tl_finding_turn {
    TL_FINDING_FOUND,   /* a new finding, or one that returns after more than the learning time */
    TL_FINDING_FURTHER, /* update of a known finding: it has returned (sooner), has a new name or cause, or has grown */
    TL_FINDING_ENDED    /* it is gone */
} tl_finding_turn;

/* Called within tl_change_detector_step(), _sample() and _begin(). `tick`: of the newest sample or
 * step. `finding` is valid during the call. */
typedef void tl_change_report(void *context, int64_t tick, const tl_finding *finding, tl_finding_turn turn);

/* `config` and `context` must outlive the detector; `account` is copied. `report` may be NULL.
 * Returns NULL if memory is out. */
tl_change_detector *tl_change_detector_create(const tl_config *config, const tl_account *account,
                                              tl_change_report *report, void *context);

/* NULL is allowed. */
void tl_change_detector_destroy(tl_change_detector *detector);

/* Adds the sample of a tick, with the qualities that the twin has used. */
void tl_change_detector_sample(tl_change_detector *detector, const tl_sample *sample);

/* Adds a committed step, whose record is complete at `tick`. Ignores steps that repeat an earlier
 * run, and steps that are not newer than the newest one. */
void tl_change_detector_step(tl_change_detector *detector, int64_t tick, const tl_record *record);

/* Call it when a run begins, before its first sample. Interrupts all series. Leaves out the start
 * of the run, unless it continues the run before (same t_start). Keeps what was learnt and the
 * findings, and converts their times to the new t_start; but findings of a replay are dropped.
 * `account`: of this run; copied. `started`: its t_start, ms since 1970 UTC. */
void tl_change_detector_begin(tl_change_detector *detector, const tl_account *account, int64_t started);

typedef enum tl_change_acceptance {
    TL_ACCEPTANCE_NONE, /* there is no such finding, or it was accepted already */
    TL_ACCEPTANCE_DONE, /* its levels give no finding from now on */
    TL_ACCEPTANCE_LATE /* the finding is marked normal, but its levels are not known any more: they may be found again */
} tl_change_acceptance;

/* A user accepts the levels of the finding with this number as normal. */
tl_change_acceptance tl_change_detector_accept(tl_change_detector *detector, uint32_t number);

/* Sets the largest number in use: new findings get numbers from `last` + 1 on. `is_new`: the
 * detector's findings are not stored anywhere yet, so `last` is added to their numbers too. */
void tl_change_detector_number_from(tl_change_detector *detector, uint32_t last, bool is_new);

/* Writes what was learnt and the findings to `bytes`, which has tl_change_detector_size() bytes: at
 * most a few MB. */
size_t tl_change_detector_size(const tl_change_detector *detector);
void tl_change_detector_save(const tl_change_detector *detector, unsigned char *bytes);

/* Restores saved bytes; then call tl_change_detector_begin(). Returns false if the bytes are
 * damaged or of another configuration (variables, step, cycle): then destroy the detector. */
bool tl_change_detector_load(tl_change_detector *detector, const unsigned char *bytes, size_t size);

/* Returns the results so far. Its `finding` is valid until the next call with this detector. */
tl_changes tl_change_detector_get(const tl_change_detector *detector);

#endif
