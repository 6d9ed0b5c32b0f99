/* Tick of an assembled twin: step, verification, result. Called by the thread that calls the FMUs.
 *
 * Memory:  plain data; nothing is allocated here.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_STEP_H
#define TL_FIRMWARE_TWIN_TWIN_STEP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/monitor/lock_monitor.h"
#include "firmware/plant/recording.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/assembly.h"
#include "master/base/status.h"
#include "master/twin/account.h"
#include "master/twin/twin.h"

/* ---- One tick and its result, as exchanged between the FMU process and its parent.
 *
 * Purpose: a replay and an emulated plant use a twin in the same way, in any process. A tick is
 *          searched, caught up (nominal plus the last correction), or followed (recorded u).
 * Thread:  data: any. Execute: the FMU thread.
 */

/* Content of a result, in addition to the record. */
typedef enum tl_twin_attached {
    TL_ATTACHED_NONE,   /* nothing */
    TL_ATTACHED_COUNTS, /* the ledger, for the recorder */
    TL_ATTACHED_OUTPUTS /* the variables that `emulate` reads, for a plant */
} tl_twin_attached;

#define TL_TWIN_NO_TICK INT64_MIN /* tick of a result that is not filled */

/* Result of one tick. In mode ahead it has the record of the step before. */
typedef struct tl_twin_result {
    int64_t tick;
    int32_t status;   /* tl_status of the step */
    uint32_t ready;   /* 1: there is a record */
    uint64_t unsaved; /* tl_twin_unsaved() */
    tl_twin_identifiability identifiability;
    tl_record record;
    union {
        tl_execution_counts counts[TL_RECORDER_COMPONENTS];
        double outputs[TL_MAX_SIGNALS];
    } attached; /* `counts` or `outputs`, by tl_twin_attached; unused elements are not sent */
} tl_twin_result;

/* Bytes of a result; the unused part of `attached` does not count. */
size_t tl_twin_result_size(const tl_config *config, tl_twin_attached attached);

/* Validates a result of another process. Status, outcomes and qualities must be known codes, the
 * step in least … tick. Measured and computed values are not checked. */
bool tl_twin_result_is_sound(const tl_twin_result *result, const tl_config *config, int64_t tick, int64_t least);

/* Tunings of a run that is repeated: an unaligned array of tl_run_tuning. Zeroed: none. */
typedef struct tl_twin_tunings {
    const unsigned char *bytes;
    size_t count;
    size_t taken; /* number of tunings applied */
} tl_twin_tunings;

/* Takes the next tuning whose tick is `tick` or earlier. Returns false if there is none. */
bool tl_twin_tunings_next(tl_twin_tunings *tunings, int64_t tick, tl_run_tuning *tuning);

/* Executes a tick without a time budget. It searches as configured. But it repeats what was
 * recorded if the tick was caught up, followed, cut short by time, or came after a reset of the
 * FMUs. `recovery` monitors the records and resets the FMUs as in a live run, but never those of an
 * emulated plant (TL_ATTACHED_OUTPUTS). Errors: those of tl_twin_step(), also in the result. */
tl_status tl_twin_execute(const tl_assembly *assembly, const tl_recording_tick *tick, tl_twin_attached attached,
                          tl_recovery *recovery, tl_twin_result *result, tl_error *error);

/* Completes the last record with the sample after it (tl_twin_finish()). */
void tl_twin_execute_last(const tl_assembly *assembly, const tl_recording_tick *tick, tl_twin_attached attached,
                          tl_twin_result *result);

/* ---- Verification in the remaining time of a tick: checks if the rollback of the FMUs is still
 * exact. A finding is a rollback that is not exact.
 *
 * Purpose: the live cycle and a replay call the same verification (tl_twin_verify()) and report the
 *          same text.
 */

enum { TL_TWIN_FINDING_TEXT = 400 };

/* Result of a verification. */
typedef struct tl_twin_verify_report {
    bool found;  /* false: no finding; ignore the other fields */
    bool mended; /* repaired: another rollback method is in use, so the finding has no further effect */
    char component[TL_ASSEMBLY_NAME];
    char text[TL_TWIN_FINDING_TEXT]; /* a sentence for the log */
} tl_twin_verify_report;

/* Verifies between two ticks, at most until the instant `until` (CLOCK_MONOTONIC); TL_TIME_NEVER:
 * no limit. Neither waits nor logs. Errors: those of tl_twin_verify(). */
tl_status tl_twin_verify_until(tl_twin *twin, tl_time until, tl_twin_verify_report *outcome, tl_error *error);

/* Describes the newest finding of a run that has ended. Returns false if it had no finding. */
bool tl_twin_last_finding(const tl_account *account, tl_twin_verify_report *outcome);

#endif
