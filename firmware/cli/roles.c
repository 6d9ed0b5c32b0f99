/* The roles of processes: see roles.h. */
#include "firmware/cli/roles.h"

#include <stdio.h>
#include <string.h>

#include "firmware/cli/check_page.h"
#include "firmware/live/live_role.h"
#include "firmware/live/live_twin.h"
#include "firmware/retune/worker.h"
#include "firmware/twin/twin_child.h"

const tl_twin_role_tasks tl_roles_twin_tasks = {.print_page = tl_check_page_print, .live = tl_live_twin};

static bool begins_with(const char *title, const char *role) {
    return strncmp(title, role, strlen(role)) == 0;
}

int tl_roles_run(const char *title) {
    if (begins_with(title, "twin") || begins_with(title, TL_TWIN_READER)) {
        return tl_twin_role_run(&tl_roles_twin_tasks);
    }
    if (begins_with(title, TL_LIVE_IO)) {
        return tl_io_role_run();
    }
    if (begins_with(title, TL_LIVE_RECORDER)) {
        return tl_recorder_role_run();
    }
    if (begins_with(title, TL_LIVE_ACTIVATOR)) {
        return tl_activator_role_run();
    }
    if (begins_with(title, TL_WORKER)) {
        return tl_worker_role_run(&tl_roles_twin_tasks);
    }
    (void)fprintf(stderr, "twinlock: there is no role \"%s\"\n", title);
    return tl_exit_code(TL_BAD_USAGE);
}
