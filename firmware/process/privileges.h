/* Privileges and limits of a process.
 *
 * Thread:  the main thread, before others start.
 */
#ifndef TL_FIRMWARE_PROCESS_PRIVILEGES_H
#define TL_FIRMWARE_PROCESS_PRIVILEGES_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/resource.h>

#include "master/base/status.h"

/* ---- What a process may because of who started it: a user of its own, and no capability.
 *
 * Purpose: a process that was started as root has the rights of nobody in particular; none can be won back, nor by starting a program.
 * Thread:  the user changes for all threads, capabilities for the one that calls: best while there is no other.
 */

/* Whether this process could become another user. */
bool tl_privileges_may_change_user(void);

/* Becomes user and group `user` (> 0), without other groups and without any capability. PR_SET_PDEATHSIG, which the kernel forgets
 * then, is set again. TL_TRY_AGAIN: refused; TL_INTERRUPTED: the parent has ended meanwhile. */
tl_status tl_privileges_become(uint32_t user, tl_error *error);

/* No capability, whoever we are. TL_TRY_AGAIN: refused. */
tl_status tl_privileges_drop(tl_error *error);

/* ---- Limits of a process that holds FMUs.
 *
 * Thread: they hold for the whole process.
 */

/* Whether memory can be limited: not with a sanitizer, whose own is larger. */
bool tl_process_limits_hold_memory(void);

/* More descriptors than are open now, and timers and signals under way, at most. */
enum { TL_PROCESS_LIMITS_DESCRIPTORS = 256, TL_PROCESS_LIMITS_SIGNALS = 256 };

/* Memory and the length of a file (bytes; 0: none), for good. Besides: descriptors, timers and signals as above, no message queue, no core, no
 * stack that grows without end, and nobody of the same user can look into the process. TL_TRY_AGAIN: the kernel refused. */
tl_status tl_process_limits_set(uint64_t memory, uint64_t file, tl_error *error);

/* At least so much of a resource (RLIMIT_…) from now on, also when capabilities are given up; as much of it as may be had, if that is less. */
void tl_process_limits_permit(int resource, rlim_t least);

#endif
