/* Trials of `check`: see check_trials.h. */
#include "firmware/twin/check_trials.h"

#include <stdio.h>
#include <string.h>

/* ---- one trial ---- */

/* Runs a task in a separate process. If that cannot be started, the outcome is TL_TRY_AGAIN.
 * Errors: TL_INTERRUPTED. */
static tl_status try_task(const tl_twin_child_settings *settings, const tl_twin_job *job, unsigned twins,
                          tl_twin_outcome *outcome, tl_error *error) {
    tl_twin_job task = *job;
    tl_twin_child_settings own = *settings;
    tl_twin_child *child = NULL;
    task.reads_back = false;
    own.job = &task;
    own.page = NULL;
    own.memory_limit *= twins;
    tl_status status = tl_twin_child_start(&own, &child, error);
    if (status == TL_OK) {
        status = tl_twin_child_finish(child, outcome, error);
    } else if (status != TL_INTERRUPTED) {
        *outcome = (tl_twin_outcome){.status = TL_TRY_AGAIN};
        (void)snprintf(outcome->text, sizeof outcome->text, "%s", error->text);
        status = TL_OK;
    }
    tl_twin_child_close(child);
    return status;
}

/* ---- other methods ---- */

#define NO_COMPONENT SIZE_MAX

typedef struct method_search {
    const tl_twin_child_settings *settings;
    tl_twin_job job; /* with the methods to test */
    tl_other_method *found;
} method_search;

static size_t count_of(const method_search *self) {
    return self->settings->config->component_count;
}

static bool is_changed(const method_search *self, size_t component) {
    return self->job.rollback[component] != (unsigned char)TL_ROLLBACK_NONE;
}

/* Returns the component that failed. If the process ended before it knew the name: the only
 * component whose method was changed, if there is exactly one. */
static size_t find_culprit(const method_search *self, const tl_twin_outcome *tried) {
    size_t only = NO_COMPONENT;
    size_t changed = 0;
    for (size_t i = 0; i < count_of(self); i++) {
        if (strcmp(self->settings->config->components[i].name, tried->ways.component) == 0) {
            return i;
        }
        only = is_changed(self, i) ? i : only;
        changed += is_changed(self, i) ? 1 : 0;
    }
    return tried->has_ended && changed == 1 ? only : NO_COMPONENT;
}

/* The failure cannot be attributed to a component. */
static void mark_unknown(const method_search *self, const char *why) {
    for (size_t i = 0; i < count_of(self); i++) {
        if (is_changed(self, i)) {
            self->found[i].kind = TL_OTHER_METHOD_UNKNOWN;
            tl_assembly_quote(why, self->settings->config->components[i].name, self->found[i].text, TL_ERROR_TEXT);
        }
    }
}

/* ---- the search ---- */

/* Sets the component's method to `auto` for the next trial. Returns false if `auto` itself has
 * failed. */
static bool use_auto(method_search *self, size_t culprit) {
    bool is_new =
        self->settings->config->components[culprit].rollback != TL_ROLLBACK_AUTO && !is_changed(self, culprit);
    if (is_new) {
        self->job.rollback[culprit] = (unsigned char)TL_ROLLBACK_AUTO;
    }
    return is_new;
}

/* All rollbacks were exact with the methods of `tried`. */
static void note_found(const method_search *self, const tl_component_methods *tried) {
    for (size_t i = 0; i < count_of(self); i++) {
        if (is_changed(self, i)) {
            self->found[i].kind = TL_OTHER_METHOD_FOUND;
            self->found[i].way = tried->of[i];
        }
    }
}

tl_status tl_other_method_find(const tl_twin_child_settings *settings, const tl_component_methods *checked,
                               tl_other_method found[TL_RECORDER_COMPONENTS], tl_error *error) {
    method_search self = {.settings = settings, .job = *settings->job, .found = found};
    tl_twin_outcome now = {.ways = *checked};
    tl_status status = TL_OK;
    self.job.task = TL_TASK_METHODS;
    for (size_t i = 0; i < count_of(&self); i++) {
        found[i] = (tl_other_method){.replay_steps = settings->config->components[i].replay_steps};
    }
    bool failed = checked->rollback_inexact != 0;
    while (failed && status == TL_OK) {
        size_t culprit = find_culprit(&self, &now);
        if (culprit == NO_COMPONENT) {
            mark_unknown(&self, now.text);
            return TL_OK;
        }
        if (!use_auto(&self, culprit)) {
            found[culprit].kind = TL_OTHER_METHOD_NONE;
            return TL_OK;
        }
        status = try_task(settings, &self.job, 1, &now, error);
        failed = status == TL_OK && (now.status != TL_OK || now.text[0] != '\0');
    }
    if (status == TL_OK) {
        note_found(&self, &now.ways);
    }
    return status;
}

/* ---- texts ---- */

/* Value of the key "rollback", and description of the method. */
static const struct {
    const char *key;
    const char *text;
} methods[TL_ROLLBACKS] = {
    [TL_ROLLBACK_STATE] = {"state", "by its state"},
    [TL_ROLLBACK_MEMORY] = {"memory", "by its memory"},
    [TL_ROLLBACK_REPLAY] = {"replay", "by replay"},
};

/* From this size on, sizes are written in MiB. */
enum { LARGE = 10000 * 1024 };

/* A state after which the set values are set again has no key of its own: only "auto" finds this
 * method. */
static void describe_found(const tl_other_method *other, FILE *out) {
    const tl_component_method *method = &other->way;
    const char *key = method->is_given_again != 0 ? NULL : methods[method->rollback].key;
    const char *text = methods[method->rollback].text;
    if (method->rollback == TL_ROLLBACK_REPLAY) {
        (void)fprintf(out, "can be rolled back by replay, but only within %u steps of its start",
                      (unsigned)other->replay_steps);
    } else {
        (void)fprintf(out, "can be rolled back exactly %s%s", text != NULL ? text : "with another method",
                      method->is_given_again != 0 ? ", if its values are set again after that" : "");
    }
    if (method->is_measured != 0) {
        (void)fprintf(out, "; a save and a restore take %.4g \302\265s here",
                      tl_seconds(method->save + method->restore) * 1e6);
    }
    if (method->is_measured != 0 && method->bytes != 0) {
        bool is_large = method->bytes >= LARGE;
        (void)fprintf(out, ", a state takes %.1f %s", (double)method->bytes / (is_large ? 1048576.0 : 1024.0),
                      is_large ? "MiB" : "KiB");
    }
    (void)fprintf(out, ": set \"rollback\": \"%s\" in the component", key != NULL ? key : "auto");
}

void tl_other_method_describe(const tl_other_method *other, char text[TL_OTHER_METHOD_TEXT]) {
    FILE *out = fmemopen(text, TL_OTHER_METHOD_TEXT, "w");
    if (out == NULL) {
        text[0] = '\0';
        return;
    }
    if (other->kind == TL_OTHER_METHOD_FOUND) {
        describe_found(other, out);
    } else if (other->kind == TL_OTHER_METHOD_NONE) {
        (void)fputs("cannot be rolled back exactly by any other method", out);
    } else {
        (void)fprintf(out, "could not be tested with another method: %s", other->text);
    }
    (void)fclose(out);
}

/* ---- comparison ---- */

static tl_status try_pair(const tl_twin_child_settings *settings, bool alone, tl_twin_outcome *outcome,
                          tl_error *error) {
    tl_twin_job job = *settings->job;
    job.task = TL_TASK_PAIR;
    job.alone = alone;
    return try_task(settings, &job, 2, outcome, error);
}

/* Both twins have stepped and differ. */
static tl_status distinguish_pair(const tl_twin_child_settings *settings, const tl_twin_outcome *pair,
                                  tl_pair_verdict *verdict, tl_error *error) {
    tl_twin_outcome again;
    tl_status status = try_pair(settings, true, &again, error);
    if (status == TL_OK && again.status != TL_TRY_AGAIN) {
        const tl_twin_pair_account *first = &pair->pair;
        uint32_t steps = first->steps < again.pair.steps ? first->steps : again.pair.steps;
        bool is_steady = again.status == TL_OK && steps > 0 &&
                         memcmp(first->marks, again.pair.marks, steps * sizeof *first->marks) == 0;
        verdict->kind = is_steady ? TL_PAIR_ONE_PER_PROCESS : TL_PAIR_NOT_DETERMINISTIC;
    }
    return status;
}

tl_status tl_pair_verdict_find(const tl_twin_child_settings *settings, tl_pair_verdict *verdict, tl_error *error) {
    tl_twin_outcome pair;
    tl_status status = try_pair(settings, false, &pair, error);
    if (status != TL_OK) {
        return status;
    }
    *verdict =
        (tl_pair_verdict){.kind = pair.pair.steps > 0 ? TL_PAIR_SAME : TL_PAIR_UNKNOWN, .steps = pair.pair.steps};
    (void)snprintf(verdict->component, sizeof verdict->component, "%s", pair.pair.component);
    (void)snprintf(verdict->text, sizeof verdict->text, "%s", pair.text);
    if (pair.status == TL_TRY_AGAIN) {
        verdict->kind = TL_PAIR_UNKNOWN;
    } else if (pair.status != TL_OK) {
        verdict->kind = pair.pair.has_second != 0 ? TL_PAIR_ONE_PER_PROCESS : TL_PAIR_NOT_DETERMINISTIC;
        if (!pair.has_ended) {
            verdict->text[strcspn(verdict->text, ";")] =
                '\0'; /* the remaining text is advice about a log that was not printed */
        }
    } else if (pair.text[0] != '\0') {
        verdict->kind = TL_PAIR_UNKNOWN;
        return distinguish_pair(settings, &pair, verdict, error);
    }
    return TL_OK;
}
