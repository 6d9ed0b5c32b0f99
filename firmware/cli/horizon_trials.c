/* Horizon trials: see horizon_trials.h. */
#include "firmware/cli/horizon_trials.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/base/output.h"
#include "firmware/config/json_document.h"
#include "firmware/process/interrupt.h"

/* Further trials: T_P = T_D, the configured T_P, and one with the other value of "free_twin". */
static const uint32_t HORIZONS[] = {2, 5, 10, 20, 50, 100, 200, 500, 1000};

/* One trial. */
typedef struct trial_run {
    const tl_horizon_trials_settings *settings;
    char *text; /* its configuration; owned */
    tl_config config;
    tl_recording *recording;
    tl_twin_child *child;
    tl_twin_job job;
    tl_twin_feed *feed;
    tl_account account;
} trial_run;

/* ---- the configuration of a trial ---- */

static cJSON *find_object(cJSON *parent, const char *key) {
    cJSON *object = cJSON_GetObjectItemCaseSensitive(parent, key);
    return object != NULL ? object : cJSON_AddObjectToObject(parent, key);
}

static bool set_value(cJSON *object, const char *key, cJSON *value) {
    cJSON_DeleteItemFromObjectCaseSensitive(object, key);
    return cJSON_AddItemToObject(object, key, value) != 0;
}

/* The configuration with the proposed settings and those of the trial. Returns NULL if memory is
 * out; the caller frees the text. */
static char *make_text(const tl_horizon_trials_settings *settings, const tl_horizon_choice *choice,
                       const tl_horizon_trial *trial) {
    const tl_config *config = settings->child->config;
    double step_s = tl_seconds(config->step);
    cJSON *root = cJSON_Duplicate(config->tree, 1);
    cJSON *patch = cJSON_Parse(settings->patch);
    char *text = NULL;
    if (root != NULL && patch != NULL && tl_json_merge(root, patch)) {
        cJSON *synchronise = find_object(root, "synchronise");
        cJSON *horizon = find_object(synchronise, "horizon");
        cJSON_DeleteItemFromObjectCaseSensitive(horizon, "prediction");
        bool is_made =
            trial->prediction == 0 || set_value(horizon, "prediction", cJSON_CreateNumber((double)trial->prediction));
        is_made = is_made && set_value(synchronise, "free_twin", cJSON_CreateBool(trial->rests));
        is_made = is_made && set_value(synchronise, "rest", cJSON_CreateBool(0)); /* the horizon itself is judged */
        is_made =
            is_made && set_value(synchronise, "release_s", cJSON_CreateNumber((double)choice->released_steps * step_s));
        is_made = is_made && set_value(root, "duration_s", cJSON_CreateNumber(tl_seconds(choice->length)));
        text = is_made ? cJSON_PrintUnformatted(root) : NULL;
    }
    cJSON_Delete(root);
    cJSON_Delete(patch);
    return text;
}

static tl_status open_recording(trial_run *self, tl_error *error) {
    self->config.recording_run = self->settings->run;
    tl_status status = tl_recording_open(self->settings->recording, &self->config, &self->recording, error);
    if (status == TL_OK) {
        const tl_recording_beginning *beginning = tl_recording_get_beginning(self->recording);
        self->job.time = tl_recording_get_time(self->recording);
        self->job.time.length = self->config.duration;
        self->job.tick = beginning != NULL ? beginning->tick : 0;
        if (beginning != NULL && beginning->follows) {
            status =
                tl_fail(error, TL_BAD_DATA,
                        "run %" PRId64 " resumes run %" PRId64 ": choose a run that starts with the FMUs' start values",
                        beginning->run, beginning->resumption.run);
        }
    }
    return status;
}

/* Parses the configuration of the trial, opens the recording and starts the FMU process. */
static tl_status start(trial_run *self, tl_error *error) {
    const tl_twin_child_settings *child = self->settings->child;
    tl_problems problems;
    tl_problems_init(&problems, child->job->path);
    tl_status status =
        tl_config_read_text(child->job->path, self->text, strlen(self->text), &self->config, &problems.report);
    if (status != TL_OK) {
        return tl_fail(error, status, "the proposed configuration has problems: see above");
    }
    tl_config_use_lookups(&self->config);
    self->job = *child->job;
    self->job.task = TL_TASK_STEP;
    self->job.attached = TL_ATTACHED_NONE;
    self->job.reads_back = false;
    self->job.text = self->config.text;
    status = open_recording(self, error);
    tl_twin_child_settings own = *child;
    own.job = &self->job;
    own.config = &self->config;
    own.page = NULL;
    status = status == TL_OK ? tl_twin_child_start(&own, &self->child, error) : status;
    status = status == TL_OK ? tl_twin_child_build(self->child, &self->account, error) : status;
    if (status == TL_OK) {
        tl_config_use_bounds(&self->config, &self->account);
        tl_recording_use_limits(self->recording);
    } else if (error->text[0] == '\0') {
        (void)tl_fail(error, status, "the FMUs cannot be used: see above");
    }
    return status;
}

/* ---- the replay ---- */

static void add_error(tl_horizon_trial *trial, const tl_config *config, const tl_record *record) {
    bool is_measured = false;
    for (size_t i = 0; i < config->match_count; i++) {
        const tl_plan_match *match = &config->match[i];
        if (match->weight > 0.0 && record->measured_quality[i] == TL_GOOD) {
            double error = (record->y[i] - record->measured[i]) / match->tolerance;
            trial->squares += match->weight * fmin(error * error, TL_RELEASED_MOST);
            is_measured = true;
        }
    }
    trial->compared += is_measured ? 1 : 0;
}

static void add_record(tl_horizon_trial *trial, const tl_config *config, const tl_record *record) {
    bool is_corrected = false;
    for (size_t v = 0; v < config->adjust_count; v++) {
        is_corrected = is_corrected || record->u[v] < record->nominal[v] || record->u[v] > record->nominal[v];
    }
    trial->steps++;
    trial->corrected += is_corrected ? 1 : 0;
    trial->evaluations += record->evaluations;
    add_error(trial, config, record);
}

static tl_status replay(trial_run *self, tl_horizon_trial *trial, const char *what, tl_error *error) {
    tl_progress progress;
    bool end = false;
    tl_status status = TL_OK;
    tl_time started = tl_clock_now(NULL);
    tl_progress_begin(&progress, what, tl_twin_feed_last_tick(&self->config, &self->account));
    while (status == TL_OK && !end) {
        tl_twin_fed fed = {0};
        status = tl_twin_feed_next(self->feed, &fed, &end, error);
        if (status == TL_OK && !end && fed.result->ready != 0) {
            add_record(trial, &self->config, &fed.result->record);
        }
        if (status == TL_OK && !end) {
            tl_progress_update(&progress, fed.tick->sample.tick);
        }
        if (tl_interrupt_requested() != NULL) {
            status = tl_fail(error, TL_INTERRUPTED, "interrupted by %s", tl_interrupt_requested());
        }
    }
    tl_progress_end(&progress);
    trial->time = trial->steps != 0 ? (tl_clock_now(NULL) - started) / (tl_time)trial->steps : 0;
    return status;
}

static tl_status run_child(trial_run *self, tl_horizon_trial *trial, tl_error *error) {
    char what[64];
    tl_status status = start(self, error);
    if (status == TL_OK) {
        const tl_twin_feed_settings feed = {
            .config = &self->config, .account = &self->account, .recording = self->recording, .child = self->child};
        (void)snprintf(what, sizeof what, "replay with prediction %" PRIu32, self->account.prediction);
        trial->prediction = self->account.prediction;
        status = tl_twin_feed_open(&feed, &self->feed, error);
    }
    status = status == TL_OK ? replay(self, trial, what, error) : status;
    return status == TL_OK ? tl_twin_child_end(self->child, &self->account, error) : status;
}

/* Errors: TL_INTERRUPTED, TL_TRY_AGAIN. Others are a fault of the trial. */
static tl_status run_trial(const tl_horizon_trials_settings *settings, tl_horizon_choice *choice,
                           tl_horizon_trial *trial, tl_error *error) {
    trial_run self = {.settings = settings, .text = make_text(settings, choice, trial)};
    tl_status status = self.text != NULL
                           ? run_child(&self, trial, error)
                           : tl_fail(error, TL_TRY_AGAIN, "not enough memory for a configuration with another horizon");
    if (status == TL_OK && self.account.released_state != TL_RELEASED_ON) {
        status = tl_fail(error, TL_BAD_DATA, "no released twins: %s",
                         tl_released_state_text((tl_released_state)self.account.released_state));
    }
    trial->released = self.account.released;
    tl_twin_feed_close(self.feed);
    tl_twin_child_close(self.child);
    tl_recording_close(self.recording);
    tl_config_free(&self.config);
    free(self.text);
    if (status != TL_OK && status != TL_INTERRUPTED && status != TL_TRY_AGAIN) {
        (void)snprintf(trial->fault, sizeof trial->fault, "%s", error->text);
        status = TL_OK;
    }
    return status;
}

/* ---- the trials ---- */

/* The next horizon in the list, or the configured one if it comes before; 0: none. */
static uint32_t find_next(uint32_t last, uint32_t configured) {
    uint32_t next = last < configured ? configured : 0;
    for (size_t i = sizeof HORIZONS / sizeof HORIZONS[0]; i-- > 0;) {
        next = HORIZONS[i] > last && (next == 0 || HORIZONS[i] < next) ? HORIZONS[i] : next;
    }
    return next;
}

/* Why the next horizon is not tried; "": it is. */
static void find_end(tl_horizon_choice *choice, uint32_t next, tl_time budget, tl_time step) {
    const tl_horizon_trial *last = &choice->trial[choice->count - 1];
    int64_t steps = choice->length / step;
    if (last->fault[0] != '\0') {
        (void)snprintf(choice->note, sizeof choice->note, "%s", last->fault);
    } else if (last->time > budget) {
        (void)snprintf(choice->note, sizeof choice->note,
                       "longer horizons were not tried: a step takes longer than the time budget of %.3g s",
                       tl_seconds(budget));
    } else if (last->time * (tl_time)last->steps > TL_HORIZON_LONGEST) {
        (void)snprintf(choice->note, sizeof choice->note, "longer horizons were not tried: the last replay took %.0f s",
                       tl_seconds(last->time * (tl_time)last->steps));
    } else if ((int64_t)next * TL_HORIZON_PARTS > steps) {
        (void)snprintf(choice->note, sizeof choice->note,
                       "longer horizons were not tried: they need a recording of more than %" PRId64 " steps", steps);
    }
}

/* Replays so much of the recording, also after the configured duration; R is an eighth of it. */
static tl_status measure_recording(const tl_horizon_trials_settings *settings, tl_horizon_choice *choice,
                                   tl_error *error) {
    tl_config config = *settings->child->config;
    tl_recording *recording = NULL;
    config.recording_run = settings->run;
    tl_status status = tl_recording_open(settings->recording, &config, &recording, error);
    if (status == TL_OK) {
        int64_t steps = tl_recording_ticks(recording);
        steps = steps < TL_HORIZON_STEPS ? steps : TL_HORIZON_STEPS;
        choice->length = tl_time_of_step(0, config.step, steps);
        choice->released_steps = (uint32_t)(steps / 16 * 2);
    }
    tl_recording_close(recording);
    return status;
}

static tl_status try_horizons(const tl_horizon_trials_settings *settings, tl_horizon_choice *choice, tl_time budget,
                              tl_error *error) {
    const tl_config *config = settings->child->config;
    tl_status status = TL_OK;
    uint32_t next = 0; /* first T_P = T_D */
    do {
        tl_horizon_trial *trial = &choice->trial[choice->count++];
        *trial = (tl_horizon_trial){.prediction = next, .rests = config->free_twin};
        status = run_trial(settings, choice, trial, error);
        next = find_next(trial->prediction, config->prediction);
        find_end(choice, next, budget, config->step);
    } while (status == TL_OK && next != 0 && choice->note[0] == '\0' && choice->count < TL_HORIZON_TRIALS - 1);
    return status;
}

static bool is_possible(const tl_config *config, tl_horizon_choice *choice) {
    const char *why = !config->synchronise || config->adjust_count == 0 ? "nothing is adjusted"
                      : config->event.start.signal != NULL              ? "not with an event horizon"
                                                                        : "";
    (void)snprintf(choice->note, sizeof choice->note, "%s", why);
    return why[0] == '\0';
}

tl_status tl_horizon_trials_run(const tl_horizon_trials_settings *settings, tl_horizon_choice *choice,
                                tl_error *error) {
    const tl_config *config = settings->child->config;
    tl_time budget = config->budget_time != 0 ? config->budget_time : config->step;
    *choice = (tl_horizon_choice){.chosen = SIZE_MAX};
    if (!is_possible(config, choice)) {
        return TL_OK;
    }
    tl_status status = measure_recording(settings, choice, error);
    if (status == TL_OK && choice->released_steps < TL_HORIZON_PARTS) {
        (void)snprintf(choice->note, sizeof choice->note, "the recording is too short");
        return TL_OK;
    }
    status = status == TL_OK ? try_horizons(settings, choice, budget, error) : status;
    if (status == TL_OK) {
        tl_horizon_choose(choice, config->step, budget);
    }
    if (status == TL_OK && choice->chosen != SIZE_MAX) {
        tl_horizon_trial *trial = &choice->trial[choice->count++];
        *trial =
            (tl_horizon_trial){.prediction = choice->trial[choice->chosen].prediction, .rests = !config->free_twin};
        status = run_trial(settings, choice, trial, error);
        tl_horizon_choose(choice, config->step, budget);
    }
    return status;
}
