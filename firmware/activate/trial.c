/* The trial: see trial.h. */
#include "firmware/activate/trial.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "firmware/activate/errand.h"
#include "firmware/base/log.h"
#include "firmware/config/config.h"
#include "firmware/config/problems.h"
#include "firmware/plant/live_plant.h"
#include "firmware/twin/twin_child.h"

/* The plant's twin goes first. */
enum { NICE = 10 };

static const tl_time CALL_LIMIT = 60 * TL_SECOND;

static bool is_unconfined(const tl_errand_job *job, const tl_config *config) {
    bool unconfined = job->unconfined;
    for (size_t i = 0; i < config->component_count; i++) {
        unconfined = unconfined || config->components[i].unconfined;
    }
    return unconfined;
}

/* What a check tells of the cost, as lines of the level of information (log.h). */
static void print_cost(char *page) {
    static const char begin[] = "cost\n";
    char *line = strstr(page, begin);
    char *rest = line == NULL ? NULL : line + sizeof begin - 1;
    while (rest != NULL && strncmp(rest, "  ", 2) == 0) {
        char *end = strchr(rest, '\n');
        if (end != NULL) {
            *end++ = '\0';
        }
        (void)printf("<%d>%s\n", TL_LOG_INFO, rest + 2);
        rest = end;
    }
    (void)fflush(stdout);
}

static tl_status check(const tl_errand_job *job, tl_config *config, FILE *page, const tl_twin_role_tasks *tasks,
                       tl_error *error) {
    tl_config_use_lookups(config);
    const tl_twin_job order = {
        .task = TL_TASK_CHECK,
        .path = job->path,
        .text = config->text,
        .unconfined = is_unconfined(job, config),
    };
    const tl_twin_child_settings settings = {
        .job = &order,
        .config = config,
        .page = page,
        .print_page = tasks->print_page,
        .call_limit = CALL_LIMIT,
        .memory_limit = job->memory_limit,
    };
    tl_twin_child *child = NULL;
    tl_status status = tl_twin_child_start(&settings, &child, error);
    if (status == TL_OK) {
        status = tl_twin_child_check(child, error);
    }
    if (child != NULL && status == TL_OK) {
        status = tl_twin_child_wait(child, error);
    }
    tl_twin_child_close(child);
    return status;
}

static tl_status try_it(const tl_errand_job *job, tl_config *config, const tl_twin_role_tasks *tasks, tl_error *error) {
    char *text = NULL;
    size_t size = 0;
    FILE *page = open_memstream(&text, &size);
    if (page == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    tl_status status = check(job, config, page, tasks, error);
    if (fclose(page) == 0 && status == TL_OK) {
        print_cost(text);
    }
    free(text);
    return status;
}

int tl_trial_role_run(const tl_twin_role_tasks *tasks) {
    tl_errand_job job;
    tl_config config;
    tl_problems problems;
    tl_error error = {.text = ""};
    tl_status status = tl_errand_begin(&job, &error);
    if (status == TL_OK) {
        (void)setpriority(PRIO_PROCESS, 0, NICE);
        tl_problems_init(&problems, "the candidate");
        status = tl_config_read_text(job.path, job.candidate, strlen(job.candidate), &config, &problems.report);
    }
    if (status == TL_OK) {
        status = tl_live_plant_check(&config, &error);
        status = status == TL_OK ? try_it(&job, &config, tasks, &error) : status;
        tl_config_free(&config);
    }
    if (status != TL_OK && error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}
