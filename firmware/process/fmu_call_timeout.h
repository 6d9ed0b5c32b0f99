/* Call timeout: ends the process if an FMU call takes too long.
 *
 * Purpose: if an FMU never returns, the program must still report the hang and end on request. A
 *          thread cannot be stopped inside a vendor's code, so the whole FMU process ends. Before,
 *          it reports the FMU, the function, and the duration.
 * Limits:  `limit` for each call with the verbs check, replay and plant. With the verb run, the
 *          supervisor limits the calls instead. After a request to end (a signal), a call may last
 *          for another TL_FMU_CALL_TIMEOUT_END. A second request, at least one second after the
 *          first, ends the process at once.
 * Clock:   a duration is the sum of the times between checks. Each of these counts at most one
 *          second, so that a stopped or suspended process does not time out.
 * Thread:  the main thread, which checks several times a second while another thread calls FMUs.
 */
#ifndef TL_FIRMWARE_PROCESS_FMU_CALL_TIMEOUT_H
#define TL_FIRMWARE_PROCESS_FMU_CALL_TIMEOUT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/fmu_call.h"
#include "master/base/simtime.h"

/* Limit of a call after a request to end, ns. */
#define TL_FMU_CALL_TIMEOUT_END (5 * TL_SECOND)

/* Default limit of one call, ns; loading and instantiating may take long. */
#define TL_FMU_CALL_TIMEOUT_CALL (60 * TL_SECOND)

/* The parent kills an FMU process that is silent for this many times the limit of a call. So a
 * process also ends if it hangs outside of a call, or does not report its call. */
enum { TL_FMU_CALL_TIMEOUT_CALLS = 10 };

/* Zeroed at first. Fields are private, except `limit`. */
typedef struct tl_fmu_call_timeout {
    tl_time limit;      /* ns of one call; 0: none */
    tl_time checked_at; /* instant of the last check, ns; 0: none */
    uint32_t begun;     /* number of the call at the last check (fmu_call.h) */
    tl_time lasted;     /* duration of that call so far, ns */
    tl_time asked;      /* time since the request to end, ns; 0: no request */
    unsigned times;     /* number of requests up to one second after the first */
} tl_fmu_call_timeout;

/* Input of one check. */
typedef struct tl_fmu_call_timeout_view {
    tl_time now;             /* CLOCK_MONOTONIC, ns */
    const tl_fmu_call *call; /* current call; NULL: none */
    const char *asked;       /* name of the signal that requested the end; NULL: none */
    unsigned times;          /* number of requests so far */
    bool whatever;           /* true: a second request ends the process even if no FMU call is running */
} tl_fmu_call_timeout_view;

/* Returns true if a limit is exceeded or the end was requested again; then writes the reason to
 * `text`, which has `size` bytes. */
bool tl_fmu_call_timeout_is_over(tl_fmu_call_timeout *patience, const tl_fmu_call_timeout_view *view, char *text,
                                 size_t size);

/* In the FMU process: checks the current call and the received signals. Reinstalls our signal
 * handlers during a long call. If a limit is exceeded, ends the process (tl_process_give_up()). */
void tl_fmu_call_timeout_poll(tl_fmu_call_timeout *patience);

#endif
