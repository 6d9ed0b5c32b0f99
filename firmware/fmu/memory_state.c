/* States that are copies of an FMU's memory, see memory_state.h. */
#include "firmware/fmu/memory_state.h"

#include <stddef.h>

#include "firmware/rollback/fmu_memory.h"

/* A warning if another rollback method remains, else an error. */
static void log_failure(tl_fmu_guarded *self, const char *text) {
    tl_log_level level = tl_fmu_guarded_has_fallback(self) ? TL_LOG_WARNING : TL_LOG_ERROR;
    tl_fmu_logger_log(&self->guard->logger, level, text);
}

/* The FMU has side effects that no copy contains. Logged once; not logged after the proof if the
 * FMU is not rolled back by memory, because then it needs no copy. */
static fmi2Status reject_copy(tl_fmu_guarded *self, const char *side_effect) {
    tl_error error;
    bool was_exact = self->guard->is_by_choice && self->guard->was_proved;
    (void)tl_fail(&error, TL_FMU_FAILED, "its memory cannot be copied, because it has %s%s", side_effect,
                  was_exact                           ? "; set \"rollback\": \"state\" in its component"
                  : tl_fmu_guarded_has_fallback(self) ? ""
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

fmi2Status tl_memory_state_save(fmi2Component component, fmi2FMUstate *state) {
    tl_fmu_guarded *self = component;
    tl_error error;
    const char *side_effect = tl_fmu_memory_side_effect(self->guard->memory);
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

fmi2Status tl_memory_state_restore(fmi2Component component, fmi2FMUstate state) {
    tl_fmu_guarded *self = component;
    const char *obstacle = tl_fmu_memory_obstacle(self->guard->memory, state);
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
    bool is_kept = tl_memory_state_save(self, present) == fmi2OK;
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
    if (status <= fmi2Warning && tl_memory_state_save(self, copy) != fmi2OK) {
        status = fmi2Error;
    }
    restore_present(self, present);
    return status;
}

const tl_fmi2 tl_memory_state_functions = {.always_final = true,
                                           .get_fmu_state = tl_memory_state_save,
                                           .set_fmu_state = tl_memory_state_restore,
                                           .free_fmu_state = free_memory,
                                           .state_size = memory_size,
                                           .reserve_states = reserve_memory,
                                           .serialized_fmu_state_size = copy_bytes_size,
                                           .serialize_fmu_state = copy_bytes_write,
                                           .deserialize_fmu_state = copy_bytes_read};
