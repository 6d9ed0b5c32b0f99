/* The trial of a changed configuration: its FMUs run in a process of their own, which answers with a verdict: see trial.h. */
#include "firmware/retune/trial.h"

#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "firmware/base/log.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/config/config_change.h"
#include "firmware/config/problems.h"
#include "firmware/plant/live_plant.h"
#include "firmware/retune/errand.h"
#include "firmware/store/run_types.h"
#include "firmware/twin/twin_child.h"
#include "master/base/signal.h"

/* ---- twin cost ---- */

/* No line of a page begins so. */
static const char BEGIN[] = "\ntwin-cost ";

void tl_twin_cost_print(const tl_twin_cost *cost, FILE *page) {
    (void)fprintf(page, "%s%" PRId64 " %" PRId64 " %" PRIu64 "\n", BEGIN + 1, cost->least, cost->worst, cost->memory);
}

/* A number from 0 on; moves on behind it. */
static bool read_number(const char **at, int64_t *number) {
    char *end = NULL;
    errno = 0;
    *number = strtoll(*at, &end, 10);
    bool is = end != *at && errno == 0 && *number >= 0;
    *at = end;
    return is;
}

/* The newest one counts: an FMU could print one before. */
static char *find_last(char *page) {
    char *found = NULL;
    for (char *at = strstr(page, BEGIN); at != NULL; at = strstr(at + 1, BEGIN)) {
        found = at;
    }
    return found;
}

bool tl_twin_cost_take(char *page, tl_twin_cost *cost) {
    char *line = find_last(page);
    int64_t memory = 0;
    if (line == NULL) {
        return false;
    }
    const char *at = line + strlen(BEGIN);
    bool is = read_number(&at, &cost->least) && read_number(&at, &cost->worst) && read_number(&at, &memory) &&
              strcmp(at, "\n") == 0;
    cost->memory = (uint64_t)memory;
    line[1] = '\0';
    return is;
}

/* ---- verdict ---- */

/* Ends it, and takes out what could command a terminal. `room` is at most TL_CONTROL_TEXT. */
static void clean(char *text, size_t room) {
    char copy[TL_CONTROL_TEXT];
    size_t length = strnlen(text, room - 1);
    memcpy(copy, text, length);
    (void)tl_clean_text(copy, length, text, room);
}

static void clean_problem(tl_control_problem *problem) {
    clean(problem->path, sizeof problem->path);
    clean(problem->text, sizeof problem->text);
}

static void clean_change(tl_control_change *change) {
    clean(change->path, sizeof change->path);
    clean(change->before, sizeof change->before);
    clean(change->after, sizeof change->after);
    clean(change->kind, sizeof change->kind);
    clean(change->right, sizeof change->right);
}

bool tl_verdict_take(const tl_verdict *from, tl_verdict *verdict) {
    uint32_t is_there = __atomic_load_n(&from->is_there, __ATOMIC_ACQUIRE);
    memcpy(verdict, from, sizeof *verdict);
    if (is_there != 1 || verdict->is_valid > 1 || verdict->kind >= TL_CHANGE_KINDS || verdict->right >= TL_RIGHTS ||
        !tl_lock_yardstick_is_sound(&verdict->yardstick) || verdict->window < 0 ||
        verdict->window > TL_VERDICT_LONGEST) {
        return false;
    }
    clean(verdict->name, sizeof verdict->name);
    clean(verdict->widened, sizeof verdict->widened);
    for (size_t i = 0; i < TL_VERDICT_PROBLEMS; i++) {
        clean_problem(&verdict->problem[i]);
    }
    for (size_t i = 0; i < TL_VERDICT_CHANGES; i++) {
        clean_change(&verdict->change[i]);
    }
    return verdict->is_valid == 0 ||
           (verdict->right >= TL_RIGHT_RETUNE && tl_tuning_check(&verdict->tuning, NULL) == TL_OK);
}

/* ---- trial answer ---- */

/* Texts are shown to people. The longest that is copied here is `why`. */
static void clean_answer(const char *from, char *text, size_t size) {
    char copy[TL_TRIAL_WHY];
    size_t length = strnlen(from, size - 1);
    memcpy(copy, from, length);
    (void)tl_clean_text(copy, length, text, size);
}

/* No box has as much. */
static const uint64_t BYTES = (uint64_t)1 << 50;

static bool has_room(const tl_trial_answer *answer) {
    return answer->match <= TL_MAX_MATCH && answer->adjust <= TL_MAX_ADJUST &&
           answer->components < TL_RECORDER_COMPONENTS && answer->unconfined <= 1 && answer->signals >= 1 &&
           answer->signals <= TL_MAX_SIGNALS && answer->fmu_bytes <= BYTES && answer->memory <= BYTES;
}

bool tl_trial_answer_take(const tl_trial_answer *from, tl_trial_answer *answer) {
    uint32_t is_there = __atomic_load_n(&from->is_there, __ATOMIC_ACQUIRE);
    memcpy(answer, from, sizeof *answer);
    return is_there == 1 && has_room(answer) && answer->step > 0 && answer->budget >= 0 && answer->least >= 0 &&
           answer->worst >= 0;
}

bool tl_trial_states_take(const tl_trial_states *from, char why[TL_TRIAL_WHY]) {
    bool is_there = __atomic_load_n(&from->is_there, __ATOMIC_ACQUIRE) == 1;
    clean_answer(from->why, why, TL_TRIAL_WHY);
    return is_there;
}

/* ---- trial ---- */

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
