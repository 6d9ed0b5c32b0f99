/* Patience with FMUs: how long a call may last before the process ends without it.
 *
 * Purpose: an FMU that never returns must not keep a program from telling what it waits for, nor from ending when it is asked to. A
 *          thread cannot be taken out of a vendor's code, so the process with the FMUs ends, and the FMU, its function, and how long are told.
 * Limits:  of a single call in `check`, `replay` and `plant`, whose FMUs are in a process of their own that another one watches (not in `run`,
 *          which has its supervisor); and TL_FMU_CALL_TIMEOUT_END once the program was asked to end. Asked again after a second, it ends at once.
 * Clock:   what passes between two looks, of which at most a second counts: who was stopped, or suspended, was not patient.
 * Thread:  the main thread, which looks some times a second while FMUs are called in another one.
 */
#ifndef TL_FIRMWARE_PROCESS_FMU_CALL_TIMEOUT_H
#define TL_FIRMWARE_PROCESS_FMU_CALL_TIMEOUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/fmu_call.h"
#include "master/base/simtime.h"

#define TL_FMU_CALL_TIMEOUT_END (5 * TL_SECOND)

/* Unless told otherwise: loading and instantiating may take long. */
#define TL_FMU_CALL_TIMEOUT_CALL (60 * TL_SECOND)

/* Nothing may come of a process with FMUs for as long as so many calls may last: whoever is not in a call, or says so, does not escape. */
enum { TL_FMU_CALL_TIMEOUT_CALLS = 10 };

/* Zeroed at first. Fields are private, but for `limit`. */
typedef struct tl_fmu_call_timeout {
    tl_time limit;  /* ns of one call; 0: none */
    tl_time looked; /* 0: never */
    uint32_t begun; /* the call seen last */
    tl_time lasted; /* as seen: how long that call is under way */
    tl_time asked;  /* how long ago the program was asked to end, */
    unsigned times; /* and how often, within the first second */
} tl_fmu_call_timeout;

/* What is seen in a look. */
typedef struct tl_fmu_call_timeout_view {
    tl_time now;             /* CLOCK_MONOTONIC */
    const tl_fmu_call *call; /* NULL: none is under way */
    const char *asked;       /* the signal that asked to end; NULL: none */
    unsigned times;          /* how often */
    bool whatever;           /* asked again it ends also if no FMU is being called, or so it says */
} tl_fmu_call_timeout_view;

/* False: there is patience left. True: it is over, and `text` says why. */
bool tl_fmu_call_timeout_is_over(tl_fmu_call_timeout *patience, const tl_fmu_call_timeout_view *view, char *text,
                                 size_t size);

/* In the process with the FMUs: looks at the call under way and at the signals that came, and takes these back from an FMU whose call lasts. If
 * patience is over the process ends here. */
void tl_fmu_call_timeout_look(tl_fmu_call_timeout *patience);

#endif
