/* The service manager is systemd: see service.h. */
#include <stdlib.h>

#include <systemd/sd-daemon.h>

#include "firmware/service.h"

void tl_service_tell(const char *state) {
    (void)sd_notify(0, state);
}

tl_time tl_service_patience(void) {
    uint64_t microseconds = 0;
    return sd_watchdog_enabled(0, &microseconds) > 0 ? (tl_time)microseconds * 1000 : 0;
}

void tl_service_leave(void) {
    (void)unsetenv("NOTIFY_SOCKET");
    (void)unsetenv("WATCHDOG_USEC");
    (void)unsetenv("WATCHDOG_PID");
}
