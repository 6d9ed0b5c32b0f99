/* Explanation: see explanation.h. */
#include "firmware/twin/explanation.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/base/text.h"
#include "master/twin/twin_rerun.h"

enum { BEFORE = 5, FEWEST_BEFORE = 60, FEWEST_AFTER = 10, REACTION = 600 };

/* Part of a value that is a small change. */
static const double SMALL = 0.02;
/* Limits of relative changes. */
static const double LEAST_GAIN = -1.0;
static const double LEAST_RELATIVE = -0.95;
static const double MOST_RELATIVE = 20.0;

struct tl_explainer {
    const tl_assembly *assembly;
    tl_explanation_order order;
    tl_explanation_window window;
    size_t outputs, signals, steps;
    double *measured, *predicted; /* steps · outputs */
    double *plant;                /* ticks · signals */
    size_t ticks, room;
    int64_t first_tick;
    bool is_marked;
    tl_rerun_target target[TL_EXPLANATION_MOST]; /* of each candidate that is not a sensor */
    size_t match[TL_EXPLANATION_MOST];           /* of each candidate that is a sensor */
    tl_explanation *explanation;
    bool (*is_stopped)(void *context);
    void (*advance)(void *context);
    void *context;
    tl_error fatal; /* ends all */
};

/* ---- window ---- */

int64_t tl_explanation_reaction(uint32_t released_steps) {
    return released_steps != 0 ? released_steps : REACTION;
}

tl_status tl_explanation_plan(const tl_explanation_order *order, uint32_t released_steps, int64_t first,
                              tl_explanation_window *window, tl_error *error) {
    int64_t R = tl_explanation_reaction(released_steps);
    int64_t begin = order->least > first + 1 ? order->least : first + 1;
    int64_t mark = order->onset - order->spread - BEFORE * R;
    int64_t end = order->onset + (order->foresees != 0 ? 1 : TL_EXPLANATION_AFTER) * R;
    window->mark = mark > begin ? mark : begin;
    window->end = end < order->last ? end : order->last;
    window->onset = order->onset;
    int64_t before = order->onset - order->spread - window->mark;
    window->learn = window->mark + (before / 3 < R ? before / 3 : R);
    if (before < FEWEST_BEFORE) {
        return tl_fail(error, TL_BAD_DATA,
                       "%lld steps are recorded before the change, expected at least %d to learn the noise",
                       (long long)(before > 0 ? before : 0), FEWEST_BEFORE);
    }
    if (window->end - order->onset < FEWEST_AFTER) {
        return tl_fail(error, TL_BAD_DATA,
                       "%lld steps are recorded after the change, expected at least %d: try again later",
                       (long long)(window->end > order->onset ? window->end - order->onset : 0), FEWEST_AFTER);
    }
    return TL_OK;
}

/* ---- validation ---- */

bool tl_explanation_is_sound(tl_explanation *explanation, size_t outputs) {
    const tl_score_result *result = &explanation->result;
    const tl_explanation_window *window = &explanation->window;
    size_t count = explanation->count;
    bool has_best = count > 0 && result->best < count && result->second < count;
    bool is_sound = count <= TL_EXPLANATION_MOST && (unsigned)result->verdict < TL_SCORE_VERDICTS &&
                    (has_best || (count == 0 && result->verdict == TL_SCORE_NOT_BETTER)) &&
                    result->apart_output < outputs && 0 <= window->mark && window->mark <= window->learn &&
                    window->learn <= window->onset && window->onset <= window->end && window->end < INT64_MAX / 4;
    for (size_t i = 0; i < count && is_sound; i++) {
        tl_explained *one = &explanation->candidate[i];
        tl_clean_field(one->name, sizeof one->name);
        tl_clean_field(one->unit, sizeof one->unit);
        is_sound = one->origin < TL_EXPLAINED_ORIGINS && one->change < TL_EXPLAINED_CHANGES && one->test.alike < count;
    }
    return is_sound;
}

/* ---- collection ---- */

tl_status tl_explainer_create(const tl_assembly *assembly, const tl_explanation_order *order, tl_explainer **explainer,
                              tl_error *error) {
    tl_twin_facts facts = tl_twin_get_facts(assembly->twin);
    tl_explanation_window window;
    tl_status status = tl_explanation_plan(order, assembly->config.released_steps, facts.first, &window, error);
    if (status != TL_OK) {
        return status;
    }
    tl_explainer *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the explanation");
    }
    made->assembly = assembly;
    made->order = *order;
    made->window = window;
    made->outputs = assembly->config.match_count;
    made->signals = assembly->config.signal_count;
    made->steps = (size_t)(window.end - window.mark);
    int64_t tick = window.mark + 1 + assembly->config.input_lookup.ticks;
    made->first_tick = tick > 0 ? tick : 0;
    made->room = made->steps;
    made->measured = calloc(made->steps * made->outputs + 1, sizeof *made->measured);
    made->predicted = calloc(made->steps * made->outputs + 1, sizeof *made->predicted);
    made->plant = calloc(made->room * made->signals + 1, sizeof *made->plant);
    if (made->measured == NULL || made->predicted == NULL || made->plant == NULL) {
        tl_explainer_free(made);
        return tl_fail(error, TL_TRY_AGAIN, "not enough memory for the explanation");
    }
    for (size_t i = 0; i < made->steps * made->outputs; i++) {
        made->measured[i] = (double)NAN;
    }
    *explainer = made;
    return TL_OK;
}

void tl_explainer_free(tl_explainer *explainer) {
    if (explainer != NULL) {
        free(explainer->measured);
        free(explainer->predicted);
        free(explainer->plant);
        free(explainer);
    }
}

static void take_record(tl_explainer *self, const tl_record *record) {
    if (record->step < self->window.mark || record->step >= self->window.end) {
        return;
    }
    double *row = self->measured + (size_t)(record->step - self->window.mark) * self->outputs;
    for (size_t k = 0; k < self->outputs; k++) {
        bool is_read = record->measured_quality[k] == TL_GOOD || record->measured_quality[k] == TL_FROZEN;
        row[k] = is_read ? record->measured[k] : (double)NAN;
    }
}

tl_status tl_explainer_take(tl_explainer *explainer, const tl_twin_result *result, tl_error *error) {
    tl_twin *twin = explainer->assembly->twin;
    int64_t row = result->tick - explainer->first_tick;
    if (row >= 0 && row == (int64_t)explainer->ticks && explainer->ticks < explainer->room) {
        tl_twin_get_plant(twin, explainer->plant + explainer->ticks * explainer->signals);
        explainer->ticks++;
    }
    if (result->ready != 0) {
        take_record(explainer, &result->record);
    }
    int64_t next = result->tick + 1 - (int64_t)tl_twin_get_facts(twin).lead;
    if (next != explainer->window.mark) {
        return TL_OK;
    }
    tl_status status = tl_twin_mark(twin, error);
    explainer->is_marked = status == TL_OK;
    return status;
}

/* ---- candidates ---- */

static tl_explained *add(tl_explainer *self, tl_explained_origin origin, tl_explained_change change) {
    tl_explanation *all = self->explanation;
    if (all->count == TL_EXPLANATION_MOST) {
        all->left_out++;
        return NULL;
    }
    tl_explained *one = &all->candidate[all->count++];
    one->origin = origin;
    one->change = change;
    one->test = (tl_score_candidate){.probe = SMALL, .least = -(double)INFINITY, .most = (double)INFINITY};
    if (change == TL_EXPLAINED_GAIN || change == TL_EXPLAINED_RELATIVE) {
        one->test.least = change == TL_EXPLAINED_GAIN ? LEAST_GAIN : LEAST_RELATIVE;
        one->test.most = MOST_RELATIVE;
    }
    return one;
}

static void add_target(tl_explainer *self, const tl_rerun_target *target, tl_explained_change change) {
    static const tl_explained_origin origins[] = {[TL_RERUN_ADJUSTED] = TL_EXPLAINED_ADJUSTED,
                                                  [TL_RERUN_INPUT] = TL_EXPLAINED_INPUT,
                                                  [TL_RERUN_PARAMETER] = TL_EXPLAINED_PARAMETER};
    size_t index = self->explanation->count;
    tl_explained *one = add(self, origins[target->kind], change);
    if (one == NULL) {
        return;
    }
    self->target[index] = *target;
    (void)snprintf(one->name, sizeof one->name, "%s.%s", target->component_name, target->variable->name);
    (void)snprintf(one->unit, sizeof one->unit, "%s", target->unit);
    if (change == TL_EXPLAINED_OFFSET) {
        one->test.probe = SMALL * fmax(fabs(target->value), SMALL * target->variable->nominal);
    }
}

static void add_targets(tl_explainer *self) {
    tl_rerun_target target;
    for (size_t i = 0; tl_rerun_target_get(self->assembly->twin, i, &target); i++) {
        bool is_parameter = target.variable->causality == TL_PARAMETER;
        bool is_constant =
            target.kind == TL_RERUN_ADJUSTED && !tl_twin_get_adjusted(self->assembly->twin, target.index).is_fed;
        if (is_parameter && fabs(target.value) > 0.0) {
            add_target(self, &target, TL_EXPLAINED_RELATIVE);
        } else if (!is_parameter) {
            add_target(self, &target, TL_EXPLAINED_OFFSET);
        }
        if (!is_parameter && !is_constant) {
            add_target(self, &target, TL_EXPLAINED_GAIN);
        }
    }
}

/* Of this output, within the window. */
static double largest_measured(const tl_explainer *self, size_t match) {
    double largest = 0.0;
    for (size_t i = match; i < self->steps * self->outputs; i += self->outputs) {
        largest = isnan(self->measured[i]) ? largest : fmax(largest, fabs(self->measured[i]));
    }
    return largest;
}

static void add_sensor(tl_explainer *self, size_t match, tl_explained_change change) {
    const tl_plan_match *plan = &self->assembly->config.match[match];
    double scale = SMALL * fmax(largest_measured(self, match), 1e-9);
    size_t index = self->explanation->count;
    tl_explained *one = add(self, TL_EXPLAINED_SENSOR, change);
    if (one == NULL) {
        return;
    }
    self->match[index] = match;
    (void)snprintf(one->name, sizeof one->name, "%.100s", plan->to);
    (void)snprintf(one->unit, sizeof one->unit, "%s", tl_twin_match_unit(self->assembly->twin, match));
    if (change == TL_EXPLAINED_DELAY) {
        one->test.probe = 1.0;
        one->test.least = 0.0;
        one->test.most = (double)(self->window.onset - self->window.mark);
    } else if (change != TL_EXPLAINED_GAIN) {
        one->test.probe = scale;
        one->test.is_level = change == TL_EXPLAINED_FREEZE;
    }
}

/* A frozen sensor repeats its reading: in more than half of the steps after the onset. */
static bool repeats(const tl_explainer *self, size_t match) {
    size_t onset = (size_t)(self->window.onset - self->window.mark);
    size_t count = 0;
    for (size_t i = onset + 1; i < self->steps; i++) {
        const double *row = self->measured + i * self->outputs + match;
        count += !isnan(*row) && memcmp(row, row - self->outputs, sizeof *row) == 0 ? 1 : 0;
    }
    return count > (self->steps - onset) / 2;
}

static void add_sensors(tl_explainer *self) {
    for (size_t match = 0; match < self->outputs; match++) {
        add_sensor(self, match, TL_EXPLAINED_OFFSET);
        add_sensor(self, match, TL_EXPLAINED_GAIN);
        add_sensor(self, match, TL_EXPLAINED_DELAY);
        if (repeats(self, match)) {
            add_sensor(self, match, TL_EXPLAINED_FREEZE);
        }
    }
}

static uint32_t count_fixed(const tl_assembly *assembly) {
    uint32_t count = 0;
    for (size_t i = 0; i < assembly->config.component_count; i++) {
        const tl_model *model = assembly->plan.components[i].model;
        for (size_t k = 0; k < model->variable_count; k++) {
            const tl_variable *variable = &model->variables[k];
            count += variable->causality == TL_PARAMETER && variable->variability == TL_FIXED &&
                             variable->type == TL_REAL && variable->has_start && fabs(variable->start.real) > 0.0
                         ? 1
                         : 0;
        }
    }
    return count;
}

/* ---- predictions ---- */

/* The prediction without a change, between two of its steps. */
static double earlier_value(const tl_explainer *self, size_t step, double delay, size_t match) {
    double at = fmax((double)step - delay, 0.0);
    size_t before = (size_t)at;
    size_t after = before + 1 < self->steps ? before + 1 : before;
    double part = at - (double)before;
    return (1.0 - part) * self->predicted[before * self->outputs + match] +
           part * self->predicted[after * self->outputs + match];
}

static void predict_sensor(const tl_explainer *self, size_t candidate, double size, size_t onset, double *predicted) {
    size_t match = self->match[candidate];
    memcpy(predicted, self->predicted, self->steps * self->outputs * sizeof *predicted);
    for (size_t i = onset; i < self->steps; i++) {
        double *y = &predicted[i * self->outputs + match];
        switch (self->explanation->candidate[candidate].change) {
        case TL_EXPLAINED_OFFSET:
            *y += size;
            break;
        case TL_EXPLAINED_GAIN:
            *y *= 1.0 + size;
            break;
        case TL_EXPLAINED_DELAY:
            *y = earlier_value(self, i, size, match);
            break;
        default:
            *y = self->predicted[(onset - 1) * self->outputs + match] + size;
        }
    }
}

static tl_status rerun(const tl_explainer *self, const tl_rerun_target *target, double factor, double offset,
                       int64_t from, double *predicted, tl_error *error) {
    const tl_rerun order = {.target = target,
                            .factor = factor,
                            .offset = offset,
                            .from = from,
                            .steps = self->steps,
                            .plant = self->plant,
                            .first_tick = self->first_tick,
                            .ticks = self->ticks};
    tl_status status = tl_twin_rerun(self->assembly->twin, &order, predicted, error);
    self->advance(self->context);
    return status;
}

/* A prediction that fails only excludes its candidate, unless the FMUs cannot be used any more. */
static bool predict(void *context, size_t candidate, double size, size_t onset, double *predicted) {
    tl_explainer *self = context;
    const tl_explained *one = &self->explanation->candidate[candidate];
    tl_error error;
    if (one->origin == TL_EXPLAINED_SENSOR) {
        predict_sensor(self, candidate, size, onset, predicted);
        return true;
    }
    if (self->is_stopped(self->context) || self->fatal.status != TL_OK) {
        return false;
    }
    bool is_offset = one->change == TL_EXPLAINED_OFFSET;
    tl_status status = rerun(self, &self->target[candidate], is_offset ? 1.0 : 1.0 + size, is_offset ? size : 0.0,
                             self->window.mark + (int64_t)onset, predicted, &error);
    if (status == TL_FMU_FATAL || status == TL_BAD_DATA) {
        self->fatal = error;
    }
    return status == TL_OK;
}

static bool has_ended(void *context) {
    const tl_explainer *self = context;
    return self->fatal.status != TL_OK || self->is_stopped(self->context);
}

/* ---- run ---- */

/* The record may have ended before the planned end. */
static tl_status shorten(tl_explainer *self, tl_error *error) {
    bool any = false;
    while (self->steps > 0 && !any) {
        const double *row = self->measured + (self->steps - 1) * self->outputs;
        for (size_t k = 0; k < self->outputs; k++) {
            any = any || !isnan(row[k]);
        }
        self->steps -= any ? 0 : 1;
    }
    self->window.end = self->window.mark + (int64_t)self->steps;
    bool is_enough = self->is_marked && self->ticks > 0 && self->window.end - self->window.onset >= FEWEST_AFTER;
    return is_enough ? TL_OK
                     : tl_fail(error, TL_BAD_DATA,
                               "no measurement follows the change, expected at least %d steps: try again later",
                               FEWEST_AFTER);
}

static tl_status run_test(tl_explainer *self, tl_error *error) {
    tl_explanation *all = self->explanation;
    tl_score_candidate *candidates = calloc(all->count + 1, sizeof *candidates);
    const tl_score_test test = {.window = {.steps = self->steps,
                                           .outputs = self->outputs,
                                           .learn = (size_t)(self->window.learn - self->window.mark),
                                           .onset = (size_t)(self->window.onset - self->window.mark),
                                           .onset_spread = (double)self->order.spread,
                                           .measured = self->measured,
                                           .predicted = self->predicted},
                                .predict = predict,
                                .context = self,
                                .stop = has_ended,
                                .only_foresees = self->order.foresees != 0};
    for (size_t i = 0; i < all->count && candidates != NULL; i++) {
        candidates[i] = all->candidate[i].test;
    }
    bool done = candidates != NULL && tl_score_test_run(&test, candidates, all->count, &all->result);
    for (size_t i = 0; i < all->count && done; i++) {
        all->candidate[i].test = candidates[i];
    }
    free(candidates);
    if (self->fatal.status != TL_OK) {
        *error = self->fatal;
        return self->fatal.status;
    }
    if (self->is_stopped(self->context)) {
        return TL_INTERRUPTED;
    }
    return done ? TL_OK : tl_fail(error, TL_TRY_AGAIN, "not enough memory for the explanation");
}

tl_status tl_explainer_run(tl_explainer *explainer, bool (*is_stopped)(void *context), void (*advance)(void *context),
                           void *context, tl_explanation *explanation, tl_error *error) {
    explainer->explanation = explanation;
    explainer->is_stopped = is_stopped;
    explainer->advance = advance;
    explainer->context = context;
    tl_status status = shorten(explainer, error);
    explanation->window = explainer->window;
    explanation->fixed = count_fixed(explainer->assembly);
    status = status == TL_OK ? rerun(explainer, NULL, 1.0, 0.0, 0, explainer->predicted, error) : status;
    if (status != TL_OK) {
        return status;
    }
    add_targets(explainer);
    add_sensors(explainer);
    return run_test(explainer, error);
}
