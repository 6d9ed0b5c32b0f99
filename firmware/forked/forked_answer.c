/* Calls of the FMU: see forked_answer.h. */
#include "firmware/forked/forked_answer.h"

#include <string.h>

#include "firmware/forked/forked_layout.h"
#include "master/fmi/component.h"

typedef struct call {
    const tl_fmi2 *fmi;
    fmi2Component instance;
    tl_forked_message *message;
    size_t count;
} call;

/* ---- texts ---- */

tl_forked_texts tl_forked_texts_of(tl_forked_message *message) {
    message->bytes[TL_FORKED_BYTES - 1] = '\0';
    return (tl_forked_texts){(const char *)message->bytes, (const char *)message->bytes + TL_FORKED_BYTES};
}

const char *tl_forked_texts_next(tl_forked_texts *texts) {
    const char *text = texts->at < texts->end ? texts->at : "";
    texts->at += texts->at < texts->end ? strlen(text) + 1 : 0;
    return text;
}

/* ---- values ---- */

#define FITS(call, type) (tl_forked_fits((call)->count, sizeof(type)))
#define REFERENCES(call, type) (tl_forked_references((call)->message, (call)->count, sizeof(type)))
#define VALUES(call, type) ((type *)(void *)(call)->message->bytes)

/* `one`: get_real and its like. */
#define ASK(call, one, type)                                                                                           \
    (FITS(call, type) ? (call)->fmi->one((call)->instance, REFERENCES(call, type), (call)->count, VALUES(call, type))  \
                      : fmi2Error)

static fmi2Status set_strings(const call *self) {
    static const char *strings[TL_FORKED_STRINGS];
    static fmi2ValueReference references[TL_FORKED_STRINGS];
    if (self->count > TL_FORKED_STRINGS) {
        return fmi2Error;
    }
    memcpy(references, self->message->bytes, self->count * sizeof *references);
    tl_forked_texts texts = tl_forked_texts_of(self->message);
    texts.at += self->count * sizeof *references;
    for (size_t i = 0; i < self->count; i++) {
        strings[i] = tl_forked_texts_next(&texts);
    }
    return self->fmi->set_string(self->instance, references, self->count, strings);
}

static fmi2Status step(const call *self) {
    tl_forked_message *message = self->message;
    size_t read = message->numbers[TL_FORKED_READ];
    unsigned done = 0;
    if (!tl_forked_fits(self->count, sizeof(fmi2Real)) || !tl_forked_fits(self->count + read, sizeof(fmi2Real))) {
        return fmi2Error;
    }
    fmi2Real *values = (fmi2Real *)(void *)message->bytes;
    fmi2ValueReference *references = tl_forked_references(message, self->count + read, sizeof *values);
    const tl_ports inputs = {.real_count = self->count, .real_references = references, .reals = values};
    const tl_ports outputs = {
        .real_count = read, .real_references = references + self->count, .reals = values + self->count};
    const tl_fmi2_step size = {.now = message->reals[0],
                               .size = message->reals[1],
                               .final = message->numbers[TL_FORKED_FLAG] != 0 ? fmi2True : fmi2False,
                               .last = true};
    fmi2Status status = self->fmi->step_reals(self->instance, &inputs, &outputs, &size, &done);
    message->numbers[TL_FORKED_DONE] = done;
    return status;
}

/* ---- life ---- */

static fmi2Status instantiate(tl_forked_answers *answers, tl_forked_message *message) {
    fmi2Component *place = &answers->instances[message->instance];
    tl_forked_texts texts = tl_forked_texts_of(message);
    const char *name = tl_forked_texts_next(&texts);
    const char *guid = tl_forked_texts_next(&texts);
    const char *resources = tl_forked_texts_next(&texts);
    *place = answers->fmu.functions->instantiate(name, fmi2CoSimulation, guid, resources, answers->fmu.callbacks,
                                                 fmi2False, message->numbers[TL_FORKED_FLAG] != 0);
    return *place != NULL ? fmi2OK : fmi2Error;
}

static fmi2Status free_instance(tl_forked_answers *answers, const call *self) {
    self->fmi->free_instance(self->instance);
    answers->instances[self->message->instance] = NULL;
    return fmi2OK;
}

static fmi2Status live(const call *self) {
    const double *reals = self->message->reals;
    fmi2Boolean flag = self->message->numbers[TL_FORKED_FLAG] != 0 ? fmi2True : fmi2False;
    switch (self->message->function) {
    case TL_FMU_SETUP_EXPERIMENT:
        return self->fmi->setup_experiment(self->instance, fmi2False, 0.0, reals[0], fmi2False, 0.0);
    case TL_FMU_ENTER_INITIALIZATION_MODE:
        return self->fmi->enter_initialization_mode(self->instance);
    case TL_FMU_EXIT_INITIALIZATION_MODE:
        return self->fmi->exit_initialization_mode(self->instance);
    case TL_FMU_TERMINATE:
        return self->fmi->terminate(self->instance);
    case TL_FMU_RESET:
        return self->fmi->reset(self->instance);
    case TL_FMU_DO_STEP:
        return self->fmi->do_step(self->instance, reals[0], reals[1], flag);
    default:
        return fmi2Error;
    }
}

static fmi2Status execute(const call *self) {
    switch (self->message->function) {
    case TL_FORKED_STEP:
        return step(self);
    case TL_FMU_GET_REAL:
        return ASK(self, get_real, fmi2Real);
    case TL_FMU_SET_REAL:
        return ASK(self, set_real, fmi2Real);
    case TL_FMU_GET_INTEGER:
        return ASK(self, get_integer, fmi2Integer);
    case TL_FMU_SET_INTEGER:
        return ASK(self, set_integer, fmi2Integer);
    case TL_FMU_GET_BOOLEAN:
        return ASK(self, get_boolean, fmi2Boolean);
    case TL_FMU_SET_BOOLEAN:
        return ASK(self, set_boolean, fmi2Boolean);
    case TL_FMU_SET_STRING:
        return set_strings(self);
    default:
        return live(self);
    }
}

void tl_forked_answer(tl_forked_answers *answers, tl_forked_message *message) {
    const call self = {.fmi = answers->fmu.functions,
                       .instance =
                           message->instance < TL_FORKED_INSTANCES ? answers->instances[message->instance] : NULL,
                       .message = message,
                       .count = message->numbers[TL_FORKED_COUNT]};
    bool is_made = message->function != TL_FMU_INSTANTIATE;
    if (self.fmi == NULL || message->instance >= TL_FORKED_INSTANCES || (self.instance == NULL && is_made)) {
        message->status = fmi2Error;
    } else if (!is_made) {
        message->status = (int32_t)instantiate(answers, message);
    } else if (message->function == TL_FMU_FREE_INSTANCE) {
        message->status = (int32_t)free_instance(answers, &self);
    } else {
        message->status = (int32_t)execute(&self);
    }
}
