/* Component: one instance of an FMU; see component.h. */
#include "master/fmi/component.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

size_t tl_ports_size(const tl_ports *ports) {
    return ports->real_count * sizeof *ports->reals + ports->integer_count * sizeof *ports->integers +
           ports->boolean_count * sizeof *ports->booleans;
}

void tl_ports_read(const tl_ports *ports, unsigned char *bytes) {
    size_t reals = ports->real_count * sizeof *ports->reals;
    size_t integers = ports->integer_count * sizeof *ports->integers;
    memcpy(bytes, ports->reals, reals);
    memcpy(bytes + reals, ports->integers, integers);
    memcpy(bytes + reals + integers, ports->booleans, ports->boolean_count * sizeof *ports->booleans);
}

void tl_ports_write(const tl_ports *ports, const unsigned char *bytes) {
    size_t reals = ports->real_count * sizeof *ports->reals;
    size_t integers = ports->integer_count * sizeof *ports->integers;
    memcpy(ports->reals, bytes, reals);
    memcpy(ports->integers, bytes + reals, integers);
    memcpy(ports->booleans, bytes + reals + integers, ports->boolean_count * sizeof *ports->booleans);
}

/* x − x is 0 for every finite x and NaN for all others: one test for many values. */
bool tl_reals_are_finite(const fmi2Real *values, size_t count) {
    double sum = (count & 1) != 0 ? values[count - 1] - values[count - 1] : 0.0;
    for (size_t i = 0; i + 1 < count; i += 2) {
        sum += (values[i] - values[i]) + (values[i + 1] - values[i + 1]);
    }
    return sum >= 0.0;
}

/* Converts the status of an FMI call; `call` is its name. */
static tl_status check_status(tl_component *component, fmi2Status status, const char *call, tl_error *error) {
    switch (status) {
    case fmi2OK:
    case fmi2Warning:
        return TL_OK;
    case fmi2Discard:
        return tl_fail(
            error, TL_FMU_FAILED,
            "%s: %s was discarded (fmi2Discard): the FMU cannot compute it with these values; see its messages in the "
            "log",
            component->name, call);
    case fmi2Error:
        component->mode = TL_MODE_FAILED;
        return tl_fail(error, TL_FMU_FAILED, "%s: %s failed (fmi2Error); see the FMU's messages in the log",
                       component->name, call);
    case fmi2Pending:
        component->mode = TL_MODE_FAILED;
        return tl_fail(error, TL_FMU_FAILED,
                       "%s: %s returned fmi2Pending, but twinlock requested no asynchronous step; export the FMU again",
                       component->name, call);
    case fmi2Fatal:
        break;
    }
    component->mode = TL_MODE_DEAD;
    if (status != fmi2Fatal) {
        return tl_fail(
            error, TL_FMU_FATAL,
            "%s: %s returned %d, which is not an fmi2Status: the FMU cannot be used any more; export it again",
            component->name, call, (int)status);
    }
    return tl_fail(
        error, TL_FMU_FATAL, "%s: %s failed (fmi2Fatal): the FMU cannot be used any more; %s", component->name, call,
        component->logging ? "see its messages in the log"
                           : "see its messages in the log, or set \"logging\": true in its component for more");
}

static fmi2Component instantiate(const tl_component *component, const fmi2CallbackFunctions *callbacks,
                                 const char *resources, bool logging) {
    return component->fmi->instantiate(component->name, fmi2CoSimulation, component->model->guid, resources, callbacks,
                                       fmi2False, logging ? fmi2True : fmi2False);
}

tl_status tl_component_instantiate(tl_component *component, const fmi2CallbackFunctions *callbacks,
                                   const char *resources, tl_error *error) {
    component->callbacks = callbacks;
    component->resources = resources;
    component->instance = instantiate(component, callbacks, resources, component->logging);
    if (component->instance == NULL && !component->logging) {
        component->instance = instantiate(component, callbacks, resources, true);
    }
    if (component->instance == NULL) {
        return tl_fail(error, TL_FMU_FAILED,
                       "%s: fmi2Instantiate failed; see the FMU's messages in the log; if there are none, the GUID in "
                       "modelDescription.xml (%s) probably differs from the binary's: export the FMU again",
                       component->name, component->model->guid);
    }
    component->mode = TL_MODE_INSTANTIATED;
    return TL_OK;
}

tl_status tl_component_set_start(tl_component *component, const tl_variable *variable, const tl_value *value,
                                 tl_error *error) {
    const tl_fmi2 *fmi = component->fmi;
    fmi2ValueReference reference = variable->reference;
    fmi2Integer integer = value->integer;
    fmi2Boolean boolean = value->integer != 0 ? fmi2True : fmi2False;
    fmi2String text = value->text;
    switch (variable->type) {
    case TL_REAL:
        return check_status(component, fmi->set_real(component->instance, &reference, 1, &value->real), "fmi2SetReal",
                            error);
    case TL_INTEGER:
    case TL_ENUMERATION:
        return check_status(component, fmi->set_integer(component->instance, &reference, 1, &integer), "fmi2SetInteger",
                            error);
    case TL_BOOLEAN:
        return check_status(component, fmi->set_boolean(component->instance, &reference, 1, &boolean), "fmi2SetBoolean",
                            error);
    case TL_STRING:
        return check_status(component, fmi->set_string(component->instance, &reference, 1, &text), "fmi2SetString",
                            error);
    }
    return tl_fail(error, TL_BAD_DATA, "%s.%s: unknown base type", component->name, variable->name);
}

tl_status tl_component_set_parameter(tl_component *component, const tl_variable *parameter, double value,
                                     tl_error *error) {
    return check_status(component, component->fmi->set_real(component->instance, &parameter->reference, 1, &value),
                        "fmi2SetReal", error);
}

tl_status tl_component_get_parameter(tl_component *component, const tl_variable *parameter, double *value,
                                     tl_error *error) {
    return check_status(component, component->fmi->get_real(component->instance, &parameter->reference, 1, value),
                        "fmi2GetReal", error);
}

tl_status tl_component_set_starts(tl_component *component, tl_error *error) {
    tl_status status = TL_OK;
    for (size_t i = 0; i < component->start_count && status == TL_OK; i++) {
        const tl_start_value *start = &component->starts[i];
        status = tl_component_set_start(component, start->variable, &start->value, error);
    }
    return status;
}

tl_status tl_component_reset(tl_component *component, tl_error *error) {
    tl_status status = check_status(component, component->fmi->reset(component->instance), "fmi2Reset", error);
    if (status != TL_OK) {
        component->mode =
            status == TL_FMU_FAILED ? TL_MODE_FAILED : component->mode; /* whatever mode a rejected call has left */
        return status;
    }
    component->mode = TL_MODE_INSTANTIATED;
    return tl_component_set_starts(component, error);
}

tl_status tl_component_renew(tl_component *component, tl_error *error) {
    tl_component_free(component);
    if (component->mode == TL_MODE_DEAD) {
        return tl_fail(error, TL_FMU_FATAL, "%s: cannot be instantiated again after fmi2Fatal", component->name);
    }
    tl_status status = tl_component_instantiate(component, component->callbacks, component->resources, error);
    return status == TL_OK ? tl_component_set_starts(component, error) : status;
}

tl_status tl_component_enter_initialization(tl_component *component, double start, tl_error *error) {
    const tl_fmi2 *fmi = component->fmi;
    tl_status status = check_status(
        component,
        fmi->setup_experiment(component->instance, fmi2False, 0.0, component->start_s + start,
                              component->stop_s > component->start_s ? fmi2True : fmi2False, component->stop_s),
        "fmi2SetupExperiment", error);
    if (status != TL_OK) {
        return status;
    }
    component->mode = TL_MODE_INITIALIZING;
    return check_status(component, fmi->enter_initialization_mode(component->instance), "fmi2EnterInitializationMode",
                        error);
}

tl_status tl_component_exit_initialization(tl_component *component, tl_error *error) {
    if (component->fmi->announce_ports != NULL) {
        component->fmi->announce_ports(component->instance, &component->inputs, &component->outputs);
    }
    tl_status status = check_status(component, component->fmi->exit_initialization_mode(component->instance),
                                    "fmi2ExitInitializationMode", error);
    if (status == TL_OK) {
        component->mode = TL_MODE_STEPPING;
    }
    return status;
}

tl_status tl_component_set_inputs(tl_component *component, tl_error *error) {
    const tl_ports *in = &component->inputs;
    const tl_fmi2 *fmi = component->fmi;
    fmi2Status status = fmi2OK;
    if (in->real_count != 0) {
        status = fmi->set_real(component->instance, in->real_references, in->real_count, in->reals);
        if (status > fmi2Warning) {
            return check_status(component, status, "fmi2SetReal", error);
        }
    }
    if (in->integer_count != 0) {
        status = fmi->set_integer(component->instance, in->integer_references, in->integer_count, in->integers);
        if (status > fmi2Warning) {
            return check_status(component, status, "fmi2SetInteger", error);
        }
    }
    if (in->boolean_count != 0) {
        status = fmi->set_boolean(component->instance, in->boolean_references, in->boolean_count, in->booleans);
        if (status > fmi2Warning) {
            return check_status(component, status, "fmi2SetBoolean", error);
        }
    }
    return TL_OK;
}

void tl_component_mark_outputs(const tl_component *component) {
    const tl_ports *out = &component->outputs;
    for (size_t i = 0; i < out->real_count; i++) {
        if (!isfinite(out->reals[i])) {
            out->reals[i] = (double)NAN;
        }
    }
}

/* Booleans as 0 and 1, so that equal values have equal bits. */
static void normalise_booleans(tl_component *component) {
    const tl_ports *out = &component->outputs;
    for (size_t i = 0; i < out->boolean_count; i++) {
        out->booleans[i] = out->booleans[i] != fmi2False ? fmi2True : fmi2False;
    }
}

/* Reads all outputs. *call: the last call. */
static fmi2Status read_outputs(const tl_component *component, const char **call) {
    const tl_ports *out = &component->outputs;
    const tl_fmi2 *fmi = component->fmi;
    fmi2Status status = fmi2OK;
    if (out->real_count != 0) {
        *call = "fmi2GetReal";
        status = fmi->get_real(component->instance, out->real_references, out->real_count, out->reals);
    }
    if (status <= fmi2Warning && out->integer_count != 0) {
        *call = "fmi2GetInteger";
        status = fmi->get_integer(component->instance, out->integer_references, out->integer_count, out->integers);
    }
    if (status <= fmi2Warning && out->boolean_count != 0) {
        *call = "fmi2GetBoolean";
        status = fmi->get_boolean(component->instance, out->boolean_references, out->boolean_count, out->booleans);
    }
    return status;
}

tl_status tl_component_get_outputs(tl_component *component, tl_error *error) {
    const char *call = "";
    bool may_refuse = component->mode == TL_MODE_INITIALIZING;
    fmi2Status status = may_refuse && component->reads_late ? fmi2Error : read_outputs(component, &call);
    if (may_refuse && (status == fmi2Discard || status == fmi2Error)) {
        component->reads_late = true;
        return TL_OK;
    }
    if (status > fmi2Warning) {
        return check_status(component, status, call, error);
    }
    normalise_booleans(component);
    tl_component_mark_outputs(component);
    return TL_OK;
}

/* ---- hash of all variables ---- */

/* Variables of one type, which are read in one call. */
enum { HASHED_AT_ONCE = 64 };

typedef struct hashed_values {
    fmi2ValueReference references[HASHED_AT_ONCE];
    size_t count;
    union {
        fmi2Real reals[HASHED_AT_ONCE];
        fmi2Integer integers[HASHED_AT_ONCE]; /* fmi2Boolean is the same C type */
    } values;
} hashed_values;

static bool is_hashed(const tl_variable *variable, tl_type type) {
    tl_type own = variable->type == TL_ENUMERATION ? TL_INTEGER : variable->type;
    return own == type && (variable->causality == TL_OUTPUT || variable->causality == TL_LOCAL) &&
           (variable->variability == TL_DISCRETE || variable->variability == TL_CONTINUOUS);
}

static fmi2Status read_values(const tl_component *component, tl_type type, hashed_values *read) {
    const tl_fmi2 *fmi = component->fmi;
    switch (type) {
    case TL_REAL:
        return fmi->get_real(component->instance, read->references, read->count, read->values.reals);
    case TL_INTEGER:
        return fmi->get_integer(component->instance, read->references, read->count, read->values.integers);
    default:
        return fmi->get_boolean(component->instance, read->references, read->count, read->values.integers);
    }
}

/* FNV-1a on the values that `read` lists, which is empty afterwards. */
static fmi2Status hash_values(const tl_component *component, tl_type type, hashed_values *read, uint64_t *hash) {
    const unsigned char *bytes = (const unsigned char *)&read->values;
    size_t size = read->count * (type == TL_REAL ? sizeof(fmi2Real) : sizeof(fmi2Integer));
    fmi2Status status = read->count != 0 ? read_values(component, type, read) : fmi2OK;
    for (size_t i = 0; i < size && status <= fmi2Warning; i++) {
        *hash = (*hash ^ bytes[i]) * 1099511628211U;
    }
    read->count = 0;
    return status;
}

static fmi2Status hash_type(const tl_component *component, tl_type type, uint64_t *hash) {
    const tl_model *model = component->model;
    hashed_values read = {.count = 0};
    fmi2Status status = fmi2OK;
    for (size_t i = 0; i < model->variable_count && i < TL_HASHED_VARIABLES && status <= fmi2Warning; i++) {
        if (is_hashed(&model->variables[i], type)) {
            read.references[read.count++] = model->variables[i].reference;
        }
        if (read.count == HASHED_AT_ONCE) {
            status = hash_values(component, type, &read, hash);
        }
    }
    return status <= fmi2Warning ? hash_values(component, type, &read, hash) : status;
}

uint64_t tl_component_hash(tl_component *component) {
    static const tl_type types[] = {TL_REAL, TL_INTEGER, TL_BOOLEAN};
    uint64_t hash = 14695981039346656037U;
    tl_error ignored;
    fmi2Status status = fmi2OK;
    for (size_t i = 0; i < sizeof types / sizeof types[0] && !component->hides_variables; i++) {
        status = hash_type(component, types[i], &hash);
        component->hides_variables = status > fmi2Warning;
        (void)check_status(component, status, "fmi2Get", &ignored);
    }
    return component->hides_variables ? 0 : hash;
}

/* Whether an FMU that returned fmi2Discard wants to end (FMI 2.0.4, 4.2.4). */
static bool has_terminated(const tl_component *component, fmi2Status status) {
    fmi2Boolean terminated = fmi2False;
    return status == fmi2Discard && component->fmi->get_boolean_status != NULL &&
           component->fmi->get_boolean_status(component->instance, fmi2Terminated, &terminated) <= fmi2Warning &&
           terminated != fmi2False;
}

/* Whether this step is the one that reaches beyond `stop`. */
static bool crosses(const tl_fmi2_step *step, double stop) {
    static const double rounding = 1e-6; /* in steps */
    return step->now <= stop + rounding * step->size && step->now + step->size > stop + rounding * step->size;
}

/* As check_status(), for fmi2DoStep. */
static tl_status check_step(tl_component *component, fmi2Status result, const tl_fmi2_step *step, tl_error *error) {
    double declared = component->model->stop_time;
    bool is_declared = declared > component->start_s && crosses(step, declared);
    bool is_over = component->stop_s > component->start_s && crosses(step, component->stop_s);
    bool has_ended = is_declared || is_over || has_terminated(component, result);
    tl_status status = check_status(component, result, "fmi2DoStep", error);
    if (status != TL_FMU_FAILED || !has_ended) {
        return status;
    }
    return tl_fail(error, status, "%s: the FMU ended itself%s, in fmi2DoStep from %.9g s (%s); %s", component->name,
                   is_declared ? " at the stopTime of its DefaultExperiment"
                   : is_over   ? " at the stop time that it was given"
                               : "",
                   step->now, result == fmi2Discard ? "fmi2Discard" : "fmi2Error",
                   is_declared ? "export it with a later stopTime, or end the run before by \"duration_s\""
                   : is_over   ? "raise \"stop_s\""
                               : "see its messages in the log");
}

/* For any kinds of ports. */
static tl_status step_all_types(tl_component *component, const tl_fmi2_step *step, tl_error *error) {
    tl_status status = tl_component_set_inputs(component, error);
    if (status != TL_OK) {
        return status;
    }
    component->executions++;
    fmi2Status result = component->fmi->do_step(component->instance, step->now, step->size, step->final);
    if (result > fmi2Warning) {
        return check_step(component, result, step, error);
    }
    return tl_component_get_outputs(component, error);
}

/* The same three calls of many components in one. Returns the number of components stepped. */
static size_t step_reals(tl_component *components, size_t count, const tl_fmi2_step *step, tl_status *status,
                         tl_error *error) {
    static const char *const calls[] = {"fmi2SetReal", "fmi2DoStep", "fmi2GetReal"};
    const tl_fmi2_end end = components->fmi->step_reals(components, count, step);
    tl_component *failed = &components[end.stepped];
    if (end.status > fmi2Warning) {
        const tl_fmi2_step own = tl_component_own_step(failed, step);
        *status = end.done == 1 ? check_step(failed, end.status, &own, error)
                                : check_status(failed, end.status, calls[end.done], error);
    }
    return end.stepped;
}

static tl_status refuse_to_step(const tl_component *component, tl_error *error) {
    return tl_fail(error, component->mode == TL_MODE_DEAD ? TL_FMU_FATAL : TL_FMU_FAILED,
                   "%s: cannot step after an earlier failure", component->name);
}

tl_status tl_component_step_all(tl_component *components, size_t count, double now, double step, bool final,
                                size_t *failed, tl_error *error) {
    const tl_fmi2_step what = {.now = now, .size = step, .final = final ? fmi2True : fmi2False};
    tl_status status = TL_OK;
    size_t i = 0;
    while (i < count && status == TL_OK) {
        tl_component *component = &components[i];
        size_t left = count - i;
        if (component->mode != TL_MODE_STEPPING) {
            status = refuse_to_step(component, error);
        } else if (component->reals_run != 0) {
            i +=
                step_reals(component, component->reals_run < left ? component->reals_run : left, &what, &status, error);
        } else {
            const tl_fmi2_step own = tl_component_own_step(component, &what);
            status = step_all_types(component, &own, error);
            i += status == TL_OK ? 1 : 0;
        }
    }
    *failed = status != TL_OK ? i : *failed;
    return status;
}

tl_status tl_component_step(tl_component *component, double now, double step, bool final, tl_error *error) {
    size_t failed = 0;
    tl_status status = tl_component_step_all(component, 1, now, step, final, &failed, error);
    if (status == TL_OK) {
        tl_component_mark_outputs(component);
    }
    return status;
}

tl_status tl_component_save(tl_component *component, fmi2FMUstate *state, tl_error *error) {
    if (component->replaces_states) {
        tl_component_forget(component, state);
    }
    if (component->mode == TL_MODE_DEAD) {
        return tl_fail(error, TL_FMU_FATAL, "%s: cannot be saved after fmi2Fatal", component->name);
    }
    fmi2FMUstate reused = *state;
    fmi2Status result = component->fmi->get_fmu_state(component->instance, state);
    component->replaces_states = component->replaces_states || (reused != NULL && *state != reused);
    return result <= fmi2Warning ? TL_OK : check_status(component, result, "fmi2GetFMUstate", error);
}

tl_status tl_component_restore(tl_component *component, fmi2FMUstate state, tl_error *error) {
    if (component->mode == TL_MODE_DEAD) {
        return tl_fail(error, TL_FMU_FATAL, "%s: cannot be restored after fmi2Fatal", component->name);
    }
    fmi2Status result = component->fmi->set_fmu_state(component->instance, state);
    if (result > fmi2Warning) {
        return check_status(component, result, "fmi2SetFMUstate", error);
    }
    component->mode = TL_MODE_STEPPING;
    return TL_OK;
}

bool tl_component_save_copy(tl_component *component) {
    const tl_fmi2_fallback *fallback = component->fmi->fallback;
    return fallback != NULL && component->mode != TL_MODE_DEAD && fallback->keep(component->instance) <= fmi2Warning;
}

size_t tl_component_copy_size(const tl_component *component) {
    const tl_fmi2_fallback *fallback = component->fmi->fallback;
    return fallback != NULL && component->mode != TL_MODE_DEAD ? fallback->size(component->instance) : 0;
}

bool tl_component_restore_copy(tl_component *component, const char *why) {
    const tl_fmi2_fallback *fallback = component->fmi->fallback;
    if (fallback == NULL || component->mode == TL_MODE_DEAD) {
        return false;
    }
    fmi2Status status =
        why != NULL ? fallback->next_method(component->instance, why) : fallback->restore_start(component->instance);
    if (status > fmi2Warning) {
        return false;
    }
    component->mode = TL_MODE_STEPPING;
    component->replaces_states = false;
    component->gave_up_states = component->gave_up_states || why != NULL;
    component->prefers_copy = component->prefers_copy && why == NULL;
    return true;
}

bool tl_component_has_choice(const tl_component *component) {
    const tl_fmi2_fallback *fallback = component->fmi->fallback;
    return fallback != NULL && component->mode == TL_MODE_STEPPING && fallback->has_choice(component->instance);
}

bool tl_component_prefer_copy(tl_component *component, const tl_fmi2_times *times) {
    component->replaces_states = false;
    component->prefers_copy = component->fmi->fallback->prefer_copy(component->instance, times) <= fmi2Warning;
    return component->prefers_copy;
}

void tl_component_drop_copy(const tl_component *component) {
    if (component->fmi->fallback != NULL && component->mode != TL_MODE_ABSENT && component->mode != TL_MODE_DEAD) {
        component->fmi->fallback->end_proof(component->instance);
    }
}

tl_status tl_component_reserve_states(const tl_component *component, size_t states, tl_error *error) {
    const tl_fmi2 *fmi = component->fmi;
    if (fmi->reserve_states == NULL || component->mode == TL_MODE_DEAD ||
        fmi->reserve_states(component->instance, states) <= fmi2Warning) {
        return TL_OK;
    }
    return tl_fail(error, TL_TRY_AGAIN, "%s: not enough memory for %zu states; lower \"saving.memory_mb\"",
                   component->name, states);
}

size_t tl_component_state_size(const tl_component *component) {
    return component->fmi->state_size != NULL ? component->fmi->state_size(component->instance) : 0;
}

bool tl_component_can_serialize(const tl_component *component) {
    const tl_fmi2 *fmi = component->fmi;
    return component->model->capabilities.can_get_and_set_state && component->model->capabilities.can_serialize_state &&
           fmi->get_fmu_state != NULL && fmi->set_fmu_state != NULL && fmi->free_fmu_state != NULL &&
           fmi->serialized_fmu_state_size != NULL && fmi->serialize_fmu_state != NULL &&
           fmi->deserialize_fmu_state != NULL;
}

tl_status tl_component_serialized_size(tl_component *component, fmi2FMUstate state, size_t *size, tl_error *error) {
    return check_status(component, component->fmi->serialized_fmu_state_size(component->instance, state, size),
                        "fmi2SerializedFMUstateSize", error);
}

tl_status tl_component_serialize(tl_component *component, fmi2FMUstate state, unsigned char *bytes, size_t size,
                                 tl_error *error) {
    return check_status(component,
                        component->fmi->serialize_fmu_state(component->instance, state, (fmi2Byte *)bytes, size),
                        "fmi2SerializeFMUstate", error);
}

tl_status tl_component_deserialize(tl_component *component, const unsigned char *bytes, size_t size,
                                   fmi2FMUstate *state, tl_error *error) {
    if (component->replaces_states) {
        tl_component_forget(component, state);
    }
    return check_status(
        component, component->fmi->deserialize_fmu_state(component->instance, (const fmi2Byte *)bytes, size, state),
        "fmi2DeSerializeFMUstate", error);
}

void tl_component_forget(tl_component *component, fmi2FMUstate *state) {
    if (*state == NULL || component->mode == TL_MODE_ABSENT || component->mode == TL_MODE_DEAD) {
        return;
    }
    if (component->fmi->free_fmu_state(component->instance, state) == fmi2Fatal) {
        component->mode = TL_MODE_DEAD;
    }
    *state = NULL;
}

void tl_component_free(tl_component *component) {
    if (component->mode == TL_MODE_ABSENT || component->mode == TL_MODE_DEAD) {
        return;
    }
    if (component->mode == TL_MODE_STEPPING && component->fmi->terminate(component->instance) == fmi2Fatal) {
        component->mode = TL_MODE_DEAD;
        return;
    }
    component->fmi->free_instance(component->instance);
    component->mode = TL_MODE_ABSENT;
    component->instance = NULL;
}
