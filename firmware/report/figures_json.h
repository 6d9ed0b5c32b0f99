/* Key figures as JSON: what `replay --json`, `run --json` and `show --json` have alike.
 *
 * Purpose: keys and shapes are those of config/SPEC.md, "Results", and the same everywhere.
 * Errors:  a failed allocation is seen at the end, when the object is printed.
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_FIGURES_JSON_H
#define TL_FIRMWARE_REPORT_FIGURES_JSON_H

#include <stdint.h>

#include <cjson/cJSON.h>

#include "firmware/report/run_figures.h"

/* JSON has no NaN and no infinity: null. */
void tl_figures_json_add_number(cJSON *object, const char *key, double value);
void tl_figures_json_add_count(cJSON *object, const char *key, uint64_t value);

/* "outcomes" */
void tl_figures_json_add_outcomes(cJSON *object, const tl_run_figures *figures);

/* "components" and "total" of a ledger. */
void tl_figures_json_add_components(cJSON *ledger, const tl_run_figures *figures);

/* "resumed"; null if the run has begun anew. */
void tl_figures_json_add_resumption(cJSON *object, const tl_resumption *resumption);

#endif
