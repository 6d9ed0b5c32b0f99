/* Rollback proof, and choice of the faster of two exact methods: see proof.h. */
#include "master/sync/proof.h"

#include <math.h>
#include <string.h>

#include "master/sync/step_search.h"
#include "master/sync/verifier.h"

/* ---- faster method ---- */

/* ns: for a smaller gain the FMU's own states are not used, because a copy misses nothing. */
static const tl_time WORTH = 10000;

/* ns for one method, once there are enough rounds for a median. */
static const tl_time LONGEST = 20000000;
enum { FEWEST = 3 };

/* Of one component. */
typedef struct speed_test {
    tl_exchange *exchange;
    size_t index;
    tl_component *component;
    int64_t first;
    tl_time (*now)(void *clock);
    bool by_copy;
    fmi2FMUstate state; /* its own */
    tl_error *error;
} speed_test;

static tl_status save_state(speed_test *self) {
    if (!self->by_copy) {
        return tl_component_save(self->component, &self->state, self->error);
    }
    return tl_component_save_copy(self->component)
               ? TL_OK
               : tl_fail(self->error, TL_FMU_FAILED, "%s: its memory cannot be copied any more", self->component->name);
}

static tl_status report_lost_start(const tl_component *component, tl_status status, tl_error *error) {
    return tl_fail(error, status, "%s: its state at the start of the rollback check cannot be restored",
                   component->name);
}

static tl_status restore_state(speed_test *self) {
    if (!self->by_copy) {
        return tl_component_restore(self->component, self->state, self->error);
    }
    if (tl_component_restore_copy(self->component, NULL)) {
        return TL_OK;
    }
    return report_lost_start(self->component, self->component->mode == TL_MODE_DEAD ? TL_FMU_FATAL : TL_FMU_FAILED,
                             self->error);
}

static tl_status run_step(const speed_test *self) {
    const tl_exchange *exchange = self->exchange;
    return tl_component_step(self->component, tl_seconds(tl_time_of_step(0, exchange->step, self->first)),
                             tl_seconds(exchange->step), false, self->error);
}

static tl_status time_round(speed_test *self, tl_time *took) {
    tl_time started_at = self->now(NULL);
    tl_status status = save_state(self);
    status = status == TL_OK ? run_step(self) : status;
    status = status == TL_OK ? restore_state(self) : status;
    *took = self->now(NULL) - started_at;
    return status;
}

static void insert_time(tl_time *times, int count, tl_time time) {
    int i = count;
    for (; i > 0 && times[i - 1] > time; i--) {
        times[i] = times[i - 1];
    }
    times[i] = time;
}

/* Median of some rounds without the first, which may allocate. Returns 0 if a step failed. */
static tl_time median_time(speed_test *self) {
    tl_time times[TL_ROLLBACK_TIMING_ROUNDS];
    tl_time took;
    int count = 0;
    tl_status status = time_round(self, &took);
    tl_time started_at = self->now(NULL);
    while (status == TL_OK && count < TL_ROLLBACK_TIMING_ROUNDS &&
           (count < FEWEST || self->now(NULL) - started_at < LONGEST)) {
        status = time_round(self, &took);
        insert_time(times, count++, took);
    }
    return status == TL_OK ? times[count / 2] : 0;
}

/* Switches to the copy, which has no state of its own: all states are freed. */
static tl_status use_copy(speed_test *self) {
    tl_component_forget(self->component, &self->state);
    self->by_copy = true;
    return restore_state(self);
}

static tl_status measure_both(speed_test *self, tl_fmi2_times *times) {
    tl_status status = use_copy(self);
    if (status == TL_OK) {
        self->by_copy = false;
        times->by_states = median_time(self);
        status = use_copy(self);
    }
    if (status == TL_OK) {
        times->by_copy = median_time(self);
        status = use_copy(self);
    }
    return status;
}

/* 0: a step failed, so there is nothing to compare. */
static bool is_copy_preferred(const tl_fmi2_times *times) {
    bool is_slow = (double)times->by_copy >= TL_ROLLBACK_TIMING_MARGIN * (double)times->by_states &&
                   times->by_copy - times->by_states >= WORTH;
    return times->by_copy > 0 && !is_slow;
}

/* ---- proof ---- */

static bool is_output(const tl_port *port) {
    return port->variable != NULL && !port->input;
}

static void note_outputs(const tl_exchange *exchange, const tl_graph *graph, double *outputs) {
    for (size_t i = 0; i < graph->port_count; i++) {
        if (is_output(&graph->ports[i])) {
            outputs[i] = tl_exchange_value(exchange, &graph->ports[i]);
        }
    }
}

#define NO_COMPONENT SIZE_MAX

static const char REMEDY[] =
    "set \"rollback\": \"auto\" in the component; if it is set, no method is exact: export the FMU again";

/* After `step` + 1 steps from a state: compares the outputs of all FMUs with the noted ones, to the
 * bit. A wrong output affects others one step later, so the first one that differs is the culprit.
 */
static tl_status compare_outputs(const tl_exchange *exchange, const tl_graph *graph, const double *outputs, int step,
                                 size_t *culprit, tl_error *error) {
    for (size_t i = 0; i < graph->port_count; i++) {
        const tl_port *port = &graph->ports[i];
        if (!is_output(port)) {
            continue;
        }
        double value = tl_exchange_value(exchange, port);
        if (memcmp(&value, &outputs[i], sizeof value) != 0) {
            *culprit = port->node;
            return tl_fail(
                error, TL_FMU_FAILED,
                "%s.%s is not the same after a rollback and %d repeated step%s: the FMU is not restored exactly; %s",
                graph->components[port->node].name, port->variable->name, step + 1, step == 0 ? "" : "s", REMEDY);
        }
    }
    return TL_OK;
}

/* After `steps` steps from a state: notes the hashes, or compares them with the noted ones. Only
 * own states can lack an internal variable. `hashes`: one per component. */
static tl_status note_or_compare_hashes(const tl_exchange *exchange, uint64_t *hashes, bool *is_hashed, int steps,
                                        size_t *culprit, tl_error *error) {
    bool is_noted = *is_hashed;
    *is_hashed = true;
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_component *component = &exchange->components[i];
        uint64_t hash = component->fmi->always_final ? 0 : tl_component_hash(component);
        if (is_noted && hash != hashes[i] && hash != 0 && hashes[i] != 0) {
            *culprit = i;
            return tl_fail(error, TL_FMU_FAILED,
                           "%s: an internal variable is not the same after a rollback and %d repeated steps: the FMU "
                           "is not restored exactly; %s",
                           component->name, steps, REMEDY);
        }
        hashes[i] = is_noted ? hashes[i] : hash;
    }
    return TL_OK;
}

/* ---- excursions ---- */

/* Distances of excursions, in first steps of the search: as far as the search may soon go. */
#define FAR 4.0

/* Where an excursion of one variable goes, in these steps. */
static const double OFFSETS[] = {FAR, -FAR, 1.0, -1.0};
enum { OFFSET_COUNT = sizeof OFFSETS / sizeof OFFSETS[0] };

static double within(const tl_adjusted *adjusted, double value) {
    return fmin(fmax(value, adjusted->lower), adjusted->upper);
}

static void add_excursion(tl_proof *proof, const tl_adjusted *adjusted, size_t v, size_t offset) {
    double now = proof->start[v];
    double value = adjusted->is_boolean ? 1.0 - now : within(adjusted, now + OFFSETS[offset] * adjusted->step);
    bool is_new = adjusted->is_boolean ? offset == 0 : value < now || value > now;
    if (is_new && proof->excursion_count < TL_PROOF_EXCURSIONS) {
        proof->excursions[proof->excursion_count++] = (tl_proof_excursion){.variable = v, .value = value};
    }
}

/* The first one sweeps all variables. */
static void plan_excursions(tl_proof *proof, const tl_synchroniser *synchroniser) {
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        proof->start[v] = tl_exchange_adjusted(synchroniser->exchange, v);
    }
    proof->excursions[0] = (tl_proof_excursion){.variable = TL_MAX_ADJUST};
    proof->excursion_count = 1;
    for (size_t i = 0; i < OFFSET_COUNT; i++) {
        for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
            add_excursion(proof, &synchroniser->adjusted[v], v, i);
        }
    }
}

/* Far up, far down, and back; Booleans false and true. */
static double swept_value(const tl_adjusted *adjusted, double now, int step) {
    if (adjusted->is_boolean) {
        return step % 2 == 0 ? 1.0 - now : now;
    }
    return within(adjusted, now + (step % 4 < 2 ? FAR : -FAR) * adjusted->step);
}

static void set_excursion(const tl_proof *proof, const tl_synchroniser *synchroniser, size_t excursion, int step) {
    const tl_proof_excursion *one = &proof->excursions[excursion];
    if (excursion != 0) {
        tl_exchange_set_adjusted(synchroniser->exchange, one->variable, one->value);
        return;
    }
    for (size_t v = 0; v < synchroniser->horizon.variables; v++) {
        tl_exchange_set_adjusted(synchroniser->exchange, v,
                                 swept_value(&synchroniser->adjusted[v], proof->start[v], step));
    }
}

static void note_inputs(const tl_proof *proof, const tl_exchange *exchange, size_t component, unsigned char *to,
                        int step) {
    tl_ports_read(&exchange->components[component].inputs, to + (size_t)step * proof->value_bytes);
}

/* Drops the noted outputs of the excursions, because they were noted after a rollback. `all`: also
 * drops those of the steps from the start, because the components may continue differently from now
 * on. */
static void forget_notes(tl_proof *proof, bool all) {
    proof->noted = all ? 0 : proof->noted;
    proof->is_hashed = proof->is_hashed && !all;
    for (size_t i = 0; i < TL_PROOF_EXCURSIONS; i++) {
        proof->excursions[i].noted = 0;
        proof->excursions[i].is_noted = false;
        proof->excursions[i].is_hashed = false;
    }
}

/* ---- rollback ---- */

/* The component whose state could not be saved or restored. */
static size_t find_failed(const tl_exchange *exchange) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        if (exchange->components[i].mode == TL_MODE_FAILED) {
            return i;
        }
    }
    return NO_COMPONENT;
}

/* State of a proof. */
typedef struct proof_attempt {
    tl_proof *proof;
    tl_synchroniser *synchroniser;
    const tl_graph *graph;
    int64_t first;
    int steps;        /* steps that were possible */
    size_t excursion; /* the last one */
    size_t culprit;
    tl_restore_cause cause; /* the cause, as far as the kind of failure shows it */
} proof_attempt;

/* Finds the component that caused a failed save or restore. */
static tl_status note_culprit(proof_attempt *self, tl_status status) {
    if (status == TL_FMU_FAILED) {
        const tl_exchange *exchange = self->synchroniser->exchange;
        self->culprit = find_failed(exchange);
        bool by_own = self->culprit != NO_COMPONENT && !exchange->components[self->culprit].fmi->always_final;
        self->cause = self->proof->was_saved && by_own ? TL_CAUSE_LATE : TL_CAUSE_UNKNOWN;
    }
    return status;
}

static tl_status save_middle(proof_attempt *self, tl_error *error) {
    self->proof->has_midst = true;
    return note_culprit(self, tl_snapshot_take(&self->proof->midst, error));
}

/* After a step from the start: notes the outputs, or compares them with those of an earlier
 * attempt. They differ if another rollback method has not restored a component exactly. */
static tl_status note_or_compare(proof_attempt *self, tl_error *error) {
    tl_proof *proof = self->proof;
    double *outputs = &proof->outputs[(size_t)self->steps * self->graph->port_count];
    if (self->steps < proof->noted) {
        return compare_outputs(self->synchroniser->exchange, self->graph, outputs, self->steps, &self->culprit, error);
    }
    note_outputs(self->synchroniser->exchange, self->graph, outputs);
    proof->noted++;
    return TL_OK;
}

/* After the last step from the start, `steps` steps after a state. */
static tl_status hash_steps(proof_attempt *self, int steps, tl_error *error) {
    tl_proof *proof = self->proof;
    return note_or_compare_hashes(self->synchroniser->exchange, proof->hashes, &proof->is_hashed, steps, &self->culprit,
                                  error);
}

/* Executes steps with the present inputs and notes the outputs. A failure of the first step is an
 * error. A later failure only ends the steps, unless it is fatal. */
static tl_status take_steps(proof_attempt *self, tl_error *error) {
    tl_exchange *exchange = self->synchroniser->exchange;
    tl_status saved = TL_OK;
    tl_status status = TL_OK;
    while (self->steps < TL_PROOF_STEPS && status == TL_OK && saved == TL_OK) {
        saved = self->steps == TL_PROOF_MIDST ? save_middle(self, error) : TL_OK;
        status = saved == TL_OK ? tl_exchange_step(exchange, self->first + self->steps, error) : TL_OK;
        status = status == TL_OK && saved == TL_OK ? note_or_compare(self, error) : status;
        self->steps += status == TL_OK && saved == TL_OK ? 1 : 0;
    }
    self->proof->stepped = self->steps > 0 || self->culprit != NO_COMPONENT;
    bool continues = self->steps > 0 && status != TL_FMU_FATAL && self->culprit == NO_COMPONENT;
    if (saved == TL_OK && status == TL_OK) {
        return hash_steps(self, self->steps, error);
    }
    return saved != TL_OK ? saved : continues ? TL_OK : status;
}

/* After a rollback a component fails in a step that it had executed. */
static tl_status report_failed_step(proof_attempt *self, tl_error *error) {
    const tl_error failed = *error;
    self->culprit = find_failed(self->synchroniser->exchange);
    self->cause = TL_CAUSE_REFUSES;
    return tl_fail(error, TL_FMU_FAILED, "after a rollback, a step fails that worked before: %s", failed.text);
}

static tl_status repeat_steps(proof_attempt *self, int from, tl_error *error) {
    tl_exchange *exchange = self->synchroniser->exchange;
    tl_status status = TL_OK;
    for (int i = from; i < self->steps && status == TL_OK; i++) {
        status = tl_exchange_step(exchange, self->first + i, error);
        if (status == TL_FMU_FAILED) {
            status = report_failed_step(self, error);
        } else if (status == TL_OK) {
            status = compare_outputs(exchange, self->graph, &self->proof->outputs[(size_t)i * self->graph->port_count],
                                     i - from, &self->culprit, error);
        }
    }
    return status == TL_OK && self->proof->is_hashed ? hash_steps(self, self->steps - from, error) : status;
}

/* Restores the start. A component that cannot be restored is the culprit. */
static tl_status restore_start(proof_attempt *self, tl_error *error) {
    return note_culprit(self, tl_exchange_restore(self->synchroniser->exchange, error));
}

static tl_status save_start(proof_attempt *self, tl_error *error) {
    tl_status status = note_culprit(self, tl_exchange_save(self->synchroniser->exchange, error));
    self->proof->was_saved = self->proof->was_saved || status == TL_OK;
    return status;
}

/* The second state, after the first one was restored. */
static tl_status prove_middle(proof_attempt *self, tl_error *error) {
    if (!self->proof->has_midst) {
        return TL_OK;
    }
    tl_status status = note_culprit(self, tl_snapshot_restore(&self->proof->midst, error));
    return status == TL_OK ? repeat_steps(self, TL_PROOF_MIDST, error) : status;
}

/* One step of an excursion: its outputs are noted the first time, then compared. */
static tl_status take_excursion_step(proof_attempt *self, int step, tl_error *error) {
    tl_exchange *exchange = self->synchroniser->exchange;
    tl_proof_excursion *one = &self->proof->excursions[self->excursion];
    double *outputs =
        &self->proof->outputs[((self->excursion + 1) * TL_PROOF_STEPS + (size_t)step) * self->graph->port_count];
    set_excursion(self->proof, self->synchroniser, self->excursion, step);
    tl_status status = tl_exchange_step(exchange, self->first + step, error);
    if (status == TL_FMU_FAILED && one->is_noted && step < one->noted) {
        return report_failed_step(self, error);
    }
    if (status == TL_OK && one->is_noted) {
        status =
            step < one->noted ? compare_outputs(exchange, self->graph, outputs, step, &self->culprit, error) : TL_OK;
    } else if (status == TL_OK) {
        note_outputs(exchange, self->graph, outputs);
        one->noted++;
    }
    return status;
}

/* An internal solver that a restore restarts shows this only while it moves. */
static tl_status restore_middle(proof_attempt *self, tl_error *error) {
    tl_status status = save_middle(self, error);
    return status == TL_OK ? note_culprit(self, tl_snapshot_restore(&self->proof->midst, error)) : status;
}

/* An excursion from the start. `is_interrupted`: with a save and a restore in its middle. An FMU
 * may reject it, as any candidate. */
static tl_status make_excursion(proof_attempt *self, size_t excursion, bool is_interrupted, tl_error *error) {
    tl_proof *proof = self->proof;
    tl_proof_excursion *one = &proof->excursions[excursion];
    tl_status status = TL_OK;
    self->excursion = excursion;
    for (int i = 0; i < TL_PROOF_STEPS && status == TL_OK; i++) {
        status = i == TL_PROOF_MIDST && is_interrupted ? restore_middle(self, error) : TL_OK;
        status = status == TL_OK ? take_excursion_step(self, i, error) : status;
    }
    if (status == TL_OK) {
        status = note_or_compare_hashes(self->synchroniser->exchange,
                                        &proof->hashes[(excursion + 1) * self->synchroniser->exchange->component_count],
                                        &one->is_hashed, TL_PROOF_STEPS, &self->culprit, error);
    }
    one->is_noted = true;
    return status == TL_FMU_FATAL || self->culprit != NO_COMPONENT ? status : TL_OK;
}

/* Makes all excursions in forward, then in reverse order, so that each one follows both of its
 * neighbours. In forward order, repeats the steps from the start after each excursion. */
static tl_status prove_excursions(proof_attempt *self, tl_error *error) {
    size_t count = self->proof->excursion_count;
    tl_status status = TL_OK;
    for (size_t i = 0; i < 2 * count && status == TL_OK; i++) {
        status = i < count ? make_excursion(self, i, false, error)
                           : make_excursion(self, 2 * count - 1 - i, self->proof->has_midst, error);
        status = status == TL_OK ? restore_start(self, error) : status;
        if (i < count && status == TL_OK) {
            status = repeat_steps(self, 0, error);
            status = status == TL_OK ? restore_start(self, error) : status;
        }
    }
    return status;
}

static tl_status prove_once(proof_attempt *self, tl_error *error) {
    tl_status status = save_start(self, error);
    status = status == TL_OK ? take_steps(self, error) : status;
    status = status == TL_OK ? restore_start(self, error) : status;
    status = status == TL_OK ? make_excursion(self, 0, false, error) : status;
    status = status == TL_OK ? prove_middle(self, error) : status;
    status = status == TL_OK ? restore_start(self, error) : status;
    status = status == TL_OK ? prove_excursions(self, error) : status;
    return status == TL_OK ? save_start(self, error) : status; /* an FMU may have done what no rollback undoes */
}

void tl_proof_end(tl_proof *proof) {
    for (size_t i = 0; i < proof->midst.component_count; i++) {
        tl_snapshot_forget(&proof->midst, i);
    }
    proof->has_midst = false;
}

/* ---- cause ---- */

/* Notes the inputs of the culprit in the steps and in the last excursion. The culprit is restored
 * from its copy, not from a state. If the excursion ends early, its last inputs are repeated. */
static bool note_distant_inputs(const proof_attempt *self) {
    tl_exchange *exchange = self->synchroniser->exchange;
    tl_error ignored;
    tl_status status = TL_OK;
    if (!tl_exchange_restore_copy(exchange, self->culprit, NULL)) {
        return false;
    }
    for (int i = 0; i < self->steps && status == TL_OK; i++) {
        note_inputs(self->proof, exchange, self->culprit, self->proof->inputs, i);
        status = tl_exchange_step(exchange, self->first + i, &ignored);
    }
    if (status == TL_FMU_FATAL || !tl_exchange_restore_copy(exchange, self->culprit, NULL)) {
        return false;
    }
    for (int i = 0; i < self->steps && status != TL_FMU_FATAL; i++) {
        set_excursion(self->proof, self->synchroniser, self->excursion, i);
        note_inputs(self->proof, exchange, self->culprit, self->proof->distant_inputs, i);
        status = status == TL_OK ? tl_exchange_step(exchange, self->first + i, &ignored) : status;
    }
    return status != TL_FMU_FATAL && tl_exchange_restore_copy(exchange, self->culprit, NULL);
}

/* Called only if there can be a full copy. */
static tl_restore_cause find_cause(const proof_attempt *self) {
    tl_exchange *exchange = self->synchroniser->exchange;
    tl_component *culprit = &exchange->components[self->culprit];
    const tl_restore_cause cause = self->cause;
    tl_restore_cause found = TL_CAUSE_UNKNOWN;
    tl_error ignored;
    const tl_restore_trial trial = {
        .component = culprit,
        .macro_step = exchange->step,
        .step = self->first,
        .steps = (unsigned)self->steps,
        .inputs = self->proof->inputs,
        .input_bytes = self->proof->value_bytes,
        .distant_inputs = self->proof->distant_inputs,
        .outputs = self->proof->repeated_outputs,
        .output_bytes = self->proof->value_bytes,
    };
    if (cause != TL_CAUSE_LATE && cause != TL_CAUSE_FINAL && self->steps > 1 && exchange->is_kept[self->culprit] &&
        tl_component_copy_size(culprit) != 0 && note_distant_inputs(self)) {
        (void)tl_restore_cause_find(&trial, &found, &ignored);
    }
    return found != TL_CAUSE_UNKNOWN ? found : cause;
}

/* Switches the culprit to its next rollback method, and restores all components to the start.
 * Returns false if there is no other method; then the error names the cause. */
static bool use_other_method(proof_attempt *self, tl_error *error) {
    tl_exchange *exchange = self->synchroniser->exchange;
    tl_restore_cause cause = find_cause(self);
    const char *cause_text = tl_restore_cause_text(cause);
    if (tl_exchange_restore_copy(exchange, self->culprit, cause_text)) {
        /* A component that is restored by a copy is where it was, but may continue differently: it
         * does not see the exception flags of others any more. */
        forget_notes(self->proof, tl_component_copy_size(&exchange->components[self->culprit]) != 0);
        return true;
    }
    tl_error found = *error;
    (void)tl_fail(error, TL_FMU_FAILED, "%s%s%s%s", found.text, cause_text[0] != '\0' ? " (" : "", cause_text,
                  cause_text[0] != '\0' ? ")" : "");
    return false;
}

/* ---- one proof ---- */

bool tl_proof_init(tl_proof *proof, tl_arena *arena, tl_exchange *exchange, const tl_graph *graph) {
    *proof = (tl_proof){.value_bytes = 1};
    for (size_t i = 0; i < exchange->component_count; i++) {
        size_t in = tl_ports_size(&exchange->components[i].inputs);
        size_t out = tl_ports_size(&exchange->components[i].outputs);
        proof->value_bytes = in > proof->value_bytes ? in : proof->value_bytes;
        proof->value_bytes = out > proof->value_bytes ? out : proof->value_bytes;
    }
    proof->outputs =
        tl_arena_take(arena, graph->port_count * TL_PROOF_STEPS * (TL_PROOF_EXCURSIONS + 1), sizeof *proof->outputs);
    proof->inputs = tl_arena_take(arena, TL_PROOF_STEPS, proof->value_bytes);
    proof->distant_inputs = tl_arena_take(arena, TL_PROOF_STEPS, proof->value_bytes);
    proof->repeated_outputs = tl_arena_take(arena, TL_PROOF_STEPS + 1, proof->value_bytes);
    proof->hashes = tl_arena_take(arena, exchange->component_count * (TL_PROOF_EXCURSIONS + 1), sizeof *proof->hashes);
    return proof->outputs != NULL && proof->hashes != NULL && proof->inputs != NULL && proof->distant_inputs != NULL &&
           proof->repeated_outputs != NULL &&
           tl_snapshot_init(&proof->midst, arena, exchange->components, exchange->component_count, exchange->values,
                            exchange->values_size);
}

/* ---- proof of components that also have a copy ---- */

/* Returns NO_COMPONENT if no component has a choice. */
static size_t find_choice(const tl_exchange *exchange) {
    size_t i = 0;
    while (i < exchange->component_count &&
           !(exchange->is_kept[i] && tl_component_has_choice(&exchange->components[i]))) {
        i++;
    }
    return i < exchange->component_count ? i : NO_COMPONENT;
}

static void set_final(const tl_exchange *exchange, bool final) {
    for (size_t i = 0; i < exchange->component_count; i++) {
        tl_component *component = &exchange->components[i];
        component->says_final = final && exchange->is_kept[i] && tl_component_has_choice(component);
    }
}

/* Repeats the steps, each marked as final, because most committed steps are final and candidates
 * are not. No state may be restored after a final step, so components with a copy are restored from
 * it. */
static tl_status prove_as_final(proof_attempt *self, size_t one, tl_error *error) {
    tl_exchange *exchange = self->synchroniser->exchange;
    set_final(exchange, true);
    tl_status status = repeat_steps(self, 0, error);
    set_final(exchange, false);
    if (status == TL_FMU_FAILED) {
        self->cause = TL_CAUSE_FINAL;
    }
    if (status == TL_OK && !tl_exchange_restore_copy(exchange, one, NULL)) {
        exchange->failed = one;
        return report_lost_start(&exchange->components[one], TL_FMU_FAILED, error);
    }
    return status == TL_OK ? tl_exchange_save(exchange, error) : status;
}

/* An own state that lacks data of the FMU may be wrong only long after the proof. So a restore
 * after an excursion must give the memory the same bits as before. `after_step`: compares after
 * one more step, so that data that each step writes before it reads them may differ. Afterwards
 * the components are at the start, without states. */
static tl_status compare_memory(speed_test *self, proof_attempt *attempt, bool after_step, bool *is_same) {
    tl_error *error = self->error;
    const tl_fmi2_fallback *memory = self->component->fmi->fallback;
    tl_exchange *exchange = self->exchange;
    tl_status status = tl_exchange_save(exchange, error);
    status = status == TL_OK && after_step ? tl_exchange_step(exchange, self->first, error) : status;
    *is_same = status == TL_OK && memory->note_memory(self->component->instance) <= fmi2Warning;
    for (size_t i = 0; i < attempt->proof->excursion_count && status == TL_OK && *is_same; i++) {
        status = restore_start(attempt, error);
        status = status == TL_OK ? make_excursion(attempt, i, false, error) : status;
        status = status == TL_OK ? restore_start(attempt, error) : status;
        status = status == TL_OK && after_step ? tl_exchange_step(exchange, self->first, error) : status;
        *is_same = status == TL_OK && memory->is_memory_same(self->component->instance);
    }
    if (status == TL_OK && !tl_exchange_restore_copy(exchange, self->index, NULL)) {
        return report_lost_start(self->component, TL_FMU_FAILED, error);
    }
    return status;
}

static tl_status choose_faster(speed_test *self, proof_attempt *attempt, bool *taken) {
    tl_fmi2_times times = {0};
    bool is_same = true;
    tl_snapshot_forget(&self->exchange->home, self->index);
    tl_status status = measure_both(self, &times);
    bool is_preferred = is_copy_preferred(&times) || (times.by_copy > 0 && self->component->fmi->prefers_copies);
    if (status == TL_OK && times.by_copy > 0 && !is_preferred) {
        bool after_step = (double)times.by_copy >= TL_ROLLBACK_TIMING_LIMIT * (double)times.by_states;
        status = compare_memory(self, attempt, after_step, &is_same);
    }
    if (status == TL_OK && (is_preferred || !is_same)) {
        *taken = tl_component_prefer_copy(self->component, &times) || *taken;
    }
    return status;
}

/* Chooses the rollback method for each component that has a choice. Call it during a proof: all
 * components are at the start, their states are proved, and only tl_exchange_save() has saved
 * states. `now`: ns. *taken: at least one component has switched to copies. Afterwards all
 * components are at the start again, and saved. Errors: TL_FMU_FAILED, TL_FMU_FATAL: a component
 * could not be restored; exchange->failed is its index. */
static tl_status choose_each(proof_attempt *attempt, tl_time (*now)(void *clock), bool *taken, tl_error *error) {
    tl_exchange *exchange = attempt->synchroniser->exchange;
    bool any = false;
    tl_status status = TL_OK;
    *taken = false;
    for (size_t i = 0; i < exchange->component_count && status == TL_OK; i++) {
        speed_test one = {.exchange = exchange,
                          .index = i,
                          .component = &exchange->components[i],
                          .first = attempt->first,
                          .now = now,
                          .error = error};
        if (exchange->is_kept[i] && tl_component_has_choice(one.component)) {
            any = true;
            exchange->failed = i;
            status = choose_faster(&one, attempt, taken);
        }
    }
    if (status != TL_OK || !any) {
        return status;
    }
    memcpy(exchange->home.live, exchange->home.values, exchange->home.values_size);
    return tl_exchange_save(exchange, error);
}

/* Call it when the states are proved. *taken: a component uses copies from now on, and may continue
 * differently: see use_other_method(). Otherwise the second state is saved again. */
static tl_status choose_copies(proof_attempt *self, tl_time (*now)(void *clock), bool *taken, tl_error *error) {
    tl_proof *proof = self->proof;
    bool had_middle = proof->has_midst;
    size_t one = find_choice(self->synchroniser->exchange);
    *taken = false;
    if (one == NO_COMPONENT) {
        return TL_OK;
    }
    tl_proof_end(proof);
    tl_status status = prove_as_final(self, one, error);
    if (status == TL_OK && now != NULL) {
        status = choose_each(self, now, taken, error);
    }
    if (status == TL_FMU_FAILED && self->culprit == NO_COMPONENT) {
        self->culprit = self->synchroniser->exchange->failed;
    }
    if (*taken) {
        forget_notes(proof, true);
    }
    if (!*taken && had_middle && status == TL_OK) {
        proof->has_midst = true;
        status = tl_snapshot_take(&proof->midst, error);
    }
    return status;
}

/* For a component whose own states are far faster than copies of its memory: checks that both give
 * the same outputs in all excursions. A state that lacks data that only excursions change may be
 * wrong in the same way each time; a copy lacks nothing. Afterwards the start is saved again. */
static tl_status compare_with_copies(proof_attempt *self, size_t one, tl_error *error) {
    tl_exchange *exchange = self->synchroniser->exchange;
    bool had_middle = self->proof->has_midst;
    tl_status status = TL_OK;
    tl_proof_end(self->proof);
    for (size_t i = 0; i <= self->proof->excursion_count && status == TL_OK; i++) {
        if (!tl_exchange_restore_copy(exchange, one, NULL)) {
            self->culprit = one;
            return report_lost_start(&exchange->components[one], TL_FMU_FAILED, error);
        }
        status = i < self->proof->excursion_count ? make_excursion(self, i, false, error) : TL_OK;
    }
    status = status == TL_OK ? tl_exchange_save(exchange, error) : status;
    return status == TL_OK && had_middle ? save_middle(self, error) : status;
}

/* ---- repeated proofs ---- */

tl_status tl_proof_of_rollback(tl_proof *proof, tl_synchroniser *synchroniser, const tl_graph *graph, int64_t first,
                               tl_time (*now)(void *clock), tl_error *error) {
    tl_exchange *exchange = synchroniser->exchange;
    tl_status status = TL_OK;
    bool is_settled = false;
    bool is_copy_wrong = false;
    bool again = false;
    forget_notes(proof, true);
    plan_excursions(proof, synchroniser);
    tl_exchange_keep_copies(exchange);
    do {
        proof_attempt search = {
            .proof = proof, .synchroniser = synchroniser, .graph = graph, .first = first, .culprit = NO_COMPONENT};
        proof->stepped = true;
        proof->was_saved = false;
        status = prove_once(&search, error);
        again = false;
        if (status == TL_OK && !is_settled) {
            status = choose_copies(&search, now, &again, error);
            is_settled = status == TL_OK;
        }
        size_t one = find_choice(exchange);
        if (status == TL_OK && !again && one != NO_COMPONENT && !is_copy_wrong) {
            status = compare_with_copies(&search, one, error);
        }
        if (status != TL_OK) {
            tl_proof_end(proof); /* a component with another method has no states of this kind any more */
            is_copy_wrong =
                is_copy_wrong || (search.culprit != NO_COMPONENT && exchange->components[search.culprit].prefers_copy);
            again = status == TL_FMU_FAILED && search.culprit != NO_COMPONENT && use_other_method(&search, error);
        }
        proof->culprit = search.culprit;
    } while (again);
    proof->holds = status == TL_OK;
    tl_exchange_drop_copies(exchange);
    for (size_t i = 0; i < exchange->component_count; i++) {
        proof->executions += exchange->components[i].executions;
        exchange->components[i].executions = 0;
    }
    return status;
}
