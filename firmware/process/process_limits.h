/* Limits of a process that holds FMUs.
 *
 * Thread: they hold for the whole process.
 */
#ifndef TL_FIRMWARE_PROCESS_PROCESS_LIMITS_H
#define TL_FIRMWARE_PROCESS_PROCESS_LIMITS_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/resource.h>

#include "master/base/status.h"

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
