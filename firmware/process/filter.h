/* The list of system calls that a confined process may make, and its loading into the kernel.
 *
 * Purpose: what is not on the list is refused: EPERM, and told to a listener if there is one (refusal.h). The list has one line
 *          for a group and its reason; behind it are the calls of which the arguments decide.
 * Machine: that of this program; a call of another one (32-bit or x32 calls on x86-64, AArch32) ends the process.
 * Thread:  any.
 */
#ifndef TL_FIRMWARE_PROCESS_FILTER_H
#define TL_FIRMWARE_PROCESS_FILTER_H

#include <stdbool.h>

#include "board/io/plant_access.h"
#include "master/base/status.h"

typedef struct tl_filter_settings {
    int start_socket;             /* sendmsg() on this descriptor only; -1: on none */
    bool whole_process;           /* all threads; else the one that calls */
    const tl_plant_access *plant; /* what a driver of a plant needs besides; NULL: none */
    bool names;                   /* looks up names of hosts: UDP to any address, TCP to port 53 */
    bool keeps_files;             /* what a recorder needs besides */
    bool may_answer;              /* what a server needs besides */
    bool lives_on;                /* reaching for another process is refused, and not the end of this one */
    bool removal_holds;    /* Landlock keeps files elsewhere from being removed; else nothing is removed or renamed */
    bool truncation_holds; /* Landlock keeps files from being emptied (ABI 3); else calls that could are refused */
} tl_filter_settings;

/* Whether the kernel has filters; whether it can tell of refused calls. */
bool tl_filter_is_offered(void);
bool tl_filter_can_notify(void);

/* Loads. `listener` may be NULL: nobody is to be told; else a descriptor, or -1 where the kernel cannot, or where somebody else is told
 * already. TL_TRY_AGAIN: it could not be loaded. */
tl_status tl_filter_load(const tl_filter_settings *settings, int *listener, tl_error *error);

#endif
