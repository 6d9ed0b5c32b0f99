/* Whether FMUs still come back to where they were: see verifier.h. */
#include "master/sync/verifier.h"

#include <string.h>

/* Places beside those of the steps that are noted: what a step gives again, and what is in the ports between two ticks. */
enum { AGAIN = TL_VERIFIED_STEPS, PRESENT, PLACES };

/* States that it keeps of each component: the earlier one, and where it is. */
enum { STATES = 2 };

/* Bytes of a copy of all that an FMU knows, its states among it, that are taken only to look at it. Dymola's 13 MiB are less. */
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
    exchange->beside += STATES;
    for (size_t i = 0; i < exchange->component_count; i++) {
        verifier->input_bytes = greater(verifier->input_bytes, tl_ports_size(&exchange->components[i].inputs));
        verifier->output_bytes = greater(verifier->output_bytes, tl_ports_size(&exchange->components[i].outputs));
    }
    verifier->verified = tl_arena_take(arena, exchange->component_count, sizeof *verifier->verified);
    verifier->inputs = tl_arena_take(arena, PLACES, verifier->input_bytes + 1);
    verifier->outputs = tl_arena_take(arena, PLACES, verifier->output_bytes + 1);
    return verifier->verified != NULL && verifier->inputs != NULL && verifier->outputs != NULL;
}

static tl_component *at_hand(const tl_verifier *verifier) {
    return &verifier->exchange->components[verifier->component];
}

static unsigned char *inputs_of(const tl_verifier *verifier, size_t place) {
    return verifier->inputs + place * verifier->input_bytes;
}

static unsigned char *outputs_of(const tl_verifier *verifier, size_t place) {
    return verifier->outputs + place * verifier->output_bytes;
}

/* ---- turns ---- */

static void enter(tl_verifier *verifier, tl_verifier_phase phase) {
    verifier->phase = phase;
    verifier->waited = 0;
}

/* The next step that is committed is noted. */
static void note_next(tl_verifier *verifier) {
    verifier->note = (tl_exchange_note){.component = verifier->component,
                                        .inputs = inputs_of(verifier, verifier->noted),
                                        .outputs = outputs_of(verifier, verifier->noted)};
    verifier->exchange->note = &verifier->note;
}

static void end_turn(tl_verifier *verifier) {
    verifier->exchange->note = NULL;
    tl_exchange_keep_from(verifier->exchange, verifier->component, false);
    enter(verifier, TL_VERIFIER_RESTS);
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
        tl_component_forget(one, &verifier->verified[component].aside);
        tl_component_let_go(one);
        tl_verifier_abandon(verifier);
    }
}

void tl_verifier_leave_out(tl_verifier *verifier, size_t component) {
    verifier->verified[component].differs = true;
}

void tl_verifier_committed(tl_verifier *verifier, int64_t step) {
    if (verifier->every == 0) {
        return;
    }
    verifier->waited++;
    if (verifier->phase == TL_VERIFIER_RESTS && verifier->waited >= verifier->every) {
        enter(verifier, TL_VERIFIER_BEGINS);
    } else if (verifier->phase == TL_VERIFIER_NOTES) {
        verifier->first = verifier->noted == 0 ? step : verifier->first;
        if (++verifier->noted < TL_VERIFIED_STEPS) {
            note_next(verifier);
        } else {
            verifier->exchange->note = NULL;
            enter(verifier, TL_VERIFIER_REPEATS);
        }
    } else if (verifier->phase != TL_VERIFIER_RESTS && verifier->waited >= verifier->every) {
        end_turn(verifier); /* there was no time for so long, or its state is not kept: another one's turn */
    }
}

/* ---- there and back ---- */

/* Where it is now, to come back to. */
static tl_status leave(tl_verifier *verifier, bool *is_kept, tl_error *error) {
    *is_kept = tl_component_keeping_takes(at_hand(verifier)) <= MOST_COPIED && tl_component_keep(at_hand(verifier));
    return *is_kept ? TL_OK
                    : tl_component_save(at_hand(verifier), &verifier->verified[verifier->component].aside, error);
}

static tl_status come_back(tl_verifier *verifier, bool is_kept, tl_error *error) {
    if (is_kept && tl_component_come_back(at_hand(verifier), NULL)) {
        return TL_OK;
    }
    return is_kept ? tl_fail(error, TL_FMU_FAILED, "%s: cannot be led to where it was", at_hand(verifier)->name)
                   : tl_component_restore(at_hand(verifier), verifier->verified[verifier->component].aside, error);
}

/* Makes the states of one; how long the way is. */
static tl_status try_way(tl_verifier *verifier, tl_error *error) {
    fmi2FMUstate *earlier = &verifier->verified[verifier->component].earlier;
    bool is_kept = false;
    tl_status status = tl_component_save(at_hand(verifier), earlier, error);
    status = status == TL_OK ? leave(verifier, &is_kept, error) : status;
    status = status == TL_OK ? tl_component_restore(at_hand(verifier), *earlier, error) : status;
    return status == TL_OK ? come_back(verifier, is_kept, error) : status;
}

tl_status tl_verifier_start(tl_verifier *verifier, const tl_budget *budget, tl_error *error) {
    bool has_clock = budget != NULL && budget->now != NULL;
    tl_status status = TL_OK;
    size_t count = verifier->every != 0 ? verifier->exchange->component_count : 0;
    for (size_t i = 0; i < count && status == TL_OK; i++) {
        verifier->component = i;
        status = try_way(verifier, error); /* what is done first takes longest: that is not its time */
        tl_time begun = has_clock ? budget->now(budget->context) : 0;
        status = status == TL_OK ? try_way(verifier, error) : status;
        verifier->verified[i].there_and_back = has_clock ? budget->now(budget->context) - begun : 0;
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
    return budget->now(budget->context) - budget->started + TL_VERIFIER_ROOM * need < budget->time;
}

/* A component that is left out, or that a candidate has made fail, has no turn. */
static tl_status begin(tl_verifier *verifier, const tl_budget *budget, tl_error *error) {
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
        tl_exchange_copy_state(verifier->exchange, verifier->component, &one->earlier, &one->aside, &taken, error);
    if (status == TL_OK && taken) {
        verifier->noted = 0;
        note_next(verifier);
        tl_exchange_keep_from(verifier->exchange, verifier->component, true);
        enter(verifier, TL_VERIFIER_NOTES);
    }
    return status;
}

/* The first output that is not what was noted. Its values in the ports are as noted afterwards. */
static bool differs(const tl_verifier *verifier, size_t place, tl_verifier_finding *finding) {
    const tl_exchange *exchange = verifier->exchange;
    const tl_ports *outputs = &at_hand(verifier)->outputs;
    unsigned char *again = outputs_of(verifier, AGAIN);
    tl_ports_read(outputs, again);
    if (memcmp(again, outputs_of(verifier, place), tl_ports_size(outputs)) == 0) {
        return false;
    }
    for (size_t i = 0; i < verifier->graph->port_count; i++) {
        const tl_port *port = &verifier->graph->ports[i];
        if (port->variable == NULL || port->input || port->node != verifier->component) {
            continue;
        }
        tl_ports_write(outputs, again);
        finding->again = tl_exchange_value(exchange, port);
        tl_ports_write(outputs, outputs_of(verifier, place));
        finding->committed = tl_exchange_value(exchange, port);
        if (memcmp(&finding->again, &finding->committed, sizeof finding->again) != 0) {
            finding->port = port;
            break;
        }
    }
    return true;
}

/* All that was noted once more, from the earlier state. A failure is a finding, unless it is fatal. */
static tl_status execute_again(tl_verifier *verifier, tl_verifier_finding *finding, bool *found, tl_error *error) {
    tl_component *component = at_hand(verifier);
    tl_exchange *exchange = verifier->exchange;
    tl_status status = tl_component_restore(component, verifier->verified[verifier->component].earlier, error);
    for (unsigned i = 0; i < TL_VERIFIED_STEPS && status == TL_OK && !*found; i++) {
        int64_t step = verifier->first + i;
        *finding = (tl_verifier_finding){.component = verifier->component, .step = step, .after = i + 1};
        tl_ports_write(&component->inputs, inputs_of(verifier, i));
        status = tl_component_step(component, tl_seconds(tl_time_of_step(0, exchange->step, step)), exchange->step_s,
                                   false, error);
        *found = status == TL_OK && differs(verifier, i, finding);
    }
    *found = *found || status == TL_FMU_FAILED;
    return status == TL_FMU_FATAL ? status : TL_OK;
}

/* What is in the places of the steps is needed no more. */
static tl_status find_cause(tl_verifier *verifier, tl_restore_cause *cause, tl_error *error) {
    const tl_restore_trial trial = {
        .component = at_hand(verifier),
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

static void count(tl_verifier *verifier, uint64_t executions, bool found) {
    tl_component *component = at_hand(verifier);
    verifier->counts.executions += component->executions - executions;
    verifier->counts.turns++;
    verifier->counts.found += found ? 1 : 0;
    component->executions = executions;
}

/* The component's values and its count are put back as well. */
static tl_status repeat(tl_verifier *verifier, const tl_budget *budget, tl_verifier_finding *finding, bool *found,
                        tl_error *error) {
    tl_component *component = at_hand(verifier);
    uint64_t executions = component->executions;
    bool is_kept = false;
    if (!has_time(verifier, budget, TL_VERIFIED_STEPS)) {
        return TL_OK;
    }
    tl_status status = leave(verifier, &is_kept, error);
    if (status != TL_OK) {
        return status;
    }
    tl_ports_read(&component->inputs, inputs_of(verifier, PRESENT));
    tl_ports_read(&component->outputs, outputs_of(verifier, PRESENT));
    status = execute_again(verifier, finding, found, error);
    status = status == TL_OK ? come_back(verifier, is_kept, error) : status;
    if (status == TL_OK && *found && finding->port == NULL) {
        finding->cause = TL_CAUSE_REFUSES;
    } else if (status == TL_OK && *found && is_kept && budget->now == NULL) {
        status = find_cause(verifier, &finding->cause, error);
    }
    tl_ports_write(&component->inputs, inputs_of(verifier, PRESENT));
    tl_ports_write(&component->outputs, outputs_of(verifier, PRESENT));
    count(verifier, executions, *found);
    end_turn(verifier);
    return status;
}

tl_status tl_verifier_go_on(tl_verifier *verifier, const tl_budget *budget, tl_verifier_finding *finding, bool *found,
                            tl_error *error) {
    *found = false;
    if (verifier->every == 0) {
        return TL_OK;
    }
    if (verifier->phase == TL_VERIFIER_BEGINS) {
        return begin(verifier, budget, error);
    }
    return verifier->phase == TL_VERIFIER_REPEATS ? repeat(verifier, budget, finding, found, error) : TL_OK;
}
