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

#include "firmware/process/confine_settings.h"
#include "master/base/status.h"

/* Whether the kernel has filters; whether it can tell of refused calls. */
bool tl_filter_is_offered(void);
bool tl_filter_can_notify(void);

/* Loads. `listener` may be NULL: nobody is to be told; else a descriptor, or -1 where the kernel cannot, or where somebody else is told
 * already. TL_TRY_AGAIN: it could not be loaded. */
tl_status tl_filter_load(const tl_confine_settings *settings, int *listener, tl_error *error);

#endif
