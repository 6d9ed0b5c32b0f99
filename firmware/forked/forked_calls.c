/* Calls into another process: see forked_calls.h. */
#include "firmware/forked/forked_calls.h"

#include <stdio.h>
#include <string.h>

#include "firmware/base/log.h"
#include "firmware/forked/forked_layout.h"
#include "master/fmi/component.h"

typedef tl_forked_instance remote;

/* ---- messages ---- */

static fmi2Status ask(const remote *self, uint32_t function) {
    tl_forked_message *message = &self->line->block->message;
    message->instance = self->number;
    if (tl_forked_line_ask(self->line, function) != TL_OK) {
        return fmi2Fatal;
    }
    int32_t status = message->status;
    return status >= fmi2OK && status <= fmi2Pending ? (fmi2Status)status : fmi2Fatal;
}

static fmi2Status refuse_size(const remote *self) {
    tl_log(TL_LOG_ERROR, "FMU %s: more values in one call than its process is given", self->line->name);
    return fmi2Error;
}

/* Appends a text with its end. False: it does not fit. */
static bool add_text(tl_forked_message *message, size_t *used, const char *text) {
    size_t size = strlen(text) + 1;
    if (size > TL_FORKED_BYTES - *used) {
        return false;
    }
    memcpy(message->bytes + *used, text, size);
    *used += size;
    return true;
}

/* ---- values ---- */

static fmi2Status set_values(const remote *self, uint32_t function, const fmi2ValueReference references[], size_t count,
                             const void *values, size_t size) {
    tl_forked_message *message = &self->line->block->message;
    if (!tl_forked_fits(count, size)) {
        return refuse_size(self);
    }
    memcpy(message->bytes, values, count * size);
    memcpy(tl_forked_references(message, count, size), references, count * sizeof *references);
    message->numbers[TL_FORKED_COUNT] = (uint32_t)count;
    return ask(self, function);
}

static fmi2Status get_values(const remote *self, uint32_t function, const fmi2ValueReference references[], size_t count,
                             void *values, size_t size) {
    tl_forked_message *message = &self->line->block->message;
    if (!tl_forked_fits(count, size)) {
        return refuse_size(self);
    }
    memcpy(message->bytes, values, count * size); /* what an FMU does not write stays as it is */
    memcpy(tl_forked_references(message, count, size), references, count * sizeof *references);
    message->numbers[TL_FORKED_COUNT] = (uint32_t)count;
    fmi2Status status = ask(self, function);
    if (status != fmi2Fatal) {
        memcpy(values, message->bytes, count * size);
    }
    return status;
}

static fmi2Status get_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           fmi2Real values[]) {
    return get_values(component, TL_FMU_GET_REAL, references, count, values, sizeof *values);
}

static fmi2Status get_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Integer values[]) {
    return get_values(component, TL_FMU_GET_INTEGER, references, count, values, sizeof *values);
}

static fmi2Status get_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              fmi2Boolean values[]) {
    return get_values(component, TL_FMU_GET_BOOLEAN, references, count, values, sizeof *values);
}

static fmi2Status set_real(fmi2Component component, const fmi2ValueReference references[], size_t count,
                           const fmi2Real values[]) {
    return set_values(component, TL_FMU_SET_REAL, references, count, values, sizeof *values);
}

static fmi2Status set_integer(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Integer values[]) {
    return set_values(component, TL_FMU_SET_INTEGER, references, count, values, sizeof *values);
}

static fmi2Status set_boolean(fmi2Component component, const fmi2ValueReference references[], size_t count,
                              const fmi2Boolean values[]) {
    return set_values(component, TL_FMU_SET_BOOLEAN, references, count, values, sizeof *values);
}

static fmi2Status set_string(fmi2Component component, const fmi2ValueReference references[], size_t count,
                             const fmi2String values[]) {
    const remote *self = component;
    tl_forked_message *message = &self->line->block->message;
    if (!tl_forked_fits(count, 1)) {
        return refuse_size(self);
    }
    size_t used = count * sizeof *references;
    memcpy(message->bytes, references, used);
    for (size_t i = 0; i < count; i++) {
        if (!add_text(message, &used, values[i])) {
            return refuse_size(self);
        }
    }
    message->numbers[TL_FORKED_COUNT] = (uint32_t)count;
    return ask(self, TL_FMU_SET_STRING);
}

/* ---- life ---- */

static remote *find_unused(tl_forked_line *line) {
    uint32_t i = 0;
    while (i < TL_FORKED_INSTANCES && line->instances[i].used) {
        i++;
    }
    if (i == TL_FORKED_INSTANCES) {
        return NULL;
    }
    line->instances[i] = (remote){.line = line, .number = i};
    return &line->instances[i];
}

static fmi2Component instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                                 const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    tl_forked_line *line = callbacks->componentEnvironment;
    tl_forked_message *message = &line->block->message;
    remote *self = find_unused(line);
    size_t used = 0;
    (void)type;
    (void)visible;
    if (self == NULL || !add_text(message, &used, name) || !add_text(message, &used, guid) ||
        !add_text(message, &used, resources)) {
        return NULL;
    }
    (void)snprintf(line->name, sizeof line->name, "%s", name);
    message->numbers[TL_FORKED_FLAG] = logging != fmi2False ? 1 : 0;
    self->used = ask(self, TL_FMU_INSTANTIATE) == fmi2OK;
    return self->used ? self : NULL;
}

static void free_instance(fmi2Component component) {
    remote *self = component;
    (void)ask(self, TL_FMU_FREE_INSTANCE);
    self->used = false;
}

static fmi2Status setup_experiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance,
                                   fmi2Real start, fmi2Boolean has_stop, fmi2Real stop) {
    const remote *self = component;
    (void)tolerance;
    (void)stop;
    if (has_tolerance != fmi2False || has_stop != fmi2False) {
        return fmi2Error; /* nobody of ours gives them */
    }
    self->line->block->message.reals[0] = start;
    return ask(self, TL_FMU_SETUP_EXPERIMENT);
}

static fmi2Status enter_initialization_mode(fmi2Component component) {
    return ask(component, TL_FMU_ENTER_INITIALIZATION_MODE);
}

static fmi2Status exit_initialization_mode(fmi2Component component) {
    return ask(component, TL_FMU_EXIT_INITIALIZATION_MODE);
}

static fmi2Status terminate(fmi2Component component) {
    return ask(component, TL_FMU_TERMINATE);
}

static fmi2Status reset(fmi2Component component) {
    return ask(component, TL_FMU_RESET);
}

/* ---- steps ---- */

static void put_step(tl_forked_message *message, fmi2Real now, fmi2Real size, fmi2Boolean final) {
    message->reals[0] = now;
    message->reals[1] = size;
    message->numbers[TL_FORKED_FLAG] = final != fmi2False ? 1 : 0;
}

static fmi2Status do_step(fmi2Component component, fmi2Real now, fmi2Real size, fmi2Boolean final) {
    const remote *self = component;
    put_step(&self->line->block->message, now, size, final);
    return ask(self, TL_FMU_DO_STEP);
}

static fmi2Status step_reals(fmi2Component component, const tl_ports *inputs, const tl_ports *outputs,
                             const tl_fmi2_step *step, unsigned *done) {
    const remote *self = component;
    tl_forked_message *message = &self->line->block->message;
    size_t set = inputs->real_count;
    size_t read = outputs->real_count;
    *done = 0;
    if (!tl_forked_fits(set + read, sizeof(fmi2Real))) {
        return refuse_size(self);
    }
    fmi2Real *values = (fmi2Real *)(void *)message->bytes;
    fmi2ValueReference *references = tl_forked_references(message, set + read, sizeof *values);
    memcpy(values, inputs->reals, set * sizeof *values);
    memcpy(values + set, outputs->reals, read * sizeof *values);
    memcpy(references, inputs->real_references, set * sizeof *references);
    memcpy(references + set, outputs->real_references, read * sizeof *references);
    message->numbers[TL_FORKED_COUNT] = (uint32_t)set;
    message->numbers[TL_FORKED_READ] = (uint32_t)read;
    put_step(message, step->now, step->size, step->final);
    fmi2Status status = ask(self, TL_FORKED_STEP);
    if (status != fmi2Fatal) {
        memcpy(outputs->reals, values + set, read * sizeof *values);
    }
    *done = message->numbers[TL_FORKED_DONE] <= 2 ? message->numbers[TL_FORKED_DONE] : 0;
    return status;
}

/* ---- states ---- */

static fmi2Status status_of(tl_status status) {
    return status == TL_OK ? fmi2OK : status == TL_FMU_FATAL ? fmi2Fatal : fmi2Error;
}

static fmi2Status get_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    const remote *self = component;
    tl_forked_snapshot *snapshot = *state;
    tl_status status = tl_forked_line_save(self->line, &snapshot);
    *state = snapshot;
    return status_of(status);
}

static fmi2Status set_fmu_state(fmi2Component component, fmi2FMUstate state) {
    const remote *self = component;
    return status_of(tl_forked_line_restore(self->line, state));
}

static fmi2Status free_fmu_state(fmi2Component component, fmi2FMUstate *state) {
    const remote *self = component;
    tl_forked_line_forget(self->line, *state);
    *state = NULL;
    return fmi2OK;
}

/* ---- the table ---- */

tl_status tl_forked_load(tl_forked_line *line, const char *folder, const char *label, const char *name,
                         tl_error *error) {
    tl_forked_message *message = &line->block->message;
    size_t used = 0;
    (void)snprintf(line->name, sizeof line->name, "%s", name);
    if (!add_text(message, &used, folder) || !add_text(message, &used, label)) {
        return tl_fail(error, TL_BAD_DATA, "%s: its path is too long", label);
    }
    if (tl_forked_line_ask(line, TL_FMU_LOADING) != TL_OK) {
        return tl_fail(error, TL_FMU_FATAL, "%s: its process has ended while it was loaded", label);
    }
    char text[TL_ERROR_TEXT];
    (void)snprintf(text, sizeof text, "%.*s", (int)sizeof text - 1, (const char *)message->bytes);
    tl_status status = (tl_status)message->status;
    return status == TL_OK ? TL_OK : tl_fail(error, status == TL_TRY_AGAIN ? TL_TRY_AGAIN : TL_BAD_DATA, "%s", text);
}

const tl_fmi2 tl_forked_functions = {
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
    .get_fmu_state = get_fmu_state,
    .set_fmu_state = set_fmu_state,
    .free_fmu_state = free_fmu_state,
    .do_step = do_step,
    .step_reals = step_reals,
};
