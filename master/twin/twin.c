/* Twin: see twin.h. */
#include "master/twin/twin.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "master/solve/optimiser.h"
#include "master/twin/twin_parts.h"

/* ---- twin facts ---- */

static const char *name_of(const tl_optimiser_class *solver) {
    return solver != NULL ? solver->name : NULL;
}

const char *tl_twin_solver_named(const char *name) {
    return name_of(tl_optimiser_find(name));
}

const char *tl_twin_solver_numbered(int number) {
    return name_of(tl_optimiser_numbered(number));
}

const char *tl_twin_solver_names(void) {
    return tl_optimiser_names();
}

/* The prediction horizon T_P in steps; of an event horizon, the longest. */
static uint32_t horizon_steps(const tl_twin *twin) {
    return twin->event != NULL ? tl_event_horizon_steps(twin->event) : twin->synchroniser.horizon.prediction;
}

/* States of the caches; of each component one more where candidates start, for the proof and for
 * checkpoints; and those of the verifier. */
static uint64_t state_memory(const tl_twin *twin) {
    const tl_exchange *exchange = &twin->exchange;
    uint64_t sum = 0;
    for (size_t k = 0; k < exchange->component_count && exchange->rooms != NULL; k++) {
        sum += (1 + (uint64_t)exchange->extra_states) * exchange->rooms[k].size;
    }
    return exchange->rooms != NULL ? sum + tl_state_room_bytes(exchange->rooms, exchange->component_count) : 0;
}

static const char *culprit_name(const tl_twin *twin) {
    return twin->rollback_inexact && twin->proof.culprit < twin->graph.component_count
               ? twin->graph.components[twin->proof.culprit].name
               : NULL;
}

tl_twin_facts tl_twin_get_facts(const tl_twin *twin) {
    const tl_synchroniser *synchroniser = &twin->synchroniser;
    uint64_t components = twin->graph.component_count + 1;
    bool searches = synchroniser->horizon.variables != 0;
    uint32_t prediction = horizon_steps(twin);
    tl_twin_facts facts = {
        .components = (size_t)components,
        .prediction = prediction,
        .distance = synchroniser->horizon.distance,
        .lead = twin->lead,
        .experiment = twin->experiment,
        .first = twin->first,
        .unknowns = synchroniser->horizon.count,
        .algorithm = synchroniser->solver != NULL ? synchroniser->solver->name : "",
        .fallback = synchroniser->fallback != NULL ? synchroniser->fallback->name : "",
        .memory = tl_arena_used(&twin->arena),
        .state_memory = state_memory(twin),
        .executions_per_step = components,
        .executions_per_evaluation = searches ? components * prediction : 0,
        .returns = twin->proof.holds,
        .rollback_inexact = twin->rollback_inexact,
        .inexact_component = culprit_name(twin),
        .proved_executions = twin->proof.executions,
        .runs_free = twin->runs_free,
        .verified = twin->verifier.counts.turns,
        .verified_executions = twin->verifier.counts.executions,
        .differed = twin->verifier.counts.found,
        .has_free_twin = twin->free_twin.is_enabled,
        .free_twin = twin->free_twin.counts,
        .released_state = twin->released_twin.state,
        .released_steps = twin->released_twin.steps,
        .released_time = twin->released_twin.fastest,
        .released = twin->released_twin.counts,
        .structure = searches && synchroniser->ledger.saving.structure,
        .sequences = searches && synchroniser->ledger.saving.sequences,
    };
    return facts;
}

/* What the graph says of one component with the configured saving. */
static void fill_needs(const tl_twin *twin, size_t component, tl_twin_ledger *entry) {
    const tl_horizon *horizon = &twin->synchroniser.horizon;
    if (horizon->variables == 0) {
        return;
    }
    const tl_plan_saving *saving = &twin->synchroniser.ledger.saving;
    uint32_t full = saving->structure ? horizon->reach[component] : horizon_steps(twin);
    entry->reach = horizon->reach[component];
    entry->on_path = horizon->longer[component] != TL_NEVER;
    entry->longer = entry->on_path ? horizon->longer[component] : 0;
    entry->first_need = full;
    bool reuses = saving->sequences && !twin->synchroniser.ledger.executes[component];
    entry->next_need = reuses ? tl_horizon_next_need(horizon, component, full) : full;
}

tl_twin_ledger tl_twin_get_ledger(const tl_twin *twin, size_t component) {
    const tl_exchange *exchange = &twin->exchange;
    bool plant = component == twin->graph.component_count;
    tl_twin_ledger entry = {
        .name = tl_twin_component_name(twin, component),
        .plain = twin->synchroniser.ledger.plain,
        .predicted = tl_ledger_predicted(&twin->synchroniser.ledger, component),
        .executions = tl_twin_executions(twin, component),
        .keep = twin->unsaved != 0 ? TL_KEEP_NONE : TL_KEEP_AUTO,
    };
    fill_needs(twin, component, &entry);
    if (!plant) {
        entry.replay = exchange->components[component].fmi->replay;
        entry.reads_late = exchange->components[component].reads_late;
        entry.cost = exchange->costs.each[component].most;
    }
    if (!plant && exchange->cached != NULL) {
        const tl_cached_component *cached = &exchange->cached[component];
        entry.keep = cached->keep;
        entry.nodes = cached->tree.capacity;
        entry.nodes_worst = twin->worst[component];
        entry.memory = tl_sequence_cache_memory(&cached->tree);
        entry.state_size = exchange->rooms[component].size;
        entry.states = exchange->rooms[component].kept;
        entry.nodes_peak = cached->tree.peak;
        entry.repeated = cached->repeated;
        entry.uncached = cached->uncached;
    }
    entry.difference = (int64_t)(entry.executions - entry.repeated - entry.predicted);
    return entry;
}

tl_twin_identifiability tl_twin_get_identifiability(const tl_twin *twin) {
    tl_twin_identifiability found;
    found.unseen = tl_sensitivity_unseen(&twin->synchroniser.sensitivity);
    found.alike = tl_sensitivity_alike(&twin->synchroniser.sensitivity, &found.since);
    return found;
}

uint64_t tl_twin_unsaved(const tl_twin *twin) {
    return twin->unsaved;
}

bool tl_twin_ledger_is_complete(const tl_twin *twin) {
    return !twin->synchroniser.ledger.incomplete;
}

uint64_t tl_twin_executions(const tl_twin *twin, size_t component) {
    return component < twin->graph.component_count ? twin->graph.components[component].executions
                                                   : twin->exchange.plant.executions;
}

const char *tl_twin_component_name(const tl_twin *twin, size_t component) {
    return component < twin->graph.component_count ? twin->graph.components[component].name : "plant";
}

tl_twin_adjusted tl_twin_get_adjusted(const tl_twin *twin, size_t adjust) {
    const tl_adjusted *adjusted = &twin->synchroniser.adjusted[adjust];
    const tl_adjusted_input *input = &twin->exchange.adjusted[adjust];
    return (tl_twin_adjusted){
        .is_real = !adjusted->is_boolean,
        .is_fed = input->delivered_real != NULL || input->delivered_boolean != NULL,
        .nominal = input->nominal,
        .step = adjusted->step,
        .lower = adjusted->lower,
        .upper = adjusted->upper,
        .least = twin->adjust_ports[adjust]->variable->minimum,
        .most = twin->adjust_ports[adjust]->variable->maximum,
        .size = twin->adjust_ports[adjust]->variable->nominal,
    };
}

tl_twin_bounds tl_twin_get_bounds(const tl_twin *twin, size_t signal) {
    tl_signal_bounds found = tl_graph_signal_bounds(&twin->graph, signal);
    tl_twin_bounds bounds = {.least = found.least, .most = found.most, .scale = found.scale, .items = found.items};
    if (found.input != NULL) {
        bounds.component = tl_twin_component_name(twin, found.input->node);
        bounds.input = found.input->variable->name;
    }
    return bounds;
}

tl_twin_delay tl_twin_get_delay(const tl_twin *twin) {
    return twin->delay;
}

const tl_metrics *tl_twin_readings(const tl_twin *twin, size_t match) {
    return &twin->readings[match];
}

const tl_metrics *tl_twin_released(const tl_twin *twin, size_t match) {
    return &twin->released[match];
}

const tl_metrics *tl_twin_metrics(const tl_twin *twin, size_t match) {
    return &twin->metrics[match];
}

double tl_twin_output(const tl_twin *twin, size_t output) {
    return tl_exchange_value(&twin->exchange, twin->outputs[output]);
}

size_t tl_twin_value_count(const tl_twin *twin) {
    return twin->graph.port_count;
}

bool tl_twin_get_value(const tl_twin *twin, size_t i, tl_twin_value *value) {
    const tl_port *port = &twin->graph.ports[i];
    if (port->input || port->variable == NULL) {
        return false;
    }
    *value = (tl_twin_value){.component = twin->graph.components[port->node].name,
                             .variable = port->variable->name,
                             .value = tl_exchange_value(&twin->exchange, port)};
    return true;
}

static const char *unit_name(const tl_port *port) {
    return port->variable->unit == NULL ? "" : port->variable->unit->name;
}

const char *tl_twin_match_unit(const tl_twin *twin, size_t match) {
    return unit_name(twin->terms[match].port);
}

const char *tl_twin_adjust_unit(const tl_twin *twin, size_t adjust) {
    return unit_name(twin->adjust_ports[adjust]);
}

/* ---- reset of a twin in the middle of its run ---- */

void tl_twin_reset(tl_twin *twin) {
    int64_t next = twin->exchange.plant.newest + 1 - (int64_t)twin->lead;
    twin->resets = next >= twin->first;
}

bool tl_twin_is_starting(const tl_twin *twin) {
    return twin->starts.waits || twin->starts.searches;
}

void tl_twin_end_released(tl_twin *twin, bool end) {
    if (end) {
        tl_released_twin_end_after(&twin->released_twin, twin->exchange.plant.newest + 1 - (int64_t)twin->lead);
    }
}

void tl_twin_rest(tl_twin *twin, bool rests) {
    twin->synchroniser.rests = rests || tl_free_twin_rests(&twin->free_twin);
}

/* As in a record. Not inlined because it is rarely needed. */
static uint64_t __attribute__((noinline, cold)) list_bad_outputs(const tl_twin *twin) {
    const tl_exchange *exchange = &twin->exchange;
    const size_t last = 63;
    uint64_t bad = 0;
    size_t bit = 0;
    for (; bit < twin->synchroniser.objective.term_count; bit++) {
        bad |= isfinite(tl_exchange_value(exchange, twin->terms[bit].port)) ? 0 : (uint64_t)1 << bit;
    }
    for (size_t i = 0; i < twin->graph.connection_count; i++, bit++) {
        double value = tl_exchange_value(exchange, twin->graph.connections[i].from);
        bad |= isfinite(value) ? 0 : (uint64_t)1 << (bit < last ? bit : last);
    }
    return bad;
}

static uint64_t find_bad_outputs(const tl_twin *twin) {
    return tl_exchange_is_finite(&twin->exchange) ? 0 : list_bad_outputs(twin);
}

/* From the committed instant. */
static tl_status begin_side_twins(tl_twin *twin, tl_error *error) {
    tl_status status = tl_free_twin_begin(&twin->free_twin, error);
    return status == TL_OK ? tl_released_twin_begin(&twin->released_twin, error) : status;
}

/* The sample that delivers the inputs of a step. */
static const tl_sample *sample_of(const tl_twin *twin, int64_t step) {
    const tl_plant *plant = &twin->exchange.plant;
    return tl_plant_sample(plant, tl_plant_shown(plant, step, plant->newest));
}

static tl_status restart_here(tl_twin *twin, int64_t step, tl_error *error) {
    const tl_sample *sample = sample_of(twin, step);
    tl_status status = tl_start_values_begin(twin, step, sample, false, error);
    return status == TL_OK ? tl_twin_restart(twin, step, sample->values, error) : status;
}

/* `due`: whether the twin itself resets, and how. */
static tl_status reset_twin(tl_twin *twin, int64_t step, tl_start_due due, tl_record_found *found, uint32_t *flags,
                            tl_error *error) {
    bool finds = due == TL_START_FIND && !twin->resets;
    found->evaluations = 0;
    *flags = TL_FLAG_RESET | (due != TL_START_NOTHING && !twin->resets ? (uint32_t)TL_FLAG_STARTS : 0U);
    twin->resets = false;
    tl_verifier_abandon(&twin->verifier);
    tl_status status = finds ? tl_start_values_find(twin, step, found, error) : restart_here(twin, step, error);
    if (status != TL_OK) {
        return status;
    }
    bool was_abandoned = twin->event != NULL && tl_event_horizon_reset(twin->event);
    twin->bad_at_start = find_bad_outputs(twin);
    *flags |= was_abandoned ? (uint32_t)TL_FLAG_ABANDONED : 0U;
    tl_synchroniser_reset(&twin->synchroniser);
    status = tl_exchange_reset(&twin->exchange, step, error);
    twin->synchroniser.rests = false;
    return status == TL_OK ? begin_side_twins(twin, error) : status;
}

/* ---- Another tuning between two ticks.
 *
 * The next search reads what changes: targets, bounds, margin, nominal. Values of earlier steps are
 * stored in units of their own (y, u), or are converted: the solver's slope, and the distance of u
 * from nominal.
 */

/* Bounds in use: the configured ones within the declared ones of the FMU. A Boolean has none. */
static tl_status place_bounds(const tl_twin *twin, size_t v, tl_tuning_adjust *adjust, tl_error *error) {
    const tl_variable *variable = twin->adjust_ports[v]->variable;
    if (twin->synchroniser.adjusted[v].is_boolean) {
        bool known = adjust->has_nominal == 0 || !(adjust->nominal < 0.0 || adjust->nominal > 0.0) ||
                     !(adjust->nominal < 1.0 || adjust->nominal > 1.0);
        return known ? TL_OK
                     : tl_fail(error, TL_BAD_DATA, "%s: its nominal is %g, expected 0 or 1 for a Boolean",
                               variable->name, adjust->nominal);
    }
    adjust->lower = fmax(adjust->lower, variable->minimum);
    adjust->upper = fmin(adjust->upper, variable->maximum);
    return adjust->lower < adjust->upper
               ? TL_OK
               : tl_fail(
                     error, TL_BAD_DATA,
                     "%s: no range is left between the bounds %g and %g (configured, and declared by the FMU): widen "
                     "\"min\" and \"max\"",
                     variable->name, adjust->lower, adjust->upper);
}

static tl_status check_tuning(const tl_twin *twin, tl_tuning *tuning, tl_error *error) {
    tl_status status = tl_tuning_check(tuning, error);
    if (status == TL_OK) {
        status = tl_tuning_fits(tuning, &twin->built, error);
    }
    for (size_t v = 0; status == TL_OK && v < tuning->adjusts; v++) {
        status = place_bounds(twin, v, &tuning->adjust[v], error);
    }
    return status;
}

/* Before the start of the FMUs: they start with it. */
static void place_nominal(tl_twin *twin, size_t v, const tl_tuning_adjust *adjust, bool has_begun) {
    if (adjust->has_nominal != 0) {
        tl_exchange_set_nominal(&twin->exchange, v, adjust->nominal);
        if (!has_begun) {
            tl_exchange_set_adjusted(&twin->exchange, v, adjust->nominal);
        }
    }
}

static void apply_tuning(tl_twin *twin, const tl_tuning *tuning) {
    bool has_begun = twin->exchange.plant.newest >= twin->begin;
    tl_synchroniser_retune(&twin->synchroniser, twin->terms, tuning);
    for (size_t v = 0; v < tuning->adjusts; v++) {
        place_nominal(twin, v, &tuning->adjust[v], has_begun);
    }
    tl_free_twin_retune(&twin->free_twin);
    twin->synchroniser.rests = false;
    if (twin->event != NULL) {
        tl_event_horizon_retune(twin->event, tuning, has_begun);
    }
}

/* The released twins have run without the new correction, so they end. The twin stays as it is. */
static void apply_approved(tl_twin *twin, const tl_tuning *tuning) {
    for (size_t v = 0; v < tuning->adjusts; v++) {
        tl_adjusted *adjusted = &twin->synchroniser.adjusted[v];
        double approved = tuning->adjust[v].approved;
        twin->tuning.adjust[v].approved = approved;
        if (!adjusted->is_boolean && (approved < adjusted->approved || approved > adjusted->approved)) {
            adjusted->approved = approved;
            tl_released_twin_end(&twin->released_twin);
        }
    }
}

tl_status tl_twin_retune(tl_twin *twin, const tl_tuning *tuning, tl_error *error) {
    tl_tuning wanted = *tuning;
    tl_status status = check_tuning(twin, &wanted, error);
    if (status != TL_OK) {
        return status;
    }
    apply_approved(twin, tuning);
    if (memcmp(&twin->tuning, tuning, sizeof *tuning) != 0) {
        apply_tuning(twin, &wanted);
        twin->tuning = *tuning;
    }
    return status;
}

void tl_twin_get_tuning(const tl_twin *twin, tl_tuning *tuning) {
    *tuning = twin->tuning;
}

/* ---- twin verify ---- */

/* Part of a tolerance: a smaller difference shows that the FMU is not exact, but does not harm the
 * matching. */
static const double HARMLESS_PART = 0.01;

/* Of the first match of that output. */
static double find_tolerances(const tl_twin *twin, const tl_verifier_finding *found) {
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        if (twin->terms[i].port == found->port) {
            return fabs(found->again - found->committed) / twin->terms[i].tolerance;
        }
    }
    return (double)NAN;
}

static void describe_finding(const tl_twin *twin, const tl_verifier_finding *found, tl_twin_finding *finding) {
    const tl_variable *variable = found->port != NULL ? found->port->variable : NULL;
    *finding = (tl_twin_finding){
        .component = twin->graph.components[found->component].name,
        .variable = variable != NULL ? variable->name : NULL,
        .unit = variable != NULL && variable->unit != NULL ? variable->unit->name : "",
        .step = found->step,
        .after = found->after,
        .committed = found->committed,
        .again = found->again,
        .cause = found->cause,
        .tolerances = found->port != NULL ? find_tolerances(twin, found) : (double)NAN,
    };
}

/* Switches to the other method if there is one that is not in use; else excludes the component. */
static tl_status replace_method(tl_twin *twin, size_t component, tl_twin_repaired *mended, tl_error *error) {
    int64_t next = twin->exchange.plant.newest + 1 - (int64_t)twin->lead;
    bool prefers_copy = twin->graph.components[component].prefers_copy;
    bool emptied = false;
    tl_twin_end_other_states(twin, component);
    tl_status status = tl_exchange_give_up_states(&twin->exchange, component, next, &emptied, error);
    if (status != TL_OK) {
        return status;
    }
    bool done = emptied && twin->graph.components[component].gave_up_states;
    if (emptied) {
        tl_ledger_reset(&twin->synchroniser.ledger);
    }
    status = begin_side_twins(twin, error);
    twin->synchroniser.rests = false;
    if (status != TL_OK) {
        return status;
    }
    *mended = !done ? TL_REPAIRED_NOT : prefers_copy ? TL_REPAIRED_BY_STATES : TL_REPAIRED_BY_MEMORY;
    if (!done) {
        tl_verifier_exclude(&twin->verifier, component);
    }
    return TL_OK;
}

tl_status tl_twin_verify(tl_twin *twin, const tl_budget *budget, tl_twin_finding *finding, bool *found,
                         tl_error *error) {
    tl_verifier_finding difference;
    *found = false;
    if (twin->ended != TL_OK || twin->synchroniser.runs_free) {
        return TL_OK;
    }
    twin->ended = tl_verifier_continue(&twin->verifier, budget, &difference, found, error);
    if (twin->ended == TL_OK && *found) {
        describe_finding(twin, &difference, finding);
        twin->ended = replace_method(twin, difference.component, &finding->mended, error);
        twin->finding = *finding;
        bool harmless = finding->tolerances < HARMLESS_PART;
        twin->marks |= TL_FLAG_DIFFERED;
        twin->lasting |= finding->mended != TL_REPAIRED_NOT || harmless ? 0U : (uint32_t)TL_FLAG_DIFFERED;
    }
    return twin->ended;
}

const char *tl_twin_cause_text(tl_restore_cause cause) {
    return tl_restore_cause_text(cause);
}

/* ---- twin ---- */

tl_status tl_twin_start(tl_twin *twin, const tl_sample *sample, tl_error *error) {
    tl_status status = tl_start_values_begin(twin, twin->first, sample, true, error);
    status = status == TL_OK ? tl_exchange_initialize(&twin->exchange, twin->first, sample->values, error) : status;
    if (status == TL_OK && twin->synchroniser.horizon.variables != 0) {
        status = tl_proof_of_rollback(&twin->proof, &twin->synchroniser, &twin->graph, twin->first, twin->now, error);
        twin->rollback_inexact = status != TL_OK && twin->proof.stepped;
        status = status == TL_OK ? tl_twin_choose_keep(twin, error) : status;
    }
    return status;
}

static tl_status start_twin(tl_twin *twin, const tl_budget *budget, tl_error *error) {
    tl_status status = tl_twin_start(twin, sample_of(twin, twin->first), error);
    status = status == TL_OK ? tl_exchange_start(&twin->exchange, twin->state_bytes, twin->heap, error) : status;
    twin->bad_at_start = find_bad_outputs(twin);
    tl_proof_end(&twin->proof);
    status = status == TL_OK ? tl_verifier_start(&twin->verifier, budget, error) : status;
    return status == TL_OK ? begin_side_twins(twin, error) : status;
}

/* ---- a measured delay ---- */

/* A correction below a hundredth of a first step of the search is ignored. */
static bool is_free(const tl_twin *twin, const tl_record *record) {
    static const double least = 0.01;
    bool free = true;
    for (size_t v = 0; v < twin->synchroniser.horizon.variables; v++) {
        free = free && fabs(record->u[v] - record->nominal[v]) <= least * twin->synchroniser.adjusted[v].step;
    }
    return free;
}

/* From the next step on. Values in a sample have a fixed age, so only whole steps can change. */
static void use_delay(tl_twin *twin) {
    tl_time delay = twin->delay.delay;
    tl_time range = twin->measure.range;
    tl_time used = delay > range ? range : delay < -range ? -range : delay;
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        twin->terms[i].shift = tl_delay_ticks(twin->measure.look_back, used, twin->step);
    }
}

/* What a meter shows in excess of the delay in use, fixed when it first knows its delay. */
static tl_time find_offset(tl_twin *twin, size_t match, const tl_delay_measured *found) {
    bool needs_one = found->known && twin->measure.has_start && twin->released_twin.state == TL_RELEASED_ON;
    if (needs_one && !twin->has_offset[match]) {
        twin->has_offset[match] = true;
        twin->offsets[match] =
            found->delay - (twin->delay.state != TL_DELAY_UNKNOWN ? twin->delay.delay : twin->measure.start);
    }
    return needs_one ? twin->offsets[match] : 0;
}

/* Uses the delay of the first matched output that knows it. If none knows it, uses one that has
 * lost it. */
static void choose_delay(tl_twin *twin) {
    tl_twin_delay best = {.state = TL_DELAY_UNKNOWN, .confidence = 0.0};
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        tl_delay_measured found = tl_delay_meter_get(twin->meters[i]);
        tl_delay_state state = !found.known ? TL_DELAY_UNKNOWN : found.lost ? TL_DELAY_LOST : TL_DELAY_KNOWN;
        found.delay -= find_offset(twin, i, &found);
        bool better = state == TL_DELAY_KNOWN ? best.state != TL_DELAY_KNOWN : best.state == TL_DELAY_UNKNOWN;
        if (better && (state != TL_DELAY_UNKNOWN || found.confidence >= best.confidence)) {
            best = (tl_twin_delay){.state = state, .delay = found.delay, .confidence = found.confidence};
        }
    }
    if (best.state == TL_DELAY_LOST) {
        best.delay = twin->delay.delay;
    }
    bool changed = best.state != TL_DELAY_UNKNOWN && best.delay != twin->delay.delay;
    bool first = best.state != TL_DELAY_UNKNOWN && twin->delay.state == TL_DELAY_UNKNOWN;
    twin->delay = best;
    if ((changed || first) && !twin->measure.is_unused) {
        use_delay(twin);
    }
}

/* The older released twin is not corrected, so it shows the delay also in lock; but not across a
 * change to the other one. */
static void __attribute__((noinline)) measure_delay(tl_twin *twin, tl_record *record) {
    uint32_t age = twin->released_twin.state == TL_RELEASED_ON ? record->release_age : 0;
    const double *y = age != 0 ? record->released : record->y;
    bool free = age != 0 ? age == twin->measured_age + 1
                         : is_free(twin, record) && (record->flags & TL_FLAG_RESET) == 0 && twin->measured_age == 0;
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        tl_delay_meter_step(twin->meters[i], record->step + 1, y[i], free);
    }
    twin->measured_age = age;
    choose_delay(twin);
    record->delay_state = twin->delay.state;
    record->delay = twin->delay.delay;
}

/* ---- records ---- */

/* The readings that fell into a step. */
static void record_readings(tl_twin *twin, size_t match, tl_record *record) {
    tl_metrics *due = &twin->due[match];
    if (twin->readers[match] != NULL) {
        tl_time end = tl_time_of_step(0, twin->step, record->step + 1);
        bool continues = (record->flags & TL_FLAG_RESET) == 0;
        tl_reading_meter_step(twin->readers[match], end, record->y[match], continues, due);
    }
    record->readings[match] = (tl_record_readings){
        .count = (uint32_t)due->pairs, .rejected = (uint32_t)due->left_out, .squares = due->sum_of_squares};
    tl_metrics_join(&twin->readings[match], due);
    *due = (tl_metrics){0};
}

/* Not inlined: a free twin matches nothing. */
static void __attribute__((noinline)) record_match(tl_twin *twin, size_t match, tl_record *record) {
    tl_quality quality;
    record->measured[match] = tl_objective_measured(&twin->synchroniser.objective, match, record->step + 1, &quality);
    record->measured_quality[match] = (uint8_t)quality;
    tl_metrics_add(&twin->metrics[match], record->y[match], record->measured[match], quality);
    record_readings(twin, match, record);
}

/* Completes a record with the measurement of its instant. */
static void complete_record(tl_twin *twin, tl_record *record) {
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        record_match(twin, i, record);
    }
    record->delay_state = twin->delay.state;
    record->delay = twin->delay.delay;
    if (twin->measure.lags != 0 && twin->released_twin.state != TL_RELEASED_ON) {
        measure_delay(twin, record);
    }
}

static uint64_t count_executions(const tl_twin *twin) {
    return twin->exchange.executions + twin->exchange.plant.executions;
}

/* How a tick's step is computed. */
typedef struct tick_mode {
    const tl_budget *budget; /* budget of the search; NULL: no search */
    bool follows;            /* an earlier run, */
    const double *u;         /* with this committed u; NULL if nothing is adjusted. Else the tick was missed */
} tick_mode;

/* As a followed step, with nominal u: a saved start of a stroke is dropped. */
static tl_status step_free_by_event(tl_twin *twin, int64_t step, tl_record *record, tl_error *error) {
    bool was_abandoned = tl_event_horizon_reset(twin->event);
    tl_status status =
        tl_event_horizon_follow(twin->event, step, tl_exchange_nominal(&twin->exchange, 0), record, error);
    record->outcome = TL_FREE_RUN;
    record->flags |= was_abandoned ? (uint32_t)TL_FLAG_ABANDONED : 0U;
    return status;
}

static tl_status step_by_event(tl_twin *twin, int64_t step, const tick_mode *mode, tl_record *record, tl_error *error) {
    if (twin->synchroniser.runs_free && !mode->follows) {
        return step_free_by_event(twin, step, record, error);
    }
    return mode->follows ? tl_event_horizon_follow(twin->event, step, mode->u[0], record, error)
                         : tl_event_horizon_step(twin->event, step, mode->budget, record, error);
}

static tl_status step_by(tl_twin *twin, int64_t step, const tick_mode *mode, tl_record *record, tl_error *error) {
    if (twin->event != NULL) {
        return step_by_event(twin, step, mode, record, error);
    }
    if (mode->follows) {
        return tl_synchroniser_follow(&twin->synchroniser, step, mode->u, record, error);
    }
    return mode->budget == NULL ? tl_synchroniser_catch_up(&twin->synchroniser, step, record, error)
                                : tl_synchroniser_step(&twin->synchroniser, step, mode->budget, record, error);
}

/* Checks whether a rollback is possible for a whole search. If not, the twin runs free: nothing is
 * searched or verified. */
static void check_rollback(tl_twin *twin, int64_t step, uint32_t *flags) {
    bool searches = twin->synchroniser.horizon.variables != 0;
    const tl_component *free =
        searches ? tl_exchange_find_not_restorable(&twin->exchange, step, horizon_steps(twin)) : NULL;
    if (free != NULL && !twin->synchroniser.runs_free) {
        tl_verifier_abandon(&twin->verifier);
    }
    twin->synchroniser.runs_free = free != NULL;
    twin->runs_free = free != NULL ? free->name : NULL;
    *flags |= free != NULL ? (uint32_t)TL_FLAG_NO_ROLLBACK : 0U;
}

/* Computes one step. */
static tl_status compute_step(tl_twin *twin, int64_t step, const tick_mode *mode, tl_record *record, tl_error *error) {
    uint64_t before = count_executions(twin);
    uint32_t flags = 0;
    tl_start_due due = tl_twin_is_starting(twin) ? tl_start_values_look(twin, step) : TL_START_NOTHING;
    bool resets = twin->resets || due != TL_START_NOTHING;
    tl_status status = resets ? reset_twin(twin, step, due, &record->found, &flags, error) : TL_OK;
    if (status == TL_OK) {
        check_rollback(twin, step, &flags);
        status = step_by(twin, step, mode, record, error);
        record->flags |= flags | twin->marks | twin->lasting;
        twin->marks = 0;
        record->bad_outputs = find_bad_outputs(twin) | twin->bad_at_start;
        record->flags |= record->bad_outputs != 0 ? (uint32_t)TL_FLAG_NOT_FINITE : 0U;
        twin->bad_at_start = 0;
    }
    if (status == TL_OK && !twin->synchroniser.runs_free) {
        tl_verifier_committed(&twin->verifier, step);
    }
    record->executions = (uint32_t)(count_executions(twin) - before);
    record->used = 0;
    return status;
}

/* Both released twins continue in parallel. If the delay that they show is used, they affect the
 * twin. Then they never end for lack of time, so that a replay does the same. */
static tl_status follow_released_twin(tl_twin *twin, const tick_mode *mode, tl_record *record, tl_error *error) {
    bool measures = twin->measure.lags != 0 && twin->released_twin.state == TL_RELEASED_ON;
    const tl_budget *budget = measures && !twin->measure.is_unused ? NULL : mode->budget;
    bool decides = budget != NULL && !budget->unrecorded;
    tl_status status = tl_released_twin_follow(&twin->released_twin, record, decides ? budget->now : NULL,
                                               decides ? budget->context : NULL, error);
    for (size_t i = 0; record->release_age != 0 && i < twin->synchroniser.objective.term_count; i++) {
        tl_metrics_add(&twin->released[i], record->released[i], record->measured[i],
                       (tl_quality)record->measured_quality[i]);
    }
    if (status == TL_OK && measures) {
        measure_delay(twin, record);
    }
    return status;
}

/* The free-running twin continues in parallel; from the next step on u may rest, or the twin
 * continue from there. */
static tl_status follow_free_twin(tl_twin *twin, const tl_record *record, tl_error *error) {
    if (!twin->free_twin.is_enabled) {
        return TL_OK;
    }
    tl_free_run_check_verdict verdict;
    tl_status status = tl_free_twin_follow(&twin->free_twin, record, &verdict, error);
    twin->synchroniser.rests = tl_free_twin_rests(&twin->free_twin);
    if (status != TL_OK || !verdict.adopt) {
        return status;
    }
    tl_verifier_abandon(&twin->verifier);
    tl_synchroniser_forget_course(&twin->synchroniser);
    return tl_exchange_reset(&twin->exchange, record->step + 1, error);
}

/* The released twins first: the free-running twin may change the state of the twin. */
static tl_status follow_side_twins(tl_twin *twin, const tick_mode *mode, tl_record *record, tl_error *error) {
    tl_status status = follow_released_twin(twin, mode, record, error);
    return status == TL_OK ? follow_free_twin(twin, record, error) : status;
}

/* A reading in the sample, at the twin's own time. */
static void see_reading(tl_twin *twin, const tl_sample *sample, size_t match) {
    const tl_objective_term *term = &twin->terms[match];
    size_t signal = twin->reading_signals[match];
    tl_time start = sample->instant - tl_time_of_step(0, twin->step, sample->tick);
    if (sample->stamps[signal] != TL_TIME_NEVER) {
        tl_time late = tl_time_of_step(0, twin->step, term->shift) - twin->look_back;
        double value = term->conversion.factor * sample->values[signal] + term->conversion.offset;
        tl_reading_meter_add_reading(twin->readers[match], sample->stamps[signal] - start - late, value,
                                     (tl_quality)sample->quality[signal], &twin->due[match]);
    }
}

/* Passes the sample to the meters of one match. */
static void __attribute__((noinline)) see_sample(tl_twin *twin, const tl_sample *sample, size_t match) {
    const tl_objective_term *term = &twin->terms[match];
    if (twin->readers[match] != NULL) {
        see_reading(twin, sample, match);
    }
    if (twin->meters[match] != NULL && sample->stamps[term->signal] != TL_TIME_NEVER) {
        tl_time start = sample->instant - tl_time_of_step(0, twin->step, sample->tick);
        tl_delay_meter_see(twin->meters[match], sample->stamps[term->signal] - start, sample->values[term->signal],
                           sample->quality[term->signal] == TL_GOOD);
    }
}

/* Passes the sample to the plant and to all meters. */
static void push_sample(tl_twin *twin, const tl_sample *sample) {
    tl_plant_push(&twin->exchange.plant, sample);
    for (size_t i = 0; i < twin->synchroniser.objective.term_count; i++) {
        see_sample(twin, sample, i);
    }
}

/* In mode ahead: completes the step computed a tick ago. */
static void complete_pending(tl_twin *twin, tl_record *record, bool *ready) {
    *record = twin->pending;
    complete_record(twin, record);
    *ready = true;
    twin->has_pending = false;
}

static tl_status advance_tick(tl_twin *twin, const tl_sample *sample, const tick_mode *mode, tl_record *record,
                              bool *ready, tl_error *error) {
    push_sample(twin, sample);
    if (sample->tick == twin->begin) {
        tl_status status = start_twin(twin, mode->budget, error);
        if (status != TL_OK) {
            return status;
        }
    }
    bool ahead = twin->measurements == TL_AHEAD;
    if (twin->has_pending) {
        complete_pending(twin, record, ready);
        tl_synchroniser_refresh(&twin->synchroniser, record->step + 1);
        tl_status status = follow_side_twins(twin, mode, record, error);
        if (status != TL_OK) {
            return status;
        }
    }
    int64_t step = sample->tick - (int64_t)twin->lead;
    if (step < twin->first) {
        return TL_OK;
    }
    tl_record *computed = ahead ? &twin->pending : record;
    tl_status status = compute_step(twin, step, mode, computed, error);
    if (status != TL_OK) {
        return status;
    }
    twin->has_pending = ahead;
    if (!ahead) {
        complete_record(twin, record);
        *ready = true;
        status = follow_side_twins(twin, mode, record, error);
    }
    if (status == TL_OK && mode->budget != NULL && mode->budget->now != NULL) {
        computed->used = tl_synchroniser_end_step(&twin->synchroniser, mode->budget);
    }
    computed->predicted = (uint32_t)tl_ledger_evaluate(&twin->synchroniser.ledger);
    return status;
}

static tl_status run_tick(tl_twin *twin, const tl_sample *sample, const tick_mode *mode, tl_record *record, bool *ready,
                          tl_error *error) {
    *ready = false;
    if (twin->ended != TL_OK) {
        return tl_fail(error, twin->ended, "the twin has ended with an earlier failure of an FMU: build a new one");
    }
    assert(sample->tick == twin->exchange.plant.newest + 1);
    twin->ended = advance_tick(twin, sample, mode, record, ready, error);
    return twin->ended;
}

tl_status tl_twin_step(tl_twin *twin, const tl_sample *sample, const tl_budget *budget, tl_record *record, bool *ready,
                       tl_error *error) {
    const tick_mode searched = {.budget = budget};
    return run_tick(twin, sample, &searched, record, ready, error);
}

tl_status tl_twin_catch_up(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready, tl_error *error) {
    const tick_mode caught_up = {0};
    return run_tick(twin, sample, &caught_up, record, ready, error);
}

tl_status tl_twin_follow(tl_twin *twin, const tl_sample *sample, const double *u, tl_record *record, bool *ready,
                         tl_error *error) {
    const tick_mode followed = {.follows = true, .u = u};
    return run_tick(twin, sample, &followed, record, ready, error);
}

void tl_twin_finish(tl_twin *twin, const tl_sample *sample, tl_record *record, bool *ready) {
    *ready = false;
    if (twin->has_pending) {
        push_sample(twin, sample);
        complete_pending(twin, record, ready);
    }
}

/* ---- the end ---- */

bool tl_twin_has_dead_fmu(const tl_twin *twin, const tl_component *component) {
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        const tl_component *other = &twin->graph.components[i];
        if (other->fmi == component->fmi && other->mode == TL_MODE_DEAD) {
            return true;
        }
    }
    return false;
}

void tl_twin_destroy(tl_twin *twin) {
    if (twin == NULL) {
        return;
    }
    for (size_t i = 0; i < twin->graph.component_count; i++) {
        if (!tl_twin_has_dead_fmu(twin, &twin->graph.components[i])) {
            tl_exchange_end_component(&twin->exchange, i);
            tl_event_horizon_forget(twin->event, i);
            tl_twin_end_other_states(twin, i);
        }
        if (!tl_twin_has_dead_fmu(twin, &twin->graph.components[i])) {
            tl_component_free(&twin->graph.components[i]);
        }
    }
    tl_event_horizon_end(twin->event);
    tl_synchroniser_end(&twin->synchroniser);
    tl_arena arena = twin->arena;
    tl_arena_release(&arena);
}
