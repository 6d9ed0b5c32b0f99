/* A candidate compared with the active version: measured in a shadow, or forecast.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_RETUNE_COMPARISON_H
#define TL_FIRMWARE_RETUNE_COMPARISON_H

#include <stdint.h>

#include "firmware/monitor/run_status.h"
#include "firmware/retune/worker.h"

/* ---- The forecast of a candidate: what its twin will take of the box, in words.
 *
 * Thread:  pure, but for tl_forecast_memory_left().
 */

enum { TL_FORECAST_TEXT = 192 };

/* In the reason of a shadow that has ended because it could not keep pace beside the run's twin. */
#define TL_COMPARISON_TWO_TWINS "this box does not carry two twins"

/* "a step takes 0.15 ms of 10 ms, and with all of its search 2.3 ms; the budget ends that after 8 ms" */
void tl_forecast_write_time(const tl_trial_answer *answer, char text[TL_FORECAST_TEXT]);

/* "its twin takes 31 MiB of memory at most; the box has 1900 MiB left". `left`: bytes; 0: not known. */
void tl_forecast_write_memory(const tl_trial_answer *answer, uint64_t left, char text[TL_FORECAST_TEXT]);

/* Bytes that the machine has to give, by /proc/meminfo; 0: it does not say. */
uint64_t tl_forecast_memory_left(void);

/* ---- A comparison: the run's twin and its shadow over the same live time.
 *
 * Purpose: what both have done from a moment on to another, in words, and whether the shadow may take over. Pure logic: figures are handed in.
 * Refused: the run's twin, beside it, misses deadlines or makes ticks up by probation's rule (probation.h), against what it did before; the shadow was in lock
 *          for less than is asked, and for less than the run's twin.
 * Unseen:  of a lock that was not judged, or only while the plant was there for a moment, nothing is asked: that is probation's.
 * Worse:   an output that both match is off by more than the tolerance of the run, and by more than TL_COMPARISON_TIMES what the run's is, as root mean
 *          squares over TL_COMPARISON_PAIRS and more. The tolerance of the candidate does not count: whoever widens it is in lock, and may be nowhere near the
 *          plant. Noise of the plant is the same for both, and below the tolerance. Or the shadow was in lock for less than is asked, and for less than the run's twin, by the
 *          tolerances of the version that a probation would return to. Somebody may insist.
 * Also:    what the shadow misses says little, since it has no priority yet: it is told, but that it makes up a quarter of its ticks is too much. Nor can
 *          anything be said if the run's twin was begun again meanwhile.
 * Trust:   figures come from memory of processes with FMUs. The host has bounded counts and cleaned names; what is no number is told as "-".
 * Thread:  plain data.
 */

enum { TL_COMPARISON_TEXT = 256, TL_COMPARISON_LOCK = 64, TL_COMPARISON_TIMES = 2, TL_COMPARISON_PAIRS = 10 };

/* `before` is set by the caller; the other fields are private. */
typedef struct tl_comparison {
    tl_run_status before;       /* the run's twin, before there was a shadow */
    tl_run_status shadow, twin; /* as they were when it began; then what they have done in it */
} tl_comparison;

typedef enum tl_comparison_result {
    TL_COMPARISON_GOOD,
    TL_COMPARISON_NO_ROOM, /* the box does not carry two twins */
    TL_COMPARISON_BAD,     /* it is the candidate's fault */
    TL_COMPARISON_WORSE /* an output is, or the lock by the tolerances of the version that a probation would return to */
} tl_comparison_result;

/* `shadow` and `twin`: how both are at the same moment. */
void tl_comparison_begin(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin);
void tl_comparison_end(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin);

/* ---- after its end ---- */

/* `say` gets a line for each output, one for each twin, and one if the shadow's lock cannot be judged. */
void tl_comparison_tell(const tl_comparison *comparison, void (*say)(void *context, const char *text), void *context);

/* `require_lock`: percent; 0: not asked. `why`: "" of a good one. */
tl_comparison_result tl_comparison_judge(const tl_comparison *comparison, double require_lock,
                                         char why[TL_COMPARISON_TEXT]);

/* "in lock 97 %"; also of a shadow that runs. */
void tl_comparison_write_lock(const tl_lock_tally *lock, char text[TL_COMPARISON_LOCK]);

#endif
