/* The twin in a process of its own, as seen by the one that started it.
 *
 * Purpose: FMUs are strangers' programs. They run in a process that holds nothing but them: no file, no socket, no terminal (confine.h).
 *          This is the other end of it: it is started, built, given ticks, asked for results, and ended.
 * Trust:   whatever comes from there may be a lie. It is held against the protocol, copied before it is looked at, and shown without
 *          control characters; who breaks the protocol is killed.
 * Ends:    an end that was not announced is a failure, told with the FMU and the function that was being called. So are a call that lasts
 *          too long and a bound that is not kept (memory, threads, files); then the process is killed. What came before counts.
 * Threads: all functions are for one thread; another one, of ours, relays what the process prints, answers its refused system calls
 *          and looks at its bounds (twin_process.h).
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

/* The title of a process that only looks at states, in place of "twin": the same role. */
#define TL_TWIN_READER "states"

typedef struct tl_twin_child tl_twin_child;

typedef struct tl_twin_child_settings {
    const tl_twin_job *job;
    const tl_config *
        config; /* of the job's text, as its twin takes it: delays forgotten, look-ups in use. Needed until the work has ended */
    FILE *page;               /* what a check prints goes here; NULL: nowhere */
    tl_twin_page *print_page; /* as in main() */
    tl_time call_limit;       /* ns of one call of an FMU */
    uint64_t memory_limit;    /* bytes that the process may take; 0: tl_confine_fair_memory() */
    const tl_block *others;   /* what another one shows, which this one reads; NULL: it is none that reads */
} tl_twin_child_settings;

/* What became of a pair that was compared, or of ways that were tried. */
typedef struct tl_twin_outcome {
    tl_twin_pair_account pair; /* as far as it came; texts are clean */
    tl_twin_ways ways;
    bool has_ended;           /* the process has, unannounced, or was killed: */
    tl_status status;         /* of that, or of the second twin; TL_OK: it came to its end */
    char text[TL_ERROR_TEXT]; /* how, or how both differ, or one does not come back; "": no fault was found */
} tl_twin_outcome;

/* Starts it, and returns when it is confined and about to load FMUs. What is not held of its confinement is said on the log. Errors:
 * TL_TRY_AGAIN. */
tl_status tl_twin_child_start(const tl_twin_child_settings *settings, tl_twin_child **child, tl_error *error);

/* Waits until the twin is built. What is wrong was said on the log if error->text is empty. */
tl_status tl_twin_child_build(tl_twin_child *child, tl_account *account, tl_error *error);

/* Waits until a check is done and its page printed; the same of its errors. Meanwhile, if its job says `reads_back`, starts other processes with the same FMUs
 * that read what it shows. */
tl_status tl_twin_child_check(tl_twin_child *child, tl_twin_check *found, tl_error *error);

/* By which ways components are led back, of a check that has ended, as far as it says. */
void tl_twin_child_ways(const tl_twin_child *child, tl_twin_ways *ways);

/* Waits until a pair is compared or ways are tried, or the process is at its end. Errors: TL_INTERRUPTED. */
tl_status tl_twin_child_finish(tl_twin_child *child, tl_twin_outcome *outcome, tl_error *error);

/* Tells what FMUs were refused since this was called last. It was said on the log already. */
void tl_twin_child_tell(tl_twin_child *child, tl_fmu_refusals_listener *hear, void *context);

/* A tick; `last`: it only completes the record before. At most TL_CHANNEL_DEPTH may be under way. It is seen there when it is pushed. */
tl_status tl_twin_child_give(tl_twin_child *child, const tl_recording_tick *tick, bool last, tl_error *error);

void tl_twin_child_push(tl_twin_child *child);

/* The result of the oldest tick under way, which is this one. Sleeps, if there is none yet, until there are `wanted` of them, or as many as
 * there will be. *stopped: it was told to stop, and there is none. Errors: that of the step, with the result filled; that with
 * which it has ended by itself; else TL_FMU_FAILED: the process is at its end, and nothing is filled. */
tl_status tl_twin_child_take(tl_twin_child *child, int64_t tick, unsigned wanted, tl_twin_result *result, bool *stopped,
                             tl_error *error);

/* It shall compute nothing more: what is done can be taken, then take says that it has stopped. */
void tl_twin_child_stop(tl_twin_child *child);

/* Ends the work, and gives the account as it then stands (NULL: not wanted). What was computed and not taken is passed over. */
tl_status tl_twin_child_end(tl_twin_child *child, tl_account *account, tl_error *error);

/* FMUs were refused something. */
bool tl_twin_child_was_refused(const tl_twin_child *child);

/* It is at its end, and was told how. */
bool tl_twin_child_is_gone(const tl_twin_child *child);

/* After that: it was ended by SIGKILL, and not by this process. The kernel does so if memory is short. */
bool tl_twin_child_was_killed_by_others(const tl_twin_child *child);

/* After that: waits until the FMUs are freed and the process has ended. Errors: TL_FMU_FAILED if it did not end as it should. */
tl_status tl_twin_child_wait(tl_twin_child *child, tl_error *error);

/* Ends it if it is not at its end yet; removes what it has left. NULL is allowed. */
void tl_twin_child_close(tl_twin_child *child);

/* ---- The feed: a recording read ahead, tick by tick, into a twin, and its results in the same order.
 *
 * Purpose: a twin in another process costs little only if neither side waits for the other at each tick. So ticks are given to it
 *          ahead of time, and results are taken as they come.
 * Ends:    where the recording does, at the configured duration, or when it is told to stop. In mode ahead a step is computed only if its
 *          measurement will come, so the last tick only completes the record before it.
 * Thread:  one.
 */

typedef struct tl_twin_feed tl_twin_feed;

typedef struct tl_twin_feed_settings {
    const tl_config *config;
    const tl_account *account; /* of the built twin */
    tl_recording *recording;   /* read by nobody else while it feeds */
    tl_twin_child *child;      /* the twin */
    bool plant;                /* every tick of the recording is a step, whatever the configuration says of an end */
    bool paced;                /* a tick is given when it is wanted, and not before */
} tl_twin_feed_settings;

/* One tick and what came of it; valid until the next one. */
typedef struct tl_twin_fed {
    const tl_recording_tick *tick;
    const tl_twin_result *result;
    bool last; /* no step was computed: its sample only completed the record before */
} tl_twin_fed;

/* Settings are copied; what they point to must outlive the feed. Errors: TL_TRY_AGAIN. */
tl_status tl_twin_feed_open(const tl_twin_feed_settings *settings, tl_twin_feed **feed, tl_error *error);

/* The tick that will be given next, so that a paced feed can wait for its instant; NULL: there is none. */
const tl_recording_tick *tl_twin_feed_look(tl_twin_feed *feed);

/* The next tick with its result; *end: there is none. A status that is not TL_OK is that of the recording, of the step (`fed` is filled then too,
 * and may have a record), or of the process with the twin (it is not); nothing comes after it. */
tl_status tl_twin_feed_next(tl_twin_feed *feed, tl_twin_fed *fed, bool *end, tl_error *error);

/* No further tick is given; what has been computed still comes. */
void tl_twin_feed_stop(tl_twin_feed *feed);

/* The tick after which nothing is computed any more. */
int64_t tl_twin_feed_last_tick(const tl_config *config, const tl_account *account);

/* NULL is allowed. */
void tl_twin_feed_close(tl_twin_feed *feed);

#endif
