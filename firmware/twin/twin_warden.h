/* The warden of a process with FMUs: a thread of ours that keeps an eye on it while the others work.
 *
 * Purpose: it answers the system calls that were refused, and ends the process if a call of an FMU lasts too long or a bound of memory, threads or
 *          files is not kept. It waits for nobody, whatever FMUs do: what they print is passed on, and what they were refused is said, each once
 *          with FMU and function, by a thread beside it (twin_output.h).
 * Signals: what asks this program to end is passed on to the process, from when it has handlers on; a second time, the process is killed. Not
 *          if a supervisor does that.
 * Thread:  start and stop from the thread that has started the process; the rest as said.
 */
#ifndef TL_FIRMWARE_TWIN_TWIN_WARDEN_H
#define TL_FIRMWARE_TWIN_TWIN_WARDEN_H

#include <stdbool.h>
#include <stdio.h>
#include <sys/types.h>

#include "firmware/process/bounds.h"
#include "firmware/process/channel.h"
#include "firmware/process/fmu_call.h"
#include "firmware/process/refusal.h"
#include "firmware/process/role.h"
#include "master/base/simtime.h"

enum { TL_TWIN_WARDEN_TEXT = 512 };

typedef struct tl_twin_warden tl_twin_warden;

typedef struct tl_twin_warden_settings {
    pid_t process;
    int output; /* what it prints: a pipe, the warden's from now on, */
    int page;   /* and this, which goes to `page_file`; -1: none */
    int start; /* a socket, the warden's: by it the process hands over the descriptor that tells of refused calls, or closes its end */
    FILE *page_file;
    const tl_fmu_calls *calls; /* in its block */
    tl_channel *channel;       /* whose thread is nudged if the process ends, or is to; NULL: none */
    bool is_silent;            /* refusals are not said on the log */
    bool passes_signals;       /* and looks for how long a call of an FMU lasts */
    tl_time call_limit;        /* ns of one; 0: none */
    tl_bounds bounds;
    tl_fmu_refusals_listener
        *hear;     /* told of each refusal that is said on the log, in the thread of the output; NULL: nobody */
    void *context; /* of `hear` */
} tl_twin_warden_settings;

/* The descriptors are the warden's on failure too. Errors: TL_TRY_AGAIN. */
tl_status tl_twin_warden_start(const tl_twin_warden_settings *settings, tl_twin_warden **warden, tl_error *error);

/* Tells what was refused and has not been told by this yet. One thread, and in that. */
void tl_twin_warden_tell(tl_twin_warden *warden, tl_fmu_refusals_listener *hear, void *context);

/* It was refused something. Any thread. */
bool tl_twin_warden_has_refused(tl_twin_warden *warden);

/* All that the process has printed until now has been passed on. Any thread. */
void tl_twin_warden_flush(tl_twin_warden *warden);

/* True: it has killed the process, or is about to; `text` says why. Any thread. */
bool tl_twin_warden_has_killed(tl_twin_warden *warden, char text[TL_TWIN_WARDEN_TEXT]);

/* Looks whether the process has ended, and reaps it; its number is nobody's after that, so it is not killed any more. The thread that has started
 * the process. */
bool tl_twin_warden_reap(tl_twin_warden *warden, tl_role *process);

/* Kills the process if it has not ended, and reaps it. The same thread. */
void tl_twin_warden_kill(tl_twin_warden *warden, tl_role *process);

/* The process is dead, and somebody else reaps it after this: its number is nobody's then, so it is neither killed nor looked at any more. */
void tl_twin_warden_let_go(tl_twin_warden *warden);

/* Passes on what is left, and ends the thread. NULL is allowed. */
void tl_twin_warden_stop(tl_twin_warden *warden);

#endif
