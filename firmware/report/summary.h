/* The summary of a run and why it ended.
 *
 * Thread:  one.
 */
#ifndef TL_FIRMWARE_REPORT_SUMMARY_H
#define TL_FIRMWARE_REPORT_SUMMARY_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/config/config.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/report/run_figures.h"
#include "master/twin/account.h"

/* ---- The summary of a run: what `replay --json`, the closing table of `replay` and `run`, and the demo show.
 *
 * Purpose: adds up records as they come; prints itself as one JSON object (keys: config/SPEC.md, "Results", --json) or as
 *          a table for people.
 * Thread:  add() from the thread that steps; printing afterwards.
 */

typedef struct tl_summary {
    tl_run_figures figures;            /* but for what the twin itself keeps until it is printed */
    uint64_t samples;                  /* of the plant, */
    uint64_t not_good[TL_MAX_SIGNALS]; /* and those of them that were not good, by signal */
    uint64_t
        ticks; /* instants at which a step was due, counted by the clock, which are steps + skipped; 0: there is none */
    uint64_t deadline_misses;  /* steps that ended after their period */
    uint64_t gaps;             /* live: times that ticks were made up, however many at once */
    tl_lock_tally lock;        /* of the last twin of a run */
    uint64_t tunings;          /* that the run took while it ran, */
    uint64_t tunings_left_out; /* and that a replay with another configuration does not follow */
    double wall_s;
    tl_resumption resumption; /* of a run that goes on with an earlier one, whose last steps are among the outcomes */
} tl_summary;

void tl_summary_add(tl_summary *summary, const tl_config *config, const tl_record *record);

/* A sample of the plant, as the twin was given it. */
void tl_summary_sample(tl_summary *summary, const tl_config *config, const tl_sample *sample);

/* Whether the twin was in lock in at least `percent` of the steps, as tl_lock_tally_is_enough(). 0 is not asked if nothing is adjusted, or if the run
 * goes on with another one. Errors: TL_NOT_LOCKED. */
tl_status tl_summary_require_lock(const tl_summary *summary, const tl_config *config, double percent, tl_error *error);

/* One JSON object and a newline. Errors: TL_TRY_AGAIN if memory is out; nothing is printed then. */
tl_status tl_summary_print_json(const tl_summary *summary, const tl_config *config, const tl_account *account,
                                FILE *file, tl_error *error);

void tl_summary_print_table(const tl_summary *summary, const tl_config *config, const tl_account *account, FILE *file);

/* ---- The end of a run as its twin tells it: whether it can be one.
 *
 * Purpose: a process with FMUs may have written anything into its pulse. What indexes something, and what is printed as text, is checked before.
 * Thread:  pure.
 */

/* Of copies, which nobody changes any more. Numbers are not judged. */
bool tl_run_end_is_sound(const tl_summary *summary, const tl_account *account, const tl_config *config);

#endif
