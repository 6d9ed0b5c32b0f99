/* The recorder of a twin: opened by what the configuration and the account say, fed with its counts.
 *
 * Purpose: run and replay record the same, whether the twin is in this process or in another.
 * Thread:  that of the recorder's functions (recorder.h); the counts are taken in the twin's.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_RECORDER_H
#define TL_FIRMWARE_TWIN_TWIN_RECORDER_H

#include "firmware/base/identity.h"
#include "firmware/config/config.h"
#include "firmware/store/record_queue.h"
#include "firmware/store/recorder.h"
#include "master/twin/account.h"

/* What is known of a run before there is a twin: all that its beginning in an outbox does not say. */
typedef struct tl_twin_record {
    tl_recorder_settings settings; /* whose texts are the configuration's, or here */
    tl_recorder_names names;
    char fmus[TL_SHA256_TEXT];
    char boot[TL_IDENTITY_TEXT];
    char format[TL_IDENTITY_TEXT];
} tl_twin_record;

/* For a run that is recorded at `path`. The configuration and the record outlive the recorder. */
void tl_twin_recorder_describe(const tl_config *config, const char *path, tl_twin_record *record);

/* With its signals and components, of a run that was described. Errors: those of tl_recorder_open(). */
tl_status tl_twin_recorder_open(const tl_config *config, const tl_account *account, tl_twin_record *record,
                                tl_recorder **recorder, tl_error *error);

/* What the FMUs of this configuration are: tl_identity_files() of the components'. */
void tl_twin_recorder_identify(const tl_config *config, char text[TL_SHA256_TEXT]);

/* The matched and the adjusted variables as recorder and report name them. Texts live as long as configuration and account. */
void tl_twin_recorder_signals(const tl_config *config, const tl_account *account,
                              tl_recorder_signal match[TL_MAX_MATCH], tl_recorder_signal adjust[TL_MAX_ADJUST]);

/* The ledger as it stands, for tl_recorder_put_step(). In mode ahead that is one step further than the record. Returns how many
 * components there are. */
size_t tl_twin_recorder_count(const tl_twin *twin, tl_recorder_component counts[TL_RECORDER_COMPONENTS]);

/* Live: a run begins now, whose tick 0 is at `start` (CLOCK_MONOTONIC). NULL: without a twin. */
void tl_twin_recorder_start(tl_record_queue *queue, const tl_twin *twin, tl_time start);

/* Puts a step with the ledger as it stands. */
void tl_twin_recorder_put(tl_record_queue *queue, const tl_record *record, const tl_twin *twin);

/* Tells of components that were executed more often than their ledger predicts, each in a sentence. For the end of a run. */
typedef void tl_twin_recorder_hear(void *context, const char *text);
void tl_twin_recorder_check(const tl_account *account, tl_twin_recorder_hear *hear, void *context);

#endif
