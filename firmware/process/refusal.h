/* Refused system calls of a confined process, and which FMU made them.
 *
 * Thread:  see each section.
 */
#ifndef TL_FIRMWARE_PROCESS_REFUSAL_H
#define TL_FIRMWARE_PROCESS_REFUSAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "firmware/process/fmu_call.h"

/* ---- Refused system calls, for the process that monitors a confined one.
 *
 * Purpose: vendors' FMUs open a socket for a licence, start a tool or change a file's mode. Such a
 *          call waits until it is received here and answered, always with EPERM. The caller is
 *          blocked meanwhile, so that the monitor can determine its cause.
 * Cost:    a refused call waits for the next poll: poll often, receive all that wait, and answer
 *          each at once.
 * Memory:  after the first call no heap is used, because a forking thread of this process holds the
 *          heap's locks while its call waits.
 * Thread:  any, one at a time.
 */

enum { TL_REFUSAL_NAME = 32 };

typedef struct tl_refusal {
    uint64_t id;                /* private: identifies the call to answer */
    char name[TL_REFUSAL_NAME]; /* for example "socket"; "call 999" if its name is unknown */
} tl_refusal;

/* Receives one refused call, which the caller must answer. Does not block. Returns false if none
 * waits or the process has ended. `listener`: from tl_confine(); -1: always returns false. */
bool tl_refusal_take(int listener, tl_refusal *refusal);

/* Answers with EPERM, so that the calling thread continues. It is no error if the process has
 * ended. */
void tl_refusal_answer(int listener, const tl_refusal *refusal);

/* ---- Messages about refused calls: one for each system call of each FMU.
 *
 * Purpose: the process that answers refused calls reports which FMU made which call, in which
 *          function. Repeated calls are reported once.
 * Bound:   TL_FMU_REFUSALS messages; further calls are answered but not reported.
 * Memory:  none but the struct.
 * Thread:  one at a time; the owner locks it if necessary.
 */

enum { TL_FMU_REFUSALS = 64, TL_FMU_REFUSAL_TEXT = 320 };

/* Receives a message about a refused call of an FMU. */
typedef void tl_fmu_refusals_listener(void *context, const char *text);

typedef struct tl_fmu_refused {
    char call[TL_REFUSAL_NAME];
    char fmu[TL_FMU_CALL_NAME];
    char said[TL_FMU_REFUSAL_TEXT];
} tl_fmu_refused;

/* Fields are private. Zeroed: empty. */
typedef struct tl_fmu_refusals {
    tl_fmu_refused entries[TL_FMU_REFUSALS];
    size_t count;
} tl_fmu_refusals;

/* Notes a refused call that was received but not yet answered. The caller of it is still blocked,
 * so `calls` of the FMU process names the current function. Returns true if it is new and has a
 * message. */
bool tl_fmu_refusals_note(tl_fmu_refusals *refusals, const tl_refusal *refusal, const tl_fmu_calls *calls);

/* Returns the next message that was not yet reported, or NULL. *told counts reported messages; 0 at
 * first. The text stays valid as long as `refusals`. */
const char *tl_fmu_refusals_next(const tl_fmu_refusals *refusals, size_t *was_reported);

#endif
