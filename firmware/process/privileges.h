/* What a process may because of who started it: a user of its own, and no capability.
 *
 * Purpose: a process that was started as root has the rights of nobody in particular; none can be won back, nor by starting a program.
 * Thread:  the user changes for all threads, capabilities for the one that calls: best while there is no other.
 */
#ifndef TL_FIRMWARE_PROCESS_PRIVILEGES_H
#define TL_FIRMWARE_PROCESS_PRIVILEGES_H

#include <stdbool.h>
#include <stdint.h>

#include "master/base/status.h"

/* Whether this process could become another user. */
bool tl_privileges_may_change_user(void);

/* Becomes user and group `user` (> 0), without other groups and without any capability. PR_SET_PDEATHSIG, which the kernel forgets
 * then, is set again. TL_TRY_AGAIN: refused; TL_INTERRUPTED: the parent has ended meanwhile. */
tl_status tl_privileges_become(uint32_t user, tl_error *error);

/* No capability, whoever we are. TL_TRY_AGAIN: refused. */
tl_status tl_privileges_drop(tl_error *error);

#endif
