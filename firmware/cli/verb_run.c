/* twinlock run: the process tree that keeps a twin locked to the live plant. */

#include <stdio.h>
#include <stdlib.h>

#include "firmware/base/log.h"
#include "firmware/cli/roles.h"
#include "firmware/cli/verb_job.h"
#include "firmware/live/process_tree.h"
#include "firmware/process/role.h"
#include "firmware/retune/version_start.h"

/* Runs the role in a forked process that cannot execute the program again. */
static int run_role(const char *title, void *context) {
    (void)context;
    return tl_roles_run(title);
}

/* Reads the configuration file; with --control, the active version of it. */
static tl_status read_config(const tl_options *options, const tl_version_start *start, tl_config *config,
                             char running[TL_VERSION_RUNNING]) {
    tl_problems problems;
    tl_error error;
    char *text = NULL;
    size_t size = 0;
    tl_problems_init(&problems, options->subject);
    if (options->control == NULL) {
        tl_status status = tl_config_read(options->subject, config, &problems.report);
        if (status == TL_OK) {
            (void)snprintf(running, TL_VERSION_RUNNING, "configuration %.12s runs: %.100s", config->hash,
                           options->subject);
        }
        return status;
    }
    tl_status status = tl_version_start_choose(start, &text, &size, running, &error);
    if (status != TL_OK) {
        *config = (tl_config){.path = NULL};
        tl_log(TL_LOG_ERROR, "%s", error.text);
        return status;
    }
    status = tl_config_read_text(options->subject, text, size, config, &problems.report);
    free(text);
    return status;
}

static int run(const tl_options *options, const tl_config *config, const char *running, tl_process_tree_end *end) {
    const tl_process_tree_settings settings = {
        .config = config,
        .running = running,
        .database = options->database,
        .duration = tl_time_of_seconds(options->duration_s),
        .verbose = options->verbose,
        .json = options->json,
        .status = options->status,
        .follow = options->follow,
        .unconfined = options->unconfined || tl_config_is_unconfined(config),
        .memory_limit = options->memory_limit_mib * 1024 * 1024,
        .require_lock = options->require_lock,
        .supervised = options->supervise,
        .call_limit = tl_time_of_seconds(options->call_limit_s),
        .state = options->state,
        .control = options->control,
        .allowed = options->allowed != NULL ? options->allowed : "/etc/twinlock/allowed",
        .watchdog = options->watchdog,
        .watchdog_s = (int)options->watchdog_s,
        .tasks = &tl_roles_twin_tasks,
        .run_role = run_role,
    };
    return tl_process_tree_run(&settings, end);
}

int tl_verb_run(const tl_options *options) {
    const tl_version_start start = {.state = options->state, .path = options->subject, .run_role = run_role};
    tl_config config;
    char running[TL_VERSION_RUNNING] = "";
    tl_error error;
    tl_status status = read_config(options, &start, &config, running);
    if (status == TL_OK && tl_config_check_filled_in(&config, &error) != TL_OK) {
        tl_log(TL_LOG_ERROR, "%s", error.text);
        status = error.status;
    }
    tl_process_tree_end end = {.is_failure = status != TL_OK};
    int code = status == TL_OK ? run(options, &config, running, &end) : tl_exit_code(status);
    tl_config_free(&config);
    if (options->control != NULL && end.is_failure &&
        (code == tl_exit_code(TL_BAD_DATA) || code == tl_exit_code(TL_FMU_FAILED))) {
        end.again = tl_version_start_failed(&start, "its run ended with an error");
    }
    if (end.again) {
        tl_log(TL_LOG_NOTICE, "the run restarts");
        tl_role_restart();
        tl_log(TL_LOG_ERROR, "the run could not restart: start it again");
        return tl_exit_code(TL_TRY_AGAIN);
    }
    return code;
}
