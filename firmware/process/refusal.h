/* Refused system calls of a confined process, and the FMUs that made them.
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
 * Purpose: some vendors' FMUs open a socket for a licence, start a tool or change a file's mode.
 *          The kernel blocks the thread that makes such a call, until this module receives the call
 *          and answers it, always with EPERM. Meanwhile the monitor can find out which FMU made it.
 * Cost:    a refused call waits for the next poll. Poll often, receive all waiting calls, and
 *          answer each at once.
 * Memory:  no heap is used after the first received call. A forking thread of this process may wait
 *          for an answer while it holds the locks of the heap.
 * Thread:  any, one at a time.
 */

enum { TL_REFUSAL_NAME = 32 };

typedef struct tl_refusal {
    uint64_t id;                /* private: identifies the call to answer */
    char name[TL_REFUSAL_NAME]; /* for example "socket"; "call 999" if its name is unknown */
} tl_refusal;

/* Receives one refused call without blocking; the caller must answer it. Returns false if no call
 * waits or the process has ended. `listener`: descriptor from tl_confine(); -1: returns false. */
bool tl_refusal_take(int listener, tl_refusal *refusal);

/* Answers the call with EPERM, so that its thread continues. Has no effect if the process has
 * ended. */
void tl_refusal_answer(int listener, const tl_refusal *refusal);

/* ---- Messages about refused calls: one for each pair of FMU and system call.
 *
 * Purpose: the process that answers refused calls reports which FMU made which call, in which
 *          function of the FMU. Repeated calls are reported once.
 * Bound:   TL_FMU_REFUSALS messages; further calls are answered but not reported.
 * Memory:  only the struct, which the caller owns.
 * Thread:  one at a time; the owner locks it if necessary.
 */

enum { TL_FMU_REFUSALS = 64, TL_FMU_REFUSAL_TEXT = 320 };

/* Callback that receives a message about a refused call of an FMU. */
typedef void tl_fmu_refusals_listener(void *context, const char *text);

typedef struct tl_fmu_refused {
    char call[TL_REFUSAL_NAME];
    char fmu[TL_FMU_CALL_NAME];
    bool is_in_call; /* of a function of the FMU; not while its library was loaded, or in another thread */
    uint32_t begun;  /* number of the last such call */
    char said[TL_FMU_REFUSAL_TEXT];
} tl_fmu_refused;

/* Fields are private. Zeroed: empty. */
typedef struct tl_fmu_refusals {
    tl_fmu_refused entries[TL_FMU_REFUSALS];
    size_t count;
} tl_fmu_refusals;

/* Notes a refused call. Call it before tl_refusal_answer(): the thread is still blocked, so `calls`
 * of its process contain the current function. Returns true if there is a new message. */
bool tl_fmu_refusals_note(tl_fmu_refusals *refusals, const tl_refusal *refusal, const tl_fmu_calls *calls);

/* Returns the next message that was not yet reported, or NULL. *reported_count counts
 * the reported messages; the caller sets it to 0 at first. The text is valid as long as `refusals`.
 */
const char *tl_fmu_refusals_next(const tl_fmu_refusals *refusals, size_t *reported_count);

/* Returns true if the failure of the process may have been caused by a refused call: it was refused
 * in the FMI call that failed, or in none. Call it after the process has ended. */
bool tl_fmu_refusals_may_be_cause(const tl_fmu_refusals *refusals, const tl_fmu_calls *calls);

#endif
