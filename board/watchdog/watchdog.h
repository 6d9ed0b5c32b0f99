/* Hardware watchdog by the kernel's driver: /dev/watchdog.
 *
 * Purpose: resets the box unless it gets a keepalive in time. It stays armed if the process that
 *          opened it dies; that is its purpose.
 * Closing: the magic close ('V') disarms it, unless the kernel is configured never to disarm it
 *          (nowayout), which the driver does not report.
 * Thread:  one thread.
 * Source:  Linux, Documentation/watchdog/watchdog-api.
 */
#ifndef TL_BOARD_WATCHDOG_WATCHDOG_H
#define TL_BOARD_WATCHDOG_WATCHDOG_H

#include <stdbool.h>

#include "master/base/status.h"

typedef struct tl_watchdog {
    int file;               /* private; -1: not open */
    char name[33];          /* as reported by the driver: "Software Watchdog" */
    int timeout_s;          /* as read back: a driver may change the requested one */
    bool has_reset_the_box; /* the watchdog ended the previous boot, as far as the driver knows */
    bool can_be_disarmed;
} tl_watchdog;

/* Opens and arms it with `timeout_s` > 0. Errors, with nothing armed: TL_PLANT_DOWN if it is
 * absent, no watchdog, or in use by another program; TL_TRY_AGAIN if the kernel rejects it. */
tl_status tl_watchdog_open(const char *path, int timeout_s, tl_watchdog *watchdog, tl_error *error);

/* Sends a keepalive. Returns false if the driver rejects it. */
bool tl_watchdog_keepalive(const tl_watchdog *watchdog);

/* Disarms and closes it. Returns false if it could not be disarmed: then it will reset the box. */
bool tl_watchdog_close(tl_watchdog *watchdog);

/* In a child process: closes the descriptor and leaves the watchdog to the parent. */
void tl_watchdog_release(tl_watchdog *watchdog);

#endif
