/* A hardware watchdog by the kernel's driver: /dev/watchdog.
 *
 * Purpose: it resets the box unless it is stroked in time. Whoever opens it has to stroke it; it stays armed where that
 *          process dies, which is what it is for.
 * Closing: with the magic close ('V') the driver disarms it; not where the kernel was told never to (nowayout), which the driver
 *          does not say.
 * Thread:  one thread.
 * Source:  Linux, Documentation/watchdog/watchdog-api.
 */
#ifndef TL_BOARD_WATCHDOG_WATCHDOG_H
#define TL_BOARD_WATCHDOG_WATCHDOG_H

#include <stdbool.h>

#include "master/base/status.h"

typedef struct tl_watchdog {
    int file;               /* private; -1: not open */
    char name[33];          /* as the driver calls itself, "Software Watchdog" */
    int timeout_s;          /* in force, as read back: a driver takes what it can */
    bool has_reset_the_box; /* the boot before this one ended by it, as far as the driver knows */
    bool can_be_disarmed;
} tl_watchdog;

/* Arms it. `timeout_s` > 0 is asked for. Errors (nothing is armed then): TL_PLANT_DOWN where it is absent, no watchdog, or
 * another program's; TL_TRY_AGAIN where the kernel refuses. */
tl_status tl_watchdog_open(const char *path, int timeout_s, tl_watchdog *watchdog, tl_error *error);

/* False where the driver refused. */
bool tl_watchdog_keepalive(const tl_watchdog *watchdog);

/* Disarms and closes it. False where it could not be disarmed: it will reset the box. */
bool tl_watchdog_close(tl_watchdog *watchdog);

/* In a child process: leaves it to the parent. */
void tl_watchdog_leave(tl_watchdog *watchdog);

#endif
