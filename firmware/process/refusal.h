/* What a confined process was refused, for the process that keeps watch on it.
 *
 * Purpose: vendors' FMUs ask for a licence by a socket, start a tool, change a file's mode. Each such call waits until it is taken here and
 *          answered, with EPERM, always. In between the caller stands still, so that what it was about can be looked up.
 * Cost:    a refused call waits for the next look: take all that wait, often, and answer each at once.
 * Memory:  once prepared, none of the heap is asked for: a thread of the same process that forks holds its locks while it waits.
 * Thread:  any one.
 */
#ifndef TL_FIRMWARE_PROCESS_REFUSAL_H
#define TL_FIRMWARE_PROCESS_REFUSAL_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/types.h>

enum { TL_REFUSAL_NAME = 32, TL_REFUSAL_ARGUMENTS = 6 };

typedef struct tl_refusal {
    uint64_t id;                /* private: of what is to be answered */
    char name[TL_REFUSAL_NAME]; /* "socket"; "call 999" where nobody has a name for it */
    int number;                 /* on this machine */
    pid_t thread;               /* who called */
    uint64_t arguments
        [TL_REFUSAL_ARGUMENTS]; /* as they were passed: what they point at is the other process's, and may change */
} tl_refusal;

/* Takes one, which must be answered. False: none waits, or the process has ended. Never waits. `listener` is tl_confine()'s, or -1: never one. */
bool tl_refusal_take(int listener, tl_refusal *refusal);

/* Refuses it: the caller goes on. One that is gone meanwhile is no error. */
void tl_refusal_answer(int listener, const tl_refusal *refusal);

#endif
