/* Twin in a child process, seen from the parent.
 *
 * Purpose: FMUs are untrusted programs. They run in a process that has nothing else: no file, no
 *          socket, no terminal (confine.h). This module starts that process, builds the twin, sends
 *          ticks, receives results, and ends it.
 * Trust:   all data from the process are untrusted. They are checked against the protocol, copied
 *          before they are validated, and shown without control characters. A process that violates
 *          the protocol is killed.
 * Ends:    an unannounced end is a failure. It is reported with the FMU and the function that was
 *          being called. So are a call timeout and an exceeded limit (memory, threads, files); then
 *          the process is killed. Earlier results remain valid.
 * Owner:   the caller owns a child until tl_twin_child_close().
 * Thread:  one thread calls all functions. The watch thread and the output thread of this program
 *          check limits, answer denied system calls and forward output (twin_process.h).
 * Errors:  TL_TRY_AGAIN if the system is out of resources; TL_FMU_FAILED if the process has failed.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_CHILD_H
#define TL_FIRMWARE_TWIN_TWIN_CHILD_H

#include <stdbool.h>
#include <stdio.h>

#include "firmware/config/config.h"
#include "firmware/process/channel.h"
#include "firmware/process/refusal.h"
#include "firmware/twin/twin_role.h"
#include "firmware/twin/twin_step.h"
#include "firmware/twin/twin_trial.h"
#include "master/twin/account.h"

/* Title of a process that only tests saved states, instead of "twin". Its role is "twin" too. */
#define TL_TWIN_READER "states"

typedef struct tl_twin_child tl_twin_child;

typedef struct tl_twin_child_settings {
    const tl_twin_job *job;
    /* Parsed from job->text, then tl_config_use_lookups(), and for an emulated plant first
     * tl_config_forget_delays(). Must outlive the child. */
    const tl_config *config;
    FILE *page;               /* receives the printed page of a check; NULL: dropped */
    tl_twin_page *print_page; /* prints the page of a check (twin_role.h) */
    tl_time call_limit;       /* ns, call timeout; 0: none */
    uint64_t memory_limit;    /* bytes that the process may use; 0: tl_confine_fair_memory() */
    const tl_block *others;   /* block with states that another process saved, for the child to load; NULL: none */
} tl_twin_child_settings;

/* Result of a comparison of two twins, or of a trial of rollback methods. */
typedef struct tl_twin_outcome {
    tl_twin_pair_account pair; /* as far as the process completed it; texts are sanitised */
    tl_component_methods ways; /* result of a trial */
    bool has_ended;            /* the process ended unannounced, or was killed */
    tl_status status;          /* of the process or of the second twin; TL_OK: completed */
    char text
        [TL_ERROR_TEXT]; /* how it ended, how the twins differ, or how a rollback is not exact; "": no fault found */
} tl_twin_outcome;

/* Starts the process. Returns when it is confined and about to load FMUs. Logs missing parts of the
 * confinement. Errors: TL_TRY_AGAIN; TL_FMU_FAILED, also if it rejects its job; TL_INTERRUPTED. */
tl_status tl_twin_child_start(const tl_twin_child_settings *settings, tl_twin_child **child, tl_error *error);

/* Waits until the twin is built, and copies its account. If error->text is empty, it was logged. */
tl_status tl_twin_child_build(tl_twin_child *child, tl_account *account, tl_error *error);

/* Waits until a check is done and its page printed. Errors as tl_twin_child_build(). If the job has
 * `reads_back`, this function also starts the processes of the read-back test (read_back.h). */
tl_status tl_twin_child_check(tl_twin_child *child, tl_twin_check *found, tl_error *error);

/* Copies the rollback methods of the components after a check, as far as the process reported them.
 */
void tl_twin_child_get_methods(const tl_twin_child *child, tl_component_methods *ways);

/* Waits until a comparison or a trial is done, or the process has ended; a failure is an outcome.
 * Errors: TL_INTERRUPTED. */
tl_status tl_twin_child_finish(tl_twin_child *child, tl_twin_outcome *outcome, tl_error *error);

/* Calls `on_event` once for each kind of denied system call that this function has not reported
 * yet. They are also logged. */
void tl_twin_child_report(tl_twin_child *child, tl_fmu_refusals_listener *on_event, void *context);

/* Enqueues a tick. At most TL_CHANNEL_DEPTH ticks may have no result yet; one more is an error that
 * kills the process. `last`: no step is computed; the sample only completes the last record. */
tl_status tl_twin_child_enqueue(tl_twin_child *child, const tl_recording_tick *tick, bool last, tl_error *error);

/* Notifies the process that ticks were enqueued. */
void tl_twin_child_push(tl_twin_child *child);

/* Takes the result of the oldest enqueued tick, which must be `tick`. If no result is available
 * yet, sleeps until `wanted` results are available, but after each 0.1 s one is enough. *stopped:
 * the process has stopped on request and there is no result.
 * Errors: if the step failed: its error, and `result` is filled. If the process announced its end:
 *         the announced error. If it ended otherwise: TL_FMU_FAILED. */
tl_status tl_twin_child_take(tl_twin_child *child, int64_t tick, unsigned wanted, tl_twin_result *result, bool *stopped,
                             tl_error *error);

/* Asks the process to compute nothing more. Finished results can still be taken; after them
 * tl_twin_child_take() reports that it has stopped. */
void tl_twin_child_stop(tl_twin_child *child);

/* Ends the work and copies the final account (NULL: not wanted). Drops results that were not taken.
 * If the process has already ended, returns TL_OK and leaves `account` unchanged. */
tl_status tl_twin_child_end(tl_twin_child *child, tl_account *account, tl_error *error);

/* For TL_TASK_EXPLAIN, when all ticks of the window were sent: drops their remaining results, and
 * waits for the explanation. Calls `advance` after each message, for example after each re-run.
 * Errors: as tl_twin_child_check(). */
tl_status tl_twin_child_explain(tl_twin_child *child, void (*advance)(void *context), void *context,
                                tl_explanation *explanation, tl_error *error);

/* Returns true if a denied system call may have caused the failure of the ended process. */
bool tl_twin_child_refusal_may_be_cause(const tl_twin_child *child);

/* Returns true if the process was seen to have ended, and does not check again. */
bool tl_twin_child_is_gone(const tl_twin_child *child);

/* After the process has ended: returns true if SIGKILL ended it, and this program did not send it.
 * The kernel does that if memory is short. */
bool tl_twin_child_was_killed_by_others(const tl_twin_child *child);

/* After tl_twin_child_end(): waits until the FMUs are freed and the process has ended. Errors:
 * TL_FMU_FAILED if it did not end regularly; TL_INTERRUPTED if it was killed after a signal. */
tl_status tl_twin_child_wait(tl_twin_child *child, tl_error *error);

/* Kills the process if it still runs, and removes its files. NULL is allowed. */
void tl_twin_child_close(tl_twin_child *child);

/* ---- Feed: reads a recording ahead, sends its ticks to a twin, and returns the results in order.
 *
 * Purpose: a twin in another process is efficient only if neither side waits for the other at each
 *          tick. So the feed sends several ticks before it takes their results.
 * Ends:    at the end of the recording, at the configured duration, or when asked to stop. In mode
 *          ahead a step is computed only if its measurement will come, so the last tick only
 *          completes the record before it.
 */

typedef struct tl_twin_feed tl_twin_feed;

typedef struct tl_twin_feed_settings {
    const tl_config *config;
    const tl_account *account; /* of the built twin */
    tl_recording *recording;   /* only the feed may read it */
    tl_twin_child *child;      /* the twin */
    bool plant;                /* emulated plant: each tick of the recording is a step, also after the duration */
    bool paced;                /* a tick is sent only when the caller asks for its result; else many ahead */
} tl_twin_feed_settings;

/* A tick and its result; the pointers are valid until the next tl_twin_feed_next(). */
typedef struct tl_twin_fed {
    const tl_recording_tick *tick;
    const tl_twin_result *result;
    bool last; /* no step was computed: the sample only completed the last record */
} tl_twin_fed;

/* Settings are copied; all that they point to must outlive the feed. Errors: TL_TRY_AGAIN. */
tl_status tl_twin_feed_open(const tl_twin_feed_settings *settings, tl_twin_feed **feed, tl_error *error);

/* Returns the next tick to be sent, so that a paced feed can wait for its instant. NULL: none. */
const tl_recording_tick *tl_twin_feed_poll(tl_twin_feed *feed);

/* Returns the next tick with its result; *end: no tick remains, and `fed` is unchanged. Errors come
 * from the recording, the step, or the process with the twin. After a failed step `fed` is filled
 * and may have a record; after other errors it is unchanged. After an error nothing follows. */
tl_status tl_twin_feed_next(tl_twin_feed *feed, tl_twin_fed *fed, bool *end, tl_error *error);

/* Sends no further tick. Computed results can still be taken. */
void tl_twin_feed_stop(tl_twin_feed *feed);

/* Returns the last tick with a step within the configured duration; INT64_MAX: no duration. */
int64_t tl_twin_feed_last_tick(const tl_config *config, const tl_account *account);

/* NULL is allowed. */
void tl_twin_feed_close(tl_twin_feed *feed);

#endif
