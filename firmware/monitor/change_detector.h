/* Change detector: watches a run for lasting changes, and groups them to findings.
 *
 * Purpose:  answers "what has changed, since when". It watches two kinds of quantities.
 *           Corrections: Δu of each adjusted variable. Outputs: ŷ minus y of the older released
 *           twin (master/sync/released_twin.h), of matched and compared outputs.
 * Blocks:   each quantity is watched with four block lengths: 10, 30 and 120 steps, and one that
 *           is longer than the longest recurring cycle. Short blocks find large changes early and
 *           date them, long ones find small changes.
 * Promise:  `false_alarms_per_year` of the configuration, divided among all series.
 * Start:    the first ten releases after each start and reset of the FMUs are left out, but at
 *           most a tenth of the learning time, or one release if that is longer. One release is
 *           left out after a gap in the readings.
 * Finding:  one line for one lasting change. Changes of several quantities are one finding if they
 *           begin at about the same time, or if one makes the other move: a correction moves all
 *           outputs of the released twin, and an output that is matched moves corrections. The
 *           finding is named by the correction, else by the output. It is gone when the series that
 *           found it is normal again.
 * Levels:   a quantity that takes the level of an earlier finding opens that again, for example
 *           when a product recurs. Within the learning time it keeps its onset; later it has a new
 *           one, and is reported like a new finding. Another level is another finding.
 * Cause:    two released twins run at the onset. Both were begun before it, so they have used no
 *           later measurement. While one of them is recorded, the outputs that are off by three
 *           deviations count. One: its sensor, or an input that acts on it alone. Several: the
 *           plant. None, or only one output in all: not known.
 * Frozen:   a signal with the quality TL_FROZEN is a finding, too.
 * Limits:   a correction outside the user's limits is a finding of its own, also while learning. It
 *           is gone when the correction is within them again (limit_window.h), or the limits were
 *           removed. Outside again within ten windows: the same finding.
 * Stored:   about 30 kB for each quantity, so that a restarted process continues. A block length of
 *           which fewer than 32 blocks were learnt starts again.
 * Learning: each block length needs 256 blocks at least, so that of the cycle reports later.
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
    TL_FINDING_FOUND,   /* a new finding, or one that returns late */
    TL_FINDING_FURTHER, /* it returns soon, has another name or cause, or drifts */
    TL_FINDING_ENDED    /* it is gone */
} tl_finding_turn;

/* Called within tl_change_detector_step(), _sample() and _begin(), with the tick at which it is
 * known. */
typedef void tl_change_report(void *context, int64_t tick, const tl_finding *finding, tl_finding_turn turn);

/* `config` and `context` must outlive the detector. `report` may be NULL. Returns NULL if memory is
 * out. */
tl_change_detector *tl_change_detector_create(const tl_config *config, const tl_account *account,
                                              tl_change_report *report, void *context);

/* NULL is allowed. */
void tl_change_detector_destroy(tl_change_detector *detector);

/* Adds the sample of a tick, with the qualities that the twin has used. */
void tl_change_detector_sample(tl_change_detector *detector, const tl_sample *sample);

/* Adds a committed step, complete at this tick. Steps that repeat an earlier run, or come late, are
 * ignored. */
void tl_change_detector_step(tl_change_detector *detector, int64_t tick, const tl_record *record);

/* Call it when a run begins, before its first sample: interrupts all series, and leaves out the
 * start of the run, unless it continues the one before (same t_start). What was learnt and the
 * findings remain; their times are moved. `account`: of this run. `started`: its t_start, ms since
 * 1970 UTC. */
void tl_change_detector_begin(tl_change_detector *detector, const tl_account *account, int64_t started);

typedef enum tl_change_acceptance {
    TL_ACCEPTANCE_NONE, /* there is no such finding, or it is normal already */
    TL_ACCEPTANCE_DONE, /* its levels give no finding from now on */
    TL_ACCEPTANCE_LATE  /* the finding is normal, but its level is forgotten after many others */
} tl_change_acceptance;

/* A user accepts the levels of a finding as normal. */
tl_change_acceptance tl_change_detector_accept(tl_change_detector *detector, uint32_t number);

/* The next finding has a number above `last`. `is_new`: so have those so far, because none of them
 * is stored. */
void tl_change_detector_number_from(tl_change_detector *detector, uint32_t last, bool is_new);

/* Return what was learnt and the findings as bytes, and their number, at most a few MB. */
size_t tl_change_detector_size(const tl_change_detector *detector);
void tl_change_detector_save(const tl_change_detector *detector, unsigned char *bytes);

/* Restores them; then call tl_change_detector_begin(). Returns false if the bytes are of another
 * configuration (variables, step, cycle) or damaged: then the detector must be destroyed. */
bool tl_change_detector_load(tl_change_detector *detector, const unsigned char *bytes, size_t size);

/* Returns the results so far; `finding` is valid until the next step. */
tl_changes tl_change_detector_get(const tl_change_detector *detector);

#endif
