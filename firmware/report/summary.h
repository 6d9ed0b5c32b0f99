/* Summary of a run, printed at its end.
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
 * Purpose: adds up records and samples as they arrive. Printed as one JSON object (keys:
 *          docs/reference/files.md, "Results") or as a table for people.
 * Thread:  the thread that steps calls add() and sample(); print afterwards.
 */

/* The caller zeroes it at first, and sets the fields that the functions below do not count. */
typedef struct tl_summary {
    tl_run_figures figures;            /* without the counts of the twin's account; print adds them */
    uint64_t samples;                  /* number of samples of the plant */
    uint64_t not_good[TL_MAX_SIGNALS]; /* samples that were not good, by signal */
    uint64_t moved[TL_MAX_SIGNALS];    /* samples whose value was moved to a limit of an FMU, by signal */
    uint64_t readings[TL_MAX_SIGNALS]; /* live: readings that arrived, by signal */
    uint64_t expected[TL_MAX_SIGNALS]; /* live: expected by the configuration; 0: no rate */
    struct {
        double value;
        tl_time age; /* of the reading, ns */
        uint32_t quality;
    } rejected[TL_MAX_SIGNALS];       /* the last sample that was not good, by signal */
    uint64_t at_bound[TL_MAX_ADJUST]; /* steps with u at a configured bound, by adjusted variable */
    struct {
        uint64_t count;              /* steps with a good ŷ and a finite y */
        double y, measured, squares; /* sums, and that of (y − ŷ)² */
    } compared[TL_MAX_MATCH];        /* of searched steps */
    tl_ages ages;
    uint64_t refused;          /* candidates that could not be evaluated */
    uint64_t ticks;            /* live: ticks at which a step was due: steps + skipped; 0: unknown */
    uint64_t deadline_misses;  /* steps that ended after their period */
    uint64_t gaps;             /* live: number of gaps; successive missed ticks are one gap */
    tl_lock_tally lock;        /* of the last twin of a run */
    uint64_t tunings;          /* tunings received during the run */
    uint64_t tunings_left_out; /* of these, not applied by a replay, because its configuration is different */
    double wall_s;             /* duration of the run by the clock, s */
    tl_resumption resumption;  /* of an earlier run, if any; then its repeated steps are in the outcomes */
} tl_summary;

/* Adds the record of a committed step. */
void tl_summary_add(tl_summary *summary, const tl_config *config, const tl_record *record);

/* Counts a sample of the plant, as it was passed to the twin. */
void tl_summary_sample(tl_summary *summary, const tl_config *config, const tl_sample *sample);

/* Checks that the twin was in lock in at least `percent` of the steps; with `percent` 0, that it
 * was ever in lock and nothing diverged (tl_lock_tally_is_enough()). With 0, returns TL_OK without
 * a check if nothing is adjusted, or if the run resumes another one and had fewer than
 * TL_LOCK_RECOVERED windows; logs a warning if the twin was lost in many steps. Errors:
 * TL_NOT_LOCKED; the text names a probable cause. */
tl_status tl_summary_require_lock(const tl_summary *summary, const tl_config *config, double percent, tl_error *error);

/* Prints one JSON object and a newline. `changes`: of the run; NULL: no change detector.
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

/* Returns true if summary and account are valid and fit the configuration. The arguments must be
 * copies that no other process can change. Numerical values are not checked. */
bool tl_run_end_is_sound(const tl_summary *summary, const tl_account *account, const tl_config *config);

#endif
