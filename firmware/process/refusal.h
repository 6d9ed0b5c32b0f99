/* System calls that a confined process was refused, and what an FMU was refused.
 *
 * Thread:  as each part says.
 */
#ifndef TL_FIRMWARE_PROCESS_REFUSAL_H
#define TL_FIRMWARE_PROCESS_REFUSAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/fmu_call.h"

/* ---- What a confined process was refused, for the process that keeps watch on it.
 *
 * Purpose: vendors' FMUs ask for a licence by a socket, start a tool, change a file's mode. Each such call waits until it is taken here and
 *          answered, with EPERM, always. In between the caller stands still, so that what it was about can be looked up.
 * Cost:    a refused call waits for the next look: take all that wait, often, and answer each at once.
 * Memory:  once prepared, none of the heap is asked for: a thread of the same process that forks holds its locks while it waits.
 * Thread:  any one.
 */

enum { TL_REFUSAL_NAME = 32 };

typedef struct tl_refusal {
    uint64_t id;                /* private: of what is to be answered */
    char name[TL_REFUSAL_NAME]; /* "socket"; "call 999" where nobody has a name for it */
} tl_refusal;

/* Takes one, which must be answered. False: none waits, or the process has ended. Never waits. `listener` is tl_confine()'s, or -1: never one. */
bool tl_refusal_take(int listener, tl_refusal *refusal);

/* Refuses it: the caller goes on. One that is gone meanwhile is no error. */
void tl_refusal_answer(int listener, const tl_refusal *refusal);

/* ---- What FMUs were refused, in words: each system call of each FMU once.
 *
 * Purpose: whoever answers refused calls (refusal.h) says which FMU asked for what, and in which function; an FMU that asks a thousand times
 *          is said once.
 * Bound:   TL_FMU_REFUSALS sentences; what comes then is answered, and not said.
 * Memory:  of its own (refusal.h).
 * Thread:  one at a time: who owns it has a lock, or is the only one.
 */

enum { TL_FMU_REFUSALS = 64, TL_FMU_REFUSAL_TEXT = 320 };

/* Told of what an FMU was refused. */
typedef void tl_fmu_refusals_listener(void *context, const char *text);

typedef struct tl_fmu_refused {
    char call[TL_REFUSAL_NAME];
    char fmu[TL_FMU_CALL_NAME];
    char said[TL_FMU_REFUSAL_TEXT];
} tl_fmu_refused;

/* Fields are private. A zeroed one is empty. */
typedef struct tl_fmu_refusals {
    tl_fmu_refused entries[TL_FMU_REFUSALS];
    size_t count;
} tl_fmu_refusals;

/* One that was taken and is not answered yet: who asked stands still, so `calls`, of the process with the FMUs, still say in which function it is.
 * True: it is new, and there is a sentence about it. */
bool tl_fmu_refusals_note(tl_fmu_refusals *refusals, const tl_refusal *refusal, const tl_fmu_calls *calls);

/* The next sentence that is not told yet: *told, 0 at first, counts them. NULL: there is none. It stays where it is. */
const char *tl_fmu_refusals_next(const tl_fmu_refusals *refusals, size_t *told);

#endif
