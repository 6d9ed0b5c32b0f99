/* What FMUs were refused, in words: each system call of each FMU once.
 *
 * Purpose: whoever answers refused calls (refusal.h) says which FMU asked for what, and in which function; an FMU that asks a thousand times
 *          is said once.
 * Bound:   TL_FMU_REFUSALS sentences; what comes then is answered, and not said.
 * Memory:  of its own (refusal.h).
 * Thread:  one at a time: who owns it has a lock, or is the only one.
 */
#ifndef TL_FIRMWARE_PROCESS_FMU_REFUSALS_H
#define TL_FIRMWARE_PROCESS_FMU_REFUSALS_H

#include <stdbool.h>
#include <stddef.h>

#include "firmware/process/fmu_call.h"
#include "firmware/process/refusal.h"

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
