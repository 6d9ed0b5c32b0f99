/* FMU guard, see fmu_guard.h. */
#include "firmware/fmu/fmu_guard.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "firmware/process/crash.h"
#include "firmware/process/host_state.h"

/* ---- Serialising the state of an FMU that is rolled back by memory although its own states are
 * exact.
 *
 * Purpose: another process reads a checkpoint, and a copy of memory is useless there. To save, the
 *          copy is restored, the FMU saves its own state, and that state is serialised. To load,
 *          the FMU restores its own state from the bytes, and then its memory is copied. Afterwards
 *          the memory is as before.
 * Source:  FMI 2.0.4, section 2.1.8 (fmi2SerializeFMUstate). The functions have the signatures of
 *          FMI's table, for an instance behind the guard and for states that are copies.
 * Errors:  fmi2Error if memory is out, if the FMU has side effects that a copy cannot restore, or
 *          if the FMU rejects a call.
 * Thread:  the thread that calls the FMUs.
 */

/* ---- Rollback methods of an FMU in their order, and the functions of each in the table.
 *
 * Purpose: the order is: its own states; copies of its memory; its own states, followed by setting
 *          its last inputs again; replay. If the proof finds a method wrong, tl_fmi2_fallback
 *          switches to the next one and restores the start of the proof. After the proof only one
 *          change is possible: from copies back to exact own states.
 * Thread:  the thread that calls the FMUs.
 */

/* ---- fmu given ---- */

static fmi2Integer *integers_in(const tl_ports *ports, double *values) {
    return (fmi2Integer *)(void *)(values + ports->real_count);
}

static fmi2Boolean *booleans_in(const tl_ports *ports, double *values) {
    return integers_in(ports, values) + ports->integer_count; /* fmi2Boolean is the same C type */
}

tl_last_inputs *tl_last_inputs_open(const tl_ports *ports) {
    size_t bytes = tl_ports_size(ports);
    tl_last_inputs *last_inputs = malloc(sizeof *last_inputs + bytes);
    if (last_inputs != NULL) {
        *last_inputs = (tl_last_inputs){.ports = ports, .bytes = bytes};
        tl_ports_read(ports, (unsigned char *)last_inputs->values);
    }
    return last_inputs;
}

void tl_last_inputs_note(tl_last_inputs *last_inputs, tl_fmu_prologue_kind kind, const fmi2ValueReference *references,
                         const void *values) {
    const tl_ports *ports = last_inputs->ports;
    if (kind == TL_PROLOGUE_SET_REAL && references == ports->real_references) {
        memcpy(last_inputs->values, values, ports->real_count * sizeof(double));
    } else if (kind == TL_PROLOGUE_SET_INTEGER && references == ports->integer_references) {
        memcpy(integers_in(ports, last_inputs->values), values, ports->integer_count * sizeof(fmi2Integer));
    } else if (kind == TL_PROLOGUE_SET_BOOLEAN && references == ports->boolean_references) {
        memcpy(booleans_in(ports, last_inputs->values), values, ports->boolean_count * sizeof(fmi2Boolean));
    }
}

tl_last_inputs_state *tl_last_inputs_make_state(const tl_last_inputs *last_inputs) {
    tl_last_inputs_state *state = malloc(sizeof *state + last_inputs->bytes);
    if (state != NULL) {
        state->own = NULL;
        tl_last_inputs_save(last_inputs, state);
    }
    return state;
}

void tl_last_inputs_save(const tl_last_inputs *last_inputs, tl_last_inputs_state *state) {
    memcpy(state->values, last_inputs->values, last_inputs->bytes);
}

fmi2Status tl_last_inputs_restore(tl_last_inputs *last_inputs, const tl_last_inputs_state *state, const tl_fmi2 *fmi,
                                  fmi2Component instance) {
    const tl_ports *ports = last_inputs->ports;
    fmi2Status status = fmi2OK;
    memcpy(last_inputs->values, state->values, last_inputs->bytes);
    if (ports->real_count != 0) {
        status = fmi->set_real(instance, ports->real_references, ports->real_count, last_inputs->values);
    }
    if (status <= fmi2Warning && ports->integer_count != 0) {
        status = fmi->set_integer(instance, ports->integer_references, ports->integer_count,
                                  integers_in(ports, last_inputs->values));
    }
    if (status <= fmi2Warning && ports->boolean_count != 0) {
        status = fmi->set_boolean(instance, ports->boolean_references, ports->boolean_count,
                                  booleans_in(ports, last_inputs->values));
    }
    return status;
}

/* ---- fmu rollback methods ---- */

/* ---- states as copies of memory: no call of the FMU ---- */

/* A next method exists only while the rollback is being proved. */
static bool has_fallback(const tl_fmu_guarded *self) {
    return self->replay != NULL && !self->guard->was_proved && !(self->by_replay && self->guard->renews);
}

/* A warning if another rollback method remains, else an error. */
static void log_failure(tl_fmu_guarded *self, const char *text) {
    tl_log_level level = has_fallback(self) ? TL_LOG_WARNING : TL_LOG_ERROR;
    tl_fmu_logger_log(&self->guard->logger, level, text);
}

/* The FMU has side effects that no copy contains. Logged once; not logged after the proof if the
 * FMU is not rolled back by memory, because then it needs no copy. */
static fmi2Status reject_copy(tl_fmu_guarded *self, const char *side_effect) {
    tl_error error;
    bool was_exact = self->guard->is_by_choice && self->guard->was_proved;
    (void)tl_fail(&error, TL_FMU_FAILED, "its memory cannot be copied, because it has %s%s", side_effect,
                  was_exact            ? "; set \"rollback\": \"state\" in its component"
                  : has_fallback(self) ? ""
                                       : "; set \"rollback\": \"replay\" in its component");
    bool is_needed = self->guard->by_memory || !self->guard->was_proved;
    if (is_needed && !self->guard->was_remaining_reported) {
        log_failure(self, error.text);
        self->guard->was_remaining_reported = true;
    }
    return fmi2Error;
}

static void warn_once(tl_fmu_guard *guard, bool is_found, bool *was_reported, const char *text) {
    if (is_found && !*was_reported) {
        tl_fmu_logger_log(&guard->logger, TL_LOG_WARNING, text);
        *was_reported = true;
    }
}

/* Side effects that copies do not contain. Most FMUs do not depend on them. */
static void warn_about_rest(tl_fmu_guarded *self) {
    tl_fmu_guard *guard = self->guard;
    const tl_fmu_heap *heap = guard->memory->heap;
    warn_once(guard, heap->writes_files, &guard->was_writing_reported,
              "writes, moves or removes files in its steps: a rollback does not undo this, also for candidates; "
              "if the FMU reads them again, its results may be wrong");
    warn_once(guard, heap->changes_environment, &guard->was_environment_reported,
              "changes environment variables in its steps: a rollback does not undo this, also for candidates; "
              "if the FMU depends on them, its results may be wrong");
    warn_once(guard, heap->has_constructed, &guard->was_construction_reported,
              "opens a library in a step: a rollback does not restore memory that its constructors "
              "allocate; if it changes later, results may be wrong: open (import) it before the first step");
}

static fmi2Status save_memory(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    tl_error error;
    const char *side_effect = tl_fmu_memory_remaining(self->guard->memory);
    if (side_effect != NULL) {
        return reject_copy(self, side_effect);
    }
    warn_about_rest(self);
    if (tl_fmu_memory_save(self->guard->memory, state, &error) != TL_OK) {
        log_failure(self, error.text);
        return fmi2Error;
    }
    return fmi2OK;
}

static fmi2Status restore_memory(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    const char *obstacle = tl_fmu_memory_obstacle(self->guard->memory, state);
    if (has_fallback(self) && tl_fmu_memory_has_unknown_library(self->guard->memory, state)) {
        self->guard->lacks_library = true;
        return fmi2Error;
    }
    if (obstacle != NULL) {
        return reject_copy(self, obstacle);
    }
    tl_fmu_memory_restore(self->guard->memory, state);
    return fmi2OK;
}

static fmi2Status free_memory(fmi2Component component, fmi2FMUstate *state) {
    (void)component;
    tl_fmu_memory_forget(*state);
    *state = NULL;
    return fmi2OK;
}

static fmi2Status reserve_memory(fmi2Component component, size_t states) {
    tl_fmu_guarded *self = component;
    tl_error error;
    if (tl_fmu_memory_reserve(self->guard->memory, states, &error) != TL_OK) {
        tl_fmu_logger_log(&self->guard->logger, TL_LOG_ERROR, error.text);
        return fmi2Error;
    }
    return fmi2OK;
}

static size_t memory_size(fmi2Component component) {
    const tl_fmu_guarded *self = component;
    return tl_fmu_memory_size(self->guard->memory);
}

/* ---- serialising states that are copies of memory ---- */

/* The FMU's own states enlarge its memory, which must not count in the size estimate. */
static bool keep_present(tl_fmu_guarded *self, void **present) {
    *present = NULL;
    tl_fmu_memory_freeze_estimate(self->guard->memory, true);
    bool is_kept = save_memory(self, present) == fmi2OK;
    if (!is_kept) {
        tl_fmu_memory_freeze_estimate(self->guard->memory, false);
    }
    return is_kept;
}

/* Restores the memory from before keep_present(). This also removes own states created since. */
static void restore_present(tl_fmu_guarded *self, void *present) {
    tl_fmu_memory_restore(self->guard->memory, present);
    tl_fmu_memory_freeze_estimate(self->guard->memory, false);
    tl_fmu_memory_forget(present);
}

/* Restores a copy and saves the FMU's own state there. */
static fmi2Status save_own_state(tl_fmu_guarded *self, fmi2FMUstate copy, void **present, fmi2FMUstate *state) {
    *state = NULL;
    if (!keep_present(self, present)) {
        return fmi2Error;
    }
    tl_fmu_memory_restore(self->guard->memory, copy);
    fmi2Status status = self->guard->by_states.get_fmu_state(self, state);
    if (status > fmi2Warning) {
        restore_present(self, *present);
    }
    return status;
}

static fmi2Status copy_bytes_size(fmi2Component component, fmi2FMUstate copy, size_t *size) {
    tl_fmu_guarded *self = component;
    void *present;
    fmi2FMUstate state;
    fmi2Status status = save_own_state(self, copy, &present, &state);
    if (status <= fmi2Warning) {
        status = self->guard->by_states.serialized_fmu_state_size(component, state, size);
        restore_present(self, present);
    }
    return status;
}

static fmi2Status copy_bytes_write(fmi2Component component, fmi2FMUstate copy, fmi2Byte bytes[], size_t size) {
    tl_fmu_guarded *self = component;
    void *present;
    fmi2FMUstate state;
    fmi2Status status = save_own_state(self, copy, &present, &state);
    if (status <= fmi2Warning) {
        status = self->guard->by_states.serialize_fmu_state(component, state, bytes, size);
        restore_present(self, present);
    }
    return status;
}

/* Deserialises an own state, restores it and frees it. */
static fmi2Status read_state(tl_fmu_guarded *self, const fmi2Byte bytes[], size_t size) {
    const tl_fmi2 *own = &self->guard->by_states;
    fmi2FMUstate state = NULL;
    fmi2Status status = own->deserialize_fmu_state(self, bytes, size, &state);
    if (status > fmi2Warning) {
        return status;
    }
    status = own->set_fmu_state(self, state);
    fmi2Status freed = own->free_fmu_state(self, &state);
    return status > freed ? status : freed;
}

static fmi2Status copy_bytes_read(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *copy) {
    tl_fmu_guarded *self = component;
    void *present;
    if (!keep_present(self, &present)) {
        return fmi2Error;
    }
    fmi2Status status = read_state(self, bytes, size);
    if (status <= fmi2Warning && save_memory(self, copy) != fmi2OK) {
        status = fmi2Error;
    }
    restore_present(self, present);
    return status;
}

/* ---- states as positions of a replay; another instance may still use its own states ---- */

static fmi2Status keep_position(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    return self->by_replay ? tl_fmu_replay_save(self->replay, state)
                           : self->guard->by_states.get_fmu_state(component, state);
}

static fmi2Status go_to_position(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    return self->by_replay ? tl_fmu_replay_restore(self->replay, state)
                           : self->guard->by_states.set_fmu_state(component, state);
}

static fmi2Status free_position(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    if (!self->by_replay) {
        return self->guard->by_states.free_fmu_state(component, state);
    }
    tl_fmu_replay_forget(self->replay, state);
    return fmi2OK;
}

/* ---- own states, with the last inputs set before them ---- */

static fmi2Status keep_state_and_inputs(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    tl_last_inputs_state *kept = *state != NULL ? *state : tl_last_inputs_make_state(self->last_inputs);
    if (kept == NULL) {
        return fmi2Error;
    }
    tl_last_inputs_save(self->last_inputs, kept);
    *state = kept;
    return self->guard->by_states.get_fmu_state(component, &kept->own);
}

static fmi2Status restore_and_set(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    const tl_last_inputs_state *kept = state;
    fmi2Status status = self->guard->by_states.set_fmu_state(component, kept->own);
    return status <= fmi2Warning ? tl_last_inputs_restore(self->last_inputs, kept, &self->guard->functions, component)
                                 : status;
}

static fmi2Status free_state_and_inputs(fmi2Component component, fmi2FMUstate *state) {
    const tl_fmu_guarded *self = component;
    tl_last_inputs_state *kept = *state;
    fmi2Status status = kept->own != NULL ? self->guard->by_states.free_fmu_state(component, &kept->own) : fmi2OK;
    free(kept);
    *state = NULL;
    return status;
}

static void end_recording(tl_fmu_guarded *self) {
    free(self->last_inputs);
    self->last_inputs = NULL;
    if (self->replay != NULL) {
        tl_fmu_replay_end(self->replay);
        free(self->replay);
        self->replay = NULL;
    }
    self->is_noted = self->memory != NULL;
}

/* ---- functions of the methods ---- */

/* Functions that are not listed are NULL. */
static const tl_fmi2 BY_MEMORY = {.always_final = true,
                                  .get_fmu_state = save_memory,
                                  .set_fmu_state = restore_memory,
                                  .free_fmu_state = free_memory,
                                  .state_size = memory_size,
                                  .reserve_states = reserve_memory};
static const tl_fmi2 BY_STATES_AND_INPUTS = {
    .get_fmu_state = keep_state_and_inputs, .set_fmu_state = restore_and_set, .free_fmu_state = free_state_and_inputs};
static const tl_fmi2 BY_REPLAY = {.always_final = true,
                                  .get_fmu_state = keep_position,
                                  .set_fmu_state = go_to_position,
                                  .free_fmu_state = free_position};

static void roll_back_by(tl_fmu_guard *guard, const tl_fmi2 *method) {
    tl_fmi2 *functions = &guard->functions;
    guard->by_memory = method == &BY_MEMORY;
    if (guard->memory != NULL) {
        guard->memory->has_flags = guard->by_memory;
    }
    functions->always_final = method->always_final;
    functions->get_fmu_state = method->get_fmu_state;
    functions->set_fmu_state = method->set_fmu_state;
    functions->free_fmu_state = method->free_fmu_state;
    functions->state_size = method->state_size;
    functions->reserve_states = method->reserve_states;
    functions->serialized_fmu_state_size = method->serialized_fmu_state_size;
    functions->serialize_fmu_state = method->serialize_fmu_state;
    functions->deserialize_fmu_state = method->deserialize_fmu_state;
}

/* If the FMU's own functions are exact, they are used for serialising: the copy is converted to an
 * own state. */
static void roll_back_by_memory(tl_fmu_guard *guard) {
    tl_fmi2 *functions = &guard->functions;
    roll_back_by(guard, &BY_MEMORY);
    tl_fmu_memory_remeasure(guard->memory);
    if (guard->is_by_choice && guard->by_states.serialize_fmu_state != NULL) {
        functions->serialized_fmu_state_size = copy_bytes_size;
        functions->serialize_fmu_state = copy_bytes_write;
        functions->deserialize_fmu_state = copy_bytes_read;
    }
}

static void roll_back_by_replay(tl_fmu_guard *guard) {
    roll_back_by(guard, &BY_REPLAY);
    guard->by_replay = true;
    guard->functions.replay.most = guard->most;
}

/* ---- fallback to the next method ---- */

/* Most restarts of an FMU that opens libraries in its steps. */
enum { MOST_RENEWALS = 4 };

static void forget_instantiated(tl_fmu_guard *guard) {
    tl_fmu_memory_forget(guard->instantiated);
    guard->instantiated = NULL;
}

/* The size estimate is frozen, because initialisation has changed much since the copy after
 * fmi2Instantiate. */
static bool save_first(tl_fmu_guarded *self) {
    tl_fmu_guard *guard = self->guard;
    bool is_first = !guard->memory->heap->opens_outside;
    guard->memory->heap->opens_outside = true;
    if (!guard->was_proved) {
        guard->memory->heap->writes_files = false; /* what was changed before the first state does no harm */
        guard->memory->heap->changes_environment = false;
    }
    if (is_first && guard->instantiated != NULL && tl_fmu_memory_has_new_library(guard->memory, guard->instantiated)) {
        forget_instantiated(guard);
        tl_fmu_memory_restart_storage(guard->memory);
    }
    tl_fmu_memory_freeze_estimate(guard->memory, true);
    bool is_saved = save_memory(self, &guard->full_copy) == fmi2OK;
    tl_fmu_memory_freeze_estimate(guard->memory, false);
    return is_saved;
}

/* Start of a proof. Replay needs no copy, because it can restore the end of the prologue. */
static fmi2Status keep_start(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (self->replay != NULL && !guard->was_proved) {
        tl_fmu_replay_wait(self->replay);
    }
    bool may_copy = guard->memory != NULL && !self->by_replay && !guard->sets_inputs &&
                    (!guard->by_memory || tl_fmu_memory_remaining(guard->memory) == NULL);
    bool has_copy = may_copy && save_first(self);
    return has_copy || has_fallback(self) ? fmi2OK : fmi2Error;
}

static void drop_copy(tl_fmu_guard *guard) {
    tl_fmu_memory_forget(guard->full_copy);
    guard->full_copy = NULL;
}

static size_t size_start(fmi2Component component) {
    const tl_fmu_guarded *self = component;
    return self->guard->memory != NULL && !self->by_replay && !self->guard->sets_inputs
               ? tl_fmu_memory_size(self->guard->memory)
               : 0;
}

static fmi2Status replay_from_start(tl_fmu_guarded *self) {
    return self->replay != NULL && tl_fmu_replay_start(self->replay) == fmi2OK
               ? tl_fmu_replay_restore_start(self->replay)
               : fmi2Error;
}

/* Some FMUs open libraries in their first steps. An earlier copy lacks these, so the FMU is reset
 * and copied again. */
static fmi2Status renew_start(tl_fmu_guarded *self) {
    tl_fmu_guard *guard = self->guard;
    drop_copy(guard);
    fmi2Status status = guard->renewals < MOST_RENEWALS ? replay_from_start(self) : fmi2Error;
    guard->renewals++;
    if (status > fmi2Warning) {
        return status;
    }
    self->replay->phase = TL_FMU_REPLAY_WAITS;
    tl_fmu_logger_log(&guard->logger, TL_LOG_NOTICE, "has opened a library in a step: it is started again with it");
    return save_memory(self, &guard->full_copy);
}

static bool is_to_be_renewed(const tl_fmu_guarded *self) {
    const tl_fmu_guard *guard = self->guard;
    return guard->by_memory && guard->full_copy != NULL && !guard->was_proved && self->replay != NULL &&
           tl_fmu_memory_has_unknown_library(guard->memory, guard->full_copy);
}

static fmi2Status restore_start(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (is_to_be_renewed(self)) {
        return renew_start(self);
    }
    if (guard->full_copy != NULL && !self->by_replay) {
        return restore_memory(component, guard->full_copy);
    }
    fmi2Status status = guard->was_proved ? fmi2Error : replay_from_start(self);
    if (self->replay != NULL && !self->by_replay && !guard->was_proved) {
        self->replay->phase = TL_FMU_REPLAY_WAITS;
    }
    return status;
}

/* `cause`: what was wrong; "": not known. Only replay is a warning, because it is slow. */
static fmi2Status log_fallback(tl_fmu_guarded *self, const char *finding, const char *cause, const char *remedy) {
    tl_error text;
    tl_log_level level = self->by_replay ? TL_LOG_WARNING : TL_LOG_NOTICE;
    bool is_known = cause[0] != '\0';
    (void)tl_fail(&text, TL_FMU_FAILED, "%s%s%s%s: %s", finding, is_known ? " (" : "", cause, is_known ? ")" : "",
                  remedy);
    tl_fmu_logger_log(&self->guard->logger, level, text.text);
    return fmi2OK;
}

static void free_first_state(tl_fmu_guarded *self) {
    if (self->guard->beginning != NULL) {
        (void)self->guard->by_states.free_fmu_state(self, &self->guard->beginning);
        self->guard->beginning = NULL;
    }
}

static void end_proof(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    void *copy = NULL;
    if (guard->beginning != NULL) { /* copies are proved; the freed state must not count in the estimate */
        tl_fmu_memory_freeze_estimate(guard->memory, true);
        free_first_state(self);
        (void)save_memory(self, &copy);
        tl_fmu_memory_forget(copy);
        tl_fmu_memory_freeze_estimate(guard->memory, false);
    }
    if (guard->sets_inputs && !guard->was_proved) {
        (void)log_fallback(self, "rollback by its own states is not exact", "parameters kept",
                           "its inputs and parameters are set again after each restore");
    }
    drop_copy(guard);
    if (!guard->by_memory) {
        forget_instantiated(guard);
    }
    guard->was_proved = true;
    guard->functions.replay.steps = 0;
    if (!self->by_replay && !guard->sets_inputs) {
        end_recording(self);
    }
}

/* Tries own states with inputs, then replay, then replay with a new instance instead of a reset. */
static fmi2Status use_inputs_or_replay(tl_fmu_guarded *self, const char *cause) {
    tl_fmu_guard *guard = self->guard;
    if (!has_fallback(self)) {
        return fmi2Error;
    }
    if (self->last_inputs != NULL && !self->by_replay && !guard->sets_inputs) {
        drop_copy(guard);
        guard->sets_inputs = true;
        roll_back_by(guard, &BY_STATES_AND_INPUTS);
        return restore_start(self);
    }
    guard->sets_inputs = false;
    drop_copy(guard);
    guard->renews = guard->renews || self->by_replay;
    if (!self->by_replay) {
        self->by_replay = true;
        if (guard->by_memory) { /* FMUs that share the memory cannot use it any more */
            guard->memory->is_given_up = true;
        }
        roll_back_by_replay(guard);
        (void)log_fallback(self, "no faster rollback method works", cause,
                           "it is rolled back by replay (reset, then its inputs again)");
    }
    return replay_from_start(self);
}

/* While copies are proved, the FMU's own state from the start of the proof exists. Later only the
 * copy from then exists. */
static fmi2Status use_states_again(tl_fmu_guarded *self, const char *cause) {
    tl_fmu_guard *guard = self->guard;
    fmi2Status status =
        guard->beginning != NULL ? guard->by_states.set_fmu_state(self, guard->beginning) : restore_start(self);
    if (status > fmi2Warning) {
        return status;
    }
    free_first_state(self);
    guard->is_by_choice = false;
    roll_back_by(guard, &guard->by_states);
    return log_fallback(self, "rollback by its memory is not exact", cause, "it is rolled back by its own states");
}

static fmi2Status replace_method(fmi2Component component, const char *cause) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (guard->is_by_choice) {
        return use_states_again(self, cause);
    }
    if (guard->lacks_library) { /* the method is right, only its copies are too old */
        guard->lacks_library = false;
        return restore_start(self);
    }
    bool has_memory_copy = guard->full_copy != NULL && !guard->by_memory && !self->by_replay;
    if (!has_memory_copy || restore_start(component) != fmi2OK) {
        return use_inputs_or_replay(self, cause);
    }
    roll_back_by_memory(guard);
    return log_fallback(self, "rollback by its own states is not exact", cause, "it is rolled back by its memory");
}

/* ---- choice between two exact methods ---- */

static bool has_choice(fmi2Component component) {
    const tl_fmu_guarded *self = component;
    const tl_fmu_guard *guard = self->guard;
    return guard->full_copy != NULL && tl_fmu_memory_remaining(guard->memory) == NULL && !guard->was_proved &&
           !guard->by_memory && !guard->sets_inputs && !self->by_replay;
}

/* The FMU saves its own state first, so that all copies contain it. */
static fmi2Status prefer_copy(fmi2Component component, const tl_fmi2_times *times) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    guard->beginning = NULL;
    if (guard->by_states.get_fmu_state(component, &guard->beginning) > fmi2Warning ||
        save_memory(component, &guard->full_copy) != fmi2OK) {
        free_first_state(self);
        return fmi2Error;
    }
    guard->is_by_choice = true;
    guard->times = *times;
    roll_back_by_memory(guard);
    return fmi2OK;
}

/* ---- first method ---- */

void tl_fmu_guard_choose_method(tl_fmu_guard *guard) {
    static const tl_fmi2_fallback fallback = {.keep = keep_start,
                                              .restore_start = restore_start,
                                              .next_method = replace_method,
                                              .end_proof = end_proof,
                                              .size = size_start,
                                              .has_choice = has_choice,
                                              .prefer_copy = prefer_copy};
    bool by_memory = guard->by_memory;
    roll_back_by(guard, &guard->by_states);
    /* A Python FMU's own states contain only the variables that its author has registered. */
    guard->functions.prefers_copies = guard->memory != NULL && guard->memory != &guard->own_memory;
    guard->functions.fallback = NULL;
    guard->functions.replay.most = 0;
    if (by_memory) {
        roll_back_by_memory(guard);
    } else if (guard->by_replay) {
        roll_back_by_replay(guard);
    }
    if (guard->may_replay || (guard->memory != NULL && !guard->by_memory)) {
        guard->functions.fallback = &fallback;
    }
}

/* ---- fmu guard ---- */

typedef tl_fmu_guarded guarded;

/* ---- changes of the process ---- */

/* `reported`: changes already logged for this instance or file. `where`: the call; NULL: the
 * present one. */
static void log_changes(tl_fmu_guard *guard, unsigned *reported, unsigned changes, const char *where) {
    char names[TL_HOST_CHANGE_TEXT];
    char text[TL_HOST_CHANGE_TEXT + 160];
    tl_fmu_call call = {.fmu = ""};
    unsigned unreported = changes & ~*reported;
    if (unreported == 0) {
        return;
    }
    *reported |= unreported;
    (void)tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call);
    tl_host_state_describe(unreported, names);
    (void)snprintf(text, sizeof text, "changed %s of the whole process in %s: restored (reported once)", names,
                   where != NULL ? where : call.function);
    tl_fmu_logger_log(&guard->logger, TL_LOG_NOTICE, text);
}

/* Not inlined because it is rarely needed. */
static void __attribute__((noinline, cold)) restore_thread(guarded *self, const char *where) {
    unsigned changes = 0;
    if (tl_fp_control_get() != self->control) {
        tl_fp_control_set(self->control);
        changes |= TL_HOST_ROUNDING;
    }
    if (uselocale((locale_t)0) != self->locale) {
        (void)uselocale(self->locale);
        changes |= TL_HOST_LOCALE;
    }
    log_changes(self->guard, &self->was_reported, changes, where);
}

/* ---- around a call ---- */

static bool is_unchanged(const guarded *self) {
    return tl_fp_control_get() == self->control && uselocale((locale_t)0) == self->locale;
}

static inline void enter(const guarded *self, tl_fmu_function function) {
    tl_fmu_call_begin(self->name, function);
    if (self->memory != NULL) {
        tl_fmu_memory_enter(self->memory);
    }
}

/* Must be the first action after a call, because later allocations do not belong to the FMU. */
static inline void leave_heap(const guarded *self) {
    if (self->memory != NULL) {
        tl_fmu_memory_leave(self->memory);
    }
}

static inline void end_call(fmi2Status status) {
    if (status > fmi2Warning) {
        tl_fmu_call_fail();
    }
    tl_fmu_call_end();
}

/* After an ordinary call: must not need a system call. */
static inline fmi2Status leave_guard(guarded *self, fmi2Status status) {
    leave_heap(self);
    if (!is_unchanged(self)) {
        restore_thread(self, NULL);
    }
    end_call(status);
    return status;
}

/* After a call that may change any process state. */
static fmi2Status leave_fully(guarded *self, fmi2Status status) {
    leave_heap(self);
    log_changes(self->guard, &self->was_reported, tl_host_state_put_back(), NULL);
    end_call(status);
    return status;
}

void tl_fmu_guard_enter(tl_fmu_guard *guard, tl_fmu_function function) {
    tl_fmu_call_begin(guard->name, function);
    if (guard->memory != NULL) {
        tl_fmu_memory_enter(guard->memory);
    }
}

void tl_fmu_guard_leave(tl_fmu_guard *guard) {
    if (guard->memory != NULL) {
        tl_fmu_memory_leave(guard->memory);
    }
    log_changes(guard, &guard->was_reported, tl_host_state_put_back(), NULL);
    tl_fmu_call_end();
}

/* ---- noting calls ---- */

static inline fmi2Status note_call(guarded *self, tl_fmu_prologue_kind kind, const fmi2ValueReference references[],
                                   size_t count, const void *values, fmi2Status status) {
    if (self->replay != NULL) {
        tl_fmu_replay_note(self->replay, kind, references, count, values, status);
    }
    if (self->last_inputs != NULL) {
        tl_last_inputs_note(self->last_inputs, kind, references, values);
    }
    return status;
}

static void free_fmu(guarded *self) {
    if (self->instance != NULL) { /* NULL if a new instance could not be created */
        enter(self, TL_FMU_FREE_INSTANCE);
        self->own->free_instance(self->instance);
        (void)leave_fully(self, fmi2OK);
    }
}

/* The size estimate is frozen, because initialisation changes much after this copy. */
static void keep_instantiated(guarded *self) {
    tl_fmu_guard *guard = self->guard;
    tl_error ignored;
    if (guard->memory == &guard->own_memory) {
        tl_fmu_memory_freeze_estimate(guard->memory, true);
        (void)tl_fmu_memory_save(guard->memory, &guard->instantiated, &ignored);
        tl_fmu_memory_freeze_estimate(guard->memory, false);
    }
}

/* fmi2Reset is incomplete in many FMUs, but a copy from after fmi2Instantiate is exact. Returns
 * false if there is no copy, or if it is incomplete. */
static bool restore_instantiated(const guarded *self) {
    const tl_fmu_guard *guard = self->guard;
    bool is_possible = guard->by_memory && guard->instantiated != NULL &&
                       !tl_fmu_memory_has_new_library(guard->memory, guard->instantiated) &&
                       tl_fmu_memory_obstacle(guard->memory, guard->instantiated) == NULL;
    if (is_possible) {
        tl_fmu_memory_freeze_estimate(guard->memory, true);
        tl_fmu_memory_restore(guard->memory, guard->instantiated);
        tl_fmu_memory_freeze_estimate(guard->memory, false);
    }
    return is_possible;
}

/* Frees the FMU's instance and creates a new one. */
static fmi2Status replace_instance(guarded *self) {
    const struct begun *begun = &self->begun;
    forget_instantiated(self->guard);
    free_fmu(self);
    enter(self, TL_FMU_INSTANTIATE);
    self->instance = self->own->instantiate(begun->name, begun->type, begun->guid, begun->resources,
                                            &self->guard->fmu_callbacks, begun->visible, begun->logging);
    fmi2Status status = leave_fully(self, self->instance != NULL ? fmi2OK : fmi2Error);
    keep_instantiated(self);
    return status;
}

/* Resets the FMU so that it can be initialised. If fmi2Reset fails once, a new instance is created
 * from then on. */
static fmi2Status reset_to_start(fmi2Component component) {
    guarded *self = component;
    if (!self->guard->renews && self->own->reset != NULL) {
        enter(self, TL_FMU_RESET);
        fmi2Status status = leave_fully(self, self->own->reset(self->instance));
        if (status <= fmi2Warning || status == fmi2Fatal) {
            return status;
        }
    }
    self->guard->renews = true;
    return replace_instance(self);
}

static bool begin_recording(guarded *self) {
    self->replay = calloc(1, sizeof *self->replay);
    if (self->replay == NULL) {
        return false;
    }
    self->by_replay = self->guard->by_replay;
    *self->replay = (tl_fmu_replay){.most = self->guard->most,
                                    .results = &self->guard->functions.replay,
                                    .functions = &self->guard->functions,
                                    .instance = self,
                                    .reset = reset_to_start};
    return true;
}

static void note_ports(fmi2Component component, const tl_ports *inputs, const tl_ports *outputs) {
    guarded *self = component;
    if (self->replay != NULL) {
        self->replay->inputs = inputs;
        self->replay->outputs = outputs;
    }
    /* The ports are known now, so their values can be noted and set again after a restore. */
    if (self->guard->may_replay && !self->guard->was_proved && self->own->get_fmu_state != NULL &&
        self->last_inputs == NULL) {
        self->last_inputs = tl_last_inputs_open(inputs);
    }
}

/* ---- life of an instance ---- */

static void free_instance(fmi2Component component) {
    guarded *self = component;
    guarded **link = &self->guard->instances;
    free_fmu(self);
    while (*link != self) {
        link = &(*link)->next;
    }
    *link = self->next;
    end_recording(self);
    free(self);
}

static fmi2Component instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                 const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    tl_fmu_guard *guard = callbacks->componentEnvironment;
    guarded *self = calloc(1, sizeof *self);
    if (self == NULL) {
        return NULL;
    }
    *self = (guarded){.own = &guard->own, .name = tl_fmu_calls_name(name), .memory = guard->memory, .guard = guard};
    self->begun = (struct begun){name, guid, resources, type, visible, logging};
    self->is_noted = guard->memory != NULL || guard->may_replay;
    self->set_real = guard->own.set_real;
    self->do_step = guard->own.do_step;
    self->get_real = guard->own.get_real;
    self->control = tl_fp_control_get();
    self->locale = uselocale((locale_t)0);
    self->characters = (const unsigned short *const *)__ctype_b_loc();
    self->table = *self->characters;
    if (replace_instance(self) != fmi2OK) {
        free(self);
        return NULL;
    }
    self->next = guard->instances;
    guard->instances = self;
    if (guard->may_replay && !begin_recording(self)) {
        free_instance(self);
        return NULL;
    }
    return self;
}

/* Some FMUs can only start at 0. A run that resumes, or resets its FMUs, starts them later. */
static fmi2Status setup_at_0(guarded *self, const tl_fmu_setup *setup) {
    tl_error text;
    enter(self, TL_FMU_SETUP_EXPERIMENT);
    fmi2Status status = leave_fully(
        self, self->own->setup_experiment(self->instance, setup->has_tolerance, setup->tolerance, 0.0, setup->has_stop,
                                          setup->has_stop != fmi2False ? setup->stop - setup->start : setup->stop));
    if (status <= fmi2Warning) {
        self->shift = setup->start;
        (void)tl_fail(&text, TL_OK, "refuses to start at %g s: it starts at 0 s, and its time stays %g s behind",
                      setup->start, setup->start);
        tl_fmu_logger_log(&self->guard->logger, TL_LOG_WARNING, text.text);
    }
    return status;
}

/* Steps of FMUs by older versions of OpenModelica take longer, the later the stop time is: minutes
 * if a run has no end. They need no stop time. */
static bool omits_stop(const guarded *self, fmi2Real start, fmi2Real stop) {
    return self->guard->is_by_openmodelica && stop - start >= TL_EXPERIMENT_FAR;
}

static fmi2Status setup_experiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                   fmi2Real start, fmi2Boolean stops, fmi2Real stop) {
    guarded *self = component;
    fmi2Boolean has_stop = stops != fmi2False && !omits_stop(self, start, stop) ? fmi2True : fmi2False;
    const tl_fmu_setup setup = {tolerance, start, stop, has_tolerance, has_stop};
    self->shift = 0.0;
    enter(self, TL_FMU_SETUP_EXPERIMENT);
    fmi2Status status =
        leave_fully(self, self->own->setup_experiment(self->instance, has_tolerance, tolerance, start, has_stop, stop));
    if ((status == fmi2Error || status == fmi2Discard) && fabs(start) > 0.0) {
        status = setup_at_0(self, &setup);
    }
    return note_call(self, TL_PROLOGUE_SETUP, NULL, 1, &setup, status);
}

static fmi2Status enter_initialization_mode(fmi2Component component) {
    guarded *self = component;
    enter(self, TL_FMU_ENTER_INITIALIZATION_MODE);
    fmi2Status status = leave_fully(self, self->own->enter_initialization_mode(self->instance));
    return note_call(self, TL_PROLOGUE_ENTER_INITIALIZATION, NULL, 0, NULL, status);
}

static fmi2Status exit_initialization_mode(fmi2Component component) {
    guarded *self = component;
    enter(self, TL_FMU_EXIT_INITIALIZATION_MODE);
    fmi2Status status = leave_fully(self, self->own->exit_initialization_mode(self->instance));
    return note_call(self, TL_PROLOGUE_EXIT_INITIALIZATION, NULL, 0, NULL, status);
}

static fmi2Status terminate(fmi2Component component) {
    guarded *self = component;
    enter(self, TL_FMU_TERMINATE);
    return leave_fully(self, self->own->terminate(self->instance));
}

static fmi2Status call_reset(guarded *self) {
    enter(self, TL_FMU_RESET);
    return leave_fully(self, self->own->reset(self->instance));
}

static fmi2Status reset(fmi2Component component) {
    guarded *self = component;
    fmi2Status status = restore_instantiated(self) ? fmi2OK : call_reset(self);
    if (self->replay != NULL && status <= fmi2Warning) {
        tl_fmu_replay_begin(self->replay);
    }
    return status;
}

/* ---- values ---- */

static fmi2Status get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           fmi2Real values[]) {
    guarded *self = component;
    enter(self, TL_FMU_GET_REAL);
    fmi2Status status = leave_guard(self, self->own->get_real(self->instance, references, count, values));
    return note_call(self, TL_PROLOGUE_GET_REAL, references, count, values, status);
}

static fmi2Status get_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Integer values[]) {
    guarded *self = component;
    enter(self, TL_FMU_GET_INTEGER);
    fmi2Status status = leave_guard(self, self->own->get_integer(self->instance, references, count, values));
    return note_call(self, TL_PROLOGUE_GET_INTEGER, references, count, values, status);
}

static fmi2Status get_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Boolean values[]) {
    guarded *self = component;
    enter(self, TL_FMU_GET_BOOLEAN);
    fmi2Status status = leave_guard(self, self->own->get_boolean(self->instance, references, count, values));
    return note_call(self, TL_PROLOGUE_GET_BOOLEAN, references, count, values, status);
}

static fmi2Status set_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           const fmi2Real values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_REAL);
    fmi2Status status = leave_guard(self, self->own->set_real(self->instance, references, count, values));
    return note_call(self, TL_PROLOGUE_SET_REAL, references, count, values, status);
}

static fmi2Status set_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Integer values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_INTEGER);
    fmi2Status status = leave_guard(self, self->own->set_integer(self->instance, references, count, values));
    return note_call(self, TL_PROLOGUE_SET_INTEGER, references, count, values, status);
}

static fmi2Status set_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Boolean values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_BOOLEAN);
    fmi2Status status = leave_guard(self, self->own->set_boolean(self->instance, references, count, values));
    return note_call(self, TL_PROLOGUE_SET_BOOLEAN, references, count, values, status);
}

static fmi2Status set_string(fmi2Component component, const fmi2ValueReference references[], size_t count,
                             const fmi2String values[]) {
    guarded *self = component;
    enter(self, TL_FMU_SET_STRING);
    fmi2Status status = leave_guard(self, self->own->set_string(self->instance, references, count, values));
    return note_call(self, TL_PROLOGUE_SET_STRING, references, count, values, status);
}

/* ---- steps ---- */

/* The prologue ends at the first step, even if no state was saved there. */
static void note_step(const guarded *self, const tl_fmi2_step *step, fmi2Status status) {
    if (self->replay == NULL) {
        return;
    }
    if (self->by_replay && self->replay->phase == TL_FMU_REPLAY_BEGINS) {
        self->guard->functions.replay.is_over = tl_fmu_replay_start(self->replay) != fmi2OK;
    }
    tl_fmu_replay_note_step(self->replay, step, status);
}

/* PythonFMU returns fmi2Fatal if a script raises an exception. A restore of its memory undoes this
 * too, so only the step has failed. */
static inline fmi2Status step_status(const guarded *self, fmi2Status status) {
    bool is_undone = self->guard->by_memory && self->guard->functions.prefers_copies;
    return status == fmi2Fatal && is_undone ? fmi2Error : status;
}

static fmi2Status do_step(fmi2Component component, fmi2Real now, fmi2Real step, fmi2Boolean final) {
    guarded *self = component;
    enter(self, TL_FMU_DO_STEP);
    fmi2Status status = leave_guard(self, self->own->do_step(self->instance, now - self->shift, step, final));
    status = step_status(self, status);
    const tl_fmi2_step made = {.now = now, .size = step, .final = final};
    note_step(self, &made, status);
    return status;
}

/* Between two instances of one macro step only a quick check is possible: the full check would take
 * as long as a step of a small FMU. It checks the effect of the control bits (host_state.h), and
 * the character table, which changes with the locale unless the new locale was made from ours. */
static inline void check_thread(guarded *self) {
    if (!tl_fp_control_holds(&self->control) || *self->characters != self->table) {
        restore_thread(self, "a step");
    }
}

/* Notes the calls set, step and get; the last one made may have failed. */
static void note_reals(guarded *self, const tl_ports *inputs, const tl_ports *outputs, const tl_fmi2_step *step,
                       unsigned done, fmi2Status status) {
    (void)note_call(self, TL_PROLOGUE_SET_REAL, inputs->real_references, inputs->real_count, inputs->reals,
                    done > 0 ? fmi2OK : status);
    if (done > 0) {
        note_step(self, step, done > 1 ? fmi2OK : status);
    }
    if (done > 1) {
        (void)note_call(self, TL_PROLOGUE_GET_REAL, outputs->real_references, outputs->real_count, outputs->reals,
                        status);
    }
}

/* The three calls of one instance. *done is set only if a call fails. */
static inline fmi2Status call_reals(tl_fmu_calls *calls, const guarded *self, tl_component *component,
                                    const tl_fmi2_step *step, unsigned *done) {
    const tl_ports *inputs = &component->inputs;
    const tl_ports *outputs = &component->outputs;
    tl_fmu_call_begin_in(calls, self->name, TL_FMU_SET_REAL);
    fmi2Status status = self->set_real(self->instance, inputs->real_references, inputs->real_count, inputs->reals);
    if (status > fmi2Warning) {
        *done = 0;
        return status;
    }
    component->executions++;
    tl_fmu_call_continue(calls, self->name, TL_FMU_DO_STEP);
    status = self->do_step(self->instance, component->start_s + step->now - self->shift, step->size,
                           tl_component_is_final(component, step->final));
    if (status > fmi2Warning) {
        *done = 1;
        return step_status(self, status);
    }
    tl_fmu_call_continue(calls, self->name, TL_FMU_GET_REAL);
    return self->get_real(self->instance, outputs->real_references, outputs->real_count, outputs->reals);
}

/* After the calls of an instance with memory of its own, or whose calls are noted. Computes nothing
 * before the thread is checked. */
static void __attribute__((noinline))
note_calls(guarded *self, const tl_component *component, const tl_fmi2_step *step, unsigned done, fmi2Status status) {
    leave_heap(self);
    if (!is_unchanged(self)) {
        restore_thread(self, "a step");
    }
    const tl_fmi2_step own = tl_component_own_step(component, step);
    note_reals(self, &component->inputs, &component->outputs, &own, done, status);
}

static tl_fmi2_end step_reals(tl_component *components, size_t count, const tl_fmi2_step *step) {
    tl_fmu_calls *calls = tl_fmu_calls_block;
    tl_component *component = components;
    guarded *self = component->instance;
    fmi2Status status = fmi2OK;
    unsigned done = 2;
    for (;;) {
        if (self->is_noted && self->memory != NULL) {
            tl_fmu_memory_enter(self->memory);
        }
        status = call_reals(calls, self, component, step, &done);
        if (self->is_noted) {
            note_calls(self, component, step, done, status);
        }
        if (status > fmi2Warning || ++component == components + count || component->mode != TL_MODE_STEPPING) {
            break;
        }
        check_thread(self);
        self = component->instance;
    }
    if (!is_unchanged(self)) { /* the last one keeps its exception flags, which the quick check would clear */
        restore_thread(self, "a step");
    }
    end_call(status);
    return (tl_fmi2_end){.stepped = (size_t)(component - components), .status = status, .done = done};
}

/* ---- states ---- */

/* An FMU may return fmi2OK without a state. Without this check, only a later restore would fail. */
static fmi2Status expect_state(guarded *self, const fmi2FMUstate *state, fmi2Status status) {
    if (status <= fmi2Warning && *state == NULL) {
        tl_fmu_logger_log(
            &self->guard->logger, TL_LOG_ERROR,
            "returned fmi2OK without a state (NULL), which counts as fmi2Error; set \"rollback\": \"memory\" in its "
            "component");
        return fmi2Error;
    }
    return status;
}

/* fmi2Discard if rollback does not need the function: the FMU can still be stepped. */
static fmi2Status crash_status(const guarded *self, bool is_serializing) {
    return is_serializing || self->guard->is_free ? fmi2Discard : fmi2Error;
}

/* After a crash in one of its own state functions. */
static fmi2Status report_caught(guarded *self, bool is_serializing) {
    char text[160];
    tl_fmu_call call = {.function = ""};
    (void)tl_fmu_calls_poll(tl_fmu_calls_in_use(), &call);
    self->guard->has_crashed = self->guard->has_crashed || !is_serializing;
    (void)snprintf(text, sizeof text, "crashed in %s: %s; %s", call.function, tl_crash_caught(),
                   is_serializing ? "its states are not serialised" : "its own states are not used any more");
    tl_fmu_logger_log(&self->guard->logger, TL_LOG_WARNING, text);
    return leave_guard(self, crash_status(self, is_serializing));
}

/* CALL calls one of the FMU's own state functions; unfinished ones crash in their first call.
 * After the proof a crash is caught only while serialising, because otherwise it has another
 * cause. */
#define STATE_CALL(self, function, is_serializing, CALL)                                                               \
    do {                                                                                                               \
        if ((self)->guard->has_crashed) {                                                                              \
            return crash_status(self, (is_serializing));                                                               \
        }                                                                                                              \
        enter(self, (function));                                                                                       \
        if (((is_serializing) || !(self)->guard->was_proved) && TL_CRASH_CATCH()) {                                    \
            return report_caught(self, (is_serializing));                                                              \
        }                                                                                                              \
        fmi2Status status = (CALL);                                                                                    \
        tl_crash_catch_end();                                                                                          \
        return leave_guard(self, status);                                                                              \
    } while (0)

static fmi2Status get_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    guarded *self = component;
    STATE_CALL(self, TL_FMU_GET_STATE, false,
               expect_state(self, state, self->own->get_fmu_state(self->instance, state)));
}

static fmi2Status set_fmu_state(fmi2Component component, fmi2FMUstate state) {
    guarded *self = component;
    STATE_CALL(self, TL_FMU_SET_STATE, false, self->own->set_fmu_state(self->instance, state));
}

static fmi2Status free_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    guarded *self = component;
    STATE_CALL(self, TL_FMU_FREE_STATE, false, self->own->free_fmu_state(self->instance, state));
}

static fmi2Status serialized_fmu_state_size(fmi2Component component, fmi2FMUstate state, size_t *size) {
    guarded *self = component;
    STATE_CALL(self, TL_FMU_SERIALIZED_SIZE, true, self->own->serialized_fmu_state_size(self->instance, state, size));
}

static fmi2Status serialize_fmu_state(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    guarded *self = component;
    STATE_CALL(self, TL_FMU_SERIALIZE, true, self->own->serialize_fmu_state(self->instance, state, bytes, size));
}

static fmi2Status deserialize_fmu_state(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                        fmi2FMUstate *state) {
    guarded *self = component;
    enter(self, TL_FMU_DESERIALIZE);
    return leave_guard(self,
                       expect_state(self, state, self->own->deserialize_fmu_state(self->instance, bytes, size, state)));
}

static fmi2Status get_boolean_status(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    guarded *self = component;
    enter(self, TL_FMU_GET_BOOLEAN_STATUS);
    return leave_guard(self, self->own->get_boolean_status(self->instance, kind, value));
}

/* ---- the guard ---- */

void tl_fmu_guard_open(tl_fmu_guard *guard, const char *name, const char *generator) {
    *guard = (tl_fmu_guard){.name = tl_fmu_calls_name(name),
                            .is_by_openmodelica = strncmp(generator, "OpenModelica", strlen("OpenModelica")) == 0};
    tl_host_state_keep();
    tl_fmu_logger_open(&guard->logger, name, generator);
    guard->callbacks = (fmi2CallbackFunctions){tl_fmu_logger_take, calloc, free, NULL, guard};
    guard->fmu_callbacks = (fmi2CallbackFunctions){tl_fmu_logger_take, calloc, free, NULL, &guard->logger};
}

void tl_fmu_guard_front(tl_fmu_guard *guard, const tl_fmi2 *own) {
    guard->own = *own;
    guard->functions = (tl_fmi2){
        .instantiate = instantiate,
        .free_instance = free_instance,
        .setup_experiment = setup_experiment,
        .enter_initialization_mode = enter_initialization_mode,
        .exit_initialization_mode = exit_initialization_mode,
        .terminate = terminate,
        .reset = reset,
        .get_real = get_real,
        .get_integer = get_integer,
        .get_boolean = get_boolean,
        .set_real = set_real,
        .set_integer = set_integer,
        .set_boolean = set_boolean,
        .set_string = set_string,
        .get_fmu_state = own->get_fmu_state != NULL ? get_fmu_state : NULL,
        .set_fmu_state = own->set_fmu_state != NULL ? set_fmu_state : NULL,
        .free_fmu_state = own->free_fmu_state != NULL ? free_fmu_state : NULL,
        .serialized_fmu_state_size = own->serialized_fmu_state_size != NULL ? serialized_fmu_state_size : NULL,
        .serialize_fmu_state = own->serialize_fmu_state != NULL ? serialize_fmu_state : NULL,
        .deserialize_fmu_state = own->deserialize_fmu_state != NULL ? deserialize_fmu_state : NULL,
        .get_boolean_status = own->get_boolean_status != NULL ? get_boolean_status : NULL,
        .do_step = do_step,
        .step_reals = step_reals,
    };
    guard->by_states = guard->functions;
    tl_fmu_guard_choose_method(guard);
    if (guard->may_replay) {
        guard->functions.know_ports = note_ports;
    }
}

void tl_fmu_guard_close(tl_fmu_guard *guard) {
    tl_fmu_memory_forget(guard->full_copy);
    guard->full_copy = NULL;
    forget_instantiated(guard);
    if (guard->memory != NULL) {
        tl_fmu_memory_free_reserve(guard->memory);
    }
    for (guarded *self = guard->instances, *next = NULL; self != NULL; self = next) {
        next = self->next;
        end_recording(self);
        free(self);
    }
    guard->instances = NULL;
    tl_fmu_logger_close(&guard->logger);
}

void tl_fmu_guard_tick(bool whole) {
    static unsigned reported; /* per process, because the changes affect the process */
    char names[TL_HOST_CHANGE_TEXT];
    unsigned changes = whole ? tl_host_state_put_back() : tl_host_state_put_back_next();
    unsigned unreported = changes & ~reported;
    if (unreported != 0) {
        static tl_log_limiter limiter = TL_LOG_LIMITER(1);
        reported |= unreported;
        tl_host_state_describe(unreported, names);
        tl_log_limited(&limiter, TL_LOG_NOTICE,
                       "an FMU changed %s of the whole process in its steps: restored with the ticks, but not by a "
                       "rollback; if its results depend on this, they may be wrong (reported once)",
                       names);
    }
}
