/* Process with FMUs, seen from its parent.
 *
 * Purpose: sets up all that an FMU process needs for any task: a private folder, a user of its own
 *          if we are root, an environment, a job, pipes for its output, and two parent threads. The
 *          process runs this same program in the role "twin" (twin_role.h).
 * Users:   twin_child.h adds a channel. A live twin has shared blocks, and a supervisor that
 *          monitors it.
 * Watch:   the watch thread answers the denied system calls. It kills the process if a limit of
 *          memory, threads or files is exceeded. It never blocks, whatever FMUs do. Without a
 *          supervisor (`passes_signals`), it also kills the process after a call timeout. If this
 *          program gets a termination signal, it forwards the signal once the process has installed
 *          its handlers; a second signal kills the process.
 * Output:  the output thread forwards the output of the process, and logs each kind of denied
 *          system call once, with FMU and function. If the reader of our log is slow, only this
 *          thread waits for it, at most 2 s; then output is dropped and counted.
 * Bound:   lines without a level: the first 32 MiB are forwarded, then 16 KiB per second. Lines
 *          with a level (our own, or forged ones) have a separate limit of the same size. Further
 *          lines are dropped; that is logged once, and their number at the end. If the page of a
 *          check exceeds 64 MiB, the process is killed.
 * Marks:   a line of an FMU gets the prefix "fmu: ". A line that begins with a level, "<3>" to
 *          "<7>", counts as ours. An FMU can forge a level, because both write from the same
 *          process.
 * Waiting: only tl_twin_process_kill() and _close() wait until the process has died.
 * Reaping: before other code reaps the process, the caller must call tl_twin_process_let_go().
 * Owner:   the caller owns the process until tl_twin_process_close().
 * Thread:  the thread that started the process; was_killed, refusal_may_be_cause and flush from
 *          any.
 * Errors:  only tl_twin_process_start() returns one.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_PROCESS_H
#define TL_FIRMWARE_TWIN_TWIN_PROCESS_H

#include <stdbool.h>
#include <stdio.h>

#include "firmware/config/config.h"
#include "firmware/process/channel.h"
#include "firmware/process/fmu_call.h"
#include "firmware/process/refusal.h"
#include "firmware/process/role.h"
#include "firmware/twin/twin_role.h"

enum {
    TL_TWIN_FOLDER_MIB = 256, /* MiB that FMUs may write, in addition to their unpacked files */
    TL_TWIN_THREADS = 1024,   /* limit of threads; a numeric library starts one per processor */
    TL_TWIN_KILLED_TEXT = 512 /* bytes of a reason with its NUL */
};

/* Facts of a configuration's FMUs that define the limits of their process. */
typedef struct tl_twin_fmus {
    size_t count;            /* number of FMU files; each component counts */
    uint64_t unpacked_bytes; /* upper limit for all unpacked archives together */
} tl_twin_fmus;

typedef struct tl_twin_process tl_twin_process;

/* `calls`, `channel`, `page`, `tasks` and `context` must exist until the process is closed, all
 * else during the start. The caller keeps the descriptors. */
typedef struct tl_twin_process_settings {
    const tl_twin_job *job; /* this module sets its folder, memory and user */
    tl_twin_fmus fmus;
    unsigned which;    /* 0 … 63, different for processes at the same time, so that each has its own user */
    const char *title; /* process title, for example "twin [motor]" */
    int given
        [TL_ROLE_DESCRIPTORS]; /* its descriptors, besides null, output, page, job and start socket (twin_role.h); -1: none */
    const tl_fmu_calls *calls; /* call in progress, in memory that the process writes */
    tl_channel *channel;       /* wakes the thread that waits on it if the process ends or is killed; NULL: none */
    FILE *page;                /* receives the printed page of a check; NULL: nothing is printed */
    bool is_silent;            /* drop its output and denied system calls, because another process reports the same */
    bool passes_signals; /* the watch thread forwards termination signals, and kills the process after a call timeout */
    tl_time call_limit;  /* ns, call timeout; 0: none */
    uint64_t memory_limit;           /* bytes that the process may use; 0: tl_confine_fair_memory() */
    const tl_twin_role_tasks *tasks; /* for a machine without exec (role.h) */
    tl_fmu_refusals_listener
        *on_event; /* called by the output thread for each denied system call that is logged; NULL: none */
    void *context; /* of `on_event` */
} tl_twin_process_settings;

/* Computes the limit from the sizes of the FMU files (fmu_archive.h). A missing file counts 0. */
tl_twin_fmus tl_twin_fmus_of(const tl_config *config);

/* Starts the process and does not wait until it is ready. The process reports its confinement in
 * its channel or its blocks. Errors: TL_TRY_AGAIN; then there is nothing to close. */
tl_status tl_twin_process_start(const tl_twin_process_settings *settings, tl_twin_process **process, tl_error *error);

/* Returns the process ID (0 if it was reaped or let go) and, if it was reaped, how it ended. */
const tl_role *tl_twin_process_role(const tl_twin_process *process);

/* Reaps the process without waiting. Returns true if it has ended and is reaped. */
bool tl_twin_process_reap(tl_twin_process *process);

/* Kills the process if it has not ended, and reaps it. */
void tl_twin_process_kill(tl_twin_process *process);

/* Call it for a dead process before other code reaps it: then this module does not use the process
 * ID any more. Forwards the remaining output. */
void tl_twin_process_let_go(tl_twin_process *process);

/* Returns true if the watch thread has killed the process or is about to; `text` is the reason. */
bool tl_twin_process_was_killed(tl_twin_process *process, char text[TL_TWIN_KILLED_TEXT]);

/* Returns true if a denied system call may have caused the failure of the ended process. */
bool tl_twin_process_refusal_may_be_cause(tl_twin_process *process);

/* Calls `on_event` for each kind of denied system call that this function has not reported yet. */
void tl_twin_process_report(tl_twin_process *process, tl_fmu_refusals_listener *on_event, void *context);

/* Returns after all its output until now has been forwarded. */
void tl_twin_process_flush(tl_twin_process *process);

/* Kills the process if it was neither reaped nor let go; ends the threads, and removes the folder.
 * NULL is allowed. */
void tl_twin_process_close(tl_twin_process *process);

#endif
