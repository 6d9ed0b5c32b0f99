/* Compares a candidate with the active version: forecasts its needs and measures its shadow.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_RETUNE_COMPARISON_H
#define TL_FIRMWARE_RETUNE_COMPARISON_H

#include <stdint.h>

#include "firmware/monitor/run_status.h"
#include "firmware/retune/worker.h"

/* ---- Forecast: time and memory that the candidate's twin will need on this box, as text.
 *
 * Thread:  pure, except tl_forecast_memory_left().
 */

enum { TL_FORECAST_TEXT = 192 };

/* Part of the reason if a shadow has ended because the box is too slow for two twins. */
#define TL_COMPARISON_TWO_TWINS "this box is too slow for two twins"

/* "a step takes 0.15 ms of 10 ms, and 2.3 ms with all of its search"; other texts if a time is
 * unknown or too long */
void tl_forecast_write_time(const tl_trial_answer *answer, char text[TL_FORECAST_TEXT]);

/* Writes "the new twin needs at most 31 MiB; the box has 1900 MiB available". `left`: bytes; 0:
 * unknown. */
void tl_forecast_write_memory(const tl_trial_answer *answer, uint64_t left, char text[TL_FORECAST_TEXT]);

/* Available memory in bytes (MemAvailable of /proc/meminfo); 0: unknown. */
uint64_t tl_forecast_memory_left(void);

/* ---- Comparison of the run's twin with its shadow over the same live time.
 *
 * Purpose: reports what both twins did in that time, and decides whether the shadow may become the
 *          live twin. Pure logic: the caller passes both states.
 * Refused: the shadow, if the run's twin beside it misses deadlines or skips ticks by probation's
 *          rule (probation.h), compared with the time before. Also if the shadow was in lock for
 *          less than required, and for less than the run's twin.
 * Unseen:  the lock is not evaluated here if no step was evaluated, or if no matched signal was
 *          good in most of the steps. Then the probation evaluates it.
 * Worse:   an output that both twins match is worse if two limits are exceeded. Its error Δy is
 *          larger than the tolerance of the run, and larger than TL_COMPARISON_TIMES the error of
 *          the run's twin. Errors are root mean squares over at least TL_COMPARISON_PAIRS pairs.
 *          The candidate's own tolerance does not count, because with a wide tolerance a twin far
 *          from the plant is in lock. Noise of the plant is the same for both, and below the
 *          tolerance.
 *          The lock is worse if, by the tolerances of the version before, the shadow was in lock
 *          for less than required, and for less than the run's twin.
 *          The client may activate a worse candidate (TL_CONTROL_ACCEPT_WORSE).
 * Skipped: deadlines that the shadow misses are reported only, because it has no priority yet. It
 *          is refused if it skipped more than a quarter of its ticks.
 * Failure: if the run's twin was restarted meanwhile, the comparison is invalid.
 * Trust:   the states are from memory of processes with FMUs. The host has bounded the counts and
 *          cleaned the names. A value that is not finite is reported as "-".
 * Thread:  plain data.
 */

enum { TL_COMPARISON_TEXT = 256, TL_COMPARISON_LOCK = 64, TL_COMPARISON_TIMES = 2, TL_COMPARISON_PAIRS = 10 };

/* The caller sets `before`; the other fields are private. */
typedef struct tl_comparison {
    tl_run_status before;       /* the run's twin, before the shadow started */
    tl_run_status shadow, twin; /* states at the begin; after tl_comparison_end() the differences since then */
} tl_comparison;

typedef enum tl_comparison_result {
    TL_COMPARISON_GOOD,
    TL_COMPARISON_NO_MEMORY, /* the box is too slow for two twins */
    TL_COMPARISON_BAD,       /* the candidate is refused */
    TL_COMPARISON_WORSE /* an output is worse, or the lock by the tolerances of the version that a probation would return to */
} tl_comparison_result;

/* `shadow` and `twin`: the states of both at the same moment. */
void tl_comparison_begin(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin);
void tl_comparison_end(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin);

/* ---- after tl_comparison_end() ---- */

/* Calls `say` with a line for each output and for each twin, and with one if the shadow's lock
 * cannot be evaluated. */
void tl_comparison_report(const tl_comparison *comparison, void (*say)(void *context, const char *text), void *context);

/* Returns the result. `require_lock`: percent of the steps; 0: not required. `why`: the reason; ""
 * if TL_COMPARISON_GOOD. */
tl_comparison_result tl_comparison_evaluate(const tl_comparison *comparison, double require_lock,
                                            char why[TL_COMPARISON_TEXT]);

/* Writes "in lock 97 %", or that the lock is not evaluated yet; also of a running shadow. */
void tl_comparison_write_lock(const tl_lock_tally *lock, char text[TL_COMPARISON_LOCK]);

#endif
