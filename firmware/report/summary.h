/* Summary of a run and why it ended.
 *
 * Thread:  one thread.
 */
#ifndef TL_FIRMWARE_REPORT_SUMMARY_H
#define TL_FIRMWARE_REPORT_SUMMARY_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "firmware/config/config.h"
#include "firmware/monitor/lock_tally.h"
#include "firmware/report/ages.h"
#include "firmware/report/run_figures.h"
#include "firmware/store/run_types.h"
#include "master/twin/account.h"

/* ---- Summary of a run: for `replay --json`, the final table of `replay` and `run`, and the demo.
 *
 * Purpose: adds up records as they arrive. Prints itself as one JSON object (keys: config/SPEC.md,
 *          "Results", --json) or as a table for people.
 * Thread:  add() is called by the thread that steps; print afterwards.
 */

typedef struct tl_summary {
    tl_run_figures figures;            /* without the counts of the twin's account; print adds them */
    uint64_t samples;                  /* samples of the plant */
    uint64_t not_good[TL_MAX_SIGNALS]; /* samples that were not good, by signal */
    uint64_t moved[TL_MAX_SIGNALS];    /* samples whose value was moved to a limit of an FMU, by signal */
    uint64_t readings[TL_MAX_SIGNALS]; /* live: that came, by signal */
    uint64_t expected[TL_MAX_SIGNALS]; /* live: that the configuration expects; 0: no rate */
    struct {
        double value;
        tl_time age; /* of the reading, ns */
        uint32_t quality;
    } rejected[TL_MAX_SIGNALS]; /* the last sample that was not good, by signal */
    tl_ages ages;
    uint64_t refused;          /* candidates that could not be evaluated */
    uint64_t ticks;            /* instants at which a step was due, by the clock: steps + skipped; 0: not known */
    uint64_t deadline_misses;  /* steps that ended after their period */
    uint64_t gaps;             /* live: number of gaps; successive missed ticks are one gap */
    tl_lock_tally lock;        /* of the last twin of a run */
    uint64_t tunings;          /* tunings received during the run */
    uint64_t tunings_left_out; /* of these, not applied by a replay, because its configuration is different */
    double wall_s;
    tl_resumption resumption; /* of the earlier run, if any; the outcomes then include its last steps */
} tl_summary;

/* Adds the record of a committed step. */
void tl_summary_add(tl_summary *summary, const tl_config *config, const tl_record *record);

/* Counts a sample of the plant, as it was passed to the twin. */
void tl_summary_sample(tl_summary *summary, const tl_config *config, const tl_sample *sample);

/* Checks that the twin was in lock in at least `percent` of the steps, as tl_lock_tally_is_enough()
 * does. With `percent` 0, returns TL_OK without a check if nothing is adjusted, or if the run
 * resumes another one and had fewer than TL_LOCK_RECOVERED windows. Errors: TL_NOT_LOCKED. */
tl_status tl_summary_require_lock(const tl_summary *summary, const tl_config *config, double percent, tl_error *error);

/* Prints one JSON object and a newline. `changes`: of the run; NULL: there is no change detector.
 * Errors: TL_TRY_AGAIN if memory is out; then nothing is printed. */
tl_status tl_summary_print_json(const tl_summary *summary, const tl_config *config, const tl_account *account,
                                const tl_run_changes *changes, FILE *file, tl_error *error);

/* Prints a table for people: the lock, the errors and the corrections. `verbose`: also outcomes,
 * executions, the ledger and MSEs. `changes`: as above. */
void tl_summary_print_table(const tl_summary *summary, const tl_config *config, const tl_account *account,
                            const tl_run_changes *changes, bool verbose, FILE *file);

/* ---- Validation of a run end: the summary and the account that a twin reports when its run ends.
 *
 * Trust:   an FMU process may have written anything into its status block. Values that index an
 *          array or are printed as text are checked before use.
 * Thread:  pure function.
 */

/* Returns true if the run end is valid. The arguments must be copies that no other process can
 * change. Numerical values are not checked. */
bool tl_run_end_is_sound(const tl_summary *summary, const tl_account *account, const tl_config *config);

#endif
