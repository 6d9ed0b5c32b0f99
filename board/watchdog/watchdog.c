/* Hardware watchdog: see watchdog.h. */
#include "board/watchdog/watchdog.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/watchdog.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

static tl_status fail_open(const char *path, tl_error *error) {
    switch (errno) {
    case EBUSY:
        return tl_fail(
            error, TL_PLANT_DOWN,
            "watchdog %s: another program uses it: remove RuntimeWatchdogSec of systemd, or leave --watchdog out",
            path);
    case ENOENT:
        return tl_fail(error, TL_PLANT_DOWN, "watchdog %s: no such device: load its driver, or leave --watchdog out",
                       path);
    default:
        return tl_fail(error, TL_PLANT_DOWN, "watchdog %s: %s", path, strerror(errno));
    }
}

/* Reads its properties and sets its timeout. */
static tl_status set_up(const char *path, int timeout_s, tl_watchdog *watchdog, tl_error *error) {
    struct watchdog_info info = {0};
    int boot = 0;
    watchdog->timeout_s = timeout_s;
    if (ioctl(watchdog->file, WDIOC_GETSUPPORT, &info) != 0) {
        return tl_fail(error, TL_PLANT_DOWN, "watchdog %s: this device is not a watchdog (%s): correct --watchdog",
                       path, strerror(errno));
    }
    (void)snprintf(watchdog->name, sizeof watchdog->name, "%.32s", (const char *)info.identity);
    watchdog->can_be_disarmed = (info.options & WDIOF_MAGICCLOSE) != 0;
    if (ioctl(watchdog->file, WDIOC_SETTIMEOUT, &watchdog->timeout_s) != 0 ||
        ioctl(watchdog->file, WDIOC_GETTIMEOUT, &watchdog->timeout_s) != 0) {
        return tl_fail(error, TL_TRY_AGAIN,
                       "watchdog %s (%s): rejects a timeout of %d s (%s): change --watchdog-timeout", path,
                       watchdog->name, timeout_s, strerror(errno));
    }
    watchdog->has_reset_the_box =
        ioctl(watchdog->file, WDIOC_GETBOOTSTATUS, &boot) == 0 && (boot & WDIOF_CARDRESET) != 0;
    return TL_OK;
}

tl_status tl_watchdog_open(const char *path, int timeout_s, tl_watchdog *watchdog, tl_error *error) {
    struct stat about;
    *watchdog = (tl_watchdog){.file = -1};
    if (stat(path, &about) != 0) {
        return fail_open(path, error);
    }
    if (!S_ISCHR(about.st_mode)) {
        return tl_fail(error, TL_PLANT_DOWN, "watchdog %s: this is not a device: correct --watchdog", path);
    }
    watchdog->file = open(path, O_WRONLY | O_CLOEXEC);
    if (watchdog->file < 0) {
        return fail_open(path, error);
    }
    tl_status status = set_up(path, timeout_s, watchdog, error);
    if (status == TL_TRY_AGAIN) {
        (void)tl_watchdog_close(watchdog);
    } else if (status != TL_OK) { /* nothing is written to a device that is no watchdog */
        tl_watchdog_release(watchdog);
    }
    return status;
}

bool tl_watchdog_keepalive(const tl_watchdog *watchdog) {
    int dummy = 0;
    return ioctl(watchdog->file, WDIOC_KEEPALIVE, &dummy) == 0;
}

bool tl_watchdog_close(tl_watchdog *watchdog) {
    bool disarmed = write(watchdog->file, "V", 1) == 1 && watchdog->can_be_disarmed;
    (void)close(watchdog->file);
    watchdog->file = -1;
    return disarmed;
}

void tl_watchdog_release(tl_watchdog *watchdog) {
    if (watchdog->file >= 0) {
        (void)close(watchdog->file);
        watchdog->file = -1;
    }
}
