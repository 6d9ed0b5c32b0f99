/* Rollback methods of an FMU, see rollback_method.h. */
#include "firmware/fmu/rollback_method.h"

#include <stdbool.h>
#include <stdlib.h>

#include "firmware/base/log.h"
#include "firmware/fmu/fmu_logger.h"
#include "firmware/fmu/last_inputs.h"
#include "firmware/fmu/memory_state.h"
#include "firmware/rollback/fmu_memory.h"
#include "firmware/rollback/fmu_replay.h"
#include "master/base/status.h"

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
    tl_last_inputs_state *kept = tl_last_inputs_save(self->last_inputs, *state);
    if (kept == NULL) {
        return fmi2Error;
    }
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

void tl_rollback_method_end_recording(tl_fmu_guarded *self) {
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
static const tl_fmi2 BY_STATES_AND_INPUTS = {
    .get_fmu_state = keep_state_and_inputs, .set_fmu_state = restore_and_set, .free_fmu_state = free_state_and_inputs};
static const tl_fmi2 BY_REPLAY = {.always_final = true,
                                  .get_fmu_state = keep_position,
                                  .set_fmu_state = go_to_position,
                                  .free_fmu_state = free_position};

static void roll_back_by(tl_fmu_guard *guard, const tl_fmi2 *method) {
    tl_fmi2 *functions = &guard->functions;
    guard->by_memory = method == &tl_memory_state_functions;
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
    roll_back_by(guard, &tl_memory_state_functions);
    tl_fmu_memory_remeasure(guard->memory);
    if (!guard->is_by_choice || guard->by_states.serialize_fmu_state == NULL) {
        functions->serialized_fmu_state_size = NULL;
        functions->serialize_fmu_state = NULL;
        functions->deserialize_fmu_state = NULL;
    }
}

static void roll_back_by_replay(tl_fmu_guard *guard) {
    roll_back_by(guard, &BY_REPLAY);
    guard->by_replay = true;
    guard->functions.replay.most = guard->most;
}

/* ---- fallback to the next method ---- */

void tl_rollback_method_forget_instantiated(tl_fmu_guard *guard) {
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
        tl_rollback_method_forget_instantiated(guard);
        tl_fmu_memory_restart_storage(guard->memory);
    }
    tl_fmu_memory_freeze_estimate(guard->memory, true);
    bool is_saved = tl_memory_state_save(self, &guard->full_copy) == fmi2OK;
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
                    (!guard->by_memory || tl_fmu_memory_side_effect(guard->memory) == NULL);
    bool has_copy = may_copy && save_first(self);
    return has_copy || tl_fmu_guarded_has_fallback(self) ? fmi2OK : fmi2Error;
}

static void drop_copy(tl_fmu_guard *guard) {
    tl_fmu_memory_forget(guard->full_copy);
    tl_fmu_memory_forget(guard->noted);
    guard->full_copy = NULL;
    guard->noted = NULL;
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

static fmi2Status restore_start(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    if (guard->full_copy != NULL && !self->by_replay) {
        return tl_memory_state_restore(component, guard->full_copy);
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
        (void)tl_memory_state_save(self, &copy);
        tl_fmu_memory_forget(copy);
        tl_fmu_memory_freeze_estimate(guard->memory, false);
    }
    if (guard->sets_inputs && !guard->was_proved) {
        (void)log_fallback(self, "rollback by its own states is not exact", "parameters kept",
                           "its inputs and parameters are set again after each restore");
    }
    drop_copy(guard);
    if (!guard->by_memory) {
        tl_rollback_method_forget_instantiated(guard);
    }
    guard->was_proved = true;
    guard->functions.replay.steps = 0;
    if (!self->by_replay && !guard->sets_inputs) {
        tl_rollback_method_end_recording(self);
    }
}

/* Tries own states with inputs, then replay, then replay with a new instance instead of a reset. */
static fmi2Status use_inputs_or_replay(tl_fmu_guarded *self, const char *cause) {
    tl_fmu_guard *guard = self->guard;
    if (!tl_fmu_guarded_has_fallback(self)) {
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
    return guard->full_copy != NULL && tl_fmu_memory_side_effect(guard->memory) == NULL && !guard->was_proved &&
           !guard->by_memory && !guard->sets_inputs && !self->by_replay;
}

/* The FMU saves its own state first, so that all copies contain it. */
static fmi2Status prefer_copy(fmi2Component component, const tl_fmi2_times *times) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    guard->beginning = NULL;
    if (guard->by_states.get_fmu_state(component, &guard->beginning) > fmi2Warning ||
        tl_memory_state_save(component, &guard->full_copy) != fmi2OK) {
        free_first_state(self);
        return fmi2Error;
    }
    guard->is_by_choice = true;
    guard->times = *times;
    roll_back_by_memory(guard);
    return fmi2OK;
}

static fmi2Status note_memory(fmi2Component component) {
    tl_fmu_guarded *self = component;
    tl_fmu_guard *guard = self->guard;
    tl_fmu_memory_freeze_estimate(guard->memory, true);
    fmi2Status status = tl_memory_state_save(component, &guard->noted);
    tl_fmu_memory_freeze_estimate(guard->memory, false);
    return status;
}

static bool is_memory_same(fmi2Component component) {
    const tl_fmu_guarded *self = component;
    return tl_fmu_memory_is_same(self->guard->memory, self->guard->noted);
}

/* ---- first method ---- */

void tl_rollback_method_choose(tl_fmu_guard *guard) {
    static const tl_fmi2_fallback fallback = {.keep = keep_start,
                                              .restore_start = restore_start,
                                              .next_method = replace_method,
                                              .end_proof = end_proof,
                                              .size = size_start,
                                              .has_choice = has_choice,
                                              .prefer_copy = prefer_copy,
                                              .note_memory = note_memory,
                                              .is_memory_same = is_memory_same};
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
