/* Compares a candidate configuration with the active one: forecasts the time and memory that the
 * candidate's twin needs, and compares this twin, as a shadow, with the run's twin.
 *
 * Thread:  one thread.
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

/* This text is part of the reason if a shadow or a comparison fails because the box is too slow. */
#define TL_COMPARISON_TWO_TWINS "this box is too slow for two twins"

/* Writes "a step takes 0.15 ms of its 10 ms, and 2.3 ms with a complete search", or what is unknown
 * or too long. */
void tl_forecast_write_time(const tl_trial_answer *answer, char text[TL_FORECAST_TEXT]);

/* Writes "the new twin needs at most 31 MiB of memory; the box has 1900 MiB available". `left`:
 * available bytes; 0: unknown, and not written. */
void tl_forecast_write_memory(const tl_trial_answer *answer, uint64_t left, char text[TL_FORECAST_TEXT]);

/* Returns the available memory in bytes (MemAvailable of /proc/meminfo); 0: unknown. */
uint64_t tl_forecast_memory_left(void);

/* ---- Comparison of the run's twin with the shadow over the same live time.
 *
 * Purpose: reports what both twins did in the compared time, and decides whether the shadow may
 *          become the live twin. Pure logic: the caller passes the states of both twins.
 * Too slow: the box is too slow for two twins if the run's twin misses too many deadlines or skips
 *          too many ticks while the shadow runs. The counts of the run's twin are compared with its
 *          counts before the shadow started, by the rule in probation.h. Skipped ticks count only
 *          if they form at least TL_PROBATION_MISSES gaps (gap: one or more skipped ticks in a
 *          row). The box is also too slow if a twin skips more than a quarter of its ticks.
 * Refused: the candidate is refused if its shadow's share of steps in lock is below the required
 *          one, and below that of the run's twin. It is also refused if the shadow executed no
 *          step.
 * Unseen:  the lock is not evaluated here in two cases: no step was evaluated, or more than half of
 *          the evaluated steps had no good matched signal. Then the probation evaluates the lock.
 * Worse:   an output that both twins match is worse if the shadow's error Δy exceeds two limits:
 *          the run's tolerance, and TL_COMPARISON_TIMES the error of the run's twin. Errors are
 *          root mean squares over at least TL_COMPARISON_PAIRS pairs. The candidate's own tolerance
 *          does not count, because with a wide tolerance a twin far from the plant is in lock.
 *          Noise of the plant affects both twins alike, and is below the tolerance. The lock is
 *          also evaluated by the tolerances of the version before. By them too, the shadow's share
 *          of steps in lock must reach the required one or that of the run's twin. If not, the
 *          candidate is worse. The client may activate a worse candidate (TL_CONTROL_ACCEPT_WORSE).
 * Deadlines: missed deadlines of the shadow are only reported, because it has no real-time priority
 *            yet.
 * Failure: if the run's twin failed and restarted meanwhile, the result is TL_COMPARISON_BAD.
 * Trust:   the states come from processes with FMUs. The caller has limited the counts and cleaned
 *          the names. A value that is not finite is reported as "-".
 * Thread:  plain data.
 */

/* Sizes of texts, bytes; the two numbers of the rule Worse. */
enum { TL_COMPARISON_TEXT = 256, TL_COMPARISON_LOCK = 64, TL_COMPARISON_TIMES = 2, TL_COMPARISON_PAIRS = 10 };

/* The caller sets `before`; the other fields are private. */
typedef struct tl_comparison {
    tl_run_status before;       /* the run's twin, before the shadow started */
    tl_run_status shadow, twin; /* states at tl_comparison_begin(); after tl_comparison_end() differences since then */
} tl_comparison;

typedef enum tl_comparison_result {
    TL_COMPARISON_GOOD,
    TL_COMPARISON_TOO_SLOW, /* the box is too slow for two twins */
    TL_COMPARISON_BAD,      /* the candidate is refused */
    TL_COMPARISON_WORSE     /* the rule Worse applies */
} tl_comparison_result;

/* Begin and end the compared time. `shadow`, `twin`: states of both at the same moment. */
void tl_comparison_begin(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin);
void tl_comparison_end(tl_comparison *comparison, const tl_run_status *shadow, const tl_run_status *twin);

/* ---- after tl_comparison_end() ---- */

/* Calls `report` with one line for each output, then one for each twin, and one if the shadow's
 * lock is not evaluated here. */
void tl_comparison_report(const tl_comparison *comparison, void (*report)(void *context, const char *text),
                          void *context);

/* Returns the result. `require_lock`: percent of the steps that must be in lock, 0 … 100. `why`:
 * the reason; "" if TL_COMPARISON_GOOD. */
tl_comparison_result tl_comparison_evaluate(const tl_comparison *comparison, double require_lock,
                                            char why[TL_COMPARISON_TEXT]);

/* Writes "in lock 97 %" or "lock not evaluated yet". Allowed before tl_comparison_end(), too. */
void tl_comparison_write_lock(const tl_lock_tally *lock, char text[TL_COMPARISON_LOCK]);

#endif
