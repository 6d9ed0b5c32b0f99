/* Live host: see live_host.h. */
#include "firmware/live/live_host.h"

#include <stdio.h>
#include <string.h>

#include "firmware/base/identity.h"
#include "firmware/base/text.h"
#include "firmware/config/config.h"
#include "firmware/twin/twin_recorder.h"

/* ---- slots ---- */

/* Returns the slot of the live twin. */
static uint32_t live_slot(const tl_live_host *self) {
    uint32_t slot = __atomic_load_n(&self->handover_block->slot_index, __ATOMIC_ACQUIRE);
    return slot < TL_TWIN_SLOTS ? slot : 0;
}

static const tl_live_twin_status *twin_of_run(const tl_live_host *self) {
    return self->twins[live_slot(self)];
}

static tl_live_tuning *tuning_of_run(const tl_live_host *self) {
    return self->tunings[live_slot(self)];
}

/* ---- status ---- */

static void check_lock(tl_lock_tally *lock) {
    lock->state = lock->state <= TL_LOCK_LOST ? lock->state : TL_LOCK_FREE;
}

/* Copies the published status of a twin, validates it, and adds facts from its status block. */
static void read_status(const tl_live_twin_status *twin, tl_run_status *status) {
    int code = 0;
    *status = (tl_run_status){.phase = TL_RUN_BEGINS};
    (void)tl_latest_read(&twin->figures, status, sizeof *status);
    check_lock(&status->lock);
    check_lock(&status->lock_before);
    status->used = status->used > 0 ? status->used : 0;
    status->outputs = status->outputs < TL_MAX_MATCH ? status->outputs : TL_MAX_MATCH;
    status->pairs = status->outputs == 0 ? status->steps : 0;
    for (size_t i = 0; i < status->outputs; i++) {
        tl_run_output *output = &status->output[i];
        tl_clean_field(output->name, sizeof output->name);
        tl_clean_field(output->unit, sizeof output->unit);
        status->pairs += output->pairs;
    }
    status->corrections = status->corrections < TL_MAX_ADJUST ? status->corrections : TL_MAX_ADJUST;
    for (size_t i = 0; i < status->corrections; i++) {
        tl_clean_field(status->correction[i].name, sizeof status->correction[i].name);
    }
    status->failure[0] = '\0';
    status->twin_failures = twin->number > twin->first ? twin->number - twin->first : 0;
    status->twin_alive = twin->holds == 0 && tl_heartbeats_is_ready(&twin->beats) &&
                         tl_heartbeats_get_end_cause(&twin->beats, &code) == TL_END_CAUSE_NONE;
}

static void read_view(void *context, tl_activation_view *view) {
    const tl_live_host *self = context;
    const tl_live_twin_status *twin = twin_of_run(self);
    char reason[TL_HANDOVER_WHY] = "";
    memset(view, 0, sizeof *view);
    view->step_s = tl_seconds(self->step);
    view->holds = twin->holds != 0;
    view->waits = twin->holds == TL_LIVE_WAITS;
    read_status(twin, &view->figures);
    /* The reason is written before the number of the next process, which counts the failures. */
    (void)tl_latest_read(&self->handover_block->failure, reason, sizeof reason);
    (void)tl_clean_text(reason, strnlen(reason, sizeof reason), view->figures.failure, TL_RUN_FAILURE);
    (void)tl_heartbeats_get_status(&twin->beats, view->line);
    view->line[sizeof view->line - 1] = '\0';
}

/* Gets the hash of the tuning in use in a slot; without a tuning, that of its configuration. */
static void find_active_hash(const tl_live_host *self, uint32_t slot, char hash[TL_SHA256_TEXT]) {
    tl_live_tuning_head head;
    bool has_tuning = tl_live_tuning_read(self->tunings[slot], &head, NULL) == TL_OK;
    memcpy(hash, has_tuning ? head.hash : self->hash[slot], TL_SHA256_TEXT);
}

static void copy_active_hash(void *context, char hash[TL_SHA256_TEXT]) {
    const tl_live_host *self = context;
    find_active_hash(self, live_slot(self), hash);
}

static bool copy_text(char *text, size_t *size, const char *from, size_t length) {
    if (length > TL_CONFIG_MAX_BYTES) {
        return false;
    }
    memcpy(text, from, length);
    text[length] = '\0';
    *size = length;
    return true;
}

/* Searches the newest tunings, the configuration of the run, and the candidate of the shadow. */
static bool running_text(void *context, const char *hash, char *text, size_t *size) {
    const tl_live_host *self = context;
    tl_live_tuning_head head;
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
        if (tl_live_tuning_read_text(self->tunings[i], &head, text, NULL) == TL_OK && strcmp(head.hash, hash) == 0) {
            *size = head.size;
            return true;
        }
    }
    if (strcmp(self->text_hash, hash) == 0) {
        return copy_text(text, size, self->text, strlen(self->text));
    }
    return strcmp(self->candidate->hash, hash) == 0 &&
           copy_text(text, size, self->candidate->text, self->candidate->size);
}

/* ---- the FMUs' files ---- */

/* This text is in use, so it was validated before. */
static bool has_other_fmus(void *context, const char *text, size_t size) {
    const tl_live_host *self = context;
    char now[TL_SHA256_TEXT];
    char loaded[TL_SHA256_TEXT];
    tl_config config;
    tl_problems problems;
    memcpy(loaded, twin_of_run(self)->digest, sizeof loaded);
    tl_problems_init(&problems, self->path);
    if (loaded[0] == '\0' || !tl_identity_is_sound(loaded) ||
        tl_config_read_text(self->path, text, size, &config, &problems.report) != TL_OK) {
        return false;
    }
    tl_twin_recorder_identify(&config, now);
    tl_config_free(&config);
    return now[0] != '\0' && strcmp(now, loaded) != 0;
}

/* ---- tunings ---- */

/* The recorder must have saved a tuning's text before the next tuning overwrites it, unless
 * recording fails now or the twin has rejected the tuning. */
static bool is_recorded(const tl_live_host *self) {
    uint32_t number = tl_live_tuning_number(tuning_of_run(self));
    tl_live_tuning_answer answer;
    bool is_refused = tl_live_tuning_answered(&twin_of_run(self)->tuned, number, &answer) && answer.refused != 0;
    if (self->recorder == NULL || number == 0 || number % 2 != 0 || is_refused) {
        return true;
    }
    tl_recorder_state_counts counts = tl_recorder_state_get(&self->recorder->state);
    return counts.tuning >= number || counts.refused_since != 0;
}

/* Returns the newest tuning number of both slots and of the recorder, so that new numbers are
 * unique. */
static uint32_t newest_tuning(const tl_live_host *self) {
    uint32_t newest = self->recorder != NULL ? tl_recorder_state_get(&self->recorder->state).tuning : 0;
    for (size_t i = 0; i < TL_TWIN_SLOTS; i++) {
        uint32_t number = tl_live_tuning_number(self->tunings[i]);
        newest = number > newest ? number : newest;
    }
    return newest;
}

static void set_tolerances(void *context, const tl_lock_tolerances *tolerances) {
    tl_latest_publish(&tuning_of_run(context)->tolerances, tolerances, sizeof *tolerances);
}

static bool write_tuning(void *context, const tl_version *version, const char *why, const char *text,
                         const tl_tuning *tuning) {
    tl_live_host *self = context;
    tl_live_tuning_head head = {.size = (uint32_t)version->size, .tuning = *tuning};
    if (!is_recorded(self)) {
        return false;
    }
    (void)snprintf(head.hash, sizeof head.hash, "%s", version->hash);
    (void)snprintf(head.who, sizeof head.who, "%s", version->who);
    (void)snprintf(head.origin, sizeof head.origin, "%s", tl_change_origins[version->origin]);
    (void)snprintf(head.why, sizeof head.why, "%s", why);
    tl_live_tuning_skip(tuning_of_run(self), newest_tuning(self));
    self->given = tl_live_tuning_write(tuning_of_run(self), &head, text);
    return true;
}

static tl_activation_answer poll_tuning(void *context, char why[TL_ACTIVATION_WHY]) {
    const tl_live_host *self = context;
    tl_live_tuning_answer answer;
    if (!tl_live_tuning_answered(&twin_of_run(self)->tuned, self->given, &answer)) {
        return TL_ACTIVATION_WAITS;
    }
    (void)snprintf(why, TL_ACTIVATION_WHY, "%.*s", TL_ACTIVATION_WHY - 1, answer.why);
    return answer.refused != 0 ? TL_ACTIVATION_REFUSED : TL_ACTIVATION_STARTED;
}

/* ---- shadow and handover ---- */

static bool is_order_done(const tl_live_host *self) {
    return __atomic_load_n(&self->handover_block->order, __ATOMIC_ACQUIRE) == self->live_status->order.number;
}

static void write_order(tl_live_host *self, tl_live_verb verb) {
    self->wants_none = false;
    self->live_status->order.verb = (uint32_t)verb;
    __atomic_store_n(&self->live_status->order.number, self->live_status->order.number + 1, __ATOMIC_RELEASE);
}

static bool order_shadow(void *context, const tl_activation_candidate *candidate) {
    tl_live_host *self = context;
    uint32_t slot = 1 - live_slot(self);
    if (!is_order_done(self)) {
        return false;
    }
    self->candidate->size = (uint32_t)candidate->size;
    memcpy(self->candidate->text, candidate->text, candidate->size + 1);
    (void)snprintf(self->candidate->hash, sizeof self->candidate->hash, "%s", candidate->hash);
    (void)snprintf(self->hash[slot], sizeof self->hash[slot], "%s", candidate->hash);
    tl_live_tuning_skip(self->tunings[slot], newest_tuning(self)); /* skip the old ones */
    tl_latest_publish(&self->tunings[slot]->tolerances, candidate->tolerances, sizeof *candidate->tolerances);
    self->live_status->order.needs = candidate->needs;
    write_order(self, TL_LIVE_SHADOW);
    return true;
}

static void end_shadow(void *context) {
    tl_live_host *self = context;
    self->wants_none = true;
    if (is_order_done(self)) {
        write_order(self, TL_LIVE_NO_SHADOW);
    }
}

static bool order_handover(void *context) {
    tl_live_host *self = context;
    if (!is_order_done(self)) {
        return false;
    }
    self->live_status->handovers = self->handover_block->handovers;
    write_order(self, TL_LIVE_HAND_OVER);
    return true;
}

/* Works also for a handover that an earlier config manager has ordered. */
static tl_activation_answer poll_handover(void *context, char why[TL_ACTIVATION_WHY]) {
    const tl_live_host *self = context;
    const tl_handover *block = self->handover_block;
    if (!is_order_done(self)) {
        return TL_ACTIVATION_WAITS;
    }
    if (__atomic_load_n(&block->handovers, __ATOMIC_ACQUIRE) == self->live_status->handovers) {
        (void)snprintf(why, TL_ACTIVATION_WHY, "%.*s", TL_HANDOVER_WHY - 1, block->why);
        return TL_ACTIVATION_REFUSED;
    }
    return live_slot(self) == __atomic_load_n(&block->to, __ATOMIC_RELAXED) ? TL_ACTIVATION_STARTED
                                                                            : TL_ACTIVATION_WAITS;
}

static void read_shadow(void *context, tl_activation_shadow *shadow) {
    const tl_live_host *self = context;
    uint32_t state = __atomic_load_n(&self->handover_block->shadow, __ATOMIC_ACQUIRE);
    memset(shadow, 0, sizeof *shadow);
    read_status(twin_of_run(self), &shadow->beside);
    find_active_hash(self, 1 - live_slot(self), shadow->hash);
    if (!is_order_done(self) && self->live_status->order.verb == TL_LIVE_SHADOW) {
        shadow->phase = TL_ACTIVATION_SHADOW_BEGINS;
    } else if (state == TL_LIVE_SHADOW_ENDED) {
        shadow->phase = TL_ACTIVATION_SHADOW_FAILED;
        (void)snprintf(shadow->why, sizeof shadow->why, "%.*s", TL_HANDOVER_WHY - 1, self->handover_block->why);
    } else if (state == TL_LIVE_SHADOW_RUNS) {
        read_status(self->twins[1 - live_slot(self)], &shadow->work);
        shadow->phase = shadow->work.phase == TL_RUN_LIVE       ? TL_ACTIVATION_SHADOW_LIVE
                        : shadow->work.phase == TL_RUN_RECORDED ? TL_ACTIVATION_SHADOW_RECORDED
                                                                : TL_ACTIVATION_SHADOW_BEGINS;
    }
}

/* ---- interface ---- */

static void request_restart(void *context) {
    tl_live_host *self = context;
    __atomic_store_n(&self->live_status->restart, 1, __ATOMIC_RELEASE);
}

static void report_event(void *context, tl_severity severity, const char *text) {
    tl_live_host *self = context;
    tl_journal_event(self->journal, -1, severity, "retune", "%s", text);
}

void tl_live_host_poll(tl_live_host *host) {
    if (host->wants_none) {
        end_shadow(host);
    }
}

tl_activation_host tl_live_host_functions(tl_live_host *host) {
    return (tl_activation_host){
        .context = host,
        .read_view = read_view,
        .active_hash = copy_active_hash,
        .text = running_text,
        .has_other_fmus = has_other_fmus,
        .use_tolerances = set_tolerances,
        .tune = write_tuning,
        .tuning_result = poll_tuning,
        .begin_shadow = order_shadow,
        .read_shadow = read_shadow,
        .end_shadow = end_shadow,
        .handover = order_handover,
        .handover_result = poll_handover,
        .restart = request_restart,
        .report = report_event,
    };
}
