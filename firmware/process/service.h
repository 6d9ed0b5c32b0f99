/* Service manager: notifies systemd, or another service manager with the same protocol
 * (sd_notify(3)). Without a service manager, all functions do nothing.
 *
 * Purpose: reports that the start is complete, that the program is alive, its status, and that it
 *          ends.
 * Thread:  one thread of the process that the service manager started.
 */
#ifndef TL_FIRMWARE_PROCESS_SERVICE_H
#define TL_FIRMWARE_PROCESS_SERVICE_H

#include <stdbool.h>

#include "master/base/simtime.h"

/* Sends lines of sd_notify(3): "READY=1", "WATCHDOG=1", "STATUS=…", "STOPPING=1". Does not block.
 * Returns false if no socket could be opened, or if the socket is full because the service manager
 * has not read earlier lines. A real-time process may keep the service manager from running, so
 * never wait for it. Without a service manager, returns true. */
bool tl_service_notify(const char *state);

/* Returns the unit's WatchdogSec, ns: the longest time between two "WATCHDOG=1"; 0: no watchdog. */
tl_time tl_service_watchdog_period(void);

#endif
