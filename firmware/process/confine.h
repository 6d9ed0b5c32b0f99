/* A process that holds FMUs gives up what FMUs have no business with.
 *
 * Purpose: after tl_confine() the process computes, starts threads, reads what programs are made of, and writes below one folder. It
 *          starts no program, opens no socket, signals, traces and reads no other process, and changes no file elsewhere, whatever an
 *          FMU in it does. There is no way back.
 * Means:   a list of the system calls that are allowed (filter.h), Landlock for the places of files (landlock.h), limits (privileges.h), a
 *          process that others of the same user cannot look into, and, for root, a user of its own (privileges.h).
 * Missing: what the kernel does not offer is a fact, told by tl_confine_describe(), never a failure. So the program goes on in an
 *          emulator, in a container and on an old kernel.
 * Left open, since no kernel holds it: names, sizes and dates of files can be seen anywhere (Landlock knows reading, not looking); time on
 *          the processor; what the listed folders hold; a file that was removed but is still open counts nowhere but at its limit, and where
 *          the disk gets full (bounds.h).
 * Others:  a process without FMUs gives up all it does not need, too. With `plant` it can open again what that driver of a plant needs, and
 *          no socket or device of another kind. TCP connects to `ports` only, from Linux 6.7 on. With keeps_files a recorder can remove and rename below the folders
 *          that it writes, and give files the mode of others. Neither can listen, start programs or reach a local socket. With may_answer a server that listens
 *          already can accept, and reach local sockets, and nobody else.
 * Thread:  from the thread that will load FMUs, best while there is no other: Landlock and capabilities hold for the thread that calls and
 *          those that it starts. With whole_process the list of system calls, the limits and the user hold for all threads.
 * Before:  what needs more than the above, as PR_SET_PDEATHSIG, setsid(), opening a device, has been done. PR_SET_PDEATHSIG is kept, which the
 *          kernel forgets when the user changes.
 */
#ifndef TL_FIRMWARE_PROCESS_CONFINE_H
#define TL_FIRMWARE_PROCESS_CONFINE_H

#include <stdbool.h>
#include <stdint.h>

#include "firmware/process/confine_settings.h"
#include "master/base/status.h"

enum { TL_CONFINE_TEXT = 768, TL_CONFINE_MEMORY_MIB = 4096 };

/* What holds, or what the kernel offers. */
typedef struct tl_confine_facts {
    bool filter;   /* of system calls */
    bool notifies; /* refused calls can be named (refusal.h) */
    int landlock;  /* its version ("ABI"); 0: none */
    bool memory;   /* there is a limit to it */
    bool user;     /* a user of its own: files of other users are out of reach without Landlock too */
} tl_confine_facts;

/* What this kernel offers, without confining. `user`: whether this process could change its user. */
void tl_confine_probe(tl_confine_facts *facts);

/* Bytes that a process with FMUs may take by default: half of the machine's memory, at most TL_CONFINE_MEMORY_MIB. 0: unknown. */
uint64_t tl_confine_fair_memory(void);

/* Confines. `listener` may be NULL: then refused calls answer EPERM and nobody is told. Else it is a descriptor for tl_refusal_take() of
 * another process, or -1; a refused call waits until somebody answers, so it must be handed over and closed here at once.
 * TL_BAD_USAGE: the folder cannot be entered. TL_TRY_AGAIN: something that the kernel offers failed; the process is half confined, and must
 * end. TL_INTERRUPTED: whoever was to be told of our end by PR_SET_PDEATHSIG has ended. */
tl_status tl_confine(const tl_confine_settings *settings, tl_confine_facts *facts, int *listener, tl_error *error);

/* Only what root gives up: `user` as in the settings. For a process without FMUs that keeps watch on those of that user. The same errors. */
tl_status tl_confine_user(uint32_t user, tl_error *error);

/* A sentence of what is not held, for people; "" where all is. */
void tl_confine_describe(const tl_confine_facts *facts, char text[TL_CONFINE_TEXT]);

#endif
