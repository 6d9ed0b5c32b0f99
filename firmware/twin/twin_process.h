/* A process with FMUs, from the side of the one that starts it.
 *
 * Purpose: what each of them needs, whatever it computes: a private folder, a user of its own if we are root, surroundings, a job, pipes for what
 *          it prints, and two threads of ours. It is this program once more, in the role "twin" (twin_role.h).
 * Above:   twin_child.h puts a channel on it. A live twin has blocks, and a supervisor that watches it.
 * Watch:   one thread answers the system calls that were refused, and kills the process if a call of an FMU lasts too long or a bound of memory,
 *          threads or files is not kept. It waits for nobody, whatever FMUs do. What asks this program to end it passes on to the process, from
 *          when that has handlers on; a second time, the process is killed. Not if a supervisor does that.
 * Output:  the other thread passes on what the process prints, and says what it was refused, each once with FMU and function. It alone may wait for
 *          who reads our log, for 2 s at most; what is not taken until then is left out and counted.
 * Bounds:  of lines, and apart of those that say their level (our own, or so they say), 32 MiB are passed on and then 16 KiB per second; what exceeds is
 *          left out: that is said once, and how many lines it were when all ends. The page of a check has at most 64 MiB.
 * Marks:   a line of an FMU begins with "fmu: ", so that it is no line of ours. One that begins with "<3>" to "<7>" is taken for ours: both come from
 *          one process, so an FMU can forge that.
 * Waiting: for the process nothing waits but kill and close, until it is dead.
 * Death:   who reaps the process by other means than these calls lets it go before: tl_twin_process_let_go().
 * Thread:  one, the one that has started it; was_killed, was_refused and flush from any.
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
    TL_TWIN_FOLDER_MIB = 256, /* that FMUs may write, beside what they are unpacked to */
    TL_TWIN_THREADS =
        1024, /* of an honest FMU: an interpreter has a handful, a numeric library one for each processor */
    TL_TWIN_KILLED_TEXT = 512
};

/* The FMUs of a configuration, as far as their process is bounded by them. */
typedef struct tl_twin_fmus {
    size_t count;
    uint64_t unpacked_bytes; /* that their archives may unpack to, together */
} tl_twin_fmus;

typedef struct tl_twin_process tl_twin_process;

/* `calls`, `channel`, `page`, `tasks` and `context` must stay until the process is closed, the rest during the start. Descriptors stay the caller's. */
typedef struct tl_twin_process_settings {
    const tl_twin_job *job; /* folder, file_bytes, memory and user are filled in */
    tl_twin_fmus fmus;
    unsigned which;    /* 0 … 63, of those that we have at the same time: none has the user of another one */
    const char *title; /* "twin [motor]" */
    int given
        [TL_ROLE_DESCRIPTORS]; /* what it gets beside nothing, output, page, job and start socket (twin_role.h); -1: nothing */
    const tl_fmu_calls *calls; /* in memory that the process writes: for the watch thread */
    tl_channel *channel;       /* whose thread is nudged if the process ends, or is killed; NULL: none */
    FILE *page;                /* what a check prints goes here; NULL: nothing is printed */
    bool
        is_silent; /* what it prints is dropped, and what it was refused is not said: another one like it has said the same */
    bool
        passes_signals; /* the watch thread passes on what asks us to end, and kills the process if a call of an FMU lasts too long */
    tl_time call_limit;              /* ns of such a call; 0: none */
    uint64_t memory_limit;           /* bytes that the process may take; 0: tl_confine_fair_memory() */
    const tl_twin_role_tasks *tasks; /* for a machine without exec (role.h) */
    tl_fmu_refusals_listener
        *hear;     /* told of each refusal that is said on the log, in the thread of the output; NULL: nobody */
    void *context; /* of `hear` */
} tl_twin_process_settings;

/* Looks at the files; one that is not there has no bytes. */
tl_twin_fmus tl_twin_fmus_of(const tl_config *config);

/* Starts it, and does not wait for what it does. What it is confined by, it tells by other ways. Errors: TL_TRY_AGAIN; then nothing is left. */
tl_status tl_twin_process_start(const tl_twin_process_settings *settings, tl_twin_process **process, tl_error *error);

/* Its number, 0 if it was reaped or let go; and how it has ended, if it has. */
const tl_role *tl_twin_process_role(const tl_twin_process *process);

/* Looks without waiting. True: it has ended, and is reaped. */
bool tl_twin_process_reap(tl_twin_process *process);

/* Kills it if it has not ended, and reaps it. */
void tl_twin_process_kill(tl_twin_process *process);

/* It is dead, and somebody else reaps it after this: nothing is done to its number any more. Passes on what it has printed. */
void tl_twin_process_let_go(tl_twin_process *process);

/* True: the watch thread has killed it, or is about to; `text` says why. */
bool tl_twin_process_was_killed(tl_twin_process *process, char text[TL_TWIN_KILLED_TEXT]);

/* It was refused something. */
bool tl_twin_process_was_refused(tl_twin_process *process);

/* Tells what was refused and has not been told by this yet. */
void tl_twin_process_tell(tl_twin_process *process, tl_fmu_refusals_listener *hear, void *context);

/* All that it has printed until now has been passed on. */
void tl_twin_process_flush(tl_twin_process *process);

/* Kills it if it was neither reaped nor let go; ends the threads, and removes the folder. NULL is allowed. */
void tl_twin_process_close(tl_twin_process *process);

#endif
