/* The service manager that started us: systemd, or one that speaks its protocol (sd_notify(3)). If there is none, all of this does nothing.
 *
 * Purpose: tells it that the start is over, that we are alive, how we are, that we end.
 * Thread:  one thread, of the process that it started.
 */
#ifndef TL_FIRMWARE_PROCESS_SERVICE_H
#define TL_FIRMWARE_PROCESS_SERVICE_H

#include <stdbool.h>

#include "master/base/simtime.h"

/* Lines of sd_notify(3): "READY=1", "WATCHDOG=1", "STATUS=…", "STOPPING=1". Does not wait: false where the service manager has not
 * heard the last ones yet, which it does not where it has no turn, and whoever must not wait for it is perhaps the one to give it one. */
bool tl_service_notify(const char *state);

/* WatchdogSec: at least so often it wants to hear "WATCHDOG=1" (ns); 0: never. */
tl_time tl_service_extend_timeout(void);

#endif
