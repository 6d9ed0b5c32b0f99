/* Refused system calls of a confined process (confine.h), and the FMUs that made them. Messages for
 * users call them "denied".
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
 *          and answers it, always with EPERM. Meanwhile the monitor can find out which FMU made the
 *          call.
 * Cost:    the calling thread waits until the next poll. Poll often; in each poll, receive every
 *          waiting call and answer it immediately.
 * Memory:  no heap is used after the first received call. fork() in another thread of the monitor
 *          may hold the lock of the heap while it waits for the confined process. That process
 *          waits for the answer, so an answer that needs the heap would deadlock.
 * Thread:  any, one at a time.
 */

enum { TL_REFUSAL_NAME = 32 }; /* bytes of a system call's name with its terminating 0 */

typedef struct tl_refusal {
    uint64_t id;                /* private: identifies the call to answer */
    char name[TL_REFUSAL_NAME]; /* for example "socket"; "call 999" if its name is unknown */
} tl_refusal;

/* Receives one refused call without blocking; the caller must answer it. Returns false if no call
 * waits or the process has ended. `listener`: notification descriptor from tl_confine(); -1:
 * returns false. */
bool tl_refusal_take(int listener, tl_refusal *refusal);

/* Answers the call with EPERM, so that its thread continues. Has no effect if the process has
 * ended. */
void tl_refusal_answer(int listener, const tl_refusal *refusal);

/* ---- Messages about refused calls: one for each pair of FMU and system call.
 *
 * Purpose: the process that answers refused calls reports which FMU made which system call, in
 *          which FMI function. Repeated calls are reported once.
 * Bound:   TL_FMU_REFUSALS (64) messages. Refused calls of further pairs are not reported.
 * Memory:  only the struct, which the caller owns.
 * Thread:  one at a time; the owner locks it if necessary.
 */

enum { TL_FMU_REFUSALS = 64, TL_FMU_REFUSAL_TEXT = 320 }; /* messages; bytes of a message */

/* Callback that receives a message about a refused call of an FMU (used by twin_process.h). */
typedef void tl_fmu_refusals_listener(void *context, const char *text);

typedef struct tl_fmu_refused {
    char call[TL_REFUSAL_NAME];
    char fmu[TL_FMU_CALL_NAME];
    bool is_in_call; /* true: made during an FMI function; false: while the library was loaded, or outside of calls */
    uint32_t begun;  /* number of the FMI call (fmu_call.h) in which the system call was last refused */
    char message[TL_FMU_REFUSAL_TEXT];
} tl_fmu_refused;

/* Fields are private. Zeroed: empty. */
typedef struct tl_fmu_refusals {
    tl_fmu_refused entries[TL_FMU_REFUSALS];
    size_t count;
} tl_fmu_refusals;

/* Notes a refused call. Use it before tl_refusal_answer(): the calling thread is still blocked, so
 * `calls` (of its process, fmu_call.h) shows which FMI function is running. Returns true if there
 * is a new message. */
bool tl_fmu_refusals_note(tl_fmu_refusals *refusals, const tl_refusal *refusal, const tl_fmu_calls *calls);

/* Returns the next message that was not yet reported, or NULL. *reported_count counts the reported
 * messages; the caller sets it to 0 at first. The text is valid as long as `refusals`. */
const char *tl_fmu_refusals_next(const tl_fmu_refusals *refusals, size_t *reported_count);

/* Returns true if a system call was refused in the FMI call that failed, or outside of any FMI
 * call. Then the refusal may have caused the failure. Call it after the process has ended. */
bool tl_fmu_refusals_may_be_cause(const tl_fmu_refusals *refusals, const tl_fmu_calls *calls);

#endif
