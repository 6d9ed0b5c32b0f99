/* Roles of processes: see roles.h. */
#include "firmware/cli/roles.h"

#include <stdio.h>
#include <string.h>

#include "firmware/cli/check_page.h"
#include "firmware/live/live_role.h"
#include "firmware/retune/worker.h"
#include "firmware/twin/twin_child.h"

const tl_twin_role_tasks tl_roles_twin_tasks = {.print_page = tl_check_page_print, .live = tl_live_twin};

/* Compared as prefixes. A title that begins with another title must precede it. */
static const struct {
    const char *title;
    int (*run)(void); /* NULL: the role calls FMUs and has run_tasks */
    int (*run_tasks)(const tl_twin_role_tasks *tasks);
} ROLES[] = {
    {"twin", NULL, tl_twin_role_run},
    {TL_TWIN_READER, NULL, tl_twin_role_run},
    {TL_LIVE_IO, tl_io_role_run, NULL},
    {TL_LIVE_RECORDER, tl_recorder_role_run, NULL},
    {TL_LIVE_CONFIG_MANAGER, tl_config_manager_role_run, NULL},
    {TL_LIVE_EXPLAINER, tl_explainer_role_run, NULL},
    {TL_WORKER, NULL, tl_worker_role_run},
};

int tl_roles_run(const char *title) {
    for (size_t i = 0; i < sizeof ROLES / sizeof ROLES[0]; i++) {
        if (strncmp(title, ROLES[i].title, strlen(ROLES[i].title)) == 0) {
            return ROLES[i].run != NULL ? ROLES[i].run() : ROLES[i].run_tasks(&tl_roles_twin_tasks);
        }
    }
    (void)fprintf(stderr, "twinlock: unknown role \"%s\"\n", title);
    return tl_exit_code(TL_BAD_USAGE);
}
