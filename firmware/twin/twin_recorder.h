/* Recorder of a twin: takes its settings from the configuration and the account of the twin, and
 * its counts from the twin.
 *
 * Purpose: a run and a replay record the same data, also if the twin is in another process.
 * Owner:   the caller closes the recorder that tl_twin_recorder_open() returns.
 * Thread:  that of the recorder's functions (recorder.h); the counts are read in the twin's thread.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_RECORDER_H
#define TL_FIRMWARE_TWIN_TWIN_RECORDER_H

#include "firmware/base/identity.h"
#include "firmware/config/config.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder.h"
#include "master/twin/account.h"

/* Data of a run that are known without a twin, so the record queue does not contain them. */
typedef struct tl_twin_record {
    tl_recorder_settings settings; /* its texts belong to the configuration or to this struct */
    tl_recorder_names names;
    char fmus[TL_SHA256_TEXT];     /* tl_twin_recorder_identify() */
    char boot[TL_IDENTITY_TEXT];   /* tl_identity_boot() */
    char format[TL_IDENTITY_TEXT]; /* tl_identity_format() */
} tl_twin_record;

/* Fills the record for a run that is recorded at `path`. The configuration and the record must
 * outlive the recorder. */
void tl_twin_recorder_describe(const tl_config *config, const char *path, tl_twin_record *record);

/* Opens the recorder of a described run, with its signals and components. Errors: those of
 * tl_recorder_open(). */
tl_status tl_twin_recorder_open(const tl_config *config, const tl_account *account, tl_twin_record *record,
                                tl_recorder **recorder, tl_error *error);

/* Identity of the configuration's FMUs: tl_identity_files() of the components' files. */
void tl_twin_recorder_identify(const tl_config *config, char text[TL_SHA256_TEXT]);

/* Names of the matched and the adjusted variables for recorder and report. Texts live as long as
 * configuration and account. */
void tl_twin_recorder_signals(const tl_config *config, const tl_account *account,
                              tl_recorder_signal match[TL_MAX_MATCH], tl_recorder_signal adjust[TL_MAX_ADJUST]);

/* Reads the twin's present ledger (counts of executions per component), for tl_recorder_put_step().
 * In mode ahead the ledger is one step ahead of the record. Returns the number of entries: the
 * components and the plant. */
size_t tl_twin_recorder_count(const tl_twin *twin, tl_execution_counts counts[TL_RECORDER_COMPONENTS]);

/* Live run: begins a run in the record queue. `start`: instant of tick 0 (CLOCK_MONOTONIC). `twin`
 * NULL: safe hold. Not for two threads at the same time. */
void tl_twin_recorder_start(tl_record_queue *queue, const tl_twin *twin, tl_time start);

/* Live run: enqueues a step with the present ledger. */
void tl_twin_recorder_put(tl_record_queue *queue, const tl_record *record, const tl_twin *twin);

/* At the end of a run: calls `on_event` with a sentence for each component that was executed more
 * often than its ledger predicts. `text` is valid during the call. */
typedef void tl_twin_recorder_on_finding(void *context, const char *text);
void tl_twin_recorder_check(const tl_account *account, tl_twin_recorder_on_finding *on_event, void *context);

#endif
