/* Figures of a run: counted, and as JSON.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_REPORT_RUN_FIGURES_H
#define TL_FIRMWARE_REPORT_RUN_FIGURES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/base/json.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/store/history.h"
#include "firmware/store/run_types.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

/* ---- The key figures of a run: one struct for the summary, for `show` and for the report.
 *
 * Purpose: what a run is judged by is added up, and named, in one place, whether it comes from the twin as it steps or from a database.
 * Thread:  plain data; one thread at a time.
 */

/* An adjusted variable; all zeros if `count` is 0. */
typedef struct tl_run_adjusted {
    uint64_t count; /* of committed steps with a u */
    double first, last;
    double sum;       /* of u */
    double delta_sum; /* of Δu = u − nominal */
} tl_run_adjusted;

/* Zeroed at first. */
typedef struct tl_run_figures {
    uint64_t steps;   /* computed at their own tick; those made up later and those followed are in `outcomes` */
    uint64_t skipped; /* ticks that were missed, counted by whoever keeps the time */
    uint64_t evaluations;
    uint64_t optimised_steps; /* that needed more than their first guess */
    uint64_t rested;          /* at nominal since a free twin was nearer */
    uint64_t outcomes[TL_OUTCOMES];
    uint64_t time_limited; /* searches that the time budget ended */
    uint64_t late;         /* steps that took longer than their period */
    tl_time longest;       /* ns that the longest step took */
    tl_metrics match[TL_MAX_MATCH];
    tl_metrics readings[TL_MAX_MATCH]; /* at the plant's readings; `left_out` were rejected */
    tl_run_adjusted adjust[TL_MAX_ADJUST];
    tl_run_component ledger[TL_RECORDER_COMPONENTS];
    size_t ledger_count; /* 0: none was kept */
    uint32_t nodes_peak; /* used at most in the caches; 0: not known */
} tl_run_figures;

/* `period` is what `late` is measured by. An outcome that this program does not know counts as a step, and nowhere else. */
void tl_run_figures_add_step(tl_run_figures *figures, const tl_history_step *step, tl_time period);

/* What one committed step said of one adjusted variable. */
void tl_run_figures_add_adjusted(tl_run_figures *figures, size_t adjust, double u, double nominal);

/* What the twin itself keeps: how well it followed, and its ledger. Component names are the account's. */
void tl_run_figures_take_account(tl_run_figures *figures, const tl_account *account);

/* All committed steps: rows of a database. */
uint64_t tl_run_figures_committed(const tl_run_figures *figures);

/* "7 free, 3 optimised": those that were, behind `before`. False: none was, and nothing is printed. */
bool tl_run_figures_print_outcomes(const tl_run_figures *figures, const char *before, FILE *file);

/* MSE and MAX; NaN if there are too few pairs to tell. */
double tl_run_figures_mse(const tl_run_figures *figures, size_t match);
double tl_run_figures_mse_readings(const tl_run_figures *figures, size_t match);
double tl_run_figures_maximum(const tl_run_figures *figures, size_t match);

/* Of u and of Δu; NaN if there is no step. */
double tl_run_figures_mean(const tl_run_figures *figures, size_t adjust);
double tl_run_figures_delta_mean(const tl_run_figures *figures, size_t adjust);

/* All components together. */
tl_recorder_component tl_run_figures_total(const tl_run_figures *figures);

/* Executions that were not needed; less than 0 if catching up cost more than was saved. */
double tl_run_component_saved(const tl_recorder_component *counts);

/* Executions that were neither predicted nor to catch up (tl_twin_ledger). */
int64_t tl_run_component_difference(const tl_recorder_component *counts);

/* ---- Key figures as JSON: what `replay --json`, `run --json` and `show --json` have alike.
 *
 * Purpose: keys and shapes are those of config/SPEC.md, "Results", and the same everywhere.
 * Thread:  the writer's.
 */

/* "outcomes" */
void tl_figures_json_add_outcomes(tl_json_writer *json, const tl_run_figures *figures);

/* MSE, MAX and counts of a match, into its object, which is open. */
void tl_figures_json_add_match(tl_json_writer *json, const tl_run_figures *figures, size_t match, const char *unit);

/* "components" and "total", into the ledger that is open. */
void tl_figures_json_add_components(tl_json_writer *json, const tl_run_figures *figures);

/* "resumed"; null if the run has begun anew. */
void tl_figures_json_add_resumption(tl_json_writer *json, const tl_resumption *resumption);

/* Of the state, into the "lock" that is open. */
void tl_figures_json_add_lock(tl_json_writer *json, const tl_lock_tally *lock);

#endif
