/* An FMU's own bytes for copies of its memory: see fmu_bytes.h. */
#include "firmware/fmu/fmu_bytes.h"

static bool save(tl_fmu_guarded *self, void **copy) {
    tl_error error;
    if (tl_fmu_memory_save(&self->guard->memory, copy, &error) != TL_OK) {
        tl_fmu_logger_say(&self->guard->logger, TL_LOG_ERROR, "", error.text);
        return false;
    }
    return true;
}

/* What states of its own take is no measure of copies. */
static bool begin(tl_fmu_guarded *self, void **here) {
    *here = NULL;
    tl_fmu_memory_pass(&self->guard->memory, true);
    if (!save(self, here)) {
        tl_fmu_memory_pass(&self->guard->memory, false);
        return false;
    }
    return true;
}

/* Where it was, and no state of its own is there that was made since. */
static void leave(tl_fmu_guarded *self, void *here) {
    tl_fmu_memory_restore(&self->guard->memory, here);
    tl_fmu_memory_pass(&self->guard->memory, false);
    tl_fmu_memory_forget(here);
}

/* To a copy, and a state of its own there. */
static fmi2Status visit(tl_fmu_guarded *self, fmi2FMUstate copy, void **here, fmi2FMUstate *state) {
    *state = NULL;
    if (!begin(self, here)) {
        return fmi2Error;
    }
    tl_fmu_memory_restore(&self->guard->memory, copy);
    fmi2Status status = self->guard->by_states.get_fmu_state(self, state);
    if (status > fmi2Warning) {
        leave(self, *here);
    }
    return status;
}

fmi2Status tl_fmu_bytes_size(fmi2Component component, fmi2FMUstate copy, size_t *size) {
    tl_fmu_guarded *self = component;
    void *here;
    fmi2FMUstate state;
    fmi2Status status = visit(self, copy, &here, &state);
    if (status <= fmi2Warning) {
        status = self->guard->by_states.serialized_fmu_state_size(component, state, size);
        leave(self, here);
    }
    return status;
}

fmi2Status tl_fmu_bytes_write(fmi2Component component, fmi2FMUstate copy, fmi2Byte bytes[], size_t size) {
    tl_fmu_guarded *self = component;
    void *here;
    fmi2FMUstate state;
    fmi2Status status = visit(self, copy, &here, &state);
    if (status <= fmi2Warning) {
        status = self->guard->by_states.serialize_fmu_state(component, state, bytes, size);
        leave(self, here);
    }
    return status;
}

/* What it has made of the bytes, once it stands there. */
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

fmi2Status tl_fmu_bytes_read(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *copy) {
    tl_fmu_guarded *self = component;
    void *here;
    if (!begin(self, &here)) {
        return fmi2Error;
    }
    fmi2Status status = read_state(self, bytes, size);
    if (status <= fmi2Warning) {
        status = save(self, copy) ? status : fmi2Error;
    }
    leave(self, here);
    return status;
}
