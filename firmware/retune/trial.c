/* The trial: see trial.h. */
#include "firmware/retune/trial.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "firmware/base/log.h"
#include "firmware/config/config.h"
#include "firmware/config/problems.h"
#include "firmware/plant/live_plant.h"
#include "firmware/retune/errand.h"
#include "firmware/retune/trial_answer.h"
#include "firmware/retune/twin_cost.h"
#include "firmware/twin/twin_child.h"

/* The plant's twin goes first, but waits for a trial of states. */
enum { NICE = 10 };

static const tl_time CALL_LIMIT = 60 * TL_SECOND;

typedef struct trial {
    tl_errand_job job;
    tl_config config;
    const tl_twin_role_tasks *tasks;
    bool of_states; /* only of what the FMUs save */
} trial;

static bool is_unconfined(const tl_errand_job *job, const tl_config *config) {
    bool unconfined = job->unconfined;
    for (size_t i = 0; i < config->component_count; i++) {
        unconfined = unconfined || config->components[i].unconfined;
    }
    return unconfined;
}

/* Errors: those of the check. *crashed: the process of the FMUs ended in it, or was killed because it hung; not if another process killed it. */
static tl_status check(const trial *self, FILE *page, bool *crashed, tl_error *error) {
    const tl_twin_job order = {
        .task = TL_TASK_CHECK,
        .path = self->job.path,
        .text = self->config.text,
        .cost = !self->of_states,
        .states_only = self->of_states,
        .reads_back = self->of_states,
        .unconfined = is_unconfined(&self->job, &self->config),
    };
    const tl_twin_child_settings settings = {
        .job = &order,
        .config = &self->config,
        .page = page,
        .print_page = self->tasks->print_page,
        .call_limit = CALL_LIMIT,
        .memory_limit = self->job.memory_limit,
    };
    tl_twin_child *child = NULL;
    uint32_t warnings = 0;
    tl_status status = tl_twin_child_start(&settings, &child, error);
    if (status == TL_OK) {
        status = tl_twin_child_check(child, &warnings, error);
    }
    if (child != NULL && status == TL_OK && !self->of_states) {
        status = tl_twin_child_wait(child, error);
    }
    *crashed = child != NULL && status == TL_FMU_FAILED && tl_twin_child_is_gone(child) &&
               !tl_twin_child_was_killed_by_others(child);
    tl_twin_child_close(child);
    return status;
}

/* ---- the answer ---- */

static uint64_t fmu_bytes(const tl_config *config) {
    uint64_t sum = 0;
    for (size_t i = 0; i < config->component_count; i++) {
        char path[PATH_MAX];
        struct stat about;
        if (tl_config_fmu_path(config, config->components[i].fmu, path, sizeof path) && stat(path, &about) == 0) {
            sum += (uint64_t)about.st_size;
        }
    }
    return sum;
}

/* Of the process of the FMUs, which has ended: as the kernel says. */
static uint64_t resident_bytes(void) {
    struct rusage usage = {.ru_maxrss = 0};
    (void)getrusage(RUSAGE_CHILDREN, &usage);
    return 1024 * (uint64_t)usage.ru_maxrss;
}

/* Its block is opened only now: no FMU has been near it. */
static tl_status answer(const tl_errand_job *job, const tl_config *config, char *page, tl_error *error) {
    tl_twin_cost cost = {.least = 0};
    void *block = NULL;
    if (!tl_twin_cost_take(page, &cost)) {
        return tl_fail(error, TL_FMU_FAILED, "the check does not say what the twin costs");
    }
    tl_status status = tl_errand_take_answer(sizeof(tl_trial_answer), &block, error);
    if (status == TL_OK) {
        tl_trial_answer *told = block;
        *told = (tl_trial_answer){
            .match = (uint32_t)config->match_count,
            .adjust = (uint32_t)config->adjust_count,
            .components = (uint32_t)config->component_count,
            .unconfined = is_unconfined(job, config) ? 1 : 0,
            .fmu_bytes = fmu_bytes(config),
            .signals = (uint32_t)config->signal_count,
            .memory = resident_bytes() + cost.memory,
            .step = config->step,
            .budget = config->budget_time,
            .least = cost.least,
            .worst = cost.worst,
        };
        __atomic_store_n(&told->is_there, 1, __ATOMIC_RELEASE);
    }
    return status;
}

/* The page's first line, or how the process of the FMUs ended. */
static tl_status answer_states(const char *page, const tl_error *end, bool crashed, tl_error *error) {
    void *block = NULL;
    tl_status status = tl_errand_take_answer(sizeof(tl_trial_states), &block, error);
    if (status == TL_OK) {
        tl_trial_states *told = block;
        if (crashed) { /* what is behind the semicolon is for who can change the limit */
            (void)snprintf(told->why, sizeof told->why, "the saved states could not be tried: %.*s",
                           (int)strcspn(end->text, ";"), end->text);
        } else {
            (void)snprintf(told->why, sizeof told->why, "%.*s", (int)strcspn(page, "\n"), page);
        }
        __atomic_store_n(&told->is_there, 1, __ATOMIC_RELEASE);
    }
    return status;
}

static tl_status try_it(const trial *self, tl_error *error) {
    char *text = NULL;
    size_t size = 0;
    bool crashed = false;
    FILE *page = open_memstream(&text, &size);
    if (page == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory");
    }
    tl_status status = check(self, page, &crashed, error);
    bool is_printed = fclose(page) == 0 && status == TL_OK;
    if (self->of_states && (is_printed || crashed)) {
        const tl_error end = *error;
        status = answer_states(text, &end, crashed, error);
    } else if (is_printed) {
        status = answer(&self->job, &self->config, text, error);
    }
    free(text);
    return status;
}

static int run(const tl_twin_role_tasks *tasks, bool of_states) {
    trial self = {.tasks = tasks, .of_states = of_states};
    tl_problems problems;
    tl_error error = {.text = ""};
    tl_status status = tl_errand_begin(&self.job, &error);
    if (status == TL_OK) {
        (void)setpriority(PRIO_PROCESS, 0, of_states ? 0 : NICE);
        tl_problems_init(&problems, "the candidate");
        status = tl_config_read_text(self.job.path, self.job.candidate, strlen(self.job.candidate), &self.config,
                                     &problems.report);
    }
    if (status == TL_OK) {
        status = tl_live_plant_check(&self.config, &error);
        tl_config_use_lookups(&self.config);
        status = status == TL_OK ? try_it(&self, &error) : status;
        tl_config_free(&self.config);
    }
    if (status != TL_OK && error.text[0] != '\0') {
        tl_log(TL_LOG_ERROR, "%s", error.text);
    }
    return tl_exit_code(status);
}

int tl_trial_role_run(const tl_twin_role_tasks *tasks) {
    return run(tasks, false);
}

int tl_trial_of_states_role_run(const tl_twin_role_tasks *tasks) {
    return run(tasks, true);
}
