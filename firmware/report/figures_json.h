/* Key figures as JSON: what `replay --json`, `run --json` and `show --json` have alike.
 *
 * Purpose: keys and shapes are those of config/SPEC.md, "Results", and the same everywhere.
 * Thread:  the writer's.
 */
#ifndef TL_FIRMWARE_REPORT_FIGURES_JSON_H
#define TL_FIRMWARE_REPORT_FIGURES_JSON_H

#include "firmware/base/json_writer.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/report/run_figures.h"

/* "outcomes" */
void tl_figures_json_add_outcomes(tl_json_writer *json, const tl_run_figures *figures);

/* "components" and "total", into the ledger that is open. */
void tl_figures_json_add_components(tl_json_writer *json, const tl_run_figures *figures);

/* "resumed"; null if the run has begun anew. */
void tl_figures_json_add_resumption(tl_json_writer *json, const tl_resumption *resumption);

/* Of the state, into the "lock" that is open. */
void tl_figures_json_add_lock(tl_json_writer *json, const tl_lock_tally *lock);

#endif
