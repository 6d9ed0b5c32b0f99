/* twinlock run: the tree of processes that keep a twin locked to the live plant. */

#include <string.h>

#include "firmware/live/tree.h"
#include "firmware/verbs/command_line.h"
#include "firmware/verbs/verb_job.h"
#include "firmware/verbs/verbs.h"

/* What main() does in a process of the run that cannot be executed anew. */
static int be(const char *title, void *context) {
    (void)context;
    return tl_command_line_be(title);
}

int tl_verb_run(const tl_options *options) {
    tl_config config;
    tl_problems problems;
    tl_problems_init(&problems, options->subject);
    tl_status status = tl_config_read(options->subject, &config, &problems.report);
    if (status != TL_OK) {
        tl_config_free(&config);
        return tl_exit_code(status);
    }
    const tl_tree_settings settings = {
        .config = &config,
        .database = options->database,
        .duration = tl_time_of_seconds(options->duration_s),
        .json = options->json,
        .status = options->status,
        .unconfined = tl_verb_is_unconfined(options, &config),
        .memory_limit = options->memory_limit_mib * 1024 * 1024,
        .require_lock = options->require_lock,
        .supervised = options->supervise,
        .state = options->state,
        .watchdog = options->watchdog,
        .watchdog_s = (int)options->watchdog_s,
        .tasks = &tl_verb_twin_tasks,
        .be = be,
    };
    int code = tl_tree_run(&settings);
    tl_config_free(&config);
    return code;
}
