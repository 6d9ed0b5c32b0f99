/* Verification of restored states, and the cause of a difference: see verifier.h. */
#include "master/sync/verifier.h"

#include <string.h>

/* ---- restore cause ---- */

/* Of an input. */
static const double INPUT_CHANGE = 0.05;

static unsigned char *outputs_of(const tl_restore_trial *trial, unsigned place) {
    return trial->outputs + place * trial->output_bytes;
}

const char *tl_restore_cause_text(tl_restore_cause cause) {
    static const char *const texts[TL_RESTORE_CAUSES] = {
        [TL_CAUSE_UNKNOWN] = "",
        [TL_CAUSE_UNSTEADY] = "not steady: two runs from one copy of its memory differ",
        [TL_CAUSE_COLD] = "cold solver: it differs even if it is restored at once",
        [TL_CAUSE_PARAMETERS] = "parameters kept: it differs if a value was set after the save",
        [TL_CAUSE_INCOMPLETE] = "incomplete state: it is exact if restored at once, and differs after other steps",
        [TL_CAUSE_ONE_STATE] = "one handle only: it differs if a second state was saved",
        [TL_CAUSE_EVENTS] =
            "events lost: it is exact after other steps, and differs after steps with large input changes",
        [TL_CAUSE_LATE] = "refuses late: it could be saved before, and cannot now",
        [TL_CAUSE_REFUSES] = "",
        [TL_CAUSE_FINAL] =
            "final steps: it differs after a step without later rollback (noSetFMUStatePriorToCurrentPoint)"};
    return texts[cause];
}

/* ---- experiments ---- */

/* Each Real input plus a twentieth. */
static void move_inputs(const tl_component *component) {
    const tl_ports *inputs = &component->inputs;
    for (size_t i = 0; i < inputs->real_count; i++) {
        inputs->reals[i] += INPUT_CHANGE * (inputs->reals[i] < 0.0 || inputs->reals[i] > 0.0 ? inputs->reals[i] : 1.0);
    }
}

static void write_inputs(const tl_restore_trial *trial, const unsigned char *inputs, unsigned step) {
    tl_ports_write(&trial->component->inputs, inputs + step * trial->input_bytes);
}

static tl_status take_step(const tl_restore_trial *trial, int64_t step, tl_error *error) {
    tl_time at = tl_time_of_step(0, trial->macro_step, step);
    return tl_component_step(trial->component, tl_seconds(at), tl_seconds(trial->macro_step), false, error);
}

/* *same NULL: notes the outputs; else whether they are equal to the noted ones. */
static tl_status take_steps(const tl_restore_trial *trial, bool *same, tl_error *error) {
    tl_component *component = trial->component;
    tl_status status = TL_OK;
    for (unsigned i = 0; i < trial->steps && status == TL_OK; i++) {
        write_inputs(trial, trial->inputs, i);
        status = take_step(trial, trial->step + i, error);
        tl_ports_read(&component->outputs, outputs_of(trial, same == NULL ? i : trial->steps));
        if (same != NULL) {
            *same = *same && memcmp(outputs_of(trial, trial->steps), outputs_of(trial, i),
                                    tl_ports_size(&component->outputs)) == 0;
        }
    }
    return status;
}

/* What happens between save and restore. */
typedef enum between { NOTHING, VALUES, NEAR, STATE, FAR } between;

static tl_status set_values(const tl_restore_trial *trial, tl_error *error) {
    write_inputs(trial, trial->inputs, 0);
    move_inputs(trial->component);
    return tl_component_set_inputs(trial->component, error);
}

/* It may fail, as any candidate may. */
static tl_status step_between(const tl_restore_trial *trial, between between_calls, tl_error *error) {
    tl_status status = TL_OK;
    for (unsigned i = 0; i < trial->steps && status == TL_OK; i++) {
        write_inputs(trial, between_calls == FAR ? trial->distant_inputs : trial->inputs, i);
        if (between_calls == NEAR) {
            move_inputs(trial->component);
        }
        status = take_step(trial, trial->step + i, error);
    }
    return status == TL_FMU_FAILED ? TL_OK : status;
}

static tl_status run_between(const tl_restore_trial *trial, between between_calls, fmi2FMUstate *second,
                             tl_error *error) {
    tl_status status = TL_OK;
    if (between_calls == VALUES) {
        return set_values(trial, error);
    }
    if (between_calls == NEAR || between_calls == FAR || between_calls == STATE) {
        status = step_between(trial, between_calls, error);
    }
    return status == TL_OK && between_calls == STATE ? tl_component_save(trial->component, second, error) : status;
}

static tl_status restore_copy(const tl_restore_trial *trial, tl_error *error) {
    return tl_component_restore_copy(trial->component, NULL)
               ? TL_OK
               : tl_fail(error, TL_FMU_FAILED, "%s: its state cannot be restored", trial->component->name);
}

/* Saves, executes that, restores, and compares. The caller's handle is valid again once the FMU is
 * restored; others are freed. */
static tl_status test_restore(const tl_restore_trial *trial, between between_calls, bool *same, tl_error *error) {
    tl_component *component = trial->component;
    fmi2FMUstate state = trial->state;
    fmi2FMUstate second = NULL;
    tl_status status = tl_component_save(component, &state, error);
    status = status == TL_OK ? run_between(trial, between_calls, &second, error) : status;
    status = status == TL_OK ? tl_component_restore(component, state, error) : status;
    status = status == TL_OK ? take_steps(trial, same, error) : status;
    tl_component_forget(component, &second);
    if (trial->state == NULL) {
        tl_component_forget(component, &state);
    }
    return status;
}

/* Experiments in this order: the first that differs is the cause. */
static tl_status run_experiment(const tl_restore_trial *trial, tl_restore_cause which, bool *same, tl_error *error) {
    static const between actions[TL_RESTORE_CAUSES] = {[TL_CAUSE_COLD] = NOTHING,
                                                       [TL_CAUSE_PARAMETERS] = VALUES,
                                                       [TL_CAUSE_INCOMPLETE] = NEAR,
                                                       [TL_CAUSE_ONE_STATE] = STATE,
                                                       [TL_CAUSE_EVENTS] = FAR};
    if (which == TL_CAUSE_EVENTS && trial->distant_inputs == NULL) {
        return TL_OK;
    }
    return which == TL_CAUSE_UNSTEADY ? take_steps(trial, same, error)
                                      : test_restore(trial, actions[which], same, error);
}

tl_status tl_restore_cause_find(const tl_restore_trial *trial, tl_restore_cause *cause, tl_error *error) {
    tl_error ignored;
    *cause = TL_CAUSE_UNKNOWN;
    tl_status status = take_steps(trial, NULL, error);
    bool failed = status == TL_FMU_FAILED; /* says nothing about a restore */
    status = status == TL_FMU_FATAL ? status : restore_copy(trial, error);
    for (tl_restore_cause which = TL_CAUSE_UNSTEADY;
         which <= TL_CAUSE_EVENTS && status == TL_OK && !failed && *cause == TL_CAUSE_UNKNOWN; which++) {
        bool same = true;
        tl_status tried = run_experiment(trial, which, &same, &ignored);
        *cause = same && tried == TL_OK ? TL_CAUSE_UNKNOWN : which;
        status = tried == TL_FMU_FATAL ? tl_fail(error, tried, "%s", ignored.text) : restore_copy(trial, error);
    }
    return status;
}

/* ---- verifier ---- */

/* Entries: the noted steps, those of the candidate, the repeated outputs, and the port values
 * between two ticks. */
enum { TRIED = TL_VERIFIED_STEPS, AGAIN = 2 * TL_VERIFIED_STEPS, PRESENT, ENTRIES };

/* States of each component: the earlier one, and the present one. */
enum { STATES = 2 };

/* Largest copy of an FMU, including its states, that is made only for verification. Dymola's 13 MiB
 * are below it. */
static const size_t MOST_COPIED = (size_t)16 << 20;

static size_t greater(size_t a, size_t b) {
    return a > b ? a : b;
}

bool tl_verifier_init(tl_verifier *verifier, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph,
                      uint32_t every) {
    *verifier = (tl_verifier){.exchange = exchange, .graph = graph, .every = every};
    if (every == 0) {
        return true;
    }
    exchange->extra_states += STATES;
    for (size_t i = 0; i < exchange->component_count; i++) {
        verifier->input_bytes = greater(verifier->input_bytes, tl_ports_size(&exchange->components[i].inputs));
        verifier->output_bytes = greater(verifier->output_bytes, tl_ports_size(&exchange->components[i].outputs));
    }
    verifier->verified = tl_arena_take(arena, exchange->component_count, sizeof *verifier->verified);
    verifier->inputs = tl_arena_take(arena, ENTRIES, verifier->input_bytes + 1);
    verifier->outputs = tl_arena_take(arena, ENTRIES, verifier->output_bytes + 1);
    return verifier->verified != NULL && verifier->inputs != NULL && verifier->outputs != NULL;
}

static tl_component *present_component(const tl_verifier *verifier) {
    return &verifier->exchange->components[verifier->component];
}

static unsigned char *inputs_of(const tl_verifier *verifier, size_t place) {
    return verifier->inputs + place * verifier->input_bytes;
}

static unsigned char *verifier_outputs(const tl_verifier *verifier, size_t place) {
    return verifier->outputs + place * verifier->output_bytes;
}

/* ---- turns ---- */

static void enter_phase(tl_verifier *verifier, tl_verifier_phase phase) {
    verifier->phase = phase;
    verifier->waited = 0;
}

/* The next committed step is noted, and the last candidate. */
static void note_next(tl_verifier *verifier) {
    verifier->note.component = verifier->component;
    verifier->note.inputs = inputs_of(verifier, verifier->noted);
    verifier->note.outputs = verifier_outputs(verifier, verifier->noted);
    verifier->exchange->note = &verifier->note;
}

static void end_turn(tl_verifier *verifier) {
    verifier->exchange->note = NULL;
    tl_exchange_keep_from(verifier->exchange, verifier->component, false);
    enter_phase(verifier, TL_VERIFIER_PAUSES);
    verifier->component = (verifier->component + 1) % verifier->exchange->component_count;
}

void tl_verifier_abandon(tl_verifier *verifier) {
    if (verifier->every != 0) {
        end_turn(verifier);
    }
}

void tl_verifier_end_component(tl_verifier *verifier, size_t component) {
    if (verifier->verified != NULL) {
        tl_component *one = &verifier->exchange->components[component];
        tl_component_forget(one, &verifier->verified[component].earlier);
        tl_component_forget(one, &verifier->verified[component].full_copy);
        tl_component_drop_copy(one);
        tl_verifier_abandon(verifier);
    }
}

void tl_verifier_exclude(tl_verifier *verifier, size_t component) {
    verifier->verified[component].differs = true;
}

void tl_verifier_committed(tl_verifier *verifier, int64_t step) {
    if (verifier->every == 0) {
        return;
    }
    verifier->waited++;
    if (verifier->phase == TL_VERIFIER_PAUSES && verifier->waited >= verifier->every) {
        enter_phase(verifier, TL_VERIFIER_BEGINS);
    } else if (verifier->phase == TL_VERIFIER_NOTES) {
        verifier->first = verifier->noted == 0 ? step : verifier->first;
        if (++verifier->noted < TL_VERIFIED_STEPS) {
            note_next(verifier);
        } else {
            verifier->exchange->note = NULL;
            enter_phase(verifier, TL_VERIFIER_REPEATS);
        }
    } else if (verifier->phase != TL_VERIFIER_PAUSES && verifier->waited >= verifier->every) {
        end_turn(
            verifier); /* there was no time for so long, or its state is not available: the next component's turn */
    }
}

/* ---- rollback and return ---- */

/* The present state, to be restored. */
static tl_status keep_present(tl_verifier *verifier, bool *is_kept, tl_error *error) {
    *is_kept = tl_component_copy_size(present_component(verifier)) <= MOST_COPIED &&
               tl_component_save_copy(present_component(verifier));
    return *is_kept ? TL_OK
                    : tl_component_save(present_component(verifier), &verifier->verified[verifier->component].full_copy,
                                        error);
}

static tl_status restore_present(tl_verifier *verifier, bool is_kept, tl_error *error) {
    if (is_kept && tl_component_restore_copy(present_component(verifier), NULL)) {
        return TL_OK;
    }
    return is_kept
               ? tl_fail(error, TL_FMU_FAILED, "%s: its state cannot be restored", present_component(verifier)->name)
               : tl_component_restore(present_component(verifier), verifier->verified[verifier->component].full_copy,
                                      error);
}

/* Only own states can lack an internal variable. */
static uint64_t hash_component(const tl_verifier *verifier) {
    tl_component *component = present_component(verifier);
    return component->fmi->always_final ? 0 : tl_component_hash(component);
}

/* Creates the states of one component and measures the duration of a rollback. */
static tl_status measure_rollback(tl_verifier *verifier, tl_error *error) {
    fmi2FMUstate *earlier = &verifier->verified[verifier->component].earlier;
    bool is_kept = false;
    tl_status status = tl_component_save(present_component(verifier), earlier, error);
    status = status == TL_OK ? keep_present(verifier, &is_kept, error) : status;
    status = status == TL_OK ? tl_component_restore(present_component(verifier), *earlier, error) : status;
    (void)hash_component(verifier);
    return status == TL_OK ? restore_present(verifier, is_kept, error) : status;
}

tl_status tl_verifier_start(tl_verifier *verifier, const tl_budget *budget, tl_error *error) {
    bool has_clock = budget != NULL && budget->now != NULL;
    tl_status status = TL_OK;
    size_t count = verifier->every != 0 ? verifier->exchange->component_count : 0;
    for (size_t i = 0; i < count && status == TL_OK; i++) {
        verifier->component = i;
        status = measure_rollback(verifier, error); /* the first run takes longest and is not typical */
        tl_time started_at = has_clock ? budget->now(budget->context) : 0;
        status = status == TL_OK ? measure_rollback(verifier, error) : status;
        verifier->verified[i].there_and_back = has_clock ? budget->now(budget->context) - started_at : 0;
    }
    verifier->component = 0;
    return status;
}

/* ---- a turn ---- */

static bool has_time(const tl_verifier *verifier, const tl_budget *budget, tl_time steps) {
    if (budget->now == NULL) {
        return true;
    }
    tl_time need = verifier->verified[verifier->component].there_and_back +
                   (steps == 0 ? 0 : tl_exchange_cost(verifier->exchange, steps));
    return budget->now(budget->context) - budget->started + TL_VERIFIER_RESERVE * need < budget->time;
}

/* An excluded component, or one that a candidate has made fail, has no turn. */
static tl_status begin_turn(tl_verifier *verifier, const tl_budget *budget, tl_error *error) {
    tl_verified *one = &verifier->verified[verifier->component];
    bool taken = false;
    if (one->differs) {
        end_turn(verifier);
        return TL_OK;
    }
    if (!has_time(verifier, budget, 0)) {
        return TL_OK;
    }
    tl_status status =
        tl_exchange_copy_state(verifier->exchange, verifier->component, &one->earlier, &one->full_copy, &taken, error);
    if (status == TL_OK && taken) {
        verifier->noted = 0;
        verifier->note = (tl_exchange_note){
            .tried = inputs_of(verifier, TRIED), .tried_bytes = verifier->input_bytes, .tried_most = TL_VERIFIED_STEPS};
        note_next(verifier);
        tl_exchange_keep_from(verifier->exchange, verifier->component, true);
        enter_phase(verifier, TL_VERIFIER_NOTES);
    }
    return status;
}

/* Finds the first output that differs from the noted one. After a difference, the ports have the
 * noted outputs. */
static bool differs(const tl_verifier *verifier, size_t place, tl_verifier_finding *finding) {
    const tl_exchange *exchange = verifier->exchange;
    const tl_ports *outputs = &present_component(verifier)->outputs;
    unsigned char *again = verifier_outputs(verifier, AGAIN);
    tl_ports_read(outputs, again);
    if (memcmp(again, verifier_outputs(verifier, place), tl_ports_size(outputs)) == 0) {
        return false;
    }
    for (size_t i = 0; i < verifier->graph->port_count; i++) {
        const tl_port *port = &verifier->graph->ports[i];
        if (port->variable == NULL || port->input || port->node != verifier->component) {
            continue;
        }
        tl_ports_write(outputs, again);
        finding->again = tl_exchange_value(exchange, port);
        tl_ports_write(outputs, verifier_outputs(verifier, place));
        finding->committed = tl_exchange_value(exchange, port);
        if (memcmp(&finding->again, &finding->committed, sizeof finding->again) != 0) {
            finding->port = port;
            break;
        }
    }
    return true;
}

/* Saves the state again and restores it at once: a solver that a restore restarts differs then. The
 * earlier instant is not needed any more. */
static tl_status interrupt(const tl_verifier *verifier, tl_error *error) {
    tl_component *component = present_component(verifier);
    fmi2FMUstate *earlier = &verifier->verified[verifier->component].earlier;
    tl_status status = tl_component_save(component, earlier, error);
    return status == TL_OK ? tl_component_restore(component, *earlier, error) : status;
}

typedef enum run_kind { NOTES, COMPARES, COMPARES_INTERRUPTED } run_kind;

/* Executes steps from the earlier state, with the inputs and outputs from entry `from` on. Notes
 * the outputs; or a difference is a finding. */
static tl_status execute_from(tl_verifier *verifier, size_t from, run_kind kind, tl_verifier_finding *finding,
                              bool *found, tl_error *error) {
    tl_component *component = present_component(verifier);
    tl_exchange *exchange = verifier->exchange;
    *finding = (tl_verifier_finding){.component = verifier->component, .step = verifier->first};
    tl_status status = tl_component_restore(component, verifier->verified[verifier->component].earlier, error);
    for (unsigned i = 0; i < TL_VERIFIED_STEPS && status == TL_OK && !*found; i++) {
        int64_t step = verifier->first + i;
        status = i == 1 && kind == COMPARES_INTERRUPTED ? interrupt(verifier, error) : TL_OK;
        finding->step = step;
        finding->after = i + 1;
        tl_ports_write(&component->inputs, inputs_of(verifier, from + i));
        status = status == TL_OK ? tl_component_step(component, tl_seconds(tl_time_of_step(0, exchange->step, step)),
                                                     exchange->step_s, false, error)
                                 : status;
        if (status == TL_OK && kind == NOTES) {
            tl_ports_read(&component->outputs, verifier_outputs(verifier, from + i));
        }
        *found = status == TL_OK && kind != NOTES && differs(verifier, from + i, finding);
    }
    if (status == TL_FMU_FAILED && kind != NOTES) {
        finding->cause = TL_CAUSE_REFUSES;
        *found = true;
    }
    return status;
}

/* Steps without a candidate get the committed inputs, changed a little. */
static void complete_candidate(const tl_verifier *verifier) {
    const tl_ports *inputs = &present_component(verifier)->inputs;
    for (size_t i = verifier->note.tried_count; i < TL_VERIFIED_STEPS; i++) {
        tl_ports_write(inputs, inputs_of(verifier, i));
        move_inputs(present_component(verifier));
        tl_ports_read(inputs, inputs_of(verifier, TRIED + i));
    }
}

/* Executes the committed steps between two runs of the candidate. If the FMU rejects the candidate
 * the first time, there is no finding; if only the second time, that is a finding. */
static tl_status execute_all(tl_verifier *verifier, tl_verifier_finding *finding, bool *found, tl_error *error) {
    complete_candidate(verifier);
    tl_status candidate = execute_from(verifier, TRIED, NOTES, finding, found, error);
    if (candidate == TL_FMU_FATAL) {
        return candidate;
    }
    uint64_t hash = candidate == TL_OK ? hash_component(verifier) : 0;
    tl_status status = execute_from(verifier, 0, COMPARES, finding, found, error);
    if (candidate == TL_OK && status == TL_OK && !*found) {
        status = execute_from(verifier, TRIED, COMPARES_INTERRUPTED, finding, found, error);
    }
    if (candidate == TL_OK && status == TL_OK && !*found) {
        uint64_t again = hash_component(verifier);
        *found = hash != 0 && again != 0 && again != hash;
    }
    return status;
}

static tl_status execute_again(tl_verifier *verifier, bool with_candidate, tl_verifier_finding *finding, bool *found,
                               tl_error *error) {
    tl_status status = with_candidate ? execute_all(verifier, finding, found, error)
                                      : execute_from(verifier, 0, COMPARES, finding, found, error);
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* Overwrites the noted outputs, which are not needed any more. */
static tl_status find_cause(tl_verifier *verifier, tl_restore_cause *cause, tl_error *error) {
    const tl_restore_trial trial = {
        .component = present_component(verifier),
        .macro_step = verifier->exchange->step,
        .step = verifier->first + TL_VERIFIED_STEPS,
        .steps = TL_VERIFIED_STEPS,
        .state = verifier->verified[verifier->component].earlier,
        .inputs = verifier->inputs,
        .input_bytes = verifier->input_bytes,
        .outputs = verifier->outputs,
        .output_bytes = verifier->output_bytes,
    };
    return tl_restore_cause_find(&trial, cause, error);
}

static void count_turn(tl_verifier *verifier, uint64_t executions, bool found) {
    tl_component *component = present_component(verifier);
    verifier->counts.executions += component->executions - executions;
    verifier->counts.turns++;
    verifier->counts.found += found ? 1 : 0;
    component->executions = executions;
}

/* Restores the component's values and count as well. */
static tl_status repeat_steps(tl_verifier *verifier, const tl_budget *budget, tl_verifier_finding *finding, bool *found,
                              tl_error *error) {
    tl_component *component = present_component(verifier);
    uint64_t executions = component->executions;
    bool is_kept = false;
    bool with_candidate = has_time(verifier, budget, TL_VERIFIED_EXECUTIONS);
    if (!with_candidate && !has_time(verifier, budget, TL_VERIFIED_STEPS)) {
        return TL_OK;
    }
    tl_status status = keep_present(verifier, &is_kept, error);
    if (status != TL_OK) {
        return status;
    }
    tl_ports_read(&component->inputs, inputs_of(verifier, PRESENT));
    tl_ports_read(&component->outputs, verifier_outputs(verifier, PRESENT));
    status = execute_again(verifier, with_candidate, finding, found, error);
    status = status == TL_OK ? restore_present(verifier, is_kept, error) : status;
    if (status == TL_OK && *found && finding->cause != TL_CAUSE_REFUSES && is_kept && budget->now == NULL) {
        status = find_cause(verifier, &finding->cause, error);
    }
    tl_ports_write(&component->inputs, inputs_of(verifier, PRESENT));
    tl_ports_write(&component->outputs, verifier_outputs(verifier, PRESENT));
    count_turn(verifier, executions, *found);
    end_turn(verifier);
    return status;
}

tl_status tl_verifier_continue(tl_verifier *verifier, const tl_budget *budget, tl_verifier_finding *finding,
                               bool *found, tl_error *error) {
    *found = false;
    if (verifier->every == 0) {
        return TL_OK;
    }
    if (verifier->phase == TL_VERIFIER_BEGINS) {
        return begin_turn(verifier, budget, error);
    }
    return verifier->phase == TL_VERIFIER_REPEATS ? repeat_steps(verifier, budget, finding, found, error) : TL_OK;
}
