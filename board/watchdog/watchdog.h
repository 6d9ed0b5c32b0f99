/* Hardware watchdog by the kernel's driver: /dev/watchdog.
 *
 * Purpose: the watchdog resets the computer (the *box*) if it gets no keepalive within its timeout.
 *          It stays armed if the process that opened it dies.
 * Closing: the magic close ('V') disarms it, unless the kernel is configured never to disarm it
 *          (nowayout). The driver does not report that setting.
 * Thread:  one thread.
 * Source:  Linux, Documentation/watchdog/watchdog-api.
 */
#ifndef TL_BOARD_WATCHDOG_WATCHDOG_H
#define TL_BOARD_WATCHDOG_WATCHDOG_H

#include <stdbool.h>

#include "master/base/status.h"

typedef struct tl_watchdog {
    int file;               /* descriptor; private; -1: not open */
    char name[33];          /* as reported by the driver: "Software Watchdog" */
    int timeout_s;          /* s, as read back: a driver may change the requested one */
    bool has_reset_the_box; /* the watchdog ended the previous boot, as far as the driver knows */
    bool can_be_disarmed;   /* the driver supports the magic close */
} tl_watchdog;

/* Opens the watchdog and arms it. `timeout_s` > 0; the driver may round it. Errors: TL_PLANT_DOWN
 * if the device is absent, no watchdog, or in use by another program: then nothing is armed.
 * TL_TRY_AGAIN if the driver rejects the timeout: then the watchdog is disarmed if it can be. */
tl_status tl_watchdog_open(const char *path, int timeout_s, tl_watchdog *watchdog, tl_error *error);

/* Sends a keepalive. Returns false if the driver rejects it. */
bool tl_watchdog_keepalive(const tl_watchdog *watchdog);

/* Disarms and closes the watchdog. Returns false if the driver cannot disarm it: then it will reset
 * the box. With nowayout it returns true, but the watchdog stays armed. */
bool tl_watchdog_close(tl_watchdog *watchdog);

/* Call it in a child process: closes the inherited descriptor without disarming. The parent keeps
 * the watchdog. */
void tl_watchdog_release(tl_watchdog *watchdog);

#endif
