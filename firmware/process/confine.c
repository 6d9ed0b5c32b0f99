/* Confinement, in its order: see confine.h. */
#include "firmware/process/confine.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "firmware/process/privileges.h"

/* ---- what there is ---- */

void tl_confine_probe(tl_confine_facts *facts) {
    *facts = (tl_confine_facts){
        .filter = tl_filter_is_offered(),
        .notifies = tl_filter_can_notify(),
        .landlock = tl_landlock_version(),
        .memory = tl_process_limits_hold_memory(),
        .user = tl_privileges_may_change_user(),
    };
}

uint64_t tl_confine_fair_memory(void) {
    long pages = sysconf(_SC_PHYS_PAGES);
    long size = sysconf(_SC_PAGESIZE);
    const uint64_t most = (uint64_t)TL_CONFINE_MEMORY_MIB * 1024 * 1024;
    uint64_t half = pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size / 2 : 0;
    return half < most ? half : most;
}

/* ---- confine ---- */

/* Devices, and files of another user, may be open to capabilities only. */
static tl_status give_up_privileges(const tl_confine_settings *settings, tl_error *error) {
    if (settings->user != 0) {
        return tl_privileges_become(settings->user, error);
    }
    return settings->plant != NULL || settings->keeps_files ? TL_OK : tl_privileges_drop(error);
}

static tl_status restrict_calls(const tl_confine_settings *settings, tl_confine_facts *facts, int *listener,
                                tl_error *error) {
    const bool filters = tl_filter_is_offered(); /* afterwards asking is refused */
    tl_status status = filters ? tl_filter_load(settings, listener, error) : TL_OK;
    if (status == TL_OK) {
        *facts = (tl_confine_facts){.filter = filters,
                                    .notifies = listener != NULL && *listener >= 0,
                                    .landlock = settings->landlock,
                                    .memory = settings->memory != 0 && tl_process_limits_hold_memory(),
                                    .user = settings->user != 0};
    }
    return status;
}

tl_status tl_confine(const tl_confine_settings *settings, tl_confine_facts *facts, int *listener, tl_error *error) {
    tl_confine_settings own = *settings;
    own.landlock = settings->landlock_newest < 0 ? 0 : tl_landlock_version();
    own.landlock = settings->landlock_newest > 0 && settings->landlock_newest < own.landlock ? settings->landlock_newest
                                                                                             : own.landlock;
    *facts = (tl_confine_facts){0};
    if (listener != NULL) {
        *listener = -1;
    }
    if (own.folder != NULL && (chdir(own.folder) != 0 || setenv("TMPDIR", own.folder, 1) != 0)) {
        return tl_fail(error, TL_BAD_USAGE, "%.300s: cannot be entered: %s", own.folder, strerror(errno));
    }
    tl_status status = give_up_privileges(&own, error);
    status = status != TL_OK ? status : tl_process_limits_set(own.memory, own.file_bytes, error);
    if (status == TL_OK && prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0) {
        status = tl_fail(error, TL_TRY_AGAIN, "setuid programs could not be given up: %s", strerror(errno));
    }
    status = status == TL_OK && own.landlock > 0 ? tl_landlock_restrict(&own, error) : status;
    return status == TL_OK ? restrict_calls(&own, facts, listener, error) : status;
}

/* ---- describe ---- */

void tl_confine_describe(const tl_confine_facts *facts, char text[TL_CONFINE_TEXT]) {
    const char *const sentences[] = {
        facts->landlock > 0 ? ""
        : facts->user       ? "FMUs can read and write what every user may: this kernel has no Landlock"
                            : "FMUs can read and write files of this user, and so take over its other processes "
                              "(/proc/PID/mem): this kernel has no Landlock",
        facts->filter
            ? ""
            : "FMUs can open sockets, start programs and signal processes of this user: this kernel has no seccomp",
        facts->filter && !facts->notifies
            ? "what FMUs are refused is not told: this kernel's seccomp has no notifications"
            : "",
        facts->memory ? "" : "the memory of FMUs has no limit",
    };
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < sizeof sentences / sizeof sentences[0]; i++) {
        if (sentences[i][0] != '\0' && used < TL_CONFINE_TEXT) {
            int length = snprintf(text + used, TL_CONFINE_TEXT - used, "%s%s", used > 0 ? "; " : "", sentences[i]);
            used += length > 0 ? (size_t)length : 0;
        }
    }
}
