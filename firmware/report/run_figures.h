/* Key figures of a run: counting, and output as JSON.
 *
 * Thread:  one thread.
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

/* ---- Key figures of a run: one struct for the summary, `show` and the report.
 *
 * Purpose: one module counts and names the figures, both for a running twin and for a database.
 * Thread:  plain data; one thread at a time.
 */

/* Figures of an adjusted variable, in its unit; all zeros if `count` is 0. */
typedef struct tl_run_adjusted {
    uint64_t count;        /* committed steps with a u */
    double first, last;    /* u of the first and of the last step */
    double sum;            /* of u */
    double correction_sum; /* of Δu = u − û */
} tl_run_adjusted;

/* Key figures. The caller zeroes the struct at first. */
typedef struct tl_run_figures {
    uint64_t steps;   /* steps computed at their own tick; caught-up and resumed steps are only in `outcomes` */
    uint64_t skipped; /* missed ticks; the caller counts them, the functions below do not */
    uint64_t evaluations;
    uint64_t optimised_steps;          /* steps with more than one evaluation */
    uint64_t rested;                   /* steps with u at nominal, because corrections did harm (TL_FLAG_RESTS) */
    uint64_t refused;                  /* steps with candidates that could not be evaluated */
    uint64_t outcomes[TL_OUTCOMES];    /* steps, by outcome */
    uint64_t time_limited;             /* searches that the time budget ended */
    uint64_t late;                     /* steps that took longer than their period */
    tl_time longest;                   /* computing time of the longest step, ns */
    tl_metrics match[TL_MAX_MATCH];    /* Δy at the end of each step */
    tl_metrics readings[TL_MAX_MATCH]; /* Δy at the plant's readings; `left_out`: rejected ones */
    tl_metrics released[TL_MAX_MATCH]; /* Δy of the older released twin; do not use `left_out` */
    tl_run_adjusted adjust[TL_MAX_ADJUST];
    tl_run_component ledger[TL_RECORDER_COMPONENTS];
    size_t ledger_count; /* 0: there is no ledger */
    uint32_t nodes_peak; /* maximum number of nodes used at once in the cache of one component; 0: not known */
} tl_run_figures;

/* Adds a committed step. `period`: T_S, ns; a longer step is `late`. A step with an unknown
 * outcome, for example of a newer program, counts in `steps` but not in `outcomes`. */
void tl_run_figures_add_step(tl_run_figures *figures, const tl_history_step *step, tl_time period);

/* Adds u and û of one adjusted variable of one committed step. */
void tl_run_figures_add_adjusted(tl_run_figures *figures, size_t adjust, double u, double nominal);

/* Copies the figures that the twin itself counts: the errors and the ledger. The names of the
 * components are not copied, so `account` must outlive the figures. */
void tl_run_figures_take_account(tl_run_figures *figures, const tl_account *account);

/* Returns the number of all committed steps, also caught-up and resumed ones. Each is a row in the
 * database. */
uint64_t tl_run_figures_committed(const tl_run_figures *figures);

/* Prints the text `before`, then the count of each outcome that occurred: "7 free, 3 optimised".
 * Prints nothing and returns false if there was no outcome. */
bool tl_run_figures_print_outcomes(const tl_run_figures *figures, const char *before, FILE *file);

/* Return the MSE of Δy, in the square of its unit: at the steps, at the readings, of released
 * twins; then the largest |Δy| at the steps. NaN if there are too few pairs: fewer than 2 for an
 * MSE, none for the maximum. */
double tl_run_figures_mse(const tl_run_figures *figures, size_t match);
double tl_run_figures_mse_readings(const tl_run_figures *figures, size_t match);
double tl_run_figures_mse_released(const tl_run_figures *figures, size_t match);
double tl_run_figures_maximum(const tl_run_figures *figures, size_t match);

/* Return the mean of u, and that of Δu; NaN if there is no step. */
double tl_run_figures_mean(const tl_run_figures *figures, size_t adjust);
double tl_run_figures_correction_mean(const tl_run_figures *figures, size_t adjust);

/* Returns the sum of the ledger's counts over all components. */
tl_execution_counts tl_run_figures_total(const tl_run_figures *figures);

/* Returns the number of executions saved (`plain` − `executions`). It is negative if an FMU needed
 * more executions to catch up than were saved. */
double tl_run_component_saved(const tl_execution_counts *counts);

/* Returns the number of executions that were neither predicted nor done to catch up an FMU
 * (`difference` of tl_twin_ledger, which explains the sign). */
int64_t tl_run_component_difference(const tl_execution_counts *counts);

/* ---- Key figures as JSON, shared by `replay --json`, `run --json` and `show --json`.
 *
 * Purpose: all three have the same keys and structure; see docs/reference/files.md, "Results".
 * Thread:  that of the writer.
 */

/* Adds the object "outcomes". */
void tl_figures_json_add_outcomes(tl_json_writer *json, const tl_run_figures *figures);

/* Adds MSE, MAX and counts of a match to its object, which must be open. */
void tl_figures_json_add_match(tl_json_writer *json, const tl_run_figures *figures, size_t match, const char *unit);

/* Adds "components" and "total" to the ledger's object, which must be open. */
void tl_figures_json_add_components(tl_json_writer *json, const tl_run_figures *figures);

/* Adds "resumed"; null if the run did not resume an earlier one. */
void tl_figures_json_add_resumption(tl_json_writer *json, const tl_resumption *resumption);

/* Adds the lock state, its reason and the counts to the object "lock", which must be open. */
void tl_figures_json_add_lock(tl_json_writer *json, const tl_lock_tally *lock);

#endif
