/* One tick of the assembled twin: step, verification, result.
 *
 * Thread:  the one that calls the FMUs.
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

/* ---- One tick for the twin, and what comes of it: what crosses between the process with the FMUs and the one with everything else.
 *
 * Purpose: a replay and an emulated plant ask the same of a twin, wherever it is: to be led along, to make a tick up, to search.
 * Thread:  plain data; execute in the thread of the FMUs.
 */

/* What is told of each step besides its record. */
typedef enum tl_twin_tells {
    TL_TELLS_RECORDS, /* nothing */
    TL_TELLS_COUNTS,  /* the ledger, for the recorder */
    TL_TELLS_OUTPUTS  /* what `emulate` reads, for a plant */
} tl_twin_tells;

#define TL_TWIN_NO_TICK INT64_MIN

/* Of one tick. In mode ahead the record is that of the step before. */
typedef struct tl_twin_result {
    int64_t tick;
    int32_t status; /* tl_status of the step */
    uint32_t ready; /* 1: there is a record */
    tl_record record;
    union {
        tl_recorder_component counts[TL_RECORDER_COMPONENTS];
        double outputs[TL_MAX_SIGNALS];
    } besides; /* as far as there are some */
} tl_twin_result;

/* Bytes of a result, of which the rest of `besides` is left out. */
size_t tl_twin_result_size(const tl_config *config, tl_twin_tells tells);

/* Whether what another process says of this tick can be one: outcomes and qualities that exist, a step that is not before `least`, nor after the
 * tick. Numbers are not judged. */
bool tl_twin_result_is_sound(const tl_twin_result *result, const tl_config *config, int64_t tick, int64_t least);

/* Tunings of a run that is repeated, tl_run_tuning one behind the other, anywhere; and how many of them were taken. Zeroed: none. */
typedef struct tl_twin_tunings {
    const unsigned char *bytes;
    size_t count;
    size_t taken;
} tl_twin_tunings;

/* The next one that is in force from this tick on. False: there is none. */
bool tl_twin_tunings_next(tl_twin_tunings *tunings, int64_t tick, tl_run_tuning *tuning);

/* The tick through the twin: searched as configured, without a clock; made up, followed, cut short, or after the FMUs began anew if it was so in
 * the recording. `recovery` sees it, and lets them begin anew as well, as a live run's does. Errors: those of tl_twin_step(), in the result too. */
tl_status tl_twin_execute(const tl_assembly *assembly, const tl_recording_tick *tick, tl_twin_tells tells,
                          tl_recovery *recovery, tl_twin_result *result, tl_error *error);

/* Completes the last record with the sample after it (tl_twin_finish()). */
void tl_twin_execute_last(const tl_assembly *assembly, const tl_recording_tick *tick, tl_twin_tells tells,
                          tl_twin_result *result);

/* ---- What is left of a tick is for looking whether the FMUs still come back to where they were; and what was found, as a sentence.
 *
 * Purpose: the live cycle and a replay ask the twin the same (tl_twin_verify()), and tell the same.
 * Thread:  that of the FMUs.
 */

enum { TL_TWIN_FINDING_TEXT = 400 };

/* What was found. */
typedef struct tl_twin_look_news {
    bool found;  /* false: nothing, and the rest means nothing */
    bool mended; /* it is no harm any more */
    char component[TL_ASSEMBLY_NAME];
    char text[TL_TWIN_FINDING_TEXT]; /* a sentence */
} tl_twin_look_news;

/* Between two ticks, until `until` on the monotonic clock; TL_TIME_NEVER: there is time enough. Does not wait, and logs nothing. Errors: those of
 * tl_twin_verify(). */
tl_status tl_twin_look(tl_twin *twin, tl_time until, tl_twin_look_news *news, tl_error *error);

/* The newest finding of a run that has ended. False: there is none. */
bool tl_twin_look_at_account(const tl_account *account, tl_twin_look_news *news);

#endif
